"""The main job on one screen: a scene becomes a plan, blocks of members run through the kernel, a Dataset or a file comes out."""

import math
import os
import sys
import tempfile
import time
import warnings

import numpy as np

from rigidmc.engine import layout
from rigidmc.engine.layout import whole_lanes
from rigidmc.engine.machine import threads_available
from rigidmc.engine.threads import run_blocks
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.files.outputs import folder_beside, refuse_existing
from rigidmc.observables import OBSERVABLES, rows_of
from rigidmc.planning import watch
from rigidmc.planning.job import closed_job, job_of, program_of
from rigidmc.planning.notes import notes
from rigidmc.planning.plan import prepare
from rigidmc.planning.stage import stage
from rigidmc.planning.tolerance.choose import resolved
from rigidmc.planning.units import internal, scaled, told
from rigidmc.progress import announcing, reporter
from rigidmc.runs.capacity import refuse_hopeless
from rigidmc.scene.amounts import counted
from rigidmc.scene.quantities import rows
from rigidmc.storage.schema import member_variables
from rigidmc.storage.sinks import File, Memory

REHEARSED = 8192  # members: two blocks for each of two threads


def simulate(
    scene, integrator=None, dt=None, t_end=None, members=None, seed=None, every=None, save=None, keep=None,
    threads=None, progress=False, output=None, force=False, block=None, tolerance=None, dtype=None, compensated=None, turn=None,
    checks=None, attrs=None,
):  # fmt: skip
    """Integrate an ensemble and return an xarray Dataset with dimensions member, time, axis, quat.

    scene : Scene; what is None below is taken from its run settings
    integrator : a name of `rigidmc integrators`, or "auto" for the cheapest that keeps a tolerance
    tolerance : error to keep in 99 % of the members, of the momentum's size and of the attitude in rad; chooses integrator, dtype and dt by
        a pilot (`rigidmc.planning.tolerance.choose.choose`; the choice rests on measured times, and the result tells it in its attributes)
    dtype : "float64" or "float32", of the numbers in which steps are made; starts, saves and drifts are float64. In float32 sums keep
        their remainders wherever they can, and what is left is the rounding of the body to 6e-8
    compensated : keep the remainders of all sums, for very many steps
    dt : step [s], as all times also "250 ms" or "1h30m"; reduced where it divides neither t_end nor every, which a warning says
    turn : in place of dt, how far a member may move in a step [rad] at its own rate (`rigidmc.planning.rates.rates`): each then makes its own
        number of equal steps between saves, which the result has as `steps`; an ensemble of slow and fast tops takes half the time
    members : how many, also as 1e6, or a range of member indices: a member's bits depend on scene, seed and its index alone
    every : time between saves [s]; without it the first and last state are saved
    save : names of observables, e.g. ("omega", "attitude", "energy")
    keep : how much of what is saved: "full", "thinned", "summary", "final" or "none", or {name: one of these}; of members that are flagged all
        of it is kept, see `rigidmc.observables.keep`
    threads : default one per core that the process may use
    progress : True for a bar on a terminal (lines elsewhere), and a line before anything is compiled; or a function of (done, total) member-steps
    checks : False to flag non-finite members only, not those that drift or spin beyond the limits of `rigidmc.planning.limits`
    output : write this netCDF file block by block, in memory that does not grow, and open it lazily; `force` replaces one that is there
    block : members of a block, a multiple of 32; no result depends on it
    attrs : more attributes of the result, words and numbers

    Raises SceneError for a scene that cannot be run, OutputExists for an output that is there. Members that turn non-finite, drift
    or spin too fast for the step are flagged in `status` and frozen at their last good state; the others do not change by a bit.
    """
    first = None
    if isinstance(members, range):
        if members.step != 1 or members.start < 0 or not members:
            raise SceneError(
                "run", "members", members, "expected a range of member indices with step 1"
            )
        first, members = members.start, len(members)
    elif members is None and (count := rows(*scene.quantities())) is not None:
        members = count - scene.run.first
    if save is not None:
        save = (save,) if isinstance(save, str) else tuple(save)
    scene = scene.with_run(
        integrator=integrator,
        tolerance=tolerance,
        dt=dt,
        turn=turn,
        t_end=t_end,
        every=every,
        first=first,
        members=members,
        seed=seed,
        save=save,
        keep=keep,
        dtype=dtype,
        compensated=compensated,
        checks=checks,
    )
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    threads = threads_available() if threads is None else counted(threads, "threads")
    if output is not None:
        refuse_existing(output, force)
    given = scene
    with announcing(progress):
        scene, plan, units, chosen = settled(given, threads, output is not None, block)
        for note in notes(given, plan, units):
            warnings.warn(note, SceneWarning, stacklevel=2)
        refuse_hopeless(scene, plan, threads, output)
        if chosen is not None:
            expected = _rehearsed(scene, plan, threads, output, chosen)
            if chosen.short:
                warnings.warn(chosen.short, SceneWarning, stacklevel=2)
            if progress is True:
                print("\n".join(chosen.lines(plan.members, expected)), file=sys.stderr)
            dataset = run(
                scene,
                plan,
                threads,
                progress,
                output,
                force,
                {**chosen.attributes(), **(attrs or {})},
                units,
            )
            dataset.encoding["rigidmc"]["predicted_seconds"] = expected
            return dataset
        return run(scene, plan, threads, progress, output, force, attrs, units)


