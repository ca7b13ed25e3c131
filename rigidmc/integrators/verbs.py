"""What a kernel asks of an integrator."""

from rigidmc.dynamics.methods import method


@method
def step(integrator, body, effects, t, h, part, q, l):
    """(q, L) after one part of a step h; t is the time of the part's torque, part = (drift, kick, gradient) its times [s, s, s^2]."""
    return q, l


@method
def opened(integrator, body, effects, t, part, q, l):
    """The state (q, L) as it is kept between steps, where that is another: `part` further on."""
    return q, l


@method
def closed(integrator, body, effects, t, part, q, l):
    """(q, L) from the state kept between steps; undoes `opened`."""
    return q, l
