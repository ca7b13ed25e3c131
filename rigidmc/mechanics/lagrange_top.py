"""The heavy symmetric top (Lagrange's) at any time, TdC Example 3.7 and (3.40)-(3.42)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.engine.formulas import evaluate
from rigidmc.inputs.arrays import Array, Bools, Shape, broadcast_arguments, floats
from rigidmc.mechanics.free_top import Motion, spread
from rigidmc.mechanics.lagrange_limits import TINY
from rigidmc.mechanics.lagrange_orbit import (
    LagrangeOrbit,
    LagrangeOrbitFormula,
    LagrangeStateFormula,
)
from rigidmc.mechanics.lagrange_steady import unequal_moments
from rigidmc.mechanics.rotation import Attitude, quaternion
from rigidmc.physics.dynamics.quaternions import conjugate, multiply

# smaller relative widths and rates count as 0 in the classification of a motion
SAME = 1e-12
# {symmetry axis: rotation to body axes with this axis third}
_TURNS = {1: (0.5, 0.5, 0.5, 0.5), 2: (0.5, -0.5, -0.5, -0.5), 3: (1.0, 0.0, 0.0, 0.0)}


class NutationRange(NamedTuple):
    """Classification of a Lagrange top's motion; `analyse_lagrange_top` describes the fields."""

    kind: NDArray[np.str_]
    p_phi: Array
    p_psi: Array
    energy: Array
    low: Array
    high: Array
    m: Array
    mc: Array
    rate: Array
    period: Array
    precession: Array
    spin: Array


def with_axis_third(
    axis: int, moments: Array, momentum: Array, attitude: Array
) -> tuple[Array, Array, Array]:
    """Relabel the body axes cyclically so that `axis` becomes the third.

    moments, momentum (3, ...), attitude (4, ...)
    """
    moments, momentum = np.roll(moments, 3 - axis, 0), np.roll(momentum, 3 - axis, 0)
    return moments, momentum, np.stack(multiply(attitude, _TURNS[axis]))


def _orbits(
    moments: ArrayLike, weight: ArrayLike, momentum: ArrayLike, attitude: Attitude, axis: int
) -> tuple[Array, Array, Shape, Bools, Bools]:
    """Return (table, columns, leading shape, bad, below).

    table : LagrangeOrbits, one row per top;  columns : A, C, k, L, attitude (10, n);  bad : mask of
        impossible tops;  below : mask of tops turned upside down because their weight is negative
    """
    if axis not in _TURNS:
        raise ValueError(f"axis = {axis!r}: the symmetry axis is 1, 2 or 3")
    shape, columns, bad = broadcast_arguments(
        ("moments", moments, 3),
        ("weight", weight, 0),
        ("momentum", momentum, 3),
        ("attitude", quaternion(attitude), 4),
    )
    i, (k,), l, q = columns
    i, l, q = with_axis_third(axis, i, l, q)
    bad |= unequal_moments(i[0], i[1], axis)
    below = k < 0.0  # the same motion upside down: rotated by pi about the space axis x
    q = np.where(below, np.stack(multiply((0.0, 1.0, 0.0, 0.0), q)), q)
    rows = np.concatenate([i[[0, 2]], np.abs(k)[None], l, q])
    rows[:, bad] = np.nan
    table = evaluate(LagrangeOrbitFormula(), len(LagrangeOrbit._fields), rows).T.copy()
    table[bad] = np.nan
    return table, rows, shape, bad, below


