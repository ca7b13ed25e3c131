"""The main job on one screen: a scene becomes a plan, blocks of members run through the engine,
and a Dataset or a file comes out."""

import os
import sys
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.arrays import placed
from rigidmc.engine.cuda.devices import device as moved_on
from rigidmc.engine.machine import threads_available
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.files.outputs import refuse_existing
from rigidmc.planning.block_size import block_of
from rigidmc.planning.notes import notes
from rigidmc.planning.settle import settled
from rigidmc.progress import Progress, announcing
from rigidmc.results.export import is_streamed
from rigidmc.runs.blocks import run
from rigidmc.runs.capacity import refuse_hopeless
from rigidmc.runs.rehearsal import predicted_seconds
from rigidmc.scene.amounts import counted
from rigidmc.scene.drifts import LARGE, one_way
from rigidmc.scene.once import once
from rigidmc.scene.scene import Scene, takes_scene
from rigidmc.scene.settings import takes_settings


@takes_settings
@takes_scene
def simulate(
    scene: Scene,
    integrator: Any = None,
    *,
    members: int | range | NDArray[np.int64] | None = None,
    threads: int | None = None,
    progress: Progress = False,
    output: str | os.PathLike[str] | None = None,
    force: bool = False,
    block: int | None = None,
    attrs: Mapping[str, Any] | None = None,
    device: str | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Integrate an ensemble.

    The parameters from `dt` on are settings of the run (`Run`), in place of the scene's own; None
    leaves the scene's own. Members that turn non-finite, drift too far or spin too fast for the
    step are flagged in `status` and frozen at their last good state; the other members do not
    change by a bit.

    Parameters
    ----------
    scene : Scene or path_like
        what is run; also its file, or the name of a shipped one
    integrator : str or integrator, optional
        a name of `rigidmc integrators`, or "auto" for the cheapest one that keeps a tolerance, or
        one of your own; the
        choice rests on times measured here, and the result's attributes tell it
    members : int, range or array_like of int, optional
        number of members, or a range of member indices, or rising indices; the bits of a member
        depend on scene, seed and its index alone
    threads : int, optional
        number of threads; by default one for each core that the process may use
    progress : bool or callable, optional
        True for a progress bar; or a function of (member-steps done, all member-steps)
    output : path_like, optional
        netCDF file (.nc) to write block by block, in memory that does not grow; it is opened
        lazily. Or .zarr, .csv, .parquet, written at the end: see `rigidmc.results.export`
    force : bool, optional
        replace an output that exists
    block : int, optional
        members of a block, a multiple of 32; no result depends on it
    attrs : dict, optional
        more attributes of the result, words and numbers
    device : str, optional
        where members move: "cpu", "cuda", "cuda:1" or "auto", see `device`; no result depends on it
    {settings}

    Returns
    -------
    xarray.Dataset
        with dimensions member, time, axis, quat, and with the methods of `ds.rigid`

    Raises
    ------
    SceneError
        for a scene that cannot be run
    OutputExists
        for an output that exists
    NoDevice
        if there is no such device, or it fails

    Examples
    --------
    >>> scene = rm.Scene.load("dzhanibekov")
    >>> ds = rm.simulate(scene, members=4, t_end=1.0, every=0.5)
    >>> ds.omega.dims, ds.omega.shape
    (('time', 'axis', 'member'), (3, 3, 4))
    """
    which = None
    if not isinstance(members, (int, range)):
        members = placed(members, "run", "members")
    if isinstance(members, (list, tuple)):
        members = np.array(members)
    if isinstance(members, np.ndarray):
        which = _indices(members)
        members = range(int(which[0]), int(which[-1]) + 1)
    scene = _with_settings(scene, members, {**settings, "integrator": integrator})
    threads = threads_available() if threads is None else counted(threads, "threads")
    if output is not None:
        refuse_existing(output, force)
    with announcing(progress), moved_on(device):
        file = output if output is not None and is_streamed(output) else None
        ready = settled(scene, threads, file is not None, block)
        if which is not None:
            plan = ready.plan.of(which)
            size = block or block_of(plan, threads, file is not None)
            ready = ready._replace(plan=plan._replace(block=size))
        for note in notes(scene, ready.plan, ready.units):
            _warn(note)
        refuse_hopeless(ready.scene, ready.plan, threads, file)
        facts, expected = dict(attrs or {}), None
        if ready.chosen is not None:
            expected = predicted_seconds(ready.scene, ready.plan, threads, file, ready.chosen)
            facts = {**ready.chosen.attributes(), **facts}
            if ready.chosen.short:
                _warn(ready.chosen.short)
            if progress is True:
                print("\n".join(ready.chosen.lines(ready.plan.members, expected)), file=sys.stderr)
        dataset = run(ready.scene, ready.plan, threads, progress, output, force, facts, ready.units)
        if line := one_way(dataset, LARGE):
            _warn(line)
        if expected is not None:
            dataset.encoding["rigidmc"]["predicted_seconds"] = expected
        return dataset


def _indices(members: NDArray[Any]) -> NDArray[np.int64]:
    """The indices of members as they are asked for; SceneError unless they rise from 0 or more."""
    sound = members.ndim == 1 and members.size and members.dtype.kind in "iu"
    if not sound or members[0] < 0 or not (np.diff(members) > 0).all():
        raise SceneError("run", "members", None, "expected indices of members that rise")
    return members.astype(np.int64)


def _with_settings(scene: Scene, members: int | range | None, settings: Mapping[str, Any]) -> Scene:
    """The scene with the settings of a run, and all numbers that depend on its members."""
    first = settings.get("first")
    if isinstance(members, range):
        if members.step != 1 or members.start < 0 or not members:
            rule = "expected a range of member indices with step 1"
            raise SceneError("run", "members", members, rule)
        first, members = members.start, len(members)
    elif members is None:
        members = (scene if first is None else scene.with_run(first=first)).rows_to_run()
    scene = _changed(scene, **{**settings, "first": first, "members": members})
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    return scene


@once
def _changed(scene: Scene, /, **settings: Any) -> Scene:
    return scene.with_run(**settings)


def _warn(note: str) -> None:
    """Show a note to the caller of `simulate`."""
    warnings.warn(note, SceneWarning, stacklevel=4)
