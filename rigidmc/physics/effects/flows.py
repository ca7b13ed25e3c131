"""Flows of L that several effects share, and algebra for them."""

from rigidmc.physics.dynamics.so3 import cross, dot, exponential, into_body, scale


def damp_flow(body, c, l):
    """Return L after dL/dt = -c omega over unit time, by the trapezoidal rule, of order 2.

    Each component is multiplied by (1 - c/2I)/(1 + c/2I), which lies between -1 and 1 if c > 0.
    """
    # Each component shrinks for any c > 0; with the explicit rule it would grow for c > 2I.
    x, y, z = 0.5 * c * body.i1, 0.5 * c * body.i2, 0.5 * c * body.i3
    return (1.0 - x) / (1.0 + x) * l[0], (1.0 - y) / (1.0 + y) * l[1], (1.0 - z) / (1.0 + z) * l[2]


def rotate_flow(u, l):
    """Rotate L by |u| about u: the flow of dL/dt = u x L over unit time."""
    q = exponential(u)
    return into_body((q[0], -q[1], -q[2], -q[3]), l)


def symmetric_times(m, v):
    """Return M v for a symmetric matrix (xx, yy, zz, yz, zx, xy)."""
    return (
        m[0] * v[0] + m[5] * v[1] + m[4] * v[2],
        m[5] * v[0] + m[1] * v[1] + m[3] * v[2],
        m[4] * v[0] + m[3] * v[1] + m[2] * v[2],
    )


def solve3(a, b, c, v):
    """Solve (a b c) x = v by Cramer's rule; a, b, c are the columns of the matrix."""
    # Cramer's rule has no branch. The matrix is 1 + C/2I, well conditioned for damping.
    n = cross(b, c)
    r = 1.0 / dot(a, n)
    return scale(r, (dot(v, n), dot(v, cross(c, a)), dot(v, cross(a, b))))
