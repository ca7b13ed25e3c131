"""Extrema of running observables, found after the steps of a trace.

Few members have an extremum that may count in a step, but one of the eight in a register often has,
and a search takes as long for one member as for all. So the loop over steps only notes the steps
that may need a search. Afterwards each search is for the next noted step of every member: for
twelve noted steps of eight members it makes three searches, not ten.

The result is the same as of a search in its step. What a search depends on, the running states
before the step, is kept in `kept`, without the extrema noted since the first step of the trace.
`merged` of an observable adds these. Observables with extrema but without `merged` are searched in
their step, and so are all if there are nodes within steps.

In this file `running` is as in `rigidmc.engine.kernel.monitoring`. The notes of a member are the
bits of one whole number, the last step in the lowest bit: TRACE of them fit in a float64.
"""

import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import picked_rows, put_rows
from rigidmc.engine.kernel.extrema import PARABOLA_DOUBT
from rigidmc.physics.dynamics.functions import as_float, as_word
from rigidmc.physics.dynamics.so3 import select, select_all
from rigidmc.physics.observables.protocol import extremum_limits, merged
from rigidmc.physics.observables.statistics import rest

_EXPONENT_BITS, _SHIFT = np.uint64(0x7FF0000000000000), np.uint64(52)
_WHOLE = np.uint64(0x4330000000000000)  # the exponent of 2^52: low bits count units
_BIAS = 4503599627370496.0 + 1023.0
DOUBT = 1.01 * PARABOLA_DOUBT  # 1 %: far more than rounding of the products


def note_step(deferred, notes, running, moves, totals, levels, before, now, kept, row):
    """Return the notes after one more step: whether a search in it may change a state.

    totals : the running states before the step, which are written to `kept` from `row` on
    before, now : the Nodes at its ends; `levels` has as many numbers as their first, the events'
    """
    if len(deferred) == 0:
        return notes
    keep_states(running, totals, kept, row)
    # `moves != moves` is False as a mask of this width.
    mark = may_change(
        moves != moves, running, totals, rest(levels, before.numbers), rest(levels, before.slopes),
        rest(levels, now.numbers), rest(levels, now.slopes),
    )  # fmt: skip
    return notes * 2.0 + select(mark & moves, 1.0, 0.0)


def may_change(mark, running, totals, values, slopes, next_values, next_slopes):
    """Return whether `mark`, or whether an extremum between two nodes may change a running state.

    No mark of `rigidmc.engine.kernel.extrema.running_extrema` is missed.
    """
    if len(values) == 0:
        return mark
    limits = extremum_limits(running[0][0], totals[0])
    mark = may_pass_limits(mark, limits, values, slopes, next_values, next_slopes)
    return may_change(
        mark, running[1:], totals[1:], rest(limits, values), rest(limits, slopes),
        rest(limits, next_values), rest(limits, next_slopes),
    )  # fmt: skip


def may_pass_limits(mark, limits, values, slopes, next_values, next_slopes):
    """Return whether `mark`, or whether an extremum of one observable may lie beyond a limit."""
    if len(limits) == 0:
        return mark
    # Both sides of the test in `may_dip`, for minima and maxima in one.
    bend = 2.0 * (next_slopes[0] - slopes[0])
    limit = select(bend > 0.0, limits[0][0], limits[0][1])
    first = bend * (values[0] - limit) - slopes[0] * slopes[0]
    second = bend * (next_values[0] - limit) - next_slopes[0] * next_slopes[0]
    near = min(first, second) < (0.5 * DOUBT) * bend * bend
    mark = mark | (near & (slopes[0] * next_slopes[0] <= 0.0))
    return may_pass_limits(
        mark, limits[1:], values[1:], slopes[1:], next_values[1:], next_slopes[1:]
    )


def first_note(notes):
    """Return the notes of each member reduced to its first; 0 if it has none."""
    return as_float(as_word(notes) & _EXPONENT_BITS)


def noted_step(note, steps):
    """Return the number of the step of one note among `steps` steps; 0 for no note."""
    place = as_float((as_word(note) >> _SHIFT) | _WHOLE) - _BIAS
    return select(note > 0.0, (steps - 1.0) - place, 0.0)


def keep_states(running, totals, kept, row):
    """Write the states of all running observables with extrema to `kept`; return the next row."""
    if len(running) == 0:
        return row
    row = keep_state(extremum_limits(running[0][0], totals[0]), totals[0], kept, row)
    return keep_states(running[1:], totals[1:], kept, row)


def keep_state(limits, total, kept, row):
    """Write the state of one observable, unless it has no extrema; return the next row."""
    if len(limits) == 0:
        return row
    return put_rows(total, kept, row)


def kept_rows(running, totals):
    """Return the number of rows that `keep_states` writes."""
    if len(running) == 0:
        return 0
    return kept_count(extremum_limits(running[0][0], totals[0]), totals[0]) + kept_rows(
        running[1:], totals[1:]
    )


def kept_count(limits, total):
    """Return the number of rows that `keep_state` writes."""
    if len(limits) == 0:
        return 0
    return len(total)


def kept_states(running, totals, kept, index, row):
    """Return the states that `keep_states` wrote to the rows from `index` of each member on.

    totals : the states of observables without extrema
    """
    if len(running) == 0:
        return ()
    limits = extremum_limits(running[0][0], totals[0])
    first = kept_state(limits, totals[0], kept, index, row)
    row += kept_count(limits, totals[0])
    return (first,) + kept_states(running[1:], totals[1:], kept, index, row)


def kept_state(limits, total, kept, index, row):
    """Return the state of one observable."""
    if len(limits) == 0:
        return total
    return picked_rows(total, kept, index, row)


def merge_states(running, where, totals, without, inserted):
    """Return later running states, with the extrema of an earlier step where there is one."""
    if len(running) == 0:
        return ()
    new = merged(running[0][0], totals[0], without[0], inserted[0])
    others = merge_states(running[1:], where, totals[1:], without[1:], inserted[1:])
    return (select_all(where, new, totals[0]),) + others


inline_all(sys.modules[__name__])
