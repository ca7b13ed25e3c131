"""The axes in which a body is described, where these are not its principal axes.

Steps are made in principal axes. What users see is in the axes in which they described the body:

    v_described = A v,   q_described = q a^-1,   C_described = A C A^T

The columns of A are the principal axes in the described axes, and a is its quaternion. A body given
by moments or as a solid has A = 1; its MassProperties have no `axes`, and nothing is computed.
"""

from typing import NamedTuple

from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.quaternions import conjugate, multiply


class BodyAxes(NamedTuple):
    """The principal axes of a body in its described axes.

    turn : the quaternion a;  x, y, z : the rows of A, the described axes in the principal axes
    """

    turn: tuple[float, float, float, float]
    x: tuple[float, float, float]
    y: tuple[float, float, float]
    z: tuple[float, float, float]


def body_axes(a):
    """Return the BodyAxes of a unit quaternion a."""
    w, x, y, z = a
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, yz, zx, wx, wy, wz = (
        2.0 * x * y,
        2.0 * y * z,
        2.0 * z * x,
        2.0 * w * x,
        2.0 * w * y,
        2.0 * w * z,
    )
    return BodyAxes(
        a,
        (1.0 - yy - zz, xy - wz, zx + wy),
        (xy + wz, 1.0 - zz - xx, yz - wx),
        (zx - wy, yz + wx, 1.0 - xx - yy),
    )


def with_axes(body, a):
    """Return the MassProperties with the BodyAxes of a quaternion a; unchanged for a = ()."""
    if len(a) == 0:
        return body
    return MassProperties(
        body.i1, body.i2, body.i3, body.a1, body.a2, body.a3, body.p1, body.p2, body.p3,
        body_axes(a),
    )  # fmt: skip


def described(body, v):
    """Return a vector of the principal axes in the described axes, A v."""
    if len(body.axes) == 0:
        return v
    return along(body.axes.x, v), along(body.axes.y, v), along(body.axes.z, v)


def along(e, v):
    """Return the component of a vector along a unit vector."""
    return e[0] * v[0] + e[1] * v[1] + e[2] * v[2]


def described_attitude(body, q):
    """Return the attitude of the described axes for the attitude of the principal axes, q a^-1."""
    if len(body.axes) == 0:
        return q
    return multiply(q, conjugate(body.axes.turn))
