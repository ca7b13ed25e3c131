"""Derivatives of the members at their start by parameters of the scene.

They come from the code that builds the members (`rigidmc.planning.initial.fill_initial`), run on
arrays with tangents (`rigidmc.dual_arrays`): the quantities that depend on a parameter carry its
tangent, and the random numbers stay. A member's tangents depend on scene, seed and index alone.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.dual_arrays import DualArray, TangentsLost, zeros
from rigidmc.errors import SceneError
from rigidmc.planning.body_derivatives import Path
from rigidmc.planning.derivative_names import seeds_of
from rigidmc.planning.initial import Source, fill_initial, member_ranges
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Drawn, Grid, Marked, Rate, Varied

Array = NDArray[np.float64]


def tangents_at_start(
    model: Model,
    sampler: Source,
    first: int,
    count: int,
    has_attitude: bool,
    rows: int,
    names: Sequence[str],
    axes: int | None = None,
) -> Array:
    """Return the derivatives (P, rows, count) of the block of `initial_block` by P parameters.

    Only the rows of `rows_to_fill` have derivatives; those of an attitude are orthogonal to it.

    names : of the parameters, see `rigidmc.planning.derivative_names`
    axes : first of the four rows of the members' principal axes, a quaternion; None without them

    Raises SceneError for a name without a derivative, and for a custom part of the scene whose code
    has none. A member whose tensor has equal moments gets nan for a parameter that turns its axes.
    """
    return built_with_tangents(model, sampler, first, count, has_attitude, rows, names, axes)[
        0
    ].tangents


def tangents_of_members(
    model: Model,
    sampler: Source,
    members: NDArray[np.int64],
    has_attitude: bool,
    rows: int,
    names: Sequence[str],
    axes: int | None = None,
) -> Array:
    """Return `tangents_at_start` of members by their indices, in any order."""
    parts = []
    for first, columns, count in member_ranges(members):
        known = first, count, has_attitude, rows, names, axes
        parts.append(np.take(tangents_at_start(model, sampler, *known), columns, axis=2))
    return np.concatenate(parts, axis=2)


def built_with_tangents(
    model: Model,
    sampler: Source,
    first: int,
    count: int,
    has_attitude: bool,
    rows: int,
    names: Sequence[str],
    axes: int | None = None,
) -> tuple[DualArray, dict[str, Any]]:
    """Return (block, start) of `initial_block` with tangents; a value of `start` that depends on no
    parameter is a plain array. Arguments as for `tangents_at_start`."""
    block = zeros((rows, count), len(names))
    try:
        start = fill_initial(block, marked_model(model, names), sampler, first, has_attitude)  # type: ignore[arg-type]
    except TangentsLost as error:
        rule = f"has no derivative: code of the scene uses what has none ({error})"
        raise SceneError(rule, at="run.wrt", value=", ".join(names)) from None
    if axes is not None:
        block[axes : axes + 4] = start["principal_axes"]
    return block, start


def marked_model(model: Model, names: Sequence[str]) -> Model:
    """Return the model with tangents in all quantities that depend on the parameters.

    It is not checked again: checks accept plain numbers only.
    """
    rates: dict[Path, dict[int, Rate]] = {}
    for j, seeds in enumerate(seeds_of(model, names)):
        for path, rate in seeds:
            rates.setdefault(path, {})[j] = rate
    for path, given in rates.items():
        value: Any = model
        for key in path:
            value = value[key] if isinstance(key, int) else getattr(value, key)
        model = _put(model, path, _marked(value, given, len(names)))
    return model


def _marked(quantity: Any, rates: dict[int, Rate], parameters: int) -> DualArray | Marked:
    """Return a quantity with its rates; a number as one with tangents."""
    if isinstance(quantity, (Distribution, Grid, np.ndarray)):
        return Marked(quantity, rates, parameters)
    number = quantity.value if isinstance(quantity, Varied) else quantity
    drawn, tangents = Drawn(np.array([float(number)]), None, 0, 0), np.zeros(parameters)
    for j, rate in rates.items():
        tangents[j] = rate(drawn)[0]
    return DualArray(number, tangents)


def _put(whole: Any, path: Path, value: Any) -> Any:
    """Return a model, a part of it or a tuple with one value replaced, without its checks."""
    if not path:
        return value
    key, *rest = path
    if isinstance(key, int):
        return (*whole[:key], _put(whole[key], tuple(rest), value), *whole[key + 1 :])
    new = _put(getattr(whole, key), tuple(rest), value)
    if hasattr(whole, "_replace"):
        return whole._replace(**{key: new})
    changed = copy.copy(whole)
    object.__setattr__(changed, key, new)
    return changed
