"""Members of a study, some at a time, so that memory does not grow with their number."""

import math
import warnings
from collections.abc import Callable, Iterator

import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import SceneWarning
from rigidmc.planning.notes import notes
from rigidmc.progress import Progress, announcing, reporter, say
from rigidmc.runs.reopen import ready
from rigidmc.runs.simulate import simulate
from rigidmc.scene.scene import Scene
from rigidmc.studies.price import price


def chunks(
    scene: Scene,
    size: int,
    threads: int | None,
    progress: Progress,
    studied: Callable[[xr.Dataset], object] = lambda part: None,
) -> Iterator[xr.Dataset]:
    """The results of the members of a scene, `size` at a time; notes are given once.

    progress : a function of (members done, all); or True for what the study will cost, and a bar
    studied : what is done with a result, for its price
    """
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        # those of all members, not of a part
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    with announcing(progress):
        told = scene.run.integrator == "auto"
        if told:
            scene = _chosen(scene, threads)
        if progress is True:
            say(str(price(scene, studied, threads)))
        with reporter(progress is True, scene.run.members, 1) as report:
            for members in _ranges(scene, size):
                with warnings.catch_warnings():
                    if told:
                        warnings.simplefilter("ignore", SceneWarning)
                    part = simulate(scene, members=members, threads=threads)
                told = True
                yield part
                report.step(len(members))
                report.poll()
                if callable(progress):
                    progress(members.stop - scene.run.first, scene.run.members)


def _ranges(scene: Scene, size: int) -> Iterator[range]:
    """The members of a scene, `size` at a time."""
    first, stop = scene.run.first, scene.run.first + scene.run.members
    for low in range(first, stop, size):
        yield range(low, min(low + size, stop))


def _chosen(scene: Scene, threads: int | None) -> Scene:
    """The scene with what its tolerance chooses, once for all parts; gives its notes."""
    run = ready(scene, threads or threads_available())
    assert run.chosen is not None
    for note in (*notes(scene, run.plan, run.units), run.chosen.short):
        if note:
            warnings.warn(note, SceneWarning, stacklevel=3)
    return run.original


def pieces(result: xr.Dataset, size: int) -> Iterator[xr.Dataset]:
    """A result, `size` members at a time."""
    for low in range(0, result.sizes["member"], size):
        yield result.isel(member=slice(low, low + size))


def saves_of(scene: Scene) -> int:
    """How many saves a run of a scene has, to one."""
    run = scene.run
    return math.ceil(run.t_end / (run.every or run.dt)) + 1
