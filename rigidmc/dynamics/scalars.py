"""Choices, roots and rounding of one number, without a branch.

A "number" is a float, in Python also an array of floats, and in a kernel also a vector that holds
one number of each of several ensemble members. Conditions are then arrays or masks, and both sides
of a choice are evaluated.
"""

import numpy as np


def select(condition, a, b):
    """`a if condition else b` with both evaluated: a blend, never a branch.

    Element by element for arrays.
    """
    if isinstance(condition, np.ndarray):
        return np.where(condition, a, b)
    return a if condition else b


def select_each(condition, a, b):
    """`select` of each number of two tuples."""
    return tuple(select(condition, x, y) for x, y in zip(a, b, strict=True))


def opposite(condition):
    """`not condition`, also for a mask."""
    return not condition


def by_precision(x, double, single):
    """One of two constants: `double`, or `single` if x is a float32 number."""
    return double


def rounded(x):
    """The integer nearest to x as a float, |x| < 2^51 (2^22 in float32), without a library call.

    x + 1.5 * 2^52 is so large that it has no digits after the point.
    """
    large = by_precision(x, 6755399441055744.0, 12582912.0)
    return (x + large) - large


def root(x):
    """The square root of a number, or of each number of an array."""
    return np.sqrt(x)


def inverse(x):
    """1/x, or 0 if x is 0: a share of nothing is none, in any unit."""
    # what is divided by 1 is not taken
    return select(x > 0.0, 1.0 / select(x > 0.0, x, 1.0), 0.0)


def larger(a, b):
    """The larger of two numbers, element by element for arrays."""
    return select(b > a, b, a)


def smaller(a, b):
    """The smaller of two numbers, element by element for arrays."""
    return select(b < a, b, a)
