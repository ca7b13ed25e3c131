"""Bodies made from bodies: with another fixed point, joined, or subtracted.

A base of `rigidmc.scene.body.Body`.
"""

from dataclasses import replace
from typing import Any, Self

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.mechanics import inertia, rotation
from rigidmc.scene import shape
from rigidmc.scene.body_makers import BodyMakers
from rigidmc.scene.body_numbers import BodyNumbers
from rigidmc.scene.inertia_about import check_mass_given
from rigidmc.scene.quantities import is_shared, is_variable, vector
from rigidmc.scene.stated import NO_RATE, Stated
from rigidmc.scene.units import in_si
from rigidmc.scene.vector_distributions.bodies import UncertainInertia
from rigidmc.scene.vector_distributions.tensors import TensorRows


class BodyChanges(BodyMakers):
    """Methods of Body that return a new Body and leave `self` unchanged."""

    def with_pivot(self, point: Any) -> Self:
        """Move the fixed point to another point of the body, by the parallel-axis theorem.

        TdC (3.26), (3.27), with d from the centre of mass to the fixed point::

            I = I_centre + M (d^2 delta_ij - d_i d_j)

        Parameters
        ----------
        point : array_like (3,) [m]
            the new fixed point, in the described axes

        Returns
        -------
        Body
            the same body rotating about the new point

        Raises
        ------
        SceneError
            for a body that differs between members or has no given mass

        Examples
        --------
        >>> rod = rm.Body.cylinder(mass=12.0, radius=1.0, height=3.0)
        >>> rod.with_pivot((0.0, 0.0, -1.5)).moments
        (39.0, 39.0, 6.0)
        """
        if isinstance(point, str):
            raise SceneError(
                'expected three numbers, or "centre"',
                at="body.pivot",
                value=point,
                nearest="centre",
            )
        return self._moved(vector(in_si(point, "m", "body.pivot"), "body.pivot"))

    def _moved(self, point: Any, is_centre: bool = False) -> Self:
        """Implement `with_pivot`; is_centre : whether the point follows the centre of mass."""
        if not is_shared(self.moments, self.mass, self.centre, point):
            rule = (
                "only a body given by plain numbers can move its fixed point; give moments about"
                " the new point instead"
            )
            raise SceneError(rule, at="body.pivot")
        new = np.array(self.centre) - np.array(point)
        check_mass_given(self.has_mass, self.centre, tuple(new.tolist()))
        bare = inertia.about_centre(self.tensor, self.mass, self.centre)
        tensor = inertia.about_point(bare, self.mass, new)
        parts = tuple(part.placed(-np.array(point)) for part in self.shape)
        stated = self.stated
        if isinstance(stated, Stated):
            pivot = "centre" if is_centre else point
            stated = stated._replace(pivot=pivot) if stated.pivot is None else None
        if isinstance(stated, Stated) and stated.is_free:
            free: Self = stated.make(type(self), self.frame, parts)
            return free
        return self._of_tensor(tensor, self.mass, tuple(new.tolist()), parts, self.frame, stated)

    def with_pivot_at_centre(self) -> Self:
        """Move the fixed point to the centre of mass, TdC (3.28), as for a satellite.

        Returns
        -------
        Body
            the same body rotating about its centre of mass; with an uncertain tensor, each drawn
            body rotates about its own

        Raises
        ------
        SceneError
            for a body with other distributions or arrays, or without a given mass

        Examples
        --------
        >>> rod = rm.Body.cylinder(mass=12.0, radius=1.0, height=3.0)
        >>> rod.with_pivot((0.0, 0.0, -1.5)).with_pivot_at_centre().moments
        (12.0, 12.0, 6.0)
        """
        if isinstance(self.moments, UncertainInertia):
            distribution = self.moments
            check_mass_given(self.has_mass, self.centre, distribution.centre or 0.0)
            distribution = (
                distribution
                if distribution.centre is not None
                else replace(distribution, centre=self.centre)
            )
            return type(self)(distribution, self.mass, shape=self.shape, frame=self.frame)
        if isinstance(self.moments, TensorRows) and not is_variable(self.mass, self.centre):
            check_mass_given(self.has_mass, self.centre)
            about = self.moments.with_centre(self.mass, self.centre)
            of = type(self)
            return of(about, self.mass, shape=self.shape, frame=self.frame, stated=NO_RATE)
        return self._moved(self.centre, is_centre=True)

    def join(
        self, other: Self, at: Any = (0.0, 0.0, 0.0), turned: Any = (1.0, 0.0, 0.0, 0.0)
    ) -> Self:
        """Join this body and another to one body, about the fixed point of this body.

        Where the bodies overlap, both masses count.

        Parameters
        ----------
        other : Body
            the body to add
        at : array_like (3,), optional [m]
            origin of the other body in the described axes of this body
        turned : array_like (4,), (3, 3) or scipy Rotation, optional
            attitude of the other body's described axes relative to this body's

        Returns
        -------
        Body
            the joined body

        Raises
        ------
        SceneError
            for bodies that differ between members or have no given mass

        Examples
        --------
        >>> box = rm.Body.box(mass=12.0, size=(1.0, 2.0, 3.0))
        >>> two = box.join(box, at=(0.0, 0.0, 3.0))
        >>> two.mass, two.centre
        (24.0, (0.0, 0.0, 1.5))
        """
        return self._with(other, at, turned, 1.0)

    def subtract(
        self, other: Self, at: Any = (0.0, 0.0, 0.0), turned: Any = (1.0, 0.0, 0.0, 0.0)
    ) -> Self:
        """Subtract from this body another body that lies within it, placed as in `join`.

        Parameters
        ----------
        other : Body
            the body to subtract
        at : array_like (3,), optional [m]
            origin of the other body in the described axes of this body
        turned : array_like (4,), (3, 3) or scipy Rotation, optional
            attitude of the other body's described axes relative to this body's

        Returns
        -------
        Body
            the remainder

        Raises
        ------
        SceneError
            if the remainder is impossible, and for bodies that differ between members or have no
            given mass

        Examples
        --------
        >>> whole = rm.Body.cylinder(mass=4.0, radius=2.0, height=1.0)
        >>> tube = whole.subtract(rm.Body.cylinder(mass=1.0, radius=1.0, height=1.0))
        >>> tube.mass, tube.moments[2]
        (3.0, 7.5)
        """
        return self._with(other, at, turned, -1.0)

    def _with(self, other: Self, at: Any, turned: Any, sign: float) -> Self:
        for body in (self, other):
            if not isinstance(body, BodyNumbers) or not is_shared(
                body.moments, body.mass, body.centre
            ):
                rule = "only bodies given by plain numbers can be joined"
                raise SceneError(rule, at="body.join")
            if not body.has_mass:
                raise SceneError("only bodies with a given mass can be joined", at="body.mass")
        place = vector(in_si(at, "m", "body.at"), "body.at")
        if not is_shared(place):
            raise SceneError("expected plain numbers", at="body.at")
        a, origin = rotation.matrix(turned), np.array(place)
        centre = a @ np.array(other.centre)
        bare = inertia.about_centre(a @ other.tensor @ a.T, other.mass, centre)
        tensor = self.tensor + sign * inertia.about_point(bare, other.mass, origin + centre)
        mass = self.mass + sign * other.mass
        if not mass > 0:
            rule = "nothing remains: the subtracted body is not lighter than the whole"
            raise SceneError(rule, at="body.mass", value=mass)
        middle = (self.mass * np.array(self.centre) + sign * other.mass * (origin + centre)) / mass
        # the remainder must also be possible about its own centre of mass
        inertia.principal_axes(inertia.about_centre(tensor, mass, middle))
        parts = (part.placed(place, turned) for part in other.shape)
        solids = shape.join_shapes(self.shape, parts, sign < 0.0)
        return self._of_tensor(tensor, mass, tuple(middle.tolist()), solids, self.frame)