def solve_lagrange_top(
    moments: ArrayLike,
    weight: ArrayLike,
    momentum: ArrayLike,
    attitude: Attitude,
    t: ArrayLike,
    axis: int = 3,
) -> Motion:
    """Return the exact motion of heavy symmetric tops at any time, TdC Example 3.7.

    Leading shapes broadcast as in `solve_free_top`.

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments about the fixed point; the two transverse moments are equal
    weight : array_like (...) [N m]
        k = m g l, l the distance of the centre of mass from the fixed point along +axis; negative
        if it lies on the other side
    momentum : array_like (..., 3) [kg m^2/s]
        angular momentum in principal axes at t = 0
    attitude : array_like (..., 4), (..., 3, 3) or (3,), or scipy Rotation
        quaternions or matrices, body to space, or three Euler angles z-x-z [rad], at t = 0; may be
        upright or hanging
    t : array_like (...) [s]
        times
    axis : int, optional
        the symmetry axis, 1, 2 or 3

    Returns
    -------
    Motion
        as for `solve_free_top`

    Raises
    ------
    SceneError
        if all tops are impossible, e.g. because of unequal moments, or shapes do not broadcast

    Warns
    -----
    SceneWarning
        with the count of impossible tops, whose results are nan; for Euler angles that look like
        degrees

    Examples
    --------
    >>> top = (1.0, 1.0, 0.5), 1.0, (0.0, 0.0, 5.0), (0.96, 0.28, 0.0, 0.0)
    >>> motion = rm.solve_lagrange_top(*top, t=[0.0, 1.0])
    >>> motion.momentum[:, 2].round(12).tolist()  # L_3 stays
    [5.0, 5.0]
    """
    table, _, tops, _, below = _orbits(moments, weight, momentum, attitude, axis)
    shape, index, times = spread(tops, t)
    values = evaluate(LagrangeStateFormula(), 7, times[None], table, index)
    values[:, np.isnan(times)] = np.nan  # L_3 needs no time
    q = values[:4]
    with np.errstate(invalid="ignore"):  # a motion too fast for floats is nan
        if below.any():
            q = np.where(below[index], np.stack(multiply((0.0, -1.0, 0.0, 0.0), q)), q)
        if axis != 3:
            q = np.stack(multiply(q, conjugate(_TURNS[axis])))
    l = np.moveaxis(np.roll(values[4:], axis - 3, 0).reshape(3, *shape), 0, -1)
    omega = l / floats(moments, "moments")
    return Motion(l, omega, np.moveaxis(q.reshape(4, *shape), 0, -1))


def analyse_lagrange_top(
    moments: ArrayLike, weight: ArrayLike, momentum: ArrayLike, attitude: Attitude, axis: int = 3
) -> NutationRange:
    """Compute constants, turning angles and kind of motion of heavy symmetric tops.

    TdC (3.40)-(3.42). Loops, cusps and waves differ in the sign, at the turning angles, of::

        phi' = (a - b u)/(1 - u^2)

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments, as for `solve_lagrange_top`
    weight : array_like (...) [N m]
        k = m g l, as for `solve_lagrange_top`
    momentum : array_like (..., 3) [kg m^2/s]
        angular momentum in principal axes
    attitude : array_like (..., 4), (..., 3, 3) or (3,), or scipy Rotation
        quaternions or matrices, body to space, or three Euler angles z-x-z [rad]
    axis : int, optional
        the symmetry axis, 1, 2 or 3

    Returns
    -------
    NutationRange
        a NamedTuple of arrays (...):

        - kind: "at rest", "sleeping" (upright, and stable: (I_3 omega_3)^2 >= 4 I_1 k), "unstable"
          (upright, below that), "hanging" (spins about the vertical), "steady precession",
          "homoclinic", "pendulum", "cusps", "loops", "monotone precession" (waves), or "invalid"
          for bad input
        - p_phi, p_psi: the constants L_z and L_3 [kg m^2/s] of TdC (3.40), (3.41)
        - energy: E [J], with the potential k cos theta
        - low, high: theta [rad] at the lowest and highest point of the axis: low is the largest
          theta, high the smallest
        - m, mc: parameter m = k^2 and 1 - m; rate: p [rad/s], where the argument of sn is p t + d
        - period: of the nutation, 2 K(m)/p [s]; inf if the axis does not return, but that of the
          rounded constants if it is homoclinic
        - precession, spin: change of phi and of psi in a period [rad]

    Raises
    ------
    SceneError
        as for `solve_lagrange_top`

    Warns
    -----
    SceneWarning
        as for `solve_lagrange_top`

    Examples
    --------
    A top released with its axis at rest:

    >>> top = rm.analyse_lagrange_top((1.0, 1.0, 0.5), 1.0, (0.0, 0.0, 5.0), (0.96, 0.28, 0.0, 0.0))
    >>> print(top.kind, top.period.round(6))
    cusps 1.348585
    """
    table, columns, shape, bad, below = _orbits(moments, weight, momentum, attitude, axis)
    nutation = _turned_back(_nutation(LagrangeOrbit(*table.T), columns, bad), below)
    return NutationRange._make(np.reshape(v, shape) for v in nutation)


