"""The points of a section, from the states that a run has saved."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import elementwise

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank, parameter_count
from rigidmc.engine import layout
from rigidmc.engine.formulas import evaluate
from rigidmc.engine.kinds import numbers_of
from rigidmc.engine.moved import Moved
from rigidmc.engine.operations import refuse_memory
from rigidmc.integrators import INTEGRATORS
from rigidmc.observables.protocol import size
from rigidmc.planning.stage import stage_some
from rigidmc.scene.scene import Scene
from rigidmc.studies.components import rows
from rigidmc.studies.sections.question import Crossing

Array = NDArray[np.float64]
STATE = ("attitude", "momentum")
# rad: a step of rk8 of this length is 1e-13 off, so that a section costs no digits of the run
ARC = 0.2
JUMP = 1e-3  # a level that is still this share of its ends has jumped, as an angle by 2 pi


def periodic(part: xr.Dataset, observed: Mapping[str, Any]) -> dict[str, Array]:
    """The points of a result once in each period: its saves until the last good one."""
    times, members = part.time.values, part.member.values
    there = _good(part)
    m, k = np.nonzero(there.T)
    columns = {name: rows(part, name)[k, :, m].T for name in observed if name in part}
    return {"member": members[m], "time": times[k], **columns}


def _good(part: xr.Dataset) -> NDArray[np.bool_]:
    """Whether a save (time, member) is before the fault of its member, if it has one."""
    ends = np.where(part.status.values == 0, np.inf, part.status_time.values)
    there: NDArray[np.bool_] = part.time.values[:, None] < ends
    return there


def crossed(
    scene: Scene,
    part: xr.Dataset,
    crossing: Crossing,
    observed: Mapping[str, Any],
    threads: int | None,
) -> dict[str, Array]:
    """The points of a result where an observable passes a value."""
    level = crossing.of.values(part) - crossing.value
    good = _good(part)
    found = crossing.happens(level[:-1], level[1:]) & good[1:]
    m, k = np.nonzero(found.T)
    times, members = part.time.values, part.member.values
    start = np.concatenate([rows(part, name)[k, :, m].T for name in STATE])
    moving = _moving(scene, members, observed, times, k, start, m, threads)
    at = _place(observed, crossing)

    def remaining(share: Array, which: Array) -> Array:
        which = which.astype(int)
        span = share * (times[k + 1] - times[k])[which]
        level: Array = moving(span, which)[7 + at] - crossing.value
        return level

    if k.size == 0:
        share, still = np.empty(0), np.empty(0)
    else:
        root = elementwise.find_root(
            remaining, (0.0, 1.0), args=(np.arange(float(k.size)),), maxiter=100
        )
        share, still = root.x, np.abs(root.f_x)
    ends = np.abs(level[k, m]) + np.abs(level[k + 1, m])
    whole = still <= JUMP * ends  # an angle that jumps from pi to -pi has not passed 0
    m, k, share = m[whole], k[whole], share[whole]
    span = share * (times[k + 1] - times[k])
    values = moving(span, np.flatnonzero(whole))
    columns, row = {}, 7
    for name, one in observed.items():
        columns[name] = values[row : row + size(one.dims)]
        row += size(one.dims)
    return {"member": members[m], "time": times[k] + span, **columns}


def _place(observed: Mapping[str, Any], crossing: Crossing) -> int:
    """The row of the quantity among those of all observables."""
    names = list(observed)
    before = names[: names.index(crossing.of.name)]
    return sum(size(observed[name].dims) for name in before) + crossing.of.row


def _moving(
    scene: Scene,
    members: NDArray[np.int64],
    observed: Mapping[str, Any],
    times: Array,
    k: NDArray[np.intp],
    start: Array,
    m: NDArray[np.intp],
    threads: int | None,
) -> Callable[[Array, Any], Array]:
    """A function of (times h, which): what `Moved.values` gives h after the states `which`.

    k, start, m : saves, states (7, n) and places of the members of all states
    The steps of a point depend on itself alone, and so do its bits.
    """
    refuse_memory(scene.effects)
    block, _ = stage_some(scene, members, True)
    end = layout.EFFECTS + parameter_count(*scene.effects)
    table = block[layout.BODY : end].T
    observables = tuple(observed.values())
    fixed = np.array(numbers_of(observables))
    table = np.concatenate([table, np.broadcast_to(fixed, (len(table), fixed.size))], axis=1)
    kind = Moved(
        MassProperties(*[0.0] * 9), blank(scene.effects), observables, INTEGRATORS["rk8"],
        0.0, 0.0, (0.0,) * 4, (0.0,) * 3,
    )  # fmt: skip
    width = 7 + sum(size(one.dims) for one in observables)
    slowest = block[layout.BODY : layout.BODY + 3].min(axis=0)[m]
    turn = np.sqrt((start[4:] ** 2).sum(axis=0)) / slowest * (times[k + 1] - times[k])
    steps = np.maximum(1, np.ceil(turn / ARC)).astype(int)

    def moving(h: Array, which: Any) -> Array:
        count, now = steps[which], times[k[which]]
        values = np.concatenate([start[:, which], np.empty((width - 7, h.size))])
        for done in range(count.max(initial=0)):
            left = np.flatnonzero(count > done)
            step = h[left] / count[left]
            columns = np.concatenate([now[None, left], step[None], values[:7, left]])
            values[:, left] = evaluate(kind, width, columns, table, m[which][left], threads)
            now[left] += step
        return values

    return moving
