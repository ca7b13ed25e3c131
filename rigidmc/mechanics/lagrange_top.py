"""The heavy symmetric top (Lagrange's) at any time: TdC Example 3.7 and (3.40)-(3.42), for a million tops at once."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.so3 import conjugate, multiply
from rigidmc.engine.formulas import evaluate
from rigidmc.errors import flag
from rigidmc.mechanics.broadcasting import aligned, spread
from rigidmc.mechanics.free_top import Motion
from rigidmc.mechanics.lagrange_orbit import Orbit, Reached, Started
from rigidmc.mechanics.rotation import quaternion

SAME = 1e-12  # relative to what they are compared with, widths and rates under it count as 0 in naming a kind of motion
_TURNS = {
    1: (0.5, 0.5, 0.5, 0.5),
    2: (0.5, -0.5, -0.5, -0.5),
    3: (1.0, 0.0, 0.0, 0.0),
}  # body axes so that `axis` becomes the third


class Nutation(NamedTuple):
    """What the motion of a Lagrange top is; arrays of the leading shape of the arguments of `lagrange_motion`.

    kind : "at rest", "sleeping", "steady precession", "homoclinic", "pendulum", "cusps", "loops" or
        "monotone precession" ("invalid": bad input)
    p_phi, p_psi : the constants a = L_z and b = L_3 [kg m^2/s] of TdC (3.40), (3.41);  energy : E
        [J], the potential being k cos theta
    low, high : the largest and smallest theta [rad], between which the axis nutates
    m, mc : modulus (parameter) and 1 - m;  rate : p [rad/s], the argument of sn is p t + d
    period : of the nutation, 2 K(m)/p [s]; inf where the axis does not return
    precession, spin : change of phi and of psi in a period [rad]
    """

    kind: np.ndarray
    p_phi: np.ndarray
    p_psi: np.ndarray
    energy: np.ndarray
    low: np.ndarray
    high: np.ndarray
    m: np.ndarray
    mc: np.ndarray
    rate: np.ndarray
    period: np.ndarray
    precession: np.ndarray
    spin: np.ndarray


def with_axis_third(axis, moments, momentum, attitude):
    """moments, momentum (3, ...) and attitude (4, ...) in body axes relabelled cyclically so that `axis` is the third."""
    moments, momentum = np.roll(moments, 3 - axis, 0), np.roll(momentum, 3 - axis, 0)
    return moments, momentum, np.stack(multiply(attitude, _TURNS[axis]))


def _orbits(moments, weight, momentum, attitude, axis):
    """(table of Orbits, arguments as columns (A, C, k, L, attitude), leading shape, bad, which are turned upside down)."""
    if axis not in _TURNS:
        raise ValueError(f"axis = {axis!r}: the symmetry axis is 1, 2 or 3")
    shape, columns = aligned(
        ("moments", moments, 3),
        ("weight", weight, 0),
        ("momentum", momentum, 3),
        ("attitude", quaternion(attitude), 4),
    )
    moments, (weight,), momentum, attitude = columns
    moments, momentum, attitude = with_axis_third(axis, moments, momentum, attitude)
    unequal = np.abs(moments[0] - moments[1]) > 1e-12 * np.abs(moments[0])
    if unequal.any():
        at = int(np.flatnonzero(unequal)[0])
        others = " and ".join(f"I{i}" for i in (1, 2, 3) if i != axis)
        rule = (
            f"a Lagrange top is symmetric about its axis {axis}: {others} must be equal, but are {moments[0, at]:.6g} and "
            f"{moments[1, at]:.6g}; simulate() takes any moments"
        )
        flag(unequal, rule)
    finite = (
        np.isfinite(weight) & np.isfinite(momentum).all(0) & (np.linalg.norm(attitude, axis=0) > 0)
    )
    bad = unequal | ~((moments > 0) & (moments < np.inf)).all(0) | ~finite
    flag(
        bad & ~unequal & ~np.isnan(attitude).any(0),
        "moments must be positive, the rest finite, and a quaternion have a norm",
    )
    below = weight < 0.0  # the same motion upside down: a turn by pi about the space axis x
    attitude = np.where(below, np.stack(multiply((0.0, 1.0, 0.0, 0.0), attitude)), attitude)
    starts = np.concatenate([moments[[0, 2]], np.abs(weight)[None], momentum, attitude])
    starts[:, bad] = np.nan
    return evaluate(Started, len(Orbit._fields), starts).T.copy(), starts, shape, bad, below


def lagrange_top(moments, weight, momentum, attitude, t, axis=3):
    """The exact motion of heavy symmetric tops: Motion(momentum, omega, attitude) at any time, TdC Example 3.7.

    moments : principal moments (..., 3) about the fixed point [kg m^2], the two across the symmetry
        axis equal
    weight : k = m g l (...) [N m], l the distance of the centre of mass from the fixed point along
        +axis; negative: on the other side
    momentum : angular momentum in principal axes (..., 3) at t = 0 [kg m^2/s]
    attitude : quaternions (..., 4) or a scipy Rotation, body to space, at t = 0; upright and
        hanging starts too
    t : times (...) [s];  axis : the symmetry axis, 1, 2 or 3

    Leading shapes broadcast as in `free_top`. What cannot be is nan in the result, with a
    SceneWarning that counts; SceneError where all are bad, e.g. unequal moments, or where shapes do
    not broadcast.
    """
    table, _, tops, _, below = _orbits(moments, weight, momentum, attitude, axis)
    shape, index, times = spread(tops, np.asarray(t, dtype=float))
    values = evaluate(Reached, 7, times[None], table, index)
    q = values[:4]
    with np.errstate(invalid="ignore"):  # what is too fast for numbers is nan
        if below.any():
            q = np.where(below[index], np.stack(multiply((0.0, -1.0, 0.0, 0.0), q)), q)
        if axis != 3:
            q = np.stack(multiply(q, conjugate(_TURNS[axis])))
    momentum = np.moveaxis(np.roll(values[4:], axis - 3, 0).reshape(3, *shape), 0, -1)
    return Motion(
        momentum,
        momentum / np.asarray(moments, dtype=float),
        np.moveaxis(q.reshape(4, *shape), 0, -1),
    )


def lagrange_motion(moments, weight, momentum, attitude, axis=3):
    """Constants, turning angles and kind of motion of heavy symmetric tops: see Nutation. Arguments and errors as `lagrange_top`.

    Loops, cusps and waves are told apart by the sign of phi' = (a - b u)/(1 - u^2) at the turning
    angles.
    """
    table, columns, shape, bad, below = _orbits(moments, weight, momentum, attitude, axis)
    o: Any = Orbit(*table.T)
    (a, c, k, l1, l2, l3), q = columns[:6], columns[6:]
    with np.errstate(all="ignore"):
        fixed = (o.width <= SAME) | (o.v1 == o.v2)
        vertical = fixed & ((o.v1 <= SAME) | (o.y2 <= SAME))
        homoclinic = ~fixed & (o.mc < SAME)
        period = np.where(fixed | (o.mc == 0.0), np.inf, 2.0 * o.quarter / o.rate)
        lower, upper = o.e_minus + o.b * o.v1, o.e_minus + o.b * o.v2
        fast = np.abs(o.e_minus) + np.abs(o.b) * o.v1
        plus = np.where(
            o.direct == 1.0,
            2.0 * (o.quarter * o.h_s / o.h_c - o.plus_all),
            np.pi + 2.0 * o.plus_all,
        )
        sigma = o.drift * period + o.s_plus * plus
        delta = 2.0 * o.s_minus * (o.h_minus * o.quarter + o.minus_all) - o.drift * period
        kinds = {
            "invalid": bad,
            "at rest": fixed & (l1**2 + l2**2 + l3**2 == 0.0),
            "sleeping": vertical,
            "steady precession": fixed,
            "homoclinic": homoclinic,
            "pendulum": np.maximum(np.abs(o.e_plus), np.abs(o.b)) <= SAME * o.rate,
            "cusps": np.abs(upper) <= SAME * fast,
            "loops": lower * upper < 0.0,
        }
        low, high = (
            2.0 * np.arctan2(np.sqrt(v), np.sqrt(y)) for v, y in ((o.v1, o.y1), (o.v2, o.y2))
        )
        height = (q[0] ** 2 + q[3] ** 2 - q[1] ** 2 - q[2] ** 2) / (q**2).sum(0)
        precession = np.where(np.isfinite(period), sigma + delta, np.nan)
        spin = np.where(np.isfinite(period), sigma - delta, np.nan)
        energy = 0.5 * ((l1**2 + l2**2) / a + l3**2 / c) + k * height
    upside = np.where(below, -1.0, 1.0)
    values = (
        np.select(list(kinds.values()), list(kinds), "monotone precession"),
        upside * 0.5 * o.inertia * (o.e_plus + o.e_minus),
        l3,
        energy,
        np.where(below, np.pi - high, low),
        np.where(below, np.pi - low, high),
        o.m,
        o.mc,
        o.rate,
        period,
        upside * precession,
        spin,
    )
    return Nutation(*(np.reshape(v, shape) for v in values))


def effective_potential(moments, weight, p_phi, p_psi, theta):
    """The potential [J] in which theta moves, TdC (3.42): E = I_1 theta'^2/2 + U(theta).

        U = (p_phi - p_psi cos theta)^2/(2 I_1 sin^2 theta) + p_psi^2/(2 I_3) + k cos theta

    moments (..., 3) with I_1 = I_2 [kg m^2];  weight k [N m];  p_phi = L_z, p_psi = L_3 [kg m^2/s];
    theta [rad]. At theta = 0 and pi the limit where it is finite, else inf. All broadcast.
    """
    moments = np.asarray(moments, dtype=float)
    cosine, sine = np.cos(theta), np.sin(theta)
    with np.errstate(all="ignore"):
        across = np.where(
            np.abs(sine) > 0.0,
            (p_phi - p_psi * cosine) ** 2 / sine**2,
            np.where(p_phi == p_psi * cosine, 0.0, np.inf),
        )
    return (
        0.5 * across / moments[..., 0] + 0.5 * np.square(p_psi) / moments[..., 2] + weight * cosine
    )


def steady_precession(moments, weight, omega3, theta):
    """The two rates phi' [rad/s] (slow, fast) of a precession without nutation: I_1 phi'^2 cos theta - I_3 omega_3 phi' + k = 0.

    moments (..., 3) with I_1 = I_2;  weight k [N m];  omega3 [rad/s];  theta [rad]. nan where (I_3
    omega_3)^2 < 4 I_1 k cos theta: there is none; the fast one is inf where cos theta = 0. All
    broadcast.
    """
    moments = np.asarray(moments, dtype=float)
    spin, rise = moments[..., 2] * omega3, moments[..., 0] * np.cos(theta)
    with np.errstate(all="ignore"):
        sum_ = 0.5 * (
            spin + np.copysign(np.sqrt(spin**2 - 4.0 * rise * weight), spin)
        )  # the larger root: no cancellation
        return weight / sum_, sum_ / rise


def sleeping_growth(moments, weight, omega3):
    """Growth rate [1/s] of a small tilt of an upright top: sqrt(4 I_1 k - (I_3 omega_3)^2)/(2 I_1), 0 where it sleeps stably.

    moments (..., 3) with I_1 = I_2;  weight k [N m];  omega3 [rad/s]. All broadcast.
    """
    moments = np.asarray(moments, dtype=float)
    return np.sqrt(
        np.maximum(4.0 * moments[..., 0] * weight - (moments[..., 2] * omega3) ** 2, 0.0)
    ) / (2.0 * moments[..., 0])
