"""The body: mass, centre of mass, principal moments about the fixed point and the axes they belong to."""

from dataclasses import dataclass

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.sampling import Distribution, draw, is_shared, quantity, vector

_SLACK = 1e-12  # a flat plate obeys I3 = I1 + I2 only to rounding
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body that turns about a fixed point, the origin of the body's own axes.

    moments : principal moments (I1, I2, I3) about the fixed point [kg m^2]
    mass : [kg]
    centre : centre of mass from the fixed point, in the body's own axes [m]
    axes : 3x3, its columns are the principal axes in the body's own axes, right-handed; the identity unless the body was given by
        a tensor, by particles or by a shift

    Components of moments, mass and centre are numbers, distributions, or arrays with one row per member.
    Raises SceneError for moments that are not positive or break the triangle inequality I_i <= I_j + I_k.
    """

    moments: tuple
    mass: float | Distribution | np.ndarray = 1.0
    centre: tuple = (0.0, 0.0, 0.0)
    axes: tuple = IDENTITY

    def __post_init__(self):
        object.__setattr__(self, "moments", vector(self.moments, "body", "moments"))
        object.__setattr__(self, "mass", quantity(self.mass, "body", "mass"))
        object.__setattr__(self, "centre", vector(self.centre, "body", "centre"))
        if self.axes != IDENTITY and not is_shared(*self.centre):
            raise SceneError("body", "centre", None, "a body given by a tensor takes plain numbers; give principal moments instead")
        fixed = [m for m in self.moments if not isinstance(m, Distribution)]
        if not all(np.min(m) > 0 for m in fixed):
            raise SceneError("body", "moments", self._given(), "principal moments must be positive")
        if not isinstance(self.mass, Distribution) and not np.min(self.mass) > 0:
            raise SceneError("body", "mass", self.mass if is_shared(self.mass) else None, "the mass must be positive")
        if len(fixed) == 3:
            bad = np.flatnonzero(broken(np.broadcast_arrays(*self.moments)))
            if bad.size:
                values = [
                    float(np.broadcast_to(m, (bad[0] + 1,))[bad[0]]) if np.ndim(m) == 0 else float(m[bad[0]]) for m in self.moments
                ]
                large, rest = max(values), sum(values) - max(values)
                row = "" if is_shared(*self.moments) else f"row {bad[0]}: "
                rule = f"{row}the triangle inequality is broken: {large:g} exceeds the sum of the other two, {rest:g}; no rigid body has these"
                raise SceneError("body", "moments", self._given(), rule)

    def _given(self):
        return list(self.moments) if is_shared(*self.moments) else None

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
        if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
            raise SceneError("body", "tensor", tensor.tolist(), "expected 3x3 finite numbers")
        size = np.abs(tensor).max()
        if np.abs(tensor - tensor.T).max() > 1e-9 * size:
            raise SceneError("body", "tensor", tensor.tolist(), "an inertia tensor is symmetric")
        moments, axes = principal(0.5 * (tensor + tensor.T))
        return cls(tuple(moments.tolist()), mass, centre, tuple(map(tuple, axes.tolist())))

    @classmethod
    def from_particles(cls, masses, positions):
        """From N point particles: I_ij = sum m (r^2 delta_ij - x_i x_j), TdC (3.15). masses (N,) [kg], positions (N, 3) [m]."""
        masses, positions = np.asarray(masses, dtype=float), np.asarray(positions, dtype=float)
        if masses.ndim != 1 or positions.shape != (masses.size, 3):
            raise SceneError(
                "body", "particles", None, f"{masses.size} masses need positions of shape ({masses.size}, 3), not {positions.shape}"
            )
        if not (np.isfinite(masses).all() and np.isfinite(positions).all() and (masses >= 0).all() and masses.sum() > 0):
            raise SceneError(
                "body", "particles", None, "masses and positions must be finite, masses not negative, and some mass positive"
            )
        mass = float(masses.sum())
        tensor = np.einsum("n,nij->ij", masses, _shift(positions))
        return cls.from_tensor(tensor, mass, tuple((masses @ positions / mass).tolist()))

    @classmethod
    def cylinder(cls, mass, radius, height):
        """Solid cylinder about its centre, axis 3 along it: M/12 diag(3a^2 + h^2, 3a^2 + h^2, 6a^2), TdC Example 3.1."""
        mass, radius, height = (_positive(v, k) for v, k in ((mass, "mass"), (radius, "radius"), (height, "height")))
        side = mass / 12 * (3 * radius**2 + height**2)
        return cls((side, side, mass * radius**2 / 2), mass)

    @classmethod
    def box(cls, mass, size):
        """Solid box with edges (x, y, z) about its centre: M/12 diag(y^2 + z^2, z^2 + x^2, x^2 + y^2)."""
        mass, (x, y, z) = _positive(mass, "mass"), (_positive(v, "size") for v in vector(size, "body", "size"))
        return cls((mass / 12 * (y * y + z * z), mass / 12 * (z * z + x * x), mass / 12 * (x * x + y * y)), mass)

    def pivoted_at(self, point):
        """The same body turning about another of its points (own axes [m]), by the parallel axes theorem, TdC (3.26), (3.27)."""
        point = vector(point, "body", "pivot")
        if not is_shared(*self.moments, self.mass, *self.centre, *point):
            raise SceneError(
                "body", "pivot", None, "only a body given by plain numbers can be moved; give moments about the new point instead"
            )
        old, new = np.array(self.centre), np.array(self.centre) - np.array(point)
        tensor = self.tensor + self.mass * (_shift(new) - _shift(old))
        return Body.from_tensor(tensor, self.mass, tuple(new.tolist()))

    @property
    def tensor(self):
        """Inertia tensor (3, 3) about the fixed point in the body's own axes [kg m^2]; only for plain numbers."""
        if not is_shared(*self.moments):
            raise ValueError("a body that differs from member to member has no single tensor")
        axes = np.array(self.axes)
        return (axes * np.array(self.moments)) @ axes.T

    def quantities(self):
        """All quantities of the body, in one flat tuple."""
        return (*self.moments, self.mass, *self.centre)

    def sample(self, seed, first, count):
        """(moments (3, count), mass (count), centre of mass in principal axes (3, count)) of some members."""
        moments = draw(self.moments, seed, "body.moments", first, count)
        mass = draw((self.mass,), seed, "body.mass", first, count)[0]
        centre = draw(self.centre, seed, "body.centre", first, count)
        if self.axes != IDENTITY:
            # written out: a BLAS product may round differently with the number of members
            centre = np.stack([sum(self.axes[j][i] * centre[j] for j in range(3)) for i in range(3)])
        return moments, mass, centre


