"""Effects on a body: gravity, springs, damping, ...

A new effect is one file in this folder and one line below. `rigidmc.physics.effects.protocol`
defines the methods and facts of an effect; docs/contributing.md has an example.
"""

# One line for each effect, in canonical order: effects act in this order, however a scene lists
# them. An effect's word in scene files is the name of its class in snake_case.
# isort: off
from rigidmc.physics.effects.gravity import Gravity as Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient as GravityGradient
from rigidmc.physics.effects.spring import Spring as Spring
from rigidmc.physics.effects.field import UniformField as UniformField
from rigidmc.physics.effects.field import RotatingField as RotatingField
from rigidmc.physics.effects.potential import Potential as Potential
from rigidmc.physics.effects.pivot import MovingPivot as MovingPivot
from rigidmc.physics.effects.torques import BodyTorque as BodyTorque
from rigidmc.physics.effects.torques import SpaceTorque as SpaceTorque
from rigidmc.physics.effects.torques import PeriodicTorque as PeriodicTorque
from rigidmc.physics.effects.rotor import Rotor as Rotor
from rigidmc.physics.effects.reaction_wheel import ReactionWheel as ReactionWheel
from rigidmc.physics.effects.damping import ViscousDamping as ViscousDamping
from rigidmc.physics.effects.damping import AxialDamping as AxialDamping
from rigidmc.physics.effects.damping import MatrixDamping as MatrixDamping
from rigidmc.physics.effects.damping import QuadraticDrag as QuadraticDrag
from rigidmc.physics.effects.damping import DryFriction as DryFriction
from rigidmc.physics.effects.dissipation import EnergyDissipation as EnergyDissipation
from rigidmc.physics.effects.dissipation import InternalDissipation as InternalDissipation
from rigidmc.physics.effects.bath import Bath as Bath
# isort: on

from collections.abc import Iterable
from typing import Any

from rigidmc.physics.dynamics.methods import argument_names, implements, number_words, word_of
from rigidmc.physics.effects.protocol import Effect, facts, shape, user_parameters

_KINDS = [cls for cls in globals().values() if hasattr(cls, "_fields")]  # the lines above
EFFECTS: dict[str, Any] = {word_of(cls): cls for cls in _KINDS}


def name_of(effect: Effect | type[Effect]) -> str:
    """Return the word for an effect or its class in a scene file; for a custom class, its name."""
    cls = effect if isinstance(effect, type) else type(effect)
    return next((name for name, known in EFFECTS.items() if known is cls), cls.__name__)


def description(cls: type[Effect]) -> tuple[str, str, str]:
    """Return (law, parameters with units, facts) of a class of effects, in words."""
    parameters = []
    for field in user_parameters(cls):
        unit, size = facts(cls).units[field], shape(cls, field)
        words = [unit] * (unit != "1") + [f"{size} numbers"] * (size is not None)
        parameters.append(field + (f" [{', '.join(words)}]" if words else ""))
    used = argument_names(cls, "torque", "energy", "kick")
    said = {
        "needs the attitude": "q" in used,
        # a shared parameter may depend on time: the momentum of a wheel with a motor
        "depends on time": "t" in used and not facts(cls).shared,
        "depends on L": "l" in used,
        "is random": facts(cls).is_random,
        "has an energy": implements(cls, "energy"),
        "conserves L_z": facts(cls).conserves_lz,
    }
    law = (cls.__doc__ or "").splitlines()[0]
    return law, ", ".join(parameters), ", ".join(k for k, v in said.items() if v) or "constant"


def label_effects(effects: Iterable[Any]) -> list[tuple[str, Any]]:
    """Return [(label, effect)]: words, numbered from the second effect of a class on."""
    known = tuple(effects)
    return list(zip(number_words(map(name_of, known)), known, strict=True))


def shared_parameters(effects: Iterable[Any]) -> dict[str, list[str]]:
    """Return {parameter: the parameters it is the sum of}, each as label_field.

    It lists each parameter that an effect shares with another kind of effect in the scene.
    """
    known = label_effects(effects)
    found = {}
    for label, effect in known:
        for field, (cls, other) in facts(effect).shared.items():
            if sources := [f"{where}_{other}" for where, one in known if name_of(one) == cls]:
                found[f"{label}_{field}"] = sources
    return found


def canonical(effects: Iterable[Any]) -> tuple[Any, ...]:
    """Return the effects in canonical order; custom effects come last, as given."""
    # Flows do not commute: a fixed order makes a result independent of the order in the scene.
    order = list(EFFECTS.values())
    return tuple(
        sorted(effects, key=lambda e: order.index(type(e)) if type(e) in order else len(order))
    )
