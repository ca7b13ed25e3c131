"""One loop over EFFECTS: torque against energy and an independent formula in space, kick against a
fine integration, facts.

A new effect is tested by its class attribute `example` and by what it has. It needs no edit here; a
second formula of its torque can go to tests/physics/effects/laws.py.
"""

import itertools
import math
import re
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.inspection import why_scalar
from rigidmc.engine.machine import is_uncompiled
from rigidmc.physics.dynamics.euler import MassProperties, angular_velocity
from rigidmc.physics.dynamics.methods import argument_names, implements
from rigidmc.physics.dynamics.so3 import cross, dot, exponential, multiply, vertical
from rigidmc.physics.effects import (  # fmt: skip
    EFFECTS,
    Gravity,
    MatrixDamping,
    Rotor,
    Spring,
    ViscousDamping,
    canonical,
    label_effects,
    name_of,
)
from rigidmc.physics.effects import protocol as P
from rigidmc.physics.effects.sums import kick_all, kick_all_back, push, total_energy, total_torque
from tests.physics.effects.laws import ENERGY, REFERENCE, Properties, symmetric
from tests.tools.reference import apart, rotation, unit

MOMENTS, STATIC = (0.6, 0.8, 1.0), (0.05, -0.02, 0.3)
BODY, KNOWN = MassProperties.of(MOMENTS, STATIC), Properties(np.diag(MOMENTS), 1.0, STATIC)
EXAMPLES = {  # random ones: test_bath.py
    name: kind(*kind.example) for name, kind in EFFECTS.items() if not P.is_random(kind)
}
EVERY = pytest.mark.parametrize("name", EXAMPLES)
WITH_ENERGY = pytest.mark.parametrize(
    "effect", [pytest.param(e, id=n) for n, e in EXAMPLES.items() if implements(e, "energy")]
)


def some_states(count=50):
    some = np.random.default_rng(1)
    return [(unit(some.normal(size=4)), tuple(some.normal(size=3))) for _ in range(count)]


def reference_error(effect, name):
    """Largest |torque - that of the law in space|."""
    worst = 0.0
    for i, (q, l) in enumerate(some_states()):
        a, t = np.array(rotation(q)), 0.3 * i
        w = a @ (np.array(l) / MOMENTS)
        error = a @ P.torque(effect, BODY, t, q, l) - REFERENCE[name](effect, t, a, w, KNOWN)
        worst = max(worst, np.abs(error).max())
    return worst


def along(q, axis, step):
    """An attitude turned by a small angle about an axis of the body, there and back."""
    return (multiply(q, exponential([s * step * x for x in axis])) for s in (1.0, -1.0))


def gradient_error(effect, step=1e-5):
    """Largest |torque + dE/d(rotation)|, by central differences along the body axes."""
    worst = 0.0
    for (q, l), axis in itertools.product(some_states(), range(3)):
        ahead, behind = (P.energy(effect, BODY, x) for x in along(q, np.eye(3)[axis], step))
        slope = (ahead - behind) / (2.0 * step)
        worst = max(worst, abs(P.torque(effect, BODY, 0.0, q, l)[axis] + slope))
    return worst


def kick_error(effect, h=0.7, steps=600, parts=1):
    """Largest |kicks - fine Runge-Kutta of dL/dt = torque at fixed attitude and time|."""
    worst = 0.0
    for q, start in some_states(10):
        l, d = np.array(start), h / steps

        def rate(l, q=q):
            return np.array(P.torque(effect, BODY, 0.0, q, tuple(l)))

        for _ in range(steps):
            k1 = rate(l)
            k2 = rate(l + d / 2 * k1)
            k3 = rate(l + d / 2 * k2)
            l = l + d / 6 * (k1 + 2 * k2 + 2 * k3 + rate(l + d * k3))
        made = start
        for _ in range(parts):
            made = P.kick(effect, BODY, 0.0, h / parts, q, made)
        worst = max(worst, np.abs(l - made).max())
    return worst


def test_every_effect_has_an_example_of_all_its_parameters():
    for kind in EFFECTS.values():
        assert len(kind.example) == len(P.user_parameters(kind))
    assert REFERENCE.keys() <= EXAMPLES.keys()


