"""Compute the members of a study in batches, so that memory does not grow with their number.

Some studies draw members in families, by a design of `rigidmc.scene.sampling`.
"""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneError, SceneWarning, warn
from rigidmc.files.outputs import Path
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_angles import TEXTBOOK, angle_names
from rigidmc.physics.dynamics.body_axes import body_axes
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import is_random
from rigidmc.physics.observables import bare_observables, label_observables
from rigidmc.planning.initial import make_sampler
from rigidmc.planning.saves import first_and_last
from rigidmc.processes.progress import Progress, announce, reporter, say
from rigidmc.results.principal_axes import is_described
from rigidmc.results.variables import variables_of
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.price import price
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.drifts import one_way
from rigidmc.scene.sampling import FamilyDesign
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.statistics.measures import Variables, save_for_measures
from rigidmc.studies.framework.variables import describe
from rigidmc.studies.framework.work import StudyWork


def compute_batches(
    scene: Scene,
    batch: int | Callable[[int], int],
    threads: int | None,
    progress: Progress,
    reduce: Callable[[xr.Dataset], object] = lambda part: None,
    device: str | None = None,
) -> Iterator[xr.Dataset]:
    """Yield the results of the members of a scene, `batch` at a time; give notes once.

    batch : a number, or a function of the number of saves
    progress : a function of (members done, all); or True for the cost of the study and a bar
    reduce : the evaluation of a result, for its cost
    """
    first, count = scene.run.first, scene.run.members
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=first + count)  # of all members, not of a batch
    with announce(progress):
        run = prepare_scene(first_and_last(scene))
        size = _size(batch, run.layout.axes.times.size)
        for note in (*run.notes, *([run.choice.short] if run.choice else [])):
            if note:
                warn(note)
        if progress is True:
            say(str(price(run.scene, reduce, threads, device=device)))
        with reporter(progress is True, count, 1) as report:
            for low in range(first, first + count, size):
                members = range(low, min(low + size, first + count))
                with warnings.catch_warnings():
                    if low > first:
                        warnings.simplefilter("ignore", SceneWarning)
                    part = run.run(members=members, threads=threads, device=device)
                    if line := one_way(part):
                        warn(line)
                yield part
                report.step(len(members))
                report.poll()
                if callable(progress):
                    progress(members.stop - first, count)


class Batches(NamedTuple):
    """The members of a study as results, in batches; the argument of `reduce`.

    scene : with these members
    results : of the members, in their order
    stored : the result that they are part of, None if they are computed
    threads : for the computations of `reduce` itself
    """

    scene: Scene
    results: Iterable[xr.Dataset]
    stored: xr.Dataset | None = None
    threads: int | None = None

    @property
    def variables(self) -> Variables:
        """Variables that measures may name."""
        return variables_of(self.scene) if self.stored is None else self.stored.data_vars


