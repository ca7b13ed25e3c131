"""Euler angles of all 12 sequences: three rotations about axes of the body.

A sequence names the axes by digits, in the order of the rotations. "321" turns the body by the
first angle about its axis 3, by the second about its new axis 2, and by the third about its new
axis 1 (intrinsic rotations). The attitude, from body to space, is the product in this order:

    A = R_i(first) R_j(second) R_k(third)

scipy writes these rotations in capitals, Rotation.from_euler("ZYX", ...); its lower-case words
mean rotations about the axes of space, in the order of the word. In a proper sequence, such as
"313", the first and the last axis are the same: 0 <= second <= pi. In a Tait-Bryan sequence, such
as "321", all axes differ: |second| <= pi/2. At the ends of these ranges (gimbal lock) the first
and third rotation have one axis in space, and only the sum or the difference of their angles is
determined.
"""

from typing import Any

import numpy as np

from rigidmc.errors import SceneError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.functions import sincos

PROPER = ("121", "131", "212", "232", "313", "323")
TAIT_BRYAN = ("123", "132", "213", "231", "312", "321")
SEQUENCES = (*PROPER, *TAIT_BRYAN)
TEXTBOOK = "313"  # z-x-z, TdC (3.36)
LOCKED = 1e-15  # rad from gimbal lock, within the rounding of a quaternion
_SCIPY = str.maketrans("XYZ", "123")


def check_sequence(sequence: Any, at: str = "sequence") -> str:
    """Return a sequence of SEQUENCES; SceneError.

    Accepts scipy's intrinsic words ("ZYX" is "321") and integers. Refuses scipy's lower-case words,
    which mean rotations about the axes of space.
    """
    word = str(sequence) if isinstance(sequence, (str, int)) else ""
    digits = word.translate(_SCIPY)
    if digits in SEQUENCES:
        return digits
    if word.islower() and (same := word.upper().translate(_SCIPY)) in SEQUENCES:
        rule = (
            "in lower case means rotations about the axes of space: angles (a, b, c) of it are the"
            f' angles (c, b, a) of "{same[::-1]}", about axes of the body; or did you mean'
            f' "{same}"?'
        )
        raise SceneError(rule, at=at, value=sequence)
    rule = (
        f"expected three axes, the neighbours different: one of {', '.join(SEQUENCES)};"
        ' "321" turns about axis 3, then about the new axis 2, then about the new axis 1'
    )
    raise SceneError(rule, at=at, value=sequence, nearest=nearest(word, SEQUENCES))


def angle_names(sequence: str = TEXTBOOK) -> tuple[str, str, str]:
    """Return the names of the three angles, in the order of the rotations.

    Proper sequences have phi, theta and psi. The angles of Tait-Bryan sequences have the names of
    their axes: roll about axis 1, pitch about axis 2, yaw about axis 3.

    Examples
    --------
    >>> from rigidmc.mechanics.euler_angles import angle_names
    >>> angle_names("321"), angle_names("313")
    (('yaw', 'pitch', 'roll'), ('phi', 'theta', 'psi'))
    """
    if sequence in PROPER:
        return "phi", "theta", "psi"
    first, second, third = (("roll", "pitch", "yaw")[int(axis) - 1] for axis in sequence)
    return first, second, third


def quaternions_of_angles(sequence: str, first: Any, second: Any, third: Any) -> Array:
    """Return quaternions (4, ...), components first, of three angles [rad] of a common shape."""
    i, j, k, sign = axes_of(sequence)
    if sequence in PROPER:
        s, c = sincos(0.5 * second)
        sin_plus, cos_plus = sincos(0.5 * (first + third))
        sin_minus, cos_minus = sincos(0.5 * (first - third))
        parts = {0: c * cos_plus, i: c * sin_plus, j: s * cos_minus, k: sign * (s * sin_minus)}
    else:
        (s1, c1), (s2, c2), (s3, c3) = (sincos(0.5 * x) for x in (first, second, third))
        parts = {
            0: c1 * c2 * c3 - sign * (s1 * s2 * s3),
            i: s1 * c2 * c3 + sign * (c1 * s2 * s3),
            j: c1 * s2 * c3 - sign * (s1 * c2 * s3),
            k: c1 * c2 * s3 + sign * (s1 * s2 * c3),
        }
    return np.stack(np.broadcast_arrays(*(parts[n] for n in range(4))))


def angles_of_quaternions(sequence: str, q: Any) -> Array:
    """Return the three angles (3, ...) [rad] of unit quaternions (4, ...), components first.

    The first and the third angle lie in (-pi, pi]. The angles reproduce the attitude to rounding
    everywhere. Near gimbal lock they are exact for the given quaternion; its own rounding, divided
    by the distance, limits the first and the third angle. Within LOCKED of gimbal lock, the third
    angle is 0. nan gives nan.

    Source: Bernardes & Viollet, PLOS ONE 17 (2022) e0276302.
    """
    i, j, k, sign = axes_of(sequence)
    w, u, v, n = q[0], q[i], q[j], sign * q[k]
    if sequence not in PROPER:
        # Turned by pi/2 about axis j, axis k becomes -sign times axis i: a proper sequence.
        w, u, v, n = w - v, u - n, v + w, n + u
    with np.errstate(invalid="ignore"):
        near, far = np.hypot(v, n), np.hypot(w, u)
        size = np.hypot(near, far)
        second = 2.0 * np.arctan2(near, far)
        plus, minus = np.arctan2(u, w), np.arctan2(n, v)  # (first + third)/2, (first - third)/2
        plus = np.where(far <= 0.5 * LOCKED * size, minus, plus)
        minus = np.where(near <= 0.5 * LOCKED * size, plus, minus)
        first, third = wrapped(plus + minus), wrapped(plus - minus)
    if sequence in PROPER:
        return np.stack([first, second, third])
    return np.stack([first, second - 0.5 * np.pi, wrapped(-sign * third)])


def distance_from_lock(sequence: str, second: Any) -> Any:
    """Return how far the second angle is from gimbal lock [rad]."""
    if sequence in PROPER:
        return np.minimum(second, np.pi - second)
    return 0.5 * np.pi - np.abs(second)


def axes_of(sequence: str) -> tuple[int, int, int, float]:
    """Return (i, j, k, sign): the first two axes, the remaining one, and the sign of (i, j, k)."""
    i, j = int(sequence[0]), int(sequence[1])
    return i, j, 6 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0


def wrapped(angle: Any) -> Any:
    """Reduce an angle in (-2 pi, 2 pi] to (-pi, pi]."""
    raised = np.where(angle <= -np.pi, angle + 2.0 * np.pi, angle)
    return np.where(angle > np.pi, angle - 2.0 * np.pi, raised)
