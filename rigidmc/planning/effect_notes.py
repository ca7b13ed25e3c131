"""Find effects that exert no torque, and jumps and kinks in time of custom torques, across which
steps of any integrator have large errors."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.inputs.amounts import count_text
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.effects.protocol import facts, from_numbers, numbers, torque

Array = NDArray[np.float64]
SAMPLES = 2000  # times: shorter pulses between them stay unseen
FINER = 32  # times that replace two intervals, three times over
SEEN = 1e-4  # least second difference that counts, relative to the largest torque


def kink_notes(
    effects: Sequence[tuple[str, Any]], moments: Array, static_moment: Array, t_end: float
) -> Iterator[str]:
    """Find torques of the first member with a jump or a kink at a time that no class states.

    effects : [(label, effect)] with arrays as fields;  moments, static_moment : (3, members)
    """
    body = MassProperties.of(moments[:, 0], static_moment[:, 0])
    for label, effect in effects:
        if is_shipped(effect) or "t" not in argument_names(effect, "torque"):
            continue
        first = from_numbers(type(effect), [float(x[0]) for _, _, x in numbers(effect)])
        if what := _kink_of(first, body, t_end):
            yield (
                f"[effects.{label}] its torque {what}, and a step across it has a large error with"
                " any integrator: state the parameter that is this time, as in"
                ' @effect(switches=("on", "off")), and steps end there'
            )


def _kink_of(effect: Any, body: MassProperties, t_end: float) -> str:
    """Return "jumps near t = ..." or "has a kink near t = ..." of a body at rest; "" if neither.

    Second differences of a smooth function fall as the square of the interval; at a kink they fall
    as the interval, at a jump not at all.
    """

    def at(t: Array) -> Array:
        state = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        return np.array(np.broadcast_arrays(*torque(effect, body, t, *state), t)[:3])

    stated = [x for name in facts(effect).switches for x in np.ravel(getattr(effect, name))]
    try:
        with np.errstate(all="ignore"):
            return _kink(at, t_end, np.array(stated, float))
    except (TypeError, ValueError, ArithmeticError):  # the method takes no arrays
        return ""


def _kink(at: Callable[[Array], Array], t_end: float, stated: Array) -> str:
    times = np.linspace(0.0, t_end, SAMPLES + 1)
    values = at(times)
    size = float(np.abs(values).max())
    bends, width = _bends(values), t_end / SAMPLES
    for time in stated:
        bends[np.abs(times[1:-1] - time) <= 1.01 * width] = 0.0
    i = int(np.argmax(bends))
    bend, time = float(bends[i]), float(times[i + 1])
    if not SEEN * size < bend < np.inf:
        return ""
    for _ in range(3):
        some = np.linspace(time - width, time + width, 2 * FINER + 1)
        bends, width = _bends(at(some)), width / FINER
        i, last = int(np.argmax(bends)), bend
        bend, time = float(bends[i]), float(some[i + 1])
    if bend > 0.3 * last:
        return f"jumps near t = {time:.4g} s"
    return f"has a kink near t = {time:.4g} s" if bend > 0.3 * last / FINER else ""


def _bends(values: Array) -> Array:
    """Return the size of the second differences of values (3, n)."""
    bends: Array = np.abs(np.diff(values, 2)).max(0)
    return bends


def is_shipped(effect: Any) -> bool:
    """Return whether an effect comes with the package."""
    return type(effect) in EFFECTS.values()


def idle_effects(effects: list[tuple[str, Any]], moments: Array, centre: Array) -> Iterator[str]:
    """Find effects [(label, effect)] of the package that exert no torque on any of the given
    members.

    moments, centre : (3, n) of the members
    """
    few, body = moments.shape[1], scaled_bodies(moments, centre)
    chance = np.random.default_rng(1)
    for label, effect in effects:
        if not is_shipped(effect) or any(_acts(effect, body, i, chance) for i in range(few)):
            continue
        why = "its torque is 0 at any attitude and spin"
        if type(effect) in (Gravity, MovingPivot) and not centre.any():
            why = "the centre of mass is on the fixed point: give [body] centre or pivot"
        yield f"[effects.{label}] has no effect on the first {count_text(few, 'member')}: {why}"


def scaled_bodies(moments: Array, centre: Array) -> MassProperties:
    """Return bodies of size 1, on which no torque underflows to 0; a centre of 0 stays 0."""
    reach = np.abs(centre).max() or 1.0  # a centre of 0 is divided by 1, in any unit
    with np.errstate(all="ignore"):
        bodies: MassProperties = MassProperties.of(
            tuple(moments / moments.max()), tuple(centre / reach)
        )
    return bodies


def of_member(effect: Any, bodies: MassProperties, i: int) -> tuple[Any, MassProperties]:
    """Return the effect and the body of member i."""
    body = MassProperties(*(np.asarray(x)[i] for x in bodies[:BODY_NUMBERS]))
    return from_numbers(type(effect), [x[i] for _, _, x in numbers(effect)]), body


def _acts(effect: Any, bodies: MassProperties, i: int, chance: np.random.Generator) -> bool:
    """Return whether an effect exerts a torque on member i at a random attitude, spin and time; for
    a bath, whether it has friction."""
    effect, body = of_member(effect, bodies, i)
    if isinstance(effect, Bath):
        return bool(effect.gamma != 0.0)
    q, l, t = (
        chance.normal(size=4),
        chance.normal(size=3) / max(body[:3]),
        chance.uniform(0.1, 10.0),
    )
    return any(torque(effect, body, t, tuple(q / np.linalg.norm(q)), tuple(l)))
