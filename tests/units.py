"""Scenes, and all that is asked of them, in other units: pure numbers have to be the same.

A Units has factors of masses and of times; lengths stay, so that moments and torques have the
factor of the mass at fixed times. `asked(scene, units)` gives {function: function of no argument}
for every public function that takes a scene, each of which returns {name: (values, unit)}.
"""

import math
import re
import warnings
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import rigidmc as rm
from rigidmc.effects import EFFECTS
from rigidmc.effects.parameters import filled, given, numbers
from rigidmc.effects.protocol import facts, is_random
from rigidmc.observables import OBSERVABLES, WATCHED, WATCHED_STATISTICS
from rigidmc.planning.units import scaled

# no numbers of the motion: what a computer takes, and what is found by rounding alone
CLOCK = re.compile(r"second|ns_|cost|cheapest|gain")
# notes on what a body may be made of, and in which units a user thinks, know SI units
ABOUT_SI = re.compile(r"air|molecule|star|osmium|millimetre|degrees|kelvin| K\b")


class Units(NamedTuple):
    """Factors of masses and of times."""

    mass: float
    time: float

    def of(self, units: str) -> float:
        """The factor of a number in `units`; its lengths stay."""
        factor = 1.0
        for word in units.split():
            name, power = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", word).groups()  # type: ignore[union-attr]
            kg, s = _EXPONENTS[name]
            factor *= (self.mass**kg * self.time**s) ** int(power or 1)
        return factor


_EXPONENTS = {
    "1": (0, 0), "rad": (0, 0), "kg": (1, 0), "m": (0, 0), "s": (0, 1), "N": (1, -2), "J": (1, -2),
    "W": (1, -3), "Hz": (0, -1), "A": (0, 0), "T": (1, -2),
}  # fmt: skip
PLAIN = Units(1.0, 1.0)
OTHERS = (Units(1e-20, 1.0), Units(1e20, 1.0), Units(1.0, 1e-6), Units(1.0, 1e6))
BINARY = (Units(2.0**-66, 1.0), Units(2.0**66, 1.0), Units(1.0, 2.0**-20), Units(1.0, 2.0**20))

# integrator and effects: what is compiled. All effects occur, and each driver without an energy
# also acts on bodies at rest.
KINDS = {
    "free": ("rk8", ()),
    "heavy": ("rk4", ("gravity", "viscous_damping")),
    "orbit": ("rk8", ("gravity_gradient", "rotating_field")),
    "sloshing": ("rk8", ("rotor", "internal_dissipation")),
    "driven": ("rk8", ("body_torque", "space_torque", "periodic_torque")),
    "wheel": ("strang", ("spring", "rotor", "axial_damping", "energy_dissipation")),
    "rubbed": (
        "rk8",
        ("uniform_field", "potential", "moving_pivot", "matrix_damping", "quadratic_drag",
         "dry_friction"),
    ),
    "bathed": ("strang", ("gravity", "bath")),
}  # fmt: skip


def scene(kind: str, seed: int) -> rm.Scene:
    """A scene of one of KINDS, a function of the seed: 0 at rest, 3 a table of bodies."""
    integrator, words = KINDS[kind]
    some = np.random.default_rng([list(KINDS).index(kind), seed])
    second = some.uniform(0.3, 0.9, 3)
    moments: Any = tuple(second.sum() - second)
    centre = (0.0, 0.0, 0.0) if kind == "orbit" else tuple(0.3 * some.normal(size=3))
    if seed % 4 == 3:
        table = some.uniform(0.3, 0.9, (3, 16))
        moments = tuple(table.sum(axis=0) - table)
    body = rm.Body.from_moments(moments, rm.normal(1.0, 0.01), centre)
    effects = tuple(_effect(word, some) for word in words)
    rest = seed % 4 == 0 and kind != "free"
    spin: Any = (0.0, 0.0, 0.0) if rest else tuple(rm.normal(x, 0.1) for x in some.normal(size=3))
    lean = rm.normal(0.8, 0.1)
    if seed % 2 == 1:  # only the start is drawn: what `ftle` takes
        body = rm.Body.from_moments(moments, 1.0, centre)
        effects = tuple(EFFECTS[word](*EFFECTS[word].example) for word in words)
    start = rm.Start(omega=spin, attitude=(0.3, lean, 0.4))
    observables = (rm.Flips(2), rm.Passage(3, 0.6))
    run = {"integrator": integrator, "dt": 0.05, "t_end": 4.0, "members": 8, "seed": seed}
    return rm.Scene(body, effects, start, observables=observables).with_run(**run)


