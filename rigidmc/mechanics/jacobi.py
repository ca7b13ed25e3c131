"""Jacobi's elliptic functions and integrals as formulas, accurate even as the modulus tends to 1.

mc = 1 - m is an input, never computed from m. The addition theorem, in forms without cancelling
subtractions, doubles the argument of sn, cn, dn from the series at u/2^11. The integral of the
third kind doubles with them, with one arctangent per level: Carlson's duplication read backwards,
without a root (DLMF 19.26.18).
"""

import math
import sys
from typing import NamedTuple

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.physics.dynamics.arc import elliptic_arc
from rigidmc.physics.dynamics.functions import arctan2
from rigidmc.physics.dynamics.vectors import nearest_integer, select

# smaller mc are replaced by this value; mc = 0 is the separatrix: K(1 - 1e-120) = 139.5, and
# sech K = 2e-60
SMALLEST = 1e-120
# the term after these is at most s^14, 6e-17 at the largest u/2^11, 0.069, because |nu| <= 1
_TERMS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


class Third(NamedTuple):
    """An integral of the third kind as an angle, Theta(u) = mu * integral_0^u sn^2/(1 + nu sn^2).

    mu^2 = nu (1 + nu)(m + nu)
    """

    one_plus_nu: float
    mu: float


def third(nu, one_plus_nu, m_plus_nu):
    """Return the Third of nu >= 0 or -1 <= nu <= -m; in both ranges mu^2 >= 0."""
    return Third(one_plus_nu, math.sqrt(nu * one_plus_nu * m_plus_nu))


def divide(a, b):
    """Return a/b; 0 if b is 0."""
    # where b is 0 the quotient is unused; the divisor 1 keeps it finite
    return select(b == 0.0, 0.0, a / select(b == 0.0, 1.0, b))


def _mean(ab):
    """Compute one round of the arithmetic-geometric mean."""
    return 0.5 * (ab[0] + ab[1]), math.sqrt(ab[0] * ab[1])


def _means(ab):
    """Compute three rounds of the arithmetic-geometric mean."""
    return _mean(_mean(_mean(ab)))


def quarter_period(mc):
    """Return K(m) = pi / (2 agm(1, sqrt(mc))), DLMF 19.8.5."""
    start = 1.0, math.sqrt(max(mc, SMALLEST))
    # twelve rounds, from a ratio of 1e-60 to equality in float64
    return 0.5 * math.pi / _means(_means(_means(_means(start))))[0]


def _duplicated(xyz):
    """Compute one round of Carlson's duplication, which leaves R_F unchanged, DLMF 19.26.18."""
    rx, ry, rz = math.sqrt(xyz[0]), math.sqrt(xyz[1]), math.sqrt(xyz[2])
    shift = rx * ry + ry * rz + rz * rx
    return 0.25 * (xyz[0] + shift), 0.25 * (xyz[1] + shift), 0.25 * (xyz[2] + shift)


def _duplicated_4(xyz):
    """Compute four rounds of Carlson's duplication."""
    return _duplicated(_duplicated(_duplicated(_duplicated(xyz))))


def carlson_first(x, y, z):
    """Return R_F(x, y, z), DLMF 19.36.1.

    Duplications reduce the deviations to 1e-2; then follows the series of degree 7.
    """
    # thirteen rounds, for ratios down to 1e-122
    x, y, z = _duplicated(_duplicated_4(_duplicated_4(_duplicated_4((x, y, z)))))
    middle = (x + y + z) * (1 / 3)
    a, b = 1.0 - x / middle, 1.0 - y / middle
    c = -a - b
    e2, e3 = a * b - c * c, a * b * c
    series = (
        1.0
        - e2 / 10
        + e3 / 14
        + e2 * e2 / 24
        - 3 * e2 * e3 / 44
        - 5 * e2 * e2 * e2 / 208
        + 3 * e3 * e3 / 104
        + e2 * e2 * e3 / 16
    )
    return series / math.sqrt(middle)


def first_kind(s, c, mc, quarter):
    """Return F(phi | m) for -pi <= phi <= pi; s, c : sin phi, cos phi;  quarter : K(m)."""
    ss, cc = s * s, c * c
    # at an amplitude of exactly pi/2 on the separatrix, F equals K: the floor keeps the ratio of
    # the arguments above SMALLEST
    f = abs(s) * carlson_first(max(cc, 0.01 * SMALLEST), cc + max(mc, SMALLEST) * ss, 1.0)
    f = select(c < 0.0, 2.0 * quarter - f, f)
    return select(s < 0.0, -f, f)


def _raised(thirds, angles, s, c, d):
    """Return the angles of the Thirds at 2u from their angles at u; s, c, d : sn, cn, dn at 2u."""
    if len(thirds) == 0:
        return ()
    ss = s * s
    # a sum of positive terms: 1 + nu sn^2 cancels where nu is near -1 and sn near 1
    p = c * c + thirds[0].one_plus_nu * ss
    angle = 2.0 * angles[0] + arctan2(thirds[0].mu * s * ss, p * (1.0 + c + d) + c * d)
    return (angle,) + _raised(thirds[1:], angles[1:], s, c, d)


