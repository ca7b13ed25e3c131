"""Sums over all effects of a scene, and the work of each.

The functions recurse over the tuple of effects, so only the effects of a scene are compiled; the
empty tuple costs nothing.

A run that saves `work` appends one number per effect to the three components of L: the energy that
the effect has given to the body. So l is (x, y, z), or these followed by the works. In this file
`works` are these numbers, and `untracked` has one flag per effect, ON if the effect has no
potential energy that accounts for its work.
"""

from rigidmc.physics.dynamics.euler import add_free_change, angular_velocity, half_rotation
from rigidmc.physics.dynamics.methods import OFF, ON
from rigidmc.physics.dynamics.so3 import (
    add,
    add_compensated,
    axpy,
    concat,
    difference,
    dot,
    first_three,
    scale,
    spin,
    value_of,
)
from rigidmc.physics.effects.protocol import (
    add_noise,
    add_torque,
    energy,
    energy_scale,
    kick,
    noise_score,
    slip,
    torque,
    torque_rate,
)


def total_torque(effects, body, t, q, l):
    """Return the sum of the torques [N m]."""
    if len(effects) == 0:
        return 0.0, 0.0, 0.0
    if len(effects) == 1:
        return torque(effects[0], body, t, q, l)
    # One effect alone is not added to 0: -0.0 + 0.0 is 0.0, so the compiler keeps the addition.
    return add(torque(effects[0], body, t, q, l), total_torque(effects[1:], body, t, q, l))


def total_torque_rate(effects, body, t, q, w):
    """Return the sum of the rates of change of the torques."""
    if len(effects) == 0:
        return 0.0, 0.0, 0.0
    if len(effects) == 1:
        return torque_rate(effects[0], body, t, q, w)
    return add(
        torque_rate(effects[0], body, t, q, w), total_torque_rate(effects[1:], body, t, q, w)
    )


def total_energy(effects, body, q):
    """Return the sum of the potential energies [J]."""
    if len(effects) == 0:
        return 0.0
    return energy(effects[0], body, q) + total_energy(effects[1:], body, q)


def total_energy_scale(effects, body):
    """Return the sum of the bounds on the potential energies [J]."""
    if len(effects) == 0:
        return 0.0
    return energy_scale(effects[0], body) + total_energy_scale(effects[1:], body)


def add_torques(effects, body, t, q, l, by, onto):
    """Return onto + by * (sum of the torques), component by component."""
    if len(effects) == 0:
        return onto
    return add_torques(
        effects[1:], body, t, q, l, by, add_torque(effects[0], body, t, q, l, by, onto)
    )


def push(effects, body, t, h, q, l, change):
    """Return change + h * (sum of the torques at t, q, L)."""
    if len(effects) == 0:
        return change
    if len(l) > 3:
        at = first_three(l)
        pushed = add_torques(effects, body, t, q, at, (h, h, h), first_three(change))
        w = add_slip(effects, body, t, 2.0, q, at, angular_velocity(body, at))
        works = add_work(effects, body, t, h, q, at, w, change[3:])
        return pushed + pay_for_slip(effects, effects, body, t, h, q, at, works)
    return add_torques(effects, body, t, q, l, (h, h, h), change)


def state_rates(rates, effects, body, t, h, q, l):
    """Return (h dq/dt, h dL/dt) in a state; rates : Rates of the body over h."""
    half = add_slip(effects, body, t, h, q, l, half_rotation(rates, l))
    return spin(q, half), push(
        effects, body, t, h, q, l, add_free_change(rates, (0.0, 0.0, 0.0), l)
    )


def pay_for_slip(effects, all_effects, body, t, h, q, l, works):
    """Subtract from the works of effects with `slip` the work of all torques along that slip.

    1/2 L . I^-1 L does not receive that work.
    """
    if len(effects) == 0:
        return ()
    others = pay_for_slip(effects[1:], all_effects, body, t, h, q, l, works[1:])
    rate = slip(effects[0], body, t, q, l)
    if len(rate) == 0:
        return works[:1] + others
    return (works[0] - h * dot(total_torque(all_effects, body, t, q, l), rate),) + others


def add_slip(effects, body, t, h, q, l, half):
    """Return half the rotation vector over a time h, with the `slip` of effects added."""
    if len(effects) == 0:
        return half
    rate = slip(effects[0], body, t, q, first_three(l))
    if len(rate) == 0:
        return add_slip(effects[1:], body, t, h, q, l, half)
    return add_slip(effects[1:], body, t, h, q, l, axpy(half, 0.5 * h, rate))