@pytest.mark.parametrize("name", REFERENCE)
def test_torque_and_energy_are_those_of_the_law_in_space(name):
    effect = EXAMPLES[name]
    assert reference_error(effect, name) < 5e-14  # measured 1.2e-14
    for q, _ in some_states() if name in ENERGY else ():
        known = ENERGY[name](effect, rotation(q), KNOWN)
        assert P.energy(effect, BODY, q) == pytest.approx(known, abs=1e-14)


@pytest.mark.parametrize("name", EFFECTS)
def test_all_methods_compile_for_members_side_by_side(name):
    """What runs in Python may be unknown to the compiler, such as a generator expression."""
    if not is_uncompiled():
        assert why_scalar(EFFECTS[name](*EFFECTS[name].example)) == ""


@EVERY
def test_each_number_of_an_effect_changes_its_torque(name):
    effect, values = EXAMPLES[name], [value for _, _, value in P.numbers(EXAMPLES[name])]
    fields = [field for field, _, _ in P.numbers(effect)]
    for i, value in enumerate(values):
        if fields[i].startswith("max_"):  # of a wheel that is not saturated
            continue
        other = P.from_numbers(EFFECTS[name], [*values[:i], value * 1.01 or 0.01, *values[i + 1 :]])
        one, two = (
            [P.torque(e, BODY, 0.3 * k, q, l) for k, (q, l) in enumerate(some_states())]
            for e in (effect, other)
        )
        assert apart(one, two) > 1e-5


@WITH_ENERGY
def test_torque_is_minus_the_gradient_of_energy(effect):
    assert gradient_error(effect) < 1e-9  # measured 1.6e-10: differences of 1e-5


@EVERY
def test_damping_takes_energy(name):
    if P.facts(EXAMPLES[name]).is_damping:
        for q, l in some_states():
            push = P.torque(EXAMPLES[name], BODY, 0.0, q, l)
            assert dot(push, angular_velocity(BODY, l)) < 0.0


@EVERY
def test_torque_rate_is_the_rate_of_the_torque_as_the_body_turns(name):
    if not implements(EFFECTS[name], "torque_rate"):
        return
    effect, h = EXAMPLES[name], 1e-5
    for q, w in some_states():
        ahead, behind = (P.torque(effect, BODY, 0.4, x, w) for x in along(q, w, h))
        slope = np.subtract(ahead, behind) / (2.0 * h)
        assert apart(slope, P.torque_rate(effect, BODY, 0.4, q, w)) < 4e-8  # measured 4.2e-9


def alone(effect):
    """Yield {a vector: the same with one component left} for each component of an effect."""
    for field, values in effect._asdict().items():
        for i in range(len(values) if isinstance(values, tuple) else 0):
            yield {field: tuple(v * (i == j) for j, v in enumerate(values))}


def assert_exact(effect):
    """A kick is the flow of the torque, and kicks add up and go back."""
    assert kick_error(effect) < 4e-13  # measured 9e-14
    for q, l in some_states(10):
        first = P.kick(effect, BODY, 0.0, 0.4, q, l)
        twice, back = (P.kick(effect, BODY, 0.0, h, q, first) for h in (0.3, -0.4))
        assert apart(twice, P.kick(effect, BODY, 0.0, 0.7, q, l)) <= 4e-15
        assert apart(back, l) <= 4e-15


@EVERY
def test_kick_is_the_flow_of_the_torque(name):
    effect, order = EXAMPLES[name], P.facts(EFFECTS[name]).kick_order
    if P.depends_on_momentum(effect) and not implements(effect, "kick"):
        return  # no splitting takes it
    if P.has_state(effect):
        return  # L alone has no flow, see test_moving_parts.py
    if order == math.inf:
        assert_exact(effect)
    else:
        coarse, fine = kick_error(effect, parts=10), kick_error(effect, parts=20)
        assert abs(math.log2(coarse / fine) - order) < 0.15  # measured 1.96 to 2.08


def test_the_kick_of_a_rotor_without_a_motor_is_exact():
    assert_exact(Rotor((0.5, -0.3, 0.8)))


@WITH_ENERGY
def test_energy_scale_bounds_the_energy_closely(effect):
    """Also of each number alone: a bound that confuses two numbers holds for all together (a
    mutant)."""
    largest, scale = (
        max(abs(P.energy(effect, BODY, q)) for q, _ in some_states(2000)),
        P.energy_scale(effect, BODY) * (1.0 + 1e-15),
    )
    assert 0.4 * scale <= largest <= scale  # measured 0.55 (potential) to 1.0
    zeros = {k: (0.0,) * len(v) for k, v in effect._asdict().items() if isinstance(v, tuple)}
    for one in (effect._replace(**zeros | one_left) for one_left in alone(effect)):
        largest = max(abs(P.energy(one, BODY, q)) for q, _ in some_states(200))
        assert largest <= P.energy_scale(one, BODY) * (1.0 + 1e-15), one


