"""The prepared run: everything that is settled before the first step, in one straight line.

A scene is data. `prepare` checks it, chooses units, integrator and step, and resolves all names to
objects. The result runs any number of times, with other members, threads or devices.
"""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from rigidmc.engine.compiler.contents import changes
from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError, PartError, warn
from rigidmc.files.outputs import Path
from rigidmc.inputs.amounts import read_count
from rigidmc.inputs.arrays import Ints
from rigidmc.planning.check import check_scene, check_starts
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.initial import make_pilot, make_sampler
from rigidmc.planning.monitors import make_monitors
from rigidmc.planning.notes import scene_notes, step_notes
from rigidmc.planning.plan import make_plan
from rigidmc.planning.saves import save_to_plot, settle_saves
from rigidmc.planning.tolerance.choose import choose_integrator
from rigidmc.planning.unit_scale import choose_units, scale_run
from rigidmc.processes.progress import Progress
from rigidmc.results.layout import Selection
from rigidmc.results.sinks import Blanks, MemorySink, Sink
from rigidmc.runs.assemble import make_layout
from rigidmc.runs.blocks import compute
from rigidmc.runs.resources import block_of, check_resources
from rigidmc.runs.settled import Machine, SettledRun, mostly_flagged, select_members
from rigidmc.scene.derivatives import parameters_of_run
from rigidmc.scene.parameter import Parameters
from rigidmc.scene.quantities import Varied
from rigidmc.scene.scene import Scene
from rigidmc.scene.user_parts.registry import Origin, contents_of_parts, origin_of, remember_classes
from rigidmc.scene.validation import PILOT
from rigidmc.scene.varied import open_varied, stored_values, with_values, without_mark

if TYPE_CHECKING:
    import xarray as xr


