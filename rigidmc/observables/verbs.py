"""The one thing a kernel asks of an observable."""

from rigidmc.dynamics.methods import method


@method
def value(observable, body, effects, t, q, l, start, works):
    """Tuple of values at time t; start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0, works those of the effects so far."""
    return (0.0,)
