"""Members of a study, some at a time, so that memory does not grow with their number.

Members that come in families, by a design of `rigidmc.scene.sampling`.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.initial import make_sampler
from rigidmc.progress import Progress, announcing, reporter, say
from rigidmc.results.measures import Variables, observing
from rigidmc.results.variables import variables_of
from rigidmc.runs.prepare import prepared
from rigidmc.runs.price import price
from rigidmc.runs.resources import refuse_count
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted
from rigidmc.scene.sampling import Design
from rigidmc.scene.scene import Scene, scene_of


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
            scene = _chosen(scene)
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


def _chosen(scene: Scene) -> Scene:
    """The scene with what its tolerance chooses, once for all parts; gives its notes."""
    run = prepared(scene)
    assert run.choice is not None
    for note in (*run.notes, run.choice.short):
        if note:
            warnings.warn(note, SceneWarning, stacklevel=3)
    return run.scene


def pieces(result: xr.Dataset, size: int) -> Iterator[xr.Dataset]:
    """A result, `size` members at a time."""
    for low in range(0, result.sizes["member"], size):
        yield result.isel(member=slice(low, low + size))


def saves_of(scene: Scene) -> int:
    """How many saves a run of a scene has, to one."""
    run = scene.run
    return math.ceil(run.t_end / (run.every or run.dt)) + 1


Array = NDArray[np.float64]
KEPT = 64  # bytes of a member that a study keeps at least: a few numbers, and copies of them
Asked = tuple[Scene, tuple[str, ...], Variables]  # scene, texts, variables of its members
_ANGLES = {"phi": 0, "theta": 1, "psi": 2}


def size(scene: Scene) -> int:
    """How many members a family of a scene has."""
    return cast(Design, make_sampler(scene.model, scene.run)).size


def made(
    scene: Scene, of: str | Sequence[str], points: str, families: int, **settings: Any
) -> Asked:
    """What measures ask of a scene with so many families, all of them drawn by a design.

    points : the name of the design;  settings : of the run
    """
    texts = (of,) if isinstance(of, str) else tuple(of)
    scene = observing(scene.with_run(**settings, points=points), texts)
    save = tuple(name for name in scene.run.save if name not in OBSERVABLES)
    many = counted(families, "families")
    count = many * size(scene)
    refuse_count(many, "families", KEPT * size(scene), "take fewer families")
    scene = scene.with_run(save=save, members=count, first=0)
    return scene, texts, variables_of(scene)


def stored(
    result: xr.Dataset, of: str | Sequence[str], points: str, study: str, allow_code: bool
) -> Asked:
    """What measures ask of a result; OptionError unless it is of members of a design.

    points : the name of the design;  study : what it is for
    """
    scene = scene_of(result, allow_code=allow_code)
    if scene.run.points != points:
        rule = f'a study of {study} needs members drawn with [run] points = "{points}"'
        raise OptionError(rule, at="run.points", value=scene.run.points)
    texts = (of,) if isinstance(of, str) else tuple(of)
    return scene, texts, result.data_vars


def refuse_noise(scene: Scene) -> None:
    """SceneError for random effects, which take neighbours anywhere."""
    for label, effect in label_effects(scene.effects):
        if is_random(effect):
            rule = "noise takes neighbours anywhere: this is a study of scenes without"
            raise SceneError(rule, at=f"effects.{label}")


def started(part: xr.Dataset, name: str) -> tuple[Array, str]:
    """(a number of the start of members (n,), its units); nan for a law of several numbers."""
    table, first, *rest = name.split(".")
    key = first if table == "body" else f"start_{first}"
    if table == "effects":
        key = f"{first}_{rest.pop(0)}"
    variable = part.get("start_euler" if key == "start_attitude" else key)
    if variable is None or (variable.ndim > 1) != bool(rest):
        return np.full(part.sizes["member"], np.nan), "1"
    values = variable.transpose(..., "member").values.reshape(-1, part.sizes["member"])
    row = _ANGLES.get(rest[0]) if rest else 0
    return values[int(rest[0]) - 1 if row is None else row], variable.attrs["units"]
