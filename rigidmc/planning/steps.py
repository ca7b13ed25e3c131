"""The times of a run: the number of steps, their lengths, and which of them end at a save.

Saves are at 0, `every`, 2 `every`, ... and at t_end. If `every` does not divide t_end, the last
interval is shorter than the others, and so are its steps. Listed times end steps of one length.
With per-member steps, each member makes as many steps as its largest possible rate requires
(`rate_bounds`, `count_member_steps`).
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.formulas import energies, torques
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.physics.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.physics.dynamics.so3 import dot
from rigidmc.physics.effects.protocol import from_numbers, parameter_count
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.scene.save_times import SaveTimes, settled

MOST_OWN_STEPS = 2**24  # of a member in a round, so that no fast member stops a run


def physics(effects: Sequence[Any], block: Array) -> tuple[MassProperties, tuple[Any, ...]]:
    """Return (body, effects) of the members of a block (rows, n), with arrays (n,) as fields."""
    arrays, row = [], layout.EFFECTS
    for effect in effects:
        arrays.append(from_numbers(type(effect), block[row : row + parameter_count(effect)]))
        row += parameter_count(effect)
    return MassProperties(*block[layout.BODY : layout.EFFECTS]), tuple(arrays)


def rate_bounds(effects: Sequence[Any], block: Array) -> Array:
    """Bound the rate of motion of each member of a block [rad/s]:

        sqrt(2 (E + V)/I) + sqrt(V/I)

    where I is the smallest moment, E the energy and V the largest potential energy. The first term
    bounds |omega| for all times; the second is the rate at which torques act. The torque at the
    start replaces V if it is larger, as for effects without an energy.
    """
    body, effects = physics(effects, block)
    q = tuple(block[layout.ATTITUDE : layout.MOMENTUM])
    l = tuple(block[layout.MOMENTUM : layout.EXTRA])
    with np.errstate(all="ignore"):
        highest = total_energy_scale(effects, body)
        smallest = 1.0 / np.max([body.i1, body.i2, body.i3], axis=0)
        torque = torques(effects, body, q, l)
        swing = np.maximum(highest, np.sqrt(dot(torque, torque)))
        energy = kinetic_energy(body, l) + energies(effects, body, q) + highest
        bound = np.sqrt(2.0 * np.maximum(energy, 0.0) / smallest) + np.sqrt(swing / smallest)
        return np.asarray(bound)


def count_member_steps(rate: Array, interval: float, turn: float | None) -> Array:
    """Return how many steps each member needs in a time `interval` [s].

    Members move at `rate` [rad/s], and a step may turn them by at most the scene's `turn` [rad].
    """
    assert turn is not None, "this scene has no per-member steps"
    with np.errstate(all="ignore"):
        steps = np.ceil(interval * rate / turn)
    return np.clip(np.where(np.isfinite(steps), steps, 1.0), 1.0, MOST_OWN_STEPS)


def order_by_steps(block: Array) -> Ints:
    """Return the order of a block's members by number of steps; equal numbers are adjacent."""
    steps = block[layout.STEPS]
    # two-byte integers are radix-sorted, 15 times as fast
    keys = steps.astype("u2") if steps.max(initial=0.0) < 2**16 else steps
    return np.argsort(keys, kind="stable")


MOST_STEPS = 10**15
SAME = 1e-9  # fraction of a step, or of t_end, by which a listed time may be off
# The grid uses equal steps if they are at most twice as many as dt requires, or at most this many
FEW = 1000
# Members with their own steps make as many steps in a short last round as in any other. Whole
# rounds may exceed t_end by this fraction: 5 % more steps.
WASTE = Fraction(1, 20)


class Clock(NamedTuple):
    """The times at which steps end: the first `head` steps last dt [s], later ones last_dt [s].

    Fields are numbers, or arrays over members with their own steps.
    """

    dt: Any
    head: Any
    last_dt: Any

    def time(self, steps: Any) -> Any:
        """Return the time after a number of steps [s]."""
        late = np.maximum(steps - self.head, 0.0)
        return np.minimum(steps, self.head) * self.dt + late * self.last_dt

    def steps(self, time: Any) -> Any:
        """Return how many steps end by a time [s], at which a step ends."""
        begun = self.head * self.dt
        late = np.rint(np.maximum(time - begun, 0.0) / self.last_dt)
        return np.rint(np.minimum(time, begun) / self.dt) + late

    def weighed(self, steps: Any, made: Any) -> Any:
        """Return the time after `steps` steps, in units of the last step length among `made` steps.

        Sums over steps weight the steps before the last interval by their length in this unit, see
        `rigidmc.engine.kernel.last_interval`.
        """
        shorter = self.dt / self.last_dt
        late = np.maximum(steps - self.head, 0.0)
        return np.where(made > self.head, np.minimum(steps, self.head) * shorter + late, steps)

    def of(self, each: Any) -> "Clock":
        """Return the Clock of members that make `each` steps in one step of this clock."""
        return Clock(self.dt / each, self.head * each, self.last_dt / each)


