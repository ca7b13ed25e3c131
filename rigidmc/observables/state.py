"""What a top is doing: angular velocity, angular momentum, attitude."""

from typing import NamedTuple

from rigidmc.dynamics.euler import angular_velocity
from rigidmc.observables.protocol import observable


@observable(units="rad s-1", long_name="angular velocity, body axes", dims=("axis",))
class Omega(NamedTuple):
    """Angular velocity in the body's principal axes, omega_i = L_i/I_i."""

    def value(self, body, l):
        return angular_velocity(body, l)


@observable(units="kg m2 s-1", long_name="angular momentum, body axes", dims=("axis",))
class Momentum(NamedTuple):
    """Angular momentum in the body's principal axes."""

    def value(self, l):
        return l


@observable(units="1", long_name="attitude quaternion, body to space", dims=("quat",))
class Attitude(NamedTuple):
    """Unit quaternion (w, x, y, z), from body to space components; q and -q are one attitude."""

    def value(self, q):
        return q
