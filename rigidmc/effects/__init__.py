"""What acts on a body. An effect is a NamedTuple whose fields are its parameters; a new one is one file and one line below.

    torque(self, [body, t, q, l])          body-frame torque [N m]
    energy(self, [body, q])                its potential energy [J], if it has one
    kick(self, [body, t, h, q, l])         L after its exact flow over h; needed by splittings where the torque depends on L
    torque_rate(self, [body, t, q, w])     rate of change of the torque while the body turns with w; needed by chin4
    shake(self, [body, h, l])              L after a time h of friction and noise, of random effects: `noise` holds three normal deviates

Facts: units, limits, shapes (of parameters), damps (whether negative parameters drive the body), stochastic, keeps_l2, keeps_lz (whether L_z is conserved under it),
isotropic (whether it singles out no axis of the body and no direction but the vertical).

Each names just the arguments that it depends on (see `rigidmc.dynamics.methods`).
"""

from typing import Any

from rigidmc.dynamics.methods import names
from rigidmc.effects.bath import Bath
from rigidmc.effects.damping import (
    AxialDamping,
    DryFriction,
    MatrixDamping,
    QuadraticDrag,
    ViscousDamping,
)
from rigidmc.effects.dissipation import EnergyDissipation
from rigidmc.effects.field import RotatingField, UniformField
from rigidmc.effects.gravity import Gravity
from rigidmc.effects.gravity_gradient import GravityGradient
from rigidmc.effects.parameters import given, shape
from rigidmc.effects.pivot import MovingPivot
from rigidmc.effects.potential import Potential
from rigidmc.effects.rotor import Rotor
from rigidmc.effects.spring import Spring
from rigidmc.effects.torques import BodyTorque, PeriodicTorque, SpaceTorque

# In canonical order: whatever order a scene lists its effects in, they are applied in this one.
EFFECTS: dict[str, Any] = {
    "gravity": Gravity,
    "gravity_gradient": GravityGradient,
    "spring": Spring,
    "uniform_field": UniformField,
    "rotating_field": RotatingField,
    "potential": Potential,
    "moving_pivot": MovingPivot,
    "body_torque": BodyTorque,
    "space_torque": SpaceTorque,
    "periodic_torque": PeriodicTorque,
    "rotor": Rotor,
    "viscous_damping": ViscousDamping,
    "axial_damping": AxialDamping,
    "matrix_damping": MatrixDamping,
    "quadratic_drag": QuadraticDrag,
    "dry_friction": DryFriction,
    "energy_dissipation": EnergyDissipation,
    "bath": Bath,
}


def name_of(effect):
    """The word for an effect in a scene file."""
    kind = effect if isinstance(effect, type) else type(effect)
    return next((name for name, known in EFFECTS.items() if known is kind), kind.__name__)


def description(kind):
    """(law, parameters with units, facts) of a class of effects, in words."""
    parameters = []
    for field in given(kind):
        words = [kind.units[field]] * (kind.units[field] != "1") + [
            f"{shape(kind, field)} numbers"
        ] * (shape(kind, field) is not None)
        parameters.append(field + (f" [{', '.join(words)}]" if words else ""))
    used = names(kind, "torque", "energy", "kick")
    facts = (
        ["needs the attitude"] * ("q" in used)
        + ["depends on time"] * ("t" in used)
        + ["depends on L"] * ("l" in used)
    )
    facts += ["is random"] * getattr(kind, "stochastic", False)
    facts += ["has an energy"] * hasattr(kind, "energy") + ["keeps L_z"] * getattr(
        kind, "keeps_lz", False
    )
    return kind.__doc__.splitlines()[0], ", ".join(parameters), ", ".join(facts) or "constant"


def labelled(effects):
    """[(label, effect)]: the word of its kind, with a number from the second of a kind on."""
    seen: dict[str, int] = {}
    found = []
    for effect in effects:
        name = name_of(effect)
        seen[name] = seen.get(name, 0) + 1
        found.append((name if seen[name] == 1 else f"{name}_{seen[name]}", effect))
    return found


def canonical(effects):
    """The effects in canonical order; those a user brings come last, as given."""
    order = list(EFFECTS.values())
    return tuple(
        sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order))
    )
