"""The chapter's table of contents: one test per row of its theory, named by its equation.

G. F. Torres del Castillo, An Introduction to Hamiltonian Mechanics, 2018, ch. 3. The tests of each
module go into detail.
"""

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rigidmc import Body, Gravity, Scene, Start, simulate
from rigidmc.mechanics import coordinates, euler_rates, inertia, rotation, textbook
from rigidmc.mechanics.free_top import solve_free_top
from rigidmc.mechanics.lagrange_steady import effective_potential
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top, solve_lagrange_top
from rigidmc.mechanics.textbook import jacobi_omega, symmetric_omega
from tests.tools import reference
from tests.tools.plans import closed_form

RNG = np.random.default_rng(34)
A = Rotation.random(rng=RNG).as_matrix()


def test_chapter_3_1_to_3_5_rotations_and_components_in_both_frames():
    q = rotation.quaternion(A)
    a = rotation.matrix(q)
    assert np.abs(a @ a.T - np.eye(3)).max() < 2e-15  # 1.1e-16
    assert np.linalg.det(a) == pytest.approx(1.0, abs=2e-15)
    v = RNG.normal(size=(9, 3))
    assert np.abs(rotation.to_space(q, v) - v @ A.T).max() < 4e-15  # 3.3e-16
    assert np.abs(rotation.to_body(q, rotation.to_space(q, v)) - v).max() < 4e-15  # 2.2e-16
    assert np.abs(rotation.to_body(q, v) - v @ A.T).max() > 0.1  # the two frames differ


def test_chapter_3_7_to_3_9_and_example_3_3_angular_velocity_of_a_rotation():
    t, h = 0.7, 1e-5
    phi, rate = np.sin(t), np.cos(t)

    def a(t):
        return rotation.matrix(rotation.from_euler((np.sin(t), 0.0, 0.0)))

    slope = (a(t + h) - a(t - h)) / (2 * h)
    # 2.4e-11
    assert np.abs(rotation.angular_velocity(a(t), slope) - [0.0, 0.0, rate]).max() < 1e-10
    # 2.4e-11
    assert np.abs(rotation.angular_velocity_space(a(t), slope) - [0.0, 0.0, rate]).max() < 1e-10
    assert np.abs(a(t) - Rotation.from_euler("z", phi).as_matrix()).max() < 1e-15  # 0.0e+00


def test_chapter_3_15_and_3_16_tensor_and_energy_of_particles():
    m, r, omega = RNG.uniform(0.1, 1.0, 12), RNG.normal(size=(12, 3)), RNG.normal(size=3)
    body = Body.from_particles(m, r)
    v = np.cross(omega, r)
    assert body.kinetic_energy(omega) == pytest.approx(0.5 * (m * (v * v).sum(1)).sum(), rel=1e-14)


def test_chapter_example_3_2_four_particles():
    body = Body.from_particles([1.0] * 4, [[1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 0]])
    assert np.abs(body.tensor - [[2, -1, 0], [-1, 2, 0], [0, 0, 4]]).max() < 2e-15  # 2.2e-16
    assert np.abs(np.array(body.moments) - [1, 3, 4]).max() < 2e-15  # 0.0e+00
    for axis, wanted in zip(np.array(body.axes).T, ([1, 1, 0], [1, -1, 0], [0, 0, 1]), strict=True):
        assert abs(axis @ wanted) / np.linalg.norm(wanted) == pytest.approx(1.0, abs=1e-15)


def test_chapter_3_17_and_example_3_1_3_18_cylinder_about_its_centre():
    mass, a, h = 1.3, 0.4, 0.9
    wanted = mass / 12 * np.array([3 * a**2 + h**2, 3 * a**2 + h**2, 6 * a**2])
    assert np.abs(np.array(Body.cylinder(mass, a, h).moments) - wanted).max() < 2e-16  # 0.0e+00
    density = mass / (np.pi * a**2 * h)
    integral = Body.from_density(density, ("cylinder", a, (-h / 2, h / 2)))
    assert np.abs(np.diag(integral.tensor) - wanted).max() < 1e-14  # 8.3e-16


