"""Changes of a momentum or an attitude that lose no digits.

A compensated state is a pair (value, remainder) whose exact sum is the state. Every function here
also takes the plain value, a 3-vector or a quaternion, and then rounds as usual.
"""

from rigidmc.dynamics.quaternions import add4, multiply, renewed, touch_up
from rigidmc.dynamics.scalars import select
from rigidmc.dynamics.vectors import add, scale


def whole(x):
    """The value of a state: of a pair (value, remainder) the value."""
    if len(x) == 2:
        return x[0]
    return x


def two_sum(a, b):
    """(s, e): s is the rounded sum, and s + e = a + b exactly.

    Source: Knuth, The Art of Computer Programming 2, 4.2.2.
    """
    s = a + b
    c = s - a
    return s, (a - (s - c)) + (b - c)


def gain(l, dl):
    """l + dl of 3-vectors.

    Of a pair (value, remainder) the pair of the sum, which loses nothing of dl.
    """
    if len(l) == 2:
        value, rest = l
        x, dx = two_sum(value[0], dl[0] + rest[0])
        y, dy = two_sum(value[1], dl[1] + rest[1])
        z, dz = two_sum(value[2], dl[2] + rest[2])
        return (x, y, z), (dx, dy, dz)
    return add(l, dl)


def gain4(q, dq):
    """q + dq of quaternions, brought back to |q| = 1; of a pair (value, remainder) the pair."""
    if len(q) == 2:
        value, rest = q
        a, da = two_sum(value[0], dq[0] + rest[0])
        b, db = two_sum(value[1], dq[1] + rest[1])
        c, dc = two_sum(value[2], dq[2] + rest[2])
        d, dd = two_sum(value[3], dq[3] + rest[3])
        # a change along q restores the norm and leaves the attitude as it is
        r = 0.5 - 0.5 * (a * a + b * b + c * c + d * d)
        r = r + 1.5 * r * r
        a, da = two_sum(a, r * a + da)
        b, db = two_sum(b, r * b + db)
        c, dc = two_sum(c, r * c + dc)
        d, dd = two_sum(d, r * d + dd)
        return (a, b, c, d), (da, db, dc, dd)
    return renewed(add4(q, dq))


def moved(q, turn):
    """q turn of unit quaternions, `turn` in body axes; of a pair (value, remainder) the pair."""
    if len(q) == 2:
        value, rest = q
        # turn - 1 without cancellation; -turn is the same rotation, so the scalar part can be >= 0
        sign = select(turn[0] < 0.0, -1.0, 1.0)
        x, y, z = scale(sign, turn[1:])
        # 1 + cos of half an angle: pure
        less = -(x * x + y * y + z * z) / (1.0 + abs(turn[0])), x, y, z
        return gain4(q, add4(multiply(value, less), multiply(rest, less)))
    return touch_up(multiply(q, turn))
