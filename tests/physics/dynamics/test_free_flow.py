"""The exact free motion: right to rounding for every body, start, time and scale."""

import itertools
import math
from fractions import Fraction
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from bench.problems.published import HARD, PROBLEMS
from rigidmc.engine.kernel import layout as K
from rigidmc.physics.dynamics.arc import EllipticArc, double_arc, elliptic_arc, increment, squares
from rigidmc.physics.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.physics.dynamics.free_flow import free_flow, make_flow, slopes
from rigidmc.physics.dynamics.so3 import add, add_compensated, apply_rotation, multiply
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.free_motion import FreeSteps
from tests.tools.kernels import block_of, make_block, prepare, run, turn_rate_of
from tests.tools.reference import apart, attitude_error, rotation, taylor

IDENTITY = (1.0, 0.0, 0.0, 0.0)
TILTED = (0.5, -0.1, 0.7, math.sqrt(0.25))


def body_of(moments):
    return MassProperties.of(tuple(map(float, moments)), (0.0, 0.0, 0.0))


def flow(moments, momentum, h, q=IDENTITY, halvings=None, panels=None):
    """One step, in panels of at most 1/8 rad by default; its momentum by a series over a panel."""
    body = body_of(moments)
    panels = panels or max(1, math.ceil(8.0 * abs(h) * turn_rate_of(moments, momentum)))
    halvings = math.ceil(math.log2(panels)) if halvings is None else halvings
    turn, change = free_flow(body, (1.0,) * halvings, (1.0 / panels,) * panels, h, momentum)
    return apply_rotation(q, turn), add_compensated(momentum, change)


@cache
def truth(moments, momentum, h):
    q, l = taylor(moments, momentum, h)
    return np.array(q, float), np.array(l, float)


def errors(moments, momentum, h, **how):
    """(angle error [rad], |L error|/|L|) of one step."""
    q, l = flow(moments, momentum, h, **how)
    true_q, true_l = truth(moments, momentum, h)
    size = np.linalg.norm(true_l)
    return float(attitude_error(q, true_q)), float(np.linalg.norm(l - true_l) / size)


def half_radian(moments, momentum):
    return 0.5 / max(abs(l / i) for l, i in zip(momentum, moments, strict=True))


def test_slopes_are_those_of_the_arc_at_constant_s():
    """Against mpmath: measured 2.2e-16 of both; 0.41 and 0.63 with the wrong sign of g1 or g3."""
    s, x, y = 0.8, 0.7, 1.1

    def less_than_root(z):
        return 1 - mp.sqrt(1 - z * mp.mpf(s) ** 2)

    a = EllipticArc(s, float(less_than_root(x)), float(less_than_root(y)))
    for slope, z in zip(slopes(a), (x, y), strict=True):
        assert abs(slope / float(mp.diff(less_than_root, z)) - 1.0) < 1e-15


def places():
    """Yield (name, [(moments, momentum, h)], bounds of both errors)."""
    for name, case in HARD.items():  # measured 1.6e-14 and 3e-16, 4e-16
        h = half_radian(*case)
        angle = 1e-13 if "needle" in name else 2e-15
        yield name, [(*case, h), (*case, -h)], (angle, 4e-15)
    octants = list(itertools.product((1.0, -1.0), repeat=3))
    for order in itertools.permutations((0, 1, 2)):  # circling about one axis, about the other
        moments = tuple((1.0, 1.3, 2.0)[i] for i in order)
        some = itertools.chain(
            itertools.product([(0.3, 0.9, 0.7)], octants),
            itertools.product([(0.9, 0.3, 0.2)], octants[::3]),
        )
        starts = [tuple(signs[i] * l[i] for i in order) for l, signs in some]
        yield f"axes {order}", [(moments, l, 0.4) for l in starts], (2e-15, 2e-15)  # 1.5e-16
    root3 = math.sqrt(3.0)
    for split in (10.0**-k for k in range(4, 16)):
        alike = (1.0, 1.0 + split, 3.0), (1.0, 3.0, 3.0 + split), (1.0 + split, 3.0, 1.0)
        bodies = *alike, (1.0, 1.0 + split, 1.0 + 2 * split)
        some = itertools.product(bodies, ((0.3, 0.2, 0.1), (0.1, -0.02, 0.3)), [1.0])
        yield f"symmetric within {split:.0e}", list(some), (2e-15, 2e-15)  # measured 2e-16
        near = (1.0 + split, 1.0, root3), (1.0 - split, 1.0, root3), (-1.0, 1.0, -root3 - split)
        some = itertools.product([(1.0, 2.0, 3.0)], (*near, (split, 2.0, 0.0)), [0.5])
        yield f"separatrix within {split:.0e}", list(some), (1e-14, 1e-14)  # measured 1.0e-15


