"""Makers of bodies: from moments, a tensor, particles, a named solid or a density.

A base of `rigidmc.scene.body.Body`. A maker computes mass, centre of mass and the inertia tensor
about the fixed point, and ends in `_of_tensor`.
"""

import inspect
from collections.abc import Callable
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.inputs.arrays import as_plain_arrays, as_tuples, floats
from rigidmc.inputs.labelled import Wanted
from rigidmc.mechanics import inertia, solids
from rigidmc.mechanics.density import moments_of_density
from rigidmc.scene import shape
from rigidmc.scene.body_numbers import BodyNumbers
from rigidmc.scene.inertia_about import (
    checked_tensor,
    has_rows,
    is_about_centre,
    positive_number,
    principal_axes_of,
    tensor_about_pivot,
)
from rigidmc.scene.quantities import is_shared, vector
from rigidmc.scene.shape import Shape
from rigidmc.scene.stated import NO_RATE, Stated
from rigidmc.scene.units import in_si
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.tensors import TensorRows


class _Hints(type):
    """Metaclass with hints for missing attributes: Body.cone is Body.solid("cone", ...)."""

    def __getattr__(cls, name: str) -> NoReturn:
        words = f"type object 'Body' has no attribute '{name}'"
        if name in solids.SOLIDS:
            keys = inspect.signature(solids.SOLIDS[name]).parameters
            words += f"; use Body.solid('{name}', {', '.join(f'{key}=...' for key in keys)})"
        elif not name.startswith("_"):
            public = {word for word in dir(cls) if not word.startswith("_")}
            close = nearest(name, (*solids.SOLIDS, *public))
            if close in solids.SOLIDS and close not in public:
                close = f"solid('{close}', ...)"
            words += f"; did you mean Body.{close}?" if close else ""
        raise AttributeError(words)


