"""The members of maps: preparation before the first step, and computation."""

import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError, SceneWarning, unknown
from rigidmc.inputs.arrays import Bools, Ints
from rigidmc.mechanics.inertia import TRIANGLE
from rigidmc.planning.saves import first_and_last
from rigidmc.planning.tolerance.choose import choose_integrator
from rigidmc.processes.progress import reporter
from rigidmc.results.variables import Variable, variables_of
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.scene import Scene
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.statistics.measures import measure, save_for_measures
from rigidmc.studies.framework.options import Side
from rigidmc.studies.stability_map.cases import MAPS
from rigidmc.studies.stability_map.pixels import (
    MapRun,
    PixelCollector,
    Pixels,
    join_pixels,
    map_dataset,
)
from rigidmc.studies.stability_map.question import Borders, MapRequest, Resolution, make_request
from rigidmc.studies.stability_map.refine import BEGUN, borders_of, pixel_members, refine

CHUNK = 2**17  # members at once: 20 to 40 MB, and 40 waits for the last block in a map of 4e6
REPLICAS = 16  # members per pixel
RESOLUTION = 256  # pixels per side of a shipped map

Progress = bool | Callable[[int, int], object] | None  # True for a bar
# (members, number computed before, number in all) -> their result
Compute = Callable[[range | Ints, int, int], xr.Dataset]


def replicas_of(scene: Scene, x: Side, y: Side) -> int:
    """Return REPLICAS if the members of a pixel differ, since a quantity or the attitude is random;
    else 1."""
    pixel = make_request(x, y, "status", 1, 1, model=scene.model).of_scene(scene)
    drawn = any(isinstance(q, (Distribution, VectorDistribution)) for q in pixel.model.quantities())
    return REPLICAS if drawn or isinstance(pixel.start.attitude, str) else 1


def prepared_case(
    name: str,
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    adaptive: bool | Borders = False,
    **settings: Any,
) -> MapRun:
    """Prepare one of MAPS, before its first step.

    settings : run settings of the map to replace, if not None;  others : see `stability_map`
    """
    if name not in MAPS:
        raise unknown("map", MAPS, at="map", value=name, error=OptionError)
    case = MAPS[name]()
    changes = {key: value for key, value in settings.items() if value is not None}
    usual = {k: value for k, value in case.settings.items() if k != "dt" or "turn" not in changes}
    members = case.members if members is None else members
    if adaptive is True:
        adaptive = case.borders
    sides = case.x, case.y, case.of, resolution, members
    request = make_request(*sides, name=name, adaptive=adaptive)
    return prepare_map(request, case.scene, **usual | changes)


def prepare_map(request: MapRequest, scene: Scene, **settings: Any) -> MapRun:
    """Prepare a map before its first step.

    settings : of the run. Raises OptionError for parameters and measures that the scene lacks.
    """
    scene = request.of_scene(scene).with_run(save=settings.pop("save", ()), **settings)
    if scene.run.points != "independent":
        rule = "the interval of a pixel requires independent members"
        raise SceneError(rule, at="run.points", value=scene.run.points)
    scene = _with_integrator(save_for_measures(scene, request.of))
    run = prepare_scene(scene)
    # no notes on long steps: maps use them on purpose
    for note in run.scene_notes:
        warnings.warn(note, SceneWarning, stacklevel=3)
    return describe_map(request, scene, run.layout.by_member)


def describe_map(request: MapRequest, scene: Scene, by_member: Mapping[str, Variable]) -> MapRun:
    """Return the MapRun of a scene with its integrator."""
    measures = [measure(text, variables_of(scene)) for text in request.of]
    if request.borders is not None:
        request = request._replace(borders=borders_of(measures, request.borders))
    return MapRun(request, scene, measures, by_member)


