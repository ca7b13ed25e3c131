"""Algebra of 3-vectors.

A momentum may be a longer tuple: after its three components follows the work that the effects have
done (`rigidmc.effects.protocol`). Sums and multiples apply to these further numbers too; a missing
one is 0.
"""


def dot(a, b):
    """Scalar product of two 3-vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    """Vector product of two 3-vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def first_three(a):
    """The 3-vector at the start of a longer tuple."""
    if len(a) == 3:
        return a
    return a[0], a[1], a[2]


def joined(a, more):
    """The tuple `a` followed by `more`."""
    if len(more) == 0:
        return a
    return a + more


def rest_scaled(s, a):
    """s*a for a tuple of any length."""
    if len(a) == 0:
        return ()
    return (s * a[0],) + rest_scaled(s, a[1:])


def rest_axpy(a, s, b):
    """a + s*b for tuples of any lengths."""
    if len(b) == 0:
        return a
    if len(a) == 0:
        return rest_scaled(s, b)
    return (a[0] + s * b[0],) + rest_axpy(a[1:], s, b[1:])


def add(a, b):
    """a + b of 3-vectors and of what follows them."""
    if len(a) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + rest_axpy(a[3:], 1.0, b[3:])
    if len(b) > 3:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2]) + b[3:]
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def difference(a, b):
    """a - b of 3-vectors and of what follows `a`."""
    if len(a) > 3:
        return (a[0] - b[0], a[1] - b[1], a[2] - b[2]) + rest_axpy(a[3:], -1.0, b[3:])
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(s, a):
    """s*a of a number and a 3-vector with what follows it."""
    if len(a) > 3:
        return (s * a[0], s * a[1], s * a[2]) + rest_scaled(s, a[3:])
    return s * a[0], s * a[1], s * a[2]


def axpy(a, s, b):
    """a + s*b of 3-vectors and of what follows them."""
    if len(b) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + rest_axpy(a[3:], s, b[3:])
    if len(a) > 3:
        return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]) + a[3:]
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]
