"""The chapter's own closed forms of omega, as it writes them: what a reader looks for beside `free_top`, which serves every case."""

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.mechanics import elliptic


def symmetric_omega(moments, omega, t):
    """omega (..., 3) at t of a free body with I_1 = I_2, TdC Example 3.5: it turns about axis 3 at the rate (I_3 - I_1) omega_3/I_1.

        omega_1 = w_1 cos - w_2 sin,   omega_2 = w_2 cos + w_1 sin   of that rate times t,   omega_3 = w_3

    moments, omega at t = 0 : (..., 3);  t (...). SceneError for I_1 != I_2.
    """
    moments, omega = np.asarray(moments, dtype=float), np.asarray(omega, dtype=float)
    if np.any(moments[..., 0] != moments[..., 1]):
        raise SceneError(
            "",
            "moments",
            moments.tolist(),
            "Example 3.5 is a body with I1 = I2; free_top takes any",
        )
    angle = (
        (moments[..., 2] - moments[..., 0])
        / moments[..., 0]
        * omega[..., 2]
        * np.asarray(t, dtype=float)
    )
    c, s = np.cos(angle), np.sin(angle)
    one, two, three = np.broadcast_arrays(
        omega[..., 0] * c - omega[..., 1] * s,
        omega[..., 1] * c + omega[..., 0] * s,
        omega[..., 2] + 0.0 * angle,
    )
    return np.stack([one, two, three], -1)


def jacobi_omega(moments, energy, square, t):
    """omega (..., 3) of a free body with I_1 < I_2 < I_3 from its constants T and L^2, TdC Example 3.6, at the time t from an instant
    where omega_2 = 0 and the other two are positive.

        L^2 > 2 T I_2:  omega = (sqrt(A/(I_1 D31)) cn, sqrt(A/(I_2 D32)) sn, sqrt(B/(I_3 D31)) dn)   of p t and m = (D21 A)/(D32 B),
        A = 2 T I_3 - L^2,   B = L^2 - 2 T I_1,   D_ij = I_i - I_j,   p = sqrt(D32 B/(I_1 I_2 I_3))

    and with 1 and 3 exchanged on the other side. energy T [J], square L^2 (...). The differences cancel near the separatrix and the
    axes: half the digits are gone at 1 - m = 1e-8, where `free_top` keeps all. SceneError for moments that do not ascend; nan for
    constants that no motion has.
    """
    moments, energy, square, t = (
        np.asarray(moments, dtype=float),
        np.asarray(energy, float),
        np.asarray(square, float),
        np.asarray(t, float),
    )
    low, middle, high = np.moveaxis(moments, -1, 0)
    if not (np.all(low < middle) and np.all(middle < high)):
        raise SceneError(
            "", "moments", moments.tolist(), "Example 3.6 wants I1 < I2 < I3; free_top takes any"
        )
    a, b = 2.0 * energy * high - square, square - 2.0 * energy * low
    above = square > 2.0 * energy * middle
    with np.errstate(all="ignore"):
        inner, outer = (middle - low) * a, (high - middle) * b
        m = np.where(above, inner / outer, outer / inner)
        rate = np.sqrt(np.where(above, outer, inner) / low / middle / high)
        sn, cn, dn, _ = elliptic.jacobi(rate * t, m=np.where((a >= 0) & (b >= 0), m, np.nan))
        one, three = np.sqrt(a / low / (high - low)), np.sqrt(b / high / (high - low))
        two = np.sqrt(np.where(above, a / (high - middle), b / (middle - low)) / middle)
    return np.stack(
        np.broadcast_arrays(
            one * np.where(above, cn, dn), two * sn, three * np.where(above, dn, cn)
        ),
        -1,
    )