@EVERY
def test_energy_scale_of_an_effect_without_energy_bounds_its_torque(name):
    """It is what a drift of the energy ledger is divided by: torque times one radian."""
    effect = EXAMPLES[name]
    if implements(effect, "energy") or not implements(effect, "energy_scale"):
        return
    # one component of one vector is left at a time: each has to be in the scale
    for one in (effect, *(effect._replace(**one_left) for one_left in alone(effect))):
        largest = max(
            math.hypot(*P.torque(one, BODY, t, q, l))
            for t in (0.0, 0.01, 0.4)
            for q, l in some_states(100)
        )
        assert largest <= P.energy_scale(one, BODY) * (1.0 + 1e-15), one
        if one is effect:
            # measured 0.22 (rotating field), 0.58 (gravity gradient), 0.66 (moving pivot)
            assert largest >= 0.15 * P.energy_scale(one, BODY)


def broken_facts(effect):
    """{fact: by how much the torque of an effect breaks it}."""
    roll, about_z = (0.5, -0.5, -0.5, -0.5), (math.cos(0.4), 0.0, 0.0, math.sin(0.4))
    rolled = MassProperties.of(np.roll(MOMENTS, 1).tolist(), np.roll(STATIC, 1).tolist())
    worst = dict.fromkeys(("conserves_l2", "conserves_lz", "isotropic"), 0.0)
    for q, l in some_states():
        tau = P.torque(effect, BODY, 0.3, q, l)
        # axis 1 becomes axis 2, and so on; and the body turns about the vertical
        other = P.torque(effect, rolled, 0.3, multiply(q, roll), tuple(np.roll(l, 1)))
        turned = P.torque(effect, BODY, 0.3, multiply(about_z, q), l)
        differences = [*np.subtract(other, np.roll(tau, 1)), *np.subtract(turned, tau)]
        # the vertical turns in the body with what the effect adds to the angular velocity
        about = np.add(tau, np.cross(P.slip(effect, BODY, 0.3, q, l) or (0.0, 0.0, 0.0), l))
        errors = abs(dot(tau, l)), abs(dot(about, vertical(q))), max(map(abs, differences))
        worst = {fact: max(worst[fact], e) for fact, e in zip(worst, errors, strict=True)}
    return worst


@EVERY
def test_facts_are_true(name):
    for fact, error in broken_facts(EXAMPLES[name]).items():
        claimed = getattr(P.facts(EFFECTS[name]), fact)
        assert (error < 1e-14) == claimed, fact  # measured 9e-16 at most, or 0.05 at least


@EVERY
def test_facts_name_the_fields(name):
    kind = EFFECTS[name]
    assert set(kind.units) == set(kind.limits) == set(kind._fields)
    # the user gives no hidden one: it has to be 0
    assert all(
        (low < high) != (k in P.facts(kind).hidden) for k, (low, high) in kind.limits.items()
    )
    assert argument_names(kind, "torque", "energy", "kick") <= {"body", "t", "h", "q", "l"}
    for field in kind._fields:
        assert re.search(rf"^ *{field} : ", kind.__doc__, re.MULTILINE), field
    # every parameter has its unit in the docstring
    assert kind.__doc__.count("[") >= sum(unit != "1" for unit in kind.units.values())
    assert name_of(kind) == name_of(EXAMPLES[name]) == name


def test_parameters_go_to_rows_and_back():
    spring = EXAMPLES["spring"]
    assert P.parameter_count(spring, Gravity(1.0)) == 9
    assert P.from_numbers(Spring, [value for _, _, value in P.numbers(spring)]) == spring
    assert P.blank((spring,)) == (Spring(0.0, (0.0,) * 3, (0.0,) * 3, 0.0),)
    labels = [label for label, _ in label_effects((spring, Gravity(1.0), spring))]
    assert labels == ["spring", "gravity", "spring_2"]


class Backwards(Gravity):
    """Gravity with the wrong sign of the torque."""

    def torque(self, body, q):
        return cross((self.g * body.p1, self.g * body.p2, self.g * body.p3), vertical(q))


