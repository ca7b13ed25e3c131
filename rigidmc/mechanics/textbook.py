"""Closed forms of omega as written in TdC, and elliptic functions of arrays.

`solve_free_top` covers every case; the two closed forms here cover the textbook's cases and test
it.

Elliptic functions accept the parameter m = k^2, 0 <= m <= 1, or its complement mc = 1 - m, and stay
accurate as the modulus tends to 1. Use the complement there: at m = 1 - 1e-14, m holds only two
digits of mc, and scipy.special.ellipj has errors of 2 and more (scipy issue 8480,
tests/mechanics/test_elliptic.py).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import elliprf

from rigidmc.engine.formulas import evaluate
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, floats
from rigidmc.mechanics.jacobi import JacobiAt


def symmetric_omega(moments: ArrayLike, omega: ArrayLike, t: ArrayLike) -> Array:
    """Return omega (..., 3) at t of a free body with I_1 = I_2, TdC Example 3.5.

    omega rotates about axis 3 at the rate (I_3 - I_1) omega_3/I_1. With w = omega(0), phi = rate t,

        omega_1 = w_1 cos phi - w_2 sin phi,   omega_2 = w_2 cos phi + w_1 sin phi,   omega_3 = w_3

    moments [kg m^2], omega at t = 0 [rad/s] : (..., 3);  t (...) [s]. SceneError if I_1 != I_2.
    """
    moments, omega = floats(moments, "moments", 3), floats(omega, "omega", 3)
    if np.any(moments[..., 0] != moments[..., 1]):
        rule = "Example 3.5 needs I1 = I2; solve_free_top accepts any moments"
        raise SceneError(rule, at="moments", value=moments.tolist())
    rate = (moments[..., 2] - moments[..., 0]) / moments[..., 0] * omega[..., 2]
    angle = rate * floats(t, "t")
    c, s = np.cos(angle), np.sin(angle)
    one = omega[..., 0] * c - omega[..., 1] * s
    two = omega[..., 1] * c + omega[..., 0] * s
    three = omega[..., 2] + 0.0 * angle
    return np.stack(np.broadcast_arrays(one, two, three), -1)


def jacobi_omega(moments: ArrayLike, energy: ArrayLike, square: ArrayLike, t: ArrayLike) -> Array:
    """Return omega (..., 3) of a free body with I_1 < I_2 < I_3 from T and L^2, TdC Example 3.6.

    At t = 0, omega_2 = 0 and the other two components are positive. If L^2 > 2 T I_2,

        omega_1 = sqrt(A/(I_1 D31)) cn,   omega_2 = sqrt(A/(I_2 D32)) sn,   omega_3 = sqrt(B/(I_3
        D31)) dn

    of the argument p t and the parameter m = (D21 A)/(D32 B), with

        A = 2 T I_3 - L^2,   B = L^2 - 2 T I_1,   D_ij = I_i - I_j,   p = sqrt(D32 B/(I_1 I_2 I_3))

    and otherwise the same with 1 and 3 exchanged. The differences cancel near the separatrix and
    the axes: at 1 - m = 1e-8 half the digits are lost, whereas `solve_free_top` keeps all
    (tests/mechanics/test_textbook.py).

    moments (..., 3) [kg m^2];  energy T (...) [J];  square L^2 (...) [kg^2 m^4/s^2];  t (...) [s].
    SceneError if the moments do not ascend; nan if no motion has these constants.
    """
    moments, energy = floats(moments, "moments", 3), floats(energy, "energy")
    square, t = floats(square, "square"), floats(t, "t")
    low, middle, high = np.moveaxis(moments, -1, 0)
    if not (np.all(low < middle) and np.all(middle < high)):
        rule = "Example 3.6 needs I1 < I2 < I3; solve_free_top accepts any moments"
        raise SceneError(rule, at="moments", value=moments.tolist())
    a, b = 2.0 * energy * high - square, square - 2.0 * energy * low
    above = square > 2.0 * energy * middle
    with np.errstate(all="ignore"):
        inner, outer = (middle - low) * a, (high - middle) * b
        m = np.where(above, inner / outer, outer / inner)
        rate = np.sqrt(np.where(above, outer, inner) / low / middle / high)
        sn, cn, dn, _ = elliptic_functions(rate * t, m=np.where((a >= 0) & (b >= 0), m, np.nan))
        one, three = np.sqrt(a / low / (high - low)), np.sqrt(b / high / (high - low))
        two = np.sqrt(np.where(above, a / (high - middle), b / (middle - low)) / middle)
    components = one * np.where(above, cn, dn), two * sn, three * np.where(above, dn, cn)
    return np.stack(np.broadcast_arrays(*components), -1)


class EllipticFunctions(NamedTuple):
    """sn, cn, dn and the amplitude am [rad], arrays of one shape."""

    sn: Array
    cn: Array
    dn: Array
    am: Array


def elliptic_functions(
    u: ArrayLike, m: ArrayLike | None = None, mc: ArrayLike | None = None
) -> EllipticFunctions:
    """Return Jacobi's elliptic functions at any u, DLMF 22.2 and 22.16(i); u and m or mc broadcast.

    Errors are below 2e-15 for all 0 <= m <= 1 and |u| <= K(m); for larger |u|, add the error
    4e-16 |u| of u mod 4K. nan if m is not in [0, 1] or u is not finite. mc below 1e-120 counts as
    1e-120 (tests/mechanics/test_elliptic.py).
    """
    m, mc = _complements(m, mc)
    u, m, mc = np.broadcast_arrays(floats(u, "u"), m, mc)
    values = evaluate(JacobiAt, 4, np.stack([u.ravel(), m.ravel(), mc.ravel()]))
    values[:, ~np.isfinite(u.ravel())] = np.nan
    return EllipticFunctions(*values.reshape(4, *u.shape))


def elliptic_k(m: ArrayLike | None = None, mc: ArrayLike | None = None) -> Array:
    """Return K(m) = integral_0^(pi/2) dphi / sqrt(1 - m sin^2 phi), DLMF 19.2.8; inf at m = 1."""
    value: Array = elliprf(0.0, _complements(m, mc)[1], 1.0)
    return value


def _complements(m: ArrayLike | None, mc: ArrayLike | None) -> tuple[Array, Array]:
    """Return (m, mc) from either one, as arrays; nan outside [0, 1]."""
    if (m is None) == (mc is None):
        raise ValueError("give either the parameter m or its complement mc = 1 - m")
    parameter: Any = floats(m if mc is None else mc, "m" if mc is None else "mc")
    parameter = np.where((parameter >= 0.0) & (parameter <= 1.0), parameter, np.nan)
    return (parameter, 1.0 - parameter) if mc is None else (1.0 - parameter, parameter)
