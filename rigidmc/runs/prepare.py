"""The prepared run: everything that is settled before the first step, in one straight line.

A scene is data. `prepare` checks it, chooses units, integrator and step, and resolves all names to
objects. The result runs any number of times, with other members, threads or devices.
"""

import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigidmc.engine.compiler.contents import changes, contents_of
from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import Program
from rigidmc.errors import OptionError, PartError, warn
from rigidmc.files.outputs import Path
from rigidmc.inputs.amounts import read_count
from rigidmc.planning.check import check_scene
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.initial import (
    InitialMembers,
    Source,
    Start,
    check_starts,
    make_pilot,
    make_sampler,
)
from rigidmc.planning.monitors import has_attitude, make_monitors
from rigidmc.planning.notes import scene_notes, step_notes
from rigidmc.planning.plan import Plan, make_plan
from rigidmc.planning.saves import FEW_MEMBERS, first_and_last, save_to_plot, settle_saves
from rigidmc.planning.tolerance.choice import Choice
from rigidmc.planning.tolerance.choose import choose_integrator
from rigidmc.planning.units import UnitScale, choose_units, scale_scene
from rigidmc.processes.progress import Progress
from rigidmc.results.layout import ResultLayout
from rigidmc.results.sinks import Blanks, MemorySink
from rigidmc.runs.assemble import make_layout, make_program
from rigidmc.runs.blocks import Sink, compute
from rigidmc.runs.members import mostly_flagged, range_of_members, select_members, with_settings
from rigidmc.runs.resources import block_of, check_resources, needs
from rigidmc.scene.derivatives import parameters_of_run
from rigidmc.scene.quantities import Varied
from rigidmc.scene.recording import make_recording
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.scene.settings import takes_settings
from rigidmc.scene.user_parts.registry import CLASSES, remember_classes, user_parts_of
from rigidmc.scene.validation import PILOT
from rigidmc.scene.varied import close_varied, nominal_of, open_varied, stored_values, with_values

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


