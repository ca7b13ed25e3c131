"""A settled run: its plan, the layout of its result and its members; and the machine that moves
them. Members are the first n, a range of indices, or increasing indices."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.block import ASSESS_INTERVAL
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.program import Program
from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import count_text, read_count
from rigidmc.inputs.arrays import Array, Ints, as_plain_arrays
from rigidmc.inputs.labelled import is_labelled
from rigidmc.planning.initial import InitialMembers, Source, Start
from rigidmc.planning.plan import Plan
from rigidmc.planning.tolerance.costs import Choice
from rigidmc.planning.unit_scale import UnitScale
from rigidmc.processes.progress import Progress
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.runs.assemble import make_program
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.sampling import rows_to_run
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run
from rigidmc.scene.user_parts.registry import origin_of

if TYPE_CHECKING:
    import xarray as xr


class Machine(NamedTuple):
    """What moves the members of a run: threads of a device, a block of members each."""

    threads: int
    device: str
    block: int
    progress: Progress = False


@dataclass(eq=False, repr=False)
class SettledRun:
    """Everything that is settled before the first step; `rigidmc.runs.prepare.PreparedRun` names
    the fields."""

    plan: Plan
    layout: ResultLayout
    members: Selection
    units: UnitScale | None
    sampler: Source
    pilot: InitialMembers | None = None
    choice: Choice | None = None
    step_notes: tuple[str, ...] = ()
    scene_notes: tuple[str, ...] = ()
    # neither the code nor the text of a result depends on the values of members
    programs: dict[tuple[str, bool], Program | None] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        """The scene of the result, with the settings of the run, and the integrator and step that a
        tolerance chose."""
        return self.layout.scene

    @property
    def notes(self) -> tuple[str, ...]:
        """Hints to the user, in words; `simulate` issues them as warnings."""
        return (*self.step_notes, *self.scene_notes)

    def program(self, device: str = "cpu") -> Program | None:
        """Return the program that moves the members, compiled or from the cache; None for closed
        forms.

        Raises SceneError for custom code that cannot be compiled.
        """
        key = device, self.plan.paired
        if key not in self.programs:
            self.programs[key] = make_program(self.plan, device)
        return self.programs[key]

    def initial(self, first: int, count: int) -> tuple[Array, Start]:
        """Build `count` members at their start, from place `first` on.

        Returns rows for the kernel, padded to whole lanes, and the sampled values of the members.
        """
        members = self.members.indices(first, whole_lanes(count))
        return self.plan.initial(self.sampler, members, self.pilot)

    def with_members(self, members: range | Ints) -> Self:
        """Return the run with other members: a range of indices, or increasing indices.

        A range gives the result of a scene with these members; indices give a selection.
        """
        layout = self.layout
        if isinstance(members, range):
            place = {"first": members.start, "members": len(members)}
            layout = layout._replace(scene=layout.scene.with_run(**place))
        return replace(self, layout=layout, members=Selection.of(members))

    def with_paired_noise(self) -> Self:
        """Return the run whose steps have the noise of two steps of half their length."""
        return replace(self, plan=self.plan._replace(paired=True))


Members = int | range | Ints


def range_of_members(members: Members | None) -> tuple[int | range | None, Ints | None]:
    """Return (number or range of members, indices of some of the range or None).

    Raises SceneError for indices that do not increase.
    """
    if not isinstance(members, (int, range)):
        members = _plain(members)
    if isinstance(members, (list, tuple)):
        members = np.array(members)
    if not isinstance(members, np.ndarray):
        return members, None
    which = _indices(members)
    return range(int(which[0]), int(which[-1]) + 1), which


def select_members(members: Members, run: Run, model: Model) -> range | Ints:
    """Return the members of a prepared run; SceneError for members that its scene lacks."""
    if isinstance(members, (int, np.integer)):
        members = range(run.first, run.first + read_count(members, "members"))
    elif isinstance(members, range):
        _check_range(members)
    else:
        members = _indices(np.asarray(_plain(members)))
    last = int(members[-1]) + 1
    most, what = count_rows(*model.quantities()), "arrays with rows for"
    if run.strata is not None:
        most, what = run.strata, "a Latin hypercube of"
    if most is not None and last > most:
        rule = f"the scene has {what} only {count_text(most, 'member')}"
        raise SceneError(rule, at="run.members", value=last)
    return members


def with_settings(scene: Scene, members: int | range | None, settings: Mapping[str, Any]) -> Scene:
    """Return the scene with the settings of a run, and all values that depend on its members."""
    first = settings.get("first")
    if isinstance(members, range):
        _check_range(members)
        first, members = members.start, len(members)
    elif members is None:
        run = scene.run if first is None else scene.with_run(first=first).run
        members = rows_to_run(scene.model, run)
    scene = scene.with_run(**{**settings, "first": first, "members": members})
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    return scene


def mostly_flagged(result: "xr.Dataset") -> str:
    """Return a note if most members of a run are flagged, with reasons and times, else "".

    A few flagged members, such as the tail of a distribution, change no mean by much: `status`
    has them, and estimates leave them out.
    """
    flagged = {k: n for k, n in origin_of(result)["flagged"].items() if n and k != "ok"}
    count, members = sum(flagged.values()), result.sizes["member"]
    if 2 * count <= members:
        return ""
    times = result["status_time"].values
    first, last = np.nanmin(times), np.nanmax(times)
    since = f"{first:.4g} s" if first == last else f"{first:.4g} to {last:.4g} s"
    kinds = ", ".join(f"{n:,} {kind}" for kind, n in flagged.items())
    who = f"all {members:,} members are" if count > 1 else "the member is"
    who = who if count == members else f"{count:,} of {members:,} members are"
    return (
        f"{who} flagged ({kinds}) at {since} and keep{'s' * (members == 1)} the last good state, of"
        f" at most {ASSESS_INTERVAL} steps before: values after it are constant, not a motion;"
        " `status` and `status_time` show which and when"
    )


def _plain(members: Any) -> Any:
    """Return members without labels: of ds.member[...] or a Series only the values count."""
    return as_plain_arrays(np.asarray(members) if is_labelled(members) else members, "run.members")


def _indices(members: NDArray[Any]) -> Ints:
    """Return the indices of requested members; SceneError unless they increase from 0 or more."""
    sound = members.ndim == 1 and members.size and members.dtype.kind in "iu"
    if not sound or members[0] < 0 or not (np.diff(members) > 0).all():
        raise SceneError("expected increasing member indices", at="run.members")
    return members.astype(np.int64)


def _check_range(members: range) -> None:
    if members.step != 1 or members.start < 0 or not members:
        rule = "expected a range of member indices with step 1"
        raise SceneError(rule, at="run.members", value=members)
