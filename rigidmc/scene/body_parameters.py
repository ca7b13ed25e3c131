"""The parameters of a body, and how each changes it.

A size of a solid changes its tensor about the fixed point, an element of a tensor changes it alone;
`rigidmc.mechanics.axes_rates` has the rates of moments and axes. The fixed point, its
distance from the origin of a solid, and the axes of the scene stay.
"""

import inspect
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.inputs.units import units_of_powers
from rigidmc.mechanics.axes_rates import axes_rates
from rigidmc.mechanics.inertia import about_point
from rigidmc.mechanics.solids import COMPONENTS, SOLIDS
from rigidmc.physics.dynamics.dual_arrays import DualArray, as_array, plain
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.parameter import (
    Parameter,
    Parameters,
    Path,
    Refusal,
    Seed,
    Seeds,
    by_name,
    of_quantities,
    of_quantity,
    of_vector,
    one_seed,
    put,
    refused,
    symmetric_parameters,
)
from rigidmc.scene.quantities import Grid, Rate, Varied, is_shared
from rigidmc.scene.reparametrise import own_number, rates_of
from rigidmc.scene.shape import UPRIGHT, ShapePart
from rigidmc.scene.stated import MESH, Stated, refused_numbers
from rigidmc.scene.units import BODY, size_units
from rigidmc.scene.vector_distributions import TensorRows
from rigidmc.scene.vector_distributions.bodies import ELEMENTS, TensorDistribution, UncertainInertia
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

POSITIVE = math.ulp(0.0), math.inf
STATED = "body", "stated"
# as in the columns of TensorRows: xx, yy, zz, yz, zx, xy
TENSOR_ELEMENTS = [
    (f"body.tensor.{i + 1}.{j + 1}", (i, j))
    for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
]
_EQUAL = (
    "turns the principal axes of a body with equal moments, which jump: give slightly different"
    " moments, or a parameter that keeps the axes"
)
_UNTURNED = (
    "turns the principal axes of a body that is described in them: give the body as a tensor with"
    " products of inertia"
)
_AT_CENTRE = (
    "moves the centre of mass, at which the fixed point is: give moments, mass and centre in place"
    " of the solid"
)
_OWN_CENTRE = "is the centre of the uncertain tensor: name it body.tensor.centre"
_SCENE_AXES = (
    'changes the principal axes of the mean tensor, the axes of the scene (axes = "principal")'
)


def body_parameters(body: Body) -> Parameters:
    """Return the parameters of a body by name.

    A solid has mass (or density) and sizes; other bodies have moments or a tensor, mass and centre.
    """
    if isinstance(body.stated, Stated):
        return by_name(_of_stated(body, body.stated))
    numbers = by_name(_of_numbers(body))
    if (solid := solid_of(body)) is not None:
        sizes, may_move = by_name(solid.parameters()), not solid.is_by_mass
        return sizes | {
            name: p._replace(seeds=None, is_settable=p.is_settable and may_move)
            for name, p in numbers.items()
        }
    if isinstance(body.moments, UncertainInertia) and body.frame == "principal":
        return numbers | refused(numbers, numbers, _SCENE_AXES)
    if isinstance(body.moments, UncertainInertia) and body.moments.centre is not None:
        numbers |= refused(numbers, (f"body.centre.{i}" for i in (1, 2, 3)), _OWN_CENTRE)
    for name, why in refused_numbers(body.stated).items():
        if name in numbers or why == MESH:
            numbers |= refused(numbers, (name,), why)
    return numbers


def _of_numbers(body: Body) -> Iterator[Parameter]:
    """Yield the moments or the tensor, the mass and the centre of a body."""
    path, unit = ("body", "moments"), BODY["moments"]
    if isinstance(body.moments, TensorDistribution):
        yield from _of_tensors(body.moments)
    else:
        yield from of_vector("body.moments", path, body.moments, unit, POSITIVE)
        yield from _of_one_tensor(body) if is_shared(body.moments) else ()
    yield from of_quantity("body.mass", ("body", "mass"), body.mass, BODY["mass"], POSITIVE)
    yield from of_quantities("body.centre", ("body", "centre"), body.centre, BODY["centre"])


