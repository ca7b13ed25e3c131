"""What a kernel asks of an integrator."""

from rigidmc.dynamics.methods import method


@method
def keeps(integrator):
    """What an integrator keeps in the state after L, without remainders of sums: as many 0.0, seven or none."""
    return ()


@method
def constants(integrator, body, part, l):
    """What is the same in all steps of a member, l with what the integrator keeps: made once before many of them."""
    return ()


@method
def step(integrator, body, effects, t, h, part, q, l, constants):
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
