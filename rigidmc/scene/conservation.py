"""What a scene conserves by its physics, and of which effects the work is booked."""

from rigidmc.dynamics.methods import implements
from rigidmc.effects import labelled
from rigidmc.effects.protocol import facts, is_conservative, is_random


def conservation(scene):
    """{"energy": "yes" or the reason why not, "energy_drift": the same of energy less work, "l2": ..., "lz": ...} by the physics of the scene."""
    noisy = [label for label, e in labelled(scene.effects) if is_random(e)]
    walk = (
        f"no: under {', '.join(noisy)} the energy of a step of order 2 walks off as dt^2 sqrt(t)"
        if noisy
        else ""
    )
    lossy = [label for label, e in labelled(scene.effects) if not is_conservative(e)]
    kept = "yes" if not lossy else f"no: {_change(lossy, 'the energy')}"
    torques = [label for label, e in labelled(scene.effects) if not facts(e).keeps_l2]
    turning = [label for label, e in labelled(scene.effects) if not facts(e).keeps_lz]
    changed = {"l2": (torques, "the angular momentum"), "lz": (turning, "L_z")}
    return {
        "energy": kept,
        "energy_drift": kept if "work" not in scene.run.save else walk or "yes",
        **{
            k: "yes" if not who else f"no: {_change(who, what)}"
            for k, (who, what) in changed.items()
        },
    }


def booked_labels(scene):
    """The labels of the effects whose works are saved."""
    return tuple(label for label, _ in labelled(scene.effects)) if "work" in scene.run.save else ()


def booked(scene):
    """The labels of the effects whose work is no part of `energy`."""
    return [label for label, e in labelled(scene.effects) if not implements(e, "energy")]


def _change(who, what):
    return f"{', '.join(who)} change{'s' * (len(who) == 1)} {what}"
