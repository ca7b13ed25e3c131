"""What effects do to a body: each against the same law integrated in space by scipy.

Well-known motions are also tested against their theory. All in plain Python, by rk8 and rk4: code
that runs compiled runs uncompiled too.
"""

import math

import numpy as np
import pytest
from scipy.special import ellipk

from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.so3 import dot, vertical
from rigidmc.physics.effects import (
    AxialDamping,
    DryFriction,
    Gravity,
    GravityGradient,
    MovingPivot,
    QuadraticDrag,
    Rotor,
    SpaceTorque,
    UniformField,
)
from rigidmc.physics.integrators import INTEGRATORS
from tests.physics.effects.laws import REFERENCE, Motion
from tests.physics.effects.test_effects import EXAMPLES, KNOWN, MOMENTS, STATIC
from tests.tools.kernels import one_step, prepare
from tests.tools.reference import attitude_error, rotation, unit

ONE = (1.0, 0.0, 0.0, 0.0)


def moved(effects, q, l, h, steps, body=None, name="rk8", seen=lambda t, q, l: None):
    """(q, L) after some steps, with the works after L if it starts with them; calls seen(t, q, L)
    after each step.
    """
    body, effects = body or MassProperties.of(MOMENTS, STATIC), tuple(effects)
    made = prepare(INTEGRATORS[name], 3.0 * h, effects)
    for i in range(steps):
        q, l = one_step(made, body, effects, i * h, h, q, l)
        seen((i + 1) * h, q, l)
    return np.array(q), np.array(l)


def in_space(name, q, l, end):
    """(A, L in the body, work) at the end, by the law in space."""
    effects = [(name, EXAMPLES[name])]
    a, w, work = Motion(KNOWN, effects, np.divide(l, MOMENTS), q, end, 2, math.inf).end()
    return a, MOMENTS * w, work[0]


@pytest.mark.parametrize("name", REFERENCE)
def test_motion_against_the_law_in_space(name):
    q, l = unit((0.5, -0.3, 0.7, 0.2)), (0.4, -0.3, 0.5)
    at, momentum = moved((EXAMPLES[name],), q, (*l, 0.0), 0.02, 100)
    a, true, work = in_space(name, q, l, 2.0)
    assert np.abs(momentum[:3] - true).max() < 1e-12  # measured 8e-14
    assert momentum[3] == pytest.approx(work, abs=1e-12)  # measured 2e-14
    assert np.abs(np.array(rotation(tuple(at))) - a).max() < 1e-12


def test_two_effects_add_up_in_any_order():
    q, l = unit((0.5, -0.3, 0.7, 0.2)), (0.4, -0.3, 0.5)
    some = [EXAMPLES[name] for name in ("spring", "axial_damping", "moving_pivot", "rotor")]
    one, two = moved(some, q, l, 0.05, 20), moved(some[::-1], q, l, 0.05, 20)
    assert np.abs(one[1] - two[1]).max() < 3e-15  # measured 7e-16


