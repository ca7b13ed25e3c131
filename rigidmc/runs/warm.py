"""Code compiled before it is needed: what a scene runs, by its own integrator or by all of them, lies in the disk cache afterwards."""

import time
from typing import NamedTuple

from rigidmc.effects import EFFECTS, name_of
from rigidmc.engine.compile_time import compiled
from rigidmc.engine.layout import whole_lanes
from rigidmc.errors import RigidmcError
from rigidmc.integrators import INTEGRATORS
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.job import program_of
from rigidmc.planning.settle import settled
from rigidmc.planning.stage import stage
from rigidmc.progress import announcing


class Warmed(NamedTuple):
    """What was compiled for an integrator.

    seconds : that it took;  compiled : labels of what was compiled, none if all was there;  skipped : why nothing could be, "" if it could
    """

    integrator: str
    seconds: float
    compiled: tuple
    skipped: str


def warm(scene, all_integrators=False, progress=False):
    """Compile what a run of a scene needs; a list of `Warmed`, one for each integrator.

    all_integrators : also for those that the scene does not ask for; the ones that cannot run it are skipped
    progress : True for a line before anything is compiled

    Raises SceneError for a scene that cannot be run as it is.
    """
    with announcing(progress):
        found = [_warmed(scene)]
        for name in INTEGRATORS if all_integrators else ():
            if name == scene.run.integrator:
                continue
            try:
                found.append(_warmed(scene.with_run(integrator=name)))
            except RigidmcError as error:
                found.append(Warmed(name, 0.0, (), error.rule))
    return found


def _warmed(scene):
    began, name, before = time.perf_counter(), scene.run.integrator, len(compiled)
    scene, plan, *_ = settled(scene)
    if own := [name_of(e) for e in scene.effects if type(e) not in EFFECTS.values()]:
        return Warmed(
            name, 0.0, (), f"{', '.join(own)}: effects of your own are compiled in every process"
        )
    if plan.form is None:
        block, start = stage(scene, plan.first, whole_lanes(1), plan.carried, None, plan.watch.rows)
        closed_values(scene, block, start, plan.times[:2], plan.dt)
    else:
        program_of(scene, plan)
    return Warmed(name, time.perf_counter() - began, tuple(compiled[before:]), "")
