"""The members of a study of exponents: each task is a block of members with their tangents."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.engine.machine import allocate_block
from rigidmc.engine.program import Program
from rigidmc.engine.threads import run_blocks
from rigidmc.errors import OptionError
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import order_by_steps, rate_bounds
from rigidmc.runs.assemble import make_program
from rigidmc.runs.blocks import BlockJob, steps_of
from rigidmc.runs.directory.tasks import Request, TaskArrays
from rigidmc.runs.prepare import PreparedRun
from rigidmc.studies.lyapunov.tangents import COUNT, TANGENTS, TangentProgram, with_tangents

Array = NDArray[np.float64]


def kept_saves(plan: Plan, keep: int) -> NDArray[np.int64]:
    """Return the saves at which the growth is kept: every `keep`-th one, and the last."""
    last = plan.grid.saves - 1
    return np.unique(np.append(np.arange(keep, last, keep), last))


def compute_members(
    run: PreparedRun, request: Request, numbers: Sequence[int], threads: int, device: str | None
) -> list[TaskArrays]:
    """Compute the members of tasks; return their growth."""
    if device not in (None, "cpu"):
        rule = "a spectrum is computed on the CPU: leave it out"
        raise OptionError(rule, at="device", value=device)
    size = request["size"]
    # the kernel needs the state at saves, but writes no values
    plan = run.plan._replace(recording=run.scene.with_run(save=()).recording)
    program, kept = make_program(plan, derivatives=TANGENTS), kept_saves(plan, request["keep"])
    assert program is not None
    done: dict[int, TaskArrays] = {}

    def make(number: int) -> BlockJob:
        first, count = number * size, min(size, run.members.size - number * size)
        place = run.members.first + first
        rows = run.initial(place, count)[0]
        members = run.members.indices(place, rows.shape[1])
        return _job(plan, program, kept, (first, count), members, rows)

    def finished(job: BlockJob) -> None:
        done[job.first // size] = _results(job)

    # with `poll`, the deadline is checked five times a second
    run_blocks(make, numbers, threads, finished, poll=lambda: None)
    return [done[number] for number in numbers]


def _job(
    plan: Plan,
    program: Program,
    kept: NDArray[np.int64],
    place: tuple[int, int],
    members: NDArray[np.int64],
    rows: Array,
) -> BlockJob:
    """Return a block of members with their tangents at the start.

    place : of the first one in the study, and their number;  members, rows : with the padding
    """
    order, slots = None, 1
    if plan.has_member_steps:
        order, slots = order_by_steps(rows), int(rows[layout.STEPS].max())
        rows = rows[:, order]
    largest = 1.0 / rows[layout.BODY : layout.BODY + 3].min(axis=0)
    rate = rate_bounds(plan.model.effects, rows)
    scale = largest * np.where(np.isfinite(rate) & (rate > 0.0), rate, 1.0)
    block = allocate_block((1 + COUNT) * rows.shape[0], rows.shape[1])
    block[:] = with_tangents(rows, scale)
    return BlockJob(
        first=place[0],
        size=place[1],
        members=members,
        start={},
        program=TangentProgram(program, scale, kept),  # type: ignore[arg-type]  # `through` only
        noise=plan.noise(members),
        block=block,
        order=order,
        out=np.empty(0),
        width=0,
        column=0,
        steps=steps_of(plan, slots),
    )


def _results(job: BlockJob) -> TaskArrays:
    """Return the growth and the status of the members of a block, in their order."""
    program: Any = job.program
    back = slice(None) if job.order is None else np.argsort(job.order)
    status = job.block[layout.STATUS].astype("i1")
    arrays = {**program.history._asdict(), "flag": status}
    return {name: x[..., back][..., : job.size].copy() for name, x in arrays.items()}
