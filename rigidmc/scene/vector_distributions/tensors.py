"""Inertia tensors given one by one: a table with one tensor per member."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.mechanics.inertia import SIX, skew_of, symmetric, violates_triangle, why_impossible
from rigidmc.scene.quantities import Source, count_rows, draw, is_shared
from rigidmc.scene.vector_distributions.bodies import TensorDistribution, about_centre
from rigidmc.scene.vector_distributions.protocol import check_semidefinite


@dataclass(frozen=True, eq=False)
class TensorRows(TensorDistribution):
    """Inertia tensors of the members, one row each, such as a sample from a posterior.

    The principal axes differ between members; each is labelled after the nearest axis of the mean
    tensor, as with `UncertainInertia`, whose notes on starts, effects and results apply.

    Parameters
    ----------
    rows : array_like (members, 3, 3) [kg m^2]
        tensors about the fixed point, all in the same axes. Six columns xx, yy, zz, yz, zx, xy,
        as a tuple of arrays (members,), do as well
    mean : array_like (3, 3), optional [kg m^2]
        tensor whose axes label the axes of the members; by default the mean of the rows

    Raises
    ------
    SceneError
        for another shape, and for a tensor that is not symmetric or that no body can have, with
        its row

    Examples
    --------
    >>> tensors = np.array([np.diag([2.0, 2.5, 3.0]), np.diag([2.1, 2.5, 3.0])])
    >>> rm.Body.from_tensor(tensors).sample(0, 0, 2)[0].T.tolist()
    [[2.0, 2.5, 3.0], [2.1, 2.5, 3.0]]
    """

    rows: Any
    mean: Any = None

    name = "tensor_rows"
    variables = ("tensor",)

    def check(self, at: str) -> "TensorRows":
        columns = _columns_of(self.rows, f"{at}.rows")
        mean = self.mean if self.mean is not None else symmetric(columns).mean(0)
        return TensorRows(columns, check_semidefinite(mean, f"{at}.mean", (3,)))

    def __repr__(self) -> str:
        # a message must not contain a million numbers
        return f"TensorRows({count_rows(*self.rows) if type(self.rows) is tuple else '...'} rows)"

    def mean_tensor(self, mass: Any) -> Array:
        """Return the tensor whose axes label the axes of the members."""
        return np.array(self.mean)

    def resized(self, mass: float, length: float) -> "TensorRows":
        """Return the tensors in units that multiply masses and lengths by these factors."""
        by = mass * length * length
        return TensorRows(
            tuple(by * column for column in self.rows),
            tuple(tuple(by * x for x in row) for row in self.mean),
        )

    def with_centre(self, mass: Any, centre: Sequence[float]) -> "TensorRows":
        """Return the tensors about the centre of mass, see `Body.with_pivot_at_centre`."""
        rows = about_centre(self.rows, centre, mass)
        # broadcast: products of inertia may not depend on the mass
        count = self.rows[0].size
        return TensorRows(tuple(np.broadcast_to(row, count) for row in rows))

    def bodies(
        self, sampler: Source, name: str, first: int, count: int, mass: Any, centre: Sequence[Any]
    ) -> Array:
        """Return parameters (10, count) of the members, see `UncertainInertia.bodies`.

        mass, centre : quantities of the body
        """
        return np.concatenate(
            [
                draw(self.rows, sampler, name, first, count),
                draw(centre, sampler, "body.centre", first, count),
                draw((mass,), sampler, "body.mass", first, count),
            ]
        )

    def check_body(self, mass: Any, centre: Sequence[Any]) -> None:
        """Raise SceneError for a centre with one row per member."""
        if count_rows(*centre) is not None:
            rule = "must be plain numbers or distributions, if each member has its own tensor"
            raise SceneError(rule, at="body.centre")
        if is_shared(mass, tuple(centre)):
            return
        if any(not is_shared(x) for x in centre) and count_rows(mass) is not None:
            rule = "cannot be a table beside distributions of the centre"
            raise SceneError(rule, at="body.mass")


def _columns_of(rows: Any, at: str) -> tuple[Array, ...]:
    """Return the six elements, one array each, of tensors; SceneError with the first bad row."""
    if isinstance(rows, (tuple, list)) and len(rows) == 6 and all(np.ndim(x) == 1 for x in rows):
        columns = [floats(row, at) for row in rows]
        if len({column.shape for column in columns}) > 1:
            raise SceneError("its six columns differ in length", at=at)
        tensors = symmetric(columns)
    else:
        tensors = floats(rows, at, wanted=Wanted((3,), is_matrix=True))
        _check_shape(tensors, at)
        columns = [0.5 * (tensors[:, i, j] + tensors[:, j, i]) for i, j in SIX]
    _check_tensors(tensors, at)
    frozen = tuple(np.array(column) for column in columns)
    for column in frozen:
        column.flags.writeable = False
    return frozen


def _check_shape(tensors: Array, at: str) -> None:
    """Raise SceneError for another shape than (members, 3, 3), and for members last."""
    shape = tensors.shape
    if tensors.ndim != 3 or shape[1:] != (3, 3) or not len(tensors):
        cure = ""
        if shape[1:] == (3,):
            cure = "; for principal moments use Body.from_moments"
        elif tensors.ndim == 3 and shape[:2] == (3, 3):
            cure = "; give np.moveaxis(x, -1, 0)"
        rule = f"has the shape {shape}: expected one tensor for each member, (members, 3, 3){cure}"
        raise SceneError(rule, at=at)
    # three tensors that are symmetric with members first and last are the same both ways
    last = np.moveaxis(tensors, -1, 0)
    if len(tensors) == 3 and skew_of(tensors).max() > 1e-9 and skew_of(last).max() <= 1e-9:
        raise SceneError("has the members last: give np.moveaxis(x, -1, 0)", at=at)


def _check_tensors(tensors: Array, at: str) -> None:
    """Raise SceneError for the first tensor that no body can have."""

    def refuse(bad: Any, why: Any) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            more = f" ({np.count_nonzero(bad):,} of {len(bad):,} rows)" if bad.sum() > 1 else ""
            raise SceneError(f"row {row}{more}: {why(row)}", at=at)

    refuse(~np.isfinite(tensors).all((1, 2)), lambda row: "is not finite")
    skew = skew_of(tensors)
    refuse(
        skew > 1e-9,
        lambda row: (
            f"is not symmetric: I_ij and I_ji differ by {skew[row]:.2g} of its largest element"
        ),
    )
    moments = np.asarray(np.linalg.eigvalsh(tensors), dtype=np.float64).T
    bad = violates_triangle(moments) | (moments[0] <= 1e-14 * moments[2])
    refuse(bad, lambda row: why_impossible(moments[:, row]))
