"""The parameters of a scene by name, such as body.moments.1, start.omega.angle or
effects.gravity.g, which a map may vary."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import shape, user_parameters
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import Grid, Varied, is_shared, quantity
from rigidmc.scene.scene import Scene
from rigidmc.scene.shape import ShapePart
from rigidmc.scene.start import Start
from rigidmc.scene.stated import NO_RATE, Stated, refused_numbers
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import whole_of

_BY_MASS = [name for name, make in SOLIDS.items() if "mass" in signature(make).parameters]
_FIXED = ("axis", "covariance", "direction")  # fields of distributions that no map varies


def parameter_names(scene: Scene) -> list[str]:
    """Return the names of all parameters of a scene that may differ between members."""
    solid = solid_by_mass(scene.body)
    if isinstance(scene.body.stated, Stated):
        names = scene.body.stated.names()
    elif solid is not None:
        names = [f"body.{solid}.mass"]
    else:
        names = [*_of("body.moments", scene.body.moments), "body.mass"]
        names += [f"body.centre.{i}" for i in (1, 2, 3)]
    which = scene.start.spin_name
    names += _of(f"start.{which}", getattr(scene.start, which))
    if scene.start.has_euler_angles:
        names += [f"start.attitude.{name}" for name in angle_names(scene.start.sequence)]
    for label, effect in label_effects(scene.effects):
        for field in user_parameters(effect):
            name, size = f"effects.{label}.{field}", shape(effect, field)
            if whole_of(getattr(effect, field)) is not None:
                continue  # no component of a correlated vector may change alone
            names += [name] if size is None else [f"{name}.{i + 1}" for i in range(size)]
    return names


def _of(name: str, value: Any) -> list[str]:
    """Return the names of three components, or of the parameters of a distribution."""
    if not isinstance(value, VectorDistribution):
        return [f"{name}.{i}" for i in (1, 2, 3)]
    if isinstance(value, TensorDistribution):
        return []  # its parts are matrices: no single element of one may change alone
    names = []
    for field, part in value.as_dict().items():
        if field not in _FIXED:
            several = isinstance(part, tuple)
            names += [f"{name}.{field}.{i}" for i in (1, 2, 3)] if several else [f"{name}.{field}"]
    return names


def with_parameter(
    scene: Scene,
    name: str,
    value: Any,
    key: str = "parameter",
    names: Sequence[str] | None = None,
) -> Scene:
    """Replace a parameter of a scene by a number, distribution or grid; SceneError with the nearest
    name.

    key : name of the argument in the error;  names : known parameters, by default `parameter_names`
    """
    return with_parameters(scene, {name: value}, key, names)


def with_parameters(
    scene: Scene,
    values: Mapping[str, Any],
    key: str = "parameter",
    names: Sequence[str] | None = None,
    **others: Any,
) -> Scene:
    """Replace several parameters of a scene, as `with_parameter` does.

    Each part is replaced once, because a part checks all its numbers when it is made.

    others : further fields of the scene to replace
    """
    names = parameter_names(scene) if names is None else names
    changed: dict[str, dict[str, Any]] = {"body": {}, "start": {}}
    body, effects = scene.body, dict(label_effects(scene.effects))
    stated = body.stated if isinstance(body.stated, Stated) else None
    for name, value in values.items():
        if "." not in name:
            raise unknown("scene parameter", names, at=key, value=name)
        table, first, *rest = name.split(".")
        if why := refused_numbers(body.stated).get(name):
            raise SceneError(f"cannot differ between members: it {why}", at=key, value=name)
        if table == "body" and stated is None and (solid := solid_by_mass(scene.body)):
            body = _of_mass(body, solid, name, value, key)
            continue
        if name not in names:
            raise unknown("scene parameter", names, at=key, value=name)
        if table == "body" and stated is not None:
            if not is_shared(value if type(value) is tuple else quantity(value, name)):
                raise SceneError(f"cannot differ between members: it {NO_RATE}", at=key, value=name)
            stated = _put(stated, ["inertia" if first == stated.key else first, *rest], value)
            continue
        if table == "effects":
            effects[first] = _put(effects[first], rest, value)
            continue
        if table == "start":
            rest = [component_of(scene.start, word) for word in rest]
        known = changed[table]
        known[first] = _put(known.get(first, getattr(getattr(scene, table), first)), rest, value)
    if stated is not None and stated is not body.stated:
        body = stated.make(type(body), body.frame)
    if changed["body"]:
        body = replace(body, **changed["body"], shape=())  # the shape belongs to the original body
    start = replace(scene.start, **changed["start"]) if changed["start"] else scene.start
    return replace(scene, body=body, start=start, effects=tuple(effects.values()), **others)


def component_of(start: Start, word: str) -> str:
    """Return the number, from 1, of an angle of the attitude; other words as they are."""
    names = angle_names(start.sequence)
    return str(names.index(word) + 1) if word in names else word


def solid_by_mass(body: Any) -> str | None:
    """Return the name of the solid if a body is a solid given by mass, with any pivot; else None.

    A shape next to explicit moments is only drawn and does not make the body a solid.
    """
    part = body.shape[0] if len(body.shape) == 1 else None
    if part is None or part.solid not in _BY_MASS:
        return None
    moments, mass, centre = (values[..., 0] for values in body.sample(0, 0, 1))
    made = _made(part, float(mass))
    long = np.sqrt(max(made.moments) / mass)
    off = moments / max(made.moments) - np.array(made.moments) / max(made.moments)
    away = (centre - made.to_principal(made.centre)) / long
    same = max(np.abs(off).max(), np.abs(away).max()) < 1e-12  # rounding of a grid and a shift
    return part.solid if same else None


def _made(part: ShapePart, mass: float) -> Body:
    """Return a solid of a mass, about the fixed point of its shape."""
    made = Body.solid(part.solid, mass=mass, **part.sizes)
    return made.with_pivot(tuple(-x for x in part.at)) if any(part.at) else made


def refuse_part_of_solid(solid: str, name: str, key: str) -> SceneError:
    """Return the error for a parameter of a solid other than its mass."""
    right = f"body.{solid}.mass"
    rule = (
        f"the sizes of a {solid} determine its centre and moments: only {right} can be varied,"
        " and the moments with it; to vary others, give moments, mass and centre in place of"
        f" the {solid}"
    )
    return SceneError(rule, at=key, value=name, nearest=right)


def _of_mass(body: Any, solid: str, name: str, value: Any, key: str) -> Any:
    """Return the solid with another mass and moments in proportion; SceneError for every other
    parameter of a solid.

    value : a number, a grid, a nominal number, or the masses of members
    """
    if name != f"body.{solid}.mass":
        raise refuse_part_of_solid(solid, name, key)
    # of 1 kg, not of the present mass: a rerun, which has other ones, then rounds alike
    each = map(float, _made(body.shape[0], 1.0).moments)
    moments = tuple(
        value.times(x) if isinstance(value, (Grid, Varied)) else value * x for x in each
    )
    return replace(body, moments=moments, mass=value)


def _put(whole: Any, path: Sequence[str], value: Any) -> Any:
    """Return an effect, a distribution or a tuple with one value replaced."""
    if not path:
        return value
    field, *rest = path
    if isinstance(whole, VectorDistribution):
        return replace(whole, **{field: _put(getattr(whole, field), rest, value)})
    if hasattr(whole, "_replace"):  # an effect
        return whole._replace(**{field: _put(getattr(whole, field), rest, value)})
    i = int(field) - 1
    return (*whole[:i], _put(whole[i], rest, value), *whole[i + 1 :])