class Speeding(ViscousDamping):
    """Damping whose flow has the wrong sign."""

    def kick(self, h, l):
        return ViscousDamping.kick(self, -h, l)


def test_wrong_signs_are_caught():
    assert gradient_error(Backwards(9.81)) > 1.0  # measured 6
    assert kick_error(Speeding(0.3)) > 0.1  # measured 0.7
    # heavier above: more energy
    assert P.energy(Gravity(9.81), BODY, (1.0, 0.0, 0.0, 0.0)) == pytest.approx(9.81 * 0.3)


def test_several_effects_act_together():
    effects = EXAMPLES["gravity"], EXAMPLES["viscous_damping"]
    q, l = some_states(1)[0]
    together = total_torque(effects, BODY, 0.0, q, l)
    each = [P.torque(e, BODY, 0.0, q, l) for e in effects]
    assert apart(together, np.sum(each, axis=0)) <= 1e-15
    assert total_torque((), BODY, 0.0, q, l) == (0.0, 0.0, 0.0)
    pushed = push(effects, BODY, 0.0, 0.2, q, l, l)
    assert apart(pushed, np.add(l, np.multiply(0.2, together))) <= 1e-15
    assert push((), BODY, 0.0, 0.2, q, l, l) is l
    assert total_energy(effects, BODY, q) == P.energy(effects[0], BODY, q)
    there = kick_all(effects, BODY, 0.0, 0.2, q, l)
    # one is the mirror image of the other
    assert apart(kick_all_back(effects, BODY, 0.2, -0.2, q, there), l) <= 1e-15
    # and no flow commutes with it
    assert apart(kick_all(effects, BODY, 0.2, -0.2, q, there), l) > 1e-3
    assert kick_all((), BODY, 0.0, 0.2, q, l) == kick_all_back((), BODY, 0.0, 0.2, q, l) == l


def test_the_order_in_which_effects_are_listed_does_not_matter():
    class Own(NamedTuple):
        size: float

    listed = Gravity(9.81), ViscousDamping(0.1), Own(1.0)
    for some in itertools.permutations(listed):
        assert canonical(some) == listed
    assert name_of(listed[2]) == "Own"


SIDES = (1, 2, 0), (2, 0, 1)  # the elements yz, zx, xy of a tensor


def test_a_matrix_that_drives_some_spin_is_refused():
    def checked(matrix, **settings):
        body, start = rm.Body.from_moments(MOMENTS), rm.Start(omega=(0.1, 0.2, 0.3))
        return rm.prepare(rm.Scene(body, (MatrixDamping(matrix),), start, rm.Run(**settings))).scene

    words = r"matrix: \(.*\) drives some rotations, which needs anti_damping = true"
    ones = 1.0, 1.0, 1.0
    for matrix in (
        (1, 1, 0, 0, 0, 1.5), (0, 1, 1, 1.5, 0, 0), (1, 0, 1, 0, 1.5, 0),  # by one minor each
        (-1e-6, 1.0, 1.0, 0, 0, 0), (*ones, 0.9, -0.9, 0.9),
    ):  # fmt: skip
        assert np.linalg.eigvalsh(symmetric(matrix))[0] < 0.0
        with pytest.raises(rm.SceneError, match=words):
            checked(matrix)
        checked(matrix, anti_damping=True)
    for matrix in ((1.0, 1.0, 1.0, 0.0, 0.0, 1.0), (0.0,) * 6, (1.0, 1.0, 1.0, 0.9, 0.9, 0.9)):
        assert np.linalg.eigvalsh(symmetric(matrix))[0] > -1e-12
        checked(matrix)
    with pytest.raises(rm.SceneError, match="drives some rotations"):
        checked((1.0, 1.0, 1.0, 0.0, 0.0, rm.uniform(0.5, 1.1)))
    some = np.random.default_rng(5)
    for size in (1.0, 1e-100, 1e100):
        for rank in (1, 2, 3):  # damping about skew axes
            for _ in range(300):
                c = sum(np.outer(v, v) for v in some.normal(size=(rank, 3))) * size
                assert not MatrixDamping((*np.diag(c), *c[SIDES])).is_driving()
                c -= 1e-6 * np.trace(c) * np.eye(3)  # one of rank 3 may still damp
                driven = MatrixDamping((*np.diag(c), *c[SIDES])).is_driving()
                assert driven == (np.linalg.eigvalsh(c)[0] < 0.0)
