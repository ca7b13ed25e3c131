"""The sliders of a live page: which numbers of a scene they move, and how far."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError, SceneError, unknown
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, shape, user_parameters
from rigidmc.planning.orbit_start import relative_to_orbit
from rigidmc.results.labels import units_text
from rigidmc.scene.parameters import parameters_of, unit_at
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.scene import Scene
from rigidmc.scene.stated import Stated, refused_numbers
from rigidmc.scene.units import hint_of_units, in_si
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Floats = NDArray[np.float64]
Range = tuple[float | str, float | str]  # a text may have a unit, as "60 deg"
WIDE = 3.0  # a slider reaches from a third of its number to three times it
_LETTERS = {"phi": "φ", "theta": "θ", "psi": "ψ"}
_INDICES = "₁₂₃"


class Slider(NamedTuple):
    """A number of a scene that a page may change, for all members.

    name : as `--set` says;  label, unit : what the page shows;  shown : of the unit per SI unit
    kind, place, row : what it is on the page: a part of the body (moments, mass, centre), of the
        spin, an angle of the attitude, or the parameter of an effect in a row of the block
    given, low, high : the number of the first member, which the page draws, and the ends
    source : what the scene has: a number or a distribution
    is_shared : whether all members have this number
    usual : whether the ends are the page's own choice
    array, component : where the numbers that members are built from have it
    """

    name: str
    label: str
    unit: str
    shown: float
    kind: str
    place: int
    row: int
    given: float
    low: float
    high: float
    source: Any
    is_shared: bool
    array: str
    component: int
    usual: bool = True

    def numbers(self, start: Mapping[str, Floats]) -> Floats:
        """Return the numbers of members, from those they are built from."""
        values: Floats = np.atleast_2d(start[self.array])[self.component]
        return values


def make_sliders(
    scene: Scene, start: Mapping[str, Floats], asked: Mapping[str, Range | None] | None
) -> list[Slider]:
    """Return the sliders of a page.

    start : the numbers that members are built from, see `rigidmc.planning.initial`
    asked : {name: ends, in SI units or texts with a unit, None for a third to three times}; None
        for moments, spin, lean and gravity
    Raises OptionError for a name that no slider can move, with the reason.
    """
    sliders = {slider.name: slider for slider in _all(scene, start)}
    if asked is None:
        return [slider for name, slider in sliders.items() if _is_usual(name)]
    refused = _refusals(scene)
    made = []
    for name, ends in asked.items():
        why = next((why for part, why in refused.items() if name.startswith(part)), None)
        if name not in sliders and why is not None:
            raise OptionError(f"no slider can move it: {why}", at="slider", value=name)
        if name not in sliders:
            kind = "number that a slider can move"
            raise unknown(kind, sliders, at="slider", value=name, error=OptionError)
        slider = sliders[name]
        if ends is not None:
            slider = _between(slider, *(_end(scene, name, end) for end in ends))
        made.append(slider)
    return made


def _end(scene: Scene, name: str, end: float | str) -> float:
    """Return the end of a slider in SI units; OptionError."""
    at, units = f"slider.{name}", unit_at(scene.model, name)
    try:
        return float(in_si(end, units, at))
    except SceneError as error:
        raise OptionError(error.rule, at=at, value=end) from None
    except ValueError:
        rule = f"expected LOW:HIGH, two numbers{hint_of_units(units)}"
        raise OptionError(rule, at=at, value=end) from None


def _between(slider: Slider, low: float, high: float) -> Slider:
    """Return a slider with other ends; OptionError."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        rule = "expected two finite numbers, the lower one first"
        raise OptionError(rule, at=f"slider.{slider.name}", value=f"{low:g}:{high:g}")
    for end in (low, high):
        if slider.kind in ("moments", "mass") and not end > 0.0:
            raise OptionError("must be above 0", at=f"slider.{slider.name}", value=end)
        if slider.kind == "angle" and abs(end) > 2.0 * math.pi:
            rule = f"is more than a turn: in degrees, write {end:g}deg"
            raise OptionError(rule, at=f"slider.{slider.name}", value=f"{end:g} rad")
    if not low <= slider.given <= high:
        rule = f"the page begins at {slider.given:.6g}, which must lie between the ends"
        raise OptionError(rule, at=f"slider.{slider.name}", value=f"{low:g}:{high:g}")
    return slider._replace(low=low, high=high, usual=False)


def _is_usual(name: str) -> bool:
    """Whether a page has this slider unless others are asked for."""
    if name.startswith("effects."):
        return name.endswith((".g", ".field.3"))
    return name.startswith(("body.moments.", "start.omega.", "start.momentum.")) or (
        name == "start.attitude.theta"
    )


