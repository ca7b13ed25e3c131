"""The effective potential of the heavy symmetric top, its steady motions, and their stability.

I_1 = I_2 and I_3 are the moments about the fixed point, k = m g l is the weight times the height of
the centre of mass along axis 3, and theta is the angle of axis 3 from the vertical. k is negative
for a centre of mass on the other side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import warn
from rigidmc.inputs.arrays import Array, Bools, Shape, broadcast_arguments, check_rows, warn_of_rows
from rigidmc.inputs.measured import degrees_note

ROUNDED = 2.0 * np.finfo(float).eps  # relative rounding of an angle, or of a product of 4 numbers


def unequal_moments(first: Array, second: Array, axis: int = 3) -> Bools:
    """Return the mask of tops whose two moments across their `axis` differ.

    SceneError if all are unequal, a SceneWarning with their count if some are.
    """
    unequal = np.abs(first - second) > 1e-12 * np.abs(first)
    if unequal.any():
        at = int(np.flatnonzero(unequal)[0])
        others = " and ".join(f"I{n}" for n in (1, 2, 3) if n != axis)
        rule = (
            f"a Lagrange top is symmetric about its axis {axis}: {others} must be equal, but are "
            f"{first.flat[at]:.6g} and {second.flat[at]:.6g}; simulate() accepts any moments"
        )
        check_rows(unequal, rule, "moments")
    return unequal


def _arguments(moments: ArrayLike, *scalars: tuple[str, ArrayLike]) -> tuple[Shape, list[Array]]:
    """Return (leading shape, I_1 = I_2, I_3 and the scalars as arrays (n,)) of tops; nan where
    I_1 and I_2 differ or an argument is bad. A SceneWarning for a theta that looks like degrees."""
    named = [(name, value, 0) for name, value in scalars]
    shape, ((first, second, third), *rest), _ = broadcast_arguments(("moments", moments, 3), *named)
    for (name, _), (x,) in zip(scalars, rest, strict=True):
        if name == "theta" and (note := degrees_note(x, "theta =", 1)):
            warn(note)
    unequal = unequal_moments(first, second)
    return shape, [np.where(unequal, np.nan, x) for x in (first, third, *(x for (x,) in rest))]


def effective_potential(
    moments: ArrayLike, weight: ArrayLike, p_phi: ArrayLike, p_psi: ArrayLike, theta: ArrayLike
) -> Array:
    """Compute the potential in which theta moves, TdC (3.42).

    ::

        E = I_1 theta'^2/2 + U(theta)
        U = (p_phi - p_psi cos theta)^2/(2 I_1 sin^2 theta) + p_psi^2/(2 I_3) + k cos theta

    Leading shapes broadcast.

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments about the fixed point, I_1 = I_2
    weight : array_like (...) [N m]
        k = m g l
    p_phi, p_psi : array_like (...) [kg m^2/s]
        the constants L_z and L_3, such as fields of the result of `analyse_lagrange_top`
    theta : array_like (...) [rad]
        angle of axis 3 from the vertical

    Returns
    -------
    numpy.ndarray (...) [J]
        U; at theta = 0 and pi its limit, inf if that is not finite

    Raises
    ------
    SceneError
        for anything but finite numbers and positive moments, for a wrong shape, and if no top has
        equal moments I_1 and I_2

    Warns
    -----
    SceneWarning
        with the count of tops that are impossible or whose moments differ, whose results are nan;
        for a theta that looks like degrees

    Examples
    --------
    >>> top = (1.0, 1.0, 0.5), 1.0
    >>> motion = rm.analyse_lagrange_top(*top, (0.0, 0.0, 5.0), (0.0, 0.6, 0.0))
    >>> low = rm.effective_potential(*top, motion.p_phi, motion.p_psi, motion.low)
    >>> abs(low / motion.energy - 1.0) < 1e-12  # theta' = 0 at a turning angle
    np.True_
    """
    shape, (first, third, weight, p_phi, p_psi, theta) = _arguments(
        moments, ("weight", weight), ("p_phi", p_phi), ("p_psi", p_psi), ("theta", theta)
    )
    s, c = _half_angle(np.sin(0.5 * theta), theta), _half_angle(np.cos(0.5 * theta), theta)
    minus, plus = 0.5 * (p_phi - p_psi), 0.5 * (p_phi + p_psi)
    with np.errstate(all="ignore"):
        # (p_phi - p_psi cos theta)/sin theta, without cancellation near the poles
        down = np.where(minus == 0.0, 0.0, minus * c / s)
        across = down + np.where(plus == 0.0, 0.0, plus * s / c)
    kinetic = 0.5 * np.square(across) / first + 0.5 * np.square(p_psi) / third
    potential: Array = kinetic + weight * np.cos(theta)
    return potential.reshape(shape)[()]


def _half_angle(value: Array, theta: Array) -> Array:
    """Return the sine or cosine of theta/2, 0 where it is as small as the rounding of theta."""
    # the float nearest to pi is 1e-16 away from the pole
    return np.where(np.abs(value) <= ROUNDED * np.abs(theta), 0.0, value)


def _cosine(theta: Array) -> Array:
    """Return cos theta, 0 for a level axis."""
    cosine = np.cos(theta)
    # the cosine of pi/2 is 6e-17, and the cosine of an angle from a quaternion has errors of 2e-16
    return np.where(np.abs(cosine) <= 2.0 * ROUNDED, 0.0, cosine)


class SteadyPrecession(NamedTuple):
    """The two rates phi' [rad/s] of a precession without nutation."""

    slow: Array
    fast: Array


