"""Compile code before it is needed: for a scene's integrator, or for every integrator that can run
the scene. The code is stored in the disk cache."""

import time
from typing import NamedTuple

from rigidmc.engine.compile_time import compiled
from rigidmc.engine.compiler.frozen import why_not_cached
from rigidmc.errors import RigidmcError
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.closed_form import closed_values
from rigidmc.processes.progress import announce
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.scene.vector_distributions.protocol import VectorDistribution


class Precompiled(NamedTuple):
    """The code compiled for an integrator.

    seconds : spent on compiling
    compiled : labels of compiled code, () if everything was in the cache
    skipped : why nothing can be compiled, or ""
    """

    integrator: str
    seconds: float
    compiled: tuple[str, ...]
    skipped: str


@takes_scene
def precompile(
    scene: Scene, all_integrators: bool = False, progress: bool = False
) -> list[Precompiled]:
    """Compile the code that a run of a scene needs.

    Parameters
    ----------
    scene : Scene or path_like
        scene to prepare for
    all_integrators : bool, optional
        also compile for integrators that the scene does not name; skip those that cannot run it
    progress : bool, optional
        print a line before compiling

    Returns
    -------
    list of Precompiled
        one for each integrator: its name, seconds spent, labels of compiled code, and the reason
        if it was skipped

    Raises
    ------
    SceneError
        for a scene that cannot run as it is

    Examples
    --------
    >>> [one.integrator for one in rm.precompile(rm.Scene.load("dzhanibekov"))]
    ['rk4']
    """
    with announce(progress):
        results = [_precompile_one(scene)]
        for name in INTEGRATORS if all_integrators else ():
            if name == scene.run.integrator:
                continue
            try:
                results.append(_precompile_one(scene.with_run(integrator=name)))
            except RigidmcError as error:
                results.append(Precompiled(name, 0.0, (), error.rule))
    return results


def _precompile_one(scene: Scene) -> Precompiled:
    began, name, before = time.perf_counter(), scene.run.integrator, len(compiled)
    run = prepare_scene(scene)
    parts = [
        type(part) for part in run.scene.user_parts if not isinstance(part, VectorDistribution)
    ]
    if found := {kind.__name__: why for kind in parts if (why := why_not_cached(kind))}:
        rule = "; ".join(
            f"{user} is compiled in every process: {why}" for user, why in found.items()
        )
        return Precompiled(name, 0.0, (), rule)
    plan = run.plan
    if plan.scheme is None:
        block, start = run.initial(run.members.first, 1)
        observables = list(plan.recording.recorded.values())
        few = plan.grid.times[:2]
        closed_values(plan.model.effects, observables, block, start, few, plan.grid.clock)
    else:
        run.program()
    return Precompiled(name, time.perf_counter() - began, tuple(compiled[before:]), "")
