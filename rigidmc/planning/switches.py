"""Cut the grid of steps at the times at which effects switch.

A step across a jump of a torque has an error of order 1, whatever its integrator. Effects state
the parameters that are such times (`switches`); a step, or a round of members with their own steps,
that contains one is made in parts, which begin and end there.

At a switch, rounding decides whether `t >= on` holds. So the time that a part passes to the effects
is shifted by a few roundings, inward from the switch; a part between two switches is shorter by as
much.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rigidmc.engine.kernel.arguments import NO_CUTS
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, numbers
from rigidmc.planning.steps import SAME, Clock
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Varied, is_shared
from rigidmc.scene.settings import Run

# relative to the time: three operations round it by at most 2.5 units of 2^-52
AROUND = 2.0**-50


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


def cut_rows(effects: Sequence[Any], clock: Clock, units: int, has_rounds: bool) -> Array:
    """Return the parts of units (steps, or rounds of members with their own steps) that begin or
    end at a switching time: rows (number of the unit, length [s], time of its step 0 [s]).

    clock : when the units end;  units : to the end of the run
    """

    def bounds(unit: int) -> tuple[float, float]:
        return float(clock.time(unit)), float(clock.time(unit + 1))

    within: dict[int, list[float]] = {}
    for time in switch_times(effects):
        begun = clock.head * clock.dt
        late = clock.head + (time - begun) // clock.last_dt
        unit = int(time // clock.dt if time < begun else late)
        if not 0 <= unit < units:
            if abs(time - bounds(units - 1)[1]) > SAME * clock.last_dt:
                continue
            unit = units - 1
        within.setdefault(unit, []).append(time)
        begin, end = bounds(unit)
        # on the grid, it ends the unit before, or begins the unit after, too
        beside = unit + (end - time < SAME * (end - begin)) - (time - begin < SAME * (end - begin))
        if 0 <= beside < units and beside != unit:
            within.setdefault(beside, []).append(time)
    rows = [
        (unit, length, begin if has_rounds else begin - unit * length)
        for unit in sorted(within)
        for length, begin in _parts(*bounds(unit), within[unit])
    ]
    return np.array([*rows, *NO_CUTS], float) if rows else NO_CUTS


def _parts(begin: float, end: float, times: Sequence[float]) -> list[tuple[float, float]]:
    """Return (length, shifted time of the begin) of the parts between some times of a unit."""
    near = SAME * (end - begin)
    at_begin = [t - begin for t in times if t < begin + near]
    at_end = [end - t for t in times if t > end - near]
    # a switch that is an end of the unit but for its rounding must not lie inside
    around = max(AROUND * end, *(2.0 * abs(off) for off in (0.0, *at_begin, *at_end)))
    inside = (t for t in times if begin + near <= t <= end - near)
    parts, edges = [], [begin, *inside, end]
    for i, (low, high) in enumerate(pairwise(edges)):
        after, before = i > 0 or bool(at_begin), i + 2 < len(edges) or bool(at_end)
        length = high - low - 2.0 * around * (after and before)
        if length > 0.0:
            parts.append((length, low + around if after else low - around))
    return parts
