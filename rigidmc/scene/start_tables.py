"""Tables of a start that say more than numbers: the sequence and unit of Euler angles, the order of
a quaternion, and values relative to the local frame of an orbit.

    attitude = { euler = "321", angles = [10, 20, 30], unit = "deg" }
    attitude = { quaternion = [0.0, 0.0, 0.0, 1.0], order = "xyzw" }
    attitude = { euler = "321", angles = [0.0, 0.1, 0.0], relative_to = "orbit" }
    omega = { rate = [0.0, 0.0, 0.0], relative_to = "orbit" }

Scene files and Python (as dicts) accept the same tables.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.arrays import as_plain_arrays, floats
from rigidmc.inputs.measured import Measured
from rigidmc.mechanics.euler_angles import TEXTBOOK, check_sequence
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Grid, is_shared, vector
from rigidmc.scene.units import angles_in_si, in_si

UNITS = {"rad": 1.0, "deg": math.pi / 180.0}
ORDERS = ("wxyz", "xyzw")
RELATIVE = ("omega", "attitude")  # what may be relative to the frame of the orbit
_MORE = {"euler": ("angles", "unit"), "quaternion": ("order",), "matrix": (), "rate": ("unit",)}
KINDS = frozenset(_MORE)  # the word that tells what a table contains
_OF_KEY = {"attitude": ("euler", "quaternion", "matrix"), "omega": ("rate",), "momentum": ()}
WORDS = ("euler", "unit", "order", "relative_to")  # keys whose values are words, not quantities


class Given(NamedTuple):
    """The content of a table: the value, its sequence if it is Euler angles, and whether it is
    relative to the frame of the orbit."""

    value: Any
    sequence: str | None = None
    relative: bool = False


def is_start_table(key: str, value: Any) -> bool:
    """Return whether a value of omega, momentum or attitude is a table of this module."""
    return has_convention(key, value) or (isinstance(value, dict) and "relative_to" in value)


def has_convention(key: str, value: Any) -> bool:
    """Return whether a value is a table with a key that only tables of this module have."""
    words = (*_OF_KEY[key], "angles", "order")
    return isinstance(value, dict) and not set(words).isdisjoint(value)


def own_keys(key: str) -> tuple[str, ...]:
    """Return the keys of the tables of omega, momentum or attitude."""
    kinds = _OF_KEY[key]
    return (*kinds, *(more for kind in kinds for more in _MORE[kind]), "relative_to")


def read_start_table(key: str, table: dict[str, Any]) -> Given:
    """Return the content of a table; SceneError.

    A table with `relative_to` alone has its value under "value".
    """
    at = f"start.{key}"
    relative = _read_frame(key, table, at)
    kinds = [kind for kind in _OF_KEY[key] if kind in table]
    if not kinds and relative and "value" in table:
        if len(table) > 2:
            raise unknown("key", own_keys(key), at=at, key=_other(table, ("value", "relative_to")))
        return Given(table["value"], relative=True)
    if not kinds and (other := _other(table, (*own_keys(key), "value"))):
        raise unknown("key", own_keys(key), at=at, key=other)
    if len(kinds) != 1:
        words = ", ".join(_OF_KEY[key])
        rule = f"give one of these keys: {words}" if words else "is not relative to an orbit"
        raise SceneError(rule, at=at, value=_words(table))
    kind = kinds[0]
    allowed = (kind, *_MORE[kind], "relative_to")
    for name in table:
        if name not in allowed:
            raise unknown("key", allowed, at=at, key=name)
    if kind == "euler":
        return Given(_read_angles(table, at), check_sequence(table[kind], f"{at}.euler"), relative)
    if kind == "quaternion":
        return Given(_read_quaternion(table, at), relative=relative)
    if kind == "rate" and not relative:
        rule = 'is missing: relative_to = "orbit"; or give the three components alone'
        raise SceneError(rule, at=f"{at}.relative_to")
    if kind == "matrix":
        return Given(_read_matrix(table[kind], f"{at}.matrix"), relative=relative)
    rate = table[kind]
    if "unit" in table:
        rate = in_si(Measured(vector(rate, f"{at}.rate"), table["unit"]), "rad s-1", f"{at}.rate")
    return Given(rate, relative=relative)


def _read_frame(key: str, table: dict[str, Any], at: str) -> bool:
    """Return whether a table is relative to the frame of the orbit; SceneError."""
    if "relative_to" not in table:
        return False
    if table["relative_to"] != "orbit":
        raise unknown("frame", ("orbit",), at=f"{at}.relative_to", value=table["relative_to"])
    if key == "momentum":
        rule = 'momenta are not relative: give omega = { rate = [...], relative_to = "orbit" }'
        raise SceneError(rule, at=f"{at}.relative_to", value="orbit")
    return True


def _read_angles(table: dict[str, Any], at: str) -> Any:
    """Return the three angles of a table in rad; SceneError."""
    if "angles" not in table:
        raise SceneError("is missing: three angles", at=f"{at}.angles")
    unit = table.get("unit", "rad")
    if unit not in tuple(UNITS):
        raise unknown("unit of angles", UNITS, at=f"{at}.unit", value=unit)
    numbers = table["angles"]
    if "unit" not in table:
        numbers = angles_in_si(numbers, f"{at}.angles")
    angles = vector(numbers, f"{at}.angles")
    return angles if unit == "rad" else tuple(_times(x, UNITS[unit]) for x in angles)


def _times(value: Any, by: float) -> Any:
    """Return a quantity times a positive number."""
    return value.times(by) if isinstance(value, (Distribution, Grid)) else value * by


def _read_quaternion(table: dict[str, Any], at: str) -> Any:
    """Return the quaternion of a table, scalar first; SceneError."""
    order = table.get("order", "wxyz")
    if order not in ORDERS:
        raise unknown("order", ORDERS, at=f"{at}.order", value=order)
    value = as_plain_arrays(table["quaternion"], f"{at}.quaternion")
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 4:
        return value if order == "wxyz" else value[:, [3, 0, 1, 2]]
    parts = vector(value, f"{at}.quaternion", 4)
    return parts if order == "wxyz" else (parts[3], *parts[:3])


def _read_matrix(value: Any, at: str) -> Any:
    """Return a matrix (3, 3), or one for each member (n, 3, 3); SceneError."""
    rule = "expected a 3x3 matrix"
    matrix = floats(value, at, rule=rule)
    if matrix.ndim not in (2, 3) or matrix.shape[-2:] != (3, 3):
        raise SceneError(f"has the shape {matrix.shape}: {rule}, or one for each member", at=at)
    return matrix


def _other(table: dict[str, Any], allowed: Sequence[str]) -> str:
    """Return the first key that is not known; "" without one."""
    return next((name for name in table if name not in allowed), "")


def _words(table: dict[str, Any]) -> Any:
    """Return a table for a message, without arrays."""
    return {
        k: v if isinstance(v, (str, int, float, list)) else type(v).__name__
        for k, v in table.items()
    }


def check_relative(relative: Any, spin: str, attitude: Any) -> tuple[str, ...]:
    """Return which of RELATIVE are relative to the frame of the orbit; SceneError."""
    at = "start.relative_to_orbit"
    names = (relative,) if isinstance(relative, str) else relative
    if not isinstance(names, (list, tuple)):
        raise SceneError(f"expected some of {', '.join(RELATIVE)}", at=at, value=relative)
    for name in names:
        if name not in RELATIVE:
            raise unknown("value", RELATIVE, at=at, value=name)
    if "omega" in names and spin != "omega":
        raise SceneError("is the angular velocity: give omega, not momentum", at=at, value="omega")
    if "attitude" in names and isinstance(attitude, str):
        if attitude == "ensemble":
            rule = "follows from the energies in space: it has no value relative to an orbit"
            raise SceneError(rule, at="start.attitude", value=attitude)
        # uniform attitudes are uniform in every frame
        names = [name for name in names if name != "attitude"]
    return tuple(name for name in RELATIVE if name in names)


def relative_components(start: Any) -> list[str]:
    """Return what of a start has components relative to the orbit that a result stores.

    Euler angles are stored as they are, and the text of the scene has distributions and shared
    numbers.
    """
    return [
        key
        for key in start.relative_to_orbit
        if isinstance(value := getattr(start, key), tuple)
        and not (key == "attitude" and start.has_euler_angles)
        and not is_shared(value)
    ]


def check_orbit(relative: Sequence[str], effects: Sequence[Any]) -> None:
    """Raise SceneError unless a start that is relative to an orbit has exactly one."""
    if not relative:
        return
    at = f"start.{relative[0]}.relative_to"
    count = sum(isinstance(effect, GravityGradient) for effect in effects)
    if not count:
        rule = "there is no orbit: add [effects.gravity_gradient]"
        raise SceneError(rule, at=at, value="orbit")
    if count > 1:
        rule = f"the scene has {count} orbits: keep one [effects.gravity_gradient]"
        raise SceneError(rule, at=at, value="orbit")


def attitude_as_table(attitude: Any, written: Any, sequence: str, relative: bool) -> Any:
    """Return an attitude as written in a scene file.

    written : the attitude as written without its sequence and frame
    """
    frame = {"relative_to": "orbit"} if relative else {}
    if isinstance(attitude, tuple) and len(attitude) == 3:
        plain = sequence == TEXTBOOK and not relative
        return written if plain else {"euler": sequence, "angles": written, **frame}
    if not relative:
        return written
    return {**written, **frame} if isinstance(written, dict) else {"quaternion": written, **frame}


def omega_as_table(written: Any, relative: bool) -> Any:
    """Return omega or momentum as written in a scene file; written : without its frame."""
    if not relative:
        return written
    frame = {"relative_to": "orbit"}
    return {**written, **frame} if isinstance(written, dict) else {"rate": written, **frame}