def steady_precession(
    moments: ArrayLike, weight: ArrayLike, omega3: ArrayLike, theta: ArrayLike
) -> SteadyPrecession:
    """Compute the rates of precession at which a heavy symmetric top does not nutate.

    They are the roots of Goldstein, Classical Mechanics, section 5.7::

        I_1 phi'^2 cos theta - I_3 omega_3 phi' + k = 0

    Leading shapes broadcast.

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments about the fixed point, I_1 = I_2
    weight : array_like (...) [N m]
        k = m g l
    omega3 : array_like (...) [rad/s]
        component of omega along axis 3, which includes phi' cos theta
    theta : array_like (...) [rad]
        angle of axis 3 from the vertical

    Returns
    -------
    SteadyPrecession
        slow, fast: arrays (...) [rad/s], the smaller and the larger in size. Both are nan below the
        spin of `least_spin`, where neither exists; at this spin, to rounding, they are equal.
        Without weight, slow is 0. For a level axis (cos theta is 0 to 4 units of rounding) only the
        slow one exists, and fast is its limit, inf

    Raises
    ------
    SceneError
        for anything but finite numbers and positive moments, for a wrong shape, and if no top has
        equal moments I_1 and I_2

    Warns
    -----
    SceneWarning
        with the count of tops that are impossible or whose moments differ, whose results are nan;
        with the count of tops that spin too slowly, and the least spin of the first; for a theta
        that looks like degrees

    Examples
    --------
    >>> slow, fast = rm.steady_precession((1.0, 1.0, 0.5), 1.0, 10.0, 0.4)
    >>> slow.round(3), fast.round(3)
    (np.float64(0.208), np.float64(5.221))
    """
    shape, (first, third, weight, omega3, theta) = _arguments(
        moments, ("weight", weight), ("omega3", omega3), ("theta", theta)
    )
    spin, rise = third * omega3, first * _cosine(theta)
    with np.errstate(all="ignore"):
        # the larger root first, which does not cancel
        larger = 0.5 * (spin + np.copysign(_root(spin**2, 4.0 * rise * weight), spin))
        # without weight, phi' = 0 is a root
        slow = np.where(weight == 0.0, 0.0, np.where(larger == 0.0, np.nan, weight / larger))
        fast = np.where(rise == 0.0, np.copysign(np.inf, larger), larger / rise)
    fast = np.where(np.isnan(slow), np.nan, fast)
    too_slow = np.isnan(slow) & np.isfinite(rise * weight * spin)
    if too_slow.any():
        at = int(np.argmax(too_slow))
        least = 2.0 * np.sqrt(np.maximum(rise * weight, 0.0)) / third
        rule = f"steady precession needs a spin above {least[at]:.6g} rad/s, but omega3 is"
        warn_of_rows(too_slow, f"{rule} {omega3[at]:.6g}")
    return SteadyPrecession(*(x.reshape(shape)[()] for x in (slow, fast)))


