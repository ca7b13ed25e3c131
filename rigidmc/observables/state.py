"""What a top is doing: angular velocity, angular momentum, attitude."""

from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.observables.protocol import observable


@observable
class Omega(NamedTuple):
    """Angular velocity in the body's principal axes, omega_i = L_i/I_i."""

    units, long_name, dims = "rad s-1", "angular velocity, body axes", ("axis",)

    def value(self, body, l):
        return angular_velocity(body, l)


@observable
class Momentum(NamedTuple):
    """Angular momentum in the body's principal axes."""

    units, long_name, dims = "kg m2 s-1", "angular momentum, body axes", ("axis",)

    def value(self, l):
        return l


@observable
class Attitude(NamedTuple):
    """Unit quaternion (w, x, y, z), from body to space components; q and -q are one attitude."""

    units, long_name, dims = "1", "attitude quaternion, body to space", ("quat",)

    def value(self, q):
        return q