AXIS = (0.0, 0.0, 2.0)
# After 5 s, a function of attitude and momentum grows by this, to these digits: of drag c and
# moment I, 1/w by c t/I; of friction, sqrt(w^2 + s^2) - s arsinh(s/w) by -T t/I; of a torque about
# the vertical, L_z; of damping, ln |L| about each axis by its own rate. Measured 4e-16 at most.
KNOWN_MOTIONS = {
    "drag": (QuadraticDrag(0.3), AXIS, lambda q, l: 1.0 / l[2], 0.3 * 5.0, 1e-14),
    "friction": (
        DryFriction(0.4, 0.2), AXIS,
        lambda q, l: math.hypot(l[2], 0.2) - 0.2 * math.asinh(0.2 / l[2]), -0.4 * 5.0, 1e-14,
    ),
    "vertical": (
        SpaceTorque((0.0, 0.0, 0.3)), (0.4, -0.3, 0.5),
        lambda q, l: dot(tuple(l), vertical(tuple(q))), 0.3 * 5.0, 1e-14,
    ),
    "axial": (
        AxialDamping((0.3, 0.1, 0.6)), (0.0, 2.0, 0.0), lambda q, l: math.log(l[1]), -0.1 * 5.0,
        1e-13,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN_MOTIONS)
def test_motions_in_closed_form(name):
    effect, l, function, change, off = KNOWN_MOTIONS[name]
    q = unit((0.5, -0.3, 0.7, 0.2))
    at, end = moved((effect,), q, l, 0.05, 100)
    assert function(at, end) - function(q, l) == pytest.approx(change, rel=off, abs=off)
    spun = np.flatnonzero(l)
    assert not np.delete(end, spun).any() or spun.size == 3


def test_a_needle_in_a_field():
    """A dipole released at angle a swings with period 4 K(sin^2(a/2)) sqrt(I/(dipole field))."""
    a, strength = 2.0, 0.5 * 3.0
    body = MassProperties.of((1.0, 1.0, 0.01), (0.0, 0.0, 0.0))
    period = 4.0 * ellipk(math.sin(0.5 * a) ** 2) / math.sqrt(strength)
    q = (math.cos(0.5 * a), math.sin(0.5 * a), 0.0, 0.0)
    field = UniformField((0.0, 0.0, 0.5), (0.0, 0.0, 3.0))
    at, l = moved((field,), q, (0.0, 0.0, 0.0), period / 200, 200, body)
    assert attitude_error(at, q) < 1e-14  # measured 8e-16
    assert np.abs(l).max() < 1e-14  # measured 3e-16


def test_libration_on_a_circular_orbit():
    """In the orbital plane, with n sqrt(3 (I2 - I1)/I3): the long axis points to the centre and
    swings about it by 1e-4 rad.
    """
    moments, n, small = (0.5, 0.8, 1.0), 1.0, 1e-4
    body = MassProperties.of(moments, (0.0, 0.0, 0.0))
    period, start = 2.0 * math.pi / math.sqrt(3.0 * (0.8 - 0.5) / 1.0), (0.0, 0.0, n * moments[2])
    q = (math.cos(0.5 * small), 0.0, 0.0, math.sin(0.5 * small))
    at, l = moved((GravityGradient(1.0, 1.0),), q, start, period / 200, 200, body)
    turned = 2.0 * math.atan2(at[3], at[0]) - n * period
    assert abs(math.remainder(turned - small, 2.0 * math.pi)) < 1e-13  # measured 4e-15
    # measured 1.5e-12: the period is right to 3e-9, the effect of the amplitude
    assert abs(l[2] / moments[2] - n) < 5e-12


def unstable(wheel):
    """Whether a spin of 1 rad/s about the middle axis, with a wheel along it, loses 1e-6 of its
    rate within 60 s.
    """
    body, lost = MassProperties.of((1.0, 2.0, 3.0), (0.0, 0.0, 0.0)), []
    moved((Rotor((0.0, wheel, 0.0)),), ONE, (1e-6, 2.0, 1e-6), 0.25, 240, body, "rk4",
          lambda t, q, l: lost.append(abs(l[0]) + abs(l[2])))  # fmt: skip
    return max(lost) > 1e-4


def test_a_wheel_makes_the_middle_axis_stable():
    """(I2 w + H - I1 w)(I2 w + H - I3 w) > 0: above H = 1 for moments 1, 2, 3, and below -1."""
    assert all(unstable(h) for h in (-0.97, 0.0, 0.97))
    assert not any(unstable(h) for h in (-1.03, 1.03))


def stands(share):
    """Whether a pendulum stands on its head if shaken with `share` of Kapitza's amplitude sqrt(2 g
    l)/frequency, l = I/(m r).
    """
    body, g, length = MassProperties.of((1.0, 1.0, 0.1), (0.0, 0.0, 1.0)), 1.0, 1.0
    frequency = 60.0
    swing, h = share * math.sqrt(2.0 * g * length) / frequency, math.pi / frequency / 6.0
    q, leans = (math.cos(5e-4), math.sin(5e-4), 0.0, 0.0), []
    shaken = Gravity(g), MovingPivot((0.0, 0.0, swing), frequency)
    moved(shaken, q, (0.0, 0.0, 0.0), h, 5000, body, "rk4",
          lambda t, q, l: leans.append(vertical(q)[2]))  # fmt: skip
    return min(leans) > 0.99


def test_kapitzas_threshold():
    assert not stands(0.98)
    assert stands(1.02)
