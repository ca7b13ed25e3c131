"""Generalised coordinates of a rigid body with a fixed point, TdC (3.29)-(3.34), and the torques of potentials.

Coordinates are a word, "zxz", "zyz" or "rotation_vector", or a function A(q) -> (..., 3, 3) of q
(..., n) that takes complex numbers. Potentials are functions V(A) [J] of matrices (..., 3, 3) that
take complex numbers. Both are differentiated by a complex step of 1e-30: exact to rounding, with no
difference taken. So they use np.sin, np.sqrt, @, ... but not abs, norm, conj, or comparisons.
"""

from collections.abc import Callable

import numpy as np

from rigidmc.errors import unknown
from rigidmc.mechanics.rotation import euler_rate_matrix, hat

STEP = 1e-30
NAMED = ("zxz", "zyz", "rotation_vector")
_FREE = "it must take complex numbers and pass them on: write np.sqrt((x * x).sum(-1)) for a norm and x * x for abs(x)**2"


def matrix(coordinates, q):
    """A (..., 3, 3) at coordinates q (..., n); complex q too."""
    q = np.asarray(q)
    if callable(coordinates):
        return np.asarray(coordinates(q))
    if coordinates == "rotation_vector":
        first, second, _ = _exponential_parts(q)
        k = hat(q)
        return np.eye(3) + first * k + second * (k @ k)
    _known(coordinates)
    phi, theta, psi = np.moveaxis(q, -1, 0)
    return _about(2, phi) @ _about(0 if coordinates == "zxz" else 1, theta) @ _about(2, psi)


def rate_matrix(coordinates, q):
    """M (..., 3, n) with omega = M(q) q', TdC (3.29): hat of column r is A^T dA/dq_r. Closed forms for the named coordinates."""
    if not callable(coordinates):
        _known(coordinates)
        q = np.asarray(q)
        if coordinates != "rotation_vector":
            return euler_rate_matrix(q, coordinates)
        _, second, third = _exponential_parts(q)
        k = hat(q)
        return np.eye(3) - second * k + third * (k @ k)
    columns = []
    a = matrix(coordinates, np.asarray(q, dtype=float))
    for slope in _slopes(lambda x: matrix(coordinates, x), q, "coordinates A(q)"):
        m = np.swapaxes(a, -1, -2) @ slope
        columns.append(
            0.5
            * np.stack(
                [
                    m[..., 2, 1] - m[..., 1, 2],
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] - m[..., 0, 1],
                ],
                -1,
            )
        )
    return np.stack(columns, -1)


