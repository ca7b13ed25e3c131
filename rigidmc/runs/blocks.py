"""Blocks of members: staged, advanced by the engine on threads, and handed to a sink."""

import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np
import xarray as xr

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.program import Program
from rigidmc.engine.threads import Keeper, run_blocks
from rigidmc.planning import monitors
from rigidmc.planning.initial import stage, stage_some
from rigidmc.planning.job import Job, closed_job, job_of, program_of
from rigidmc.planning.plan import Plan
from rigidmc.planning.units import Internal, in_user_units
from rigidmc.progress import Progress, Report, reporter
from rigidmc.results.export import is_streamed
from rigidmc.results.schema import member_variables
from rigidmc.results.sinks import Export, File, Memory
from rigidmc.scene.drifts import drift_laws
from rigidmc.scene.scene import Scene


class Sink(Protocol):
    """Where the results of blocks go: memory, a file, or the shards of a run directory."""

    def room(self, low: int, count: int) -> tuple[np.ndarray, int, int]:
        """Memory for what members low ... low + count - 1 save: an array, its width, and the first
        column of these members."""

    def has(self, place: int) -> bool:
        """Whether an earlier run left the results of the block at a place."""

    def resumed(self, job: Job) -> Job:
        """A block that goes on from where an earlier run left it, if there is anything of it."""

    @property
    def keeper(self) -> Keeper | None:
        """What keeps the states of blocks on their way, None if nothing does."""

    def take(self, job: Job, results: dict[str, np.ndarray]) -> None:
        """Take a finished block and the results of its members."""

    def finish(self) -> Any:
        """Complete the result and return it."""

    def discard(self) -> None:
        """Drop an incomplete result."""


def run(
    scene: Scene,
    plan: Plan,
    threads: int,
    progress: Progress = False,
    output: str | os.PathLike[str] | None = None,
    force: bool = False,
    attrs: Mapping[str, Any] | None = None,
    units: Internal | None = None,
) -> xr.Dataset:
    """Run the plan of a scene and return its result; see `simulate`.

    units : how the scene was rescaled; the result is in the units of the original scene

    `dataset.encoding["rigidmc"]` holds the cost of the run and the number of flagged members.
    """
    began = time.perf_counter()
    program = program_of(scene, plan)
    compiled = time.perf_counter() - began
    original, shown = in_user_units(scene, plan, units)
    sink: Sink = Memory(original, shown, dict(attrs or {}))
    if output is not None:
        kind = File if is_streamed(output) else Export
        sink = kind(output, original, shown, force, dict(attrs or {}))
    began = time.perf_counter()
    try:
        flagged = compute(scene, plan, program, threads, sink, progress, units)
        dataset: xr.Dataset = sink.finish()
    except BaseException:
        sink.discard()
        raise
    dataset.encoding["rigidmc"] = {
        "compile_seconds": compiled,
        "run_seconds": time.perf_counter() - began,
        "flagged": flagged,
        "steps": plan.mean_steps,
    }
    return dataset


def compute(
    scene: Scene,
    plan: Plan,
    program: Program | None,
    threads: int,
    sink: Sink,
    progress: Progress = False,
    units: Internal | None = None,
    blocks: Iterable[int] | None = None,
    members: int | None = None,
) -> dict[str, int]:
    """Compute all blocks of a plan, or only those in `blocks`, and hand each to the sink when it is
    done; {status: number of members}.

    members : number of members in `blocks`, for the progress bar
    """
    original, shown = in_user_units(scene, plan, units)
    flagged = dict.fromkeys(layout.STATUSES, 0)

    def make(i: int) -> Job:
        low = i * plan.block
        count = min(plan.block, plan.members - low)
        members = plan.indices(plan.first + low, whole_lanes(count))
        staged = plan.carried, plan.dt if plan.member_steps else None, plan.watch.rows
        if plan.which is None:
            block, start = stage(scene, plan.first + low, members.size, *staged)
        else:
            block, start = stage_some(scene, members, *staged)
        place = (plan.first + low, count, members, block, start, *sink.room(low, count))
        if scene.run.integrator == "closed":
            return closed_job(scene, plan, *place)
        assert program is not None  # only closed forms have none
        return sink.resumed(job_of(scene, plan, program, *place))

    def finished(job: Job) -> None:
        results = _results(job, scene, plan)
        for status, count in zip(
            layout.STATUSES,
            np.bincount(results["status"], minlength=len(layout.STATUSES)),
            strict=True,
        ):
            flagged[status] += int(count)
        if units is not None:
            results = _in_original_units(job, results, original, shown, units)
        sink.take(job, results)

    members = plan.members if members is None else members
    which = range(math.ceil(plan.members / plan.block)) if blocks is None else blocks
    if program is not None:
        count = math.ceil(members / plan.block)
        threads = program.workers(threads, count, plan.block, plan.times.size)
    with reporter(progress, members, plan.steps) as report:
        left = _left(which, plan, sink, report)
        run_blocks(make, left, threads, finished, report.step, report.poll, sink.keeper)
    return flagged


def _left(blocks: Iterable[int], plan: Plan, sink: Sink, report: Report) -> Iterator[int]:
    """The blocks of which the sink does not have the results; those that it has count as done."""
    for i in blocks:
        if sink.has(plan.first + i * plan.block):
            report.step(plan.block * plan.steps)
        else:
            yield i


def _results(job: Job, scene: Scene, plan: Plan) -> dict[str, np.ndarray]:
    """{variable: values} of the finished members of a block, except what was saved over time."""
    rows = job.block if job.order is None else job.block[:, np.argsort(job.order)]
    status = rows[layout.STATUS, : job.size].astype("i1")
    flagged, fault = rows[layout.STATUS] > 0.0, rows[layout.FAULT_STEP]
    each = rows[layout.STEPS]
    made, clock = plan.steps * each, plan.grid.clock.of(each)
    return {
        "energy_drift_max": rows[layout.DRIFT],
        "l2_drift_max": rows[layout.DRIFT + 1],
        "drift_law": drift_laws(scene, rows, made, plan.dtype),
        **monitors.results(scene, plan.watch, rows, clock, made, plan.nodes),
        "status_step": np.where(flagged, fault, -1.0),
        "status_time": np.where(flagged, clock.time(fault), np.nan),
        "status": status,
        "steps": made,
        **job.start,
    }


def _in_original_units(
    job: Job, results: dict[str, np.ndarray], scene: Scene, plan: Plan, units: Internal
) -> dict[str, np.ndarray]:
    """Results in the units of the original scene; values saved over time are changed in place."""
    if job.width:
        saves = job.out.reshape(plan.times.size, plan.values, job.width)
        columns = slice(job.column, job.column + job.block.shape[1])
        for name, rows in plan.saved.items():
            saves[:, rows, columns] *= units.factor(scene.observable(name).units)
    known = member_variables(scene, plan.carried)
    return {
        name: values * units.factor(known[name].attrs.get("units", "1"))
        if name in known
        else values
        for name, values in results.items()
    }
