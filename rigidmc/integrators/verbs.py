"""The one thing a kernel asks of an integrator."""

from rigidmc.dynamics.methods import method


@method
def step(integrator, body, effects, t, h, q, l):
    """(q, L) after one step h from time t."""
    return q, l
