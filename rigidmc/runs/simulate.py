"""The main functions: prepare a scene; run its members, and return a Dataset or write a file; and
compile before any of that."""

import os
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rigidmc.engine.machine import threads_available
from rigidmc.errors import warn
from rigidmc.files.outputs import refuse_existing
from rigidmc.inputs.amounts import read_count
from rigidmc.inputs.arrays import Ints
from rigidmc.planning.saves import FEW_MEMBERS, first_and_last
from rigidmc.processes.progress import Progress, announce
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.settled import range_of_members, with_settings
from rigidmc.scene.drifts import one_way
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.scene.settings import takes_settings
from rigidmc.scene.user_parts.registry import origin_of
from rigidmc.scene.varied import nominal_of

if TYPE_CHECKING:
    import xarray as xr
import time
from typing import NamedTuple

from rigidmc.engine.compile_time import compiled
from rigidmc.engine.compiler.frozen import why_not_cached
from rigidmc.errors import RigidmcError
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.closed_form import closed_values
from rigidmc.scene.vector_distributions.protocol import VectorDistribution


@takes_settings
@takes_scene
def prepare(
    scene: Scene,
    integrator: Any = None,
    *,
    members: int | range | Ints | None = None,
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
    everyone = scene.run.members
    members, which = range_of_members(members)
    scene = with_settings(scene, members, {**settings, "integrator": integrator})
    if names := (varied,) if isinstance(varied, str) else tuple(varied):
        scene = scene.with_run(varied=nominal_of(scene.model, names))
    count = scene.run.members if which is None else which.size
    if isinstance(members, range):
        # A part of an ensemble has the saves of the whole, so that parts fit together. The result
        # says so: else its own scene, which has few members, would save more.
        count = max(count, everyone)
        scene = first_and_last(scene) if count > FEW_MEMBERS else scene
    run = prepare_scene(scene, count)
    return run if which is None else run.with_members(which)


@takes_settings
@takes_scene
def simulate(
    scene: Scene,
    integrator: Any = None,
    *,
    members: int | range | Ints | None = None,
    threads: int | None = None,
    progress: Progress = False,
    output: str | os.PathLike[str] | None = None,
    force: bool = False,
    block: int | None = None,
    attrs: Mapping[str, Any] | None = None,
    device: str | None = None,
    **settings: Any,
) -> "xr.Dataset":
    """Integrate an ensemble.

    The parameters from `dt` on are settings of the run (`Run`) that replace the scene's own; None
    keeps the scene's own. Members that turn non-finite, drift too far or spin too fast for the step
    are flagged in `status` and frozen at their last good state. The bits of the other members do
    not change.

    Parameters
    ----------
    scene : Scene or path_like
        the scene, its file, or the name of a shipped scene
    integrator : str or integrator, optional
        a name from `rigidmc integrators`, a custom integrator, or "auto" for the cheapest one that
        keeps a tolerance; this choice uses timings on this machine, and the attributes of the
        result report it
    members : int, range or array_like of int, optional
        number of members, range of member indices, or increasing indices; the bits of a member
        depend only on scene, seed and its index
    threads : int, optional
        number of threads; default one for each core that the process may use
    progress : bool or callable, optional
        True for a progress bar; or a function of (member-steps done, all member-steps)
    output : path_like, optional
        netCDF file (.nc), written block by block in constant memory and opened lazily; or .zarr,
        .csv, .parquet, written at the end: see `rigidmc.results.export`
    force : bool, optional
        replace an existing output
    block : int, optional
        members of a block, a multiple of 32; results do not depend on it
    attrs : dict, optional
        additional attributes of the result, words and numbers
    device : str, optional
        where members move: "cpu", "cuda" for all GPUs (needs `pip install 'rigidmc[cuda]'`),
        "cuda:1" for one, "auto" for all usable GPUs, if there are any; results do not depend on it
    {settings}

    Returns
    -------
    xarray.Dataset
        with dimensions member, time, axis, quat, and with the methods of `ds.rigid`

    Raises
    ------
    SceneError
        for a scene that cannot run
    OutputExists
        for an existing output
    NoDevice
        if the device does not exist or fails

    Warns
    -----
    SceneWarning
        for the notes of `rigidmc check`, drifts in one direction, and if most members are flagged

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov")
    >>> ds = rm.simulate(scene, members=4, t_end=1.0, every=0.5)
    >>> ds.omega.dims, ds.omega.shape
    (('time', 'axis', 'member'), (3, 3, 4))
    """
    threads = threads_available() if threads is None else read_count(threads, "threads")
    if output is not None:
        refuse_existing(output, force)
    with announce(progress):
        run = prepare(scene, integrator, members=members, **settings)
        for note in run.notes:
            warn(note)
        expected = None
        if run.choice is not None:
            from rigidmc.runs.price import predicted_seconds

            expected = predicted_seconds(run, threads, device, output)
            if run.choice.short:
                warn(run.choice.short)
            if progress is True:
                print("\n".join(run.choice.lines(run.members.size, expected)), file=sys.stderr)
        dataset = run.run(
            threads=threads,
            device=device,
            output=output,
            force=force,
            block=block,
            attrs=attrs,
            progress=progress,
        )
        if line := one_way(dataset):
            warn(line)
        if expected is not None:
            origin_of(dataset)["predicted_seconds"] = expected
        return dataset


class Precompiled(NamedTuple):
    """The code compiled for an integrator.

    seconds : spent on compiling
    compiled : labels of compiled code, () if everything was in the cache
    skipped : why nothing can be compiled, or ""
    """

    integrator: str
    seconds: float
    compiled: tuple[str, ...]
    skipped: str


@takes_scene
def precompile(
    scene: Scene, all_integrators: bool = False, progress: bool = False
) -> list[Precompiled]:
    """Compile the code that a run of a scene needs.

    Parameters
    ----------
    scene : Scene or path_like
        scene to prepare for
    all_integrators : bool, optional
        also compile for integrators that the scene does not name; skip those that cannot run it
    progress : bool, optional
        print a line before compiling

    Returns
    -------
    list of Precompiled
        one for each integrator: its name, seconds spent, labels of compiled code, and the reason
        if it was skipped

    Raises
    ------
    SceneError
        for a scene that cannot run as it is

    Examples
    --------
    >>> [one.integrator for one in rm.precompile(rm.Scene.load("dzhanibekov"))]
    ['rk4']
    """
    with announce(progress):
        results = [_precompile_one(scene)]
        for name in INTEGRATORS if all_integrators else ():
            if name == scene.run.integrator:
                continue
            try:
                results.append(_precompile_one(scene.with_run(integrator=name)))
            except RigidmcError as error:
                results.append(Precompiled(name, 0.0, (), error.rule))
    return results


def _precompile_one(scene: Scene) -> Precompiled:
    began, name, before = time.perf_counter(), scene.run.integrator, len(compiled)
    run = prepare_scene(scene)
    parts = [
        type(part) for part in run.scene.user_parts if not isinstance(part, VectorDistribution)
    ]
    if uncached := {kind.__name__: why for kind in parts if (why := why_not_cached(kind))}:
        rule = "; ".join(
            f"{user} is compiled in every process: {why}" for user, why in uncached.items()
        )
        return Precompiled(name, 0.0, (), rule)
    plan = run.plan
    if plan.scheme is None:
        block, start = run.initial(run.members.first, 1)
        observables = list(plan.recording.recorded.values())
        few = plan.grid.times[:2]
        closed_values(plan.model.effects, observables, block, start, few, plan.grid.clock)
    else:
        run.program()
    return Precompiled(name, time.perf_counter() - began, tuple(compiled[before:]), "")
