"""Settle everything about a run before its first step."""

from typing import NamedTuple

from rigidmc.planning.notes import notes
from rigidmc.planning.plan import Plan, prepare
from rigidmc.planning.tolerance.choose import Chosen, resolved
from rigidmc.planning.units import Internal, internal, scaled
from rigidmc.scene.once import once
from rigidmc.scene.scene import Scene


class Settled(NamedTuple):
    """A run that is ready for its first step.

    scene : the scene in the units in which it is integrated, with integrator and step chosen
    plan : its Plan
    units : how the scene was rescaled; None if nothing was rescaled
    chosen : what a tolerance chose; None if the scene names its integrator
    notes : what the user of the scene should know, see `rigidmc.planning.notes`
    """

    scene: Scene
    plan: Plan
    units: Internal | None
    chosen: Chosen | None
    notes: tuple[str, ...]


@once
def settled(
    scene: Scene, threads: int = 1, streaming: bool = False, block: int | None = None
) -> Settled:
    """Rescale a scene if numbers could overflow, choose integrator and step if it asks for a
    tolerance, and make its Plan; SceneError."""
    original, units = scene, internal(scene)
    if units is not None:
        scene = scaled(scene, units.mass, 1.0, units.time)
    scene, chosen = resolved(scene, threads)
    plan = prepare(scene, threads, streaming, block)
    return Settled(scene, plan, units, chosen, notes(original, plan, units))
