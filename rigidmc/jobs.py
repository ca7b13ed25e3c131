"""Blocks of members made ready for the kernel, and the kernel compiled for them."""

import time
import warnings
from typing import NamedTuple

import numpy as np

from rigidmc.closed_form import closed_values
from rigidmc.effects import EFFECTS
from rigidmc.effects.own import RULE
from rigidmc.effects.parameters import blank
from rigidmc.engine import kernel, layout
from rigidmc.engine.compose import NumbaError, as_single, reason
from rigidmc.engine.flops import misdeeds, unpacked
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.observables import OBSERVABLES
from rigidmc.staging import block_rows, ledger, noise, together


class Job(NamedTuple):
    """One block on its way: its members, its rows, and where its values go; see `rigidmc.engine.kernel.advance`."""

    first: int
    size: int  # members, the padding not counted
    start: dict
    how: (
        tuple | None
    )  # None where nothing is left to do; integrator, parts, effects, observables, attitude, compensated, precision, own, limits, noise, ledger, events, running, shadow
    block: np.ndarray
    order: np.ndarray | None  # in which the block has the members, where they have steps of their own
    out: np.ndarray
    width: int
    column: int
    h: float
    slots: int
    stride: int
    total: int
    rounds: int


def compile_kernel(scene, plan):
    """Compile, or load from the cache, the kernel of a plan; seconds that it took."""
    began = time.perf_counter()
    if plan.form is None:
        return 0.0
    own = [e for e in scene.effects if type(e) not in EFFECTS.values()]
    try:
        for effect in own:
            if wrong := misdeeds(effect):
                raise SceneError("effects", f"{type(effect).__name__}.torque", None, f"{wrong}; {RULE}")
            if why := unpacked(effect):
                rule = f"{type(effect).__name__} {why}: members are not worked on side by side, and the step is much slower than it might be"
                warnings.warn(rule, SceneWarning, stacklevel=2)
        kernel.advance(*block_arguments(scene, plan, np.zeros((block_rows(scene) + plan.watch.rows, 0))), 1, 0, 0, 1, 1)
    except NumbaError as error:
        if not own:
            raise
        raise SceneError(
            "effects", ", ".join(type(e).__name__ for e in own), None, f"cannot be compiled: {reason(error)}; {RULE}"
        ) from error
    return time.perf_counter() - began


def block_arguments(scene, plan, block):
    """Arguments of `kernel.advance` up to h, for a block of which nothing is saved."""
    job = job_of(scene, plan, 0, 0, block, {}, np.empty(0), 0, 0)
    return *job.how, job.block, job.out, job.width, job.column, job.h


def job_of(scene, plan, first, count, block, start, out, width, column):
    """A block of `count` members from `first` on, whose values go to columns from `column` on of `out`, `width` columns wide."""
    effects = blank(scene.effects)
    observables = tuple(OBSERVABLES[name]() for name in scene.recorded())
    compensated = (0.0,) if plan.compensated else ()
    attitude, precision = (0.0,) if plan.carried else (), np.empty(0, plan.dtype)
    integrator = as_single(plan.form.integrator) if plan.dtype == "float32" else plan.form.integrator
    order, own = None, tuple[np.ndarray, ...]()
    if plan.own:
        order = together(block)
        block, own = np.take(block, order, axis=1), (order,)  # block[:, order] would lie the other way round: another kernel
    how = (
        integrator,
        plan.form.parts,
        effects,
        observables,
        attitude,
        compensated,
        precision,
        own,
        tuple(plan.limits),
        noise(scene, first, block.shape[1], order),
        ledger(scene),
        *plan.watch.compiled,
    )
    slots = int(block[layout.STEPS].max(initial=1.0)) if plan.own else 1
    return Job(
        first,
        count,
        start,
        how,
        block,
        order,
        out,
        width,
        column,
        plan.dt,
        slots,
        slots * plan.stride,
        slots * plan.steps,
        plan.steps,
    )


def closed_job(scene, plan, first, count, block, start, out, width, column):
    """A block that needs no kernel: its saves are closed forms."""
    values, saves = closed_values(scene, block, start, plan.times, plan.dt), len(plan.times)
    if width:
        size = block.shape[1]
        out.reshape(saves, -1, width)[:, :, column : column + size] = values
    return Job(first, count, start, None, block, None, out, width, column, plan.dt, 1, plan.stride, plan.steps, plan.steps)
