"""The free motion of a body by rotations: exact for two equal moments, else of order 2."""

from rigidmc.dynamics.elementary import sincos
from rigidmc.dynamics.free_flow import middle_axis, relabel
from rigidmc.dynamics.quaternions import exponential, multiply
from rigidmc.dynamics.vectors import scale


def symmetric_flow(body, h, l):
    """(turn, change of L) in the time h of a free body with moments A, A and C, C about an axis e.

        turn = exp(h L/A) exp(h (1/C - 1/A) L_e e)                          (TdC Example 3.5)

    L rotates about e by the angle -h (1/C - 1/A) L_e. Exact for any h.
    """
    x, y, z = abs(body.a1), abs(body.a2), abs(body.a3)
    # the axis whose coefficient vanishes becomes axis 2
    first, third = (x < y) & (x < z), (z < y) & (z <= x)
    one, two, three = relabel(first, third, l)
    i1, _, i3 = relabel(first, third, (body.i1, body.i2, body.i3))
    _, _, rate = relabel(first, third, (body.a1, body.a2, body.a3))  # (A - C)/(A C) = 1/C - 1/A
    s, c = sincos(0.5 * h * rate * two)
    a, b = 2.0 * s * s, 2.0 * s * c
    change = -a * one - b * three, 0.0, b * one - a * three
    x, y, z = relabel(third, first, (0.0, s, 0.0))
    turn = multiply(exponential(scale(0.5 * h * (i1 + i3), l)), (c, x, y, z))
    return turn, relabel(third, first, change)


def split_flow(body, h, l):
    """(turn, change of L) in the time h of a free body, by a symmetric splitting of order 2.

    Exact for bodies with two equal moments.

        T = |L|^2/2I2 + 1/2 (1/I1 - 1/I2) L1^2 + 1/2 (1/I3 - 1/I2) L3^2,   middle moment on axis 2

    The first term rotates the body about L and commutes with the others, which are rotations about
    the axes 1 and 3. They are composed symmetrically: h/2 about 1, h about 3, h/2 about 1.
    """
    first, third = middle_axis(body)
    one, two, three = relabel(first, third, l)
    _, i2, _ = relabel(first, third, (body.i1, body.i2, body.i3))
    a1, _, a3 = relabel(first, third, (body.a1, body.a2, body.a3))
    # a3 = 1/I2 - 1/I1, a1 = 1/I3 - 1/I2; a rotation about 1 takes (L2, L3) to
    # (c L2 + s L3, c L3 - s L2), c and s of its angle
    s1, c1 = sincos(-0.25 * h * a3 * one)
    x2 = 2.0 * s1 * (c1 * three - s1 * two)
    x3 = -2.0 * s1 * (c1 * two + s1 * three)
    s3, c3 = sincos(0.5 * h * a1 * (three + x3))
    y1 = 2.0 * s3 * (c3 * (two + x2) - s3 * one)
    y2 = x2 - 2.0 * s3 * (c3 * one + s3 * (two + x2))
    s2, c2 = sincos(-0.25 * h * a3 * (one + y1))
    z2 = y2 + 2.0 * s2 * (c2 * (three + x3) - s2 * (two + y2))
    z3 = x3 - 2.0 * s2 * (c2 * (two + y2) + s2 * (three + x3))
    turn = multiply(multiply((c1, s1, 0.0, 0.0), (c3, 0.0, 0.0, s3)), (c2, s2, 0.0, 0.0))
    x, y, z = relabel(third, first, turn[1:])
    turn = multiply(exponential(scale(h * i2, l)), (turn[0], x, y, z))
    return turn, relabel(third, first, (y1, z2, z3))
