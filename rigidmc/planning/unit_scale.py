"""Convert scenes to other units, and choose the units of integration where SI units would overflow
or underflow."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.units import KNOWN, powers_of
from rigidmc.physics.effects import name_of
from rigidmc.physics.effects.protocol import facts, from_numbers, numbers
from rigidmc.physics.observables import is_own
from rigidmc.planning.initial import Source, initial_block, make_sampler
from rigidmc.planning.plan import Plan
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Grid, Varied, is_shared
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run, with_changes
from rigidmc.scene.stated import Stated
from rigidmc.scene.vector_distributions import VECTOR_DISTRIBUTIONS
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

# Without a change of units, the largest moment of inertia and the rate of motion may have exponents
# of 2 up to this, because the code squares their products.
RANGE = {"float64": 100, "float32": 10}


def unit_exponents(units: str) -> tuple[int, int, int]:
    """Return (kg, m, s) exponents of a string such as "kg m2 s-1"; ValueError if unknown. Amperes
    are not rescaled."""
    powers = powers_of(units)
    if powers is None or not powers.keys() <= KNOWN.keys():
        raise ValueError(f"'{units}' is not a product of powers of SI units")
    kg, m, s = (sum(n * KNOWN[symbol][2][i] for symbol, n in powers.items()) for i in range(3))
    return kg, m, s


def unit_factor(units: str, mass: float, length: float, time: float) -> float:
    """Return the factor of a number in `units` for given factors of masses, lengths and times; inf
    if beyond float64."""
    kg, m, s = unit_exponents(units)
    with np.errstate(over="ignore"):
        return float(np.float64(mass) ** kg * np.float64(length) ** m * np.float64(time) ** s)


def scale_scene(scene: Scene, mass: float = 1.0, length: float = 1.0, time: float = 1.0) -> Scene:
    """Return the same scene with all masses, lengths and times multiplied by these factors.

    The motion stays the same, to the bit if the factors are powers of 2. Raises SceneError if an
    effect does not declare the units of its parameters.
    """
    observables = tuple(
        kind._replace(
            **{
                name: getattr(kind, name) * unit_factor(unit, mass, length, time)
                for name, unit in getattr(kind, "parameter_units", {}).items()
            }
        )
        for kind in scene.observables
    )
    model = scale_model(scene.model, mass, length, time)
    run = scale_run(scene.run, time)
    return replace(scene, **model._asdict(), observables=observables, run=run)


def scale_model(model: Model, mass: float, length: float, time: float) -> Model:
    """Return what moves with all masses, lengths and times multiplied, as in `scale_scene`."""
    effects = _scaled_effects(model.effects, mass, length, time)
    inertia = mass * length**2
    moments = model.body.moments
    if isinstance(moments, TensorDistribution):
        moments = moments.resized(mass, length)
    else:
        moments = _sized(moments, inertia, 1.0)
    stated = model.body.stated
    body = replace(
        model.body,
        moments=moments,
        mass=_times(model.body.mass, mass),
        centre=tuple(_times(x, length) for x in model.body.centre),
        stated=stated.scaled(mass, length) if isinstance(stated, Stated) else stated,
    )
    spin = model.start.spin_name
    by = 1.0 / time if spin == "omega" else inertia / time
    distribution = _sized(getattr(model.start, spin), by, inertia / time / time)
    return model._replace(
        body=body, effects=effects, start=replace(model.start, **{spin: distribution})
    )


def scale_run(run: Run, time: float) -> Run:
    """Return the settings of a run with all times multiplied."""
    changed: dict[str, Any] = {"t_end": run.t_end * time}
    if isinstance(run.every, tuple):
        changed["every"] = tuple(t * time for t in run.every)
    elif isinstance(run.every, float):
        changed["every"] = run.every * time
    if run.turn is None:
        changed["dt"] = run.dt * time
        if run.turn_rate is not None:
            changed["turn_rate"] = run.turn_rate / time
    return with_changes(run, changed)


def _scaled_effects(
    effects: Sequence[Any], mass: float, length: float, time: float
) -> tuple[Any, ...]:
    scaled = []
    for effect in effects:
        values = []
        for name, _, value in numbers(effect):
            unit: Any = facts(effect).units.get(name)
            try:
                values.append(_times(value, unit_factor(unit, mass, length, time)))
            except (ValueError, AttributeError):
                kind = name_of(effect)
                why = f"{kind} does not declare the unit of {name}"
                if unit is not None:
                    why = f"{kind} declares an unknown unit of {name}, '{unit}'"
                rule = f"the scene cannot be converted to other units: {why}"
                raise SceneError(rule, at=f"effects.{kind}.{name}") from None
        scaled.append(from_numbers(type(effect), values))
    return tuple(scaled)


class UnitScale(NamedTuple):
    """Units of integration: the powers of 2 by which masses and times were multiplied."""

    mass: float
    time: float

    def factor(self, units: str) -> float:
        """Return the factor that converts a result in `units` back to the scene's units."""
        return unit_factor(units, 1.0 / self.mass, 1.0, 1.0 / self.time)

    def back(self, plan: Plan) -> Plan:
        """Convert a Plan to the units of the user."""
        rate = plan.turn_rate
        if rate is not None and not plan.has_member_steps:
            rate = rate * self.time
        grid = plan.grid
        return plan._replace(
            grid=grid._replace(dt=grid.dt / self.time, last_dt=grid.last_dt / self.time),
            turn_rate=rate,
        )

    def model(self, model: Model) -> Model:
        """Convert what moves to the units of integration."""
        return scale_model(model, self.mass, 1.0, self.time)

    def scaled(self, scene: Scene) -> Scene:
        """Convert a scene to the units of integration."""
        return scale_scene(scene, self.mass, 1.0, self.time)