def _effect(word: str, some: np.random.Generator) -> Any:
    """The example of an effect, its first number drawn."""
    kind = EFFECTS[word]
    example, values = kind(*kind.example), []
    fields = set(given(kind))
    for i, (field, _, value) in enumerate(numbers(example)):
        law = i == 0 and field in fields and word != "matrix_damping" and value != 0.0
        values.append(rm.normal(value, 0.02 * abs(value)) if law else value)
    return filled(kind, values)


def in_units(one: rm.Scene, units: Units) -> rm.Scene:
    """A scene in other units."""
    return scaled(one, mass=units.mass, time=units.time)


def of_dataset(ds: xr.Dataset) -> dict[str, tuple[Any, str]]:
    """{name: (values, unit)} of the numbers of a Dataset."""
    found = {}
    for name, variable in ds.variables.items():
        if "number" in variable.dims and "units" in ds.coords:  # numbers of different units
            variable = variable.transpose(..., "number")
            for i, unit in enumerate(ds.units.values):
                if variable.dtype.kind in "fiub":
                    found[f"{name} {i}"] = variable.values[..., i], str(unit)
        elif variable.dtype.kind in "fiub" and not CLOCK.search(str(name)):
            found[str(name)] = variable.values, variable.attrs.get("units", "1")
    return found


def asked(one: rm.Scene, units: Units) -> dict[str, Any]:
    """{name: function} of all that a scene is asked, each {variable: (values, unit)}."""
    noisy = any(map(is_random, one.effects))
    fast, t = "omega_max[3]", units.time
    saves = [*OBSERVABLES, *(name for name in WATCHED if name != "histogram")]
    saves += [name for name, (of, _) in WATCHED_STATISTICS.items() if of in ("omega", "energy")]
    if noisy or one.run.integrator not in ("rk4", "rk8", "strang"):
        saves.remove("work")
    if "work" in saves and not one.effects:
        saves.remove("work")
    every = one.run.t_end / 4.0

    def simulated() -> Any:
        return rm.simulate(one, save=saves, every=every)

    def again() -> Any:
        ds = rm.simulate(one, save=("omega", "energy"), every=every)
        return rm.rerun(ds, 3, every=0.5 * every)

    def chosen() -> Any:
        return rm.simulate(one, integrator="auto", tolerance=1e-6, save=("omega", "momentum"))

    def until() -> Any:
        ds, interval = rm.simulate_until(one, f"mean({fast}) +- 20%", most=256)
        return {**of_dataset(ds), **_interval(interval, "rad s-1")}

    def spread() -> Any:
        points = one.with_run(points="sobol")
        return _interval(rm.randomised(points, f"mean({fast})", 64), "rad s-1")

    def measured() -> Any:
        ds = rm.simulate(one, save=("omega_max", "passage", "flips", "megno"), members=32)
        texts = (f"mean({fast})", "rad s-1"), (f"p({fast} >= {1.0 / t!r})", "1")
        texts += (("mean(lyapunov)", "s-1"), ("median(passage_first)", "s"))
        found = {text: _interval(ds.rigid.measure(text), unit) for text, unit in texts}
        return {f"{i} {k}": v for i, one in enumerate(found.values()) for k, v in one.items()}

    def mapped() -> Any:
        ends = ((0.5 / t, 2.0 / t), (-1.0 / t, 1.0 / t))
        sides = [(f"start.omega.{i}", *e) for i, e in zip((1, 3), ends, strict=True)]
        ds = rm.stability_map(one, *sides, ("mean(flips)", f"p({fast} >= {1.0 / t!r})"), 3, 2)
        return ds.rename({name: _words(str(name)) for name in ds.data_vars})

    def cross() -> Any:
        return rm.section(one, "momentum[2] = 0", way="both", members=4)

    def periodic() -> Any:
        return rm.section(one, f"every {0.5 * t!r}", members=4)

    def spectra() -> Any:
        return rm.frequencies(one, "momentum[1]", 2, members=4, t_end=16.0 * t, every=0.1 * t)

    def grown() -> Any:
        return rm.ftle(one, 8)

    def shares() -> Any:  # measures have units of their own, which no attribute tells
        found = of_dataset(rm.sensitivity(one, f"mean({fast})", 16))
        units = {"mean": "s-1", "variance": "s-2"}
        return {name: (x, units.get(name, unit)) for name, (x, unit) in found.items()}

    def sure() -> Any:
        return rm.basins(one, f"p(omega_last[3] >= {0.2 / t!r})", 16)

    def seldom() -> Any:
        return rm.rare(one, "p(passages >= 1)", 1e-3, 40, 2)

    def tail() -> Any:
        return rm.rare(one, f"p({fast} >= {4.0 / t!r})", 1e-3, 40, 2)

    def levels() -> Any:
        found = of_dataset(rm.multilevel(one, f"mean({fast}) +- 20%", most=256))
        return {**found, "variance": (found["variance"][0], "s-2")}

    def dear() -> Any:  # the ladder ends where steps take too long
        return rm.accuracy(one, ["rk4"], [1e-3], members=4).isel(row=slice(6))

    return {
        "simulate": simulated, "rerun": again, "simulate(tolerance)": chosen,
        "simulate_until": until, "randomised": spread, "rigid.measure": measured,
        "stability_map": mapped, "section": cross, "section, every": periodic,
        "frequencies": spectra, "ftle": grown, "sensitivity": shares, "basins": sure,
        "rare, event": seldom, "rare, tail": tail, "multilevel": levels, "accuracy": dear,
    }  # fmt: skip


