"""The parameters of a scene by name, such as body.moments.1, start.omega.angle or
effects.gravity.g: what a map may vary."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rigidmc.effects import labelled
from rigidmc.effects.parameters import given, shape
from rigidmc.errors import unknown
from rigidmc.scene.laws.protocol import Law
from rigidmc.scene.scene import Scene

_ANGLES = {"phi": 0, "theta": 1, "psi": 2}
_FIXED = ("axis", "covariance", "direction")  # fields of laws that no map varies


def parameters(scene: Scene) -> list[str]:
    """The names of all numbers of a scene that may differ from member to member."""
    names = [*_of("body.moments", scene.body.moments), "body.mass"]
    names += [f"body.centre.{i}" for i in (1, 2, 3)]
    which = scene.start.which
    names += _of(f"start.{which}", getattr(scene.start, which))
    if scene.start.by_euler_angles:
        names += [f"start.attitude.{name}" for name in _ANGLES]
    for label, effect in labelled(scene.effects):
        for field in given(effect):
            name, size = f"effects.{label}.{field}", shape(effect, field)
            names += [name] if size is None else [f"{name}.{i + 1}" for i in range(size)]
    return names


def _of(name: str, value: Any) -> list[str]:
    """The names of the numbers of three components, or of a law."""
    if not isinstance(value, Law):
        return [f"{name}.{i}" for i in (1, 2, 3)]
    names = []
    for field, part in value.as_dict().items():
        if field not in _FIXED:
            several = isinstance(part, tuple)
            names += [f"{name}.{field}.{i}" for i in (1, 2, 3)] if several else [f"{name}.{field}"]
    return names


def with_parameter(scene: Scene, name: str, value: Any, key: str = "parameter") -> Scene:
    """The scene with a number, distribution or grid in place of one of its parameters; SceneError
    with the nearest name. key : what the error calls the parameter"""
    if name not in parameters(scene):
        raise unknown("", key, name, "scene parameter", parameters(scene))
    table, first, *rest = name.split(".")
    if table in ("body", "start"):
        part = getattr(scene, table)
        changed = {first: _put(getattr(part, first), rest, value)}
        if table == "body":
            changed["shape"] = ()  # another body than the one that has this shape
        part = replace(part, **changed)
        return replace(scene, **{table: part})
    effects = tuple(
        _put(effect, rest, value) if label == first else effect
        for label, effect in labelled(scene.effects)
    )
    return replace(scene, effects=effects)


def _put(whole: Any, path: Sequence[str], value: Any) -> Any:
    """An effect, a law or a tuple with a value in one place."""
    if not path:
        return value
    field, *rest = path
    if isinstance(whole, Law):
        return replace(whole, **{field: _put(getattr(whole, field), rest, value)})
    if hasattr(whole, "_replace"):  # an effect
        return whole._replace(**{field: _put(getattr(whole, field), rest, value)})
    i = _ANGLES[field] if field in _ANGLES else int(field) - 1
    return (*whole[:i], _put(whole[i], rest, value), *whole[i + 1 :])
