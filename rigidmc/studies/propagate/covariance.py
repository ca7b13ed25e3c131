"""Mean and covariance of what a scene draws, and the scene whose numbers are the means."""

import dataclasses
from itertools import zip_longest
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.scene.distributions import Common, Distribution, Truncated
from rigidmc.scene.mixtures import Mixture
from rigidmc.scene.model import Model
from rigidmc.scene.parameters import value_at
from rigidmc.scene.quantities import Grid
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import common_numbers
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import Correlated, whole_of

ROUNDING = 1e-9  # relative: asymmetry and negative variances of a covariance from rounding


def moments_of(law: Distribution) -> tuple[float, float]:
    """Return (mean, variance) of a distribution; infinite or nan where it has none."""
    if isinstance(law, Mixture):
        each = [moments_of(part) for _, part in law.parameters]
        mean = float(sum(w * m for w, (m, _) in zip(law.shares(), each, strict=True)))
        square = sum(
            w * (v + (m - mean) ** 2) for w, (m, v) in zip(law.shares(), each, strict=True)
        )
        return mean, float(square)
    if isinstance(law, Truncated):
        inner, low, high = law.parameters
        expect = inner.frozen().expect
        mean = float(expect(lambda x: x, lb=low, ub=high, conditional=True))
        return mean, float(expect(lambda x: (x - mean) ** 2, lb=low, ub=high, conditional=True))
    mean, variance = law.frozen().stats("mv")
    return float(mean), float(variance)


def at_means(scene: Scene) -> Scene:
    """Return the scene with the mean of each distribution in its place.

    Raises SceneError for tables, grids, and distributions of vectors other than `Correlated`.
    """
    start, changed = scene.start, dict[str, Any]()
    spin = getattr(start, start.spin_name)
    if isinstance(spin, Correlated):
        changed[start.spin_name] = tuple(spin.mean)
    if isinstance(scene.body.moments, Correlated):
        body = dataclasses.replace(scene.body, moments=tuple(scene.body.moments.mean), shape=())
        scene = dataclasses.replace(scene, body=body)
    scene = dataclasses.replace(scene, start=dataclasses.replace(start, **changed))
    names, _ = uncertain_numbers(scene.model)
    for name in names:
        matrix = name.startswith("body.tensor")
        if matrix or isinstance(value_at(scene.model, name), (VectorDistribution, str)):
            rule = (
                "draws a vector, a matrix or an attitude without a mean to propagate: give numbers,"
                " and their covariance with `covariance` and `wrt`"
            )
            raise SceneError(rule, at=name, table="")
    return scene.with_model(scene.model.mapped(_mean_of))


def _mean_of(quantity: Any) -> Any:
    if isinstance(quantity, Grid) or (isinstance(quantity, np.ndarray) and quantity.ndim):
        rule = "grids and tables have no covariance: use distributions or numbers"
        raise SceneError(rule, at="scene")
    if not isinstance(quantity, Distribution):
        return quantity
    if isinstance(quantity, Common):
        return float(quantity.parameters[0])
    mean, variance = moments_of(quantity)
    if not np.isfinite([mean, variance]).all():
        rule = "has no finite variance: nothing to propagate"
        raise SceneError(rule, at="distribution", value=quantity.words())
    return mean


def of_distributions(model: Model) -> tuple[list[str], Array]:
    """Return (names of the numbers that a model draws, their covariance (P, P)).

    The means are in `at_means`. Raises SceneError if nothing is drawn.
    """
    names: list[str] = []
    blocks: list[Array] = []
    for name in uncertain_numbers(model)[0]:
        value = value_at(model, name)
        vector = value if isinstance(value, Correlated) else whole_of(value)
        if vector is not None:
            names += [f"{name}.{i}" for i in (1, 2, 3)]
            blocks.append(np.array(vector.covariance))
        elif not isinstance(value, Common):
            names.append(name)
            blocks.append(np.array([[moments_of(value)[1]]]))
    if together := common_numbers(model):
        rows = np.array([*zip_longest(*together.values(), fillvalue=0.0)]).T
        names += together
        blocks.append(rows @ rows.T)
    if not names:
        rule = "nothing in the scene is drawn: give `covariance` or `deviations`, and `wrt`"
        raise SceneError(rule, at="scene", table="")
    return names, block_diag(*blocks)


def checked_covariance(value: Any, size: int) -> Array:
    """Return a covariance (size, size); OptionError unless it is symmetric without negative
    variances."""
    try:
        matrix = np.asarray(value, float)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    rule = f"expected a symmetric matrix of {size}x{size} finite numbers, one row for each of `wrt`"
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise OptionError(rule, at="covariance", value=value)
    deviations = np.sqrt(np.abs(np.diag(matrix)))
    # a variance of 0 has zeros in its row, in any unit
    scale = np.where(deviations > 0.0, deviations, 1.0)
    unitless = matrix / np.outer(scale, scale)
    if np.abs(unitless - unitless.T).max() > ROUNDING:
        raise OptionError(rule, at="covariance", value=value)
    if np.linalg.eigvalsh(0.5 * (unitless + unitless.T)).min() < -ROUNDING * size:
        rule = "expected no negative variance in any direction (positive semidefinite)"
        raise OptionError(rule, at="covariance", value=value)
    return np.asarray(0.5 * (matrix + matrix.T))


def draw_normal(covariance: Array, count: int, seed: int) -> Array:
    """Return normal deviations (P, count) of mean 0 with a covariance, which may be singular."""
    factor = factor_of(covariance)
    z = np.random.default_rng([seed, 0x636F76]).standard_normal((count, len(factor)))
    return np.asarray(factor @ z.T)


def factor_of(covariance: Array) -> Array:
    """Return L (P, P) with L L^T = covariance, which may be singular."""
    deviations = np.sqrt(np.diag(covariance))
    # a variance of 0 has zeros in its row, in any unit
    scale = np.where(deviations > 0.0, deviations, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None)))
