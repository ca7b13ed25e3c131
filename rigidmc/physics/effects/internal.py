"""Energy lost by moving parts inside the body, at constant total momentum."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import add, axpy, cross, dot, inverse, root, scale
from rigidmc.physics.effects.protocol import Number, Vector, effect

_NONE = (0.0, 0.0, 0.0)


@effect(
    units={"loss": "1", "wheel": "kg m2 s-1", "motor": "N m"},
    shapes={"wheel": 3, "motor": 3},
    limits={"loss": (-math.inf, math.inf), "wheel": (0.0, 0.0), "motor": (0.0, 0.0)},
    hidden=("wheel", "motor"),
    in_body=("wheel", "motor"),
    shared={"wheel": ("rotor", "momentum"), "motor": ("rotor", "motor")},
    example=(0.05,),
    is_damping=True,
    conserves_l2=True,
    conserves_lz=True,
    isotropic=True,
)
class InternalDissipation(NamedTuple):
    """Internal dissipation that conserves the momentum in space, direction included.

    L moves in the body as under `EnergyDissipation`, and the body turns so that L stays in space::

        dL/dt = L x Omega,   dA/dt = A hat(Omega),   Omega = omega + loss G x omega/|G|

    with omega = I^-1 L and G = L, or L + H with a `Rotor` of momentum H. L is the momentum of the
    body and of its moving parts. Relative to the body these parts have the momentum
    `-loss I (G x omega)/|G|`, so the body does not turn with I^-1 L. `omega` in results is I^-1 L;
    Omega differs from it by at most `loss` of its size. The energy 1/2 L . I^-1 L falls::

        dE/dt = -loss |G x omega|^2/|G|

    and a wobble changes as under `EnergyDissipation`. Requires the integrator rk8 or cf4.
    Source: the energy sink of Hughes, Spacecraft Attitude Dynamics (1986), 7, by the double bracket
    of Bloch, Krishnaprasad, Marsden & Ratiu, Commun. Math. Phys. 175 (1996) 1, section 4;
    theory/gyrostat of the documentation derives the rate.

    Parameters
    ----------
    loss : quantity
        speed at which G drifts to the major axis, as a fraction of its free rate
    wheel : quantities (3,) [kg m^2/s]
        momentum of the rotors of the scene at t = 0; the engine fills it in
    motor : quantities (3,) [N m]
        torque of their motors; the engine fills it in

    Examples
    --------
    >>> sloshing = rm.InternalDissipation(loss=0.01)
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), sloshing)
    """

    loss: Number
    wheel: Vector = _NONE
    motor: Vector = _NONE

    def torque(self, body, t, l):
        g = add(l, axpy(self.wheel, t, self.motor))
        return cross(g, _more(self.loss, g, angular_velocity(body, l)))

    def slip(self, body, t, l):
        g = add(l, axpy(self.wheel, t, self.motor))
        return _more(self.loss, g, angular_velocity(body, l))


def _more(loss, g, w):
    """Return Omega - omega [rad/s]; 0 for a body at rest."""
    return scale(loss * inverse(root(dot(g, g))), cross(g, w))