def kick_by_torques(effects, body, t, h, q, l):
    """Return L after a kick over h by torques that depend on attitude and time.

    q, l : values, or pairs (value, remainder)
    """
    if len(effects) == 0:
        return l
    if len(l) > 3:  # the works also by their exact flow, which is linear in L
        before = first_three(l)
        after = add_torques(effects, body, t, value_of(q), before, (h, h, h), before)
        # midway: T is quadratic and L changes evenly, so the works add up to the change of T
        w = angular_velocity(body, scale(0.5, add(before, after)))
        return after + add_work(effects, body, t, h, q, before, w, l[3:])
    if len(l) == 2:
        return add_compensated(l, scale(h, total_torque(effects, body, t, value_of(q), l[0])))
    return add_torques(effects, body, t, value_of(q), l, (h, h, h), l)


def kick_all(effects, body, t, h, q, l):
    """Return L after the flows of the effects over h, one after the other, first to last."""
    if len(effects) == 0:
        return l
    if len(l) > 3:
        before = first_three(l)
        after = kick(effects[0], body, t, h, q, before)
        rest = kick_all(effects[1:], body, t, h, q, concat(after, l[4:]))
        work = add_flow_work(effects[0], body, t, h, q, before, after, l[3])
        return first_three(rest) + (work,) + rest[3:]
    return kick_all(effects[1:], body, t, h, q, kick(effects[0], body, t, h, q, l))


def kick_all_back(effects, body, t, h, q, l):
    """Mirror `kick_all`, last effect to first, which makes a composition symmetric."""
    if len(effects) == 0:
        return l
    if len(l) > 3:
        rest = kick_all_back(effects[1:], body, t, h, q, concat(first_three(l), l[4:]))
        before = first_three(rest)
        after = kick(effects[0], body, t, h, q, before)
        return after + (add_flow_work(effects[0], body, t, h, q, before, after, l[3]),) + rest[3:]
    return kick(effects[0], body, t, h, q, kick_all_back(effects[1:], body, t, h, q, l))


def shake_all(effects, body, h, l):
    """Return L after the friction and noise of all effects over h."""
    if len(effects) == 0:
        return l
    if len(l) > 3:  # the work of one effect is its change of the kinetic energy
        before = first_three(l)
        after = add_noise(effects[0], body, h, before)
        middle = scale(0.5, add(before, after))
        # exact for any L: T is quadratic
        done = dot(angular_velocity(body, middle), difference(after, before))
        rest = shake_all(effects[1:], body, h, concat(after, l[4:]))
        return first_three(rest) + (l[3] + done,) + rest[3:]
    return shake_all(effects[1:], body, h, add_noise(effects[0], body, h, l))


def shake_scored(effects, body, h, l, scores):
    """Return (L, scores) after `shake_all`, with the score of the noise added to `scores`.

    scores : at least as many numbers as the random effect, of which there is one, has parameters
    """
    if len(effects) == 0:
        return l, scores
    scores = add_first(noise_score(effects[0], body, h, l), scores)
    return shake_scored(effects[1:], body, h, add_noise(effects[0], body, h, l), scores)


def add_first(new, sums):
    """Return the sums with each of the new numbers added to the sum in its place."""
    if len(new) == 0:
        return sums
    return (sums[0] + new[0],) + add_first(new[1:], sums[1:])


def add_work(effects, body, t, h, q, l, w, works):
    """Return the work of each effect plus h torque(t, q, L) . w; works = () means all 0."""
    if len(effects) == 0:
        return ()
    done = h * dot(torque(effects[0], body, t, q, l), w)
    if len(works) == 0:
        return (done,) + add_work(effects[1:], body, t, h, q, l, w, works)
    return (works[0] + done,) + add_work(effects[1:], body, t, h, q, l, w, works[1:])


def add_flow_work(effect, body, t, h, q, before, after, work):
    """Return the work of one effect after its flow over h, which takes L from `before` to `after`.

    It uses the torque midway between the two: order 2.
    """
    middle = scale(0.5, add(before, after))
    return work + h * dot(torque(effect, body, t, q, middle), angular_velocity(body, middle))


def corrected_by_work(start, untracked, works):
    """Correct the start's (E, 1/scale of E, ...) by the works done since.

    E grows by the work of the effects without an energy; the scale grows by the sum of all |work|.
    """
    if len(works) == 0:
        return start
    return (
        start[0] + untracked_work(untracked, works),
        # 1/(scale + |work|) from 1/scale, so that 0, no scale, stays 0
        start[1] / (1.0 + start[1] * total_abs_work(works)),
    ) + start[2:]


def has_untracked(untracked):
    """Return ON if an effect has no potential energy, else OFF."""
    if len(untracked) == 0:
        return OFF
    if len(untracked[0]) == 0:
        return has_untracked(untracked[1:])
    return ON


def untracked_work(untracked, works):
    """Return the sum of the works of the effects without a potential energy."""
    if len(works) == 0:
        return 0.0
    if len(untracked[0]) == 0:
        return untracked_work(untracked[1:], works[1:])
    return works[0] + untracked_work(untracked[1:], works[1:])


def total_abs_work(works):
    """Return the sum of all |work|."""
    if len(works) == 0:
        return 0.0
    return abs(works[0]) + total_abs_work(works[1:])