class PreparedRun:
    """A run that is ready for its first step, made by `prepare`.

    Parameters
    ----------
    scene : Scene
        with the settings of the run, and the integrator and step that a tolerance chose
    plan : Plan
        the resolved run, in the units of integration
    layout : ResultLayout
        the result, in the units of the scene
    units : UnitScale or None
        the units of integration, None if they are the scene's
    sampler : object
        source of the members' uniform random numbers
    pilot : InitialMembers or None
        the first members at their start, if they belong to the run
    choice : Choice or None
        the choice for a tolerance, None if the scene names its integrator
    step_notes : tuple of str
        hints to the user on step lengths
    scene_notes : tuple of str
        other hints to the user

    Examples
    --------
    >>> run = rm.prepare("dzhanibekov", members=4, t_end=1.0)
    >>> run.scene.run.integrator, run.notes
    ('rk4', ())
    """

    def __init__(
        self,
        scene: Scene,
        plan: Plan,
        layout: ResultLayout,
        units: UnitScale | None,
        sampler: Source,
        pilot: InitialMembers | None,
        choice: Choice | None,
        step_notes: tuple[str, ...],
        scene_notes: tuple[str, ...],
    ) -> None:
        self.scene, self.plan, self.layout, self.units = scene, plan, layout, units
        self.sampler, self.pilot, self.choice = sampler, pilot, choice
        self.step_notes, self.scene_notes = step_notes, scene_notes
        self._programs: dict[tuple[str, bool], Program | None] = {}
        self._blanks = Blanks()
        self._derived: dict[str | tuple[str, ...], PreparedRun] = {}  # by `wrt` of `run`
        self.contents = contents_of_parts(scene)

    @property
    def notes(self) -> tuple[str, ...]:
        """Hints to the user, in words; `simulate` issues them as warnings."""
        return (*self.step_notes, *self.scene_notes)

    def compile(self, device: str | None = None) -> "PreparedRun":
        """Compile the code that the members need, or load it from the disk cache. Without this
        call, the first `run` compiles.

        Parameters
        ----------
        device : str, optional
            as in `simulate`

        Returns
        -------
        PreparedRun
            itself

        Examples
        --------
        >>> rm.prepare("dzhanibekov", members=4, t_end=1.0).compile().plan.members
        4
        """
        self._refuse_changes()
        self.program(resolve_device(device))
        return self

    def _refuse_changes(self) -> None:
        """Raise PartError if custom code has changed since the run was prepared."""
        if not self.contents:  # no custom code
            return
        if changed := changes(self.contents, contents_of_parts(self.scene)):
            rule = f"{', '.join(changed[:5])}: changed since the run was prepared; prepare it again"
            raise PartError(rule, at="code")

    def program(self, device: str = "cpu") -> Program | None:
        """Return the program that moves the members, compiled or from the cache; None for closed
        forms.

        Raises SceneError for custom code that cannot be compiled.
        """
        key = device, self.plan.paired
        if key not in self._programs:
            self._programs[key] = make_program(self.plan, device)
        return self._programs[key]

    def initial(self, first: int, count: int) -> tuple[Array, Start]:
        """Build `count` members at their start, from place `first` on.

        Returns rows for the kernel, padded to whole lanes, and the sampled values of the members.
        """
        return self.plan.initial(self.sampler, first, count, self.pilot)

    def with_members(self, members: range | NDArray[np.int64]) -> "PreparedRun":
        """Return the run with other members: a range of indices, or increasing indices.

        A range gives the result of a scene with these members; indices give a selection.
        """
        if isinstance(members, range):
            place = {"first": members.start, "members": len(members)}
            scene = self.scene.with_run(**place)
            layout = self.layout._replace(
                scene=scene, first=members.start, members=len(members), which=None
            )
            plan = self.plan._replace(first=members.start, members=len(members), which=None)
            return self._changed(plan, layout, scene)
        layout = self.layout._replace(first=0, members=members.size, which=members)
        return self._changed(self.plan.of(members), layout)

    def with_values(self, values: Mapping[str, ArrayLike]) -> "PreparedRun":
        """Return the run with other values of the varied parameters; see `run`."""
        scene, count = with_values(self.scene, values)
        units = self.units
        moving = scene if units is None else scale_scene(scene, units.mass, 1.0, units.time)
        plan = self.plan._replace(model=moving.model, first=0, members=count, which=None)
        layout = self.layout._replace(scene=scene, first=0, members=count, which=None)
        run = self._changed(plan, layout, scene)
        run.pilot = None
        return run

    def with_derivatives(self, wrt: str | Iterable[str]) -> "PreparedRun":
        """Return the run with derivatives by other parameters; see `run`."""
        names = wrt if isinstance(wrt, str) else tuple(wrt)
        if names == self.scene.run.wrt:
            return self
        if names not in self._derived:
            run, which = prepare_scene(self.scene.with_run(wrt=names)), self.plan.which
            plan = run.plan.with_kernels_of(self.plan)
            run = run._changed(plan, run.layout._replace(columns=plan.columns))
            run.choice = self.choice
            self._derived[names] = run if which is None else run.with_members(which)
        return self._derived[names]

    def with_paired_noise(self) -> "PreparedRun":
        """Return the run whose steps have the noise of two steps of half their length."""
        return self._changed(self.plan._replace(paired=True), self.layout)

    def run(
        self,
        *,
        members: int | range | NDArray[np.int64] | None = None,
        values: Mapping[str, ArrayLike] | None = None,
        wrt: str | Iterable[str] | None = None,
        threads: int | None = None,
        device: str | None = None,
        output: Path | None = None,
        force: bool = False,
        block: int | None = None,
        attrs: Mapping[str, Any] | None = None,
        progress: Progress = False,
    ) -> "xr.Dataset":
        """Integrate the members.

        The bits of a member do not depend on any argument except `values`.

        Parameters
        ----------
        members : int, range or array_like of int, optional
            number of members from the first one on, or a range of indices, or increasing indices;
            replaces the prepared members
        values : dict of array_like, optional
            {name: values of each member} for exactly the parameters prepared as `varied`, in the
            units of the scene: (members,) for a number, (members, 3) for a vector. Labels of pandas
            and xarray are read; an array (3, 3) needs them, or is given as a tuple of columns.
            Grid, scheme and limits stay, and a member beyond them is flagged
        wrt : str or iterable of str, optional
            parameters of the derivatives, in place of the prepared ones; () for none. The result is
            that of a run prepared with them. Kernels of a run prepared with a parameter of the
            body serve all parameters, others the same tables, start or effects
        threads : int, optional
            number of threads; default one for each core that the process may use
        device : str, optional
            CPU or GPU that moves the members, as in `simulate`
        output : path_like, optional
            file to write, as in `simulate`
        force : bool, optional
            replace an existing output
        block : int, optional
            members of a block, a multiple of 32
        attrs : dict, optional
            additional attributes of the result
        progress : bool or callable, optional
            as in `simulate`

        Returns
        -------
        xarray.Dataset
            as in `simulate`; `dataset.encoding["rigidmc"]` holds the cost of the run and the number
            of flagged members

        Warns
        -----
        SceneWarning
            if most members are flagged

        Raises
        ------
        SceneError
            for members that the scene lacks, and for custom classes that have changed since the run
            was prepared
        NoRoom
            if memory or disk is too small
        NoDevice
            if the device does not exist or fails

        Examples
        --------
        >>> run = rm.prepare("dzhanibekov", members=4, t_end=1.0, every=0.5)
        >>> run.run(members=range(2, 4)).member.values.tolist()
        [2, 3]
        """
        self._refuse_changes()
        run = self if wrt is None else self.with_derivatives(wrt)
        if values is not None:
            run = run.with_values(values)
        if members is not None:
            run = run.with_members(select_members(members, run.scene.run, run.plan.model))
        if any(isinstance(q, Varied) for q in run.plan.model.quantities()):
            rule = f"is missing: the run varies {', '.join(run.scene.run.varied or ())}"
            raise OptionError(rule, at="values")
        threads = threads_available() if threads is None else read_count(threads, "threads")
        device = "cpu" if run.plan.scheme is None else resolve_device(device)
        is_streamed = _is_streamed(output)
        size = block or block_of(run.plan, threads, device, is_streamed)
        room = needs(run.layout, run.plan, run.plan.members, size, threads)
        check_resources(room, run.plan.members, threads, output if is_streamed else None)
        began = time.perf_counter()
        run.program(device)
        compiled = time.perf_counter() - began
        sink = run._sink(size, output, force, attrs or {})
        dataset = run._integrate(sink, device, threads, size, progress)
        dataset.encoding["rigidmc"]["compile_seconds"] = compiled
        if note := mostly_flagged(dataset):
            warn(note)
        return dataset

    def _sink(self, block: int, output: Path | None, force: bool, attrs: Mapping[str, Any]) -> Sink:
        """Return what takes the members of a run: a Dataset in memory, or a file."""
        layout = self.layout._replace(block=block)
        attrs = {**(self.choice.attributes() if self.choice else {}), **attrs}
        if output is None:
            return MemorySink(layout, attrs, blank=self._blanks.of(layout))
        from rigidmc.results import file_sinks  # with xarray and netCDF4

        kind = file_sinks.FileSink if _is_streamed(output) else file_sinks.ExportSink
        return kind(output, layout, force, attrs)

    def _integrate(
        self, sink: Sink, device: str, threads: int, block: int, progress: Progress
    ) -> "xr.Dataset":
        """Integrate the members in blocks, and return what the sink made of them."""
        began = time.perf_counter()
        try:
            flagged = compute(
                self.plan,
                self.layout._replace(block=block),
                self.initial,
                self.program(device),
                sink,
                threads=threads,
                block=block,
                units=self.units,
                progress=progress,
            )
            dataset: xr.Dataset = sink.finish()
        except BaseException:
            sink.discard()
            raise
        dataset.encoding[CLASSES] = remember_classes(self.scene) if self.contents else ""
        dataset.encoding["rigidmc"] = {
            "run_seconds": time.perf_counter() - began,
            "flagged": flagged,
            "steps": self.plan.mean_steps,
        }
        return dataset

    def _changed(
        self, plan: Plan, layout: ResultLayout, scene: Scene | None = None
    ) -> "PreparedRun":
        known = self.units, self.sampler, self.pilot, self.choice
        notes = self.step_notes, self.scene_notes
        changed = PreparedRun(scene or self.scene, plan, layout, *known, *notes)
        # neither the code nor the text of a result depends on the values of members
        changed._programs, changed._blanks = self._programs, self._blanks
        changed.contents = self.contents
        return changed


