"""The free motion of a body by rotations: exact for two equal moments, or of order 2 for any body.

They cost less than the motion of `rigidmc.physics.dynamics.free_flow`.
"""

from rigidmc.physics.dynamics.free_flow import middle_axis, relabel
from rigidmc.physics.dynamics.functions import sincos
from rigidmc.physics.dynamics.quaternions import exponential, multiply
from rigidmc.physics.dynamics.vectors import scale, select


def symmetric_flow(body, h, l):
    """Return (turn, change of L) over h of a free body with moments A, A and C, C about an axis e.

        turn = exp(h L/A) exp(h (1/C - 1/A) L_e e)                          (TdC Example 3.5)

    L rotates about e by the angle -h (1/C - 1/A) L_e. Exact for any h.
    """
    return rotate_about_axis(body, h, l)


def rotate_about_axis(body, h, l):
    """Do the same as `symmetric_flow`; derivatives lack the difference of the equal moments."""
    first, third = axis_of_symmetry(body)
    one, two, three = relabel(first, third, l)
    i1, _, i3 = relabel(first, third, (body.i1, body.i2, body.i3))
    _, _, rate = relabel(first, third, (body.a1, body.a2, body.a3))  # (A - C)/(A C) = 1/C - 1/A
    s, c = sincos(0.5 * h * rate * two)
    # 1 - cos and sin of the angle from half of it: 1 - cos x would lose 5 digits at x = 1e-3
    a, b = 2.0 * s * s, 2.0 * s * c
    change = -a * one - b * three, 0.0, b * one - a * three
    x, y, z = relabel(third, first, (0.0, s, 0.0))
    rotation = multiply(exponential(scale(0.5 * h * (i1 + i3), l)), (c, x, y, z))
    return rotation, relabel(third, first, change)


def axis_of_symmetry(body):
    """Return (first, third): whether axis 1 or 3 is the axis of symmetry, which `relabel` makes
    axis 2; else axis 2 is."""
    x, y, z = abs(body.a1), abs(body.a2), abs(body.a3)  # the coefficient of the axis vanishes
    return (x < y) & (x < z), (z < y) & (z <= x)


def turn_by_asymmetry(body, h, l):
    """Return (d, eta): how far `symmetric_flow` is from the motion of a body whose moments A and A'
    are not quite equal. The body turns further by d eta, to first order in d = (1/A - 1/A')/2.

    The axis of symmetry is axis 2. With k = 1/C - 1/A, x = k h L_2 and u(x) = sin(x)/x,

        eta = (h u(x) L_1, h L_2 + k h^2 (v(x) (L_1^2 - L_3^2) + u(x)^2 L_1 L_3), -h u(x) L_3)

    with v(x) = (1 - u(2 x))/(2 x). It solves the equation of the change of attitude,
    eta' = (L_1, L_2, -L_3) + k ((L x eta)_2 e_2 + L_2 eta x e_2). In body axes after the step.
    """
    first, third = axis_of_symmetry(body)
    one, two, three = relabel(first, third, l)
    i1, _, i3 = relabel(first, third, (body.i1, body.i2, body.i3))
    _, _, rate = relabel(first, third, (body.a1, body.a2, body.a3))
    x = h * rate * two
    s, _ = sincos(x)
    # an angle of 0 rad: sin(x)/x is 1
    u = select(x == 0.0, 1.0, s / select(x == 0.0, 1.0, x))
    second = _v(x) * (one * one - three * three) + u * u * one * three
    eta = h * u * one, h * two + h * h * rate * second, -h * u * three
    return 0.5 * (i1 - i3), relabel(third, first, eta)


def _v(x):
    """Return (1 - sin(2x)/(2x))/(2x)."""
    y = 2.0 * x
    w = y * y
    # up to |y| = 1 the series, whose next term is 2e-20: 1 - sin(y)/y would lose digits
    p = 1 / 39916800 - w * (1 / 6227020800 - w * (1 / 1307674368000 - w * (1 / 355687428096000)))
    p = 1 / 6 - w * (1 / 120 - w * (1 / 5040 - w * (1 / 362880 - w * p)))
    small = w < 1.0
    s, _ = sincos(y)
    over = 1.0 / select(small, 1.0, y)
    return select(small, y * p, (1.0 - s * over) * over)


def split_flow(body, h, l):
    """Return (turn, change of L) over h of a free body, by a symmetric splitting of order 2.

    Exact for bodies with two equal moments.

        T = |L|^2/(2 I2) + 1/2 (1/I1 - 1/I2) L1^2 + 1/2 (1/I3 - 1/I2) L3^2

    with the middle moment on axis 2. The first term rotates the body about L and commutes with the
    others, which are rotations about the axes 1 and 3. They are composed symmetrically: h/2 about
    1, h about 3, h/2 about 1.
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
    rotation = multiply(multiply((c1, s1, 0.0, 0.0), (c3, 0.0, 0.0, s3)), (c2, s2, 0.0, 0.0))
    x, y, z = relabel(third, first, rotation[1:])
    rotation = multiply(exponential(scale(h * i2, l)), (rotation[0], x, y, z))
    return rotation, relabel(third, first, (y1, z2, z3))
