"""Constants of motion beyond energy, |L|^2 and L_z, and motions known in closed form, of heavy tops that are not Lagrange's.

Everywhere c = m g r [N m], the weight times the centre of mass in body axes, and u = A^T e_z, the upward direction there: the energy
is E = 1/2 L.omega + c.u, the torque u x c. All arrays have components last and broadcast.
"""

from typing import NamedTuple

import numpy as np

from rigidmc.errors import SceneError


def kovalevskaya(moments, c, momentum, up):
    """Kovalevskaya's constant |(omega_1 + i omega_2)^2 - (c_1 + i c_2)(u_1 + i u_2)/I_3|^2 [1/s^4] of a top with I_1 = I_2 = 2 I_3 and
    c_3 = 0 (Acta Math. 12 (1889) 177; the sign belongs to V = +c.u).

    moments, c, momentum, up : (..., 3). SceneError for moments or a centre of mass that are not of this kind.
    """
    moments, c, momentum, up = (np.asarray(v, dtype=float) for v in (moments, c, momentum, up))
    _ratio(moments, (2.0, 2.0, 1.0), "a Kovalevskaya top has I1 = I2 = 2 I3")
    _zero(
        c[..., 2], c, "c", "a Kovalevskaya top has its centre of mass in the plane of axes 1 and 2"
    )
    omega = momentum / moments
    spin = (omega[..., 0] + 1j * omega[..., 1]) ** 2
    return (
        np.abs(
            spin - (c[..., 0] + 1j * c[..., 1]) * (up[..., 0] + 1j * up[..., 1]) / moments[..., 2]
        )
        ** 2
    )


def goryachev_chaplygin(moments, c, momentum, up):
    """The constant L_3 (L_1^2 + L_2^2) - (moment I_1) (c_1 L_1 + c_2 L_2) u_3 of a top with I_1 = I_2 = 4 I_3 and c_3 = 0; constant only
    where L_z = L.u = 0 (Goryachev 1900, Chaplygin 1901).

    moments, c, momentum, up : (..., 3). SceneError for moments, a centre of mass or a start (L_z) that are not of this kind.
    """
    moments, c, l, up = (np.asarray(v, dtype=float) for v in (moments, c, momentum, up))
    _ratio(moments, (4.0, 4.0, 1.0), "a Goryachev-Chaplygin top has I1 = I2 = 4 I3")
    _zero(
        c[..., 2],
        c,
        "c",
        "a Goryachev-Chaplygin top has its centre of mass in the plane of axes 1 and 2",
    )
    _zero((l * up).sum(-1), l, "momentum", "Goryachev and Chaplygin's constant needs L_z = L.u = 0")
    return (
        l[..., 2] * (l[..., 0] ** 2 + l[..., 1] ** 2)
        - moments[..., 0] * (c[..., 0] * l[..., 0] + c[..., 1] * l[..., 1]) * up[..., 2]
    )


class Precession(NamedTuple):
    """Grioli's regular precession: the centre of mass the top needs, and the motion. Components in principal axes.

    centre : unit vector (..., 3) from the fixed point to the centre of mass;  rate : nu [rad/s];  omega [rad/s], up : (..., 3)
    """

    centre: np.ndarray
    rate: np.ndarray
    omega: np.ndarray
    up: np.ndarray


def grioli(moments, weight, t):
    """Grioli's regular precession of an asymmetric heavy top (Ann. Mat. Pura Appl. 26 (1947) 271): an exact solution.

        omega = nu (cos p x1 + sin p x2 + e),   u = (al cos p + be sin^2 p) x1 + (al sin p - be sin p cos p) x2 + be cos p e,   p = -nu t

    with I_1 < I_2 < I_3, e = (e1, 0, e3) = (sqrt((I2 - I1)/(I3 - I1)), 0, sqrt((I3 - I2)/(I3 - I1))) the direction of the centre of mass,
    x1 = (e3, 0, -e1), x2 = (0, 1, 0), J = I1 + I3 - I2, D = e1 e3 (I1 - I3), nu^2 = k/sqrt(J^2 + D^2), al = nu^2 J/k, be = -nu^2 D/k.

    moments (..., 3) ascending [kg m^2];  weight k = m g |r| [N m];  t [s]. SceneError for moments that do not ascend.
    """
    moments, k, t = (
        np.asarray(moments, dtype=float),
        np.asarray(weight, dtype=float),
        np.asarray(t, dtype=float),
    )
    low, middle, high = np.moveaxis(moments, -1, 0)
    if not (np.all(low < middle) and np.all(middle < high) and np.all(k > 0)):
        raise SceneError(
            "", "moments", moments.tolist(), "Grioli's precession needs I1 < I2 < I3 and a weight"
        )
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
    return Precession(
        e, rate, omega, (al * cos + be * sin**2) * x1 + (al - be * cos) * sin * x2 + be * cos * e
    )


def staude(moments, c, up):
    """omega^2 [rad^2/s^2] of the permanent rotation about a vertical axis `up` in the body, and how far the axis is from allowing one.

    A top turns steadily about its vertical u iff I u, c and u lie in a plane: omega^2 (u x I u) = u x c (Staude, J. reine angew. Math.
    113 (1894) 318). Returns (omega^2, defect): the defect is |u . (I u x c)|/(|I u| |c|), 0 on Staude's cone; omega^2 < 0: no rotation.
    nan where I u is parallel to u: with c parallel too, any rate will do.

    moments, c, up : (..., 3), up of length 1.
    """
    moments, c, up = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (moments, c, up)))
    inertia = moments * up
    arm, pull = np.cross(up, inertia), np.cross(up, c)
    with np.errstate(all="ignore"):
        square = (arm * pull).sum(-1) / (arm * arm).sum(-1)
        size = np.linalg.norm(inertia, axis=-1) * np.linalg.norm(c, axis=-1)
        return square, np.abs((up * np.cross(inertia, c)).sum(-1)) / size


def _ratio(moments, shape, rule):
    wanted = moments[..., 2:] * np.array(shape)
    if not np.all(np.abs(moments - wanted) <= 1e-12 * wanted):
        raise SceneError("", "moments", np.asarray(moments).tolist(), rule)


def _zero(part, whole, key, rule):
    if not np.all(np.abs(part) <= 1e-9 * np.linalg.norm(whole, axis=-1)):
        raise SceneError("", key, np.asarray(whole).tolist(), rule)
