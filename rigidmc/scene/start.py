"""How tops start: angular velocity or momentum, and attitude."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigidmc.errors import SceneError, unknown
from rigidmc.mechanics.rotation import quaternion_from_euler, quaternion_from_matrix
from rigidmc.scene.laws import checked, kept, numbers_of, turns
from rigidmc.scene.quantities import draw, is_open, is_shared, numbers, rows, vector


@dataclass(frozen=True, eq=False)
class Start:
    """How the tops start: each component a number, a distribution, or an array with one row per member.

    omega : angular velocity in the body's principal axes [rad/s], or
    momentum : angular momentum in the body's principal axes [kg m^2/s]; either also as a whole, see `rigidmc.scene.laws`
    attitude : quaternion (w, x, y, z), normalised here; 3x3 matrix; Euler angles z-x-z (phi, theta, psi) [rad], TdC (3.36);
        a scipy Rotation; "uniform" on SO(3); Fisher, Pointing of `rigidmc.scene.laws`; or "ensemble", by the law of the momentum: with
        GibbsMomentum exp(-V/kT), with Shell sqrt(E - V), which together are the canonical and the microcanonical ensemble.
        Default: body axes along space axes.

    Raises SceneError for a wrong shape, a non-finite number, a quaternion of norm 0, a matrix that is no rotation, or both or
    neither of omega and momentum.
    """

    omega: tuple | None = None
    momentum: tuple | None = None
    attitude: Any = field(default=(1.0, 0.0, 0.0, 0.0))

    def __post_init__(self):
        if (self.omega is None) == (self.momentum is None):
            raise SceneError("start", "omega", None, "give either omega or momentum, one of them")
        which = "omega" if self.momentum is None else "momentum"
        given = getattr(self, which)
        whole = hasattr(given, "_fields")
        object.__setattr__(
            self, which, checked(given, "start", which) if whole else vector(given, "start", which)
        )
        whole = hasattr(self.attitude, "_fields")
        object.__setattr__(
            self,
            "attitude",
            checked(self.attitude, "start", "attitude") if whole else _attitude(self.attitude),
        )
        if self.attitude == "ensemble" and (
            not hasattr(given, "share") or getattr(given, "direction", None) is not None
        ):
            rule = "is the law of the momentum: give momentum = { gibbs = kT }, or { shell = { energy = E } } without a direction"
            raise SceneError("start", "attitude", self.attitude, rule)

    def quantities(self):
        """All quantities of the start, in one flat tuple."""
        spin: Any = self.omega if self.momentum is None else self.momentum
        spin = (spin, *numbers_of(spin)) if hasattr(spin, "_fields") else spin
        attitude = (
            (self.attitude, *numbers_of(self.attitude))
            if hasattr(self.attitude, "_fields")
            else self.attitude
        )
        return (*spin, *(() if isinstance(attitude, str) else attitude))

    def spin(self, seed, first, count, facts):
        """("omega" or "momentum", its values (3, count)); facts : `rigidmc.scene.laws.Facts` of the members."""
        which = "omega" if self.momentum is None else "momentum"
        given = getattr(self, which)
        if hasattr(given, "_fields"):
            return which, given.sample(seed, f"start.{which}", first, count, facts)
        return which, draw(given, seed, f"start.{which}", first, count)

    def quaternions(self, seed, first, count, facts=None):
        """Unit quaternions (4, count); facts : as of `spin`."""
        if self.attitude == "ensemble":
            law: Any = self.momentum
            return kept(law.share(seed, first, count, facts), seed, first, count)
        if self.attitude == "uniform":
            return turns(*numbers(seed, "start.attitude", first, count, used=(0, 1, 2))[:3])
        if hasattr(self.attitude, "_fields"):
            return self.attitude.sample(seed, "start.attitude", first, count, None)
        values = draw(self.attitude, seed, "start.attitude", first, count)
        if len(values) == 3:
            return quaternion_from_euler(*values)
        square = values[0] ** 2 + values[1] ** 2 + values[2] ** 2 + values[3] ** 2
        # one that is normalised stays to the bit, so that stored starts run again to the same bits
        return np.where(np.abs(square - 1.0) < 1e-15, values, values / np.sqrt(square))


def _attitude(value):
    if isinstance(value, str):
        if value not in ("uniform", "ensemble"):
            raise unknown("start", "attitude", value, "attitude", ["uniform", "ensemble"])
        return value
    if hasattr(value, "as_quat"):
        value = np.asarray(value.as_quat(scalar_first=True))
        value = value if value.ndim == 2 else tuple(value.tolist())
    if not hasattr(value, "__len__") or isinstance(value, dict):
        rule = 'expected "uniform", "ensemble", a quaternion (w, x, y, z), Euler angles (phi, theta, psi), or a 3x3 matrix'
        raise SceneError("start", "attitude", value, rule)
    shape = _shape(value)
    if shape in ((3, 3), (len(value), 3, 3)):
        q = quaternion_from_matrix(np.asarray(value, dtype=float), "start", "attitude")
        value = tuple(q.tolist()) if q.ndim == 1 else q
    size = (
        3
        if (shape[1] if isinstance(value, np.ndarray) and len(shape) == 2 else len(value)) == 3
        else 4
    )
    parts = vector(value, "start", "attitude", size)
    if size == 4 and rows(*parts) is not None and is_open(parts):
        raise SceneError(
            "start",
            "attitude",
            None,
            "a quaternion has distributions or arrays as components, not both",
        )
    if size == 4 and not is_open(parts):
        square = sum(p * p for p in parts)
        if np.min(square) < 1e-200:
            raise SceneError(
                "start",
                "attitude",
                value if is_shared(parts) else None,
                "a quaternion of norm 0 is no attitude",
            )
    return parts


def _shape(value):
    try:
        return np.shape(value)
    except ValueError:
        return (len(value),)
