"""What a scene conserves by its physics, and the effects whose work is booked."""

from collections.abc import Sequence

from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import labelled
from rigidmc.physics.effects.protocol import facts, is_conservative, is_random
from rigidmc.scene.parts import Parts


def conservation(scene: Parts) -> dict[str, str]:
    """{"energy", "energy_drift", "l2", "lz": "yes", or "no: ..." with the reason}.

    energy_drift : the energy less the booked work
    """
    effects = labelled(scene.effects)
    lossy = [label for label, e in effects if not is_conservative(e)]
    random = [label for label, e in effects if is_random(e)]
    energy, drift = _verdict(lossy, "the energy"), "yes"
    if random:
        walk = "the energy of a step of order 2 walks off as dt^2 sqrt(t)"
        drift = f"no: under {', '.join(random)} {walk}"
    l2 = [label for label, e in effects if not facts(e).keeps_l2]
    lz = [label for label, e in effects if not facts(e).keeps_lz]
    return {
        "energy": energy,
        "energy_drift": drift if "work" in scene.run.save else energy,
        "l2": _verdict(l2, "the angular momentum"),
        "lz": _verdict(lz, "L_z"),
    }


def booked_labels(scene: Parts) -> tuple[str, ...]:
    """The labels of the effects whose work is saved."""
    return tuple(label for label, _ in labelled(scene.effects)) if "work" in scene.run.save else ()


def booked(scene: Parts) -> list[str]:
    """The labels of the effects whose work is no part of `energy`."""
    return [label for label, e in labelled(scene.effects) if not implements(e, "energy")]


def _verdict(labels: Sequence[str], quantity: str) -> str:
    """ "yes", or "no" with the effects that change a quantity."""
    if not labels:
        return "yes"
    return f"no: {', '.join(labels)} change{'s' * (len(labels) == 1)} {quantity}"
