"""What acts on a body. An effect is a NamedTuple whose fields are its parameters; a new one is one file and one line below.

    torque(self, [body, t, q, l])          body-frame torque [N m]
    energy(self, [body, q])                its potential energy [J], if it has one
    kick(self, [body, t, h, q, l])         L after its exact flow over h; needed by splittings where the torque depends on L
    torque_rate(self, [body, t, q, w])     rate of change of the torque while the body turns with w; needed by chin4

Facts: units, limits (of parameters), keeps_lz (whether L_z is conserved under it),
isotropic (whether it singles out no axis of the body and no direction but the vertical).

Each names just the arguments that it depends on (see `rigidmc.dynamics.methods`).
"""

from typing import Any

from rigidmc.effects.damping import ViscousDamping
from rigidmc.effects.gravity import Gravity

# In canonical order: whatever order a scene lists its effects in, they are applied in this one.
EFFECTS: dict[str, Any] = {"gravity": Gravity, "viscous_damping": ViscousDamping}


def name_of(effect):
    """The word for an effect in a scene file."""
    kind = effect if isinstance(effect, type) else type(effect)
    return next((name for name, known in EFFECTS.items() if known is kind), kind.__name__)


def canonical(effects):
    """The effects in canonical order; those a user brings come last, as given."""
    order = list(EFFECTS.values())
    return tuple(sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order)))
