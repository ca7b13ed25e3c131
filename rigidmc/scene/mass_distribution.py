"""What a body is: mass, centre of mass, principal moments about the fixed point, and their axes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import SceneError
from rigidmc.mechanics import inertia, rotation
from rigidmc.mechanics.inertia import broken
from rigidmc.scene.laws import checked
from rigidmc.scene.laws.protocol import Law, numbers_of
from rigidmc.scene.quantities import Source, draw, is_open, is_shared, quantity, vector
from rigidmc.scene.shape import Shape

Array = NDArray[np.float64]
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class MassDistribution:
    """A rigid body that turns about a fixed point, the origin of the axes in which it is described.

    moments : principal moments (I1, I2, I3) about the fixed point [kg m^2]
    mass : [kg]
    centre : centre of mass from the fixed point, in the described axes [m]
    axes : 3x3, its columns are the principal axes in the described axes, right-handed; the identity
        unless the body was given by a tensor, by particles or by a shift
    shape : the solids that pictures draw; makers of bodies know them, no motion depends on them

    Components of moments, mass and centre are numbers, distributions, grids, or arrays with one row
    per member. Moments may also be a law: SecondMoments, whose bodies always exist, or Correlated,
    a measured inertia with its covariance.

    Raises SceneError for moments that are not positive or break the triangle inequality
    I_i <= I_j + I_k.
    """

    moments: Any
    mass: Any = 1.0
    centre: Any = (0.0, 0.0, 0.0)
    axes: tuple[tuple[float, ...], ...] = IDENTITY
    shape: Shape = ()

    def __post_init__(self) -> None:
        whole = isinstance(self.moments, Law)
        check = checked if whole else vector
        object.__setattr__(self, "moments", check(self.moments, "body", "moments"))
        object.__setattr__(self, "mass", quantity(self.mass, "body", "mass"))
        object.__setattr__(self, "centre", vector(self.centre, "body", "centre"))
        if self.axes != IDENTITY and not is_shared(self.centre):
            rule = "a body given by a tensor takes plain numbers; give principal moments instead"
            raise SceneError("body", "centre", None, rule)
        if not is_open(self.mass) and not np.min(self.mass) > 0:
            shown = self.mass if is_shared(self.mass) else None
            raise SceneError("body", "mass", shown, "the mass must be positive")
        if not whole:
            self._check_moments()

    def _check_moments(self) -> None:
        """SceneError for moments that no body can have; distributions are checked when drawn."""
        shown = list(self.moments) if is_shared(self.moments) else None
        known = [m for m in self.moments if not is_open(m)]
        if not all(np.min(m) > 0 for m in known):
            raise SceneError("body", "moments", shown, "principal moments must be positive")
        if len(known) < 3:
            return
        moments = np.array(np.broadcast_arrays(*self.moments)).reshape(3, -1)
        bad = np.flatnonzero(broken(moments))
        if bad.size:
            values = moments[:, bad[0]].tolist()
            large, rest = max(values), sum(values) - max(values)
            row = "" if is_shared(self.moments) else f"row {bad[0]}: "
            rule = (
                f"{row}the triangle inequality is broken: {large:g} exceeds the sum of the other"
                f" two, {rest:g}; no rigid body has these moments"
            )
            raise SceneError("body", "moments", shown, rule)

    def to_principal(self, vector: ArrayLike) -> Array:
        """Components in the principal axes, as in results, of vectors (..., 3) in the described
        axes."""
        components: Array = np.asarray(vector, dtype=float) @ np.array(self.axes)
        return components

    def to_own(self, vector: ArrayLike) -> Array:
        """Components in the described axes of vectors (..., 3) in principal axes, such as omega and
        momentum of a result."""
        components: Array = np.asarray(vector, dtype=float) @ np.array(self.axes).T
        return components

    def own_attitude(self, attitude: ArrayLike) -> Array:
        """Attitudes (..., 4) of the described axes from those of the principal axes, as in
        results."""
        inverse = rotation.quaternion(np.array(self.axes)) * np.array([1.0, -1.0, -1.0, -1.0])
        return rotation.product(rotation.quaternion(attitude), inverse)

    def principal_attitude(self, attitude: ArrayLike) -> Array:
        """Attitudes (..., 4) of the principal axes, as `Start` takes them, from those of the
        described axes."""
        axes = rotation.quaternion(np.array(self.axes))
        return rotation.product(rotation.quaternion(attitude), axes)

    def angular_momentum(self, omega: ArrayLike) -> Array:
        """L = I omega (..., 3), TdC (3.25), both in the described axes."""
        return inertia.angular_momentum(self.tensor, omega)

    def kinetic_energy(self, omega: ArrayLike) -> Array:
        """T = 1/2 omega I omega (...), TdC (3.16), with omega (..., 3) in the described axes."""
        return inertia.kinetic_energy(self.tensor, omega)

    @property
    def tensor(self) -> Array:
        """Inertia tensor (3, 3) about the fixed point in the described axes [kg m^2]; ValueError
        unless the moments are plain numbers."""
        if not is_shared(self.moments):
            raise ValueError("a body that differs from member to member has no single tensor")
        axes = np.array(self.axes)
        tensor: Array = (axes * np.array(self.moments)) @ axes.T
        return tensor

    def quantities(self) -> tuple[Any, ...]:
        """All quantities of the body, in one flat tuple."""
        moments = self.moments
        if isinstance(moments, Law):
            moments = (moments, *numbers_of(moments))
        return (*moments, self.mass, *self.centre)

    def sample(self, source: Source, first: int, count: int) -> tuple[Array, Array, Array]:
        """Moments (3, count), mass (count,) and centre of mass in principal axes (3, count) of
        members first ... first + count - 1."""
        if isinstance(self.moments, Law):
            moments = self.moments.sample(source, "body.moments", first, count, None)
        else:
            moments = draw(self.moments, source, "body.moments", first, count)
        mass = draw((self.mass,), source, "body.mass", first, count)[0]
        centre = draw(self.centre, source, "body.centre", first, count)
        if self.axes != IDENTITY:
            # written out: a BLAS product may round differently with the number of members
            centre = np.stack(
                [sum(self.axes[j][i] * centre[j] for j in range(3)) for i in range(3)]
            )
        return moments, mass, centre