def _of_stated(body: Body, stated: Stated) -> Iterator[Parameter]:
    """Yield the stated numbers of a body."""
    for (field, *places), rates in stated.rates().items():
        seeds = partial(moved_seeds, body, np.array(body.moments), *rates)
        name = ".".join(["body", field, *(str(i + 1) for i in places)])
        key = "inertia" if field == stated.key else field
        is_settable = field in ("moments", "mass", "centre")
        yield Parameter(name, BODY[field], (*STATED, key, *places), seeds, is_settable)
    if stated.key == "tensor":
        rule = "is not a number of the scene, which states a tensor: name its elements, body.tensor"
        for p in of_quantities("body.moments", ("body", "moments"), body.moments, BODY["moments"]):
            yield p._replace(seeds=rule, is_settable=False)


def moved_seeds(
    body: Body, moments: Array, mass: float, centre: Array, tensor: Array
) -> list[Seed] | Refusal:
    """Return the Seeds for rates of mass, centre of mass and tensor about the fixed point.

    mass : relative to the mass;  moments (3,) : of the tensor, in proportion to the members'
    """
    seeds = tensor_seeds(body, moments, tensor, relative)
    if isinstance(seeds, str):
        return seeds
    if mass != 0.0:
        seeds.append(Seed(("body", "mass"), relative(mass)))
    moved = enumerate(centre.tolist())
    return seeds + [Seed(("body", "centre", i), constant(x)) for i, x in moved if x != 0.0]


def constant(derivative: float) -> Rate:
    """Return the Rate of numbers with the same derivative for all members."""
    return lambda drawn: np.full_like(drawn.values, derivative)


def relative(derivative: float) -> Rate:
    """Return the Rate of numbers whose derivatives are in proportion to the numbers."""
    return lambda drawn: derivative * drawn.values


def _of_tensors(distribution: TensorDistribution) -> Iterator[Parameter]:
    """Yield the elements of a distribution of tensors."""
    path, unit = ("body", "moments"), BODY["tensor"]
    if isinstance(distribution, TensorRows):
        for k, (name, _) in enumerate(TENSOR_ELEMENTS):
            yield Parameter(name, unit, (*path, "rows", k), one_seed((*path, "rows", k)))
        return
    assert isinstance(distribution, UncertainInertia)
    covariance = np.array(distribution.covariance)
    yield from symmetric_parameters("body.tensor.mean", (*path, "mean"), 3, lambda i, j: unit)
    spread = symmetric_parameters(
        "body.tensor.covariance", (*path, "covariance"), len(covariance), _covariance_unit
    )
    width = np.sqrt(covariance.diagonal())
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(width, width)
    # zeros mark exact elements; a root has no derivative there
    if not np.nan_to_num(np.linalg.eigvalsh(np.nan_to_num(correlation))).min() > 1e-9:
        rule = "has a width of 0 in some direction, at a kink"
        spread = (p._replace(seeds=rule) for p in spread)
    yield from spread
    centre = distribution.centre or ()
    for p in of_quantities("body.tensor.centre", (*path, "centre"), centre, BODY["centre"]):
        yield p._replace(is_settable=False)


def _covariance_unit(i: int, j: int) -> str:
    """Return the units of a covariance of two of ELEMENTS, such as "kg m3"."""
    powers = {"tensor": (1, 2), "centre": (0, 1), "mass": (1, 0)}
    first, other = (powers[ELEMENTS[k].partition(".")[0]] for k in (i, j))
    return units_of_powers({"kg": first[0] + other[0], "m": first[1] + other[1]})


