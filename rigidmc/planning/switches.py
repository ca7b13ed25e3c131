"""Cut the grid of steps at the times at which effects switch or sample.

A step across a jump of a torque has an error of order 1, whatever its integrator. Effects state
the parameters that are such times (`switches`); a step, or a round of members with their own steps,
that contains one is made in parts, which begin and end there.

At a switch, rounding decides whether `t >= on` holds. So the time that a part passes to the effects
is shifted by a few roundings, inward from the switch; a part between two switches is shorter by as
much.

Effects with a memory sample at k every + after. A part begins there, too; it needs no shift, as a
torque reads the memory and not the time.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel.arguments import no_cuts
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, has_memory, has_state, numbers
from rigidmc.planning.steps import SAME, Clock
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Varied, is_shared
from rigidmc.scene.settings import Run

# relative to the time: three operations round it by at most 2.5 units of 2^-52
AROUND = 2.0**-50
MOST_SAMPLES = 10_000_000  # of a run: their table takes 40 bytes and more each


def switching_parameters(effects: Sequence[Any]) -> list[tuple[str, Any]]:
    """Return [(name in a scene, value)] of the numbers that are switching times."""
    return [
        (f"effects.{label}.{field}" + ("" if i is None else f".{i + 1}"), value)
        for label, effect in label_effects(effects)
        for field, i, value in (numbers(effect) if facts(effect).switches else ())
        if field in facts(effect).switches
    ]


def switch_times(effects: Sequence[Any]) -> Array:
    """Return the switching times of effects [s], increasing."""
    if not any(facts(effect).switches for effect in effects):
        return np.empty(0)  # 15 of 300 us of a prepared run of few members
    return np.unique([float(value) for _, value in switching_parameters(effects)])


def check_switches(model: Model, run: Run, growing: Sequence[str]) -> None:
    """Raise SceneError for switching times that no grid can be cut at.

    growing : labels of the recorded observables of the growth of a tangent
    """
    for name, value in switching_parameters(model.effects):
        if isinstance(value, Varied) or not is_shared(value):
            rule = (
                "is a switching time, at which the steps of all members are cut, so it must be one"
                " number for all members: run the scene once for each time (`--set`)"
            )
            raise SceneError(rule, at=name)
        if name in (run.wrt or ()):
            rule = (
                "is a switching time: the derivative would lack the jump of the torque at that"
                " time; use the difference of two runs with `--set`"
            )
            raise SceneError(rule, at="run.wrt", value=name)
        if run.dtype == "float32":
            rule = "rounds times to 6e-8 of themselves, so no step ends at a switching time"
            raise SceneError(rule, at="run.dtype", value=run.dtype)
        if growing:
            rule = f"{', '.join(growing)} needs steps of one length, but {name} is a switching time"
            raise SceneError(rule, at="run.save")
    for label, effect in label_effects(model.effects):
        if growing and (has_memory(effect) or has_state(effect)):
            rule = f"{', '.join(growing)} is of q and L alone, but {label} has numbers that move"
            raise SceneError(rule, at="run.save")
        if has_memory(effect):
            _check_samples(label, effect, run)


def _check_samples(label: str, effect: Any, run: Run) -> None:
    """Raise SceneError for sample times that no grid can be cut at."""
    stated = facts(effect)
    for field in filter(None, (stated.every, stated.after)):
        name, value = f"effects.{label}.{field}", getattr(effect, field)
        if isinstance(value, Varied) or not is_shared(value):
            rule = "cuts the steps of all members, so it must be one number for all"
            raise SceneError(rule, at=name)
        if name in (run.wrt or ()):
            rule = "has no derivative: the samples of a run would be of other states"
            raise SceneError(rule, at="run.wrt", value=name)
    every, after = sample_period(effect)
    if not (0.0 < every < math.inf and 0.0 <= after < math.inf):
        rule = "expected a time above 0 between samples, and 0 or more to the first [s]"
        raise SceneError(rule, at=f"effects.{label}.{stated.every}", value=every)
    if run.t_end / every > MOST_SAMPLES:
        rule = f"{run.t_end / every:,.0f} samples exceed the limit of {MOST_SAMPLES:,}"
        raise SceneError(rule, at=f"effects.{label}.{stated.every}", value=every)


class Edge(NamedTuple):
    """A time at which a step is cut.

    is_switch : whether a torque may jump there
    samples : number of the sample of each effect with a memory, -1 if it does not sample; () if
        none does
    """

    time: float
    is_switch: bool = False
    samples: tuple[float, ...] = ()


def sample_times(effects: Sequence[Any], end: float) -> tuple[Array, Array]:
    """Return the times before `end` at which effects with a memory sample, increasing, and the
    number of the sample of each at each time, (times, effects), -1 if it does not sample.

    Sample k is at k every + after. Times closer than SAME of a period are one: products
    of a period round in different ways.
    """
    sampling = [effect for effect in effects if has_memory(effect)]
    each, near = list[Array](), np.inf
    for effect in sampling:
        every, after = sample_period(effect)
        count = np.arange(max(0, math.ceil((end - after) / every - SAME)), dtype=float)
        each.append(after + count * every)
        near = min(near, SAME * every)
    found = np.sort(np.concatenate(each))
    times = found[np.diff(found, prepend=-np.inf) > near]
    counts = np.full((times.size, len(sampling)), -1.0)
    for place, own in enumerate(each):
        counts[np.searchsorted(times, own + near) - 1, place] = np.arange(own.size)
    return times, counts


def sample_period(effect: Any) -> tuple[float, float]:
    """Return (time between samples, time of the first sample) of an effect [s]."""
    stated = facts(effect)
    after = float(getattr(effect, stated.after)) if stated.after else 0.0
    return float(getattr(effect, stated.every)), after


def cut_rows(effects: Sequence[Any], clock: Clock, units: int, has_rounds: bool) -> Array:
    """Return the parts of units (steps, or rounds of members with their own steps) that begin or
    end at a switching or sample time: rows (number of the unit, length [s], time of its step 0
    [s]), and if effects have memories the time of the sample at its begin, -1 for none, and its
    numbers.

    clock : when the units end;  units : to the end of the run
    """
    sampling = sum(map(has_memory, effects))
    within: dict[int, list[Edge]] = {}
    for time in switch_times(effects):
        unit, beside = _units_at(time, clock, units)
        for one in {unit, beside} - {-1}:
            within.setdefault(one, []).append(Edge(time, True))
    rows = [_sampled_rows(effects, clock, units, has_rounds, within)] if sampling else []
    none = (-1.0,) * (1 + sampling if sampling else 0)
    for unit in sorted(within):
        begin, end = float(clock.time(unit)), float(clock.time(unit + 1))
        for length, at, taken in _parts(begin, end, within[unit]):
            origin = at if has_rounds else at - unit * length
            rows.append(np.array([[unit, length, origin, *(taken or none)]]))
    if not rows:
        return no_cuts(sampling)
    made = np.concatenate(rows)
    return np.concatenate([made[np.argsort(made[:, 0], kind="stable")], no_cuts(sampling)])


def _sampled_rows(
    effects: Sequence[Any],
    clock: Clock,
    units: int,
    has_rounds: bool,
    within: dict[int, list[Edge]],
) -> Array:
    """Return the rows of units that begin with a sample and have no other edge; add the edges of
    all other samples to `within`.

    Most samples are such, and a run may have 1e7: they are found by arrays.
    """
    times, counts = sample_times(effects, float(clock.time(units)))
    at = _unit_of(times, clock)
    lengths = clock.time(at + 1) - clock.time(at)
    # rounded down: it begins the next unit
    at = np.where(clock.time(at + 1) - times < SAME * lengths, at + 1, at)
    begins = clock.time(at)
    lengths = clock.time(at + 1) - begins
    busy, many = np.unique(at, return_counts=True)
    alone = np.isin(at, busy[many == 1]) & (abs(times - begins) < SAME * lengths)
    alone &= ~np.isin(at, list(within))
    origin = begins if has_rounds else begins - at * lengths
    for i in np.flatnonzero(~alone & (at < units)):
        edge = Edge(float(times[i]), False, tuple(counts[i].tolist()))
        within.setdefault(int(at[i]), []).append(edge)
    rows = np.column_stack([at, lengths, origin, times, counts])
    begun: Array = rows[alone & (at < units)]
    return begun


def _unit_of(times: Any, clock: Clock) -> Any:
    """Return the units in which times lie."""
    begun = clock.head * clock.dt
    late = clock.head + (times - begun) // clock.last_dt
    return np.where(times < begun, times // clock.dt, late).astype(np.int64)


def _units_at(time: float, clock: Clock, units: int) -> tuple[int, int]:
    """Return the unit in which a switching time lies, and the one that it also bounds; -1 for
    none."""
    unit = int(_unit_of(time, clock))
    if not 0 <= unit < units:
        if abs(time - float(clock.time(units))) > SAME * clock.last_dt:
            return -1, -1
        unit = units - 1
    begin, end = float(clock.time(unit)), float(clock.time(unit + 1))
    # on the grid, it ends the unit before, or begins the unit after, too
    near = SAME * (end - begin)
    beside = unit + int(end - time < near) - int(time - begin < near)
    return unit, beside if 0 <= beside < units and beside != unit else -1


def _parts(
    begin: float, end: float, edges: Sequence[Edge]
) -> list[tuple[float, float, tuple[float, ...]]]:
    """Return (length, shifted time of the begin, time and numbers of the samples at the begin) of
    the parts between some edges of a unit."""
    near = SAME * (end - begin)
    times = [edge.time for edge in edges if edge.is_switch]
    at_begin = [t - begin for t in times if t < begin + near]
    at_end = [end - t for t in times if t > end - near]
    # a switch that is an end of the unit but for its rounding must not lie inside
    around = max(AROUND * end, *(2.0 * abs(off) for off in (0.0, *at_begin, *at_end)))
    parts, bounds = [], _bounds(begin, end, near, edges)
    for low, high in pairwise(bounds):
        after = low.is_switch or (low.time == begin and bool(at_begin))
        before = high.is_switch or (high.time == end and bool(at_end))
        length = high.time - low.time - 2.0 * around * (after and before)
        if length > 0.0:
            at = low.time + around if after else low.time - around * bool(times)
            parts.append((length, at, (low.time, *low.samples) if low.samples else ()))
    return parts


def _bounds(begin: float, end: float, near: float, edges: Sequence[Edge]) -> list[Edge]:
    """Return the ends of the parts of a unit; edges that are one time become one."""
    found = [Edge(begin), Edge(end)]
    for edge in sorted(edges, key=lambda one: one.time):
        place = next((i for i, e in enumerate(found) if abs(e.time - edge.time) <= near), None)
        if place is None:
            found.insert(-1, edge)
        else:
            one = found[place]
            is_switch = one.is_switch or (edge.is_switch and 0 < place < len(found) - 1)
            found[place] = Edge(one.time, is_switch, edge.samples or one.samples)
    return found