PLACES = {name: rest for name, *rest in places()}


@pytest.mark.parametrize("name", PLACES)
def test_a_step_is_right_to_rounding(name):
    cases, bounds = PLACES[name]
    assert (np.max([errors(*case) for case in cases], axis=0) < bounds).all()


SYMMETRIC = [(a, a, b)[k:] + (a, a, b)[:k] for a, b in ((1.0, 2.0), (15.0, 0.5)) for k in range(3)]


@pytest.mark.parametrize("moments", SYMMETRIC)
def test_the_axis_of_a_symmetric_body_may_be_any(moments):
    momentum = 0.3, 0.4, -0.2
    q, l = IDENTITY, momentum
    for _ in range(50):  # long enough for components off the axis to change sign
        q, l = flow(moments, l, 0.1, q=q, panels=1)
    true_q, true_l = truth(moments, momentum, 5.0)
    assert attitude_error(q, true_q) < 2e-14  # measured 4e-15
    assert np.abs(l - true_l).max() < 3e-15  # measured 5e-16


def test_a_symmetric_body_takes_any_step():
    for moments in ((1.0, 1.0, 2.0), (1.0, 2.0, 2.0)):  # measured 1.6e-15, 1.8e-15
        assert max(errors(moments, (0.3, 0.2, 0.1), 25.0, halvings=6, panels=1)) < 1e-14


def test_too_few_halvings_are_wrong_and_change_the_size_of_l():
    moments, momentum = (1.0, 2.0, 3.0), (1.0, 0.8, 1.2)
    h = 5.0
    true_l = truth(moments, momentum, h)[1]
    good, bad = (np.array(flow(moments, momentum, h, halvings=n, panels=1)[1]) for n in (7, 0))
    assert np.abs(good - true_l).max() < 2e-14  # measured 2.0e-15
    assert np.abs(bad - true_l).max() > 0.1  # measured 0.37
    # measured 0.0057: a run flags it
    assert abs(bad @ bad / np.dot(momentum, momentum) - 1.0) > 0.001


def test_the_phase_rule_is_of_order_8():
    moments, momentum = (0.6, 0.8, 1.0), (1.8, 0.4, -0.9)
    steps = [1.13, 0.8, 0.566, 0.4]
    found = [errors(moments, momentum, h, halvings=5, panels=1) for h in steps]
    angle, relative = np.array(found).T
    slopes = np.diff(np.log(angle))[1:] / np.diff(np.log(steps))[1:]
    assert relative.max() < 4e-15  # measured 4e-16: the momentum is exact at any step
    # measured 8.98 and 9.13: the error of one step, so one more than the order
    assert (np.abs(slopes - 9.0) < (0.2, 0.3)).all()


def test_the_rule_of_a_panel_errs_by_its_term_of_order_9():
    """h^9 v^(8)/(7! 8!), from v = t^8 over h = 1, whose 8th derivative is 8!; none of t^7."""
    for power, error in ((7, Fraction(0)), (8, Fraction(1, math.factorial(7)))):
        ends = Fraction(19, 70) - Fraction(power, 35) + Fraction(power * (power - 1), 840)
        assert ends + Fraction(16, 35) / 2**power - Fraction(1, power + 1) == error


def test_panels_cut_a_step_without_a_seam():
    moments, momentum = HARD["generic"]
    q, l = flow(moments, momentum, 0.1, panels=1)
    for _ in range(3):
        q, l = flow(moments, l, 0.1, q=q, panels=1)
    four = flow(moments, momentum, 0.4, panels=4)
    assert attitude_error(four[0], q) < 1e-15  # measured 1.2e-16
    assert apart(four[1], l) < 1e-15  # measured 0


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("turn", "halvings"), [(0.1, 0), (1.0, 3)])
def test_a_principal_axis_stays_put_to_the_bit(axis, sign, turn, halvings):
    for moments in itertools.permutations((1.0, 2.0, 3.0)):
        for size in (1.0, 0.7, 3.3, 1e-9):
            momentum = tuple(sign * size if i == axis else 0.0 for i in range(3))
            q, l = TILTED, momentum
            for _ in range(50):
                q, l = flow(moments, l, turn / size, q=q, halvings=halvings, panels=1)
                assert l == momentum
            half = 25 * turn * sign / moments[axis]
            about = [math.cos(half), *(math.sin(half) * (i == axis) for i in range(3))]
            # measured 6e-15 after 50 rad
            assert attitude_error(q, multiply(TILTED, about)) < 5e-14


