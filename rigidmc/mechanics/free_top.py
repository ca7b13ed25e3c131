"""The free top at any time: momentum, angular velocity and attitude in closed form, for a million bodies at once."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.formulas import evaluate
from rigidmc.errors import flag
from rigidmc.mechanics.broadcasting import aligned, spread
from rigidmc.mechanics.free_orbit import Orbit, Phase, Reached, Started
from rigidmc.mechanics.rotation import quaternion


class Motion(NamedTuple):
    """momentum (..., 3) [kg m^2/s] and omega (..., 3) [rad/s] in principal axes, attitude (..., 4), body to space."""

    momentum: np.ndarray
    omega: np.ndarray
    attitude: np.ndarray


class Kind(NamedTuple):
    """What a free motion is; arrays of the leading shape of the arguments of `free_motion`.

    kind : "invalid", "rest", "permanent rotation", "symmetric precession", "separatrix", "about the
        largest moment" or "about the smallest"
    axis : 1, 2 or 3 (0: invalid), the principal axis about which the momentum circles
    m, mc : modulus (parameter m = k^2) and 1 - m, from sums: no digit of mc cancels
    rate : lambda [rad/s], the argument of sn, cn, dn is lambda t
    period : 4 K(m)/lambda [s], of momentum and omega; inf on a separatrix and where nothing moves
    flip_interval : 2 K(m)/lambda [s], between sign changes of the middle component; nan for
        symmetric bodies
    turn : the angle about the momentum by which a period turns the attitude [rad], not reduced
    solid_angle : swept by the momentum in the body in a period, oriented, modulo 4 pi: turn = 2 T
        period/|L| - solid_angle
        (Montgomery, Am. J. Phys. 59 (1991) 394)
    phase : where on its curve the momentum is, lambda (t - t0)/(4 K) modulo 1: the component of the
        middle moment is 0 at 0 and 1/2; nan
        where nothing moves
    """

    kind: np.ndarray
    axis: np.ndarray
    m: np.ndarray
    mc: np.ndarray
    rate: np.ndarray
    period: np.ndarray
    flip_interval: np.ndarray
    turn: np.ndarray
    solid_angle: np.ndarray
    phase: np.ndarray


def _orbits(moments, momentum, attitude):
    """(table of Orbits, one row per top; leading shape; which rows are bad)."""
    shape, (moments, momentum, attitude) = aligned(
        ("moments", moments, 3), ("momentum", momentum, 3), ("attitude", quaternion(attitude), 4)
    )
    bad = (
        ~((moments > 0) & (moments < np.inf)).all(0)
        | ~np.isfinite(momentum).all(0)
        | ~(np.linalg.norm(attitude, axis=0) > 0)
    )
    flag(
        bad & ~np.isnan(attitude).any(0),
        "moments must be positive, momenta finite, and a quaternion have a norm",
    )
    columns = np.concatenate([moments, momentum, attitude])
    columns[:, bad] = np.nan
    table = evaluate(Started, len(Orbit._fields), columns).T.copy()
    table[:, Orbit._fields.index("phase")] = evaluate(Phase, 1, table.T)[0]
    return table, shape, bad


def free_top(moments, momentum, attitude, t):
    """The exact motion of free rigid bodies: Motion(momentum, omega, attitude) at any time, TdC (3.35) and Example 3.6.

    moments : principal moments (..., 3) [kg m^2], in any order; any positive ones, also those that
        no body has (published problems do)
    momentum : angular momentum in principal axes (..., 3) at t = 0 [kg m^2/s]
    attitude : quaternions (..., 4) or a scipy Rotation, body to space, at t = 0
    t : times (...) [s]: sparse, huge, negative

    Leading shapes broadcast: moments (B, 1, 3) and t (T,) give (B, T). A body or start that cannot
    be is nan in the result, with a SceneWarning that counts them; SceneError where all are, or
    where shapes do not broadcast.
    """
    table, bodies, _ = _orbits(moments, momentum, attitude)
    t = np.asarray(t, dtype=float)
    shape, index, times = spread(bodies, t)
    values = evaluate(Reached, 7, times[None], table, index).reshape(7, *shape)
    attitude, momentum = np.moveaxis(values[:4], 0, -1), np.moveaxis(values[4:], 0, -1)
    return Motion(momentum, momentum / np.asarray(moments, dtype=float), attitude)


_AXES = np.array([[1, 3], [3, 2], [2, 1]])  # the body's axes that `shift` made axes 1 and 3


def free_motion(moments, momentum):
    """What the free motion of principal moments (..., 3) from a momentum (..., 3) is: see Kind. Errors as `free_top`."""
    table, shape, bad = _orbits(moments, momentum, (1.0, 0.0, 0.0, 0.0))
    o: Any = Orbit(*table.T)
    _, (moments, l) = aligned(("moments", moments, 3), ("momentum", momentum, 3))
    axis = np.where(bad, 0, _AXES[np.nan_to_num(o.shift).astype(int), (o.about == 3.0).astype(int)])
    with np.errstate(over="ignore"):
        forces = [
            (moments[i] - moments[j]) * l[i] * l[j] for i, j in ((1, 2), (2, 0), (0, 1))
        ]  # of L x omega, but for moments
    permanent = ~np.any(forces, axis=0)
    symmetric = (moments == np.roll(moments, 1, 0)).any(0)
    largest = np.take_along_axis(moments, np.maximum(axis, 1)[None] - 1, 0)[0] == moments.max(0)
    kinds = {
        "invalid": bad,
        "rest": o.size == 0.0,
        "permanent rotation": permanent,
        "symmetric precession": symmetric,
        "separatrix": o.mc == 0.0,
        "about the largest moment": largest,
    }
    with np.errstate(all="ignore"):
        period = np.where((o.mc > 0.0) & ~permanent, 4.0 * o.quarter / o.rate, np.inf)
        turn = np.where(
            np.isfinite(period),
            o.spin * period + o.sense * (4.0 * o.swing + 2.0 * np.pi * o.direct),
            np.nan,
        )
        twice_energy = (l * l / moments).sum(0)
        phase = np.where(
            np.isfinite(period), np.remainder(o.offset / (4.0 * o.quarter), 1.0), np.nan
        )
        solid = np.remainder(twice_energy / o.size * period - turn, 4.0 * np.pi)
    period[bad] = np.nan
    values = (
        np.select(list(kinds.values()), list(kinds), "about the smallest moment"),
        axis,
        o.m,
        o.mc,
        o.rate,
        period,
        np.where(symmetric, np.nan, 0.5 * period),
        turn,
        solid,
        phase,
    )
    return Kind(*(np.reshape(v, shape) for v in values))
