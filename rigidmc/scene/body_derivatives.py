"""The parameters of a body by which a model can be differentiated, and how each changes it.

A size of a solid changes its tensor about the fixed point, an element of a tensor changes it alone;
`rigidmc.mechanics.axes_rates` has the rates of moments and axes. The fixed point, its
distance from the origin of a solid, and the axes of the scene stay.
"""

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics.axes_rates import axes_rates
from rigidmc.mechanics.inertia import about_point
from rigidmc.mechanics.solids import COMPONENTS, SOLIDS
from rigidmc.physics.dynamics.dual_arrays import DualArray, as_array, plain
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.quantities import Rate, is_shared
from rigidmc.scene.reparametrise import own_number, rates_of
from rigidmc.scene.shape import UPRIGHT, ShapePart
from rigidmc.scene.stated import MESH, Stated, refused_numbers
from rigidmc.scene.vector_distributions import TensorRows
from rigidmc.scene.vector_distributions.bodies import TensorDistribution, UncertainInertia
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Path = tuple[str | int, ...]  # of fields and indices, from a Model


class Seed(NamedTuple):
    """A quantity of a model that depends on a parameter, and the derivative of its numbers."""

    path: Path
    rate: Rate


Array = NDArray[np.float64]
Refusal = str  # why there is no derivative, to follow "it"
Given = Callable[[], list[Seed] | Refusal] | Refusal

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


def constant(derivative: float) -> Rate:
    """Return the Rate of numbers with the same derivative for all members."""
    return lambda drawn: np.full_like(drawn.values, derivative)


def relative(derivative: float) -> Rate:
    """Return the Rate of numbers whose derivatives are in proportion to the numbers."""
    return lambda drawn: derivative * drawn.values


def of_quantity(name: str, path: Path, quantity: Any) -> dict[str, Given]:
    """Return the parameters of a quantity: the member's own number, and each parameter of its
    distribution."""
    known: dict[str, Given] = {name: one_seed(path, own_number)}
    for word, rate in rates_of(quantity).items():
        known[f"{name}.{word}"] = rate if isinstance(rate, str) else one_seed(path, rate)
    return known


def one_seed(path: Path, rate: Rate) -> Callable[[], list[Seed]]:
    """Return a function that returns one Seed."""
    return lambda: [Seed(path, rate)]


def body_parameters(body: Body) -> dict[str, Given]:
    """Return {name: function that returns the Seeds of a parameter of a body, or the reason why it
    has no derivative}.

    A solid has mass (or density) and sizes; other bodies have moments or a tensor, mass and centre.
    """
    if isinstance(body.stated, Stated):
        return _of_stated(body, body.stated)
    if (solid := solid_of(body)) is not None:
        return solid.parameters()
    known: dict[str, Given] = {}
    if isinstance(body.moments, TensorDistribution):
        known |= _of_tensors(body.moments)
    elif not isinstance(body.moments, VectorDistribution):
        for i in range(3):
            path = ("body", "moments", i)
            known |= of_quantity(f"body.moments.{i + 1}", path, body.moments[i])
        if is_shared(body.moments):
            known |= _of_one_tensor(body)
    known |= of_quantity("body.mass", ("body", "mass"), body.mass)
    for i in range(3):
        known |= of_quantity(f"body.centre.{i + 1}", ("body", "centre", i), body.centre[i])
    if isinstance(body.moments, UncertainInertia) and body.frame == "principal":
        return dict.fromkeys(known, _SCENE_AXES)
    if isinstance(body.moments, UncertainInertia) and body.moments.centre is not None:
        known |= dict.fromkeys((f"body.centre.{i}" for i in (1, 2, 3)), _OWN_CENTRE)
    refused = refused_numbers(body.stated)
    return known | {name: why for name, why in refused.items() if name in known or why == MESH}


def _of_stated(body: Body, stated: Stated) -> dict[str, Given]:
    """Return the stated numbers of a body."""
    known: dict[str, Given] = {}
    for name, rates in stated.rates().items():
        known[name] = lambda rates=rates: moved_seeds(body, np.array(body.moments), *rates)  # type: ignore[misc]
    if stated.key == "tensor":
        rule = "is not a number of the scene, which states a tensor: name its elements, body.tensor"
        known |= dict.fromkeys((f"body.moments.{i}" for i in (1, 2, 3)), rule)
    return known


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


