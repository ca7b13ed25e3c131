"""A settled run: its plan, the layout of its result and its members; and the machine that moves
them."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.program import Program
from rigidmc.planning.initial import InitialMembers, Source, Start
from rigidmc.planning.plan import Plan
from rigidmc.planning.tolerance.costs import Choice
from rigidmc.planning.unit_scale import UnitScale
from rigidmc.processes.progress import Progress
from rigidmc.results.layout import ResultLayout, Selection
from rigidmc.runs.assemble import make_program
from rigidmc.scene.scene import Scene

Array = NDArray[np.float64]


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

    def with_members(self, members: range | NDArray[np.int64]) -> Self:
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
