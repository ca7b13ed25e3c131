"""Heavy tops other than Lagrange's: additional constants of motion, and motions in closed form.

Throughout, c = m g r [N m] is the weight times the centre of mass in body axes, and u = A^T e_z the
upward direction in body axes. The energy is E = 1/2 L.omega + c.u, the torque u x c. All arrays
have components last and broadcast.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, floats


def kovalevskaya(moments: ArrayLike, c: ArrayLike, momentum: ArrayLike, up: ArrayLike) -> Array:
    """Return Kovalevskaya's constant [1/s^4] of a top with I_1 = I_2 = 2 I_3 and c_3 = 0.

        |(omega_1 + i omega_2)^2 - (c_1 + i c_2)(u_1 + i u_2)/I_3|^2

    Source: Acta Math. 12 (1889) 177; the sign holds for V = +c.u.

    moments, c, momentum, up : (..., 3). SceneError for other moments or centres of mass.
    """
    moments, c = floats(moments, "moments", 3), floats(c, "c", 3)
    momentum, up = floats(momentum, "momentum", 3), floats(up, "up", 3)
    _check_ratio(moments, (2.0, 2.0, 1.0), "a Kovalevskaya top has I1 = I2 = 2 I3")
    rule = "a Kovalevskaya top has its centre of mass in the plane of axes 1 and 2"
    _check_zero(c[..., 2], c, "c", rule)
    omega = momentum / moments
    spin = (omega[..., 0] + 1j * omega[..., 1]) ** 2
    pull = (c[..., 0] + 1j * c[..., 1]) * (up[..., 0] + 1j * up[..., 1]) / moments[..., 2]
    constant: Array = np.abs(spin - pull) ** 2
    return constant


def goryachev_chaplygin(
    moments: ArrayLike, c: ArrayLike, momentum: ArrayLike, up: ArrayLike
) -> Array:
    """Return Goryachev and Chaplygin's constant of a top with I_1 = I_2 = 4 I_3 and c_3 = 0.

        L_3 (L_1^2 + L_2^2) - I_1 (c_1 L_1 + c_2 L_2) u_3

    It is constant only if L_z = L.u = 0 (Goryachev 1900, Chaplygin 1901).

    moments, c, momentum, up : (..., 3). SceneError for other moments, centres of mass or L_z.
    """
    moments, c = floats(moments, "moments", 3), floats(c, "c", 3)
    l, up = floats(momentum, "momentum", 3), floats(up, "up", 3)
    _check_ratio(moments, (4.0, 4.0, 1.0), "a Goryachev-Chaplygin top has I1 = I2 = 4 I3")
    rule = "a Goryachev-Chaplygin top has its centre of mass in the plane of axes 1 and 2"
    _check_zero(c[..., 2], c, "c", rule)
    rule = "Goryachev and Chaplygin's constant needs L_z = L.u = 0"
    _check_zero((l * up).sum(-1), l, "momentum", rule)
    pull = moments[..., 0] * (c[..., 0] * l[..., 0] + c[..., 1] * l[..., 1]) * up[..., 2]
    constant: Array = l[..., 2] * (l[..., 0] ** 2 + l[..., 1] ** 2) - pull
    return constant


class SteadyPrecession(NamedTuple):
    """Grioli's regular precession: the required centre of mass, and the motion.

    Components are in principal axes. centre : unit vector (..., 3) from the fixed point to the
        centre of mass;  rate : nu [rad/s];  omega [rad/s], up : (..., 3)
    """

    centre: Array
    rate: Array
    omega: Array
    up: Array


def grioli(moments: ArrayLike, weight: ArrayLike, t: ArrayLike) -> SteadyPrecession:
    """Return Grioli's regular precession of an asymmetric heavy top, an exact solution.

        omega = nu (cos p x1 + sin p x2 + e),   p = -nu t,
        u = (al cos p + be sin^2 p) x1 + (al sin p - be sin p cos p) x2 + be cos p e

    with I_1 < I_2 < I_3, the direction of the centre of mass
    e = (e1, 0, e3) = (sqrt((I2 - I1)/(I3 - I1)), 0, sqrt((I3 - I2)/(I3 - I1))), x1 = (e3, 0, -e1),
    x2 = (0, 1, 0), J = I1 + I3 - I2, D = e1 e3 (I1 - I3), nu^2 = k/sqrt(J^2 + D^2), al = nu^2 J/k,
    be = -nu^2 D/k.

    Source: Ann. Mat. Pura Appl. 26 (1947) 271.

    moments (..., 3) ascending [kg m^2];  weight k = m g |r| [N m];  t [s]. SceneError for moments
    that do not ascend.
    """
    moments, k = floats(moments, "moments", 3), floats(weight, "weight")
    t = floats(t, "t")
    low, middle, high = np.moveaxis(moments, -1, 0)
    if not (np.all(low < middle) and np.all(middle < high) and np.all(k > 0)):
        rule = "Grioli's precession needs I1 < I2 < I3 and a positive weight"
        raise SceneError(rule, at="moments", value=moments.tolist())
    e1, e3 = np.sqrt((middle - low) / (high - low)), np.sqrt((high - middle) / (high - low))
    j, d = low + high - middle, e1 * e3 * (low - high)
    rate = np.sqrt(k / np.hypot(j, d))
    al, be = rate**2 * j / k, -(rate**2) * d / k
    zero = np.zeros_like(e1 + t)
    e, x1, x2 = (
        np.stack(np.broadcast_arrays(*v, zero)[:3], -1)
        for v in ((e1, zero, e3), (e3, zero, -e1), (zero, zero + 1.0, zero))
    )
    cos, sin = np.cos(rate * t)[..., None], -np.sin(rate * t)[..., None]
    al, be = np.asarray(al)[..., None], np.asarray(be)[..., None]
    omega = np.asarray(rate)[..., None] * (cos * x1 + sin * x2 + e)
    up = (al * cos + be * sin**2) * x1 + (al - be * cos) * sin * x2 + be * cos * e
    return SteadyPrecession(e, rate, omega, up)


def _check_ratio(moments: Array, ratio: tuple[float, float, float], rule: str) -> None:
    """Raise SceneError for moments not in the ratio (a, b, 1)."""
    wanted = moments[..., 2:] * np.array(ratio)
    if not np.all(np.abs(moments - wanted) <= 1e-12 * wanted):
        raise SceneError(rule, at="moments", value=np.asarray(moments).tolist())


def _check_zero(part: Array, vector: Array, key: str, rule: str) -> None:
    """Raise SceneError for a part that exceeds 1e-9 of the vector `whole`."""
    if not np.all(np.abs(part) <= 1e-9 * np.linalg.norm(vector, axis=-1)):
        raise SceneError(rule, at=key, value=np.asarray(vector).tolist())
