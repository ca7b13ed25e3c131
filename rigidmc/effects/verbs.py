"""What integrators and observables ask of a tuple of effects; the empty tuple costs nothing."""

from rigidmc.dynamics.methods import method, names
from rigidmc.dynamics.so3 import add, axpy, gain, scale, whole


@method
def torque(effect, body, t, q, l):
    """Body-frame torque of one effect [N m]."""
    return 0.0, 0.0, 0.0


@method
def energy(effect, body, q):
    """Potential energy of one effect [J]."""
    return 0.0


@method
def energy_scale(effect, body):
    """A bound on the |potential energy| of one effect [J], by plain arithmetic: arrays pass through it too."""
    return 0.0


@method
def kick(effect, body, t, h, q, l):
    """L after the flow of one effect alone over h; exact as it stands where the torque depends on q alone."""
    return axpy(l, h, torque(effect, body, t, q, l))


@method
def shake(effect, body, h, l):
    """L after the friction and noise of one effect over h."""
    return l


@method
def torque_rate(effect, body, t, q, w):
    """Rate of change of one effect's torque while the body turns with angular velocity w (body axes) and t stands still."""
    return 0.0, 0.0, 0.0


def depends_on_momentum(effect):
    """Whether an effect's torque depends on L, or comes as a flow of L of its own: a kick by it is then not L + h torque(q, t)."""
    return "l" in names(effect, "torque") or hasattr(effect, "kick")


def is_random(effect):
    """Whether an effect needs noise."""
    return getattr(effect, "stochastic", False)


def total_torque(effects, body, t, q, l):
    """Sum of the torques of all effects [N m]."""
    if len(effects) == 0:
        return 0.0, 0.0, 0.0
    if len(effects) == 1:
        return torque(effects[0], body, t, q, l)
    return add(torque(effects[0], body, t, q, l), total_torque(effects[1:], body, t, q, l))


def total_torque_rate(effects, body, t, q, w):
    """Sum of the rates of change of all torques."""
    if len(effects) == 0:
        return 0.0, 0.0, 0.0
    if len(effects) == 1:
        return torque_rate(effects[0], body, t, q, w)
    return add(torque_rate(effects[0], body, t, q, w), total_torque_rate(effects[1:], body, t, q, w))


def kicked(effects, body, t, h, q, l):
    """L after a kick over h by torques that depend on attitude and time; states may be pairs (value, remainder)."""
    if len(effects) == 0:
        return l
    return gain(l, scale(h, total_torque(effects, body, t, whole(q), whole(l))))


def push(effects, body, t, h, q, l, change):
    """change + h * (torque of all effects at t, q, L): no work at all where there is none."""
    if len(effects) == 0:
        return change
    return axpy(change, h, total_torque(effects, body, t, q, l))


def total_energy(effects, body, q):
    """Sum of the potential energies of all effects [J]."""
    if len(effects) == 0:
        return 0.0
    return energy(effects[0], body, q) + total_energy(effects[1:], body, q)


def total_energy_scale(effects, body):
    """Sum of the bounds on the potential energies of all effects [J]."""
    if len(effects) == 0:
        return 0.0
    return energy_scale(effects[0], body) + total_energy_scale(effects[1:], body)


def shake_all(effects, body, h, l):
    """L after the friction and noise of all effects."""
    if len(effects) == 0:
        return l
    return shake_all(effects[1:], body, h, shake(effects[0], body, h, l))


def chosen(effects, which):
    """Those of the effects for which the same place of `which` is not ()."""
    if len(effects) == 0:
        return ()
    return with_first(which[0], effects[0], chosen(effects[1:], which[1:]))


def with_first(mark, effect, others):
    """The others with an effect before them, unless its mark is ()."""
    if len(mark) == 0:
        return others
    return (effect,) + others


def kick_all(effects, body, t, h, q, l):
    """The effects' flows over h one after the other, first to last."""
    if len(effects) == 0:
        return l
    return kick_all(effects[1:], body, t, h, q, kick(effects[0], body, t, h, q, l))


def kick_all_back(effects, body, t, h, q, l):
    """The same, last to first: the mirror image that makes a composition symmetric."""
    if len(effects) == 0:
        return l
    return kick(effects[0], body, t, h, q, kick_all_back(effects[1:], body, t, h, q, l))
