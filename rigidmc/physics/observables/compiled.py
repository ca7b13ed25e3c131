"""What compiled code calls of an observable: each function calls a method, or gives its default.

Like the methods of effects, these methods name the arguments that they depend on and receive no
others: body, effects, t, q, l, and for `value` also start and works. They are plain arithmetic, see
`rigidmc.physics.dynamics.methods`.
"""

from rigidmc.physics.dynamics.body_axes import described, described_attitude
from rigidmc.physics.dynamics.methods import OFF, method


@method
def value(observable, body, effects, t, q, l, start, works):
    """Return a tuple of values at time t.

    start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0
    works : work of each effect so far [J]
    """
    return (0.0,)


@method
def is_body_vector(observable):
    """Return ON if the values are the components of a vector along the axes of the body."""
    return OFF


@method
def is_attitude(observable):
    """Return ON if the values are an attitude of the body."""
    return OFF


def observed(of, body, effects, t, q, l, start, works):
    """Return the values of an observable in the axes in which the body is described."""
    values = value(of, body, effects, t, q, l, start, works)
    if len(is_body_vector(of)) > 0:
        return described(body, values)
    if len(is_attitude(of)) > 0:
        return described_attitude(body, values)
    return values


@method
def begin(running, body, effects, t, q, l):
    """Return the running state at the start: a tuple of floats."""
    return (0.0,)


@method
def update(running, state, body, effects, t, q, l):
    """Return the running state after a step that ended at t; state : before the step."""
    return state


@method
def extrema(observable, body, effects, t, q, l):
    """Return a tuple of the numbers whose extrema within a step count."""
    return ()


@method
def extremum_limits(observable, state):
    """Return (low, high) for each number of `extrema`.

    The running observable is updated at a minimum below `low` and at a maximum above `high`.
    """
    return ()


@method
def merged(observable, state, without, inserted):
    """Return a running state as if an extremum had been inserted in an earlier step.

    without, inserted : the states after that step, without the extremum and with it

    The searches in many steps are made together if all observables of a run with `extrema` have
    this method. The `extremum_limits` of a merged state must be those after an update in its step.
    """
    return state


@method
def monotone(observable, values):
    """Return smooth numbers, one for each value of an observable, that rise with it.

    Extremes of the values are found from these numbers.
    """
    return values


@method
def is_time_average(observable):
    """Return ON if a running observable is a mean over time.

    Means are also updated at equally spaced states within a step.
    """
    return OFF


@method
def reweighed(running, state, longer):
    """Return the running state if each step so far counts as `longer` future steps.

    The steps of a last interval may be shorter. Sums over steps are multiplied by `longer`, which
    weights them by time; by default the state is unchanged.
    """
    return state


@method
def is_conserved(observable):
    """Return ON if an observable is conserved.

    Its statistics use only the ends of steps: a state within a step has fewer digits.
    """
    return OFF


@method
def level(event, body, effects, t, q, l):
    """Return a number that passes through 0 when the event happens."""
    return 1.0


@method
def armed(event, body, q, l, level, armed):
    """Return whether the event may happen next; by default, whether its level is below 0.

    armed : whether it could have happened in the last step but did not
    """
    return level < 0.0


@method
def counts_at_start(event, level):
    """Return whether the event counts as happened at the start; by default, if level >= 0."""
    return level >= 0.0


@method
def dwell(event):
    """Return () if an event counts when its level passes through 0.

    (T,) if it counts only after the level has been above 0 for T seconds. A second number applies
    the rule within steps as well, by dense output.
    """
    return ()


@method
def is_terminal(event):
    """Return ON if the event stops the member; known when the event is compiled."""
    return OFF