def contents_of_parts(scene: Scene) -> dict[str, str]:
    """Return what the custom classes of a scene read, see `contents_of`."""
    return contents_of({type(part): None for part in user_parts_of(scene)})


def _is_streamed(output: Path | None) -> bool:
    """Return whether blocks go to a file while others run; see `export.is_streamed`."""
    if output is None:
        return False
    from rigidmc.results import export  # with xarray and netCDF4

    return export.is_streamed(output)


@takes_settings
@takes_scene
def prepare(
    scene: Scene,
    integrator: Any = None,
    *,
    members: int | range | NDArray[np.int64] | None = None,
    varied: Iterable[str] = (),
    **settings: Any,
) -> PreparedRun:
    """Prepare a run: check a scene, choose its units, integrator and step, and resolve all names.

    `simulate` is `prepare(...).run(...)`. Prepare a run once if it runs many times.

    The parameters from `dt` on are settings of the run (`Run`) that replace the scene's own; None
    keeps the scene's own.

    Parameters
    ----------
    scene : Scene or path_like
        the scene, its file, or the name of a shipped scene
    integrator : str or integrator, optional
        as in `simulate`
    members : int, range or array_like of int, optional
        as in `simulate`
    varied : iterable of str, optional
        parameters that `run(values=)` replaces, named as in maps and `--set`: a vector,
        "start.omega", or one of its components, "start.omega.3". The scene's own values plan the
        run and settle nothing else: no closed form or symmetry relies on them
    {settings}

    Returns
    -------
    PreparedRun
        with `notes`, `plan`, `choice`, and the methods `compile` and `run`

    Raises
    ------
    SceneError
        for a scene that cannot run

    See Also
    --------
    simulate : prepare a scene and run it once.

    Examples
    --------
    >>> run = rm.prepare("dzhanibekov", members=4, t_end=1.0, every=0.5)
    >>> run.plan.grid.steps
    100
    >>> run.run().sizes["member"]
    4
    """
    whole = scene.run.members
    members, which = range_of_members(members)
    scene = with_settings(scene, members, {**settings, "integrator": integrator})
    if names := (varied,) if isinstance(varied, str) else tuple(varied):
        scene = scene.with_run(varied=nominal_of(scene.model, names))
    count = scene.run.members if which is None else which.size
    if isinstance(members, range):
        # A part of an ensemble has the saves of the whole, so that parts fit together. The result
        # says so: else its own scene, which has few members, would save more.
        count = max(count, whole)
        scene = first_and_last(scene) if count > FEW_MEMBERS else scene
    run = prepare_scene(scene, count)
    return run if which is None else run.with_members(which)