def broken(moments):
    """Which bodies cannot be: a moment is not positive, or exceeds the sum of the other two. moments (3, ...) -> bool (...)."""
    one, two, three = moments
    total = (one + two + three) * (1 + _SLACK)
    return ~((np.minimum(np.minimum(one, two), three) > 0) & (2 * np.maximum(np.maximum(one, two), three) <= total))


def principal(tensor):
    """(moments (3,), axes (3, 3) as columns, right-handed) of a symmetric tensor; see Body.from_tensor for the choice."""
    off = np.abs(tensor[[0, 0, 1], [1, 2, 2]]).max()
    if off <= 1e-15 * np.abs(tensor).max():
        return np.diag(tensor).copy(), np.eye(3)
    moments, axes = np.linalg.eigh(tensor)
    for i in (0, 1):
        axes[:, i] *= np.sign(axes[np.abs(axes[:, i]).argmax(), i])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def _shift(r):
    """r^2 1 - r r^T for vectors (..., 3)."""
    return np.einsum("...i,...i", r, r)[..., None, None] * np.eye(3) - r[..., :, None] * r[..., None, :]


def _positive(value, key):
    value = quantity(value, "body", key)
    if not is_shared(value):
        raise SceneError("body", key, None, "shapes take plain numbers; for bodies that differ give moments instead")
    if not value > 0:
        raise SceneError("body", key, value, "must be positive")
    return value
