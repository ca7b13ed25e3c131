"""Scenes, and all that is asked of them, in other units; `tests.tools.pure_numbers` compares.

A Units has factors of masses and of times; lengths stay, so that moments and torques have the
factor of the mass at fixed times. `asked(scene, units)` gives {function: function of no argument}
for every public function that takes a scene, each of which returns {name: (values, unit)}.
"""

import re
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import rigidmc as rm
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import (
    facts,
    from_numbers,
    is_random,
    numbers,
    user_parameters,
)
from rigidmc.physics.observables import OBSERVABLES, bare_observables, square_units, statistics
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.scene.derivatives import quotient
from rigidmc.scene.distributions import Distribution
from rigidmc.studies.stress.trust import trust
from rigidmc.views.live.engine import live_run

# no numbers of the motion: what a computer takes, and what is found by rounding alone
CLOCK = re.compile(r"second|ns_|cost|cheapest|gain")


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

T_END = 4.0  # s, of every scene
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
if added := tuple(word for word in EFFECTS if word not in str(KINDS)):
    KINDS["added"] = ("rk8", added)


def scene(kind: str, seed: int) -> rm.Scene:
    """A scene of one of KINDS, a function of the seed: 0 at rest, 3 a table of bodies."""
    integrator, words = KINDS[kind]
    some = np.random.default_rng([list(KINDS).index(kind), seed])
    second = some.uniform(0.3, 0.9, 3)
    moments: Any = tuple(second.sum() - second)
    centre = (0.0, 0.0, 0.0) if kind == "orbit" else tuple(0.3 * some.normal(size=3))
    if seed % 4 == 3:
        table = some.uniform(0.3, 0.9, (3, 64))
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
    run = {"integrator": integrator, "dt": 0.05, "t_end": T_END, "members": 8, "seed": seed}
    return rm.Scene(body, effects, start, observables=observables).with_run(**run)


def _effect(word: str, some: np.random.Generator) -> Any:
    """The example of an effect, its first number drawn."""
    kind = EFFECTS[word]
    example, values = kind(*kind.example), []
    fields = set(user_parameters(kind))
    for i, (field, _, value) in enumerate(numbers(example)):
        law = i == 0 and field in fields and word != "matrix_damping" and value != 0.0
        values.append(rm.normal(value, 0.02 * abs(value)) if law else value)
    return from_numbers(kind, values)


def in_units(one: rm.Scene, units: Units) -> rm.Scene:
    """A scene in other units."""
    return scale_scene(one, mass=units.mass, time=units.time)


def of_dataset(ds: xr.Dataset) -> dict[str, tuple[Any, str]]:
    """{name: (values, unit)} of the numbers of a Dataset."""
    found = {}
    for name, variable in ds.variables.items():
        if variable.dtype.kind not in "fiub" or CLOCK.search(str(name)):
            continue
        own = variable.attrs.get("units")
        if own is None and "units" in ds.coords and ds.units.dims[0] in variable.dims:
            dim = ds.units.dims[0]  # along which numbers differ in their units
            values = variable.transpose(..., dim).values
            for i, unit in enumerate(map(str, ds.units.values)):
                of = square_units(unit) if name == "variance" else unit
                found[f"{name} {i}"] = values[..., i], of
        else:
            found[str(name)] = variable.values, own or "1"
    return found


def observed(one: rm.Scene, time: float) -> tuple[rm.Scene, list[str]]:
    """A scene with every observable that it takes, in units of this time, and all their names."""
    orbit = any(isinstance(effect, rm.GravityGradient) for effect in one.effects)
    more = rm.PointingAngle(3), *([rm.OrbitAngles()] if orbit else [])
    spins = rm.Histogram("omega[3]", -3.0 / time, 3.0 / time, 20)
    saves = [name for name in OBSERVABLES if name != "histogram"]
    # statistics know no effects: all of them beside six take minutes to compile
    few = bare_observables() if len(one.effects) <= 2 else ("omega", "energy")
    saves += [name for name, (of, _) in statistics().items() if of in few]
    bathed = any(map(is_random, one.effects))
    if not one.effects or bathed:
        saves.remove("work")
    if not bathed:
        saves.remove("noise_score")
    if not orbit:
        saves.remove("orbit_angles")
    return replace(one, observables=(*one.observables, *more, spins)), saves


def one_body(one: rm.Scene, start_alone: bool = False) -> rm.Scene:
    """A scene with the first row of its table of bodies; start_alone : nothing but the start of it
    is drawn, which is what `ftle` takes."""
    moments: Any = tuple(np.ravel(x)[0] for x in one.body.moments)
    body, effects = replace(one.body, moments=moments), one.effects
    if start_alone:
        body = replace(body, mass=_middle(body.mass))
        effects = tuple(
            from_numbers(type(e), [_middle(value) for *_, value in numbers(e)]) for e in effects
        )
    return replace(one, body=body, effects=effects)


