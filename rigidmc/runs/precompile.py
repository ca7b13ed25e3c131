"""Code compiled before it is needed: for a scene's integrator, or for all that take the scene. It
is kept in the disk cache."""

import time
from typing import NamedTuple

from rigidmc.engine.compile_time import compiled
from rigidmc.engine.compiler.user_stamps import why_not_cached
from rigidmc.errors import RigidmcError
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.closed_form import closed_values
from rigidmc.progress import announcing
from rigidmc.runs.prepare import prepared
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.scene.user_parts.registry import own_parts
from rigidmc.scene.vector_distributions.protocol import Law


class Warmed(NamedTuple):
    """What was compiled for an integrator.

    seconds : that it took
    compiled : labels of what was compiled, () if everything was in the cache
    skipped : why nothing can be compiled, "" if it can
    """

    integrator: str
    seconds: float
    compiled: tuple[str, ...]
    skipped: str


@takes_scene
def warm(scene: Scene, all_integrators: bool = False, progress: bool = False) -> list[Warmed]:
    """Compile what a run of a scene needs.

    Parameters
    ----------
    scene : Scene or path_like
        what is to be run
    all_integrators : bool, optional
        also for the integrators that the scene does not name; those that cannot run it are skipped
    progress : bool, optional
        True for a line before anything is compiled

    Returns
    -------
    list of Warmed
        one for each integrator: integrator, seconds that it took, labels of what was compiled, why
        it was skipped

    Raises
    ------
    SceneError
        for a scene that cannot be run as it is

    Examples
    --------
    >>> [one.integrator for one in rm.warm(rm.Scene.load("dzhanibekov"))]
    ['rk4']
    """
    with announcing(progress):
        results = [_warmed(scene)]
        for name in INTEGRATORS if all_integrators else ():
            if name == scene.run.integrator:
                continue
            try:
                results.append(_warmed(scene.with_run(integrator=name)))
            except RigidmcError as error:
                results.append(Warmed(name, 0.0, (), error.rule))
    return results


def _warmed(scene: Scene) -> Warmed:
    began, name, before = time.perf_counter(), scene.run.integrator, len(compiled)
    run = prepared(scene)
    parts = [type(part) for part in own_parts(run.scene) if not isinstance(part, Law)]
    if found := {kind.__name__: why for kind in parts if (why := why_not_cached(kind))}:
        rule = "; ".join(
            f"{user} is compiled in every process: {why}" for user, why in found.items()
        )
        return Warmed(name, 0.0, (), rule)
    plan = run.plan
    if plan.scheme is None:
        block, start = run.initial(plan.first, 1)
        observables = list(plan.recording.recorded.values())
        few = plan.times[:2]
        closed_values(plan.model.effects, observables, block, start, few, plan.grid.clock)
    else:
        run.program()
    return Warmed(name, time.perf_counter() - began, tuple(compiled[before:]), "")