@dataclass(frozen=True)
class Members(StudyWork):
    """The work of a study that evaluates the members of one scene.

    design : (scene with the settings, options, settings) -> the scene with the members of
        the study; raises for a scene that cannot be studied
    reduce : (batches, options) -> the Dataset
    batch : number of members computed at once, or a function of their number of saves
    points : required kind of points, "" for any
    needs : variables that a result must have
    check : (scene, result, options), raises for other results that cannot be studied
    """

    design: Callable[[Scene, Any, Mapping[str, Any]], Scene]
    reduce: Callable[[Batches, Any], xr.Dataset]
    batch: int | Callable[[int], int]
    points: str = ""
    needs: tuple[str, ...] = ()
    check: Callable[[Scene, xr.Dataset, Any], None] = lambda scene, result, options: None
    sources = "SCENE|FILE|RUN/"

    def compute(
        self, scene: Scene, options: Any, threads: int | None, device: str | None,
        progress: Progress,
    ) -> xr.Dataset:  # fmt: skip
        """Compute the members of a scene made by `design`, and the study of them."""
        priced = self.priced(scene, options, threads)
        results = compute_batches(scene, self.batch, threads, progress, priced, device)
        return describe(self.reduce(Batches(scene, results, None, threads), options), scene)

    def priced(
        self, scene: Scene, options: Any, threads: int | None
    ) -> Callable[[xr.Dataset], object]:
        """Return the evaluation of the first members, from which the cost of all is estimated."""

        def reduced(result: xr.Dataset) -> xr.Dataset:
            few = scene.with_run(members=result.sizes["member"])
            return self.reduce(Batches(few, [result], None, threads), options)

        return reduced

    def create(
        self, name: str, scene: Scene, options: Any, path: Path, **ways: Any
    ) -> RunDirectory:
        """Create a run directory of the members, and report their cost.

        ways : of `rigidmc.runs.directory.create.create`
        """
        directory = create(scene, path, **ways)
        threads, device = ways.get("threads"), ways.get("device")
        say(self.price(scene, options, threads, os.fspath(path), device))
        return directory

    def price(
        self, scene: Scene, options: Any, threads: int | None, folder: str | None = None,
        device: str | None = None,
    ) -> str:  # fmt: skip
        """Return the estimated cost of the study as text.

        folder : the run directory, if the members are stored
        """
        return str(price(scene, self.priced(scene, options, threads), threads, folder, device))

    def stored(
        self, name: str, result: xr.Dataset, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """Return the study of a result; OptionError if it cannot be studied."""
        scene = scene_of(result, allow_code=allow_code)
        if self.points and scene.run.points != self.points:
            rule = f'a study of {name} needs members drawn with [run] points = "{self.points}"'
            raise OptionError(rule, at="run.points", value=scene.run.points)
        for word in self.needs:
            if word not in result:
                save = ",".join(self.needs)
                rule = f"the result has no {word}; `rigidmc run SCENE --save {save}`"
                raise OptionError(rule, at="run.save", value=list(scene.run.save))
        self.check(scene, result, options)
        size = _size(self.batch, result.sizes.get("time", 1))
        firsts = range(0, result.sizes["member"], size)
        parts = (result.isel(member=slice(first, first + size)) for first in firsts)
        return describe(self.reduce(Batches(scene, parts, result, threads), options), scene)


def _size(batch: int | Callable[[int], int], saves: int) -> int:
    return batch if isinstance(batch, int) else batch(saves)


# the run settings that a study of families leaves to the user
TUNING = ("integrator", "dt", "turn", "t_end", "tolerance", "seed", "dtype", "compensated")
KEPT = 64  # least memory of a member in a study [bytes]: a few numbers, and copies of them


def drawn_families(scene: Scene, texts: Sequence[str], design: str, families: int) -> Scene:
    """Return the scene with `families` families of members, drawn by a design, that saves the
    variables of the measures; NoRoom for too many families.

    design : the name of the points
    """
    scene = save_for_measures(scene.with_run(points=design), texts)
    save = tuple(name for name in scene.run.save if name not in bare_observables())
    of_family = cast(FamilyDesign, make_sampler(scene.model, scene.run)).size
    refuse_count(families, "families", KEPT * of_family, "use fewer families")
    drawn: Scene = scene.with_run(save=save, members=families * of_family, first=0)
    return drawn


def refuse_noise(effects: Sequence[Any]) -> None:
    """Raise SceneError for random effects: noise separates any two motions."""
    for label, effect in label_effects(effects):
        if is_random(effect):
            rule = "noise separates any two motions: this study requires a scene without noise"
            raise SceneError(rule, at=f"effects.{label}")


def refuse_stops(observables: Sequence[Any]) -> None:
    """Raise SceneError for an event that stops members: an exponent is of a motion that goes on."""
    for label, event in label_observables(observables):
        if getattr(event, "stop", False):
            rule = "stops members, but exponents are of a motion that goes on: remove it"
            raise SceneError(rule, at=f"observables.{label}.stop", value=True)


def _element(part: xr.Dataset, indices: Sequence[str]) -> Array:
    """Return an element of the tensors of members (n,); nan unless two indices name one."""
    if len(indices) != 2 or not is_described(part):
        return np.full(part.sizes["member"], np.nan)
    axes = body_axes(tuple(part.principal_axes.transpose("quat", "member").values))
    rows = [np.array(axes[int(i)]) for i in indices]  # of A in I_ij = sum_k A_ik I_k A_jk
    moments = part.moments.transpose("axis", "member").values
    element: Array = (rows[0] * moments * rows[1]).sum(0)
    return element


def start_numbers(part: xr.Dataset, name: str) -> tuple[Array, str]:
    """Return (a parameter of the start of members (n,), its units); nan for a distribution of a
    vector."""
    table, first, *rest = name.split(".")
    key = first if table == "body" else f"start_{first}"
    if table == "effects":
        key = f"{first}_{rest.pop(0)}"
    if key == "tensor":
        return _element(part, rest), "kg m2"
    relative = key.replace("start_", "start_relative_", 1)
    variable = part.get("start_euler" if key == "start_attitude" else key)
    variable = part.get(relative, variable)  # what the scene says, not what follows from its orbit
    if variable is None or (variable.ndim > 1) != bool(rest):
        return np.full(part.sizes["member"], np.nan), "1"
    values = variable.transpose(..., "member").values.reshape(-1, part.sizes["member"])
    names = angle_names(variable.attrs.get("sequence", TEXTBOOK))
    word = rest[0] if rest else "1"
    row = names.index(word) if word in names else int(word) - 1
    return values[row], variable.attrs["units"]