def _of_one_tensor(body: Body) -> Iterator[Parameter]:
    """Yield the elements of the tensor of a body in its described axes."""
    for name, (i, j) in TENSOR_ELEMENTS:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        seeds = partial(tensor_seeds, body, np.array(body.moments), unit, constant)
        yield Parameter(name, BODY["tensor"], ("body", "tensor", i, j), seeds)


def tensor_seeds(
    body: Body, moments: Array, change: Array, rate: Callable[[float], Rate]
) -> list[Seed] | Refusal:
    """Return the Seeds of moments and axes for a tensor that changes at the rate `change` (3, 3).

    moments (3,) : of the tensor;  rate : `constant`; or `relative`, for derivatives in proportion
        to the moments
    """
    axes = np.array(body.axes)
    moving, turning = axes_rates(moments, axes, change)
    if not np.isfinite(turning).all():
        return _EQUAL
    if body.axes == IDENTITY and np.abs(turning).max() > 0.0:
        return _UNTURNED
    by = moving / moments if rate is relative else moving
    seeds = [Seed(("body", "moments", i), rate(float(by[i]))) for i in range(3)]
    places = ((i, j) for i in range(3) for j in range(3))
    return seeds + [
        Seed(("body", "axes", i, j), constant(float(turning[i, j])))
        for i, j in places
        if turning[i, j] != 0.0
    ]


class Solid(NamedTuple):
    """A body that is a solid by itself, about any fixed point.

    length : factor of its lengths, other than 1 in the units of an integration
    mass, moments : of the first member
    """

    body: Body
    part: ShapePart
    length: float
    mass: float
    moments: Array

    @property
    def scale(self) -> str:
        """The argument that its mass is in proportion to, "mass" or "density"."""
        return next(iter(inspect.signature(SOLIDS[self.part.solid]).parameters))

    @property
    def is_by_mass(self) -> bool:
        """Whether a map may vary its mass, and the moments with it."""
        return self.scale == "mass" and self.length == 1.0

    def parameters(self) -> Iterator[Parameter]:
        """Yield the mass, or the density, and the sizes."""
        name, scale, path = f"body.{self.part.solid}", self.scale, ("body", "mass")
        unit, by, also = size_units(scale), self.scale_seeds, self.with_mass
        yield Parameter(f"{name}.{scale}", unit, path, by, self.is_by_mass, POSITIVE, also)
        for word, rate in rates_of(self.body.mass).items() if scale == "mass" else ():
            seeds: Seeds = rate if isinstance(rate, str) else partial(self.mass_seeds, rate)
            yield Parameter(f"{name}.mass.{word}", unit, (*path, word), seeds)
        for k, (key, *place) in enumerate(_components(self.part)):
            of_size = ".".join([name, key, *(str(i + 1) for i in place)])
            path, seeds = ("body", "shape", 0, "sizes", key, *place), partial(self.size_seeds, k)
            yield Parameter(of_size, size_units(key), path, seeds)

    def with_mass(self, model: Any, mass: Any) -> Any:
        """Return the model with moments in proportion to another mass: a number, a grid, a nominal
        number, or the masses of members."""
        # of 1 kg, not of the present mass: a rerun, which has other ones, then rounds alike
        made = Body.solid(self.part.solid, mass=1.0, **self.part.sizes)
        made = made.with_pivot(tuple(-x for x in self.part.at)) if any(self.part.at) else made
        each = map(float, made.moments)
        moments = (mass.times(x) if isinstance(mass, (Grid, Varied)) else mass * x for x in each)
        return put(model, ("body", "moments"), tuple(moments))

    def scale_seeds(self) -> list[Seed]:
        """Return the Seeds of the mass, or of the density."""
        if self.scale == "mass":
            return self.mass_seeds(own_number)
        density = self.mass / (plain(self.made()[0]) * self.length**3)
        paths: list[Path] = [("body", "mass"), *(("body", "moments", i) for i in range(3))]
        return [Seed(path, relative(1.0 / float(density))) for path in paths]

    def mass_seeds(self, rate: Rate) -> list[Seed]:
        """Return the Seeds of a parameter of the mass; the moments are in proportion."""

        def times(by: float) -> Rate:
            # quantities of a grid or a table have their own numbers; see `with_mass`
            return lambda drawn: by * rate(drawn._replace(values=drawn.values / by))

        ratios = (self.moments / self.mass).tolist()
        seeds = [Seed(("body", "moments", i), times(by)) for i, by in enumerate(ratios)]
        return [Seed(("body", "mass"), rate), *seeds]

    def size_seeds(self, k: int) -> list[Seed] | Refusal:
        """Return the Seeds of size number k."""
        mass, centre, tensor = self.made()
        axes = np.array(self.body.axes)
        moments = np.diagonal(axes.T @ tensor.value @ axes)
        by = 1.0 / self.length
        change = float(by * mass.tangents[k] / mass.value) if isinstance(mass, DualArray) else 0.0
        moved = centre.tangents[k] if isinstance(centre, DualArray) else np.zeros(3)
        if moved.any() and np.abs(plain(centre)).max() < 1e-12 * self.length:
            return _AT_CENTRE
        return moved_seeds(self.body, moments, change, moved, by * tensor.tangents[k])

    def made(self) -> tuple[Any, Any, Any]:
        """Return `_made` with tangents by all sizes."""
        unit = np.eye(len(_components(self.part)))
        numbers = iter(unit)

        def mark(x: Any) -> Any:
            return tuple(map(mark, x)) if isinstance(x, tuple) else DualArray(x, next(numbers))

        return _made(self.part, {key: mark(x) for key, x in self.part.sizes.items()})