def _nutation(o: Any, columns: Array, bad: Bools) -> NutationRange:
    """Return the NutationRange (n,) of each LagrangeOrbit in o, whose weights are not negative.

    columns : A, C, k, L, attitude (10, n);  bad : mask of impossible tops
    """
    (a, c, k, l1, l2, l3), q = columns[:6], columns[6:]
    with np.errstate(all="ignore"):
        fixed = (o.width <= SAME) | (o.v1 == o.v2)
        kind = _kinds(o, columns, bad, fixed)
        period = np.where(fixed | (o.mc == 0.0), np.inf, 2.0 * o.quarter / o.rate)
        precession, spin = _turns_of_a_period(o, period)
        low, high = (
            2.0 * np.arctan2(np.sqrt(np.where(v <= TINY, 0.0, v)), np.sqrt(y))
            for v, y in ((o.v1, o.y1), (o.v2, o.y2))
        )
        height = (q[0] ** 2 + q[3] ** 2 - q[1] ** 2 - q[2] ** 2) / (q**2).sum(0)
        energy = 0.5 * ((l1**2 + l2**2) / a + l3**2 / c) + k * height
    p_phi = 0.5 * o.inertia * (o.e_plus + o.e_minus)
    constants = kind, p_phi, l3, energy, low, high
    return NutationRange(*constants, o.m, o.mc, o.rate, period, precession, spin)


def _turned_back(nutation: NutationRange, below: Bools) -> NutationRange:
    """Return the NutationRange of tops that `_orbits` has turned upside down where `below`."""
    upside = np.where(below, -1.0, 1.0)
    return nutation._replace(
        p_phi=upside * nutation.p_phi,
        low=np.where(below, np.pi - nutation.high, nutation.low),
        high=np.where(below, np.pi - nutation.low, nutation.high),
        precession=upside * nutation.precession,
    )


def _kinds(o: Any, columns: Array, bad: Bools, fixed: Bools) -> Any:
    """Return the kind of motion, as named by `analyse_lagrange_top`, of each LagrangeOrbit in o.

    columns : A, C, k and L first;  fixed : whether the axis keeps its angle from the vertical
    """
    a, _, k, l1, l2, l3 = columns[:6]
    upright, hanging = fixed & (o.v1 <= SAME), fixed & (o.y2 <= SAME) & (k > 0.0)
    lower, upper = o.e_minus + o.b * o.v1, o.e_minus + o.b * o.v2  # signs of phi'
    fast = np.abs(o.e_minus) + np.abs(o.b) * o.v1
    # phi' sin^2 theta is 0 because sin theta is: the axis passes through the vertical and moves on
    passes = (np.abs(o.e_minus) <= SAME * fast) & (np.abs(o.e_minus) > 2.0 * np.abs(o.b) * o.v2)
    passes |= (np.abs(o.e_plus) <= SAME * fast) & (np.abs(o.e_plus) > 2.0 * np.abs(o.b) * o.y1)
    kinds = {  # the first that holds
        "invalid": bad,
        "at rest": fixed & (l1**2 + l2**2 + l3**2 == 0.0),
        "unstable": upright & (l3**2 < 4.0 * a * k * (1.0 - SAME)),
        "hanging": hanging,
        "sleeping": upright | (fixed & (o.y2 <= SAME)),  # without weight, hanging is upright too
        "steady precession": fixed,
        "homoclinic": ~fixed & (o.mc < SAME),
        "pendulum": np.maximum(np.abs(o.e_plus), np.abs(o.b)) <= SAME * o.rate,
        "cusps": (np.abs(upper) <= SAME * fast) & ~passes,
        "loops": (lower * upper < 0.0) & ~passes,
    }
    return np.select(list(kinds.values()), list(kinds), "monotone precession")


def _turns_of_a_period(o: Any, period: Array) -> tuple[Array, Array]:
    """Return (precession, spin), the changes of phi and psi in a period [rad]; nan without one."""
    plus = np.where(
        o.direct == 1.0, 2.0 * (o.quarter * o.h_s / o.h_c - o.plus_all), np.pi + 2.0 * o.plus_all
    )
    sigma = o.drift * period + o.s_plus * plus
    delta = 2.0 * o.s_minus * (o.h_minus * o.quarter + o.minus_all) - o.drift * period
    ends = np.isfinite(period)
    return np.where(ends, sigma + delta, np.nan), np.where(ends, sigma - delta, np.nan)
