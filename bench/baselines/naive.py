"""The Numba baseline as a good user writes it: prange over tops, the time loop inside.

Million member-steps/s, free | heavy: 61 | 45, where bench/baselines/tops.c reaches 411 | 297.
Without forceinline LLVM leaves calls in the heavy one: 61 | 24. Numba does not vectorise over tops,
because the body of prange contains the time loop.
"""

import math

from numba import njit, prange


@njit(fastmath=True, forceinline=True)
def free_rates(i1, i2, i3, a1, a2, a3, q0, q1, q2, q3, l1, l2, l3):
    """Rates of quaternion and body angular momentum of a free top."""
    w1, w2, w3 = 0.5 * i1 * l1, 0.5 * i2 * l2, 0.5 * i3 * l3
    return (
        -q1 * w1 - q2 * w2 - q3 * w3,
        q0 * w1 + q2 * w3 - q3 * w2,
        q0 * w2 + q3 * w1 - q1 * w3,
        q0 * w3 + q1 * w2 - q2 * w1,
        a1 * l2 * l3,
        a2 * l3 * l1,
        a3 * l1 * l2,
    )


@njit(fastmath=True, forceinline=True)
def torque(p1, p2, p3, q0, q1, q2, q3):
    """Torque of gravity on a static moment p (times g)."""
    u1, u2 = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1)
    u3 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    return u2 * p3 - u3 * p2, u3 * p1 - u1 * p3, u1 * p2 - u2 * p1


@njit(fastmath=True, forceinline=True)
def heavy_rates(i1, i2, i3, a1, a2, a3, p1, p2, p3, q0, q1, q2, q3, l1, l2, l3):
    """Rates of quaternion and body angular momentum of a heavy top."""
    d0, d1, d2, d3, d4, d5, d6 = free_rates(i1, i2, i3, a1, a2, a3, q0, q1, q2, q3, l1, l2, l3)
    t1, t2, t3 = torque(p1, p2, p3, q0, q1, q2, q3)
    return d0, d1, d2, d3, d4 + t1, d5 + t2, d6 + t3


@njit(fastmath=True, forceinline=True)
def ahead(c, x, d):
    """x + c d, for a state x and rates d."""
    return (
        x[0] + c * d[0],
        x[1] + c * d[1],
        x[2] + c * d[2],
        x[3] + c * d[3],
        x[4] + c * d[4],
        x[5] + c * d[5],
        x[6] + c * d[6],
    )


@njit(fastmath=True, forceinline=True)
def summed(h, x, a, b, c, d):
    """The end of a step, normalised."""
    y = ahead(h / 6.0, ahead(h / 3.0, ahead(h / 3.0, ahead(h / 6.0, x, a), b), c), d)
    r = 1.0 / math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3])
    return r * y[0], r * y[1], r * y[2], r * y[3], y[4], y[5], y[6]


@njit(parallel=True, fastmath=True)
def rk4_free(state, inverse, a, steps, h):
    """Move the states (n, 7) of free tops by rk4 steps h; inverse moments and a = (I2 - I3)/(I2 I3)
    are (n, 3).
    """
    for k in prange(state.shape[0]):
        i1, i2, i3 = inverse[k]
        a1, a2, a3 = a[k]
        x = (
            state[k, 0],
            state[k, 1],
            state[k, 2],
            state[k, 3],
            state[k, 4],
            state[k, 5],
            state[k, 6],
        )
        for _ in range(steps):
            d1 = free_rates(i1, i2, i3, a1, a2, a3, *x)
            d2 = free_rates(i1, i2, i3, a1, a2, a3, *ahead(0.5 * h, x, d1))
            d3 = free_rates(i1, i2, i3, a1, a2, a3, *ahead(0.5 * h, x, d2))
            d4 = free_rates(i1, i2, i3, a1, a2, a3, *ahead(h, x, d3))
            x = summed(h, x, d1, d2, d3, d4)
        for j in range(7):
            state[k, j] = x[j]


@njit(parallel=True, fastmath=True)
def rk4_heavy(state, inverse, a, p, steps, h):
    """The same under gravity; p = g times static moment, (n, 3)."""
    for k in prange(state.shape[0]):
        i1, i2, i3 = inverse[k]
        a1, a2, a3 = a[k]
        p1, p2, p3 = p[k]
        x = (
            state[k, 0],
            state[k, 1],
            state[k, 2],
            state[k, 3],
            state[k, 4],
            state[k, 5],
            state[k, 6],
        )
        for _ in range(steps):
            d1 = heavy_rates(i1, i2, i3, a1, a2, a3, p1, p2, p3, *x)
            d2 = heavy_rates(i1, i2, i3, a1, a2, a3, p1, p2, p3, *ahead(0.5 * h, x, d1))
            d3 = heavy_rates(i1, i2, i3, a1, a2, a3, p1, p2, p3, *ahead(0.5 * h, x, d2))
            d4 = heavy_rates(i1, i2, i3, a1, a2, a3, p1, p2, p3, *ahead(h, x, d3))
            x = summed(h, x, d1, d2, d3, d4)
        for j in range(7):
            state[k, j] = x[j]
