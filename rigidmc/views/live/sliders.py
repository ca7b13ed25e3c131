"""The sliders of a live page: which numbers of a scene they move, and how far."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError, SceneError, unknown
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, shape
from rigidmc.planning.orbit_start import relative_to_orbit
from rigidmc.results.labels import units_text
from rigidmc.scene.body_parameters import POSITIVE
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import Parameter
from rigidmc.scene.parameters import parameters_of
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.stated import Stated, refused_numbers
from rigidmc.scene.units import in_si
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Range = tuple[float | str, float | str]  # a text may have a unit, as "60 deg"
Asked = Mapping[str, Range | None] | None
WIDE = 3.0  # a slider reaches from a third of its number to three times it
_LETTERS = {"phi": "φ", "theta": "θ", "psi": "ψ"}
_INDICES = "₁₂₃"
# {field of the body or start: (kind, where members have it, label)}
_SHOWN = {
    "moments": ("moments", "moments", "I{}"),
    "mass": ("mass", "mass", "mass"),
    "centre": ("centre", "centre", "centre{}"),
    "omega": ("spin", "start_omega", "ω{}(0)"),
    "momentum": ("spin", "start_momentum", "L{}(0)"),
    "attitude": ("angle", "start_euler", "{}(0)"),
}


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
    parameter: Parameter
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

    def numbers(self, start: Mapping[str, Array]) -> Array:
        """Return the numbers of members, from those they are built from."""
        values: Array = np.atleast_2d(start[self.array])[self.component]
        return values


def make_sliders(
    model: Model, start: Mapping[str, Array], asked: Asked, driven: bool = False
) -> list[Slider]:
    """Return the sliders of a page.

    start : the numbers that members are built from, see `rigidmc.planning.initial`
    asked : {name: ends, in SI units or texts with a unit, None for a third to three times}; None
        for moments, spin, lean and gravity
    driven : whether damping may be negative
    Raises OptionError for a name that no slider can move, with the reason.
    """
    sliders = {slider.name: slider for slider in _all(model, start, driven)}
    if asked is None:
        return [slider for slider in sliders.values() if _is_usual(slider.parameter)]
    refused = _refusals(model)
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
            slider = _between(slider, *(_end(slider.parameter, end) for end in ends))
        made.append(slider)
    return made


def _end(parameter: Parameter, end: float | str) -> float:
    """Return the end of a slider in SI units; OptionError."""
    at, units = f"slider.{parameter.name}", parameter.unit
    try:
        return float(in_si(end, units, at))
    except SceneError as error:
        raise OptionError(error.rule, at=at, value=end) from None
    except ValueError:
        hint = f', or text with its unit, such as "1.5 {units_text(units)}"' * (units != "1")
        raise OptionError(f"expected LOW:HIGH, two numbers{hint}", at=at, value=end) from None


def _between(slider: Slider, low: float, high: float) -> Slider:
    """Return a slider with other ends; OptionError."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        rule = "expected two finite numbers, the lower one first"
        raise OptionError(rule, at=f"slider.{slider.name}", value=f"{low:g}:{high:g}")
    least, most = slider.parameter.limits
    for end in (low, high):
        if not least <= end <= most:
            above_zero = least == POSITIVE[0]
            rule = "above 0" if above_zero else f"between {least:g} and {most:g}"
            raise OptionError(f"must be {rule}", at=f"slider.{slider.name}", value=end)
        if slider.kind == "angle" and abs(end) > 2.0 * math.pi:
            rule = f"is more than a turn: in degrees, write {end:g}deg"
            raise OptionError(rule, at=f"slider.{slider.name}", value=f"{end:g} rad")
    if not low <= slider.given <= high:
        rule = f"the page begins at {slider.given:.6g}, which must lie between the ends"
        raise OptionError(rule, at=f"slider.{slider.name}", value=f"{low:g}:{high:g}")
    return slider._replace(low=low, high=high, usual=False)


def _is_usual(parameter: Parameter) -> bool:
    """Whether a page has this slider unless others are asked for."""
    table, field, *places = parameter.path
    if table == "effects":
        return places in (["g"], ["field", 2])
    return field in ("moments", "omega", "momentum") or parameter.name == "start.attitude.theta"


def _refusals(model: Model) -> dict[str, str]:
    """Return {beginning of names: why no slider moves them}."""
    refused = dict[str, str]()
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


def _all(model: Model, start: Mapping[str, Array], driven: bool) -> list[Slider]:
    """Return all sliders that a model can have."""
    refused, made = tuple(_refusals(model)), list[Slider]()
    spin = float(np.abs(start[f"start_{model.start.spin_name}"]).max())
    labels, rows = label_effects(model.effects), rows_of_effects(model.effects)
    for name, parameter in parameters_of(model, driven).items():
        table, first, *rest = parameter.path
        field, places = (rest[0], rest[1:]) if table == "effects" else (first, rest)
        is_number = len(places) < 2 and all(isinstance(place, int) for place in places)
        if table == "run" or not is_number or name.startswith(refused):
            continue
        k, row, word = int(places[0]) if places else 0, 0, str(field)
        if table == "effects":
            label, part = labels[int(first)]
            if model.body.is_turned and field in facts(part).in_body:
                continue
            kind, array = "effect", f"{label}_{field}"
            row = rows[array][k]
            index = _INDICES[k] if (shape(part, word) or 0) <= 3 else str(k + 1)
            shown = f"{field}{index if places else ''}"
        else:
            part, angle = getattr(model, str(table)), angle_names(model.start.sequence)[k]
            kind, array, shown = _SHOWN[word]
            shown = shown.format(_LETTERS.get(angle, angle) if kind == "angle" else _INDICES[k])
        values = np.atleast_2d(start[array])[k]
        source = getattr(part, word)
        source = source[k] if places and isinstance(source, tuple) else source
        is_one = bool((values == values[0]).all()) and is_shared(source)
        unit, by = units_text(parameter.unit), 1.0
        if unit == "rad":
            unit, by = "°", 180.0 / math.pi
        number = float(values[0])
        low, high = _ends(kind, number, values, spin)
        if kind == "moments":
            low, high = _possible(start, k, number, low, high)
        least, most = parameter.limits
        low, high = min(number, max(low, least)), max(number, min(high, most))
        at = row or k, row, number, low, high
        made.append(Slider(name, parameter, shown, unit, by, kind, *at, source, is_one, array, k))
    return made


def rows_of_effects(effects: Sequence[Any]) -> dict[str, range]:
    """Return {"LABEL_FIELD": its rows in the block} of the parameters of effects."""
    rows, row = dict[str, range](), layout.EFFECTS
    for label, effect in label_effects(effects):
        for field in effect._fields:
            rows[f"{label}_{field}"] = range(row, row := row + (shape(effect, field) or 1))
    return rows


def _ends(kind: str, number: float, values: Array, spin: float) -> tuple[float, float]:
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
    start: Mapping[str, Array], k: int, number: float, low: float, high: float
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
