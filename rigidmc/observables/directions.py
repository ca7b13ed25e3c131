"""Directions in space that an axis of the body is compared with."""

import math
from collections.abc import Sequence
from typing import Any

from rigidmc.effects.gravity_gradient import GravityGradient, place
from rigidmc.errors import SceneError, unknown

ORBIT = ("local_vertical", "along_track", "orbit_normal")
WORDS = ("vertical", "momentum", *ORBIT)
RULE = (
    f"expected {', '.join(map(repr, WORDS[:-1]))} or '{WORDS[-1]}', or a direction in space of"
    " three numbers, such as [1, 0, 0]"
)


def check(table: str, key: str, about: Any) -> None:
    """Raise SceneError for what is no direction."""
    if isinstance(about, str):
        if about not in WORDS:
            raise unknown(table, key, about, "direction", WORDS)
        return
    numbers = isinstance(about, Sequence) and len(about) == 3 and all(map(_is_finite, about))
    if not numbers or not any(about):
        raise SceneError(table, key, about, RULE)


def _is_finite(x: Any) -> bool:
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x)


def orbit(table: str, key: str, about: str, effects: Sequence[Any]) -> int:
    """The place of the effect that has the orbit; SceneError if there is none."""
    found = [i for i, one in enumerate(effects) if isinstance(one, GravityGradient)]
    if not found:
        rule = "there is no orbit: it needs [effects.gravity_gradient]"
        raise SceneError(table, key, about, rule)
    return found[0]


def words(about: Any) -> str:
    """The direction in a long_name."""
    if isinstance(about, str):
        named = {"momentum": "angular momentum", "along_track": "direction along the track"}
        return named.get(about, about.replace("_", " "))
    return f"direction ({', '.join(f'{x:g}' for x in about)})"


def on_orbit(effects, which, ahead, t):
    """The unit vector from the central body outward, or that along the track.

    which : (0.0,) as often as there are effects before the one that has the orbit
    ahead : (0.0,) for the direction along the track, at a right angle to the other
    """
    if len(which) > 0:
        return on_orbit(effects[1:], which[1:], ahead, t)
    cosine, sine = place(effects[0], t)
    if len(ahead) > 0:
        return -sine, cosine, 0.0
    return cosine, sine, 0.0