def test_chapter_3_19_to_3_23_principal_axes_right_handed_with_equal_moments_too():
    for moments in ([1.0, 2.0, 2.5], [1.0, 1.0, 1.5], [1.0, 2.0, 2.0], [1.5, 1.5, 1.5]):
        found, b = inertia.principal_axes((A * moments) @ A.T)
        assert np.abs(found - moments).max() < 3e-15  # 1.3e-15
        assert np.abs((b * found) @ b.T - (A * moments) @ A.T).max() < 3e-15  # 4.4e-16
        assert np.linalg.det(b) == pytest.approx(1.0, abs=3e-15)


def test_chapter_cylinder_on_the_edge_of_its_base_by_both_routes():
    mass, a = 1.0, 0.1
    h = np.sqrt(3.0) * a
    direct = (
        mass
        / 12
        * np.array(
            [
                [3 * a**2 + 4 * h**2, 0, -6 * a * h],
                [0, 15 * a**2 + 4 * h**2, 0],
                [-6 * a * h, 0, 18 * a**2],
            ]
        )
    )
    shifted = inertia.about_point(Body.cylinder(mass, a, h).tensor, mass, (a, 0.0, h / 2))
    assert np.abs(shifted - direct).max() < 1e-16  # 3.5e-18
    unit = mass * a**2
    for body in (
        Body.from_tensor(direct, mass),
        Body.cylinder(mass, a, h).with_pivot((a, 0.0, -h / 2)),
    ):
        assert np.abs(np.sort(body.moments) / unit - [0.5, 2.25, 2.25]).max() < 3e-15  # 4.4e-16
    axis = np.array(Body.from_tensor(direct, mass).axes)[:, 0]
    assert abs(axis @ np.array([2.0, 0.0, np.sqrt(3.0)]) / np.sqrt(7.0)) == pytest.approx(
        1.0, abs=2e-15
    )
    root = np.sqrt(225 * a**4 + 24 * a**2 * h**2 + 16 * h**4)
    general = mass / 24 * (21 * a**2 + 4 * h**2 + np.array([-root, root]))
    # 6.9e-18
    assert (
        np.abs(
            np.sort(np.linalg.eigvalsh(direct))[[0, 2]]
            - np.sort([*general, mass / 12 * (15 * a**2 + 4 * h**2)])[[0, 2]]
        ).max()
        < 1e-16
    )


def test_chapter_3_25_angular_momentum_is_not_along_omega_off_a_principal_axis():
    m, r, omega = RNG.uniform(0.1, 1.0, 8), RNG.normal(size=(8, 3)), RNG.normal(size=3)
    body = Body.from_particles(m, r)
    l = body.angular_momentum(omega)
    # 7.1e-15
    assert np.abs(l - (m[:, None] * np.cross(r, np.cross(omega, r))).sum(0)).max() < 2e-14
    assert np.linalg.norm(np.cross(l, omega)) > 1e-3 * np.linalg.norm(l)
    own = np.array(body.axes)[:, 1]
    assert np.linalg.norm(np.cross(body.angular_momentum(own), own)) < 2e-14  # 4.9e-16


def test_chapter_3_26_to_3_28_and_example_3_4_parallel_axes_and_surviving_principal_axes():
    m, r, point = RNG.uniform(0.1, 1.0, 6), RNG.normal(size=(6, 3)), RNG.normal(size=3)
    body = Body.from_particles(m, r)
    # 1.8e-15
    assert np.abs(body.with_pivot(point).tensor - inertia.of_particles(m, r - point)).max() < 3e-14
    # 8.9e-16
    assert (
        np.abs(
            body.with_pivot_at_centre().tensor - inertia.of_particles(m, r - m @ r / m.sum())
        ).max()
        < 2e-14
    )
    assert inertia.survives(np.eye(3), (1.0, 1.0, 0.0)).tolist() == [False, False, True]


