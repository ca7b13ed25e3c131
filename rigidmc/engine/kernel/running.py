"""The states of running observables, whose numbers are float64 rows of `work`.

In this file `running` are pairs (observable, `static_count` of the numbers of its state), and
`totals` the states of all running observables.
"""

import sys

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.memory import put_rows
from rigidmc.engine.compiler.trees import tree_unflatten
from rigidmc.physics.dynamics.methods import OFF
from rigidmc.physics.dynamics.so3 import select_all
from rigidmc.physics.effects.sums import either
from rigidmc.physics.observables.protocol import begin, is_time_average, update


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
    new = update(running[0][0], totals[0], step.body, step.effects, t, q, l)
    rest = update_states(running[1:], moves, step, t, q, l, totals[1:])
    return (select_all(moves, new, totals[0]),) + rest


def update_averages(running, moves, step, t, q, l, totals):
    """Do the same as `update_states`, only for means over time."""
    if len(running) == 0:
        return ()
    first = update_average(
        is_time_average(running[0][0]), running[0][0], moves, step, t, q, l, totals[0]
    )
    return (first,) + update_averages(running[1:], moves, step, t, q, l, totals[1:])


def update_average(averages, observable, moves, step, t, q, l, totals):
    """Return the state of one running observable, updated if it is a mean."""
    if len(averages) == 0:
        return totals
    return select_all(moves, update(observable, totals, step.body, step.effects, t, q, l), totals)


def any_averages(running):
    """Return ON if any running observable is a mean over time."""
    if len(running) == 0:
        return OFF
    return either(is_time_average(running[0][0]), any_averages(running[1:]))


inline_all(sys.modules[__name__])