def choose_units(scene: Scene) -> UnitScale | None:
    """Return units that bring the moments and rates of a scene's first member near 1, or None if
    they are within RANGE.

    If a scene can be integrated in either units, the choice does not change the bits of the result.
    In float32, and at the ends of float64, it can be integrated only in internal units.
    """
    try:
        _scaled_effects(scene.effects, 1.0, 1.0, 1.0)
    except SceneError:  # a custom effect without units
        return None
    # the units of custom observables, and of distributions without `scaling`, are unknown
    if any(map(is_own, scene.observables)) or any(map(_is_unsized, scene.model.quantities())):
        return None
    moments, mass, centre = (x[..., 0] for x in scene.body.sample(scene.run.seed, 0, 1))
    inertia = _exponent(np.max(moments))
    exponents = _spin_exponents(scene.model, moments, make_sampler(scene.model, scene.run))
    arm = np.max(np.abs(centre))
    for effect in scene.effects if arm > 0.0 else ():
        if name_of(effect) == "gravity" and not (is_shared(effect.g) and effect.g == 0.0):
            # the rate of a pendulum is sqrt(m g h/I)
            g = _exponent(effect.g if is_shared(effect.g) else 1.0)
            torque = g + _exponent(mass) + _exponent(arm)
            exponents.append((torque - _exponent(np.min(moments))) // 2)
    rate, most = max(exponents, default=0), RANGE[scene.run.dtype]
    if max(abs(inertia), abs(rate)) <= most:
        return None
    return UnitScale(_power(-inertia), _power(rate))


def _spin_exponents(model: Model, moments: Any, sampler: Source) -> list[int]:
    """Return the exponents of the non-zero components of the first member's omega [rad/s]."""
    word = model.start.spin_name
    joint = isinstance(getattr(model.start, word), VectorDistribution)
    if joint or word in model.start.relative_to_orbit:  # it may depend on the energy or the orbit
        _, start = initial_block(model, sampler, 0, 1)
        spin = start[f"start_{word}"]
    else:
        _, spin = model.start.sample_spin(sampler, 0, 1, None)
    return [
        _exponent(x) - (_exponent(i) if word == "momentum" else 0)
        for x, i in zip(np.nan_to_num(spin)[:, 0], moments, strict=True)
        if x != 0.0
    ]


def _exponent(x: Any) -> int:
    return math.frexp(float(x))[1] if math.isfinite(float(x)) and x != 0.0 else 0


def _power(exponent: int) -> float:
    """Return a power of 2 within the range of float64."""
    return math.ldexp(1.0, min(1000, max(-1000, exponent)))


def _sized(values: Any, by: float, energy: float) -> Any:
    """Multiply sizes by `by` and energies by `energy`, in three quantities or a distribution of a
    vector."""
    if not isinstance(values, VectorDistribution):
        return tuple(_times(x, by) for x in values)
    if _is_unsized(values):
        rule = f"the scene cannot be converted to other units: {values.name} has no `scaling`"
        raise SceneError(rule, at=f"start.{values.name}")
    changed = {}
    for name, power in values.scaling.items():
        scale = energy if power == "energy" else by**power
        changed[name] = _all_times(getattr(values, name), scale)
    return replace(values, **changed)


def _is_unsized(value: Any) -> bool:
    """Return whether a custom distribution does not declare how its fields scale."""
    return (
        isinstance(value, VectorDistribution)
        and type(value) not in VECTOR_DISTRIBUTIONS
        and not value.scaling
    )


def _all_times(value: Any, by: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_all_times(x, by) for x in value)
    return _times(value, by)


def _times(value: Any, by: float) -> Any:
    if isinstance(value, (Distribution, Grid, Varied)):
        return value.times(by)
    return value * by