def _doubled(modulus, thirds, state):
    """Return (sn, cn, dn, angles) at 2u from their values at u, 0 <= 2u <= K; modulus : (m, mc).

        sn 2u = 2 s c d/D,   cn 2u = (c^2 d^2 - mc s^2)/D = 1 - 2 s^2 d^2/D,
        dn 2u = (c^2 d^2 + mc s^2)/D,   D = c^2 + s^2 d^2

    While cn is near 1, it follows from 1 - cn, which is small and accurate; later from the product,
    which does not cancel for 2u <= K.
    """
    m, mc = modulus
    s, c, d, angles = state
    ss, cc, dd = s * s, c * c, d * d
    r = 1.0 / (cc + ss * dd)
    product, rest = cc * dd, mc * ss
    gc, gd = 2.0 * ss * dd * r, 2.0 * m * ss * cc * r
    s = 2.0 * s * c * d * r
    c = select(gc < 0.5, 1.0 - gc, (product - rest) * r)
    d = select(gd < 0.5, 1.0 - gd, (product + rest) * r)
    return s, c, d, _raised(thirds, angles, s, c, d)


def _doubled_3(modulus, thirds, state):
    """Apply `_doubled` three times."""
    return _doubled(modulus, thirds, _doubled(modulus, thirds, _doubled(modulus, thirds, state)))


def _series(ks, m, nu, x, before, last, e, power):
    """Return the sum over k >= 1 of e_k x^k/(2k + 3).

    The e_k are the coefficients of 1/((1 + nu x) sqrt((1 - x)(1 - m x))).
    """
    if len(ks) == 0:
        return 0.0
    k = ks[0]
    following = ((k - 0.5) * (1.0 + m) * last - (k - 1.0) * m * before) / k
    e, power = following - nu * e, power * x
    return e * power / (2.0 * k + 3.0) + _series(ks[1:], m, nu, x, last, following, e, power)


def _first_angles(m, thirds, s):
    """Return the angles at a small u from the series of their integrands in s = sn u.

        mu s^3 (1/3 + e_1 s^2/5 + ...)

    They contribute 4^-11 of an angle for u < 1, and more near the separatrix.
    """
    if len(thirds) == 0:
        return ()
    ss = s * s
    series = 1 / 3 + _series(_TERMS, m, thirds[0].one_plus_nu - 1.0, ss, 0.0, 1.0, 1.0, 1.0)
    return (thirds[0].mu * s * ss * series,) + _first_angles(m, thirds[1:], s)


def _signed(sign, angles):
    """Multiply each angle by sign."""
    if len(angles) == 0:
        return ()
    return (sign * angles[0],) + _signed(sign, angles[1:])


def jacobi(u, m, mc, thirds):
    """Return (sn u, cn u, dn u, angles of the Thirds at u) for |u| <= K."""
    mc = max(mc, SMALLEST)
    start = elliptic_arc(abs(u) / 2048.0, 1.0, m)
    state = (start.s, 1.0 - start.g1, 1.0 - start.g3, _first_angles(m, thirds, start.s))
    # eleven doublings: for u <= K(SMALLEST), u/2^11 <= 0.069, where the error of the series is
    # 1e-16
    both = m, mc
    state = _doubled_3(both, thirds, _doubled_3(both, thirds, _doubled_3(both, thirds, state)))
    s, c, d, angles = _doubled(both, thirds, _doubled(both, thirds, state))
    sign = select(u < 0.0, -1.0, 1.0)
    return sign * s, c, d, _signed(sign, angles)


def jacobi_at(u, m, mc, thirds, s, c, d):
    """Return the angles at 0 <= u <= K when sn, cn, dn are known more accurately than u.

    The last doubling uses the given s, c, d in place of sn, cn, dn of the rounded u.
    """
    half = jacobi(0.5 * u, m, mc, thirds)
    return _raised(thirds, half[3], s, c, d)


def complete(quarter, m, mc, thirds):
    """Return the angles at u = K."""
    return jacobi_at(quarter, m, mc, thirds, 1.0, 0.0, math.sqrt(max(mc, SMALLEST)))


def reduce_argument(u, mc, quarter):
    """Return (n, v) with u = 2 n K + v and |v| <= K.

    The separatrix (mc = 0) has no period: n = 0, and beyond K(SMALLEST) only the angles change.
    """
    n = select(mc > 0.0, nearest_integer(u / (2.0 * quarter)), 0.0)
    v = u - 2.0 * n * quarter
    return n, max(min(v, quarter), -quarter)


def angle_past(one, angle, whole, u, n, v, mc):
    """Return Theta(u) of a Third from Theta(v) and Theta(K) = whole, u = 2 n K + v.

    On the tail of the separatrix, sn^2 = 1 and Theta grows at the rate mu/(1 + nu).
    """
    tail = select(mc > 0.0, 0.0, (u - v) * divide(one.mu, one.one_plus_nu))
    return angle + 2.0 * n * whole + tail


def parity(n):
    """Return (-1)^n for an integer n."""
    return 1.0 - 2.0 * abs(n - 2.0 * nearest_integer(0.5 * n))


class JacobiAt(NamedTuple):
    """Formula for (sn, cn, dn, am) at any u."""

    u: float
    m: float
    mc: float

    def values(self):
        quarter = quarter_period(self.mc)
        n, v = reduce_argument(self.u, self.mc, quarter)
        s, c, d, _ = jacobi(v, self.m, self.mc, ())
        odd = parity(n)
        return odd * s, odd * c, d, arctan2(s, c) + math.pi * n


inline_all(sys.modules[__name__])