class BodyMakers(BodyNumbers, metaclass=_Hints):
    """Class methods of Body that make a body."""

    @classmethod
    def from_moments(
        cls, moments: Any, mass: Any = None, centre: Any = (0.0, 0.0, 0.0), about: str = "pivot"
    ) -> Self:
        """Make a body from its principal moments; the described axes are the principal axes.

        With about = "centre", they are the principal axes about the centre of mass.

        Parameters
        ----------
        moments : quantities (3,), array_like (members, 3) or distribution [kg m^2]
            (I1, I2, I3)
        mass : quantity, optional [kg]
            mass of the body; 1 kg if not given
        centre : quantities (3,), optional [m]
            centre of mass from the fixed point
        about : str, optional
            the point of the moments: "pivot", the fixed point, or "centre", the centre of mass

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            for impossible moments, and for about = "centre" with a body that differs between
            members or has a centre but no mass

        Examples
        --------
        >>> rm.Body.from_moments((1.0, 2.0, 2.5)).moments
        (1.0, 2.0, 2.5)
        >>> rm.Body.from_moments((1.0, 1.0, 0.5), 2.0, (0.0, 0.0, 3.0), about="centre").moments
        (19.0, 19.0, 0.5)
        """
        body = cls(moments, mass, centre)
        if not is_about_centre(about):
            return body
        if not is_shared(body.moments, body.mass, body.centre):
            rule = 'must be plain numbers with about = "centre"; give moments about the fixed point'
            raise SceneError(rule, at="body.moments")
        moved = tensor_about_pivot(np.diag(body.moments), mass, centre)
        stated = Stated.about_centre(body.moments, mass, centre)
        return cls._of_tensor(moved, mass, centre, stated=stated)

    @classmethod
    def from_tensor(
        cls,
        tensor: ArrayLike | TensorDistribution,
        mass: Any = None,
        centre: Any = (0.0, 0.0, 0.0),
        about: str = "pivot",
        axes: str = "described",
    ) -> Self:
        """Make a body from its inertia tensor, transformed to principal axes, TdC (3.19)-(3.23).

        Starts, effects and results are in the axes of the tensor; rigidmc computes in the principal
        axes. Each principal axis has the number of the axis of the tensor that is nearest to it.

        Parameters
        ----------
        tensor : array_like (3, 3) or (members, 3, 3), UncertainInertia or TensorRows [kg m^2]
            symmetric tensor, I_xy = -int x y dm, or one for each member
        mass : float, optional [kg]
            mass of the body; 1 kg if not given
        centre : array_like (3,), optional [m]
            centre of mass from the fixed point, in the axes of the tensor
        about : str, optional
            the point of the tensor: "pivot", the fixed point, or "centre", the centre of mass, as
            in CAD programs, robot descriptions and data sheets. Then the tensor about the fixed
            point is I + m (c^2 1 - c c^T), TdC (3.26); an uncertain tensor and its covariance are
            moved to first order
        axes : str, optional
            "principal" if starts, effects and results are in the principal axes instead; these are
            in the order of ascending moments, the largest components of the first two axes are
            positive, and the third axis completes a right-handed set; a diagonal tensor keeps its
            axes and their order

        Returns
        -------
        Body
            the body, with the axes of the tensor as its described axes

        Raises
        ------
        SceneError
            for an impossible tensor, with its likely causes, and for about = "centre" with a mass
            or centre that differs between members, or with a centre but no mass

        Examples
        --------
        >>> body = rm.Body.from_tensor([[2.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]])
        >>> [round(moment, 12) for moment in body.moments]
        [1.5, 2.5, 3.0]
        >>> sheet = np.diag([10.0, 12.0, 8.0])  # about the centre of mass
        >>> rm.Body.from_tensor(sheet, 50.0, (0.0, 0.0, 0.4), about="centre").tensor.diagonal()
        array([18., 20.,  8.])
        """
        tensor = in_si(tensor, "kg m2", "body.tensor")
        # TOML gives the columns of a table as a tuple
        if (isinstance(tensor, tuple) and len(tensor) == 6) or has_rows(tensor):
            tensor = TensorRows(tensor)
        stated: Stated | str | None = None
        if is_about_centre(about):
            if isinstance(tensor, TensorRows):
                rule = "tensors of single members must be about the fixed point, not the centre"
                raise SceneError(rule, at="body.about", value=about)
            stated = NO_RATE
            if not isinstance(tensor, TensorDistribution):
                tensor = checked_tensor(tensor)
                # moved to the fixed point, an impossible tensor may look possible
                principal_axes_of(tensor, mass, (0.0, 0.0, 0.0))
                stated = Stated.about_centre(as_tuples(tensor), mass, centre)
            tensor = tensor_about_pivot(tensor, mass, centre)
        if isinstance(tensor, TensorDistribution):
            return cls(tensor, mass, centre, frame=axes, stated=stated)
        return cls._of_tensor(tensor, mass, centre, frame=axes, stated=stated)

    @classmethod
    def _of_tensor(
        cls,
        tensor: ArrayLike,
        mass: Any,
        centre: Any,
        parts: Shape = (),
        frame: str = "described",
        stated: Stated | str | None = None,
    ) -> Self:
        """Make a body from a tensor (3, 3), with the solids that pictures draw."""
        moments, axes = principal_axes_of(checked_tensor(tensor), mass, centre, frame)
        numbers = as_tuples(moments), mass, centre, as_tuples(axes)
        return cls(*numbers, parts, frame, stated=stated)

    @classmethod
    def from_particles(cls, masses: ArrayLike, positions: ArrayLike) -> Self:
        """Make a body from N point particles, TdC (3.15).

        Its inertia tensor::

            I_ij = sum m (r^2 delta_ij - x_i x_j)

        Parameters
        ----------
        masses : array_like (N,) [kg]
            masses of the particles
        positions : array_like (N, 3) [m]
            positions from the fixed point

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            for negative or non-finite masses, and for impossible bodies, such as particles on a
            line

        Examples
        --------
        >>> corners = [[1, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]]
        >>> rm.Body.from_particles([1, 1, 1, 1], corners).moments
        (8.0, 2.0, 10.0)
        """
        m = floats(in_si(masses, "kg", at := "body.particles.masses"), at)
        wanted = Wanted((3,), by_member=False)
        x = floats(in_si(positions, "m", at := "body.particles.positions"), at, wanted=wanted)
        if m.ndim != 1 or x.shape != (m.size, 3):
            rule = f"{m.size} masses need positions of shape ({m.size}, 3), not {x.shape}"
            raise SceneError(rule, at="body.particles")
        finite = np.isfinite(m).all() and np.isfinite(x).all()
        if not (finite and (m >= 0).all() and m.sum() > 0):
            rule = "masses and positions must be finite, no mass negative, and some mass positive"
            raise SceneError(rule, at="body.particles")
        mass = float(m.sum())
        centre, parts = as_tuples(m @ x / mass), shape.shape_of_particles(m, x)
        return cls._of_tensor(inertia.of_particles(m, x), mass, centre, parts)

    @classmethod
    def solid(cls, name: str, **sizes: Any) -> Self:
        """Make a solid of uniform density by its name in `rigidmc.mechanics.solids.SOLIDS`.

        It rotates about the point named in the docstring there; axis 3 is its symmetry axis.

        Parameters
        ----------
        name : str
            such as "hollow_cylinder"
        **sizes : float, str or quantity [kg, m]
            arguments of the solid, all positive, also with their units, as "3 cm"

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            for an unknown name, and a missing, unknown or nonpositive size

        Examples
        --------
        >>> ring = rm.Body.solid("hollow_cylinder", mass=1.0, inner=0.1, outer=0.2, height=0.3)
        >>> round(ring.moments[2], 12)  # M/2 (inner^2 + outer^2)
        0.025
        """
        if name not in solids.SOLIDS:
            raise unknown("solid", solids.SOLIDS, at="body", key=name)
        make, at = solids.SOLIDS[name], f"body.{name}"
        wanted = tuple(inspect.signature(make).parameters)
        for key in sizes:
            if key not in wanted:
                raise unknown("key", wanted, at=at, key=key)
        checked: dict[str, Any] = {}
        for key in wanted:
            if key not in sizes:
                raise SceneError("is missing", at=f"{at}.{key}")
            count = solids.COMPONENTS.get((name, key))
            if count is None:
                checked[key] = positive_number(sizes[key], f"{at}.{key}")
            else:
                parts = vector(in_si(sizes[key], "m", f"{at}.{key}"), f"{at}.{key}", count)
                checked[key] = tuple(positive_number(part, f"{at}.{key}") for part in parts)
        mass, centre, tensor = make(**checked)
        part = shape.ShapePart(name, {key: checked[key] for key in shape.sizes_of(name)})
        return cls(as_tuples(np.diag(tensor)), mass, centre, shape=(part,))

    @classmethod
    def cylinder(cls, mass: Any, radius: Any, height: Any) -> Self:
        """Make a solid cylinder about its centre, with axis 3 along it, TdC Example 3.1.

        Its inertia tensor::

            I = M/12 diag(3a^2 + h^2, 3a^2 + h^2, 6a^2)

        Parameters
        ----------
        mass : float [kg]
            M
        radius : float [m]
            a
        height : float [m]
            h

        Returns
        -------
        Body
            the body

        Examples
        --------
        >>> rm.Body.cylinder(mass=12.0, radius=1.0, height=3.0).moments
        (12.0, 12.0, 6.0)
        """
        return cls.solid("cylinder", mass=mass, radius=radius, height=height)

    @classmethod
    def box(cls, mass: Any, size: Any) -> Self:
        """Make a solid box about its centre.

        Its inertia tensor::

            I = M/12 diag(y^2 + z^2, z^2 + x^2, x^2 + y^2)

        Parameters
        ----------
        mass : float [kg]
            M
        size : array_like (3,) [m]
            edges (x, y, z)

        Returns
        -------
        Body
            the body

        Examples
        --------
        >>> rm.Body.box(mass=12.0, size=(1.0, 2.0, 3.0)).moments
        (13.0, 10.0, 5.0)
        """
        return cls.solid("box", mass=mass, size=size)

    @classmethod
    def from_density(
        cls, density: float | Callable[..., Any], region: Any, tolerance: float = 1e-10
    ) -> Self:
        """Make a body from a density over a region, TdC (3.17); it rotates about the origin.

        Gauss-Legendre rules with 24 and 40 points per dimension integrate a smooth density to
        rounding, even if limits meet like square roots, as at the rim of a ball. A density with
        internal jumps is refused.

        Parameters
        ----------
        density : float or callable [kg/m^3]
            a number, or a function rho(x, y, z) of arrays
        region : tuple [m]
            ("box", (x0, x1), (y0, y1), (z0, z1)), or ("cylinder", radius, (z0, z1)), or
            ((x0, x1), y of x, z of x and y) with functions of arrays that return pairs of limits
        tolerance : float, optional
            largest relative difference between the two rules

        Returns
        -------
        Body
            the body

        Raises
        ------
        SceneError
            with the estimated error if the two rules differ by more, and for a nonpositive mass

        Examples
        --------
        >>> box = ("box", (-0.5, 0.5), (-1.0, 1.0), (-1.5, 1.5))
        >>> [round(moment, 12) for moment in rm.Body.from_density(2.0, box).moments]
        [13.0, 10.0, 5.0]
        """
        region = as_plain_arrays(in_si(region, "m", "body.region"), "body.region")
        density = in_si(density, "kg m-3", "body.density")
        coarse, fine = (moments_of_density(density, region, points) for points in (24, 40))
        mass, first, second = fine[0], fine[1:4], fine[4:].reshape(3, 3)
        if not mass > 0:
            rule = f"the mass is {mass:.3g}; it must be positive"
            raise SceneError(rule, at="body.density")
        # mass and second moments differ in units: their geometric mean measures first moments
        scale = np.array([mass, *[np.sqrt(mass * np.trace(second))] * 3, *[np.trace(second)] * 9])
        error = (np.abs(fine - coarse) / scale).max()
        if not error <= tolerance:
            rule = (
                f"the integral has not converged: the relative difference of two rules is"
                f" {error:.1e}, more than {tolerance:g}; split the region where the density jumps"
            )
            raise SceneError(rule, at="body.density")
        tensor, centre = np.trace(second) * np.eye(3) - second, first / mass
        parts = shape.shape_of_region(region)
        return cls._of_tensor(tensor, float(mass), as_tuples(centre), parts)
