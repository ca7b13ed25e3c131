"""Members of a study, some at a time, so that memory does not grow with their number."""

import math
import warnings
from collections.abc import Callable, Iterator

import xarray as xr

from rigidmc.errors import SceneWarning
from rigidmc.runs.simulate import simulate
from rigidmc.scene.scene import Scene


def chunks(
    scene: Scene,
    size: int,
    threads: int | None,
    progress: Callable[[int, int], object] | None,
) -> Iterator[xr.Dataset]:
    """The results of the members of a scene, `size` at a time; notes are given once.

    progress : a function of (members done, all)
    """
    first, count = scene.run.first, scene.run.members
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=first + count)  # those of all members, not of a part
    for low in range(0, count, size):
        high = min(low + size, count)
        with warnings.catch_warnings():
            if low:
                warnings.simplefilter("ignore", SceneWarning)
            part = simulate(scene, members=range(first + low, first + high), threads=threads)
        yield part
        if progress is not None:
            progress(high, count)


def pieces(result: xr.Dataset, size: int) -> Iterator[xr.Dataset]:
    """A result, `size` members at a time."""
    for low in range(0, result.sizes["member"], size):
        yield result.isel(member=slice(low, low + size))


def saves_of(scene: Scene) -> int:
    """How many saves a run of a scene has, to one."""
    run = scene.run
    return math.ceil(run.t_end / (run.every or run.dt)) + 1
