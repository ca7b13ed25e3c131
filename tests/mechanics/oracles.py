"""Closed forms at 50 digits, by the classical formulas and the elliptic functions of mpmath.

Nothing of the package is used. Free top: omega from sn, cn, dn and the attitude by one phase with
Pi (Celledoni, Fasso, Saefstroem & Zanna 2008, corrected signs). Lagrange top: Euler angles from the
roots of the cubic and two Pi. Each for one top and any time.
"""

import warnings

import mpmath as mp

DIGITS = 50
# for the Lagrange top: u2 and u3 may be 1e-20 apart, and the roots then keep 50 - 2 x 20 digits of
# 50
ROOTS = 100


def free(moments, momentum, t, attitude=(1, 0, 0, 0)):
    """(q, L) of an asymmetric body, moments ascending, off separatrix and axes, as lists of mpf."""
    with mp.workdps(DIGITS):
        i, l, q = ([mp.mpf(x) for x in row] for row in (moments, momentum, attitude))
        # mirror: exchanging axes 1 and 3 and reversing axis 2 keeps the frame right-handed
        if mp.fdot(l, l) < mp.fsum(x * x / m for x, m in zip(l, i, strict=True)) * i[1]:
            turn, end = _free(i[::-1], [l[2], -l[1], l[0]], mp.mpf(t))
            turn, end = [turn[0], turn[3], -turn[2], turn[1]], [end[2], -end[1], end[0]]
        else:
            turn, end = _free(i, l, mp.mpf(t))
        return multiply(q, turn), end


def _free(i, l, t):
    """The motion about axis 3, by quadrature-free forms: u3 = C dn, its phase with Pi."""
    size = mp.sqrt(mp.fdot(l, l))
    energy = mp.fsum(x * x / m for x, m in zip(l, i, strict=True))
    low = (energy - size**2 / i[2]) / (1 / i[0] - 1 / i[2])  # largest L1^2
    high = (energy - size**2 / i[0]) / (1 / i[2] - 1 / i[0])  # largest L3^2
    across = (energy - size**2 / i[2]) / (1 / i[1] - 1 / i[2])  # largest L2^2
    rate = mp.sqrt((1 / i[1] - 1 / i[2]) * (1 / i[0] - 1 / i[2]) * high)
    m = (1 / i[0] - 1 / i[1]) / (1 / i[1] - 1 / i[2]) * low / high
    # L2' = a2 L3 L1 with a2 = 1/I1 - 1/I3: at the apex L1 > 0 it has the sign of a2 L3
    sign2 = mp.sign(l[2]) * mp.sign(1 / i[0] - 1 / i[2])
    phase = mp.atan2(sign2 * l[1] / mp.sqrt(across), l[0] / mp.sqrt(low))
    start = mp.ellipf(phase, m)
    u = start + rate * t
    period = mp.ellipk(m)

    def state(u):
        s, c, d = (mp.ellipfun(k, u, m=m) for k in ("sn", "cn", "dn"))
        turns = mp.nint(u / (2 * period))
        am = turns * mp.pi + mp.atan2(s * (-1) ** int(turns), c * (-1) ** int(turns))
        third = mp.sign(l[2]) * mp.sqrt(high) * d
        return [mp.sqrt(low) * c, sign2 * mp.sqrt(across) * s, third], am

    (begin, am0), (end, am1) = state(start), state(u)
    # psi' = (2T + |L| |L3|/I3)/(|L| + |L3|) integrates to |L| t/I1 - (...) Pi - atan: with c =
    # sqrt(high)/|L|, 1 - u3^2 = b^2 + c^2 m sn^2
    c2 = high / size**2
    b2 = 1 - c2
    w2 = b2 + c2 * m
    n = -c2 * m / b2

    def integral(am):  # of c dn/(1 + c dn) du = elementary - (Pi/b^2 - u)
        whole = mp.nint(am / mp.pi) * mp.pi
        rest = mp.atan2(mp.sqrt(w2) * mp.sin(am - whole), mp.sqrt(b2) * mp.cos(am - whole))
        elementary = mp.sqrt(c2) / mp.sqrt(b2 * w2) * (whole + rest)
        return elementary - mp.ellippi(n, am, m) / b2 + mp.ellipf(am, m)

    share = (integral(am1) - integral(am0)) / rate * size
    psi = energy / size * t + (1 / i[2] - energy / size**2) * share
    sg = mp.sign(l[2])
    turn = [mp.cos(psi / 2), 0, 0, sg * mp.sin(psi / 2)]
    back, forth = _to_third(begin, size, sg), _to_third(end, size, sg)
    return multiply(multiply([back[0], *(-x for x in back[1:])], turn), forth), end


