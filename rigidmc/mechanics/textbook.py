"""The closed forms of omega as TdC writes them; `free_top` serves every case."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.arrays import floats
from rigidmc.errors import SceneError
from rigidmc.mechanics import elliptic


def symmetric_omega(moments: ArrayLike, omega: ArrayLike, t: ArrayLike) -> NDArray[np.float64]:
    """omega (..., 3) at t of a free body with I_1 = I_2, TdC Example 3.5.

    It rotates about axis 3 at the rate (I_3 - I_1) omega_3/I_1. With w = omega(0) and phi = rate t,

        omega_1 = w_1 cos phi - w_2 sin phi,   omega_2 = w_2 cos phi + w_1 sin phi,   omega_3 = w_3

    moments [kg m^2], omega at t = 0 [rad/s] : (..., 3);  t (...) [s]. SceneError if I_1 != I_2.
    """
    moments, omega = floats(moments, "moments", 3), floats(omega, "omega", 3)
    if np.any(moments[..., 0] != moments[..., 1]):
        rule = "Example 3.5 is a body with I1 = I2; free_top takes any"
        raise SceneError("", "moments", moments.tolist(), rule)
    rate = (moments[..., 2] - moments[..., 0]) / moments[..., 0] * omega[..., 2]
    angle = rate * floats(t, "t")
    c, s = np.cos(angle), np.sin(angle)
    one = omega[..., 0] * c - omega[..., 1] * s
    two = omega[..., 1] * c + omega[..., 0] * s
    three = omega[..., 2] + 0.0 * angle
    return np.stack(np.broadcast_arrays(one, two, three), -1)


def jacobi_omega(
    moments: ArrayLike, energy: ArrayLike, square: ArrayLike, t: ArrayLike
) -> NDArray[np.float64]:
    """omega (..., 3) of a free body with I_1 < I_2 < I_3 from its T and L^2, TdC Example 3.6.

    t counts from an instant at which omega_2 = 0 and the other two are positive. If L^2 > 2 T I_2,

        omega_1 = sqrt(A/(I_1 D31)) cn,   omega_2 = sqrt(A/(I_2 D32)) sn,   omega_3 = sqrt(B/(I_3
        D31)) dn

    of the argument p t and the parameter m = (D21 A)/(D32 B), with

        A = 2 T I_3 - L^2,   B = L^2 - 2 T I_1,   D_ij = I_i - I_j,   p = sqrt(D32 B/(I_1 I_2 I_3))

    and otherwise the same with 1 and 3 exchanged. The differences cancel near the separatrix and
    the axes: half the digits are lost at 1 - m = 1e-8, where `free_top` keeps all
    (tests/mechanics/test_textbook.py).

    moments (..., 3) [kg m^2];  energy T (...) [J];  square L^2 (...) [kg^2 m^4/s^2];  t (...) [s].
    SceneError if the moments do not ascend; nan if no motion has these constants.
    """
    moments, energy = floats(moments, "moments", 3), floats(energy, "energy")
    square, t = floats(square, "square"), floats(t, "t")
    low, middle, high = np.moveaxis(moments, -1, 0)
    if not (np.all(low < middle) and np.all(middle < high)):
        rule = "Example 3.6 wants I1 < I2 < I3; free_top takes any"
        raise SceneError("", "moments", moments.tolist(), rule)
    a, b = 2.0 * energy * high - square, square - 2.0 * energy * low
    above = square > 2.0 * energy * middle
    with np.errstate(all="ignore"):
        inner, outer = (middle - low) * a, (high - middle) * b
        m = np.where(above, inner / outer, outer / inner)
        rate = np.sqrt(np.where(above, outer, inner) / low / middle / high)
        sn, cn, dn, _ = elliptic.jacobi(rate * t, m=np.where((a >= 0) & (b >= 0), m, np.nan))
        one, three = np.sqrt(a / low / (high - low)), np.sqrt(b / high / (high - low))
        two = np.sqrt(np.where(above, a / (high - middle), b / (middle - low)) / middle)
    components = one * np.where(above, cn, dn), two * sn, three * np.where(above, dn, cn)
    return np.stack(np.broadcast_arrays(*components), -1)