@pytest.mark.parametrize("name", ["313", "323", "rotation_vector"])
def test_chapter_3_29_to_3_32_coordinates_and_their_identity(name):
    q, rate, h = RNG.uniform(0.4, 1.2, 3), RNG.normal(size=3), 1e-5
    m = coordinates.rate_matrix(name, q)
    slope = (coordinates.matrix(name, q + h * rate) - coordinates.matrix(name, q - h * rate)) / (
        2 * h
    )
    # 5.2e-10
    assert (
        np.abs(rotation.angular_velocity(coordinates.matrix(name, q), slope) - m @ rate).max()
        < 1e-9
    )
    # 1.7e-16
    assert (
        np.abs(coordinates.identity_residual(lambda x: coordinates.rate_matrix(name, x), q)).max()
        < 1e-15
    )


def test_chapter_3_33_and_3_34_torque_of_a_potential():
    v = coordinates.total(
        coordinates.uniform_gravity(1.2, (0.1, 0.0, 0.3)),
        coordinates.spring(4.0, (0.2, 0.1, 0.0), (0.5, 0.5, 1.0), 0.2),
        lambda a: a[..., 0, 0] * a[..., 1, 1] ** 2,
    )
    q, h = RNG.uniform(0.4, 1.2, 3), 1e-6
    a = coordinates.matrix("313", q)
    torque = coordinates.torque_of_potential(v, a)
    turns = (Rotation.from_rotvec(s * h * e).as_matrix() for e in np.eye(3) for s in (1, -1))
    values = np.array([v(a @ turn) for turn in turns]).reshape(3, 2)
    assert np.abs(torque + (values[:, 0] - values[:, 1]) / (2 * h)).max() < 1e-8  # 7.7e-10
    # 8.9e-16
    assert (
        np.abs(
            torque
            - coordinates.torque_of_force("313", q, coordinates.generalised_force(v, "313", q))
        ).max()
        < 1e-14
    )


def test_chapter_3_35_and_example_3_5_two_equal_moments():
    one, three, omega = 1.0, 1.6, np.array([0.4, -0.3, 2.0])
    t = np.linspace(-30.0, 30.0, 61)
    rate = (three - one) / one * omega[2]
    wanted = np.stack(
        [
            omega[0] * np.cos(rate * t) - omega[1] * np.sin(rate * t),
            omega[1] * np.cos(rate * t) + omega[0] * np.sin(rate * t),
            0 * t + omega[2],
        ],
        -1,
    )
    moments = np.array([one, one, three])
    # 2.3e-15
    assert (
        np.abs(solve_free_top(moments, moments * omega, (1, 0, 0, 0), t).omega - wanted).max()
        < 1e-13
    )


def test_chapter_example_3_5_as_the_chapter_writes_it():
    moments, omega, t = (
        np.array([1.0, 1.0, 1.6]),
        np.array([0.4, -0.3, 2.0]),
        np.linspace(-9.0, 9.0, 7),
    )
    assert (
        np.abs(
            symmetric_omega(moments, omega, t)
            - solve_free_top(moments, moments * omega, (1, 0, 0, 0), t).omega
        ).max()
        < 2e-14
    )
    with pytest.raises(ValueError, match="I1 = I2"):
        symmetric_omega((1, 2, 2.5), omega, t)


# on either side of the separatrix
@pytest.mark.parametrize("start", [(0.7, 0.0, 0.9), (1.5, 0.0, 0.2)])
def test_chapter_example_3_6_as_the_chapter_writes_it(start):
    moments, t = np.array([1.0, 2.0, 3.0]), np.linspace(-9.0, 9.0, 7)
    l = moments * start
    omega = jacobi_omega(moments, 0.5 * (l * start).sum(), (l * l).sum(), t)
    assert np.abs(omega - solve_free_top(moments, l, (1, 0, 0, 0), t).omega).max() < 2e-14


