"""Algebra of 3-vectors; choices, roots and rounding of numbers without a branch.

A "number" is a float; in Python it may be an array of floats, and in a kernel a vector with one
number from each of several members. Conditions are then arrays or masks, and both sides of a choice
are evaluated.

A momentum may be a longer tuple: its three components, then the states of the effects, then the
works that they have done (`rigidmc.physics.effects.sums`). Sums and multiples include these
trailing numbers; a missing one is 0.
"""

import numpy as np


def dot(a, b):
    """Return the scalar product of two 3-vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    """Return the vector product of two 3-vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def symmetric_times(m, v):
    """Return M v for a symmetric matrix (xx, yy, zz, yz, zx, xy)."""
    return (
        m[0] * v[0] + m[5] * v[1] + m[4] * v[2],
        m[5] * v[0] + m[1] * v[1] + m[3] * v[2],
        m[4] * v[0] + m[3] * v[1] + m[2] * v[2],
    )


def first_three(a):
    """Return the 3-vector at the start of a longer tuple."""
    if len(a) == 3:
        return a
    return a[0], a[1], a[2]


def concat(a, b):
    """Return the tuple `a` followed by `b`."""
    if len(b) == 0:
        return a
    return a + b


def scale_rest(s, a):
    """Return s*a for a tuple of any length."""
    if len(a) == 0:
        return ()
    return (s * a[0],) + scale_rest(s, a[1:])


def rest_axpy(a, s, b):
    """Return a + s*b for tuples of any lengths."""
    if len(b) == 0:
        return a
    if len(a) == 0:
        return scale_rest(s, b)
    return (a[0] + s * b[0],) + rest_axpy(a[1:], s, b[1:])


def taken(like, values):
    """Return as many of the first values as `like` has."""
    if len(like) == 0:
        return ()
    return values[:1] + taken(like[1:], values[1:])


def left_after(like, values):
    """Return the values after `taken`."""
    if len(like) == 0:
        return values
    return left_after(like[1:], values[1:])


def add(a, b):
    """Return a + b for 3-vectors and their trailing numbers."""
    if len(a) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + rest_axpy(a[3:], 1.0, b[3:])
    if len(b) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + b[3:]
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def difference(a, b):
    """Return a - b for 3-vectors and the trailing numbers of `a`."""
    if len(a) > 3:
        return (a[0] - b[0], a[1] - b[1], a[2] - b[2]) + rest_axpy(a[3:], -1.0, b[3:])
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(s, a):
    """Return s*a for a number and a 3-vector with its trailing numbers."""
    if len(a) > 3:
        return (s * a[0], s * a[1], s * a[2]) + scale_rest(s, a[3:])
    return s * a[0], s * a[1], s * a[2]


def axpy(a, s, b):
    """Return a + s*b for 3-vectors and their trailing numbers."""
    if len(b) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + rest_axpy(a[3:], s, b[3:])
    if len(a) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + a[3:]
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


def select(condition, a, b):
    """Return `a if condition else b` with both evaluated: a blend, never a branch.

    Element by element for arrays.
    """
    if isinstance(condition, np.ndarray):
        return np.where(condition, a, b)
    return a if condition else b


def select_all(condition, a, b):
    """Apply `select` to each number of two tuples."""
    return tuple(select(condition, x, y) for x, y in zip(a, b, strict=True))


def logical_not(condition):
    """Return `not condition`, also for a mask."""
    return not condition


def by_precision(x, double, single):
    """Return one of two constants: `double`, or `single` if x is a float32 number."""
    return double


def nearest_integer(x):
    """Return the integer nearest to x as a float, |x| < 2^51 (2^22 in float32), with no library.

    x + 1.5 * 2^52 is so large that it has no digits after the point.
    """
    large = by_precision(x, 6755399441055744.0, 12582912.0)
    return (x + large) - large


def root(x):
    """Return the square root of a number, or of each number of an array."""
    # `math.sqrt` does not accept arrays. Compiled, this is one instruction.
    return np.sqrt(x)


def inverse(x):
    """Return 1/x, or 0 if x is 0: a fraction of 0 counts as 0, in any unit."""
    # Where x is 0 the quotient is unused: 1 keeps it finite and free of warnings.
    return select(x > 0.0, 1.0 / select(x > 0.0, x, 1.0), 0.0)


def maximum(a, b):
    """Return the larger of two numbers, element by element for arrays."""
    return select(b > a, b, a)


def minimum(a, b):
    """Return the smaller of two numbers, element by element for arrays."""
    return select(b < a, b, a)
