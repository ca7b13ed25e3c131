"""Sums over all effects of a scene, and the work of each.

The functions recurse over the tuple of effects, so only the effects of a scene are compiled; the
empty tuple costs nothing.

Effects with a state append its numbers to the three components of L, one effect after the other; a
run that saves `work` appends one number per effect after them: the energy that the effect has given
to the body. So l is (x, y, z), `states` and `works`, and whatever evaluates effects first puts the
states into them (`in_state`). `untracked` has one flag per effect, ON if the effect has no
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
    left_after,
    rest_axpy,
    scale,
    scale_rest,
    spin,
    taken,
    value_of,
)
from rigidmc.physics.effects.present import in_state, states_of
from rigidmc.physics.effects.protocol import (
    add_noise,
    add_torque,
    energy,
    energy_scale,
    kick,
    noise_score,
    slip,
    state_rate,
    torque,
    torque_rate,
)


def state_rates_of(effects, body, t, q, l):
    """Return the rates of change of the states of all effects; these are in the effects."""
    if len(effects) == 0:
        return ()
    first = state_rate(effects[0], body, t, q, l)
    return concat(first, state_rates_of(effects[1:], body, t, q, l))


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
        return push_states(effects, states_of(effects), body, t, h, q, l, change)
    return add_torques(effects, body, t, q, l, (h, h, h), change)


def push_states(effects, states, body, t, h, q, l, change):
    """Return the same, followed by the changes of the states and works; without numbers after the
    three of `change` these changes begin with 0."""
    at, present, more = first_three(l), in_state(effects, l[3:]), change[3:]
    pushed = add_torques(present, body, t, q, at, (h, h, h), first_three(change))
    moved = rest_axpy(taken(states, more), h, state_rates_of(present, body, t, q, at))
    saved, works = left_after(states, l[3:]), left_after(states, more)
    return concat(concat(pushed, moved), push_works(saved, present, body, t, h, q, at, works))


def push_works(saved, effects, body, t, h, q, l, works):
    """Return the works of the effects plus h times their power; () if none are saved."""
    if len(saved) == 0:
        return ()
    w = add_slip(effects, body, t, 2.0, q, l, angular_velocity(body, l))
    done = add_work(effects, body, t, h, q, l, w, works)
    return pay_for_slip(effects, effects, body, t, h, q, l, done)


def state_rates(rates, effects, body, t, h, q, l):
    """Return (h dq/dt, h dL/dt) in a state; rates : Rates of the body over h."""
    half = add_slip(in_state(effects, l[3:]), body, t, h, q, l, half_rotation(rates, l))
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
        works = left_after(states_of(effects), l[3:])
        return joined(kick_each(effects, body, t, h, q, first_three(l), l[3:], works))
    return kick_all(effects[1:], body, t, h, q, kick(effects[0], body, t, h, q, l))


def kick_each(effects, body, t, h, q, l, states, works):
    """Return (L, states, works) after `kick_all`; works : () if none are saved."""
    if len(effects) == 0:
        return l, (), ()
    mine = states_of(effects[:1])
    after, state, work = kick_one(effects[:1], mine, body, t, h, q, l, states, works)
    others = left_after(mine, states), works[1:]
    end, later, done = kick_each(effects[1:], body, t, h, q, after, others[0], others[1])
    return end, concat(state, later), concat(work, done)


def joined(parts):
    """Return one tuple of L, states and works."""
    return concat(concat(parts[0], parts[1]), parts[2])


def kick_all_back(effects, body, t, h, q, l):
    """Mirror `kick_all`, last effect to first, which makes a composition symmetric."""
    if len(effects) == 0:
        return l
    if len(l) > 3:
        works = left_after(states_of(effects), l[3:])
        return joined(kick_each_back(effects, body, t, h, q, first_three(l), l[3:], works))
    return kick(effects[0], body, t, h, q, kick_all_back(effects[1:], body, t, h, q, l))


def kick_each_back(effects, body, t, h, q, l, states, works):
    """Return (L, states, works) after `kick_all_back`; works : () if none are saved."""
    if len(effects) == 0:
        return l, (), ()
    mine = states_of(effects[:1])
    others = left_after(mine, states), works[1:]
    middle, later, done = kick_each_back(effects[1:], body, t, h, q, l, others[0], others[1])
    end, state, work = kick_one(effects[:1], mine, body, t, h, q, middle, states, works)
    return end, concat(state, later), concat(work, done)


def kick_one(one, mine, body, t, h, q, l, states, works):
    """Return (L, state, work) after the flow of an effect, whose state and work come first.

    one : a tuple of the effect;  mine : states_of(one)
    """
    before = taken(mine, states)
    after, state = kick_with_state(one, before, body, t, h, q, l)
    midway = in_state(one, rest_axpy(scale_rest(0.5, state), 0.5, before))
    return after, state, flow_work(midway[0], body, t, h, q, l, after, works)


def kick_with_state(one, state, body, t, h, q, l):
    """Return (L, state) after the flow of an effect over h at a fixed attitude.

    The kick of an effect may return its state after L. Otherwise the state moves by half a step,
    L by the torque there, and the state by the other half: order 2, exact if the rate depends on
    nothing that moves.
    """
    if len(state) == 0:
        return kick(one[0], body, t, h, q, l), ()
    present = in_state(one, state)
    return after_kick(one, kick(present[0], body, t, h, q, l), body, t, h, q, l, state)


def after_kick(one, kicked, body, t, h, q, l, state):
    """Return (L, state); kicked : by the effect in this state."""
    if len(kicked) > 3:
        return first_three(kicked), kicked[3:]
    middle = half_way(one, body, t, 0.5 * h, q, l, state)
    present = in_state(one, middle)
    after = kick(present[0], body, t, h, q, l)
    return after, half_way(one, body, t + 0.5 * h, 0.5 * h, q, after, middle)


def half_way(one, body, t, h, q, l, state):
    """Return the state of an effect after h at fixed q and L, by the midpoint rule."""
    first = state_rates_of(in_state(one, state), body, t, q, l)
    middle = in_state(one, rest_axpy(state, 0.5 * h, first))
    return rest_axpy(state, h, state_rates_of(middle, body, t + 0.5 * h, q, l))


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


def flow_work(effect, body, t, h, q, before, after, works):
    """Return the first of the works after the flow of its effect over h; () if none are saved.

    before, after : L

    It uses the torque midway between the two: order 2.
    """
    if len(works) == 0:
        return ()
    middle = scale(0.5, add(before, after))
    done = h * dot(torque(effect, body, t, q, middle), angular_velocity(body, middle))
    return (works[0] + done,)


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