def _refusals(scene: Scene) -> dict[str, str]:
    """Return {beginning of names: why no slider moves them}."""
    model, refused = scene.model, dict[str, str]()
    if model.body.is_turned:
        rule = "the body is described in other axes than its principal axes"
        refused |= {"body.": rule, "start.": rule}
    elif isinstance(model.body.stated, Stated):
        refused["body."] = "it also moves the inertia: give moments about the fixed point"
    else:
        refused |= {name: f"it {why}" for name, why in refused_numbers(model.body.stated).items()}
    for solid in SOLIDS:
        rule = "move body.moments.1 to 3 and body.mass: the page then draws an ellipsoid"
        refused.setdefault(f"body.{solid}.", rule)
    if isinstance(model.start.attitude, str) or not model.start.has_euler_angles:
        refused.setdefault("start.attitude", "the attitude is not given by Euler angles")
    if relative := relative_to_orbit(model):
        refused |= {f"start.{name}": "it is relative to the orbit" for name in relative}
    spin = model.start.spin_name
    if isinstance(getattr(model.start, spin), VectorDistribution):
        refused.setdefault(f"start.{spin}", "a distribution draws the whole vector")
    return refused


def _all(scene: Scene, start: Mapping[str, Floats]) -> list[Slider]:
    """Return all sliders that a scene can have."""
    model, refused, made = scene.model, _refusals(scene), list[Slider]()
    parameters = parameters_of(model)
    word = model.start.spin_name
    spin = float(np.abs(start[f"start_{word}"]).max())

    def add(name: str, label: str, kind: str, place: int, at: tuple[str, int], source: Any) -> None:
        values = np.atleast_2d(start[at[0]])[at[1]]
        is_common = bool((values == values[0]).all())
        unit, by = units_text(parameters[name].unit), 1.0
        if unit == "rad":
            unit, by = "°", 180.0 / math.pi
        number = float(values[0])
        low, high = _ends(kind, number, values, spin)
        if kind == "moments":
            low, high = _possible(start, place, number, low, high)
        row = place if kind == "effect" else 0
        is_one = is_common and is_shared(source)
        ends = number, low, high
        made.append(Slider(name, label, unit, by, kind, place, row, *ends, source, is_one, *at))

    if "body." not in refused:
        for k in range(3):
            source = _of_vector(model.body.moments, k)
            add(f"body.moments.{k + 1}", f"I{_INDICES[k]}", "moments", k, ("moments", k), source)
        add("body.mass", "mass", "mass", 0, ("mass", 0), model.body.mass)
        for k in range(3):
            source = _of_vector(model.body.centre, k)
            add(f"body.centre.{k + 1}", f"centre{_INDICES[k]}", "centre", k, ("centre", k), source)
    if not any(f"start.{word}".startswith(part) for part in refused if part != "body."):
        letter = "ω" if word == "omega" else "L"
        for k, source in enumerate(getattr(model.start, word)):
            label = f"{letter}{_INDICES[k]}(0)"
            add(f"start.{word}.{k + 1}", label, "spin", k, (f"start_{word}", k), source)
    if "start_euler" in start and not any("start.attitude".startswith(p) for p in refused):
        for k, angle in enumerate(angle_names(model.start.sequence)):
            label, source = f"{_LETTERS.get(angle, angle)}(0)", model.start.attitude[k]
            add(f"start.attitude.{angle}", label, "angle", k, ("start_euler", k), source)
    row = layout.EFFECTS
    for label, effect in label_effects(model.effects):
        for field, value in zip(effect._fields, effect, strict=True):
            count = shape(effect, field)
            turned = model.body.is_turned and field in facts(effect).in_body
            for k in range(count or 1):
                name = f"effects.{label}.{field}" + (f".{k + 1}" if count else "")
                source_of = value[k] if count and isinstance(value, tuple) else value
                if field in user_parameters(effect) and not turned:
                    words = (
                        f"{field}{_INDICES[k] if count and count <= 3 else k + 1 if count else ''}"
                    )
                    add(name, words, "effect", row, (f"{label}_{field}", k), source_of)
                row += 1
    return [slider for slider in made if slider.name not in refused]


def _of_vector(vector: Any, k: int) -> Any:
    """Return component k of a vector of numbers, or the distribution of the whole vector."""
    return vector[k] if isinstance(vector, tuple) else vector


def _ends(kind: str, number: float, values: Floats, spin: float) -> tuple[float, float]:
    """Return the ends of a slider around its number; spin : largest component of the spin."""
    if kind == "spin" and abs(number) < 0.1 * spin:
        return -0.3 * spin, 0.3 * spin
    if kind == "angle":
        return (0.0, math.pi) if 0.0 <= number <= math.pi else (-math.pi, math.pi)
    # a slider of a number that is 0 for all members ends at 3 units of it
    largest = float(np.abs(values).max()) or 1.0
    if number > 0.0:
        return number / WIDE, number * WIDE
    return -WIDE * largest, WIDE * largest


def _possible(
    start: Mapping[str, Floats], k: int, number: float, low: float, high: float
) -> tuple[float, float]:
    """Return the part of a slider of moment k where all members can exist, with their other moments
    J about the centre of mass: ``|J_i - J_j| <= J_k <= J_i + J_j``.
    """
    values, centre = start["moments"], start["centre"]
    shift = start["mass"].reshape(-1) * ((centre**2).sum(0) - centre**2)
    about_centre = values - shift
    first, second = (about_centre[i] for i in range(3) if i != k)
    # a slider gives four digits, which may lie beyond an end by 5e-4 of it
    least = number + float((np.abs(first - second) * (1.0 + 1e-3) - about_centre[k]).max())
    most = number + float(((first + second) * (1.0 - 1e-3) - about_centre[k]).min())
    return min(number, max(low, least)), max(number, min(high, most))
