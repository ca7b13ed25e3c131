"""Parameters that runs of a prepared scene vary: their names, their numbers for the plan, and those
of members."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import OptionError, nearest, unknown
from rigidmc.physics.effects import label_effects
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.parameters import parameter_names, with_parameter
from rigidmc.scene.quantities import Grid, Varied, count_rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Nominal = dict[str, float | list[float]]


def variable_names(scene: Scene) -> list[str]:
    """The names that may be varied: of all parameters but those of distributions, which have no
    rows, and of the vectors that they are part of."""
    start = getattr(scene.start, scene.start.spin_name)
    vectors = {f"start.{scene.start.spin_name}": start, "body.moments": scene.body.moments}
    drawn = tuple(name for name, value in vectors.items() if isinstance(value, VectorDistribution))
    known = [name for name in parameter_names(scene) if not name.startswith(drawn)]
    if isinstance(scene.start.attitude, tuple):
        known = [*known, "start.attitude.1"]
    return list(dict.fromkeys(word for name in known for word in (_vector(name), name) if word))


def _vector(name: str) -> str:
    """The name of the vector that a component is part of, "" for a number of its own."""
    whole, _, last = name.rpartition(".")
    return whole if last.isdecimal() or last in ("phi", "theta", "psi") else ""


def nominal_of(scene: Scene, names: Iterable[str]) -> Nominal:
    """{name: numbers} of a scene, by which runs with other numbers are planned: its own, or the
    medians of distributions, grids and rows.

    Raises SceneError for a name that the scene lacks.
    """
    found: Nominal = {}
    for name in names:
        if name not in variable_names(scene):
            raise unknown("scene parameter", variable_names(scene), at="varied", value=name)
        value = value_at(scene, name)
        found[name] = list(map(_middle, value)) if isinstance(value, tuple) else _middle(value)
    return found


def _middle(value: Any) -> float:
    """A number, or the median of a quantity."""
    if isinstance(value, Distribution):
        return float(value.ppf(np.array(0.5)))
    if isinstance(value, Grid):
        return float(np.median(value.values()))
    return float(np.median(value))


def value_at(scene: Scene, name: str) -> Any:
    """The value of a parameter, or of a vector."""
    table, first, *rest = name.split(".")
    value = (
        getattr(scene, table) if table != "effects" else dict(label_effects(scene.effects))[first]
    )
    for word in (first, *rest) if table != "effects" else rest:
        place = {"phi": 0, "theta": 1, "psi": 2}.get(word)
        if place is None and word.isdecimal():
            place = int(word) - 1
        value = getattr(value, word) if place is None else value[place]
    return value


def put_value(scene: Scene, name: str, value: Any) -> Scene:
    """The scene with a value in place of a parameter, or of a vector."""
    return with_parameter(scene, name, value, "varied", variable_names(scene))


def open_varied(scene: Scene) -> Scene:
    """The scene as it is planned: with its varied numbers, which settle nothing for all members."""
    for name, value in (scene.run.varied or {}).items():
        marked = tuple(map(Varied, value)) if isinstance(value, list) else Varied(value)
        scene = put_value(scene, name, marked)
    return scene


def close_varied(scene: Scene) -> Scene:
    """A planned scene with plain numbers again."""
    model = scene.model.mapped(lambda q: q.value if isinstance(q, Varied) else q)
    return scene.with_model(model)


def stored_values(scene: Scene) -> dict[str, NDArray[np.float64]] | None:
    """{name: numbers of each row} that a scene with varied parameters has of members.

    None if it has only numbers for the plan.
    """
    values = {name: value_at(scene, name) for name in scene.run.varied or {}}
    parts = [x for v in values.values() for x in (v if type(v) is tuple else (v,))]
    count = count_rows(*parts)
    if count is None or not all(isinstance(x, (float, np.ndarray)) for x in parts):
        return None

    def each(x: Any) -> NDArray[np.float64]:
        return np.broadcast_to(x, count)

    return {
        name: np.stack(list(map(each, value)), axis=-1) if type(value) is tuple else each(value)
        for name, value in values.items()
    }


def with_values(scene: Scene, values: Mapping[str, ArrayLike]) -> tuple[Scene, int]:
    """(the scene with the numbers of members in place of its varied ones, how many members).

    Raises OptionError unless `values` has exactly the varied names, each with a row per member.
    """
    known = scene.run.varied or {}
    for name in {**values, **known}:
        if name not in known:
            rule = f"is not varied; varied: {', '.join(known) or 'nothing'}"
            raise OptionError(rule, at="values", value=name, nearest=nearest(name, known))
        if name not in values:
            raise OptionError(f"lacks {name}, which is varied", at="values")
    given = {name: np.asarray(array, dtype=float) for name, array in values.items()}
    counts = {name: array.shape[0] if array.ndim else 0 for name, array in given.items()}
    count = max(counts.values())
    for name, array in given.items():
        size = len(value) if isinstance(value := known[name], list) else None
        wanted = (count,) if size is None else (count, size)
        if array.shape != wanted or not count:
            rule = f"{name} has the shape {array.shape}, expected {wanted}"
            raise OptionError(rule, at="values")
        scene = put_value(
            scene, name, array if size is None else tuple(np.ascontiguousarray(array.T))
        )
    return replace(scene, run=scene.run.model_copy(update={"first": 0, "members": count})), count
