"""Blocks of members made ready, and the program that moves them."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.compose import NumbaError, reason
from rigidmc.engine.cuda.devices import number_of
from rigidmc.engine.inspection import refuse_memory
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import Noise
from rigidmc.engine.program import NO_NOISE, Program
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.trials import RULE
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.observables import is_own
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.initial import Start, ledger, noise
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import Array, by_steps
from rigidmc.scene.once import once
from rigidmc.scene.scene import Scene


class Job(NamedTuple):
    """One block on its way: its members, its rows, and where its values go.

    first, size : place of the first member, and how many there are without the padding;  members :
        their indices, with the padding
    start : what the members were made from;  program : None if nothing is left to do
    order : of the members in the block if they have steps of their own
    out, width, column : array for the values, its columns, and the block's first column
    h, slots, stride, total : step [s], slots in a round, steps between saves, steps in all
    head, last_h : the step after which h is `last_h`
    done : steps that are made already
    """

    first: int
    size: int
    members: NDArray[np.int64]
    start: Start
    program: Program | None
    noise: Noise
    block: Array
    order: NDArray[np.int64] | None
    out: Array
    width: int
    column: int
    h: float
    slots: int
    stride: int
    total: int
    head: int
    last_h: float
    rounds: int
    done: int = 0


@once
def program_of(scene: Scene, plan: Plan, ask: bool = False) -> Program | None:
    """What moves the members of a plan, compiled or from the cache; None for closed forms.

    ask : compile nothing; the Program then tells what is `missing`
    Raises SceneError for effects that cannot be compiled.
    """
    if plan.form is None:
        return None
    try:
        refuse_memory(scene.effects)
        events, running, shadow = plan.watch.compiled
        kind: Any = Program
        if plan.device != "cpu":
            from rigidmc.engine.cuda.program import CudaProgram

            kind = partial(CudaProgram, number=number_of(plan.device))
        found: Program = kind(
            plan.form,
            blank(scene.effects),
            tuple(scene.recorded().values()),
            plan.carried,
            plan.compensated,
            plan.dtype,
            tuple(plan.limits),
            ledger(scene),
            events,
            running,
            shadow,
            ask=ask,
            nodes=plan.nodes,
            paired=plan.paired,
            shortens=plan.grid.is_shortened,
        )
        return found
    except NumbaError as error:
        own = {
            "effects": [e for e in scene.effects if type(e) not in EFFECTS.values()],
            "observables": list(filter(is_own, scene.observables)),
        }
        names = {key: ", ".join(type(one).__name__ for one in ones) for key, ones in own.items()}
        table = ", ".join(table for table, words in names.items() if words)
        if not table:
            raise
        rule = f"cannot be compiled: {reason(error)}; {RULE}"
        raise SceneError(table, ", ".join(filter(None, names.values())), None, rule) from error


def job_of(
    scene: Scene,
    plan: Plan,
    program: Program,
    first: int,
    count: int,
    members: NDArray[np.int64],
    block: Array,
    start: Start,
    out: Array,
    width: int,
    column: int,
) -> Job:
    """A block of `count` members from place `first` on, whose values go to the columns of `out`
    from `column` on; `members` : their indices;  `width` : columns of `out`."""
    order, slots = None, 1
    if plan.member_steps:
        order = by_steps(block)
        block = np.take(block, order, axis=1)  # block[:, order] would have another memory layout
        slots = int(block[layout.STEPS].max(initial=1.0))
    return Job(
        first=first,
        size=count,
        members=members,
        start=start,
        program=program,
        noise=noise(scene, members),
        block=block,
        order=order,
        out=out,
        width=width,
        column=column,
        h=plan.dt,
        slots=slots,
        stride=slots * plan.stride,
        total=slots * plan.steps,
        head=slots * plan.head,
        last_h=plan.last_dt,
        rounds=plan.steps,
    )


def closed_job(
    scene: Scene,
    plan: Plan,
    first: int,
    count: int,
    members: NDArray[np.int64],
    block: Array,
    start: Start,
    out: Array,
    width: int,
    column: int,
) -> Job:
    """A block that needs no steps, because its saves are closed forms."""
    values, saves = closed_values(scene, block, start, plan.times, plan.grid.clock), len(plan.times)
    if width:
        size = block.shape[1]
        out.reshape(saves, -1, width)[:, :, column : column + size] = values
    return Job(
        first=first,
        size=count,
        members=members,
        start=start,
        program=None,
        noise=NO_NOISE,
        block=block,
        order=None,
        out=out,
        width=width,
        column=column,
        h=plan.dt,
        slots=1,
        stride=plan.stride,
        total=plan.steps,
        head=plan.head,
        last_h=plan.last_dt,
        rounds=plan.steps,
    )
