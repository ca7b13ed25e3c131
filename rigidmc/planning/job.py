"""Blocks of members made ready, and what moves them compiled."""

import warnings
from typing import NamedTuple

import numpy as np

from rigidmc.effects import EFFECTS
from rigidmc.effects.own import RULE
from rigidmc.effects.parameters import blank
from rigidmc.engine import layout
from rigidmc.engine.compose import NumbaError, reason
from rigidmc.engine.frame import Noise
from rigidmc.engine.operations import refuse_misdeeds, unpacked
from rigidmc.engine.program import QUIET, Program
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.observables import OBSERVABLES
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.stage import ledger, noise, together


class Job(NamedTuple):
    """One block on its way: its members, its rows, and where its values go; see `rigidmc.engine.cpu`."""

    first: int
    size: int  # members, the padding not counted
    start: dict
    program: Program | None  # None where nothing is left to do
    noise: Noise
    block: np.ndarray
    order: (
        np.ndarray | None
    )  # in which the block has the members, where they have steps of their own
    out: np.ndarray
    width: int
    column: int
    h: float
    slots: int
    stride: int
    total: int
    rounds: int


def program_of(scene, plan, ask=False):
    """What moves the members of a plan, compiled or from the cache; None for closed forms. SceneError for effects that cannot be compiled.
    ask : compile nothing, and tell what is `missing`"""
    if plan.form is None:
        return None
    own = [e for e in scene.effects if type(e) not in EFFECTS.values()]
    try:
        refuse_misdeeds(own)
        for effect in own:
            if why := unpacked(effect):
                rule = f"{type(effect).__name__} {why}: members are not worked on side by side, and the step is much slower than it might be"
                warnings.warn(rule, SceneWarning, stacklevel=2)
        events, running, shadow = plan.watch.compiled
        return Program(
            plan.form,
            blank(scene.effects),
            tuple(OBSERVABLES[name]() for name in scene.recorded()),
            plan.carried,
            plan.compensated,
            plan.dtype,
            tuple(plan.limits),
            ledger(scene),
            events,
            running,
            shadow,
            side_by_side(own),
            ask,
        )
    except NumbaError as error:
        if not own:
            raise
        raise SceneError(
            "effects",
            ", ".join(type(e).__name__ for e in own),
            None,
            f"cannot be compiled: {reason(error)}; {RULE}",
        ) from error


def side_by_side(own):
    """How many members are worked on side by side where a scene has effects of a user's own: one, where code of one of them takes one only."""
    return 1 if any(map(unpacked, own)) else None


def job_of(scene, plan, program, first, count, block, start, out, width, column):
    """A block of `count` members from `first` on, whose values go to columns from `column` on of `out`, `width` columns wide."""
    order, slots = None, 1
    if plan.own:
        order = together(block)
        block = np.take(block, order, axis=1)  # block[:, order] would lie the other way round
        slots = int(block[layout.STEPS].max(initial=1.0))
    steps = slots * plan.stride, slots * plan.steps, plan.steps
    return Job(
        first,
        count,
        start,
        program,
        noise(scene, first),
        block,
        order,
        out,
        width,
        column,
        plan.dt,
        slots,
        *steps,
    )


def closed_job(scene, plan, first, count, block, start, out, width, column):
    """A block that needs no steps: its saves are closed forms."""
    values, saves = closed_values(scene, block, start, plan.times, plan.dt), len(plan.times)
    if width:
        size = block.shape[1]
        out.reshape(saves, -1, width)[:, :, column : column + size] = values
    return Job(
        first,
        count,
        start,
        None,
        QUIET,
        block,
        None,
        out,
        width,
        column,
        plan.dt,
        1,
        plan.stride,
        plan.steps,
        plan.steps,
    )