def _components(part: ShapePart) -> list[tuple[Any, ...]]:
    """Return (name,) or (name, index) of the sizes of a solid."""
    components: list[tuple[Any, ...]] = []
    for key in part.sizes:
        count = COMPONENTS.get((part.solid, key))
        components += [(key,)] if count is None else [(key, i) for i in range(count)]
    return components


def _made(part: ShapePart, sizes: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Return (mass, centre (3,), tensor (3, 3) about the fixed point) of a solid of mass or density
    1, with sizes that may have tangents.

    About a point at -a from the origin of the solid, with the centre of mass c, TdC (3.26):

        I + m (a^2 1 - a a^T + 2 a.c 1 - a c^T - c a^T)
    """
    maker = SOLIDS[part.solid]
    scale = next(iter(inspect.signature(maker).parameters))
    mass, centre, tensor = maker(**{scale: 1.0}, **sizes)
    a, c = np.array(part.at), as_array(centre)
    across = a[:, None] * c[None, :]
    away = about_point(np.zeros((3, 3)), 1.0, a)
    moved = mass * (away + 2.0 * (a * c).sum(0) * np.eye(3) - across - across.T)
    return mass, c + a, tensor + moved


def solid_of(body: Body) -> Solid | None:
    """Return the Solid of a body; None if its moments, mass and centre differ from the solid's.

    Lengths may have another unit, a power of 2 of metres, as in an integration.
    """
    part = body.shape[0] if len(body.shape) == 1 else None
    if part is None or part.solid not in SOLIDS or part.turned != UPRIGHT:
        return None
    if isinstance(body.moments, VectorDistribution):
        return None
    moments, mass, centre = (values[..., 0] for values in body.sample(0, 0, 1))
    own_mass, own_centre, own_tensor = _made(part, part.sizes)
    tensor_per_mass, axes = own_tensor / own_mass, np.array(body.axes)
    tensor = (axes * moments) @ axes.T / mass
    length = 2.0 ** round(0.5 * float(np.log2(np.trace(tensor) / np.trace(tensor_per_mass))))
    off = np.abs(tensor - length**2 * tensor_per_mass).max() / np.trace(tensor)
    away = np.abs(axes @ centre - length * own_centre).max() / np.sqrt(np.trace(tensor))
    if not max(off, away) < 1e-12:  # rounding of a grid, and of a shift
        return None
    return Solid(body, part, length, float(mass), moments)