def _of_tensors(distribution: TensorDistribution) -> dict[str, Given]:
    """Return the elements of a distribution of tensors."""
    path = ("body", "moments")
    if isinstance(distribution, TensorRows):
        places = enumerate(TENSOR_ELEMENTS)
        return {name: one_seed((*path, "rows", k), own_number) for k, (name, _) in places}
    assert isinstance(distribution, UncertainInertia)
    covariance = np.array(distribution.covariance)
    known = symmetric_parameters("body.tensor.mean", (*path, "mean"), 3)
    spread = symmetric_parameters("body.tensor.covariance", (*path, "covariance"), len(covariance))
    width = np.sqrt(covariance.diagonal())
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(width, width)
    # zeros mark exact elements; a root has no derivative there
    if not np.nan_to_num(np.linalg.eigvalsh(np.nan_to_num(correlation))).min() > 1e-9:
        spread = dict.fromkeys(spread, "has a width of 0 in some direction, at a kink")
    known |= spread
    for i, x in enumerate(distribution.centre or ()):
        known |= of_quantity(f"body.tensor.centre.{i + 1}", (*path, "centre", i), x)
    return known


def symmetric_parameters(name: str, path: Path, size: int) -> dict[str, Given]:
    """Return the elements i <= j of a symmetric matrix; i.j changes j.i, too."""

    def seeds(i: int, j: int) -> Callable[[], list[Seed]]:
        return lambda: [Seed((*path, *place), own_number) for place in sorted({(i, j), (j, i)})]

    pairs = ((i, j) for i in range(size) for j in range(i, size))
    return {f"{name}.{i + 1}.{j + 1}": seeds(i, j) for i, j in pairs}


def _of_one_tensor(body: Body) -> dict[str, Given]:
    """Return the elements of the tensor of a body in its described axes."""
    known: dict[str, Given] = {}
    for name, (i, j) in TENSOR_ELEMENTS:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        known[name] = lambda unit=unit: tensor_seeds(  # type: ignore[misc]
            body, np.array(body.moments), unit, constant
        )
    return known


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

    def parameters(self) -> dict[str, Given]:
        """Return the mass, or the density, and the sizes."""
        solid = self.part.solid
        scale = next(iter(inspect.signature(SOLIDS[solid]).parameters))
        known: dict[str, Given] = {f"body.{solid}.{scale}": lambda: self.scale_seeds(scale)}
        if scale == "mass":
            for word, rate in rates_of(self.body.mass).items():
                known[f"body.{solid}.mass.{word}"] = (
                    rate if isinstance(rate, str) else lambda rate=rate: self.mass_seeds(rate)  # type: ignore[misc]
                )
        for k, (key, i) in enumerate(_components(self.part)):
            name = f"body.{solid}.{key}" if i is None else f"body.{solid}.{key}.{i + 1}"
            known[name] = lambda k=k: self.size_seeds(k)  # type: ignore[misc]
        return known

    def scale_seeds(self, scale: str) -> list[Seed]:
        """Return the Seeds of the mass, or of the density."""
        if scale == "mass":
            return self.mass_seeds(own_number)
        density = self.mass / (plain(self.made()[0]) * self.length**3)
        paths: list[Path] = [("body", "mass"), *(("body", "moments", i) for i in range(3))]
        return [Seed(path, relative(1.0 / float(density))) for path in paths]

    def mass_seeds(self, rate: Rate) -> list[Seed]:
        """Return the Seeds of a parameter of the mass; the moments are in proportion."""

        def times(by: float) -> Rate:
            # quantities of a grid or a table have their own numbers; see `Body` of `_of_mass`
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


def _components(part: ShapePart) -> list[tuple[str, int | None]]:
    """Return (name, index or None) of the sizes of a solid."""
    found: list[tuple[str, int | None]] = []
    for key in part.sizes:
        count = COMPONENTS.get((part.solid, key))
        found += [(key, None)] if count is None else [(key, i) for i in range(count)]
    return found


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
    own, axes = own_tensor / own_mass, np.array(body.axes)
    tensor = (axes * moments) @ axes.T / mass
    length = 2.0 ** round(0.5 * float(np.log2(np.trace(tensor) / np.trace(own))))
    off = np.abs(tensor - length**2 * own).max() / np.trace(tensor)
    away = np.abs(axes @ centre - length * own_centre).max() / np.sqrt(np.trace(tensor))
    if not max(off, away) < 1e-12:  # rounding of a grid, and of a shift
        return None
    return Solid(body, part, length, float(mass), moments)