def _to_third(l, size, sg):
    q = [size + abs(l[2]), sg * l[1], -sg * l[0], mp.mpf(0)]
    norm = mp.sqrt(mp.fdot(q, q))
    return [x / norm for x in q]


def lagrange(one, three, k, momentum, attitude, t):
    """(q, L) of a Lagrange top off the vertical, with a nutation, as lists of mpf."""
    with mp.workdps(ROOTS):
        one, three, k, t = (mp.mpf(x) for x in (one, three, k, t))
        q, l = [mp.mpf(x) for x in attitude], [mp.mpf(x) for x in momentum]
        norm = mp.sqrt(mp.fdot(q, q))
        q = [x / norm for x in q]
        g = [
            2 * (q[1] * q[3] - q[0] * q[2]),
            2 * (q[2] * q[3] + q[0] * q[1]),
            q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2,
        ]
        a, b, u0 = mp.fdot(l, g) / one, l[2] / one, g[2]
        be = 2 * k / one
        al = (l[0] ** 2 + l[1] ** 2) / one**2 + be * u0
        slope = (g[0] * l[1] - g[1] * l[0]) / one
        cubic = [be, -(al + b * b), 2 * a * b - be, al - a * a]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of the order of the coefficients
            found = mp.polyroots(cubic, maxsteps=500, extraprec=400)
        u1, u2, u3 = sorted(mp.re(x) for x in found)
        m, p = (u2 - u1) / (u3 - u1), mp.sqrt(be * (u3 - u1)) / 2
        am0 = mp.asin(mp.sqrt(min(max((u0 - u1) / (u2 - u1), 0), 1))) * (1 if slope >= 0 else -1)
        x0 = mp.ellipf(am0, m)
        x1 = x0 + p * t
        quarter = mp.ellipk(m)
        turns = mp.nint(x1 / (2 * quarter))
        s, c, d = (mp.ellipfun(name, x1, m=m) for name in ("sn", "cn", "dn"))
        am1 = turns * mp.pi + mp.atan2(s * (-1) ** int(turns), c * (-1) ** int(turns))
        u = u1 + (u2 - u1) * s * s

        def phase(nu):
            return (mp.ellippi(nu, am1, m) - mp.ellippi(nu, am0, m)) / p

        minus = (a - b) / (2 * (1 - u1)) * phase((u2 - u1) / (1 - u1))
        plus = (a + b) / (2 * (1 + u1)) * phase(-(u2 - u1) / (1 + u1))
        phi = mp.atan2(q[3], q[0]) + mp.atan2(q[2], q[1]) + minus + plus
        psi = mp.atan2(q[3], q[0]) - mp.atan2(q[2], q[1]) + (l[2] / three - b) * t - minus + plus
        half = mp.acos(u) / 2
        both, apart, sine = (phi + psi) / 2, (phi - psi) / 2, mp.sin(2 * half)
        level, upright = (
            [mp.sin(half) * mp.cos(apart), mp.sin(half) * mp.sin(apart)],
            [mp.cos(half) * mp.cos(both), mp.cos(half) * mp.sin(both)],
        )
        across, along = one * (a - b * u) / sine, -2 * one * p * (u2 - u1) * s * c * d / sine
        s, c = mp.sin(psi), mp.cos(psi)
        end = [across * s + along * c, across * c - along * s, l[2]]
        return [upright[0], *level, upright[1]], end


def multiply(p, q):
    """The product of quaternions of mpf."""
    (a, *u), (b, *v) = p, q
    cross = [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]
    vector = [a * y + b * x + z for x, y, z in zip(u, v, cross, strict=True)]
    return [a * b - mp.fdot(u, v), *vector]


def symmetric(moments, momentum, t, attitude=(1, 0, 0, 0)):
    """(q, L) of a body with I1 = I2, of a sphere, or at rest: two rotations, TdC Example 3.5."""
    with mp.workdps(DIGITS):
        one, three, t = mp.mpf(moments[0]), mp.mpf(moments[2]), mp.mpf(t)
        l, q = ([mp.mpf(x) for x in row] for row in (momentum, attitude))
        size = mp.sqrt(mp.fdot(l, l))
        half, angle = size * t / one / 2, (1 / three - 1 / one) * l[2] * t
        s, c = mp.sin(angle), mp.cos(angle)
        about = [mp.cos(half), *(mp.sin(half) * x / (size or 1) for x in l)]
        spin = [mp.cos(angle / 2), mp.mpf(0), mp.mpf(0), mp.sin(angle / 2)]
        end = [l[0] * c + l[1] * s, l[1] * c - l[0] * s, l[2]]
        return multiply(q, multiply(about, spin)), end
