"""Directions in space for comparison with an axis of the body."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from rigidmc.errors import SceneError, unknown
from rigidmc.physics.dynamics.methods import OFF, ON, Count, Flag, flag, static_count
from rigidmc.physics.dynamics.so3 import dot, first_three, into_body, vertical
from rigidmc.physics.effects.field import RotatingField, UniformField, field_at
from rigidmc.physics.effects.gravity_gradient import GravityGradient, place
from rigidmc.physics.observables.protocol import is_finite, require

ORBIT = ("local_vertical", "along_track", "orbit_normal")
WORDS = ("vertical", "momentum", "field", *ORBIT)
RULE = (
    f"expected {', '.join(map(repr, WORDS[:-1]))} or '{WORDS[-1]}', or a direction in space of"
    " three numbers, such as [1, 0, 0]"
)


def check(about: Any, at: str) -> None:
    """Raise SceneError unless `about` is a direction."""
    if isinstance(about, str) and about not in WORDS:
        raise unknown("direction", WORDS, at=at, value=about)
    require(isinstance(about, str) or is_vector(about), RULE, at, about)


def is_vector(value: Any) -> bool:
    """Return whether a value is three numbers that define a direction."""
    several = isinstance(value, Sequence) and not isinstance(value, str) and len(value) == 3
    return several and all(map(is_finite, value)) and any(value)


def unit(axis: int) -> tuple[float, float, float]:
    """Return the unit vector of body axis 1, 2 or 3, or of its other end -1, -2 or -3."""
    one, two, three = (math.copysign(abs(axis) == i, axis) for i in (1, 2, 3))
    return one, two, three


def source(about: str, effects: Sequence[Any], at: str) -> int:
    """Return the index of the effect with the orbit or field; raise SceneError if missing."""
    field = about == "field"
    kinds = (UniformField, RotatingField) if field else (GravityGradient,)
    found = [i for i, one in enumerate(effects) if isinstance(one, kinds)]
    if not found:
        names = "uniform_field] or [effects.rotating_field" if field else "gravity_gradient"
        rule = f"there is no {'field' if field else 'orbit'}: add [effects.{names}]"
        raise SceneError(rule, at=at, value=about)
    if field and len(found) > 1:
        raise SceneError("expected one field; the scene has several", at=at, value=about)
    return found[0]


def words(about: Any) -> str:
    """Return the direction as words for a long_name."""
    if isinstance(about, str):
        named = {"momentum": "angular momentum", "along_track": "direction along the track"}
        return named.get(about, about.replace("_", " "))
    return f"direction ({', '.join(f'{x:g}' for x in about)})"


class Direction(NamedTuple):
    """A direction in compiled form. All flags OFF mean the vertical.

    momentum, orbit, field : ON for the angular momentum, for a direction of the orbit, for the
        field
    which : number of effects before the one with the orbit or the field
    other : ON for the direction along the track, and for a rotating field
    vector : (x, y, z) of a fixed unit vector in space, else ()
    """

    momentum: Flag = OFF
    orbit: Flag = OFF
    field: Flag = OFF
    which: Count = static_count(0)
    other: Flag = OFF
    vector: tuple[float, ...] = ()


def make_direction(about: Any, effects: Sequence[Any], at: str) -> Direction:
    """Return the Direction for `about`; raise SceneError if its orbit or field is missing."""
    if not isinstance(about, str):
        size = math.hypot(*about)
        return Direction(vector=tuple(x / size for x in about))
    if about in (*ORBIT, "field"):
        index = source(about, effects, at)
        if about == "field":
            turns = flag(isinstance(effects[index], RotatingField))
            return Direction(field=ON, which=static_count(index), other=turns)
        if about != "orbit_normal":  # the space z axis
            ahead = flag(about == "along_track")
            return Direction(orbit=ON, which=static_count(index), other=ahead)
    return Direction(momentum=flag(about == "momentum"))


def direction_in_body(direction, effects, t, q, l):
    """Return a vector along a Direction, in body components."""
    if len(direction.momentum) > 0:
        return first_three(l)
    if len(direction.orbit) > 0:
        return into_body(q, on_orbit(effects, direction.which, direction.other, t))
    if len(direction.field) > 0:
        return into_body(q, on_field(effects, direction.which, direction.other, t))
    if len(direction.vector) > 0:
        return into_body(q, direction.vector)
    return vertical(q)


def length(direction, v):
    """Return the length of a vector along a Direction: 1 except for momenta and fields."""
    if len(direction.momentum) > 0:
        return math.sqrt(dot(v, v))
    if len(direction.field) > 0:
        return math.sqrt(dot(v, v))
    return 1.0


def marked_component(marks, v):
    """Return the component of a vector along the first marked axis."""
    if len(marks[0]) > 0:
        return v[0]
    if len(marks[1]) > 0:
        return v[1]
    return v[2]


def on_orbit(effects, index, ahead, t):
    """Return the unit vector from the central body outward, or the one along the track.

    index : number of effects before the one with the orbit
    ahead : ON for the direction along the track, perpendicular to the outward vector
    """
    cosine, sine = place_on(effects, index, t)
    if len(ahead) > 0:
        return -sine, cosine, 0.0
    return cosine, sine, 0.0


def place_on(effects, index, t):
    """Return (cosine, sine) of the true anomaly; index : see `on_orbit`."""
    if len(index) > 0:
        return place_on(effects[1:], index[1:], t)
    return place(effects[0], t)


def on_field(effects, index, turns, t):
    """Return the field in space at time t, not normalised.

    index : number of effects before the one with the field
    turns : ON for a rotating field
    """
    if len(index) > 0:
        return on_field(effects[1:], index[1:], turns, t)
    if len(turns) > 0:
        return field_at(effects[0].field, effects[0].rate, t)
    return effects[0].field
