"""Generalised coordinates: M(q), the identity (3.32), motion in them, torques of potentials."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigidmc.mechanics import coordinates as C
from rigidmc.mechanics import rotation as R
from tests.tools import reference
from tests.tools.reference import apart

RNG = np.random.default_rng(32)
SOME = "313", "321", "rotation_vector"
POINTS = RNG.uniform(0.3, 1.4, (6, 3))
MASS, CENTRE, G = 1.3, np.array([0.1, 0.2, 0.3]), 9.81
GRAVITY = C.uniform_gravity(MASS, CENTRE, G)
SPRING = C.spring(5.0, (0.3, 0.1, 0.2), (1.0, 0.0, 0.5), 0.4)


def own(q):
    """A user's coordinates: rotations about x, y and z one after the other."""
    a = np.eye(3)
    for k, axis in enumerate(map(R.hat, np.eye(3))):
        c, s = (f(q[..., k])[..., None, None] for f in (np.cos, np.sin))
        a = a @ (np.eye(3) + s * axis + (1.0 - c) * (axis @ axis))
    return a


@pytest.mark.parametrize("name", C.NAMED)
def test_named_coordinates_are_the_rotations_of_rotation_py(name):
    is_vector = name == "rotation_vector"
    made = R.from_rotation_vector(POINTS) if is_vector else R.from_euler(POINTS, name)
    assert apart(C.matrix(name, POINTS), R.matrix(made)) < 2e-15  # 3.3e-16


@pytest.mark.parametrize("name", C.NAMED)
@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-9])
def test_closed_forms_of_m_are_the_derivatives_of_a(name, size):
    m = C.rate_matrix(lambda q: C.matrix(name, q), size * POINTS)
    assert apart(C.rate_matrix(name, size * POINTS), m) < 2e-15  # 4.4e-16


@pytest.mark.parametrize("name", C.NAMED)
def test_identity_3_32(name):
    def m(q):
        return C.rate_matrix(name, q)

    assert np.abs(C.identity_residual(m, POINTS)).max() < 2e-15  # 2.2e-16
    # the wrong versions: the other sign of the product, and space components in place of body
    # components
    assert np.abs(C.identity_residual(lambda q: -m(q), POINTS)).max() > 0.1
    assert np.abs(C.identity_residual(lambda q: C.matrix(name, q) @ m(q), POINTS)).max() > 0.1


# those of a user are differentiated number by number, for 10 s
@pytest.mark.parametrize("coordinates", [*SOME, pytest.param(own, marks=pytest.mark.slow)])
def test_motion_in_them_is_that_of_the_quaternion_form(coordinates):
    moments, momentum, weight = (0.6, 0.8, 1.0), np.array([0.8, 0.4, -0.3]), (0.02, 0.0, 0.1)
    start = POINTS[0]
    rates = np.linalg.solve(C.rate_matrix(coordinates, start), momentum / moments)
    rhs = C.equations_of_motion(coordinates, moments, C.uniform_gravity(1.0, weight, G))
    y = solve_ivp(rhs, (0.0, 1.0), [*start, *rates], "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    attitude = tuple(R.quaternion(C.matrix(coordinates, start)))
    q, l = reference.taylor(moments, momentum, 1.0, attitude, weight=[G * w for w in weight])
    assert R.attitude_error(C.matrix(coordinates, y[:3]), np.array(q, float)) < 5e-11  # 2.3e-12
    found = moments * (C.rate_matrix(coordinates, y[:3]) @ y[3:])
    assert np.abs(found - np.array(l, float)).max() < 5e-11  # 2.0e-12


@pytest.mark.parametrize("coordinates", [*SOME, own])
@pytest.mark.parametrize("times", [1e-12, 1e12, 1e25])
def test_free_motion_is_alike_at_any_rate(coordinates, times):
    rhs, rate = C.equations_of_motion(coordinates, (0.6, 0.8, 1.0)), np.array([0.8, 0.4, -0.3])
    bends, same = (rhs(0.0, np.array([*POINTS[0], *(x * rate)]))[3:] for x in (1.0, times))
    assert np.abs(same / times**2 - bends).max() < 1e-12 * np.abs(bends).max()  # 2.5e-13
    assert not rhs(0.0, np.array([*POINTS[0], 0.0, 0.0, 0.0])).any()


@pytest.mark.parametrize("potential", [GRAVITY, SPRING, C.total(GRAVITY, SPRING)])
@pytest.mark.parametrize("coordinates", [*SOME, own])
def test_torque_is_minus_the_inverse_transpose_of_m_times_the_slope(potential, coordinates):
    torque = C.torque_of_potential(potential, C.matrix(coordinates, POINTS))
    force = C.generalised_force(potential, coordinates, POINTS)
    assert np.abs(C.torque_of_force(coordinates, POINTS, force) - torque).max() < 2e-14  # 1.3e-15
    assert np.abs(C.force_of_torque(coordinates, POINTS, torque) - force).max() < 2e-14  # 1.3e-15


def test_torque_of_gravity_and_spring_are_force_times_arm():
    a = C.matrix("313", POINTS)
    weight = np.cross(CENTRE, -MASS * G * a[:, 2])
    assert apart(C.torque_of_potential(GRAVITY, a), weight) < 2e-15  # 8.9e-16
    point, hook = np.array([0.3, 0.1, 0.2]), np.array([1.0, 0.0, 0.5])
    away = hook - a @ point
    length = np.linalg.norm(away, axis=1, keepdims=True)
    pull = np.cross(point, R.to_body(a, 5.0 * (length - 0.4) * away / length))
    assert apart(C.torque_of_potential(SPRING, a), pull) < 2e-15  # 2.2e-16


def test_torque_of_a_users_potential_against_a_difference():
    def potential(a):
        return np.exp(a[..., 0, 1]) * a[..., 2, 2] ** 3

    a, h = C.matrix("313", POINTS), 1e-4
    turns = [R.matrix(R.from_rotation_vector(s * h * np.eye(3))) for s in (-2, -1, 1, 2)]
    v = [np.stack([potential(a @ turn[k]) for k in range(3)], -1) for turn in turns]
    slope = (v[0] - 8.0 * v[1] + 8.0 * v[2] - v[3]) / (12.0 * h)
    assert np.abs(C.torque_of_potential(potential, a) + slope).max() < 1e-11  # 3.8e-13


@pytest.mark.parametrize(
    "potential",
    [
        lambda a: np.abs(a[..., 2, 0]),
        lambda a: np.linalg.norm(a[..., 2, :2], axis=-1),
        lambda a: a.real[..., 2, 0] ** 2,
    ],
)
def test_a_potential_that_drops_the_imaginary_part_is_found_out(potential):
    with pytest.raises(ValueError, match="complex"):
        C.torque_of_potential(potential, C.matrix("313", POINTS))


def test_unknown_coordinates_name_the_nearest():
    with pytest.raises(ValueError, match="did you mean '313'"):
        C.rate_matrix("3133", POINTS)
