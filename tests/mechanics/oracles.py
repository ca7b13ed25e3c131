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
        i = [mp.mpf(x) for x in moments]
        l = [mp.mpf(x) for x in momentum]
        square, twice_energy = mp.fdot(l, l), mp.fsum(x * x / m for x, m in zip(l, i, strict=True))
        if (
            square < twice_energy * i[1]
        ):  # mirror: exchanging axes 1 and 3 and reversing axis 2 keeps the frame right-handed
            swap = [l[2], -l[1], l[0]]
            q, end = _free([i[2], i[1], i[0]], swap, mp.mpf(t))
            q = [q[0], q[3], -q[2], q[1]]
            end = [end[2], -end[1], end[0]]
        else:
            q, end = _free(i, l, mp.mpf(t))
        return _multiply([mp.mpf(x) for x in attitude], q), end


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
        return [
            mp.sqrt(low) * c,
            sign2 * mp.sqrt(across) * s,
            mp.sign(l[2]) * mp.sqrt(high) * d,
        ], am

    (begin, am0), (end, am1) = state(start), state(u)
    # psi' = (2T + |L| |L3|/I3)/(|L| + |L3|) integrates to |L| t/I1 - (...) Pi - atan: with c =
    # sqrt(high)/|L|, 1 - u3^2 = b^2 + c^2 m sn^2
    c2 = high / size**2
    b2 = 1 - c2
    w2 = b2 + c2 * m
    n = -c2 * m / b2

    def integral(am):  # of c dn/(1 + c dn) du = elementary - (Pi/b^2 - u)
        turns = mp.nint(am / mp.pi)
        elementary = (
            mp.sqrt(c2)
            / mp.sqrt(b2 * w2)
            * (
                turns * mp.pi
                + mp.atan2(
                    mp.sqrt(w2) * mp.sin(am - turns * mp.pi),
                    mp.sqrt(b2) * mp.cos(am - turns * mp.pi),
                )
            )
        )
        return elementary - mp.ellippi(n, am, m) / b2 + mp.ellipf(am, m)

    share = (integral(am1) - integral(am0)) / rate * size
    psi = energy / size * t + (1 / i[2] - energy / size**2) * share
    sg = mp.sign(l[2])
    turn = [mp.cos(psi / 2), 0, 0, sg * mp.sin(psi / 2)]
    back, forth = _to_third(begin, size, sg), _to_third(end, size, sg)
    return _multiply(_multiply([back[0], -back[1], -back[2], -back[3]], turn), forth), end


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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of the order of the coefficients
            found = mp.polyroots(
                [be, -(al + b * b), 2 * a * b - be, al - a * a], maxsteps=500, extraprec=400
            )
        roots = sorted(mp.re(x) for x in found)
        u1, u2, u3 = roots
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
        end = [
            mp.cos(half) * mp.cos((phi + psi) / 2),
            mp.sin(half) * mp.cos((phi - psi) / 2),
            mp.sin(half) * mp.sin((phi - psi) / 2),
            mp.cos(half) * mp.sin((phi + psi) / 2),
        ]
        sine = mp.sin(2 * half)
        dphi, dtheta = (a - b * u) / sine**2, -2 * p * (u2 - u1) * s * c * d / sine
        return end, [
            one * (dphi * sine * mp.sin(psi) + dtheta * mp.cos(psi)),
            one * (dphi * sine * mp.cos(psi) - dtheta * mp.sin(psi)),
            l[2],
        ]


def _multiply(p, q):
    return [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    ]


def symmetric(moments, momentum, t, attitude=(1, 0, 0, 0)):
    """(q, L) of a body with I1 = I2, or of a sphere: two rotations, TdC Example 3.5."""
    with mp.workdps(DIGITS):
        one, three, t = mp.mpf(moments[0]), mp.mpf(moments[2]), mp.mpf(t)
        l = [mp.mpf(x) for x in momentum]
        angle = (1 / three - 1 / one) * l[2] * t
        end = [
            l[0] * mp.cos(angle) + l[1] * mp.sin(angle),
            l[1] * mp.cos(angle) - l[0] * mp.sin(angle),
            l[2],
        ]
        size = mp.sqrt(mp.fdot(l, l))
        half = size * t / one / 2
        about = [mp.cos(half), *(mp.sin(half) * x / size for x in l)]
        spin = [mp.cos(angle / 2), mp.mpf(0), mp.mpf(0), mp.sin(angle / 2)]
        return _multiply([mp.mpf(x) for x in attitude], _multiply(about, spin)), end
