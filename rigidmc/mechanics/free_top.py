"""The free top at any time in closed form, for arrays of bodies, TdC (3.35) and Example 3.6.

Arguments of all closed forms broadcast in their leading shapes, and are checked by
`rigidmc.inputs.arrays.broadcast_arguments`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.engine.formulas import evaluate
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Bools, Ints, Shape, broadcast_arguments, floats
from rigidmc.mechanics.free_orbit import FreeOrbit, FreeOrbitFormula, FreeStateFormula, Phase
from rigidmc.mechanics.rotation import Attitude, quaternion


def spread(shape: Shape, t: ArrayLike) -> tuple[Shape, Ints, Array]:
    """Return (shape, row, time): each body of a table at each time.

    shape : leading shape of the bodies, whose order is the order of the table's rows
    t : times (...)

    Returns the shape to which both broadcast, and for each element its row of the table and its
    time.
    """
    size, ((times,),), _ = broadcast_arguments(("t", t, 0))
    try:
        both = np.broadcast_shapes(shape, size)
    except ValueError:
        rule = (
            f"times {size} do not broadcast against bodies {shape}; give an axis of length 1, "
            "e.g. bodies (n, 1) and times (m,)"
        )
        raise SceneError(rule, at="t") from None
    rows: NDArray[Any] = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
    return (
        both,
        np.broadcast_to(rows, both).reshape(-1),
        np.broadcast_to(times.reshape(size), both).reshape(-1),
    )


class Motion(NamedTuple):
    """momentum (..., 3) [kg m^2/s] and omega (..., 3) [rad/s] in principal axes, attitude (..., 4).

    The attitude takes body to space components.
    """

    momentum: Array
    omega: Array
    attitude: Array


class FreeMotionType(NamedTuple):
    """Classification of free motions; arrays with the leading shape of the bodies.

    kind : "invalid", "rest", "permanent rotation", "symmetric precession", "separatrix",
        "about the largest moment" or "about the smallest moment"
    axis : 1, 2 or 3 (0: invalid), the principal axis about which the momentum circles
    m, mc : the parameter m = k^2 and 1 - m; mc has no cancellation error
    rate : lambda [rad/s]; the argument of sn, cn, dn is lambda t
    period : 4 K(m)/lambda [s], of momentum and omega; inf on a separatrix and if both are constant
    flip_interval : 2 K(m)/lambda [s], between sign changes of the middle component; nan for
        symmetric bodies
    turn : the angle [rad] by which the attitude rotates about the momentum in a period, not reduced
        modulo 2 pi
    solid_angle : solid angle that the momentum sweeps in the body in a period, oriented, modulo
        4 pi: turn = 2 T period/|L| - solid_angle (Montgomery, Am. J. Phys. 59 (1991) 394)
    phase : position of the momentum on its curve, lambda (t - t0)/(4 K) modulo 1: the component
        along the middle axis is 0 at 0 and 1/2; nan if the momentum is constant
    """

    kind: NDArray[np.str_]
    axis: Ints
    m: Array
    mc: Array
    rate: Array
    period: Array
    flip_interval: Array
    turn: Array
    solid_angle: Array
    phase: Array


def _orbits(
    moments: ArrayLike, momentum: ArrayLike, attitude: Attitude
) -> tuple[Array, Shape, Bools]:
    """Return (table of FreeOrbits, one row per top; leading shape; mask of bad rows)."""
    shape, arrays, bad = broadcast_arguments(
        ("moments", moments, 3), ("momentum", momentum, 3), ("attitude", quaternion(attitude), 4)
    )
    columns = np.concatenate(arrays)
    table = evaluate(FreeOrbitFormula(), len(FreeOrbit._fields), columns).T.copy()
    table[:, FreeOrbit._fields.index("phase")] = evaluate(Phase(), 1, table.T)[0]
    table[bad] = np.nan
    return table, shape, bad


def solve_free_top(
    moments: ArrayLike, momentum: ArrayLike, attitude: Attitude, t: ArrayLike
) -> Motion:
    """Return the exact motion of free rigid bodies at any time, TdC (3.35) and Example 3.6.

    Leading shapes broadcast: moments (B, 1, 3) and t (T,) give (B, T).

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments, in any order; any positive numbers, even moments of impossible bodies
        (some published problems use them)
    momentum : array_like (..., 3) [kg m^2/s]
        angular momentum in principal axes at t = 0
    attitude : array_like (..., 4), (..., 3, 3) or (3,), or scipy Rotation
        quaternions or matrices, body to space, or three Euler angles z-x-z [rad], at t = 0
    t : array_like (...) [s]
        times; may be sparse, huge or negative

    Returns
    -------
    Motion
        momentum (..., 3) [kg m^2/s] and omega (..., 3) [rad/s] in principal axes, and attitude
        (..., 4), body to space

    Raises
    ------
    SceneError
        if all bodies or starts are impossible, or shapes do not broadcast

    Warns
    -----
    SceneWarning
        with the count of impossible bodies or starts, whose results are nan

    Examples
    --------
    >>> top = (1.0, 2.0, 3.0), (0.0, 1.0, 0.5), (1.0, 0.0, 0.0, 0.0)
    >>> motion = rm.solve_free_top(*top, t=[1.0, 1e6])
    >>> motion.omega.round(6).tolist()
    [[-0.084088, 0.492879, 0.173593], [0.184068, -0.464886, 0.197665]]
    """
    table, bodies, _ = _orbits(moments, momentum, attitude)
    shape, index, times = spread(bodies, t)
    values = evaluate(FreeStateFormula(), 7, times[None], table, index).reshape(7, *shape)
    q, l = np.moveaxis(values[:4], 0, -1), np.moveaxis(values[4:], 0, -1)
    return Motion(l, l / floats(moments, "moments"), q)


_AXES = np.array([[1, 3], [3, 2], [2, 1]])  # the body axes that `shift` relabels 1 and 3


def analyse_free_top(moments: ArrayLike, momentum: ArrayLike) -> FreeMotionType:
    """Compute the kind, period and turning angle of free motions, TdC (3.35).

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments, as for `solve_free_top`
    momentum : array_like (..., 3) [kg m^2/s]
        angular momentum in principal axes

    Returns
    -------
    FreeMotionType
        arrays (...): kind, axis, m, mc, rate, period, flip_interval, turn, solid_angle, phase, see
        `rigidmc.mechanics.free_top.FreeMotionType`

    Raises
    ------
    SceneError
        as for `solve_free_top`

    Warns
    -----
    SceneWarning
        as for `solve_free_top`

    Examples
    --------
    >>> motion = rm.analyse_free_top((1.0, 2.0, 3.0), (0.5, 1.0, 0.5))
    >>> print(motion.kind, motion.period.round(6))
    about the smallest moment 19.879658
    """
    table, shape, bad = _orbits(moments, momentum, (1.0, 0.0, 0.0, 0.0))
    o: Any = FreeOrbit(*table.T)
    moments, l = (
        np.moveaxis(np.broadcast_to(floats(x, name, 3), (*shape, 3)), -1, 0).reshape(3, -1)
        for name, x in (("moments", moments), ("momentum", momentum))
    )
    axis = np.where(bad, 0, _AXES[np.nan_to_num(o.shift).astype(int), (o.about == 3.0).astype(int)])
    with np.errstate(over="ignore"):  # components of L x omega, times moments
        torques = [(moments[i] - moments[j]) * l[i] * l[j] for i, j in ((1, 2), (2, 0), (0, 1))]
    permanent = ~np.any(torques, axis=0)
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
        moves = np.isfinite(period)
        turn = o.spin * period + o.sense * (4.0 * o.swing + 2.0 * np.pi * o.direct)
        turn = np.where(moves, turn, np.nan)
        twice_energy = (l * l / moments).sum(0)
        phase = np.where(moves, np.remainder(o.offset / (4.0 * o.quarter), 1.0), np.nan)
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
    return FreeMotionType(*(np.reshape(v, shape) for v in values))
