"""Members copied between a block, the workspace of a thread, and the saves.

A block has a column for each member, the workspace a lane: row i of lane k is number i * lanes + k
of `state` or of `work`. The derivatives come after all values: in the block the derivatives of all
passes, in the workspace the derivatives of one pass, then the tangents that grow.
"""

import sys
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import call_address
from rigidmc.engine.compiler.memory import memory, shifted
from rigidmc.engine.kernel import layout
from rigidmc.physics.dynamics.functions import as_float


class BlockMemory(NamedTuple):
    """The memory of a frame as plain numbers: row i of member k is number i * lanes + k."""

    substeps: Any
    block: Any
    state: Any
    spare_state: Any
    work: Any
    spare_work: Any
    trace: Any


def block_memory(frame):
    """Return the BlockMemory of a frame."""
    real = frame.real
    substeps, block = memory(frame.substeps, 1.0), memory(frame.block, 1.0)
    state, spare_state = memory(frame.state, real), memory(frame.spare_state, real)
    work, spare_work = memory(frame.work, 1.0), memory(frame.spare_work, 1.0)
    trace = memory(frame.trace, real)
    return BlockMemory(substeps, block, state, spare_state, work, spare_work, trace)


def copy_of_members(frame, j, part):
    """Return (block, state, work) with the values for j = 0, else with derivative j of a pass."""
    flat, lanes = block_memory(frame), frame.lanes
    column = 0 if j == 0 else part * frame.tangents + j
    block = shifted(flat.block, column * frame.rows * frame.width)
    state = shifted(flat.state, j * frame.tangents_in_state * lanes)
    return block, state, shifted(flat.work, j * frame.tangents_in_work * lanes)


def gather_members(frame, low, h, round_start, part):
    """Copy the rows of the members from `low` on, and their derivatives, to the workspace.

    h, round_start : length of the steps, or of a round of member steps, and when it began [s]
    part : the pass
    """
    lanes, work, members = frame.lanes, block_memory(frame).work, frame.width
    order, indices = memory(frame.order, lanes), memory(frame.members, lanes)
    for j in range(1 + frame.tangents):
        block, state, rows = copy_of_members(frame, j, part)
        # numbers and lengths of steps depend on no parameter: their derivatives are 0
        own, since = (frame.member_steps, round_start) if j == 0 else (0, 0.0)
        length = h if j == 0 else 0.0
        arguments = block, frame.rows, members, low, own, length, since, state, rows
        call_address(frame.gather, arguments)
        for k in range(lanes if j > 0 else 0):
            rows[layout.MEMBER_STEPS * lanes + k] = 0.0
    for k in range(lanes if frame.is_random != 0 else 0):
        index = order[low + k] if frame.member_steps != 0 else low + k
        # The bits of index + 1 as a float: rows of `work` are float64, and no arithmetic touches
        # them.
        work[layout.INDEX * lanes + k] = as_float(np.uint64(indices[index] + 1))


def gather_growing(frame, low):
    """Copy the tangents that grow, of the members from `low` on, to the workspace: they are the
    last derivatives of the state. Bodies and effects do not change along them.
    """
    flat, lanes, members = block_memory(frame), frame.lanes, frame.width
    state = shifted(flat.state, (1 + frame.tangents) * frame.tangents_in_state * lanes)
    work = shifted(flat.work, (1 + frame.tangents) * frame.tangents_in_work * lanes)
    first = (frame.growth_row - layout.MEMBER_ROWS) * members + low
    for i in range(layout.BODY_AT + frame.rows - layout.BODY):
        for k in range(lanes):
            state[i * lanes + k] = flat.block[first + i * members + k] if i < layout.START else 0.0
    for i in range((layout.MEMBER_ROWS + frame.rows) * lanes if frame.tangents != 0 else 0):
        work[i] = 0.0


def park_finished(frame, state, now, stores):
    """Copy the states of members that have made all their steps behind the trace, or back.

    stores : 0 to copy them back

    Return True if there are any.
    """
    lanes, is_any_finished, parking = frame.lanes, False, frame.parking * frame.lanes
    flat = block_memory(frame)
    trace, work = flat.trace, flat.work
    for k in range(lanes):
        if work[layout.MEMBER_STEPS * lanes + k] <= float(now):
            is_any_finished = True
            for j in range(1 + frame.tangents + frame.growth):
                for i in range(layout.START + frame.trailing):
                    row = i if i < layout.START else frame.row_after + i - layout.START
                    at = (j * frame.tangents_in_state + row) * lanes + k
                    place = parking + (j * (layout.START + frame.trailing) + i) * lanes + k
                    if stores != 0:
                        trace[place] = state[at]
                    else:
                        state[at] = trace[place]
    return is_any_finished


def save_members(frame, low, t, save, part):
    """Write the saved values of the members, and their derivatives of a pass.

    t, save : time [s] and number of the save

    Members with their own steps are sorted by steps: their values go to `saved` first.
    """
    if frame.columns != 0 and frame.values != 0:
        lanes, work, out = frame.lanes, block_memory(frame).work, memory(frame.out, 1.0)
        saved, order = memory(frame.saved, 1.0), memory(frame.order, lanes)
        tangents, each = frame.tangents, 1 + frame.passes * frame.tangents
        base = save * frame.values * each * frame.columns + frame.column
        first, reorders = 1 + part * tangents, frame.member_steps != 0
        if reorders:
            arguments = (
                work, frame.axes_row, saved, 0, (1 + tangents) * lanes, t, 0, lanes, lanes,
            )  # fmt: skip
        else:
            pitch = frame.columns
            arguments = (
                work, frame.axes_row, out, base + low, each * pitch, t, frame.skips_cache,
                first * pitch, pitch,
            )  # fmt: skip
        call_address(frame.record, arguments)
        for i in range(frame.values if reorders else 0):
            for j in range(1 + tangents):
                row = i * each + (0 if j == 0 else first + j - 1)
                for k in range(lanes):
                    at = (i * (1 + tangents) + j) * lanes + k
                    out[base + row * frame.columns + order[low + k]] = saved[at]


def scatter_members(frame, low, part):
    """Copy the rows of the members back to the block: their derivatives of a pass, and after the
    last pass all others.

    At the end of the run they contain the last good state.
    """
    is_last, row_after = part == frame.passes - 1, layout.BODY + frame.row_after - layout.BODY_AT
    done = 1 if frame.last == frame.total else 0
    for j in range(0 if is_last else 1, 1 + frame.tangents):
        block, state, work = copy_of_members(frame, j, part)
        at = frame.rows, frame.width, low, frame.trailing, row_after, done
        call_address(frame.scatter, (block, *at, state, work))
    if is_last and frame.growth != 0:
        scatter_growing(frame, low)


def scatter_growing(frame, low):
    """Copy the tangents that grow, of the members from `low` on, back to the block."""
    flat, lanes, members = block_memory(frame), frame.lanes, frame.width
    state = shifted(flat.state, (1 + frame.tangents) * frame.tangents_in_state * lanes)
    first = (frame.growth_row - layout.MEMBER_ROWS) * members + low
    for i in range(layout.START):
        for k in range(lanes):
            flat.block[first + i * members + k] = state[i * lanes + k]


inline_all(sys.modules[__name__])