def prepare_scene(scene: Scene, plotted: int = 0) -> PreparedRun:
    """Settle everything about the run of a scene; SceneError if it cannot run.

    plotted : number of members that, if few, save enough to plot; see
        `rigidmc.planning.saves.save_to_plot`
    """
    if not scene.run.varied:
        return _prepare_scene(scene, plotted)
    run, values = _prepare_scene(open_varied(scene), 0), stored_values(scene)
    if values is None:
        return run
    # a result with varied parameters keeps its original plan, and each member has its own values
    first, members = scene.run.first, scene.run.members
    return run.with_values(values).with_members(range(first, first + members))


def _prepare_scene(scene: Scene, plotted: int) -> PreparedRun:
    """Prepare a scene whose varied parameters are already marked; see `prepare_scene`."""
    asked, wrt, recorded = (
        scene,
        parameters_of_run(scene.model, scene.run.wrt),
        make_recording(scene),
    )
    check_scene(scene, recorded)  # first: every step from here on may evaluate custom effects
    units = choose_units(scene)
    if units is not None:
        scene = scale_scene(scene, units.mass, 1.0, units.time)
        recorded = make_recording(scene)
    scene, choice = choose_integrator(settle_saves(scene))
    scene = save_to_plot(scene, recorded, plotted, len(wrt))
    run, model = scene.run, scene.model
    coarse, sampler = model.coarse(), make_sampler(model, run)
    check_starts(coarse, sampler, run.seed)
    monitors = make_monitors(model, recorded, run.seed)
    attitude = has_attitude(model.effects, recorded, monitors)
    pilot = make_pilot(coarse, sampler, attitude)
    if run.integrator == "closed":  # raises if no closed form exists
        closed_form(model, sampler, run.first, whole_lanes(min(PILOT, run.members)))
    plan = make_plan(model, run, scene.integrator, recorded, monitors, attitude, pilot, wrt)
    notes = step_notes(asked.run, plan, units), scene_notes(asked.model, asked.run, plan)
    if units is not None:
        scene = units.original(scene)
        recorded = make_recording(scene)
    layout = make_layout(scene, recorded, plan if units is None else units.back(plan))
    if run.varied:
        scene = close_varied(scene)
        layout = layout._replace(scene=scene)
    known = sampler, pilot if coarse is model else None
    return PreparedRun(scene, plan, layout, units, *known, choice, *notes)