class TimeGrid(NamedTuple):
    """The steps and saves of a run.

    steps : to t_end;  dt : their length [s]
    stride : steps between saves; the last step is always saved
    head, last_dt : number of steps before a shorter last interval, and the length of its steps [s];
        without one, all steps and dt
    listed : steps that end at a save, from 0 to the last, if the saves are not even; else ()
    notes : on dt
    """

    steps: int
    dt: float
    stride: int
    head: int
    last_dt: float
    listed: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def save_steps(self) -> Ints:
        """The steps that end at a save, from 0 to the last."""
        if self.listed:
            return np.array(self.listed, np.int64)
        return np.append(np.arange(0, self.steps, self.stride), self.steps)

    @property
    def saves(self) -> int:
        """Number of saves, with those at 0 and at the end."""
        return len(self.listed) or -(-self.steps // self.stride) + 1

    @property
    def times(self) -> Array:
        """The times of the saves [s]."""
        times: Array = self.clock.time(self.save_steps)
        return times

    @property
    def end(self) -> float:
        """The time of the last save [s]."""
        return float(self.clock.time(self.steps))

    @property
    def clock(self) -> Clock:
        """The Clock of these steps."""
        return Clock(self.dt, self.head, self.last_dt)

    @property
    def is_shortened(self) -> bool:
        """Whether the last interval, and its steps, are shorter than the others."""
        return self.head < self.steps


def make_time_grid(t_end: float, dt: float, every: SaveTimes | None) -> TimeGrid:
    """Return the TimeGrid of a run: whole numbers of steps between saves, each at most dt long.

    Decimal numbers are read as exact fractions, so that `10 / 0.3` is 100/3. All steps have one
    length if `every` and t_end have a common step that is not much shorter than dt.

    every : time between saves, or times of saves [s]; None for the first and the last state

    Raises SceneError for more steps than a run may have, and for listed times without a common
    step.
    """
    every = settled(every)
    end, step = Fraction(repr(t_end)), Fraction(repr(dt))
    for key, length in (("dt", dt), ("every", every)):
        if isinstance(length, (int, float)):
            _refuse_many(end / Fraction(repr(length)), key, length, t_end)
    grid = _saved_once(end, step, t_end)
    if isinstance(every, tuple):
        grid = _listed(end, step, every, t_end)
    elif every is not None and every < t_end:
        grid = _even(end, step, every, t_end) or _with_rest(end, step, every)
    _refuse_many(grid.steps, "dt", dt, t_end)
    if abs(grid.dt / dt - 1) < 0.01:  # errors grow as dt^4: by less than 4 %; `show` names the dt
        return grid
    divided = "every" if grid.is_shortened else "t_end and every"
    note = f"dt reduced from {dt:g} to {grid.dt:.10g} s, which divides {divided}"
    return grid._replace(notes=(note,))


def _saved_once(end: Fraction, step: Fraction, t_end: float) -> TimeGrid:
    """Return the TimeGrid of a run that is saved only at its end."""
    steps = _count(end / step)
    return TimeGrid(steps, t_end / steps, steps, steps, t_end / steps)


def _even(end: Fraction, step: Fraction, every: float, t_end: float) -> TimeGrid | None:
    """Return the TimeGrid with steps of one length, or None if these are too many."""
    # steps must be a multiple of p for stride = steps q/p to be whole, with p/q = t_end/every
    ratio = _simple(end / Fraction(repr(every)))
    # a remainder of 1e-9 of `every` comes from writing t_end/7 in digits
    ratio = Fraction(round(ratio)) if abs(round(ratio) - ratio) < Fraction(1, 10**9) else ratio
    # the step of `_with_rest`: a result stores that step, which must lead to the same grid
    shorter = Fraction(repr(every / _count(Fraction(repr(every)) / step)))
    if ratio.numerator > max(FEW, 2 * math.ceil(end / shorter)):
        return None
    multiples = _count(end / step / ratio.numerator)
    steps = multiples * ratio.numerator
    return TimeGrid(steps, t_end / steps, multiples * ratio.denominator, steps, t_end / steps)


def _simple(ratio: Fraction) -> Fraction:
    """Return the fraction meant by a ratio of numbers with 16 digits, such as t_end/7 or 2^-30."""
    # as large as LONGEST_STRIDE of `rigidmc.planning.saves`, which relies on it
    simple = ratio.limit_denominator(1000)
    return simple if abs(simple / ratio - 1) < Fraction(1, 10**14) else ratio


def _listed(end: Fraction, step: Fraction, times: tuple[float, ...], t_end: float) -> TimeGrid:
    """Return the TimeGrid that saves at listed times: with the steps of a run without saves if they
    end there, else with the longest shorter steps that do; SceneError if these are too many."""
    if not times[-1] <= t_end * (1.0 + SAME):
        rule = f"is later than t_end = {t_end:g} s"
        raise SceneError(rule, at="run.every", value=f"{times[-1]:.10g} s")
    inner = [t for t in times if 0.0 < t < t_end * (1.0 - SAME)]
    once = _saved_once(end, step, t_end)
    steps, near = once.steps, _nearest_steps(inner, once.dt)
    if near is None:
        base, most = 1, max(FEW, 2 * once.steps)
        for t in inner:
            base = math.lcm(base, _simple(Fraction(repr(t)) / end).denominator)
            if base > most:
                raise _off_steps(inner, once.dt, most)
        steps = base * _count(end / step / base)
        _refuse_many(steps, "dt", float(step), t_end)
        near = [round(Fraction(repr(t)) / end * steps) for t in inner]
    listed = 0, *near, steps
    return TimeGrid(steps, t_end / steps, steps, steps, t_end / steps, listed=listed)


def _nearest_steps(times: Sequence[float], dt: float) -> list[int] | None:
    """Return the steps of length dt that end at times; None if one of them ends at no step."""
    position = np.array(times) / dt
    near = np.rint(position)
    # times are rounded to 2e-16 of themselves; 1e-9 of a step comes from writing them in digits
    if (np.abs(position - near) > np.maximum(SAME, 1e-15 * position)).any() or (near == 0).any():
        return None
    return [int(n) for n in near]


def _off_steps(times: Sequence[float], dt: float, most: int) -> SceneError:
    """Return the error about the first of some times that ends no step."""
    off = next(t for t in times if _nearest_steps([t], dt) is None)
    near = max(1, round(off / dt)) * dt
    rule = (
        f"is between steps of {dt:.10g} s, the nearest of which ends at {near:.10g} s, and steps"
        f" that end at all times are more than {most:,}: round the times to multiples of"
        f" {dt:.10g} s, or reduce dt"
    )
    return SceneError(rule, at="run.every", value=f"{off:.10g} s")


def _with_rest(end: Fraction, step: Fraction, every: float) -> TimeGrid:
    """Return the TimeGrid with a last interval that is shorter than the others."""
    between = Fraction(repr(every))
    intervals = end // between
    stride = _count(between / step)
    dt, rest = every / stride, end - intervals * between
    last = _count(rest / Fraction(repr(dt)))
    return TimeGrid(intervals * stride + last, dt, stride, intervals * stride, float(rest / last))


def _count(steps: Fraction) -> int:
    """Round a number of steps up to an integer, at least 1, but not for a rounding error."""
    return max(1, math.ceil(steps * (1 - Fraction(1, 10**9))))


def _refuse_many(steps: int | Fraction, key: str, length: float, t_end: float) -> None:
    """Raise SceneError if a run has too many steps or saves."""
    if steps > MOST_STEPS:
        # an integer of more than 309 digits does not fit in a float
        count = f"{float(steps):.3g}" if steps < 10**300 else "over 1e+300"
        rule = f"{count} steps to t_end = {t_end:g} exceed the limit of {MOST_STEPS:.3g}"
        raise SceneError(rule, at=f"run.{key}", value=length)


def round_grid(t_end: float, every: SaveTimes | None) -> TimeGrid:
    """Return the TimeGrid of the longest intervals that divide `every`, and if possible t_end.

    These intervals are the rounds of members with their own steps, which make as many steps in a
    shorter last round as in any other.
    """
    every = settled(every)
    if isinstance(every, tuple):
        gaps = np.diff([0.0, *(t for t in every if t < t_end), t_end])
        grid = make_time_grid(t_end, float(gaps[gaps > 0.0].min()), every)
        return grid._replace(notes=())
    if every is None or every >= t_end:
        return TimeGrid(1, t_end, 1, 1, t_end)
    grid = make_time_grid(t_end, every, every)
    if not grid.is_shortened:
        return grid._replace(notes=())
    end, between = Fraction(repr(t_end)), Fraction(repr(every))
    # 20 parts suffice: they overshoot by less than a 20th of `every`, which is below t_end
    parts = next(
        m for m in range(1, 21) if -(-end * m // between) * between / m <= end * (1 + WASTE)
    )
    return make_time_grid(t_end, every / parts, every)._replace(notes=())
