"""Bodies from moments, tensors, particles, solids, densities and meshes, and of other bodies."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.mechanics import inertia, rotation, solids
from rigidmc.scene import shape
from rigidmc.scene.mass_distribution import MassDistribution
from rigidmc.scene.quantities import is_shared, quantity, vector

if TYPE_CHECKING:
    from trimesh import Trimesh


class _Hints(type):
    """Hints for attributes that Body does not have: Body.cone is Body.solid("cone", ...)."""

    def __getattr__(cls, name: str) -> NoReturn:
        words = f"type object 'Body' has no attribute '{name}'"
        if name in solids.SOLIDS:
            names = inspect.signature(solids.SOLIDS[name]).parameters
            sizes = ", ".join(f"{key}=..." for key in names)
            words += f"; Body.solid('{name}', {sizes}) makes one"
        elif not name.startswith("_"):
            public = (word for word in dir(cls) if not word.startswith("_"))
            close = nearest(name, (*solids.SOLIDS, *public))
            if close in solids.SOLIDS and close not in cls.__dict__:
                close = f"solid('{close}', ...)"
            words += f"; did you mean Body.{close}?" if close else ""
        raise AttributeError(words)


@dataclass(frozen=True, eq=False)
class Body(MassDistribution, metaclass=_Hints):
    __doc__ = MassDistribution.__doc__

    @classmethod
    def from_moments(cls, moments: Any, mass: Any = 1.0, centre: Any = (0.0, 0.0, 0.0)) -> "Body":
        """A body from principal moments (I1, I2, I3) or an array (members, 3) [kg m^2]; the
        described axes are the principal axes."""
        return cls(moments, mass, centre)

    @classmethod
    def from_tensor(
        cls, tensor: ArrayLike, mass: Any = 1.0, centre: Any = (0.0, 0.0, 0.0)
    ) -> "Body":
        """A body from its inertia tensor (3, 3) about the fixed point [kg m^2], turned to principal
        axes, TdC (3.19)-(3.23).

        A diagonal tensor keeps its axes and their order. Otherwise the moments ascend, the largest
        components of the first two axes are positive, and the third axis completes a right-handed
        set.
        """
        matrix = np.asarray(tensor, dtype=float)
        if matrix.shape != (3, 3):
            raise SceneError("body", "tensor", matrix.tolist(), "expected 3x3 finite numbers")
        try:
            moments, axes = inertia.principal_axes(matrix)
        except SceneError as error:
            raise SceneError("body", "tensor", matrix.tolist(), error.rule) from None
        return cls(tuple(moments.tolist()), mass, centre, tuple(map(tuple, axes.tolist())))

    @classmethod
    def from_particles(cls, masses: ArrayLike, positions: ArrayLike) -> "Body":
        """A body of N point particles, TdC (3.15).

            I_ij = sum m (r^2 delta_ij - x_i x_j)

        masses : (N,) [kg]
        positions : (N, 3) [m]
        """
        m, x = np.asarray(masses, dtype=float), np.asarray(positions, dtype=float)
        if m.ndim != 1 or x.shape != (m.size, 3):
            rule = f"{m.size} masses need positions of shape ({m.size}, 3), not {x.shape}"
            raise SceneError("body", "particles", None, rule)
        finite = np.isfinite(m).all() and np.isfinite(x).all()
        if not (finite and (m >= 0).all() and m.sum() > 0):
            rule = "masses and positions must be finite, no mass negative, and some mass positive"
            raise SceneError("body", "particles", None, rule)
        mass = float(m.sum())
        centre = tuple((m @ x / mass).tolist())
        body = cls.from_tensor(inertia.of_particles(m, x), mass, centre)
        return replace(body, shape=shape.of_particles(m, x))

    @classmethod
    def solid(cls, name: str, **sizes: Any) -> "Body":
        """A solid of uniform density by its name in `rigidmc.mechanics.solids.SOLIDS`, about the
        point that its docstring names, with axis 3 as its own axis.

        sizes : its arguments, all positive, e.g.
            solid("hollow_cylinder", mass=1.0, inner=0.1, outer=0.2, height=0.3)
        """
        if name not in solids.SOLIDS:
            raise unknown("body", name, None, "solid", solids.SOLIDS)
        make, table = solids.SOLIDS[name], f"body.{name}"
        wanted = tuple(inspect.signature(make).parameters)
        for key in sizes:
            if key not in wanted:
                raise unknown(table, key, None, "key", wanted)
        given: dict[str, Any] = {}
        for key in wanted:
            if key not in sizes:
                raise SceneError(table, key, None, "is missing")
            count = solids.COMPONENTS.get((name, key))
            if count is None:
                given[key] = _positive(sizes[key], key, table)
            else:
                parts = vector(sizes[key], table, key, count)
                given[key] = tuple(_positive(part, key, table) for part in parts)
        mass, centre, tensor = make(**given)
        sizes = {key: given[key] for key in shape.sizes_of(name)}
        parts = (shape.Part(name, sizes),)
        return cls(tuple(np.diag(tensor).tolist()), mass, centre, shape=parts)

    @classmethod
    def cylinder(cls, mass: float, radius: float, height: float) -> "Body":
        """A solid cylinder about its centre, axis 3 along it, TdC Example 3.1.

        I = M/12 diag(3a^2 + h^2, 3a^2 + h^2, 6a^2)
        """
        return cls.solid("cylinder", mass=mass, radius=radius, height=height)

    @classmethod
    def box(cls, mass: float, size: tuple[float, float, float]) -> "Body":
        """A solid box with edges (x, y, z) about its centre.

        I = M/12 diag(y^2 + z^2, z^2 + x^2, x^2 + y^2)
        """
        return cls.solid("box", mass=mass, size=size)

    @classmethod
    def from_density(
        cls, density: float | Callable[..., Any], region: Any, tolerance: float = 1e-10
    ) -> "Body":
        """A body from a density over a region, TdC (3.17), by Gauss-Legendre rules; it turns about
        the origin.

        density : a number, or a function rho(x, y, z) of arrays [kg/m^3]
        region : ("box", (x0, x1), (y0, y1), (z0, z1)), or ("cylinder", radius, (z0, z1)), or
            ((x0, x1), y of x, z of x and y) with functions of arrays that give pairs of limits
        tolerance : relative; SceneError with the estimate if two rules differ by more

        The rules have 24 and 40 points per dimension. A smooth density is integrated to rounding,
        also if limits meet like roots, as at the rim of a ball; a density with edges inside is
        refused.
        """
        coarse, fine = (inertia.moments_of_density(density, region, points) for points in (24, 40))
        mass, first, second = fine[0], fine[1:4], fine[4:].reshape(3, 3)
        if not mass > 0:
            rule = f"the mass is {mass:.3g}; it must be positive"
            raise SceneError("body", "density", None, rule)
        # mass and second moments differ in units: their geometric mean measures first moments
        scale = np.array([mass, *[np.sqrt(mass * np.trace(second))] * 3, *[np.trace(second)] * 9])
        error = (np.abs(fine - coarse) / scale).max()
        if not error <= tolerance:
            rule = (
                f"the integral has not converged: two rules differ by {error:.1e} of it, more than"
                f" {tolerance:g}; cut the region where the density jumps"
            )
            raise SceneError("body", "density", None, rule)
        tensor, centre = np.trace(second) * np.eye(3) - second, first / mass
        body = cls.from_tensor(tensor, float(mass), tuple(centre.tolist()))
        return replace(body, shape=shape.of_region(region))

    @classmethod
    def from_mesh(
        cls,
        path: "str | Trimesh",
        density: float | None = None,
        mass: float | None = None,
        scale: float = 1.0,
    ) -> "Body":
        """A body from a closed triangle mesh of uniform density, turning about the mesh's origin.

        path : STL or OBJ file (extra `mesh`), or a trimesh.Trimesh
        density [kg/m^3] or mass [kg]
        scale : metres per unit of the file

        Raises SceneError for a mesh that is not watertight.
        """
        from rigidmc.mechanics import mesh

        table = "body.mesh"
        if (density is None) == (mass is None):
            raise SceneError(table, "density", density, "give either density or mass, one of them")
        loaded = mesh.load(path, _positive(scale, "scale", table))
        volume, centre, tensor = mesh.mass_properties(loaded, 1.0)
        if mass is None:
            by = _positive(density, "density", table)
        else:
            by = _positive(mass, "mass", table) / volume
        body = cls.from_tensor(by * tensor, float(by * volume), tuple(centre.tolist()))
        return replace(body, shape=(shape.of_mesh(loaded),))

    def pivoted_at(self, point: Any) -> "Body":
        """The same body turning about another of its points [m, described axes], by the parallel
        axes theorem, TdC (3.26), (3.27)."""
        point = vector(point, "body", "pivot")
        if not is_shared(self.moments, self.mass, self.centre, point):
            rule = (
                "only a body given by plain numbers can be moved; give moments about the new point"
                " instead"
            )
            raise SceneError("body", "pivot", None, rule)
        new = np.array(self.centre) - np.array(point)
        bare = inertia.about_centre(self.tensor, self.mass, self.centre)
        tensor = inertia.about_point(bare, self.mass, new)
        parts = tuple(part.placed(-np.array(point)) for part in self.shape)
        body = Body.from_tensor(tensor, self.mass, tuple(new.tolist()))
        return replace(body, shape=parts)

    def about_centre(self) -> "Body":
        """The same body turning about its centre of mass, TdC (3.28)."""
        return self.pivoted_at(self.centre)

    def joined(
        self, other: "Body", at: Any = (0.0, 0.0, 0.0), turned: Any = (1.0, 0.0, 0.0, 0.0)
    ) -> "Body":
        """This body and another as one, about the fixed point of this body.

        at : origin of the other body in the described axes of this one [m]
        turned : attitude of the other body's described axes in those of this body

        Mass counts twice where the bodies overlap.
        """
        return self._with(other, at, turned, 1.0)

    def without(
        self, other: "Body", at: Any = (0.0, 0.0, 0.0), turned: Any = (1.0, 0.0, 0.0, 0.0)
    ) -> "Body":
        """This body less another that lies within it, placed as in `joined`; SceneError if the
        remainder is no body."""
        return self._with(other, at, turned, -1.0)

    def _with(self, other: "Body", at: Any, turned: Any, sign: float) -> "Body":
        for body in (self, other):
            if not isinstance(body, Body) or not is_shared(body.moments, body.mass, body.centre):
                rule = "only bodies given by plain numbers can be joined"
                raise SceneError("body", "join", None, rule)
        place = vector(at, "body", "at")
        if not is_shared(place):
            raise SceneError("body", "at", None, "expected plain numbers")
        a, origin = rotation.matrix(turned), np.array(place)
        centre = a @ np.array(other.centre)
        bare = inertia.about_centre(a @ other.tensor @ a.T, other.mass, centre)
        tensor = self.tensor + sign * inertia.about_point(bare, other.mass, origin + centre)
        mass = self.mass + sign * other.mass
        if not mass > 0:
            rule = "nothing remains: the part taken away is not lighter than the body"
            raise SceneError("body", "mass", mass, rule)
        middle = (self.mass * np.array(self.centre) + sign * other.mass * (origin + centre)) / mass
        # a remainder must be a body about its own centre of mass too
        inertia.principal_axes(inertia.about_centre(tensor, mass, middle))
        parts = (part.placed(place, turned) for part in other.shape)
        body = Body.from_tensor(tensor, mass, tuple(middle.tolist()))
        return replace(body, shape=shape.joined(self.shape, parts, sign < 0.0))


def _positive(value: Any, key: str, table: str = "body") -> float:
    """A positive plain number; SceneError."""
    number = quantity(value, table, key)
    if not isinstance(number, float):
        rule = "shapes take plain numbers; for bodies that differ give moments instead"
        raise SceneError(table, key, None, rule)
    if not number > 0:
        raise SceneError(table, key, number, "must be positive")
    return number