def run_map(
    map_run: MapRun,
    threads: int | None = None,
    progress: Progress = None,
    device: str | None = None,
) -> xr.Dataset:
    """Compute a map in memory and return its Dataset."""
    began, run = time.perf_counter(), prepare_scene(first_and_last(map_run.scene))

    def compute(members: range | Ints, done: int, of_all: int) -> xr.Dataset:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # `prepare_map` gave the notes
            part = run.run(members=members, threads=threads, device=device)
        report.step(len(members))
        report.poll()
        if callable(progress):
            progress(done + len(members), of_all)
        return part

    # an adaptive map needs fewer members; their number is not known in advance
    with reporter(progress is True, map_run.request.members, 1) as report:
        if map_run.request.borders is not None:
            pixels = _refined(map_run, compute)
        else:
            pixels = join_pixels(list(_computed(map_run, compute)))
    return finish_map(map_run, pixels).assign_attrs(seconds=time.perf_counter() - began)


def finish_map(map_run: MapRun, pixels: Pixels, computed: Bools | None = None) -> xr.Dataset:
    """Return the Dataset of the pixels, with the theory of a shipped map; OptionError if all have
    an impossible body or start.

    computed : whether each pixel of an adaptive map was computed, if the other pixels are already
        filled from these
    """
    request = map_run.request
    if not pixels.counts[:2].any():
        (x, *ends), (y, *others) = request.x[:3], request.y[:3]
        between = f"between {ends[0]:g} and {ends[1]:g}, and {others[0]:g} and {others[1]:g} of {y}"
        rule = f"{between}, all pixels have an impossible body or start: bodies obey {TRIANGLE}"
        raise OptionError(rule, at="x", value=x)
    if request.borders is not None and computed is None:
        state = refine(request, pixels)
        pixels, computed = pixels.at(state.source), state.known
    ds = map_dataset(map_run, pixels, computed)
    if request.name in MAPS:
        case = MAPS[request.name]()
        sides = np.meshgrid(ds.x.values, ds.y.values)
        for key, (units, text, values) in case.derived.items():
            ds[key] = (("y", "x"), values(ds, *sides), {"units": units, "long_name": text})
        ds.attrs |= {"title": case.title, "map": request.name, "theory": case.source}
    return ds


def _with_integrator(scene: Scene) -> Scene:
    """Return the scene with an integrator and a step for its tolerance, chosen over the map."""
    if scene.run.integrator != "auto":
        return scene
    run = choose_integrator(scene.with_model(scene.model.coarse()))[0].run
    step = {"dt": run.dt} if run.turn is None else {"turn": run.turn}
    return scene.with_run(integrator=run.integrator, dtype=run.dtype, **step)


def _refined(map_run: MapRun, compute: Compute) -> Pixels:
    """Integrate the pixels of an adaptive map, level by level, and return them."""
    request, done = map_run.request, 0
    collected, level = PixelCollector(map_run), BEGUN
    while True:
        state = refine(request, pixels := collected.pixel_values(), level)
        if not (level := state.level):
            return pixels
        members = pixel_members(request, state.wanted)
        for low in range(0, members.size, CHUNK):
            part = members[low : low + CHUNK]
            collected.take(compute(part, done, done + members.size - low))
            done += part.size


def _computed(map_run: MapRun, compute: Compute) -> Iterator[Pixels]:
    """Integrate the members, CHUNK at a time; yield complete pixels, range by range."""
    request, done = map_run.request, 0
    width = min(request.pixels, CHUNK)
    together = CHUNK // request.pixels if width == request.pixels else 1  # replicas
    for low in range(0, request.pixels, width):
        here = range(low, min(low + width, request.pixels))
        collected = PixelCollector(map_run, here)
        for replica in range(0, request.replicas, together):
            more = min(together, request.replicas - replica) - 1
            first = replica * request.pixels + low
            members = range(first, first + more * request.pixels + len(here))
            collected.take(compute(members, done, request.members))
            done += len(members)
        yield collected.pixel_values()