def _interval(one: Any, unit: str) -> dict[str, tuple[Any, str]]:
    return {name: (getattr(one, name), unit) for name in ("value", "low", "high")}


class Answer(NamedTuple):
    """What a function gave: pure numbers, the notes without numbers, or the words of an error."""

    numbers: dict[str, Any]
    notes: tuple[str, ...]
    error: str


def answer(function: Any, units: Units) -> Answer:
    """The Answer of a function of `asked`, its numbers divided by their units."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = function()
        except rm.RigidmcError as error:
            return Answer({}, (), _words(str(error)))
    if isinstance(found, xr.Dataset):
        found = of_dataset(found)
    numbers = {}
    for name, (values, unit) in found.items():
        with np.errstate(all="ignore"):
            numbers[name] = np.asarray(values, float) / units.of(_unit(name, unit))
    texts = {str(w.message) for w in caught if issubclass(w.category, rm.SceneWarning)}
    return Answer(numbers, tuple(sorted(_words(x) for x in texts if not ABOUT_SI.search(x))), "")


def _unit(name: str, unit: str) -> str:
    return "1" if unit in ("", "degree", "%") else unit


def _words(text: str) -> str:
    """A text without its numbers."""
    return re.sub(r"[-+]?\d[\d,.]*(e[-+]?\d+)?", "#", text)


def apart(one: Answer, two: Answer) -> tuple[float, str]:
    """(largest difference of the numbers of two Answers, of the largest of each; where)."""
    if one.error != two.error:
        return math.inf, f"{one.error or 'no error'} / {two.error or 'no error'}"
    if one.notes != two.notes:
        return math.inf, f"notes {set(one.notes) ^ set(two.notes)}"
    if one.numbers.keys() != two.numbers.keys():
        return math.inf, f"variables {one.numbers.keys() ^ two.numbers.keys()}"
    worst, where = 0.0, ""
    for name, a in one.numbers.items():
        b = two.numbers[name]
        if a.shape != b.shape or not np.array_equal(np.isfinite(a), np.isfinite(b)):
            return math.inf, f"{name}: {a} / {b}"
        ends = np.isfinite(a)
        if not ends.any():
            continue
        size = _size(name, one.numbers)
        off = (
            float(np.abs(a[ends] - b[ends]).max() / size)
            if size > 0.0
            else float(np.abs(b[ends]).max() > 0.0)
        )
        if off > worst:
            worst, where = off, name
    return worst, where


def _size(name: str, numbers: dict[str, Any]) -> float:
    """By what a difference is measured: the largest of the numbers; 1 for a drift, which is
    relative, and the square of the mean for a variance, which may be rounding of a constant."""
    a, mean = numbers[name], numbers.get(name.replace("variance", "mean"))
    size = np.nanmax(np.abs(a[np.isfinite(a)]))
    if "drift" in name:
        return max(1.0, size)
    if "variance" in name and mean is not None:
        return max(size, np.nanmax(np.abs(mean)) ** 2)
    return size


def drivers() -> set[str]:
    """The effects of all KINDS."""
    return {word for _, words in KINDS.values() for word in words}


assert drivers() == set(EFFECTS), "an effect is in no kind"
assert all(facts(kind).units for kind in EFFECTS.values())
