"""Scenes in other units, and the units in which a scene is integrated where SI ones would leave the range of numbers."""

import math
import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rigidmc.effects import name_of
from rigidmc.effects.parameters import filled, numbers
from rigidmc.effects.protocol import facts
from rigidmc.errors import SceneError
from rigidmc.planning.stage import source, stage
from rigidmc.scene.laws.protocol import Law
from rigidmc.scene.quantities import Distribution, Grid, is_shared

# exponents of kilogram, metre and second; amperes stay as they are
_KNOWN = {"1": (0, 0, 0), "rad": (0, 0, 0), "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "J": (1, 2, -2), "W": (1, 2, -3), "Hz": (0, 0, -1),
    "A": (0, 0, 0), "T": (1, 0, -2)}  # fmt: skip
# Exponents of 2 that the largest moment of inertia and the rate of motion may have as they are: squares of their products are formed.
RANGE = {"float64": 100, "float32": 10}


def dimensions(units):
    """(kg, m, s) exponents of a string such as "kg m2 s-1"; ValueError for a unit that is not known."""
    total = [0, 0, 0]
    for word in units.split():
        found = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", word)
        if not found or found[1] not in _KNOWN:
            raise ValueError(f"unit '{word}' is none of {', '.join(_KNOWN)}")
        for i, exponent in enumerate(_KNOWN[found[1]]):
            total[i] += exponent * int(found[2] or 1)
    return tuple(total)


def factor(units, mass, length, time):
    """The factor of a number in `units` if masses, lengths and times have these factors; inf if beyond float64."""
    kg, m, s = dimensions(units)
    with np.errstate(over="ignore"):
        return float(np.float64(mass) ** kg * np.float64(length) ** m * np.float64(time) ** s)


def scaled(scene, mass=1.0, length=1.0, time=1.0):
    """The same scene with all masses, lengths and times multiplied: it moves alike, and where they are powers of 2 to the bit.

    Raises SceneError where an effect does not tell the units of its parameters.
    """
    effects = _scaled_effects(scene.effects, mass, length, time)
    inertia = mass * length**2
    body = replace(
        scene.body, moments=_sized(scene.body.moments, inertia, 1.0), mass=_times(scene.body.mass, mass),
        centre=tuple(_times(x, length) for x in scene.body.centre),
    )  # fmt: skip
    which, by = (
        ("omega", 1.0 / time) if scene.start.momentum is None else ("momentum", inertia / time)
    )
    start = replace(
        scene.start, **{which: _sized(getattr(scene.start, which), by, inertia / time / time)}
    )
    run = {
        name: getattr(scene.run, name) * time
        for name in ("t_end", "every")
        if getattr(scene.run, name) is not None
    }
    run |= {"dt": scene.run.dt * time} if scene.run.turn is None else {}
    if scene.run.turn_rate is not None and scene.run.turn is None:
        run["turn_rate"] = scene.run.turn_rate / time
    return replace(scene, body=body, effects=effects, start=start).with_run(**run)


def _scaled_effects(effects, mass, length, time):
    made = []
    for effect in effects:
        values = []
        for name, _, value in numbers(effect):
            told = facts(effect).units.get(name)
            try:
                values.append(_times(value, factor(told, mass, length, time)))
            except (ValueError, AttributeError):
                rule = f"the scene cannot be put in other units: {name_of(effect)} does not tell that of {name}"
                raise SceneError(
                    f"effects.{name_of(effect)}",
                    name,
                    None,
                    rule if told is None else f"{rule}, but '{told}'",
                ) from None
        made.append(filled(type(effect), values))
    return tuple(made)


class Internal(NamedTuple):
    """What masses and times were multiplied by, powers of 2."""

    mass: float
    time: float

    def factor(self, units):
        """What a result in `units` is multiplied by, to be in those of the scene."""
        return factor(units, 1.0 / self.mass, 1.0, 1.0 / self.time)

    def back(self, scene, plan):
        """A scene and its Plan in the units that they had."""
        rate = plan.turn_rate if plan.turn_rate is None or plan.own else plan.turn_rate * self.time
        told = plan._replace(dt=plan.dt / self.time, times=plan.times / self.time, turn_rate=rate)
        return scaled(scene, 1.0 / self.mass, 1.0, 1.0 / self.time), told


def told(scene, plan, units):
    """A scene and its Plan in the units that the user gave; `units` : an Internal, or None where those are they."""
    return (scene, plan) if units is None else units.back(scene, plan)


def internal(scene):
    """The Internal units that bring a scene's first member to moments and rates near 1, or None where they are within RANGE.

    No bit of a result depends on it where both come out; in float32, and at the ends of float64, they come out only so.
    """
    try:
        _scaled_effects(scene.effects, 1.0, 1.0, 1.0)
    except SceneError:  # an effect of the user's own, without units
        return None
    moments, mass, centre = (x[..., 0] for x in scene.body.sample(scene.run.seed, 0, 1))
    which = "omega" if scene.start.momentum is None else "momentum"
    if isinstance(getattr(scene.start, which), Law):  # a law, which may depend on the energy
        spin = stage(scene, 0, 1, True)[1][f"start_{which}"]
    else:
        _, spin = scene.start.spin(source(scene), 0, 1, None)
    spin = np.nan_to_num(spin)
    inertia = _exponent(np.max(moments))
    each = [
        _exponent(x) - (_exponent(i) if which == "momentum" else 0)
        for x, i in zip(spin[:, 0], moments, strict=True)
        if x != 0.0
    ]
    g = [
        _exponent(e.g if is_shared(e.g) else 1.0)
        for e in scene.effects
        if name_of(e) == "gravity" and not (is_shared(e.g) and e.g == 0.0)
    ]
    arm = np.max(np.abs(centre))
    each += [
        (x + _exponent(mass) + _exponent(arm) - _exponent(np.min(moments))) // 2
        for x in g
        if arm > 0.0
    ]
    rate, most = max(each, default=0), RANGE[scene.run.dtype]
    if max(abs(inertia), abs(rate)) <= most:
        return None
    return Internal(_power(-inertia), _power(rate))


def _exponent(x):
    return math.frexp(float(x))[1] if math.isfinite(float(x)) and x != 0.0 else 0


def _power(exponent):
    """A power of 2 within the range of numbers."""
    return math.ldexp(1.0, min(1000, max(-1000, exponent)))


def _sized(values, by, energy):
    """Three quantities, or a vector of `rigidmc.scene.laws`, with its sizes times `by` and its energies times `energy`."""
    if not isinstance(values, Law):
        return tuple(_times(x, by) for x in values)
    made = {}
    for name, power in values.sized.items():
        factor, value = energy if power == "energy" else by**power, getattr(values, name)
        made[name] = _all_times(value, factor)
    return replace(values, **made)


def _all_times(value, by):
    return (
        tuple(_all_times(x, by) for x in value) if isinstance(value, tuple) else _times(value, by)
    )


def _times(value, by):
    if isinstance(value, (Distribution, Grid)):
        return value.times(by)
    return value * by
