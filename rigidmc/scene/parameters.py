"""The parameters of a scene by name, such as body.moments.1, start.omega.angle or effects.gravity.g: what a map may vary."""

from dataclasses import replace

from rigidmc.effects import labelled
from rigidmc.effects.parameters import given, shape
from rigidmc.errors import unknown

_ANGLES = {"phi": 0, "theta": 1, "psi": 2}


def parameters(scene):
    """Names of all numbers of a scene that may differ from member to member."""
    found = [
        *_of("body.moments", scene.body.moments),
        "body.mass",
        *(f"body.centre.{i}" for i in (1, 2, 3)),
    ]
    which = "omega" if scene.start.momentum is None else "momentum"
    found += _of(f"start.{which}", getattr(scene.start, which))
    if not isinstance(scene.start.attitude, str) and len(scene.start.attitude) == 3:
        found += [f"start.attitude.{name}" for name in _ANGLES]
    for label, effect in labelled(scene.effects):
        for field in given(effect):
            size = shape(effect, field)
            found += (
                [f"effects.{label}.{field}"]
                if size is None
                else [f"effects.{label}.{field}.{i + 1}" for i in range(size)]
            )
    return found


def _of(name, value):
    """Names of the numbers of three components or of a vector of `rigidmc.scene.laws`."""
    if not hasattr(value, "_fields"):
        return [f"{name}.{i}" for i in (1, 2, 3)]
    found = []
    for field, part in value._asdict().items():
        if field in ("axis", "covariance", "direction"):
            continue
        found += (
            [f"{name}.{field}.{i}" for i in (1, 2, 3)]
            if isinstance(part, tuple)
            else [f"{name}.{field}"]
        )
    return found


def with_parameter(scene, name, value, key="parameter"):
    """The scene with a number, distribution or grid in the place of one of its parameters; SceneError with the nearest name."""
    if name not in parameters(scene):
        raise unknown("", key, name, "scene parameter", parameters(scene))
    table, first, *rest = name.split(".")
    if table == "body":
        return replace(
            scene,
            body=replace(scene.body, **{first: _put(getattr(scene.body, first), rest, value)}),
        )
    if table == "start":
        return replace(
            scene,
            start=replace(scene.start, **{first: _put(getattr(scene.start, first), rest, value)}),
        )
    effects = [
        _put(e, rest, value) if label == first else e for label, e in labelled(scene.effects)
    ]
    return replace(scene, effects=tuple(effects))


def _put(whole, path, value):
    """A tuple, or a tuple within it, with a value in one place."""
    if not path:
        return value
    if hasattr(whole, "_fields"):
        return whole._replace(**{path[0]: _put(getattr(whole, path[0]), path[1:], value)})
    i = _ANGLES.get(path[0], -1)
    i = int(path[0]) - 1 if i < 0 else i
    return (*whole[:i], _put(whole[i], path[1:], value), *whole[i + 1 :])