def identity_residual(m, q):
    """dM_is/dq_r - dM_ir/dq_s - eps_ijk M_js M_kr (..., 3, n, n), which is 0 for every M that belongs to coordinates, TdC (3.32).

    m : function M(q), e.g. lambda q: rate_matrix("zxz", q); it must take complex numbers
    """
    value = np.asarray(m(np.asarray(q, dtype=float)))
    slopes = np.stack(list(_slopes(m, q, "M(q)")), -1)  # dM_is/dq_r as [..., i, s, r]
    epsilon = np.zeros((3, 3, 3))
    epsilon[[0, 1, 2], [1, 2, 0], [2, 0, 1]], epsilon[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = 1.0, -1.0
    return (
        slopes
        - np.swapaxes(slopes, -1, -2)
        - np.einsum("ijk,...js,...kr->...isr", epsilon, value, value)
    )


def generalised_force(potential, coordinates, q):
    """-dV/dq_r (..., n) of a potential V(A) at coordinates q."""
    return -np.stack(
        list(_slopes(lambda x: potential(matrix(coordinates, x)), q, "a potential V(A)")), -1
    )


def torque_of_force(coordinates, q, force):
    """Body torque tau = (M^-1)^T F (..., 3) of generalised forces (..., 3), TdC (3.33), (3.34)."""
    m = rate_matrix(coordinates, q)
    return np.linalg.solve(np.swapaxes(m, -1, -2), np.asarray(force, dtype=float)[..., None])[
        ..., 0
    ]


def force_of_torque(coordinates, q, torque):
    """Generalised forces F = M^T tau (..., n) of a body torque (..., 3)."""
    return np.einsum("...ir,...i->...r", rate_matrix(coordinates, q), torque)


def torque(potential, attitude):
    """Body torque (..., 3) [N m] of a potential: tau_k = -d/de V(A exp(e hat(e_k))) at e = 0, TdC (3.34).

    attitude : matrices A (..., 3, 3)
    """
    a = np.asarray(attitude, dtype=float)
    return -np.stack(
        list(
            _slopes(
                lambda e: potential(a @ (np.eye(3) + hat(e))),
                np.zeros((*a.shape[:-2], 3)),
                "a potential V(A)",
            )
        ),
        -1,
    )


def uniform_gravity(mass, centre, g=9.81) -> Callable:
    """V = m g z of the centre of mass (3,) [m] in body axes; torque -m g r x A^T e_z."""
    centre = np.asarray(centre, dtype=float)
    return lambda a: mass * g * (a[..., 2, :] * centre).sum(-1)


def spring(stiffness, body_point, space_point, rest_length=0.0) -> Callable:
    """V = k/2 (|A r - s| - l)^2 of a spring [N/m] from a point of the body to a point of space [m]."""
    body_point, space_point = (
        np.asarray(body_point, dtype=float),
        np.asarray(space_point, dtype=float),
    )

    def potential(a):
        apart = a @ body_point - space_point
        square = (apart * apart).sum(-1)
        if rest_length == 0.0:
            return 0.5 * stiffness * square
        return 0.5 * stiffness * (np.sqrt(square) - rest_length) ** 2

    return potential


def total(*potentials) -> Callable:
    """The sum of potentials."""
    return lambda a: sum(potential(a) for potential in potentials)


def equations_of_motion(coordinates, moments, potential=None):
    """rhs(t, y) for scipy's solve_ivp, y = (q, q'), of a body with principal moments (3,) in three coordinates:

        q'' = M^-1 (I^-1 (L x omega + tau) - M' q'),   omega = M q',   L = I omega          (TdC
        (3.29), (3.35))

    Singular where det M = 0: sin(theta) = 0 of Euler angles, |q| = 2 pi of rotation vectors.
    """
    moments = np.asarray(moments, dtype=float)

    def rhs(t, y):
        q, rate = y[:3], y[3:]
        m = rate_matrix(coordinates, q)
        turning = (
            rate_matrix(coordinates, q + 1j * STEP * rate).imag / STEP
            if not callable(coordinates)
            else _along(coordinates, q, rate)
        ) @ rate
        omega = m @ rate
        tau = 0.0 if potential is None else torque(potential, matrix(coordinates, q))
        return np.concatenate(
            [rate, np.linalg.solve(m, (np.cross(moments * omega, omega) + tau) / moments - turning)]
        )

    return rhs


def _along(coordinates, q, rate):
    """dM/dt (3, n) of a user's coordinates along q', by a difference of order 4: M is itself a complex step, and two do not nest."""
    h = 1e-3 / max(1.0, float(np.abs(rate).max()))
    near = [rate_matrix(coordinates, q + k * h * rate) for k in (-2, -1, 1, 2)]
    return (8.0 * (near[2] - near[1]) - (near[3] - near[0])) / (12.0 * h)


def _slopes(function, q, what):
    """The derivative of an array function in each coordinate; ValueError where it cannot be differentiated by a complex step."""
    q = np.asarray(q, dtype=float)
    for r in range(q.shape[-1]):
        step = np.zeros(q.shape[-1])
        step[r] = 1.0
        try:
            slope = np.asarray(function(q + 1j * STEP * step)).imag / STEP
        except TypeError as error:
            raise ValueError(f"{what} failed on complex numbers ({error}): {_FREE}") from None
        # a difference of order 2 tells a function that drops the imaginary part
        near = (np.real(function(q + 1e-5 * step)) - np.real(function(q - 1e-5 * step))) / 2e-5
        size = (
            np.abs(near).max(initial=0.0)
            + np.abs(slope).max(initial=0.0)
            + 1e-3 * np.abs(np.real(function(q))).max(initial=0.0)
        )
        if np.abs(near - slope).max(initial=0.0) > 1e-4 * size:
            raise ValueError(
                f"{what} is not differentiated by a complex step ({np.ravel(slope)[0]:.3g} for {np.ravel(near)[0]:.3g}): {_FREE}"
            )
        yield slope


def _exponential_parts(v):
    """(sin x/x, (1 - cos x)/x^2, (x - sin x)/x^3) as (..., 1, 1), x = |v|; by series for x < 0.1; complex v too."""
    square = (v * v).sum(-1)[..., None, None]
    small = np.abs(square) < 1e-2
    x = np.sqrt(np.where(small, 1.0, square))
    s = np.where(small, square, 0.0)
    return (
        np.where(
            small,
            1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)))),
            np.sin(x) / x,
        ),
        np.where(
            small,
            (1 - s / 12 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90)))) / 2,
            (1 - np.cos(x)) / x**2,
        ),
        np.where(
            small,
            (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)))) / 6,
            (x - np.sin(x)) / x**3,
        ),
    )


def _about(axis, angle):
    """The turn by an angle (...) about a coordinate axis, complex too."""
    c, s = np.cos(angle)[..., None, None], np.sin(angle)[..., None, None]
    k = hat(np.eye(3)[axis])
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)


def _known(coordinates):
    if coordinates not in NAMED:
        raise unknown("", "coordinates", coordinates, "coordinates", NAMED)
