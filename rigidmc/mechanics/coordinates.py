"""Generalised coordinates of a body with a fixed point, and torques of potentials.

TdC (3.29)-(3.34). Coordinates are a sequence of Euler angles such as "313", "rotation_vector", or a
function A(q) -> (..., 3, 3) of q (..., n). Potentials are functions V(A) [J] of matrices
(..., 3, 3). Both kinds of functions must accept complex numbers: a complex step of 1e-30
differentiates them, exactly to rounding because it forms no difference. They may use np.sin,
np.sqrt, @ and so on, but not abs, norm, conj or comparisons.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import unknown
from rigidmc.inputs.arrays import Array, floats
from rigidmc.mechanics.euler_angles import SEQUENCES
from rigidmc.mechanics.euler_rates import euler_rate_matrix
from rigidmc.mechanics.rotation import hat, vee

Potential = Callable[[NDArray[Any]], Any]
Coordinates = str | Callable[[NDArray[Any]], ArrayLike]
STEP = 1e-30  # of a coordinate, or of an angle [rad]: its square is negligible compared with 1
NAMED = (*SEQUENCES, "rotation_vector")
_FREE = (
    "it must accept complex numbers and keep them complex: "
    "write np.sqrt((x * x).sum(-1)) for a norm and x * x for abs(x)**2"
)


def matrix(coordinates: Coordinates, q: ArrayLike) -> NDArray[Any]:
    """Return A (..., 3, 3) at real or complex coordinates q (..., n)."""
    q = floats(q, "q", kinds="fiuc")
    if callable(coordinates):
        return np.asarray(coordinates(q))
    if coordinates == "rotation_vector":
        first, second, _ = _exponential_parts(q)
        k = hat(q)
        rotated: NDArray[Any] = np.eye(3) + first * k + second * (k @ k)
        return rotated
    _check_known(coordinates)
    one, two, three = (_about(int(axis) - 1, q[..., k]) for k, axis in enumerate(coordinates))
    product: NDArray[Any] = one @ two @ three
    return product


def rate_matrix(coordinates: Coordinates, q: ArrayLike) -> NDArray[Any]:
    """Return M (..., 3, n) with omega = M(q) q', TdC (3.29): hat of column r is A^T dA/dq_r.

    Named coordinates have a closed form, which also holds at complex q.
    """
    if not callable(coordinates):
        _check_known(coordinates)
        q = floats(q, "q", 3, kinds="fiuc")
        if coordinates != "rotation_vector":
            return euler_rate_matrix(q, coordinates)
        _, second, third = _exponential_parts(q)
        k = hat(q)
        rates: NDArray[Any] = np.eye(3) - second * k + third * (k @ k)
        return rates
    columns = []
    a = matrix(coordinates, floats(q, "q"))
    for slope in _slopes(lambda x: matrix(coordinates, x), q, "coordinates A(q)"):
        columns.append(vee(np.swapaxes(a, -1, -2) @ slope))
    return np.stack(columns, -1)


def identity_residual(m: Callable[[NDArray[Any]], ArrayLike], q: ArrayLike) -> Array:
    """Return dM_is/dq_r - dM_ir/dq_s - eps_ijk M_js M_kr (..., 3, n, n), TdC (3.32).

    It is 0 for every M that belongs to coordinates.

    m : function M(q) that accepts complex numbers, e.g. lambda q: rate_matrix("313", q)
    """
    value = np.asarray(m(floats(q, "q")))
    slopes = np.stack(list(_slopes(m, q, "M(q)")), -1)  # dM_is/dq_r as [..., i, s, r]
    epsilon = np.zeros((3, 3, 3))
    epsilon[[0, 1, 2], [1, 2, 0], [2, 0, 1]], epsilon[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = 1.0, -1.0
    product = np.einsum("ijk,...js,...kr->...isr", epsilon, value, value)
    residual: Array = slopes - np.swapaxes(slopes, -1, -2) - product
    return residual


def generalised_force(potential: Potential, coordinates: Coordinates, q: ArrayLike) -> Array:
    """Return -dV/dq_r (..., n) of a potential V(A) at coordinates q."""

    def energy(x: NDArray[Any]) -> Any:
        return potential(matrix(coordinates, x))

    return -np.stack(list(_slopes(energy, q, "a potential V(A)")), -1)


def torque_of_force(coordinates: Coordinates, q: ArrayLike, force: ArrayLike) -> Array:
    """Return the body torque tau = (M^-1)^T F (..., 3) of generalised forces F (..., 3).

    TdC (3.33), (3.34).
    """
    m = rate_matrix(coordinates, q)
    column = floats(force, "force", 3)[..., None]
    tau: Array = np.linalg.solve(np.swapaxes(m, -1, -2), column)[..., 0]
    return tau


def force_of_torque(coordinates: Coordinates, q: ArrayLike, torque: ArrayLike) -> Array:
    """Return the generalised forces F = M^T tau (..., n) of a body torque tau (..., 3)."""
    m = rate_matrix(coordinates, q)
    force: Array = np.einsum("...ir,...i->...r", m, floats(torque, "torque", 3))
    return force


def torque_of_potential(potential: Potential, attitude: ArrayLike) -> Array:
    """Return the body torque (..., 3) [N m] of a potential, TdC (3.34).

    tau_k = -d/de V(A exp(e hat(e_k))) at e = 0

    attitude : matrices A (..., 3, 3)
    """
    a = floats(attitude, "attitude", 3)

    def energy(e: NDArray[Any]) -> Any:
        return potential(a @ (np.eye(3) + hat(e)))

    return -np.stack(list(_slopes(energy, np.zeros((*a.shape[:-2], 3)), "a potential V(A)")), -1)


def uniform_gravity(mass: float, centre: ArrayLike, g: float = 9.81) -> Potential:
    """Return the potential V = m g z; its torque is -m g r x A^T e_z.

    centre : r (3,) [m], the centre of mass in body axes;  z is its height
    """
    centre = floats(centre, "centre", 3)
    return lambda a: mass * g * (a[..., 2, :] * centre).sum(-1)


def spring(
    stiffness: float, body_point: ArrayLike, space_point: ArrayLike, rest_length: float = 0.0
) -> Potential:
    """Return the potential V = k/2 (|A r - s| - l)^2 of a spring.

    stiffness : k [N/m];  body_point : r [m];  space_point : s [m];  rest_length : l [m]
    """
    body_point = floats(body_point, "body_point", 3)
    space_point = floats(space_point, "space_point", 3)

    def potential(a: NDArray[Any]) -> Any:
        apart = a @ body_point - space_point
        square = (apart * apart).sum(-1)
        if rest_length == 0.0:
            return 0.5 * stiffness * square
        return 0.5 * stiffness * (np.sqrt(square) - rest_length) ** 2

    return potential


def total(*potentials: Potential) -> Potential:
    """Return the sum of potentials."""
    return lambda a: sum(potential(a) for potential in potentials)


def equations_of_motion(
    coordinates: Coordinates, moments: ArrayLike, potential: Potential | None = None
) -> Callable[[float, Array], Array]:
    """Return rhs(t, y), y = (q, q'), for scipy's solve_ivp, for a body in three coordinates.

        q'' = M^-1 (I^-1 (L x omega + tau) - M' q'),   omega = M q',   L = I omega   (TdC (3.29),
        (3.35))

    Singular where det M = 0: sin(theta) = 0 for Euler angles, |q| = 2 pi for rotation vectors.

    moments : principal moments (3,) [kg m^2]
    """
    moments = floats(moments, "moments", 3)

    def rhs(t: float, y: Array) -> Array:
        q, rate = y[:3], y[3:]
        m = rate_matrix(coordinates, q)
        slope, omega = _along(coordinates, q, rate), m @ rate
        tau = 0.0 if potential is None else torque_of_potential(potential, matrix(coordinates, q))
        right = (np.cross(moments * omega, omega) + tau) / moments - slope @ rate
        return np.concatenate([rate, np.linalg.solve(m, right)])

    return rhs


def _along(coordinates: Coordinates, q: Array, rate: Array) -> Array:
    """Return dM/dt (3, n) along q'.

    The steps are relative to the fastest coordinate, and so independent of the unit of time. For
    named coordinates the step is complex. For a user's coordinates it is a real difference of
    order 4: their M already uses a complex step, and two do not nest.
    """
    fastest = float(np.abs(rate).max())
    way = rate / (fastest or 1.0)  # 0 at rest, in any unit
    if not callable(coordinates):
        return fastest * rate_matrix(coordinates, q + 1j * STEP * way).imag / STEP
    # order 4 leaves h^4/30 of the fifth derivative, 3e-14; rounding leaves 1e-16/h, 1e-13
    h = 1e-3
    near = [rate_matrix(coordinates, q + k * h * way) for k in (-2, -1, 1, 2)]
    slope: Array = (8.0 * (near[2] - near[1]) - (near[3] - near[0])) * (fastest / (12.0 * h))
    return slope


def _slopes(
    function: Callable[[NDArray[Any]], ArrayLike], q: ArrayLike, what: str
) -> Iterator[Array]:
    """Yield the derivative of an array function in each coordinate.

    ValueError if a complex step does not differentiate the function.
    """
    q = floats(q, "q")
    for r in range(q.shape[-1]):
        step = np.zeros(q.shape[-1])
        step[r] = 1.0
        try:
            slope = np.asarray(function(q + 1j * STEP * step)).imag / STEP
        except TypeError as error:
            raise ValueError(f"{what} failed on complex numbers ({error}): {_FREE}") from None
        # a second-order difference detects a function that drops the imaginary part; its step 1e-5
        # suits coordinates of order 1, such as angles
        near = (np.real(function(q + 1e-5 * step)) - np.real(function(q - 1e-5 * step))) / 2e-5
        size = np.abs(near).max(initial=0.0) + np.abs(slope).max(initial=0.0)
        size = size + 1e-3 * np.abs(np.real(function(q))).max(initial=0.0)
        if np.abs(near - slope).max(initial=0.0) > 1e-4 * size:
            values = f"{np.ravel(slope)[0]:.3g} instead of {np.ravel(near)[0]:.3g}"
            raise ValueError(f"a complex step does not differentiate {what} ({values}): {_FREE}")
        yield slope


def _exponential_parts(v: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return (sin x/x, (1 - cos x)/x^2, (x - sin x)/x^3) as (..., 1, 1), x = |v|, v real or
    complex.

    Uses series where x is small.
    """
    square = (v * v).sum(-1)[..., None, None]
    # The quotients lose digits: (1 - cos x)/x^2 is 6e-15 off at 0.1 and 2e-11 at 1e-3, its series
    # 1e-16.
    small = np.abs(square) < 1e-2
    x = np.sqrt(np.where(small, 1.0, square))
    s = np.where(small, square, 0.0)
    first = 1 - s / 6 * (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110))))
    second = (1 - s / 12 * (1 - s / 30 * (1 - s / 56 * (1 - s / 90)))) / 2
    third = (1 - s / 20 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110)))) / 6
    return (
        np.where(small, first, np.sin(x) / x),
        np.where(small, second, (1 - np.cos(x)) / x**2),
        np.where(small, third, (x - np.sin(x)) / x**3),
    )


def _about(axis: int, angle: NDArray[Any]) -> NDArray[Any]:
    """Return the matrix of a rotation by a real or complex angle (...) about a coordinate axis."""
    c, s = np.cos(angle)[..., None, None], np.sin(angle)[..., None, None]
    k = hat(np.eye(3)[axis])
    turned: NDArray[Any] = np.eye(3) + s * k + (1.0 - c) * (k @ k)
    return turned


def _check_known(coordinates: str) -> None:
    """Raise SceneError for an unknown name of coordinates."""
    if coordinates not in NAMED:
        raise unknown("coordinates", NAMED, at="coordinates", value=coordinates)
