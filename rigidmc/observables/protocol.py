"""What a kernel asks of an observable."""

from rigidmc.dynamics.methods import method


@method
def value(observable, body, effects, t, q, l, start, works):
    """Tuple of values at time t; start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0, works those of the effects so far."""
    return (0.0,)


@method
def begin(running, body, effects, t, q, l):
    """What a running observable keeps, at the start: a tuple of floats."""
    return (0.0,)


@method
def update(running, kept, body, effects, t, q, l):
    """What it keeps after a step that ended at t."""
    return kept


@method
def level(event, body, effects, t, q, l):
    """A number that passes 0 when the event happens."""
    return 1.0


@method
def armed(event, body, q, l, level, armed):
    """Whether the event may happen next, where it might before and did not: by default below 0."""
    return level < 0.0


@method
def past(event, level):
    """Whether what the event leads to is so at the start already: by default where the level is not below 0."""
    return level >= 0.0
