"""What integrators and observables ask of a tuple of effects; the empty tuple costs nothing."""

from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.dynamics.methods import method, names
from rigidmc.dynamics.so3 import add, axpy, difference, dot, first_three, gain, joined, scale, whole


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
def impel(effect, body, t, q, l, by, onto):
    """onto + by * torque of one effect, component by component: what stays from step to step may be multiplied first, and once."""
    x, y, z = torque(effect, body, t, q, l)
    return onto[0] + by[0] * x, onto[1] + by[1] * y, onto[2] + by[2] * z


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


def impelled(effects, body, t, q, l, by, onto):
    """onto + by * the torques of all effects, component by component."""
    if len(effects) == 0:
        return onto
    return impelled(effects[1:], body, t, q, l, by, impel(effects[0], body, t, q, l, by, onto))


def total_torque_rate(effects, body, t, q, w):
    """Sum of the rates of change of all torques."""
    if len(effects) == 0:
        return 0.0, 0.0, 0.0
    if len(effects) == 1:
        return torque_rate(effects[0], body, t, q, w)
    return add(
        torque_rate(effects[0], body, t, q, w), total_torque_rate(effects[1:], body, t, q, w)
    )


def kicked(effects, body, t, h, q, l):
    """L after a kick over h by torques that depend on attitude and time; states may be pairs (value, remainder)."""
    if len(effects) == 0:
        return l
    if len(l) > 3:  # the exact flow of the works too, linear in L
        before = first_three(l)
        after = impelled(effects, body, t, whole(q), before, (h, h, h), before)
        w = angular_velocity(body, scale(0.5, add(before, after)))
        return after + worked(effects, body, t, h, q, before, w, l[3:])
    if len(l) == 2:
        return gain(l, scale(h, total_torque(effects, body, t, whole(q), l[0])))
    return impelled(effects, body, t, whole(q), l, (h, h, h), l)


def push(effects, body, t, h, q, l, change):
    """change + h * (torque of all effects at t, q, L): no work at all where there is none."""
    if len(effects) == 0:
        return change
    if len(l) > 3:
        at = first_three(l)
        pushed = impelled(effects, body, t, q, at, (h, h, h), first_three(change))
        return pushed + worked(effects, body, t, h, q, at, angular_velocity(body, at), change[3:])
    return impelled(effects, body, t, q, l, (h, h, h), change)


def worked(effects, body, t, h, q, l, w, works):
    """The work that each effect has done, (), or 0 so far, and h torque(t, q, L) . w more."""
    if len(effects) == 0:
        return ()
    done = h * dot(torque(effects[0], body, t, q, l), w)
    if len(works) == 0:
        return (done,) + worked(effects[1:], body, t, h, q, l, w, works)
    return (works[0] + done,) + worked(effects[1:], body, t, h, q, l, w, works[1:])


def worked_along(effect, body, t, h, q, before, after, work):
    """The work of one effect whose flow over h brings L from `before` to `after`: by its torque in the middle, order 2."""
    middle = scale(0.5, add(before, after))
    return work + h * dot(torque(effect, body, t, q, middle), angular_velocity(body, middle))


def booked(start, ledger, works):
    """(E, 1/scale of E, ...) of a start after works: E with what effects without an energy have done (`ledger` is () for those that have one), and
    the scale with the sum of the works' sizes."""
    if len(works) == 0:
        return start
    return (start[0] + spent(ledger, works), start[1] / (1.0 + start[1] * gross(works))) + start[2:]


def spent(ledger, works):
    """The sum of the works whose place in `ledger` is not ()."""
    if len(works) == 0:
        return 0.0
    return spent_first(ledger[0], works[0], spent(ledger[1:], works[1:]))


def spent_first(mark, work, others):
    """The others, and a work unless its mark is ()."""
    if len(mark) == 0:
        return others
    return work + others


def gross(works):
    """The sum of the sizes of works."""
    if len(works) == 0:
        return 0.0
    return abs(works[0]) + gross(works[1:])


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
    if len(l) > 3:  # their work is what they change of the kinetic energy
        before = first_three(l)
        after = shake(effects[0], body, h, before)
        done = dot(
            angular_velocity(body, scale(0.5, add(before, after))), difference(after, before)
        )
        made = shake_all(effects[1:], body, h, joined(after, l[4:]))
        return first_three(made) + (l[3] + done,) + made[3:]
    return shake_all(effects[1:], body, h, shake(effects[0], body, h, l))


def chosen(effects, which):
    """The effects, those idle for which the same place of `which` is ()."""
    if len(effects) == 0:
        return ()
    return (idle_unless(which[0], effects[0]),) + chosen(effects[1:], which[1:])


class Idle(NamedTuple):
    """In the place of an effect that does nothing here."""

    def kick(self, l):
        return l


def idle_unless(mark, effect):
    """An effect, or Idle where the mark is ()."""
    if len(mark) == 0:
        return Idle()
    return effect


def kick_all(effects, body, t, h, q, l):
    """The effects' flows over h one after the other, first to last."""
    if len(effects) == 0:
        return l
    if len(l) > 3:
        before = first_three(l)
        after = kick(effects[0], body, t, h, q, before)
        made = kick_all(effects[1:], body, t, h, q, joined(after, l[4:]))
        return (
            first_three(made)
            + (worked_along(effects[0], body, t, h, q, before, after, l[3]),)
            + made[3:]
        )
    return kick_all(effects[1:], body, t, h, q, kick(effects[0], body, t, h, q, l))


def kick_all_back(effects, body, t, h, q, l):
    """The same, last to first: the mirror image that makes a composition symmetric."""
    if len(effects) == 0:
        return l
    if len(l) > 3:
        made = kick_all_back(effects[1:], body, t, h, q, joined(first_three(l), l[4:]))
        before = first_three(made)
        after = kick(effects[0], body, t, h, q, before)
        return after + (worked_along(effects[0], body, t, h, q, before, after, l[3]),) + made[3:]
    return kick(effects[0], body, t, h, q, kick_all_back(effects[1:], body, t, h, q, l))