def test_at_rest_for_no_time_and_there_and_back():
    q, l = flow((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 1.0, q=TILTED, panels=1)
    assert l == (0.0, 0.0, 0.0)
    assert attitude_error(q, TILTED) < 1e-15  # measured 0
    for moments, momentum in HARD.values():
        h = half_radian(moments, momentum)
        q, l = flow(moments, momentum, 0.0, q=TILTED)
        assert l == momentum
        assert attitude_error(q, TILTED) < 1e-15  # measured 1.4e-16
        q, l = flow(moments, momentum, h, q=TILTED)
        q, l = flow(moments, l, -h, q=q)
        assert attitude_error(q, TILTED) < 3e-14  # measured 3e-15, a needle; 3e-16 otherwise
        # measured 2e-16
        assert np.linalg.norm(np.subtract(l, momentum)) < 2e-15 * np.linalg.norm(momentum)


@pytest.mark.parametrize("size", [1e-150, 1e-30, 1e30, 1e150])
@pytest.mark.parametrize("mass", [1e-46, 1e-20, 1.0, 8e37])
def test_scale_does_not_matter(size, mass):
    """From molecules to planets in SI units, and any speed that a double can hold."""
    moments, momentum = (1.0, 1.3, 2.0), (0.3, 0.9, 0.7)
    q, l = flow(moments, momentum, 0.4)
    scaled = (tuple(by * x for x in row) for by, row in ((mass, moments), (size, momentum)))
    big_q, big_l = flow(*scaled, 0.4 / size * mass)
    assert attitude_error(big_q, q) < 1e-15  # measured 7e-17
    assert apart(np.divide(big_l, size), l) < 1e-15  # measured 1.1e-16


def block_of_bodies(moments, momentum, attitude):
    """A block of free bodies (3, members)."""
    body = MassProperties.of(moments, np.zeros_like(moments))
    return make_block(body, (), np.array([attitude]).T, momentum)


def hard_and_random():
    some = np.random.default_rng(1)
    masses, hard = some.uniform(0.2, 1.0, (3, 48)), np.moveaxis(np.array([*HARD.values()]), 0, 2)
    moments = np.column_stack([hard[0], masses.sum(0) - masses])
    return block_of_bodies(moments, np.column_stack([hard[1], some.normal(size=(3, 48))]), TILTED)


class Walking(FreeSteps):
    """The exact steps by their increments alone, without the correction to T and |L|^2."""

    def precompute(self, body, substep, l):
        m, _ = make_flow(body, self.drift.halvings, self.drift.panels, substep[0], l[7:])
        return m, slopes(m.whole), slopes(m.panel), (0.0 * m.x, 0.0 * m.x)


class Deaf(Walking):
    """The same with g1 and g3 of the start for ever."""

    def precompute(self, body, substep, l):
        m, _ = make_flow(body, self.drift.halvings, self.drift.panels, substep[0], l[7:])
        return m, (), (), (0.0 * m.x, 0.0 * m.x)


def drifts(kind, steps):
    """Largest drifts of T and |L|^2 of each body, except bodies with two equal moments."""
    block, made = hard_and_random(), prepare(INTEGRATORS["exact"], 0.1)
    run(block, made._replace(integrator=kind(*made.integrator)), (), 0.05, steps)
    differences = block[K.BODY + 3 : K.BODY + 6]  # a1, a2, a3
    return block[K.DRIFT : K.DRIFT + 2, (np.abs(differences) > 1e-6).all(0)].max(0)


def test_no_invariant_of_a_free_body_drifts_with_steps():
    """The rounding of the constants is the same in every step, and that of the state is a random
    walk; the steps correct both.
    """
    few, many = (drifts(FreeSteps, steps) for steps in (1_000, 100_000))
    assert few.max() < 2e-15 and many.max() < 2e-15  # measured 7.3e-16 and 8.2e-16
    walked = [drifts(Walking, steps).max() for steps in (1_000, 100_000)]
    assert walked[1] > 10.0 * many.max()  # measured 1.1e-13
    assert walked[1] > 5.0 * walked[0]  # measured 4.0e-15 before: 27 times
    assert drifts(Deaf, 10_000).max() > 1e-9  # measured 9.8e-7: along the separatrix


def test_invariants_of_hard_and_random_bodies_over_ten_thousand_steps():
    block = hard_and_random()
    before = block[:7].copy()
    run(block, prepare(INTEGRATORS["exact"], 0.1), (), 0.05, 10_000)
    start, end = (np.array([rotation(x[:4]) @ x[4:7] for x in b.T]) for b in (before, block))
    drift = np.linalg.norm(end - start, axis=1) / np.linalg.norm(start, axis=1)
    norm = np.abs((block[:4] ** 2).sum(0) - 1.0)
    assert block[K.DRIFT].max() < 5e-14  # measured 1.1e-14, of a rod
    assert block[K.DRIFT + 1].max() < 5e-14  # measured 1.1e-14
    assert drift.max() < 4e-14  # measured 7.5e-15: momentum in space, which the attitude turns
    assert norm.max() < 1e-15  # measured 2e-16


def test_many_steps_along_and_across_the_separatrix_stay_right():
    separatrices = "separatrix", "separatrix_above", "separatrix_below"
    names = "generic", *separatrices, "near_middle_axis", "prolate", "needle_on_edge"
    h, steps = 0.05, 60
    moments, momentum = (np.array([HARD[n][i] for n in names]).T for i in (0, 1))
    block = block_of_bodies(moments, momentum, IDENTITY)
    run(block, prepare(INTEGRATORS["exact"], 0.1), (), h, steps)
    for m, name in enumerate(names):
        q, l = truth(*HARD[name], h * steps)
        assert attitude_error(block[:4, m], q) < 1e-14  # measured 1.0e-15
        assert np.linalg.norm(block[4:7, m] - l) < 8e-15 * np.linalg.norm(l)  # measured 8e-16


def test_the_plain_form_drifts_where_the_increments_do_not():
    body, start = body_of((0.6, 0.8, 1.0)), (1.8, 0.4, -0.9)

    def parts(l):
        p, q1, q3 = squares(body, l)
        return double_arc(elliptic_arc(0.005, p + q3, p + q1), p + q3, p + q1), p

    def plain(l):
        (s, g1, g3), p = parts(l)
        f1, f3, d = 1.0 - g1, 1.0 - g3, 1.0 - p * s * s
        return (
            (f1 * l[0] + f3 * s * body.a1 * l[1] * l[2]) / d,
            (f1 * f3 * l[1] + s * body.a2 * l[0] * l[2]) / d,
            (f3 * l[2] + f1 * s * body.a3 * l[0] * l[1]) / d,
        )

    def increments(l):
        return add(l, increment(body, *parts(l), l))

    def kept(l):
        return np.array([kinetic_energy(body, l), np.dot(l, l)])

    def drift(step, steps):
        l = start
        for _ in range(steps):
            l = step(l)
        return apart(kept(l) / kept(start), 1.0)

    good, (bad, worse) = drift(increments, 10_000), (drift(plain, n) for n in (5_000, 10_000))
    assert apart(plain(start), increments(start)) < 1e-15  # the same map
    assert good < 2e-14  # measured 3e-15
    assert worse > 3e-13  # measured 9e-13
    assert 1.5 < worse / bad < 2.5  # measured 1.8: it grows with time


@pytest.mark.parametrize("name", [n for n, p in PROBLEMS.items() if "flip" in p.more])
def test_flips_come_at_the_right_time(name):
    problem = PROBLEMS[name]
    body, flip = problem.body, problem.more["flip"]
    lam = turn_rate_of(problem.moments, problem.momentum)

    def crossing(guess):
        """The time at which the middle component is 0, by Newton's method from a guess."""
        for _ in range(20):
            steps = math.ceil(guess * lam)
            made, block = prepare(INTEGRATORS["exact"], lam * guess / steps), block_of([problem])
            run(block, made, (), guess / steps, steps)
            l = block[K.MOMENTUM : K.EXTRA, 0]
            late = l[1] / (body.a2 * l[0] * l[2])
            guess -= np.clip(late, -0.3 / lam, 0.3 / lam)
        return guess

    first = crossing(flip / 2)
    if problem.momentum[2] == 0.0:  # starts at the extreme, where the middle component turns back
        assert abs(first / (flip / 2) - 1.0) < 2e-14  # measured 3.1e-15
    # the next time is as accurate as |L|^2 - 2 T I2, the distance from the separatrix, is
    # conserved: to 1e-16 |L|^2
    i, l = problem.moments, problem.momentum
    distance = abs(l[0] ** 2 * (1 - i[1] / i[0]) + l[2] ** 2 * (1 - i[1] / i[2])) / np.dot(l, l)
    bound = 0.5 * 1.1e-16 / distance  # measured 0.07 of 1.1e-16/distance
    if bound < 1e-3:  # true at every start except 1e-8 from the axis
        assert abs((crossing(first + flip) - first) / flip - 1.0) < bound


@pytest.mark.parametrize("h", [1e-6, 1e-3, 0.05])
def test_a_short_turn_has_all_its_digits(h):
    """The error of a short rotation is the same in every step and adds up.

    It was 6.6e-11 of a rotation by 1e-6 rad when that was a product of three factors of size 1.
    """
    some = np.random.default_rng(3)
    for _ in range(4):
        moments, l = some.uniform(0.6, 1.0, 3), some.normal(size=3)
        turn, _ = free_flow(body_of(moments), (), (1.0,), h, tuple(l))
        q = np.array(taylor(moments, l, h)[0], float)
        assert np.abs(np.array(turn[1:]) - q[1:]).max() < 1e-15 * np.linalg.norm(q[1:])  # 3.2e-16