def _root(square: Array, least: Array) -> Array:
    """Return sqrt(square - least), 0 where the two are equal to rounding."""
    return np.sqrt(np.where(np.abs(square - least) <= 4.0 * ROUNDED * square, 0.0, square - least))


def least_spin(moments: ArrayLike, weight: ArrayLike, theta: ArrayLike = 0.0) -> Array:
    """Compute the least spin at which a heavy symmetric top precesses without nutation.

    At theta = 0 it is the spin above which an upright top sleeps. For k cos theta > 0::

        |omega_3| = 2 sqrt(I_1 k cos theta)/I_3

    Leading shapes broadcast.

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments about the fixed point, I_1 = I_2
    weight : array_like (...) [N m]
        k = m g l
    theta : array_like (...), optional [rad]
        angle of axis 3 from the vertical

    Returns
    -------
    numpy.ndarray (...) [rad/s]
        the size of omega_3; 0 if the centre of mass is not above the fixed point, where any spin
        suffices

    Raises
    ------
    SceneError
        for anything but finite numbers and positive moments, for a wrong shape, and if no top has
        equal moments I_1 and I_2

    Warns
    -----
    SceneWarning
        with the count of tops that are impossible or whose moments differ, whose results are nan;
        for a theta that looks like degrees

    Examples
    --------
    >>> rm.least_spin((1.0, 1.0, 0.5), 1.0)
    np.float64(4.0)
    """
    shape, (first, third, weight, theta) = _arguments(moments, ("weight", weight), ("theta", theta))
    rise = weight * _cosine(theta)
    spin: Array = 2.0 * np.sqrt(first * np.maximum(rise, 0.0)) / third
    return spin.reshape(shape)[()]


def tilt_growth(moments: ArrayLike, weight: ArrayLike, omega3: ArrayLike) -> Array:
    """Compute the growth rate of a small tilt of an upright top.

    ::

        sqrt(4 I_1 k - (I_3 omega_3)^2)/(2 I_1)

    Leading shapes broadcast.

    Parameters
    ----------
    moments : array_like (..., 3) [kg m^2]
        principal moments about the fixed point, I_1 = I_2
    weight : array_like (...) [N m]
        k = m g l
    omega3 : array_like (...) [rad/s]
        spin about the vertical axis 3

    Returns
    -------
    numpy.ndarray (...) [1/s]
        the rate; 0 if the top sleeps, which is from the spin of `least_spin` on

    Raises
    ------
    SceneError
        for anything but finite numbers and positive moments, for a wrong shape, and if no top has
        equal moments I_1 and I_2

    Warns
    -----
    SceneWarning
        with the count of tops that are impossible or whose moments differ, whose results are nan

    Examples
    --------
    >>> rm.tilt_growth((1.0, 1.0, 0.5), 1.0, [3.0, 5.0]).round(4).tolist()
    [0.6614, 0.0]
    """
    shape, (first, third, weight, omega3) = _arguments(
        moments, ("weight", weight), ("omega3", omega3)
    )
    least, square = 4.0 * first * weight, (third * omega3) ** 2
    rate: Array = _root(np.maximum(least, square), square) / (2.0 * first)
    return rate.reshape(shape)[()]