@dataclass(eq=False, repr=False)
class PreparedRun(SettledRun):
    """A run that is ready for its first step, made by `prepare`.

    Parameters
    ----------
    plan : Plan
        the resolved run, in the units of integration
    layout : ResultLayout
        the result, in the units of the scene; it has the scene with the settings of the run, and
        the integrator and step that a tolerance chose
    members : Selection
        the members that move
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
    programs : dict
        the compiled programs of devices, shared by all runs made from this one
    contents : dict
        hashes of what custom classes read
    blanks : Blanks
        results to copy
    varied : dict
        the parameters that vary between runs

    Examples
    --------
    >>> run = rm.prepare("dzhanibekov", members=4, t_end=1.0)
    >>> run.scene.run.integrator, run.notes
    ('rk4', ())
    """

    contents: dict[str, str] = field(default_factory=dict)
    blanks: Blanks = field(default_factory=Blanks)
    varied: Parameters = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.derived = dict[str | tuple[str, ...], PreparedRun]()  # by `wrt` of `run`

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
        >>> rm.prepare("dzhanibekov", members=4, t_end=1.0).compile().members.size
        4
        """
        self._refuse_changes()
        self.program(resolve_device(device))
        return self

    def _refuse_changes(self) -> None:
        """Raise PartError if custom code has changed since the run was prepared."""
        if not self.contents:  # no custom code
            return
        if changed := changes(self.contents, contents_of_parts(self.scene.user_parts)):
            rule = f"{', '.join(changed[:5])}: changed since the run was prepared; prepare it again"
            raise PartError(rule, at="code")

    def with_values(self, values: Mapping[str, ArrayLike]) -> "PreparedRun":
        """Return the run with other values of the varied parameters; see `run`."""
        settings = self.scene.run
        nominal = settings.varied or {}
        model, count = with_values(self.scene.model, self.varied, nominal, values)
        run = settings.model_copy(update={"first": 0, "members": count})
        scene = replace(self.scene, run=run, **model._asdict())
        moving = model if self.units is None else self.units.model(model)
        plan, layout = self.plan._replace(model=moving), self.layout._replace(scene=scene)
        return replace(self, plan=plan, layout=layout, members=Selection(0, count), pilot=None)

    def with_derivatives(self, wrt: str | Iterable[str]) -> "PreparedRun":
        """Return the run with derivatives by other parameters; see `run`."""
        names = wrt if isinstance(wrt, str) else tuple(wrt)
        if names == self.scene.run.wrt:
            return self
        if names not in self.derived:
            run = prepare_scene(self.scene.with_run(wrt=names))
            plan = run.plan.with_kernels_of(self.plan)
            layout = run.layout._replace(columns=plan.columns)
            run = replace(run, plan=plan, layout=layout, members=self.members, choice=self.choice)
            self.derived[names] = run
        return self.derived[names]

    def run(
        self,
        *,
        members: int | range | Ints | None = None,
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
        size = block or block_of(run, threads, device, is_streamed)
        path = output if is_streamed else None
        check_resources(run, run.members.size, size, threads, path)
        began = time.perf_counter()
        run.program(device)
        compiled = time.perf_counter() - began
        sink = run._sink(size, output, force, attrs or {})
        began = time.perf_counter()
        try:
            flagged = compute(run, sink, Machine(threads, device, size, progress))
            dataset: xr.Dataset = sink.finish()
        except BaseException:
            sink.discard()
            raise
        cost = Origin(run_seconds=time.perf_counter() - began, compile_seconds=compiled)
        classes = remember_classes(run.scene.user_parts) if run.contents else ""
        more = Origin(flagged=flagged, steps=run.plan.mean_steps, classes=classes)
        origin_of(dataset).update(cost | more)
        if note := mostly_flagged(dataset):
            warn(note)
        return dataset

    def _sink(self, block: int, output: Path | None, force: bool, attrs: Mapping[str, Any]) -> Sink:
        """Return what takes the members of a run: a Dataset in memory, or a file."""
        layout, members = self.layout, self.members._replace(block=block)
        attrs = {**(self.choice.attributes() if self.choice else {}), **attrs}
        if output is None:
            return MemorySink(layout, members, attrs, blank=self.blanks.of(layout, members))
        from rigidmc.results import export  # with xarray and netCDF4

        kind = export.FileSink if _is_streamed(output) else export.ExportSink
        return kind(output, layout, members, force, attrs)


def _is_streamed(output: Path | None) -> bool:
    """Return whether blocks go to a file while others run; see `export.is_streamed`."""
    if output is None:
        return False
    from rigidmc.results import export  # with xarray and netCDF4

    return export.is_streamed(output)


def prepare_scene(scene: Scene, plotted: int = 0) -> PreparedRun:
    """Settle everything about the run of a scene; SceneError if it cannot run.

    plotted : number of members that, if few, save enough to plot; see
        `rigidmc.planning.saves.save_to_plot`
    """
    nominal = scene.run.varied
    if not nominal:
        return _prepare_scene(scene, plotted)
    opened, varied = open_varied(scene.model, nominal)
    run = replace(_prepare_scene(scene.with_model(opened), 0), varied=varied)
    values = stored_values(scene.model, varied)
    if values is None:
        return run
    # a result with varied parameters keeps its original plan, and each member has its own values
    first, members = scene.run.first, scene.run.members
    return run.with_values(values).with_members(range(first, first + members))


def _prepare_scene(scene: Scene, plotted: int) -> PreparedRun:
    """Prepare a scene whose varied parameters are already marked; see `prepare_scene`."""
    wrt, recorded = parameters_of_run(scene.model, scene.run.wrt), scene.recording
    check_scene(scene, recorded)  # first: every step from here on may evaluate custom effects
    units = choose_units(scene)
    moving = scene if units is None else units.scaled(scene)
    moving, choice = choose_integrator(settle_saves(moving))
    moving = save_to_plot(moving, recorded, plotted, len(wrt))
    run, model = moving.run, moving.model
    recording = recorded if units is None else moving.recording  # times of events differ
    coarse, sampler = model.coarse(), make_sampler(model, run)
    check_starts(coarse, sampler, run.seed)
    monitors = make_monitors(model, recording, run.seed)
    pilot = make_pilot(coarse, sampler, monitors.has_attitude)
    if run.integrator == "closed":  # raises if no closed form exists
        closed_form(model, sampler, run.first, whole_lanes(min(PILOT, run.members)))
    plan = make_plan(model, run, moving.integrator, recording, monitors, pilot, wrt)
    settled = moving if units is None else replace(scene, run=scale_run(run, 1.0 / units.time))
    layout = make_layout(settled, recorded, plan if units is None else units.back(plan))
    if run.varied:
        layout = layout._replace(scene=settled.with_model(settled.model.mapped(without_mark)))
    return PreparedRun(
        plan=plan,
        layout=layout,
        members=Selection(run.first, run.members),
        units=units,
        sampler=sampler,
        pilot=pilot if coarse is model else None,
        choice=choice,
        step_notes=step_notes(scene.run, plan, units),
        scene_notes=scene_notes(scene.model, scene.run, plan),
        contents=contents_of_parts(settled.user_parts),
    )
