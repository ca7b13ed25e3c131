"""The body: mass, centre of mass, principal moments about the fixed point and the axes they belong to."""

import inspect
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.mechanics import inertia, rotation, solids
from rigidmc.mechanics.inertia import broken
from rigidmc.scene.laws import checked
from rigidmc.scene.laws.protocol import Law, numbers_of
from rigidmc.scene.quantities import draw, is_open, is_shared, quantity, vector

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class _Hints(type):
    """Hints for attributes that Body does not have: Body.cone is Body.solid("cone", ...)."""

    def __getattr__(cls, name):
        words = f"type object 'Body' has no attribute '{name}'"
        if name in solids.SOLIDS:
            sizes = ", ".join(
                f"{key}=..." for key in inspect.signature(solids.SOLIDS[name]).parameters
            )
            words += f"; Body.solid('{name}', {sizes}) makes one"
        elif not name.startswith("_"):
            close = nearest(
                name, (*solids.SOLIDS, *(word for word in dir(cls) if not word.startswith("_")))
            )
            close = (
                f"solid('{close}', ...)"
                if close in solids.SOLIDS and close not in cls.__dict__
                else close
            )
            words += f"; did you mean Body.{close}?" if close else ""
        raise AttributeError(words)


@dataclass(frozen=True, eq=False)
class Body(metaclass=_Hints):
    """A rigid body that turns about a fixed point, the origin of the body's own axes.

    moments : principal moments (I1, I2, I3) about the fixed point [kg m^2]
    mass : [kg]
    centre : centre of mass from the fixed point, in the body's own axes [m]
    axes : 3x3, its columns are the principal axes in the body's own axes, right-handed; the identity unless the body was given by
        a tensor, by particles or by a shift

    Components of moments, mass and centre are numbers, distributions, grids, or arrays with one row per member; moments also
    SecondMoments, whose bodies always exist, and Correlated, with the covariance of inertia that was measured.
    Raises SceneError for moments that are not positive or break the triangle inequality I_i <= I_j + I_k.
    """

    moments: Any
    mass: Any = 1.0
    centre: tuple = (0.0, 0.0, 0.0)
    axes: tuple = IDENTITY

    def __post_init__(self):
        whole = isinstance(self.moments, Law)
        moments = (
            checked(self.moments, "body", "moments")
            if whole
            else vector(self.moments, "body", "moments")
        )
        object.__setattr__(self, "moments", moments)
        object.__setattr__(self, "mass", quantity(self.mass, "body", "mass"))
        object.__setattr__(self, "centre", vector(self.centre, "body", "centre"))
        if self.axes != IDENTITY and not is_shared(self.centre):
            raise SceneError(
                "body",
                "centre",
                None,
                "a body given by a tensor takes plain numbers; give principal moments instead",
            )
        fixed = [] if whole else [m for m in self.moments if not is_open(m)]
        if not all(np.min(m) > 0 for m in fixed):
            raise SceneError("body", "moments", self._given(), "principal moments must be positive")
        if not is_open(self.mass) and not np.min(self.mass) > 0:
            raise SceneError(
                "body",
                "mass",
                self.mass if is_shared(self.mass) else None,
                "the mass must be positive",
            )
        if len(fixed) == 3:
            bad = np.flatnonzero(broken(np.broadcast_arrays(*self.moments)))
            if bad.size:
                values = [
                    float(np.broadcast_to(m, (bad[0] + 1,))[bad[0]])
                    if np.ndim(m) == 0
                    else float(m[bad[0]])
                    for m in self.moments
                ]
                large, rest = max(values), sum(values) - max(values)
                row = "" if is_shared(self.moments) else f"row {bad[0]}: "
                rule = f"{row}the triangle inequality is broken: {large:g} exceeds the sum of the other two, {rest:g}; no rigid body has these"
                raise SceneError("body", "moments", self._given(), rule)

    def _given(self):
        return list(self.moments) if is_shared(self.moments) else None

    @classmethod
    def from_moments(cls, moments, mass=1.0, centre=(0.0, 0.0, 0.0)):
        """From principal moments (I1, I2, I3) or an array (members, 3) [kg m^2]; the body's own axes are the principal axes."""
        return cls(moments, mass, centre)

    @classmethod
    def from_tensor(cls, tensor, mass=1.0, centre=(0.0, 0.0, 0.0)):
        """From an inertia tensor (3, 3) about the fixed point [kg m^2], turned to its principal axes, TdC (3.19)-(3.23).

        A tensor that is diagonal already keeps its axes and their order; else the moments ascend, the largest components of the first
        two axes are positive and the third completes a right-handed set.
        """
        tensor = np.asarray(tensor, dtype=float)
        if tensor.shape != (3, 3):
            raise SceneError("body", "tensor", tensor.tolist(), "expected 3x3 finite numbers")
        try:
            moments, axes = inertia.principal_axes(tensor)
        except SceneError as error:
            raise SceneError("body", "tensor", tensor.tolist(), error.rule) from None
        return cls(tuple(moments.tolist()), mass, centre, tuple(map(tuple, axes.tolist())))

    @classmethod
    def from_particles(cls, masses, positions):
        """From N point particles: I_ij = sum m (r^2 delta_ij - x_i x_j), TdC (3.15). masses (N,) [kg], positions (N, 3) [m]."""
        masses, positions = np.asarray(masses, dtype=float), np.asarray(positions, dtype=float)
        if masses.ndim != 1 or positions.shape != (masses.size, 3):
            raise SceneError(
                "body",
                "particles",
                None,
                f"{masses.size} masses need positions of shape ({masses.size}, 3), not {positions.shape}",
            )
        if not (
            np.isfinite(masses).all()
            and np.isfinite(positions).all()
            and (masses >= 0).all()
            and masses.sum() > 0
        ):
            raise SceneError(
                "body",
                "particles",
                None,
                "masses and positions must be finite, masses not negative, and some mass positive",
            )
        mass = float(masses.sum())
        return cls.from_tensor(
            inertia.of_particles(masses, positions),
            mass,
            tuple((masses @ positions / mass).tolist()),
        )

    @classmethod
    def solid(cls, name, **sizes):
        """A solid of uniform density by its name in `rigidmc.mechanics.solids.SOLIDS`, about the point that its docstring names, axis 3 its own.

        sizes : its arguments, e.g. solid("hollow_cylinder", mass=1.0, inner=0.1, outer=0.2, height=0.3); all positive
        """
        if name not in solids.SOLIDS:
            raise unknown("body", name, None, "solid", solids.SOLIDS)
        make, table = solids.SOLIDS[name], f"body.{name}"
        wanted = tuple(inspect.signature(make).parameters)
        for key in sizes:
            if key not in wanted:
                raise unknown(table, key, None, "key", wanted)
        for key in wanted:
            if key not in sizes:
                raise SceneError(table, key, None, "is missing")
        given = {}
        for key in wanted:
            count = solids.COMPONENTS.get((name, key))
            parts = (sizes[key],) if count is None else vector(sizes[key], table, key, count)
            values = tuple(_positive(value, key, table) for value in parts)
            given[key] = values[0] if count is None else values
        mass, centre, tensor = make(**given)
        return cls(tuple(np.diag(tensor).tolist()), mass, centre)

    @classmethod
    def cylinder(cls, mass, radius, height):
        """Solid cylinder about its centre, axis 3 along it: M/12 diag(3a^2 + h^2, 3a^2 + h^2, 6a^2), TdC Example 3.1."""
        return cls.solid("cylinder", mass=mass, radius=radius, height=height)

    @classmethod
    def box(cls, mass, size):
        """Solid box with edges (x, y, z) about its centre: M/12 diag(y^2 + z^2, z^2 + x^2, x^2 + y^2)."""
        return cls.solid("box", mass=mass, size=size)

    @classmethod
    def from_density(cls, density, region, tolerance=1e-10):
        """From a density over a region, TdC (3.17), by Gauss-Legendre rules; the body turns about the origin.

        density : number or function rho(x, y, z) of arrays [kg/m^3]
        region : ("box", (x0, x1), (y0, y1), (z0, z1)), ("cylinder", radius, (z0, z1)), or ((x0, x1), y of x, z of x and y): functions
            that give the pair of limits, of arrays
        tolerance : relative; SceneError with the estimate where two rules differ by more

        The rules are of 24 and 40 points a dimension: a smooth density is integrated to rounding, also where limits meet like roots, as
        at the rim of a ball; one with edges inside is refused.
        """
        coarse, fine = (inertia.moments_of_density(density, region, points) for points in (24, 40))
        mass, first, second = fine[0], fine[1:4], fine[4:].reshape(3, 3)
        if not mass > 0:
            raise SceneError(
                "body", "density", None, f"the mass is {mass:.3g}; it must be positive"
            )
        # mass and moments have their own units: first moments are measured by the geometric mean of the two
        scale = np.array([mass, *[np.sqrt(mass * np.trace(second))] * 3, *[np.trace(second)] * 9])
        error = (np.abs(fine - coarse) / scale).max()
        if not error <= tolerance:
            rule = f"the integral is not settled: two rules differ by {error:.1e} of it, more than {tolerance:g}; cut the region where the density jumps"
            raise SceneError("body", "density", None, rule)
        return cls.from_tensor(
            np.trace(second) * np.eye(3) - second, float(mass), tuple((first / mass).tolist())
        )

    @classmethod
    def from_mesh(cls, path, density=None, mass=None, scale=1.0):
        """From a closed triangle mesh of uniform density (STL, OBJ; extra `mesh`, or a trimesh.Trimesh), turning about its origin.

        density [kg/m^3] or mass [kg]; scale : metres per unit of the file. SceneError for a mesh that is not watertight.
        """
        from rigidmc.mechanics import mesh

        if (density is None) == (mass is None):
            raise SceneError(
                "body.mesh", "density", density, "give either density or mass, one of them"
            )
        found, centre, tensor = mesh.mass_properties(
            mesh.load(path, _positive(scale, "scale", "body.mesh")), 1.0
        )
        by = (
            _positive(density, "density", "body.mesh")
            if mass is None
            else _positive(mass, "mass", "body.mesh") / found
        )
        return cls.from_tensor(by * tensor, float(by * found), tuple(centre.tolist()))

    def pivoted_at(self, point):
        """The same body turning about another of its points (own axes [m]), by the parallel axes theorem, TdC (3.26), (3.27)."""
        point = vector(point, "body", "pivot")
        if not is_shared(self.moments, self.mass, self.centre, point):
            raise SceneError(
                "body",
                "pivot",
                None,
                "only a body given by plain numbers can be moved; give moments about the new point instead",
            )
        new = np.array(self.centre) - np.array(point)
        tensor = inertia.about_point(
            inertia.about_centre(self.tensor, self.mass, self.centre), self.mass, new
        )
        return Body.from_tensor(tensor, self.mass, tuple(new.tolist()))

    def about_centre(self):
        """The same body turning about its centre of mass, TdC (3.28)."""
        return self.pivoted_at(self.centre)

    def joined(self, other, at=(0.0, 0.0, 0.0), turned=(1.0, 0.0, 0.0, 0.0)):
        """This body and another as one, about this one's fixed point. The other's origin lies `at` [m] and its axes are `turned` (an
        attitude) in this one's own axes. Where they overlap, mass counts twice."""
        return self._with(other, at, turned, 1.0)

    def without(self, other, at=(0.0, 0.0, 0.0), turned=(1.0, 0.0, 0.0, 0.0)):
        """This body less another that lies within it, placed as in `joined`; SceneError where what remains is no body."""
        return self._with(other, at, turned, -1.0)

    def _with(self, other, at, turned, sign):
        for body in (self, other):
            if not isinstance(body, Body) or not is_shared(body.moments, body.mass, body.centre):
                raise SceneError(
                    "body", "join", None, "only bodies given by plain numbers can be joined"
                )
        place = vector(at, "body", "at")
        if not is_shared(place):
            raise SceneError("body", "at", None, "expected plain numbers")
        a, at = rotation.matrix(turned), np.array(place)
        centre = a @ np.array(other.centre)
        bare = inertia.about_centre(a @ other.tensor @ a.T, other.mass, centre)
        tensor = self.tensor + sign * inertia.about_point(bare, other.mass, at + centre)
        mass = self.mass + sign * other.mass
        if not mass > 0:
            raise SceneError(
                "body",
                "mass",
                mass,
                "nothing remains: the part taken away is not lighter than the body",
            )
        middle = (self.mass * np.array(self.centre) + sign * other.mass * (at + centre)) / mass
        inertia.principal_axes(
            inertia.about_centre(tensor, mass, middle)
        )  # a remainder must be one about its own centre too
        return Body.from_tensor(tensor, mass, tuple(middle.tolist()))

    def to_principal(self, vector):
        """Components in the principal axes, in which results come, of vectors (..., 3) in the body's own axes."""
        return np.asarray(vector, dtype=float) @ np.array(self.axes)

    def to_own(self, vector):
        """Components in the body's own axes of vectors (..., 3) in principal axes, such as omega and momentum of a result."""
        return np.asarray(vector, dtype=float) @ np.array(self.axes).T

    def own_attitude(self, attitude):
        """Attitudes (..., 4) of the body's own axes from those of the principal axes, as results have them."""
        inverse = rotation.quaternion(np.array(self.axes)) * np.array([1.0, -1.0, -1.0, -1.0])
        return rotation.product(rotation.quaternion(attitude), inverse)

    def principal_attitude(self, attitude):
        """Attitudes (..., 4) of the principal axes, as `Start` takes them, from those of the body's own axes."""
        return rotation.product(
            rotation.quaternion(attitude), rotation.quaternion(np.array(self.axes))
        )

    def angular_momentum(self, omega):
        """L = I omega (..., 3), TdC (3.25), both in the body's own axes."""
        return inertia.angular_momentum(self.tensor, omega)

    def kinetic_energy(self, omega):
        """T = 1/2 omega I omega (...), TdC (3.16), omega (..., 3) in the body's own axes."""
        return inertia.kinetic_energy(self.tensor, omega)

    @property
    def tensor(self):
        """Inertia tensor (3, 3) about the fixed point in the body's own axes [kg m^2]; only for plain numbers."""
        if not is_shared(self.moments):
            raise ValueError("a body that differs from member to member has no single tensor")
        axes = np.array(self.axes)
        return (axes * np.array(self.moments)) @ axes.T

    def quantities(self):
        """All quantities of the body, in one flat tuple."""
        moments = (
            (self.moments, *numbers_of(self.moments))
            if isinstance(self.moments, Law)
            else self.moments
        )
        return (*moments, self.mass, *self.centre)

    def sample(self, seed, first, count):
        """(moments (3, count), mass (count), centre of mass in principal axes (3, count)) of some members."""
        if isinstance(self.moments, Law):
            moments = self.moments.sample(seed, "body.moments", first, count, None)
        else:
            moments = draw(self.moments, seed, "body.moments", first, count)
        mass = draw((self.mass,), seed, "body.mass", first, count)[0]
        centre = draw(self.centre, seed, "body.centre", first, count)
        if self.axes != IDENTITY:
            # written out: a BLAS product may round differently with the number of members
            centre = np.stack(
                [sum(self.axes[j][i] * centre[j] for j in range(3)) for i in range(3)]
            )
        return moments, mass, centre


def _positive(value, key, table="body"):
    value = quantity(value, table, key)
    if not is_shared(value):
        raise SceneError(
            table,
            key,
            None,
            "shapes take plain numbers; for bodies that differ give moments instead",
        )
    if not value > 0:
        raise SceneError(table, key, value, "must be positive")
    return value
