"""Energy lost inside the body, by two models of its moving parts."""

import math
from typing import Any, NamedTuple

from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import (
    add,
    axpy,
    cross,
    difference,
    dot,
    inverse,
    root,
    rotated,
    scale,
    select,
)
from rigidmc.physics.effects.protocol import Number, Vector, effect

_NONE = (0.0, 0.0, 0.0)
_FACTS: dict[str, Any] = {
    "units": {"loss": "1", "wheel": "kg m2 s-1", "motor": "N m"},
    "shapes": {"wheel": 3, "motor": 3},
    "limits": {"loss": (-math.inf, math.inf), "wheel": (0.0, 0.0), "motor": (0.0, 0.0)},
    "hidden": ("wheel", "motor"),
    "in_body": ("wheel", "motor"),
    "shared": {"wheel": ("rotor", "momentum"), "motor": ("rotor", "motor")},
    "example": (0.05,),
    "is_damping": True,
    "conserves_l2": True,
    "isotropic": True,
}


@effect(**_FACTS, kick_order=2)
class EnergyDissipation(NamedTuple):
    """Internal dissipation: energy falls, `|L|` stays, the spin ends about the major axis.

    Torque and power::

        tau = loss G x (G x omega)/|G|,   dE/dt = -loss |G x omega|^2/|G|

    G is the momentum of the whole: L, or L + H with a `Rotor` of momentum H. The direction of G in
    space wanders by about `loss` rad per turn, unlike in a real body with moving parts inside: use
    `InternalDissipation` where the attitude matters. The kick is a rule of order 2 that rotates G,
    so `|G|` is constant to rounding.

    A wobble about axis 3, with spin w and a wheel along that axis, changes as exp(-t/T)::

        1/T = (loss/2) (|G|/I_1 + |G|/I_2 - 2 w)

    Without a wheel it decays if I_3 is the largest moment; a symmetric body whose wobble has a
    quality factor Q has loss = 1/(2 Q). With a wheel it decays if `|G|/w` is larger than I_1 and
    I_2.
    Source: the double bracket of Bloch, Krishnaprasad, Marsden & Ratiu, Commun. Math. Phys. 175
    (1996) 1, section 4; Hughes, Spacecraft Attitude Dynamics (1986), 7, for gyrostats.

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
    >>> sloshing = rm.EnergyDissipation(loss=0.01)
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), sloshing)
    """

    loss: Number
    wheel: Vector = _NONE
    motor: Vector = _NONE

    def torque(self, body, t, l):
        g = add(l, axpy(self.wheel, t, self.motor))
        return scale(self.loss / _size(g), cross(g, cross(g, angular_velocity(body, l))))

    def kick(self, body, t, h, l):
        wheel = axpy(self.wheel, t, self.motor)
        g = add(l, wheel)
        by = -h * self.loss / _size(g)
        # A half step gives the rate in the middle, which makes the rule order 2.
        half = rotated(scale(0.5 * by, cross(g, angular_velocity(body, l))), g)
        slope = cross(half, angular_velocity(body, difference(half, wheel)))
        return difference(rotated(scale(by, slope), g), wheel)


@effect(**_FACTS, conserves_lz=True)
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
        return cross(g, _slip(self.loss, g, angular_velocity(body, l)))

    def slip(self, body, t, l):
        g = add(l, axpy(self.wheel, t, self.motor))
        return _slip(self.loss, g, angular_velocity(body, l))


def _size(v):
    """Return |v|, or 1 if v is 0: a quotient by it is then 0 in any unit."""
    square = dot(v, v)
    # 1 has no fixed unit, see above
    return root(select(square > 0.0, square, 1.0))


def _slip(loss, g, w):
    """Return Omega - omega [rad/s]; 0 for a body at rest."""
    return scale(loss * inverse(root(dot(g, g))), cross(g, w))
