"""Truths independent of the package: a 26-digit Taylor series, and rotations in NumPy."""

from operator import mul

import mpmath as mp
import numpy as np

# 26 digits, measured; 40 digits, with 160 bits, degree 36 and steps of 0.3, take twice the time, a
# sixth of all that the tests take
BITS = 112  # behind the point of the Taylor series' numbers, which are integers times 2^-BITS


def taylor(moments, momentum, time, attitude=(1, 0, 0, 0), weight=(0, 0, 0), damping=0, degree=24):
    """(q, L) as lists of 26-digit numbers: L' = L x w - weight x u - damping L, q' = 1/2 q (0, w),
    u = A^T e_z.

    Each step is the Taylor polynomial of the solution; Cauchy products give its coefficients, times
    powers of the step, from those of lower order. Integers take a sixth of the time of mpmath's
    numbers; their units are the largest momentum of the start and the smallest moment.
    """
    with mp.workprec(2 * BITS):
        size = max(abs(mp.mpf(x)) for x in momentum) or mp.mpf(1)
        unit = min(map(mp.mpf, moments)) / size  # of time
        inverse = [unit * size / mp.mpf(i) for i in moments]
        q, l = [mp.mpf(x) for x in attitude], [mp.mpf(x) / size for x in momentum]
        c, damping = [unit * mp.mpf(x) / size for x in weight], unit * mp.mpf(damping)
        time = mp.mpf(time) / unit
        rate = (
            sum(abs(x * i) for x, i in zip(l, inverse, strict=True))
            + mp.sqrt(sum(map(abs, c)) * max(inverse))
            + abs(damping)
        )
        steps = int(mp.ceil(abs(time) * rate / mp.mpf("0.4"))) + 1
        h, damping = _fixed(time / steps), _fixed(damping)
        inverse, c, q, l = ([_fixed(x) for x in values] for values in (inverse, c, q, l))
        for _ in range(steps):
            q, l = _taylor_step(inverse, c, damping, q, l, h, degree)
        return [mp.ldexp(x, -BITS) for x in q], [mp.ldexp(x, -BITS) * size for x in l]


def _fixed(x):
    return int(mp.nint(mp.ldexp(mp.mpf(x), BITS)))


def _taylor_step(inverse, c, damping, q, l, h, degree):
    q, l = [[x] for x in q], [[x] for x in l]
    w = [[x[0] * i >> BITS] for x, i in zip(l, inverse, strict=True)]
    for k in range(degree):

        def times(a, b, k=k):
            return sum(map(mul, a[: k + 1], b[k::-1])) >> BITS

        def cross(a, b):
            return [times(a[i], b[j]) - times(a[j], b[i]) for i, j in ((1, 2), (2, 0), (0, 1))]

        u = (
            2 * (times(q[1], q[3]) - times(q[0], q[2])),
            2 * (times(q[2], q[3]) + times(q[0], q[1])),
            times(q[0], q[0]) - times(q[1], q[1]) - times(q[2], q[2]) + times(q[3], q[3]),
        )
        vector = [times(q[0], w[i]) + x for i, x in enumerate(cross(q[1:], w))]
        slope = [-times(q[1], w[0]) - times(q[2], w[1]) - times(q[3], w[2]), *vector]
        torque = [
            c[j] * u[i] - c[i] * u[j] - damping * l[m][k] >> BITS
            for m, (i, j) in enumerate(((1, 2), (2, 0), (0, 1)))
        ]
        force = [a + b for a, b in zip(cross(l, w), torque, strict=True)]
        for a, slope_a in zip(q, slope, strict=True):
            a.append((slope_a * h >> BITS) // (2 * (k + 1)))
        for a, b, force_a, i in zip(l, w, force, inverse, strict=True):
            a.append((force_a * h >> BITS) // (k + 1))
            b.append(a[-1] * i >> BITS)
    return [sum(a) for a in q], [sum(a) for a in l]


def true_end(problem):
    """(q, L) of a catalogued problem as arrays, from the Taylor series."""
    weight = [mp.mpf(problem.gravity) * mp.mpf(p) for p in problem.static_moment]
    start = problem.moments, problem.momentum, problem.time, problem.attitude
    q, l = taylor(*start, weight)
    return np.array(q, float), np.array(l, float)


def apart(a, b=0.0):
    """The largest |a - b|; nan if there is one."""
    return np.abs(np.subtract(a, b)).max()


def off(motion, truth, least=0.0):
    """(error of the momentum over its size, or over `least`, of the attitude [rad]) of a motion."""
    q, l = (np.array(x, float) for x in truth)
    size = max(np.linalg.norm(l), least)
    return apart(motion.momentum, l) / size, attitude_error(motion.attitude, q)


def attitude_error(q, p):
    """Angle between attitudes (4, ...) [rad]; not arccos |q.p|, which loses half the digits."""
    q, p = np.asarray(q, float), np.asarray(p, float)
    chord = np.minimum(np.linalg.norm((q.T - p.T), axis=-1), np.linalg.norm((q.T + p.T), axis=-1))
    return 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))


def rotation(q):
    """A of x_space = A x_body, TdC (3.1)."""
    w, v = q[0], np.asarray(q[1:], float)
    return (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * hat(v)


def unit(q):
    """q/|q| as a tuple."""
    return tuple(float(x) for x in np.divide(q, np.linalg.norm(q)))


def moved(tensor, mass, centre):
    """A tensor about a point from which the centre of mass is at `centre`, by Steiner's theorem."""
    c = np.array(centre)
    return np.array(tensor) + mass * (c @ c * np.eye(3) - np.outer(c, c))


def hat(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rodrigues(u):
    """exp(hat(u))."""
    angle = np.linalg.norm(u)
    k = hat(u)
    one, two = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.eye(3) + one * k + two * k @ k