def _middle(value: Any) -> Any:
    return value.parameters[0] if isinstance(value, Distribution) else value


def asked(one: rm.Scene, units: Units) -> dict[str, Any]:
    """{name: function} of all that a scene is asked, each {variable: (values, unit)}."""
    every, single = one.run.t_end / 4.0, one_body(one)
    fast, t = "omega_max[3]", units.time
    # a record is one motion: the attitude is known
    level = replace(single, start=replace(single.start, attitude=(1.0, 0.0, 0.0, 0.0)))

    def simulated() -> Any:
        scene, saves = observed(one, t)
        return rm.simulate(scene, save=saves, every=every)

    def again() -> Any:
        ds = rm.simulate(one, save=("omega", "energy"), every=every)
        return rm.rerun(ds, 3, every=0.5 * every)

    def chosen() -> Any:
        # the cheapest by the clock, perhaps another integrator and step than in other units
        names = ["omega", "momentum"]
        return rm.simulate(one, integrator="auto", tolerance=1e-6, save=names)[names]

    def until() -> Any:
        ds, interval = rm.simulate_until(single, f"mean({fast}) +- 20%", most=256)
        return {**of_dataset(ds), **_interval(interval, "rad s-1")}

    def totals() -> Any:
        ds = rm.simulate_totals(single, [f"mean({fast})", "p(flips >= 1)"], members=64)
        numbers = np.stack([ds.value.values, ds.low.values, ds.high.values])
        return {"mean": (numbers[:, 0], "rad s-1"), "p": (numbers[:, 1], "1")}

    def spread() -> Any:
        points = single.with_run(points="sobol")
        return _interval(rm.estimate_rqmc(points, f"mean({fast})", 64), "rad s-1")

    def weighed() -> Any:
        def shifted(law: Any) -> Any:
            if not isinstance(law, Distribution) or law.name != "normal":
                return law
            mean, deviation = law.parameters
            return rm.normal(mean + 0.1 * deviation, deviation)

        ds = rm.simulate(single, save=("omega",), members=160)
        new = single.with_model(single.model.mapped(shifted))
        found = rm.reweight(ds, new, "mean(omega_final[3])")
        kinds = dict.fromkeys(("estimate", "standard_error"), "rad s-1") | {"weight": "1"}
        return {name: (found[name].values, unit) for name, unit in kinds.items()}

    def measured() -> Any:
        ds = rm.simulate(single, save=("omega_max", "passage", "flips", "megno"), members=32)
        texts = (f"mean({fast})", "rad s-1"), (f"p({fast} >= {1.0 / t!r})", "1")
        texts += (("mean(lyapunov)", "s-1"), ("median(passage_first)", "s"))
        found = {text: _interval(ds.rigid.measure(text), unit) for text, unit in texts}
        by = of_dataset(ds.rigid.measure(f"mean({fast})", by="passages"))
        number = (("lyapunov" if i == 2 else i, one) for i, one in enumerate(found.values()))
        return {**by, **{f"{i} {k}": v for i, one in number for k, v in one.items()}}

    def followed() -> Any:
        save = ("omega", "momentum", "attitude", "energy")
        ds = rm.simulate(one, save=save, t_end=2.0 * t, every=0.05 * t)
        numbers, rigid = of_dataset(ds.rigid.euler()), ds.rigid
        numbers |= {**of_dataset(rigid.euler("321")), "rotation": (rigid.rotation().as_quat(), "1")}
        arrays = {name: getattr(rigid, name)() for name in ("momentum", "phase", "energy", "drift")}
        arrays |= {"psi": rigid.unwrapped("psi"), "polhode": rigid.polhode(1)}
        arrays |= {name: getattr(rigid, name)("omega") for name in ("described", "principal")}
        return {**numbers, **{k: (x.values, x.attrs.get("units", "1")) for k, x in arrays.items()}}

    def mapped() -> Any:
        return _plain(_map())

    def nearer() -> Any:
        return _plain(rm.zoom_map(_map(), (0.5 / t, 1.0 / t), (-0.5 / t, 0.5 / t)))

    def _map() -> Any:
        ends = ((0.5 / t, 2.0 / t), (-1.0 / t, 1.0 / t))
        sides = [(f"start.omega.{i}", *e) for i, e in zip((1, 3), ends, strict=True)]
        asks = "mean(flips)", f"p({fast} >= {1.0 / t!r})", f"mean({fast})"
        return rm.stability_map(single, *sides, asks, 3, 2)

    def cross() -> Any:
        return rm.section(one, "momentum[2] = 0", way="both", members=4)

    def periodic() -> Any:
        return rm.section(one, f"every {0.5 * t!r}", members=4)

    def spectra() -> Any:
        return rm.frequencies(one, "momentum[1]", 2, members=4, t_end=16.0 * t, every=0.1 * t)

    def grown() -> Any:
        return rm.ftle(one_body(one, True), 8)

    def shares() -> Any:
        return rm.sensitivity(single, f"mean({fast})", 16)

    def sure() -> Any:
        return rm.basins(single, f"p(omega_last[3] >= {0.2 / t!r})", 16)

    def seldom() -> Any:
        return rm.rare(one, "p(passages >= 1)", 1e-3, 40, 2)

    def tail() -> Any:
        return rm.rare(one, f"p({fast} >= {4.0 / t!r})", 1e-3, 40, 2)

    def levels() -> Any:
        return rm.multilevel(single, f"mean({fast}) +- 20%", most=256)

    def ladder() -> Any:  # its first steps: where it ends is a matter of rounding
        slips = any(isinstance(effect, rm.InternalDissipation) for effect in one.effects)
        return rm.accuracy(one, ["cf4" if slips else "rk4"], [1e-3], members=4).isel(row=slice(6))

    def checked() -> Any:
        return trust(one, quick=True)

    def exponents() -> Any:
        return rm.lyapunov(one, members=4)

    def slope() -> Any:
        of = f"mean({fast.replace('max', 'last')})"
        found = rm.gradient(single, of, "start.omega.2", members=8).isel(measure=0, parameter=0)
        unit = str(found.unit.item())
        kinds = {"value": unit, "derivative": quotient(unit, str(found.parameter_unit.item()))}
        return {
            name: (variable.values, kinds.get(str(name).split("_")[0], "1"))
            for name, variable in found.data_vars.items()
            if variable.dtype.kind in "fi"
        }

    def linear() -> Any:
        return rm.propagate(
            single, wrt="start.omega.2", deviations=[0.1 / t], of="omega", members=8
        )

    def steady() -> Any:
        return rm.linearise(single, starts=4)

    def fitted() -> Any:
        ds = rm.simulate(level, members=1, save="omega", t_end=t, every=0.02 * t).isel(member=0)
        # errors of a sensor, so that intervals are not those of rounding
        omega = ds.omega.values + 0.01 / t * np.cos(2.0 * np.arange(ds.omega.size)).reshape(-1, 3)
        data = {"t": ds.time.values, **{f"omega[{i + 1}]": omega[:, i] for i in range(3)}}
        found = rm.fit(level, data, "start.omega", noise={"omega": 0.01 / t}, trials=2)
        return {name: (found[name].values, "rad s-1") for name in ("value", "deviation")}

    def designed() -> Any:
        sensor, times = f"omega={0.01 / t!r}@{20.0 / t!r}", [0.5 * t, t]
        found = rm.design(level, "start.omega", sensor, times, "start.omega.2")
        return {"deviation": (found.deviation.values, "rad s-1")}

    def moving() -> Any:
        live = live_run(one, 2)
        started = {name: live.start[name] for name in ("moments", "mass")}
        units = {"moments": "kg m2", "mass": "kg"}
        return {name: (values, units[name]) for name, values in started.items()}

    return {
        "live": moving, "simulate": simulated, "rerun": again, "simulate(tolerance)": chosen,
        "simulate_until": until, "simulate_totals": totals,
        "estimate_rqmc": spread, "reweight": weighed, "rigid.measure": measured,
        "rigid": followed, "stability_map": mapped, "zoom_map": nearer, "section": cross,
        "section, every": periodic, "frequencies": spectra, "ftle": grown, "sensitivity": shares,
        "basins": sure, "rare, event": seldom, "rare, tail": tail, "multilevel": levels,
        "accuracy": ladder, "stress --scene": checked, "lyapunov": exponents,
        "gradient": slope, "propagate": linear, "linearise": steady, "fit": fitted,
        "design": designed,
    }  # fmt: skip


def _plain(ds: xr.Dataset) -> xr.Dataset:
    """A map, its variables named without the numbers of their measures, which have units."""
    names = {name: without_numbers(str(name)) for name in ds.data_vars}
    return ds.rename({name: f"{i} {word}" for i, (name, word) in enumerate(names.items())})


def _interval(one: Any, unit: str) -> dict[str, tuple[Any, str]]:
    return {name: (getattr(one, name), unit) for name in ("value", "low", "high")}


def without_numbers(text: str) -> str:
    """A text with # for each number."""
    return re.sub(r"[-+]?\d[\d,.]*(e[-+]?\d+)?", "#", text)


def drivers() -> set[str]:
    """The effects of all KINDS."""
    return {word for _, words in KINDS.values() for word in words}


assert all(facts(kind).units for kind in EFFECTS.values())