def settled(scene, threads=1, streaming=False, block=None):
    """(scene, its Plan, the Units that it is in, what a tolerance chose): everything of a run that is settled before its first step."""
    units = internal(scene)
    if units is not None:
        scene = scaled(scene, units.mass, 1.0, units.time)
    scene, chosen = resolved(scene, threads)
    return scene, prepare(scene, threads, streaming, block), units, chosen


def run(scene, plan, threads, progress=False, output=None, force=False, attrs=None, units=None):
    """Run a plan of a scene, which `units` tells to be in other units than its result; `dataset.encoding["rigidmc"]` tells what it cost and how many members are flagged. See `simulate`."""
    began = time.perf_counter()
    program = program_of(scene, plan)
    compiled = time.perf_counter() - began
    mine, shown = told(scene, plan, units)
    sink = (
        File(output, mine, shown, force, attrs or {})
        if output is not None
        else Memory(mine, shown, attrs or {})
    )
    began = time.perf_counter()
    try:
        flagged = compute(scene, plan, program, threads, sink, progress, units)
        dataset = sink.finish()
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
    scene, plan, program, threads, sink, progress=False, units=None, blocks=None, members=None
):
    """Compute the blocks of a plan, or those of some indices with so many members, and give them to a sink as they are done; {status: members}."""
    mine, shown = told(scene, plan, units)
    which = range(math.ceil(plan.members / plan.block)) if blocks is None else blocks
    flagged = dict.fromkeys(layout.STATUSES, 0)

    def make(i):
        low = i * plan.block
        count = min(plan.block, plan.members - low)
        span = plan.dt if plan.own else None
        block, start = stage(
            scene, plan.first + low, whole_lanes(count), plan.carried, span, plan.watch.rows
        )
        if scene.run.integrator == "closed":
            return closed_job(
                scene, plan, plan.first + low, count, block, start, *sink.room(low, count)
            )
        return job_of(
            scene, plan, program, plan.first + low, count, block, start, *sink.room(low, count)
        )

    def finished(job):
        rows = job.block if job.order is None else job.block[:, np.argsort(job.order)]
        status = rows[layout.STATUS, : job.size].astype("i1")
        for code, count in enumerate(np.bincount(status, minlength=len(layout.STATUSES))):
            flagged[list(layout.STATUSES)[code]] += int(count)
        drift = {"energy_drift_max": rows[layout.DRIFT], "l2_drift_max": rows[layout.DRIFT + 1]}
        seen, found = rows[layout.FAULT_STEP], rows[layout.STATUS] > 0.0
        faults = {
            "status_step": np.where(found, seen, -1.0),
            "status_time": np.where(found, seen * (plan.dt / rows[layout.STEPS]), np.nan),
        }
        seen = watch.results(
            scene, plan.watch, rows, plan.dt / rows[layout.STEPS], plan.steps * rows[layout.STEPS]
        )
        results = {
            **drift,
            **seen,
            **faults,
            "status": status,
            "steps": rows[layout.STEPS] * plan.steps,
            **job.start,
        }
        sink.take(job, results if units is None else _told(job, results, mine, shown, units))

    with reporter(progress, plan.members if members is None else members, plan.steps) as report:
        run_blocks(make, which, threads, finished, report.step, report.poll)
    return flagged


def _told(job, results, scene, plan, units):
    """Results in the units of the scene; the saved values are changed in place."""
    names = scene.recorded()
    each = [
        units.factor(OBSERVABLES[name].units)
        for name in names
        for _ in range(rows_of(scene.effects, name))
    ]
    if job.width:
        values = job.out.reshape(plan.times.size, len(each), job.width)[
            ..., job.column : job.column + job.block.shape[1]
        ]
        values *= np.array(each)[:, None]
    known = member_variables(scene, plan.carried)
    return {
        name: v * units.factor(known[name].attrs.get("units", "1")) if name in known else v
        for name, v in results.items()
    }


def _rehearsed(scene, plan, threads, output, chosen):
    """How long a plan will take [s], from its first members: with memory or a file of the same kind, which the kernels' time leaves out."""
    guess = plan.members / chosen.members_per_second
    if plan.members < 8 * REHEARSED:
        return guess
    kept, began = [], time.perf_counter()
    taken: dict[int, list[float]] = {REHEARSED: [], 3 * REHEARSED: []}
    with folder_beside(output) if output else tempfile.TemporaryDirectory() as folder:
        for i in range(10):
            count = REHEARSED * (1 + 2 * (i % 2))
            few = scene.with_run(members=count)
            file = os.path.join(folder, f"{i}.nc") if output else None
            kept.append(
                run(
                    few, prepare(few, threads, output is not None, plan.block), threads, False, file
                )
            )
            taken[count].append(kept[-1].encoding["rigidmc"]["run_seconds"])
            if i >= 3 and time.perf_counter() - began > 0.5:
                break
        for dataset in kept:  # only now, so that none finds memory that was used before
            dataset.close()
    few_seconds, more_seconds = (
        float(np.median(seconds)) for seconds in (taken[REHEARSED][1:], taken[3 * REHEARSED])
    )  # the first warms up
    each = max(more_seconds - few_seconds, 0.2 * more_seconds) / (
        2 * REHEARSED
    )  # what a run takes once is not counted again
    return more_seconds + each * (plan.members - 3 * REHEARSED)
