"""Move members one part of a run at a time. Between the parts, a study may inspect them, copy them,
and continue the copies with their own noise."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange
from rigidmc.engine.kernel.layout import LANES, whole_lanes
from rigidmc.engine.machine import allocate_block
from rigidmc.engine.program import NO_SAVES
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.planning import monitors
from rigidmc.planning.initial import Source, initial_block
from rigidmc.planning.switches import cut_rows
from rigidmc.processes.threads import Late, Task, end_of_work, threads_of
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.quantities import of_members
from rigidmc.scene.scene import Scene

SHARE = 8 * LANES  # members that justify a thread


class SegmentedRun:
    """The members of a scene in progress, as blocks of rows, see `rigidmc.engine.kernel.layout`.

    A block is the whole state of its members: a run may continue from copied columns. A member's
    bits depend only on its column, its index and the steps, not on the parts.

    parts : number of parts of the run, as even as its steps allow; at most the number of steps
    ends : the steps at which parts begin and end
    """

    def __init__(self, scene: Scene, parts: int, threads: int, device: str | None = None) -> None:
        """Raise SceneError for closed forms and for per-member steps (`turn`)."""
        if scene.run.turn is not None:
            rule = "the members of such a study need the same steps: use dt"
            raise SceneError(rule, at="run.turn", value=scene.run.turn)
        run = prepare_scene(scene)
        program = run.program(resolve_device(device))
        if program is None:
            rule = "has no steps: this study follows members step by step, so use exact"
            raise SceneError(rule, at="run.integrator", value=scene.run.integrator)
        self.prepared, self.plan, self._units = run, run.plan, run.units
        self._program, self._threads = program, threads
        self.ends = np.unique(np.linspace(0, self.plan.grid.steps, parts + 1).astype(int))
        self._known = run.layout.by_member

    def start(self, source: Source, count: int, rows: Ints | None = None) -> Array:
        """Build the block of `count` members, drawn from `source`, and more to fill lanes.

        rows : scene members whose rows of grids and tables the block uses; default the first ones
        """
        plan, model = self.plan, self.plan.model
        if rows is not None:
            model = model.mapped(lambda quantity: of_members(quantity, rows))
        block, start = initial_block(model, source, 0, count, plan.has_attitude, plan.places.end)
        if plan.has_axes:
            block[plan.places.axes : plan.places.end] = start["principal_axes"]
        return fill_lanes(block)

    def moved(self, block: Array, members: Ints, part: int) -> Array:
        """Return a block after a part of the run, from its state before.

        Raises Late if the work must end before that, see `rigidmc.processes.threads.ending`.

        members : the index of each member, which determines its noise
        """
        plan, count = self.plan, members.size
        first, last = map(int, self.ends[part : part + 2])
        grid, effects = plan.grid, plan.model.effects
        lengths = grid.head, grid.last_dt
        cuts = cut_rows(effects, grid.clock, grid.steps, False)
        run = StepRange(grid.dt, 1, grid.stride, grid.steps, 0, first, last, *lengths).cut(cuts)
        size, end = max(SHARE, whole_lanes(-(-count // self._threads))), end_of_work()

        def advance(low: int) -> Array:
            mine = fill_lanes(block[:, low : low + size])
            indices = np.resize(members[low : low + size], mine.shape[1])
            for _ in self._program.through(mine, run, plan.noise(indices), NO_SAVES):
                if time.monotonic() >= end:
                    raise Late
            return mine[:, : min(size, count - low)]

        tasks = [Task(advance, low) for low in range(0, count, size)]
        if len(tasks) == 1:
            return advance(0)
        threads_of("parts", self._threads).run(tasks)
        return np.concatenate([task.result() for task in tasks], axis=1)

    def results(self, block: Array, part: int) -> dict[str, Array]:
        """Return {variable: values of each member} of monitors after a part; nan if flagged."""
        plan, steps = self.plan, int(self.ends[part + 1])
        monitored = monitors.results(
            plan.monitors, plan.places, block, plan.grid.clock, steps, plan.nodes
        )
        if self._units is None:
            return monitored
        units = {name: self._known[name].attrs.get("units", "1") for name in monitored}
        return {name: x * self._units.factor(units[name]) for name, x in monitored.items()}

    def event(self, i: int, block: Array) -> tuple[Array, Array]:
        """Return (count, level) of event i of the scene for each member; the level is 0 while the
        event cannot happen next."""
        at = self.plan.places.events + layout.EVENT_ROWS * i
        return block[at + layout.COUNT], block[at + layout.LEVEL]

    def events(self) -> Sequence[tuple[str, Any]]:
        """Return (label, event) of each event, in the order of `event`."""
        return self.plan.monitors.of_events


def fill_lanes(block: Array) -> Array:
    """Copy a block to its own memory and fill it to whole lanes with copies of the first member."""
    rows, count = block.shape
    wide = allocate_block(rows, whole_lanes(count))
    wide[:, :count], wide[:, count:] = block, block[:, :1]
    return wide