def test_chapter_example_3_6_loses_half_the_digits_next_to_the_separatrix():
    """From T and L^2 of a body that begins beside its middle axis, where p t = -K."""
    moments, start, t = np.array([1.0, 2.0, 3.0]), np.array([1e-4, -1.0, 0.0]), 60.0
    l = moments * start
    mc = start[0] ** 2 / (1.0 + start[0] ** 2)  # 1 - B/A, A = 2 (1 + omega_1^2) and B = 2
    assert mc == pytest.approx(1e-8, rel=1e-6)
    rate = np.sqrt((1.0 + start[0] ** 2) / 3.0)
    later = t - float(textbook.elliptic_k(mc=mc)) / rate
    plain = jacobi_omega(moments, 0.5 * (l * start).sum(), (l * l).sum(), later)
    kept = solve_free_top(moments, l, (1, 0, 0, 0), t).omega
    true = np.array(reference.taylor(moments, l, t)[1], float) / moments
    assert 1e-10 < np.abs(plain - true).max() < 1e-8  # measured 8e-10
    assert np.abs(kept - true).max() < 4e-15  # measured 3.5e-16


def test_chapter_example_3_6_constants_and_jacobis_solution_in_omega_and_attitude():
    moments, l = (1.0, 2.0, 3.0), (0.3, 1.1, 0.9)
    motion = solve_free_top(moments, l, (1, 0, 0, 0), 7.0)
    q, end = reference.taylor(moments, l, 7.0)
    assert np.abs(motion.momentum - np.array(end, float)).max() < 1e-14  # 6.9e-16
    assert rotation.attitude_error(motion.attitude, np.array(q, float)) < 1e-14  # 8.3e-16
    assert (motion.momentum**2).sum() == pytest.approx(np.square(l).sum(), rel=2e-15)
    assert (motion.momentum**2 / moments).sum() == pytest.approx(
        (np.square(l) / moments).sum(), rel=2e-15
    )
    # the chapter's side L^2 > 2 T I_2, with mpmath's sn at the chapter's modulus: omega_2 is an
    # amplitude times sn
    energy, square = (np.square(l) / moments).sum(), np.square(l).sum()
    m = (2 - 1) * (energy * 3 - square) / ((3 - 2) * (square - energy * 1))
    assert 0 < m < 1
    rate = np.sqrt((3 - 2) * (square - energy * 1) / (1 * 2 * 3))
    amplitude = np.sqrt((energy * 3 - square) / (2 * (3 - 2)))
    with mp.workdps(30):
        start = mp.ellipf(mp.asin(l[1] / 2 / amplitude), m)
        found = [amplitude * mp.ellipfun("sn", start + s * rate * 7, m=m) for s in (1, -1)]
    assert min(abs(float(x) - motion.omega[1]) for x in found) < 5e-14  # 5.8e-16


def test_chapter_3_36_to_3_39_euler_angles_their_rates_and_energy():
    phi, theta, psi = angles = np.array([0.5, 1.1, -0.8])
    rates = dphi, dtheta, dpsi = np.array([0.7, -0.4, 1.3])
    omega = euler_rates.omega_from_euler_rates(angles, rates)
    wanted = (
        dphi * np.sin(theta) * np.sin(psi) + dtheta * np.cos(psi),
        dphi * np.sin(theta) * np.cos(psi) - dtheta * np.sin(psi),
        dphi * np.cos(theta) + dpsi,
    )
    assert np.abs(omega - wanted).max() < 1e-15  # 1.1e-16
    assert np.abs(euler_rates.euler_rates(angles, omega) - rates).max() < 1e-15  # 1.1e-16
    assert np.abs(rotation.euler(rotation.from_euler(angles)) - angles).max() < 1e-15  # 2.2e-16
    # 4.4e-16
    assert (
        np.abs(
            rotation.matrix(rotation.from_euler(angles))
            - Rotation.from_euler("ZXZ", [phi, theta, psi]).as_matrix()
        ).max()
        < 1e-15
    )
    upright = rotation.from_euler((0.5, 0.0, -0.8))
    # 5.6e-17
    assert rotation.attitude_error(rotation.from_euler(rotation.euler(upright)), upright) < 1e-15
    one, three = 1.0, 0.5
    energy = 0.5 * (
        one * (dtheta**2 + dphi**2 * np.sin(theta) ** 2)
        + three * (dpsi + dphi * np.cos(theta)) ** 2
    )
    assert euler_rates.kinetic_energy_of_euler_rates(
        (one, one, three), angles, rates
    ) == pytest.approx(energy, rel=1e-15)


