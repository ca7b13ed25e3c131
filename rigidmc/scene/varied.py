"""Parameters that vary between runs of a prepared scene: names, nominal values for planning, and
values of the members."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import OptionError, RigidmcError, SceneError, nearest, unknown
from rigidmc.inputs.arrays import Array, floats, is_number
from rigidmc.inputs.labelled import COLUMN, Wanted, is_labelled, two_ways
from rigidmc.physics.effects import label_effects
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import Parameter, Parameters
from rigidmc.scene.parameters import (
    parameters_of,
    refuse_part_of_solid,
    settable,
    solid_by_mass,
    with_parameters,
    with_vectors,
)
from rigidmc.scene.quantities import Grid, Varied, count_rows
from rigidmc.scene.units import in_si
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import whole_of

Nominal = dict[str, float | list[float]]


def variables(model: Model) -> Parameters:
    """Return what may be varied: all parameters, except in vector distributions, which have no
    rows, and all vectors that contain these parameters."""
    every, drawn = parameters_of(model), _drawn_vectors(model)
    found = with_vectors({k: p for k, p in settable(every).items() if not k.startswith(drawn)})
    if isinstance(model.start.attitude, tuple):
        found.setdefault("start.attitude", with_vectors(every)["start.attitude"])
    return found


def common_numbers(model: Model) -> dict[str, tuple[float, ...]]:
    """Return {parameter: its factors of the numbers in common} for the `Common` ones."""
    each = {name: p.get(model) for name, p in settable(parameters_of(model)).items()}
    return {name: x.parameters[1:] for name, x in each.items() if getattr(x, "stream", "")}


def _drawn_vectors(model: Model) -> tuple[str, ...]:
    """Return the names of the vectors that a distribution of vectors draws."""
    body, start, spin = model.body, model.start, model.start.spin_name
    vectors = {f"body.{body.inertia_key}": body.moments, "start.attitude": start.attitude}
    vectors |= {f"start.{spin}": getattr(start, spin)}
    for label, effect in label_effects(model.effects):
        for field, value in zip(effect._fields, effect, strict=True):
            vectors[f"effects.{label}.{field}"] = whole_of(value)
    return tuple(k for k, x in vectors.items() if isinstance(x, (VectorDistribution, str)))


def _refused(model: Model, name: str) -> RigidmcError:
    """Return the error for a name that may not be varied, with the reason."""
    names, solid = variables(model), solid_by_mass(model.body)
    numbers = set(names) - {"start.attitude", *(p.vector for p in names.values())}
    inner = [number for number in numbers if name.startswith(f"{number}.")]
    if drawn := [vector for vector in _drawn_vectors(model) if f"{name}.".startswith(f"{vector}.")]:
        rule = f"one distribution of the scene draws {drawn[0]}: give numbers in its place"
    elif inner:
        rule = f"members differ by {inner[0]} itself, not by its distribution"
    elif solid is not None and name.startswith("body."):
        return refuse_part_of_solid(solid, name, "varied")
    elif name.startswith("body.tensor"):
        rule = "it turns the principal axes: vary body.moments, or simulate a tensor per member"
    elif name in parameters_of(model) and name.startswith("start.attitude."):
        rule = "it is one of the four numbers of a quaternion: vary start.attitude as a whole"
    else:
        return unknown("scene parameter", names, at="varied", value=name)
    return SceneError(f"cannot be varied: {rule}", at="varied", value=name)


def nominal_of(model: Model, names: Iterable[str]) -> Nominal:
    """Return {name: nominal values} for planning runs with other values: the model's own numbers,
    or the medians of its distributions, grids and rows.

    Raises SceneError for a name that the model lacks.
    """
    nominal, known = Nominal(), variables(model)
    for name in names:
        if name not in known:
            raise _refused(model, name)
        value = known[name].get(model)
        nominal[name] = list(map(_middle, value)) if isinstance(value, tuple) else _middle(value)
    return nominal


def _middle(value: Any) -> float:
    """Return a number, or the median of a quantity."""
    if isinstance(value, Distribution):
        return float(value.ppf(np.array(0.5)))
    if isinstance(value, Grid):
        return float(np.median(value.values()))
    return float(np.median(value))


def open_varied(model: Model, nominal: Nominal) -> tuple[Model, Parameters]:
    """Return (model for planning, its varied parameters): they have the nominal values, marked as
    not constant; SceneError for unknown names."""
    marked = {
        name: tuple(map(Varied, value)) if isinstance(value, list) else Varied(value)
        for name, value in nominal.items()
    }
    known = variables(model)
    opened = with_parameters(model, marked, "varied", known)
    return opened, {name: known[name] for name in nominal}


def without_mark(q: Any) -> Any:
    """Return a quantity of a planned model, a plain number in place of a marked one."""
    return q.value if isinstance(q, Varied) else q


def stored_values(model: Model, varied: Parameters) -> dict[str, Any] | None:
    """Return {name: values by row, or a tuple of the columns of a vector} of varied parameters;
    None if the model has only nominal values."""
    values = {name: p.get(model) for name, p in varied.items()}
    parts = [x for v in values.values() for x in (v if type(v) is tuple else (v,))]
    count = count_rows(*parts)
    if count is None or not all(isinstance(x, (float, np.ndarray)) for x in parts):
        return None

    def each(x: Any) -> Array:
        return np.broadcast_to(x, count)

    return {
        name: tuple(map(each, value)) if type(value) is tuple else each(value)
        for name, value in values.items()
    }


def _in_si(parameter: Parameter, array: Any) -> Any:
    """Return values of a parameter in SI units; OptionError for a unit of another dimension."""
    try:
        return in_si(array, parameter.unit, "values")
    except SceneError as error:
        rule = f"{parameter.name} {error.rule}"
        raise OptionError(rule, at="values", nearest=error.nearest) from None


def with_values(
    model: Model, varied: Parameters, nominal: Nominal, values: Mapping[str, ArrayLike]
) -> tuple[Model, int]:
    """Return (model with the members' values of its varied parameters, number of members).

    Raises OptionError unless `values` has exactly the varied names, each with a row per member.
    """
    for name in {**values, **nominal}:
        if name not in nominal:
            rule = f"is not varied; varied: {', '.join(nominal) or 'nothing'}"
            raise OptionError(rule, at="values", value=name, nearest=nearest(name, nominal))
        if name not in values:
            raise OptionError(f"lacks {name}, which is varied", at="values")
    sizes = {name: len(v) if isinstance(v, list) else None for name, v in nominal.items()}
    in_rows = {
        name: _rows(_in_si(varied[name], value), name, sizes[name])
        for name, value in values.items()
    }
    count, changed = max(array.shape[0] if array.ndim else 0 for array in in_rows.values()), {}
    for name, array in in_rows.items():
        size = sizes[name]
        wanted = (count,) if size is None else (count, size)
        if array.shape != wanted or not count:
            rows: Any = wanted
            if array.ndim != len(wanted) or not count:  # the length is not a number of members
                rows = "(members,)" if size is None else f"(members, {size})"
            raise OptionError(f"{name} has the shape {array.shape}, expected {rows}", at="values")
        columns = np.array(array.T, order="C")  # frozen, so that the scene copies no column again
        columns.flags.writeable = False
        changed[name] = columns if size is None else tuple(columns)
    return with_parameters(model, changed, "varied", varied), count


def _rows(value: Any, name: str, size: int | None) -> Array:
    """Return values of the members as an array (members,) or (members, size), also those given as
    a tuple of `size` columns; SceneError."""
    at = f"values.{name}"
    if isinstance(value, tuple) and len(value) == size and not is_number(value[0]):
        return np.stack([floats(column, at, wanted=COLUMN) for column in value], axis=-1)
    array = floats(value, at, wanted=Wanted(() if size is None else (size,)))
    if size is not None and array.shape == (size, size) and not is_labelled(value):
        raise two_ways(array.shape, at)
    return array
