"""Settle everything about a run before its first step."""

from typing import NamedTuple

from rigidmc.engine.cuda.devices import device_now
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
    """

    scene: Scene
    plan: Plan
    units: Internal | None
    chosen: Chosen | None


def settled(
    scene: Scene, threads: int = 1, streaming: bool = False, block: int | None = None
) -> Settled:
    """Rescale a scene if numbers could overflow, choose integrator and step if it asks for a
    tolerance, and make its Plan; SceneError."""
    found = _settled(scene, threads, streaming, block, device_now())
    return Settled(found[0] or scene, *found[1:])


@once
def _settled(
    scene: Scene, threads: int, streaming: bool, block: int | None, device: str
) -> tuple[Scene | None, Plan, Internal | None, Chosen | None]:
    """The fields of Settled. The scene is None if it is the scene itself, which would otherwise
    hold itself and stay in memory until the garbage is collected.

    device : the one that runs take now, of which a Plan tells
    """
    original, units = scene, internal(scene)
    if units is not None:
        scene = scaled(scene, units.mass, 1.0, units.time)
    scene, chosen = resolved(scene, threads)
    plan = prepare(scene, threads, streaming, block)
    return None if scene is original else scene, plan, units, chosen