def test_chapter_3_40_to_3_42_and_example_3_7_heavy_symmetric_top():
    # 50-digit values of theta, phi, psi at t = 3 from their elliptic integrals
    one, three, k = 1.5, 0.5, 2.0
    theta, dtheta, dphi, dpsi = 0.7, 0.3, 0.9, 6.0
    moments = np.array([one, one, three])
    omega = euler_rates.omega_from_euler_rates((0.0, theta, 0.0), (dphi, dtheta, dpsi))
    q = rotation.from_euler((0.0, theta, 0.0))
    end = solve_lagrange_top(moments, k, moments * omega, q, 3.0)
    phi, tilt, psi = rotation.euler(end.attitude)
    assert np.cos(tilt) == pytest.approx(0.8481311842035334004268262, abs=1e-15)
    assert np.remainder(phi - 3.089935055726440571121999 + 1.0, 2 * np.pi) == pytest.approx(
        1.0, abs=1e-14
    )
    assert np.remainder(psi - 17.98891524283163447238032 + 1.0, 2 * np.pi) == pytest.approx(
        1.0, abs=1e-14
    )
    what = analyse_lagrange_top(moments, k, moments * omega, q)
    assert what.period == pytest.approx(5.4677772510163923079, rel=4e-15)
    assert what.p_psi == pytest.approx(three * (dpsi + dphi * np.cos(theta)), rel=1e-15)  # b
    # a
    assert what.p_phi == pytest.approx(
        one * dphi * np.sin(theta) ** 2 + what.p_psi * np.cos(theta), rel=4e-15
    )
    for turning in (what.low, what.high):  # nutation limits: the energy is all potential there
        assert effective_potential(moments, k, what.p_phi, what.p_psi, turning) == pytest.approx(
            float(what.energy), rel=1e-14
        )
    assert what.kind == "monotone precession"

    # and against integration, by the chapter's own (3.42) in theta and by the kernel
    def rhs(t, y):
        u, w = np.cos(y[0]), what.p_phi - what.p_psi * np.cos(y[0])
        s = np.sin(y[0])
        force = w**2 * u / (one * s**3) - w * what.p_psi / (one * s) + k * s
        return [y[1], force / one]

    nutation = solve_ivp(
        rhs, (0.0, 3.0), [theta, dtheta], method="DOP853", rtol=1e-12, atol=1e-13
    ).y[0, -1]
    assert nutation == pytest.approx(tilt, abs=1e-11)
    body = Body.from_moments(tuple(moments), mass=1.0, centre=(0.0, 0.0, k / 9.81))
    scene = Scene(body, (Gravity(9.81),), Start(omega=tuple(omega), attitude=(0.0, theta, 0.0)))
    last = (
        simulate(scene, dt=1e-3, t_end=3.0, members=1, save=("attitude",))
        .attitude.isel(time=-1, member=0)
        .values
    )
    # 1.2e-10
    assert rotation.attitude_error(last, closed_form(scene, 1).motion(3.0).attitude[0]) < 5e-10
    assert rotation.attitude_error(last, end.attitude) < 5e-10  # 1.2e-10
