"""The members of maps: what is settled before their first step, and how they are computed."""

import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.planning.tolerance.choose import choose_integrator
from rigidmc.progress import reporter
from rigidmc.results.measures import Measure, measure, observing
from rigidmc.results.variables import Variable, variables_of
from rigidmc.runs.prepare import prepared
from rigidmc.runs.simulate import simulate
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.scene import Scene
from rigidmc.scene.vector_distributions.protocol import Law
from rigidmc.studies.stability_map.pixels import Collected, Pixels, joined, map_dataset
from rigidmc.studies.stability_map.question import Question, Side, question
from rigidmc.studies.stability_map.refine import BEGUN, borders_of, members_of, refined

CHUNK = 2**17  # members at once: 20 to 40 MB, and 40 waits for the last block in a map of 4e6
REPLICAS = 16  # members per pixel

Progress = bool | Callable[[int, int], object] | None  # True for a bar


# (members, how many were computed before, how many there are to be) -> their result
Compute = Callable[[range | NDArray[np.int64], int, int], xr.Dataset]


class Prepared(NamedTuple):
    """A map before its first step.

    scene : whose members are those of the map, with integrator and step
    known : {name: Variable} of the members
    """

    question: Question
    scene: Scene
    measures: list[Measure]
    known: dict[str, Variable]


def replicas_of(scene: Scene, x: Side, y: Side) -> int:
    """REPLICAS if the members of a pixel differ: a quantity or the attitude is random; else 1."""
    one = question(x, y, "status", 1, 1).of_scene(scene)
    drawn = any(isinstance(q, (Distribution, Law)) for q in one.quantities())
    return REPLICAS if drawn or isinstance(one.start.attitude, str) else 1


def prepare_map(asked: Question, scene: Scene, **settings: Any) -> Prepared:
    """Settle everything about a map before its first step.

    settings : of the run. Raises OptionError for parameters and measures that the scene lacks.
    """
    scene = asked.of_scene(scene).with_run(save=settings.pop("save", ()), **settings)
    if scene.run.points != "independent":
        rule = "the interval of a pixel needs independent members"
        raise SceneError(rule, at="run.points", value=scene.run.points)
    scene = observing(scene, asked.of)
    whole = _with_integrator(scene)
    run = prepared(whole)
    # not those on large steps, which maps take on purpose
    for note in run.scene_notes:
        warnings.warn(note, SceneWarning, stacklevel=3)
    return described(asked, whole, run.layout.by_member)


def described(asked: Question, scene: Scene, known: dict[str, Variable]) -> Prepared:
    """The Prepared map of a scene that has its integrator; known : the variables of its members."""
    measures = [measure(text, variables_of(scene)) for text in asked.of]
    if asked.borders is not None:
        asked = asked._replace(borders=borders_of(measures, asked.borders))
    return Prepared(asked, scene, measures, known)


def mapped(
    ready: Prepared,
    threads: int | None = None,
    progress: Progress = None,
    device: str | None = None,
) -> xr.Dataset:
    """The Dataset of a map, computed in memory."""
    began = time.perf_counter()

    def compute(members: range | NDArray[np.int64], done: int, of_all: int) -> xr.Dataset:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # the notes were given before
            part = simulate(ready.scene, members=members, threads=threads, device=device)
        report.step(len(members))
        report.poll()
        if callable(progress):
            progress(done + len(members), of_all)
        return part

    # an adaptive map asks for fewer members, and nobody knows how many
    with reporter(progress is True, ready.question.members, 1) as report:
        if ready.question.borders is not None:
            found = finished(ready, _refined(ready, compute))
        else:
            found = finished(ready, joined(list(_computed(ready, compute))))
    return found.assign_attrs(seconds=time.perf_counter() - began)


def finished(
    ready: Prepared, pixels: Pixels, computed: NDArray[np.bool_] | None = None
) -> xr.Dataset:
    """The Dataset of the pixels; OptionError if none has a body and a start.

    computed : whether a pixel of an adaptive map was, if the others show their neighbours already
    """
    asked = ready.question
    if not pixels.counts[:2].any():
        (x, *ends), (y, *others) = asked.x[:3], asked.y[:3]
        between = f"between {ends[0]:g} and {ends[1]:g}, and {others[0]:g} and {others[1]:g} of {y}"
        rule = f"{between} no pixel has a body and a start: moments must obey I_i <= I_j + I_k"
        raise OptionError(rule, at="x", value=x)
    if asked.borders is not None and computed is None:
        state = refined(asked, pixels)
        pixels, computed = pixels.at(state.source), state.known
    return map_dataset(asked, ready.scene, ready.known, ready.measures, pixels, computed)


def _with_integrator(scene: Scene) -> Scene:
    """The scene with an integrator and a step for its tolerance, chosen over the whole map."""
    if scene.run.integrator != "auto":
        return scene
    run = choose_integrator(scene.with_model(scene.model.coarse()))[0].run
    step = {"dt": run.dt} if run.turn is None else {"turn": run.turn}
    chosen: Scene = scene.with_run(integrator=run.integrator, dtype=run.dtype, **step)
    return chosen


def _refined(ready: Prepared, compute: Compute) -> Pixels:
    """The pixels of an adaptive map, integrated level by level."""
    asked, done = ready.question, 0
    collected, level = Collected(asked, ready.measures), BEGUN
    while True:
        state = refined(asked, pixels := collected.pixel_values(), level)
        if not (level := state.level):
            return pixels
        members = members_of(asked, state.wanted)
        for low in range(0, members.size, CHUNK):
            part = members[low : low + CHUNK]
            collected.take(compute(part, done, done + members.size - low))
            done += part.size


def _computed(ready: Prepared, compute: Compute) -> Iterator[Pixels]:
    """Integrate the members, CHUNK at a time: all replicas of some pixels, then of the next."""
    asked, done = ready.question, 0
    width = min(asked.pixels, CHUNK)
    together = CHUNK // asked.pixels if width == asked.pixels else 1  # replicas
    for low in range(0, asked.pixels, width):
        here = range(low, min(low + width, asked.pixels))
        collected = Collected(asked, ready.measures, here)
        for replica in range(0, asked.replicas, together):
            more = min(together, asked.replicas - replica) - 1
            first = replica * asked.pixels + low
            members = range(first, first + more * asked.pixels + len(here))
            collected.take(compute(members, done, asked.members))
            done += len(members)
        yield collected.pixel_values()
