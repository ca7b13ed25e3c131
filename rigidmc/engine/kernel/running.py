"""States of running observables, whose numbers are float64 rows of `work`, and noted extrema.

Few members have an extremum that may count in a step, but one of the eight in a register often has,
and a search takes as long for one member as for all. So the loop over steps only notes the steps
that may need a search. Afterwards each search is for the next noted step of every member: for
twelve noted steps of eight members it makes three searches, not ten.

The result is the same as of a search in its step. What a search depends on, the running states
before the step, is kept in `kept`, without the extrema noted since the first step of the trace.
`merged` of an observable adds these. Observables with extrema but without `merged` are searched in
their step, and so are all if there are nodes within steps.

In this file `running` and `totals` are as in `rigidmc.engine.kernel.monitoring`. The notes of a
member are the bits of one whole number, the last step in the lowest bit: TRACE of them fit in a
float64.
"""

import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import picked_rows, put_rows
from rigidmc.engine.compiler.trees import tree_unflatten
from rigidmc.engine.kernel.extrema import PARABOLA_DOUBT
from rigidmc.physics.dynamics.functions import as_float, as_word
from rigidmc.physics.dynamics.methods import OFF, ON
from rigidmc.physics.dynamics.so3 import first_three, select, select_all
from rigidmc.physics.effects.present import in_state
from rigidmc.physics.observables.compiled import (
    begin,
    extremum_limits,
    is_time_average,
    merged,
    update,
)
from rigidmc.physics.observables.statistics import rest

_EXPONENT_BITS, _SHIFT = np.uint64(0x7FF0000000000000), np.uint64(52)
_WHOLE = np.uint64(0x4330000000000000)  # the exponent of 2^52: low bits count units
_BIAS = 4503599627370496.0 + 1023.0
DOUBT = 1.01 * PARABOLA_DOUBT  # 1 %: far more than rounding of the products


def begin_running(running, body, effects, t, q, l, work, row):
    """Set the rows of running observables at the start."""
    if len(running) == 0:
        return 0
    put_rows(begin(running[0][0], body, effects, t, q, l), work, row)
    return begin_running(running[1:], body, effects, t, q, l, work, row + len(running[0][1]))


def states_at(running, work, row):
    """Return the states of running observables, from their rows."""
    if len(running) == 0:
        return ()
    first = tree_unflatten(running[0][1], work, row)
    return (first,) + states_at(running[1:], work, row + len(running[0][1]))


def put_states(totals, work, row):
    """Write the rows that `states_at` reads."""
    if len(totals) == 0:
        return row
    return put_states(totals[1:], work, put_rows(totals[0], work, row))


def update_states(running, moves, step, t, q, l, totals):
    """Return the states of running observables after a state, changed for members that move."""
    if len(running) == 0:
        return ()
    present = in_state(step.effects, l[3:])
    new = update(running[0][0], totals[0], step.body, present, t, q, first_three(l))
    others = update_states(running[1:], moves, step, t, q, l, totals[1:])
    return (select_all(moves, new, totals[0]),) + others


def update_averages(running, moves, step, t, q, l, totals):
    """Do the same as `update_states`, only for means over time."""
    if len(running) == 0:
        return ()
    others = update_averages(running[1:], moves, step, t, q, l, totals[1:])
    if len(is_time_average(running[0][0])) == 0:
        return totals[:1] + others
    return update_states(running[:1], moves, step, t, q, l, totals[:1]) + others


def any_averages(running):
    """Return ON if any running observable is a mean over time."""
    if len(running) == 0:
        return OFF
    if len(is_time_average(running[0][0])) == 0:
        return any_averages(running[1:])
    return ON


def note_step(deferred, notes, running, moves, totals, levels, before, now, kept, row):
    """Return the notes after one more step: whether a search in it may change a state.

    totals : the running states before the step, which are written to `kept` from `row` on
    before, now : the Nodes at its ends; `levels` has as many numbers as their first, the events'
    """
    if len(deferred) == 0:
        return notes
    keep_states(running, totals, kept, row)
    # `moves != moves` is False as a mask of this width.
    mark = may_change(moves != moves, running, totals, rest(levels, before), rest(levels, now))
    return notes * 2.0 + select(mark & moves, 1.0, 0.0)


def may_change(mark, running, totals, before, now):
    """Return whether `mark`, or whether an extremum between two nodes may change a running state.

    No mark of `rigidmc.engine.kernel.extrema.running_extrema` is missed.
    """
    if len(before) == 0:
        return mark
    limits = extremum_limits(running[0][0], totals[0])
    mark = may_pass_limits(mark, limits, before, now)
    return may_change(mark, running[1:], totals[1:], rest(limits, before), rest(limits, now))


def may_pass_limits(mark, limits, before, now):
    """Return whether `mark`, or whether an extremum of one observable may lie beyond a limit."""
    if len(limits) == 0:
        return mark
    # Both sides of the test in `may_dip`, for minima and maxima in one.
    (value, slope), (next_value, next_slope) = before[0], now[0]
    bend = 2.0 * (next_slope - slope)
    limit = select(bend > 0.0, limits[0][0], limits[0][1])
    first = bend * (value - limit) - slope * slope
    second = bend * (next_value - limit) - next_slope * next_slope
    near = min(first, second) < (0.5 * DOUBT) * bend * bend
    mark = mark | (near & (slope * next_slope <= 0.0))
    return may_pass_limits(mark, limits[1:], before[1:], now[1:])


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
    if len(extremum_limits(running[0][0], totals[0])) == 0:
        return keep_states(running[1:], totals[1:], kept, row)
    return keep_states(running[1:], totals[1:], kept, put_rows(totals[0], kept, row))


def kept_rows(running, totals):
    """Return the number of rows that `keep_states` writes."""
    if len(running) == 0:
        return 0
    if len(extremum_limits(running[0][0], totals[0])) == 0:
        return kept_rows(running[1:], totals[1:])
    return len(totals[0]) + kept_rows(running[1:], totals[1:])


def kept_states(running, totals, kept, index, row):
    """Return the states that `keep_states` wrote to the rows from `index` of each member on.

    totals : the states of observables without extrema
    """
    if len(running) == 0:
        return ()
    if len(extremum_limits(running[0][0], totals[0])) == 0:
        return totals[:1] + kept_states(running[1:], totals[1:], kept, index, row)
    first, later = picked_rows(totals[0], kept, index, row), row + len(totals[0])
    return (first,) + kept_states(running[1:], totals[1:], kept, index, later)


def merge_states(running, where, totals, without, inserted):
    """Return later running states, with the extrema of an earlier step where there is one."""
    if len(running) == 0:
        return ()
    new = merged(running[0][0], totals[0], without[0], inserted[0])
    others = merge_states(running[1:], where, totals[1:], without[1:], inserted[1:])
    return (select_all(where, new, totals[0]),) + others


inline_all(sys.modules[__name__])
