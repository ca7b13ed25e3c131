"""Derivatives of the members at their start by parameters of the scene.

They come from the code that builds the members (`rigidmc.planning.initial.fill_initial`), run on
arrays with tangents (`rigidmc.physics.dynamics.dual_arrays`): the quantities that depend on a
parameter carry its tangent, and the random numbers stay. A member's tangents depend on scene, seed
and index alone.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.physics.dynamics.dual_arrays import DualArray, TangentsLost, plain, zeros
from rigidmc.planning.initial import Source, fill_initial, member_ranges
from rigidmc.scene.derivatives import seeds_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.model import Model
from rigidmc.scene.parameter import Path, get, put
from rigidmc.scene.quantities import Drawn, Grid, Marked, Rate, Varied

SAMPLING = "sample", "sample_attitude"  # methods that draw vectors of members


def tangents_at_start(
    model: Model,
    sampler: Source,
    members: Ints,
    names: Sequence[str],
    out: Array,
    has_attitude: bool = True,
    axes: int | None = None,
) -> None:
    """Set the derivatives (P, rows, count) of the block of `initial_block_of` by P parameters.

    Only the rows of `rows_to_fill` have derivatives; other rows keep their numbers. The derivative
    of an attitude is orthogonal to it.

    names : of the parameters, see `rigidmc.scene.parameters`
    axes : first of the four rows of the members' principal axes, a quaternion; None without them

    Raises SceneError for a name without a derivative, and for a custom part of the scene whose code
    has none. A member whose tensor has equal moments gets nan for a parameter that turns its axes.
    """
    at = 0
    for first, columns, count in member_ranges(members):
        part = out[..., at : at + columns.size]
        alone = np.array_equal(columns, np.arange(count))  # no member is built besides
        tangents = part if alone else np.zeros((*out.shape[:-1], count))
        block = DualArray(np.empty(tangents.shape[1:]), tangents)
        build_with_tangents(block, model, sampler, first, has_attitude, names, axes)
        if not alone:
            np.take(tangents, columns, axis=2, out=part)
        at += columns.size


def build_with_tangents(
    block: DualArray,
    model: Model,
    sampler: Source,
    first: int,
    has_attitude: bool,
    names: Sequence[str],
    axes: int | None = None,
) -> dict[str, Any]:
    """Set the rows of `tangents_at_start` and their values in a block, and return the sampled
    values that the members are built from; those that depend on no parameter are plain arrays."""
    try:
        start = fill_initial(block, marked_model(model, names), sampler, first, has_attitude)  # type: ignore[arg-type]
    except (TangentsLost, ValueError) as error:
        # NumPy's ValueError for an element of an array has the cause beside it
        if not isinstance(error.__cause__ or error, TangentsLost):
            raise
        rule = f"has no derivative: code of the scene uses what has none ({error})"
        raise SceneError(rule, at="run.wrt", value=", ".join(names)) from None
    if axes is not None:
        block[axes : axes + 4] = start["principal_axes"]
    return start


def marked_model(model: Model, names: Sequence[str]) -> Model:
    """Return the model with tangents in all quantities that depend on the parameters.

    It is not checked again: checks accept plain numbers only.
    """
    rates: dict[Path, dict[int, Rate]] = {}
    for j, seeds in enumerate(seeds_of(model, names)):
        for path, rate in seeds:
            rates.setdefault(path, {})[j] = rate
    # methods last, so that they belong to parts whose fields are marked
    for path, by_parameter in sorted(rates.items(), key=lambda item: item[0][-1] in SAMPLING):
        model = put(model, path, _marked(get(model, path), by_parameter, len(names)))
    return model


def _marked(quantity: Any, rates: dict[int, Rate], parameters: int) -> Any:
    """Return a quantity with its rates; a number as one with tangents, and the method that draws
    vectors as one that adds tangents to them."""
    if callable(quantity):
        return partial(_with_own_components, quantity, rates, parameters)
    if isinstance(quantity, (Distribution, Grid, np.ndarray)):
        return Marked(quantity, rates, parameters)
    number = quantity.value if isinstance(quantity, Varied) else quantity
    drawn, tangents = Drawn(np.array([float(number)]), None, 0, 0), np.zeros(parameters)
    for j, rate in rates.items():
        tangents[j] = rate(drawn)[0]
    return DualArray(number, tangents)


def _with_own_components(
    sample: Any, rates: dict[int, Rate], parameters: int, *arguments: Any
) -> DualArray:
    """Return drawn vectors with the tangents of their own components."""
    vectors = sample(*arguments)
    unit = zeros(vectors.shape, parameters)
    for j, rate in rates.items():
        unit.tangents[j] = rate(Drawn(plain(vectors), None, 0, 0))
    if isinstance(vectors, DualArray):
        unit.tangents += vectors.tangents
    return DualArray(plain(vectors), unit.tangents)
