"""Progress of a free body over a time: Jacobi's elliptic functions without branches or a modulus.

Series for short times, the addition theorem for longer ones; no inverse function is needed.
"""

from typing import NamedTuple

from rigidmc.physics.dynamics.methods import OFF, ON


class EllipticArc(NamedTuple):
    """The progress of the flow over a time h: S, g1 = 1 - f1 and g3 = 1 - f3, where S is like sn.

    S' = f1 f3,   f1' = -x S f3,   f3' = -y S f1
    """

    s: float
    g1: float
    g3: float


def elliptic_arc(h, x, y):
    """Return the EllipticArc of a short time.

    Series of S and f1^2 = 1 - x S^2, f3^2 = 1 - y S^2. It omits 0.0036 (h sqrt(max(x, y)))^12 of S
    or less, 4e-15 at 0.1 (tests/physics/dynamics/test_series.py).
    """
    # dimensionless: x and y by themselves reach 1e92 for the moments of a molecule
    hx, hy = h * h * x, h * h * y
    # DLMF 22.10.4 in the symmetric sums u = x + y and p = x y, so no modulus is formed
    u, p = hx + hy, hx * hy
    uu = u * u
    t = u * (uu * uu + 11064.0 * uu * p + 132624.0 * p * p) * (1 / 39916800)
    t = (uu * uu + 1224.0 * uu * p + 3024.0 * p * p) * (1 / 362880) - t
    t = u * (uu + 132.0 * p) * (1 / 5040) - t
    t = (uu + 12.0 * p) * (1 / 120) - t
    s = h * (1.0 - (u * (1 / 6) - t))
    ss = s * s
    return EllipticArc(s, _less_than_root(x * ss), _less_than_root(y * ss))


def _less_than_root(z):
    """Return 1 - sqrt(1 - z) for |z| < 0.016, by its series, which is faster than a root.

    The series omits a fraction 0.022 z^8 (tests/physics/dynamics/test_series.py).
    """
    # Horner's rule in two parts: a chain of fused multiply-adds, with no division.
    p = 21 / 512 + z * (33 / 1024 + z * (429 / 16384))
    p = 1 / 8 + z * (5 / 64 + z * (7 / 128 + z * p))
    return 0.5 * z * (1.0 + z * (1 / 4 + z * p))


def _reciprocal(u, near):
    """Return 1/(1 - u) to rounding; near : OFF for any u, ON for |u| < 0.1.

    For small u it takes a series to u^3 and two Newton steps, which is faster than a division
    (tests/physics/dynamics/test_series.py).
    """
    if len(near) == 0:
        return 1.0 / (1.0 - u)
    # the series lacks u^4 < 1e-4; each Newton step squares that: 1e-8, then 1e-16
    d, r = 1.0 - u, 1.0 + u * (1.0 + u * (1.0 + u))
    r = r + r * (1.0 - d * r)
    return r + r * (1.0 - d * r)


def double_arc(a, x, y, near=OFF):
    """Return the EllipticArc of twice the time; near : ON for short times, see `_reciprocal`.

    g = 1 - f of the doubled time comes from a factored form, so no digit cancels.
    """
    ss = a.s * a.s
    f1, f3 = 1.0 - a.g1, 1.0 - a.g3
    r = _reciprocal((x * ss) * (y * ss), near)
    return EllipticArc(
        2.0 * a.s * f1 * f3 * r, 2.0 * x * ss * f3 * f3 * r, 2.0 * y * ss * f1 * f1 * r
    )


def increment(body, a, p, l, near=OFF):
    """Return L(t + h) - L(t) of a free body for the EllipticArc of h; p : P of `squares`.

    near : ON if h is the time of an arc without doublings, or of one panel; see `_reciprocal`

    T and |L|^2 are conserved to rounding for any S in the range of `near`, and the errors do not
    accumulate: the plain form L1' = (f1 L1 + f3 S a1 L2 L3)/D drifts linearly (9e-13 after 1e4
    steps), this one makes a random walk (3e-15; tests/physics/dynamics/test_free_flow.py).
    """
    f1, f3 = 1.0 - a.g1, 1.0 - a.g3
    u = p * (a.s * a.s)
    r = _reciprocal(u, near)
    return (
        r * (f3 * a.s * body.a1 * l[1] * l[2] + (u - a.g1) * l[0]),
        r * (a.s * body.a2 * l[0] * l[2] + (u - (a.g1 + a.g3 - a.g1 * a.g3)) * l[1]),
        r * (f1 * a.s * body.a3 * l[0] * l[1] + (u - a.g3) * l[2]),
    )


def squares(body, l):
    """Return (P, Q1, Q3) = (a1 a3 L2^2, -a2 a3 L1^2, -a1 a2 L3^2).

    All are >= 0 if axis 2 has the middle moment. x = P + Q3 and y = P + Q1 are constants of motion.
    """
    return (
        body.a1 * body.a3 * l[1] * l[1],
        -body.a2 * body.a3 * l[0] * l[0],
        -body.a1 * body.a2 * l[2] * l[2],
    )


def half_and_full(h, x, y, halvings):
    """Return (arc of h/2, arc of h): the series at h/2^(1 + len(halvings)), then doublings."""
    if len(halvings) == 0:
        half = elliptic_arc(0.5 * h, x, y)
        return half, double_arc(half, x, y, ON)
    half = half_and_full(0.5 * h, x, y, halvings[1:])[1]
    return half, double_arc(half, x, y)


def near_flag(halvings):
    """Return `near` for an EllipticArc with these halvings: ON if there are none."""
    if len(halvings) == 0:
        return ON
    return OFF


def panel_arcs(half, whole, h, x, y, panels):
    """Return (arc of half a panel, arc of a panel) for a time h cut into panels.

    half, whole : the arcs of h/2 and h
    """
    if len(panels) == 1:
        return half, whole
    return half_and_full(panels[0] * h, x, y, ())
