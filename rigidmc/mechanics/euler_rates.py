"""Rates of Euler angles, and the angular velocity: for all 12 sequences, both ways.

With A = R_i(a) R_j(b) R_k(c), omega in the body is the sum of a' times the first axis, b' times the
second and c' times the third, each as the body sees it. n is the remaining axis, and the sign is
the handedness of (i, j, n), see `rigidmc.mechanics.euler_angles.axes_of`.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import warn
from rigidmc.inputs.arrays import Array, Shape, broadcast_arguments, check_rows, floats
from rigidmc.inputs.measured import degrees_note
from rigidmc.mechanics.euler_angles import LOCKED, PROPER, TEXTBOOK, axes_of, check_sequence


def euler_rate_matrix(angles: ArrayLike, sequence: str = TEXTBOOK) -> NDArray[Any]:
    """Return M (..., 3, 3) with omega = M (a', b', c'), TdC (3.37).

    angles (..., 3) [rad]; complex angles give a complex M
    """
    sequence = check_sequence(sequence)
    i, j, n, sign = axes_of(sequence)
    _, second, third = np.moveaxis(floats(angles, "angles", 3, kinds="fiuc"), -1, 0)
    zero, one = 0.0 * second, 1.0 + 0.0 * second
    s, c, s3, c3 = np.sin(second), np.cos(second), np.sin(third), np.cos(third)
    if sequence in PROPER:  # the third axis is i
        first = {i: c, j: s * s3, n: sign * (s * c3)}
        across = {i: zero, j: c3, n: -sign * s3}
        last = {i: one, j: zero, n: zero}
    else:  # the third axis is n
        first = {i: c * c3, j: -sign * (c * s3), n: sign * s}
        across = {i: sign * s3, j: c3, n: zero}
        last = {i: zero, j: zero, n: one}
    rows = [np.stack([first[k], across[k], last[k]], -1) for k in (1, 2, 3)]
    return np.stack(rows, -2)


def _rows(angles: ArrayLike, name: str, values: ArrayLike) -> tuple[Shape, Array, Array]:
    """Return (leading shape, angles (3, n), values (3, n)); SceneError, SceneWarning."""
    shape, (angles, values), _ = broadcast_arguments(("angles", angles, 3), (name, values, 3))
    if note := degrees_note(angles[1], "angles: a second angle of", 1):
        warn(note)
    return shape, angles, values


def omega_from_euler_rates(angles: ArrayLike, rates: ArrayLike, sequence: str = TEXTBOOK) -> Array:
    """Compute the angular velocity from Euler angles and their rates, TdC (3.37).

    For z-x-z::

        omega_1 = phi' sin theta sin psi + theta' cos psi
        omega_2 = phi' sin theta cos psi - theta' sin psi
        omega_3 = phi' cos theta + psi'

    Leading shapes broadcast.

    Parameters
    ----------
    angles : array_like (..., 3) [rad]
        Euler angles in the order of the rotations; (phi, theta, psi) for "313"
    rates : array_like (..., 3) [rad/s]
        their rates
    sequence : str, optional
        sequence of three rotations about body axes, as for `Start`: "313" is z-x-z, "321" has yaw,
        pitch and roll

    Returns
    -------
    numpy.ndarray (..., 3) [rad/s]
        omega, in body axes

    Raises
    ------
    SceneError
        for an unknown sequence, a wrong shape, or if no row has finite numbers

    Warns
    -----
    SceneWarning
        with the count of rows that are not finite, whose results are nan; for a second angle that
        looks like degrees

    Examples
    --------
    The axis of a top leans by 0.4 rad and precesses at 7 rad/s:

    >>> omega = rm.omega_from_euler_rates((0.0, 0.4, 0.0), (7.0, 0.0, 193.0))
    >>> omega.round(3).tolist()
    [0.0, 2.726, 199.447]
    """
    shape, angles, rates = _rows(angles, "rates", rates)
    rows = np.einsum("nij,jn->ni", euler_rate_matrix(angles.T, sequence), rates)
    omega: Array = rows.reshape(*shape, 3)
    return omega


def euler_rates(angles: ArrayLike, omega: ArrayLike, sequence: str = TEXTBOOK) -> Array:
    """Compute the rates of Euler angles from the angular velocity, TdC (3.38).

    Leading shapes broadcast.

    Parameters
    ----------
    angles : array_like (..., 3) [rad]
        Euler angles in the order of the rotations; (phi, theta, psi) for "313"
    omega : array_like (..., 3) [rad/s]
        angular velocity, in body axes
    sequence : str, optional
        as for `omega_from_euler_rates`

    Returns
    -------
    numpy.ndarray (..., 3) [rad/s]
        rates of the angles. At gimbal lock the first and the third are nan: only their sum or
        difference is determined

    Raises
    ------
    SceneError
        for an unknown sequence, a wrong shape, or if no row has finite numbers or all angles are at
        gimbal lock

    Warns
    -----
    SceneWarning
        with the count of rows that are not finite, and of angles at gimbal lock; for a second angle
        that looks like degrees

    Examples
    --------
    >>> rates = rm.euler_rates((0.0, 0.4, 0.0), (0.0, 2.726, 199.447))
    >>> rates.round(2).tolist()
    [7.0, 0.0, 193.0]
    """
    sequence = check_sequence(sequence)
    i, j, n, sign = axes_of(sequence)
    shape, angles, omega = _rows(angles, "omega", omega)
    on = dict(zip((1, 2, 3), omega, strict=True))
    _, second, third = angles
    is_proper = sequence in PROPER
    s3, c3 = np.sin(third), np.cos(third)
    turned = on[j] * s3 + sign * on[n] * c3 if is_proper else on[i] * c3 - sign * on[j] * s3
    divisor, rest = (np.sin, np.cos) if is_proper else (np.cos, np.sin)
    bad = np.abs(divisor(second)) <= LOCKED
    check_rows(bad, "Euler rates are undetermined at gimbal lock", "angles")
    with np.errstate(all="ignore"):
        first = np.where(bad, np.nan, turned / divisor(second))
    if is_proper:
        middle = on[j] * c3 - sign * on[n] * s3
        last = on[i] - first * rest(second)
    else:
        middle = on[j] * c3 + sign * on[i] * s3
        last = on[n] - sign * first * rest(second)
    return np.stack([first, middle, last], -1).reshape(*shape, 3)
