"""Recompute members of a result, to the same bits, with more variables saved."""

import os
import warnings
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from rigidmc.errors import FileError, OptionError, SceneError, SceneWarning, in_file
from rigidmc.files.opening import is_zarr
from rigidmc.files.outputs import Path, refuse_existing
from rigidmc.files.stores import is_folder
from rigidmc.inputs.amounts import count_text, read_count
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.physics.observables import OUTCOMES, bare_observables, outputs, own
from rigidmc.physics.observables.saving import summaries
from rigidmc.planning.saves import first_and_last, settle_saves
from rigidmc.planning.steps import make_time_grid
from rigidmc.results.export import write
from rigidmc.results.reader import open_result
from rigidmc.results.variables import METHOD
from rigidmc.runs.directory.dataset import open_run
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.simulate import simulate
from rigidmc.scene.derivatives import derivative_name
from rigidmc.scene.recording import Recording
from rigidmc.scene.save_times import SaveTimes, read_every
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.scene.settings import Run
from rigidmc.scene.toml.read import refuse_twice

# relative difference allowed between an input of a member and its value from scene and seed:
# versions of scipy differ by 1e-12 in quantiles
SAME_INPUT = 1e-6


def rerun(
    source: Path | xr.Dataset,
    member: int | range,
    every: SaveTimes | ArrayLike | None = None,
    save: Iterable[str] | None = None,
    allow_code: bool = False,
    output: Path | None = None,
    force: bool = False,
    **options: Any,
) -> xr.Dataset:
    """Recompute members of a result.

    The new result equals the old one at the times that both have. Its attribute `rerun` states at
    how many times they were compared.

    Parameters
    ----------
    source : path_like or xarray.Dataset
        a result: a file (.nc, .zarr), a run directory or a Dataset
    member : int or range
        index of a member, or a range of indices
    every : float, str or array_like, optional
        time between saves [s], times of saves [s] or saves per turn, as in `simulate`; default as
        in the result. If a time between saves is not a whole number of steps, the nearest whole
        number is used, and a SceneWarning states the resulting time. With per-member steps
        (`turn`), the steps depend on `every`, so there it cannot change
    save : iterable of str, optional
        names of observables; default all, but work only if the result has it
    allow_code : bool, optional
        as in `Scene.load`; not needed for a result that was opened with it
    output : path_like, optional
        also write this file, in a format that `simulate` writes
    force : bool, optional
        replace an existing output
    **options : object
        as in `simulate`

    Returns
    -------
    xarray.Dataset
        like the result of `simulate`

    Raises
    ------
    OptionError
        for a member that the result lacks
    SceneError
        for an `every` that would change the steps

    Warns
    -----
    SceneWarning
        if a value differs, as it may with another version of rigidmc or of a library

    Examples
    --------
    >>> ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
    >>> again = rm.rerun(ds, member=2, every=0.25)
    >>> bool((again.omega.sel(time=ds.time) == ds.omega.sel(member=[2])).all())
    True
    """
    if output is not None:
        refuse_existing(os.fspath(output), force)
    if not isinstance(source, xr.Dataset):
        with open_members(source, allow_code) as result:
            return rerun(result, member, every, save, allow_code, output, force, **options)
    if "member" not in source.coords:
        rule = "expected a result with members: a map or a study stores none"
        raise OptionError(rule, at="source")
    original = scene = scene_of(source, allow_code=allow_code)
    name = source.encoding.get("source", "the result")
    members = chosen_members(member, scene.run, source, name)
    between = scene.run.every
    if every is not None:
        asked = settle_saves(scene.with_run(every=read_every(every, "run.every"))).run.every
        between = _whole_steps(scene.run, asked)
    scene = _saving(scene, save, between, members, every)
    again = simulate(first_and_last(scene), members=members, **options)
    again.attrs["rerun"] = _compared(again, source.sel(member=list(members)), original, name)
    if output is not None:
        write(again, output, force)
    return again


def open_members(path: Path, allow_code: bool = False) -> xr.Dataset:
    """Open a result: a file or a run directory."""
    path = os.fspath(path)
    run = is_folder(path) and not is_zarr(path)
    return open_run(path, allow_code) if run else open_result(path, allow_code)


def chosen_members(member: int | range, run: Run, result: xr.Dataset, name: str) -> range:
    """Return the range of indices that `member` means; OptionError if the result lacks them."""
    if isinstance(member, range):
        members = member
    else:
        first = read_count(member, "member", 0)
        members = range(first, first + 1)
    end = run.first + run.members
    if not members or members.step != 1 or not run.first <= members[0] <= members[-1] < end:
        rule = f"{name} has the members {run.first} to {end - 1}"
        raise OptionError(rule, at="member", value=member)
    with in_file(name):
        refuse_twice(result.member.values)
    if not np.isin(members, result.member.values).all():
        there = f"{result.sizes['member']:,} of its {count_text(run.members, 'member')}"
        raise OptionError(f"{name} has only {there}, not this one", at="member", value=member)
    return members


def _whole_steps(run: Run, every: SaveTimes | None) -> SaveTimes | None:
    """Round a time between saves [s] to the nearest whole number of steps; warn if it changes.
    Listed times stay as they are."""
    free = run.turn is not None or run.integrator == "closed"
    if free or (isinstance(every, float) and every >= run.t_end):
        return every
    grid = make_time_grid(run.t_end, run.dt, run.every)
    if grid.is_shortened and every != run.every:
        rule = (
            f"the last steps of this run are shorter, because its every = {run.every:.10g} s does"
            f" not divide t_end = {run.t_end:.10g} s: other saves would change the steps"
        )
        raise SceneError(rule, at="run.every", value=every)
    if not isinstance(every, float):
        return every
    count = max(1, round(every / run.dt))
    nearest = run.t_end * count / grid.steps
    if every == run.every or abs(every / nearest - 1.0) < 1e-9:
        return every
    note = (
        f"every = {every:.10g} s is not a whole number of steps of {run.dt:.10g} s: saves are"
        f" {nearest:.10g} s apart, {count:,} steps"
    )
    warnings.warn(note, SceneWarning, stacklevel=3)
    return nearest


def _saving(
    scene: Scene, save: Iterable[str] | None, between: SaveTimes | None, members: range, every: Any
) -> Scene:
    """Return the scene of some members with other saves.

    between : time between them, or their times [s];  every : as given by the user
    Raises SceneError if these saves would change the steps.
    """
    run = scene.run
    names = _everything(scene.recording, run.save) if save is None else tuple(save)
    # without work, energy_drift would be another quantity
    work = ("work",) * ("work" in run.save and "work" not in names)
    # a result of selected members has rows for these only
    more: Scene = scene.with_run(
        every=between, save=(*names, *work), keep="full", first=members[0], members=len(members)
    )
    if run.turn is not None and between != run.every:
        rule = (
            f"members have their own steps in each {run.every} s:"
            " another time between saves changes them"
        )
        raise SceneError(rule, at="run.every", value=every)
    free = run.turn is not None or run.integrator == "closed"
    if (
        not free
        and between is not None
        and abs(prepare_scene(more).layout.settings["dt"] / run.dt - 1.0) > 1e-9
    ):
        rule = (
            f"these saves do not fit the steps of {run.dt:.10g} s to t_end = {run.t_end:g} s"
            " without another step"
        )
        raise SceneError(rule, at="run.every", value=every)
    return more


def _everything(recording: Recording, save: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of all observables at save times (of work only if `save` has it), and of the
    scene's observables over all steps."""
    more = dict.fromkeys((*own(recording.observables), *save, *summaries(recording.retained)))
    bare = bare_observables()
    over = (name for name in more if name not in bare)
    return (*(name for name in bare if name != "work" or "work" in save), *over)


class Pair(NamedTuple):
    """A variable that both results have.

    name : of the variable in the first result;  again, before : its values in the new and old one
    times : of the saves, [] for values over all steps; None for values at the start
    """

    name: str
    again: NDArray[Any]
    before: NDArray[Any]
    times: Array | None


def _compared(again: xr.Dataset, result: xr.Dataset, scene: Scene, source: str) -> str:
    """Describe at how many times the saves of both results are bit-identical; warn if they differ.

    scene : of the result
    """
    digits = scene.run.digits
    times: Array = np.empty(0)
    names, apart = list[str](), dict[str, float]()
    others = [str(name) for name in again if _other_method(again, result, str(name))]
    if others:
        rule = f"of {source} were found by another method, not by tangents: not compared"
        warnings.warn(f"{', '.join(others)} {rule}", SceneWarning, stacklevel=3)
    for pair in _pairs(again, result, scene.recording):
        tolerance = 0.0
        if pair.name in others:
            continue
        if pair.times is None:
            refuse_other_inputs(pair, again.member.values, source)
        else:
            names.append(pair.name)
            times = np.union1d(times, pair.times)
            if digits is not None and pair.times.size and not pair.name.endswith("_final"):
                tolerance = 10.0**-digits
        if not _equal(pair, tolerance):
            apart[pair.name] = float(np.nanmax(np.abs(pair.again - pair.before)))
    if apart:
        worst = ", ".join(f"{name} by {off:.1e}" for name, off in apart.items())
        note = f"differs from {source}: {worst}; another version rounds differently"
        warnings.warn(note, SceneWarning, stacklevel=3)
        return f"differs: {worst}"
    if not names:
        return "compared with nothing: the results share no quantity at the same save time"
    how = "to the bit"
    if digits is not None and times.size:
        how = f"to the {digits} digits that were kept"
    count = f" at {times.size:,} times" if times.size else ""
    return f"equal {how}{count} in {', '.join(names)}"


def _other_method(again: xr.Dataset, result: xr.Dataset, name: str) -> bool:
    """Return whether both results have a variable, found by different methods."""
    methods = [ds[name].attrs.get(METHOD, "") for ds in (again, result) if name in ds]
    return len({*methods}) == 2


def refuse_other_inputs(pair: Pair, members: Ints, source: str) -> None:
    """Raise FileError for inputs (..., member) that do not follow from scene and seed.

    Differences from rounding in other versions are allowed.
    """
    again, before = (np.reshape(x, (-1, members.size)) for x in (pair.again, pair.before))
    size = np.nan_to_num(np.fmax(np.abs(again), np.abs(before))).max(0)
    # inputs of impossible bodies and starts are nan
    same = (np.abs(again - before) <= SAME_INPUT * size) | (np.isnan(again) & np.isnan(before))
    other = np.flatnonzero(~same.all(0))
    if other.size:
        rule = (
            f"the inputs of member {members[other[0]]} ({pair.name}) do not follow from this scene"
            " and seed: the result was changed, or combined from several runs"
        )
        raise FileError(rule, at="member", file=source)


def _equal(pair: Pair, tolerance: float) -> bool:
    """Return whether both values are bit-identical, or agree within a relative tolerance."""
    same = np.array_equal(pair.again, pair.before, equal_nan=True)
    return same or bool(tolerance and np.allclose(pair.again, pair.before, tolerance, 0.0, True))


def _pairs(again: xr.Dataset, result: xr.Dataset, recording: Recording) -> Iterator[Pair]:
    """Yield each variable that both results have, even if one stores only part of its saves."""
    over = set[str]()  # variables over all steps
    if again.sizes["time"]:
        over = {name for label, kind in recording.monitored for name in outputs(label, kind)}
        over |= set(map(derivative_name, over))
    parameters = [list(ds.parameter.values) if "parameter" in ds else [] for ds in (again, result)]
    for name in map(str, again.data_vars):
        variable = again[name]
        dims = tuple(map(str, variable.dims))
        if "member" not in dims:  # of the ensemble as a whole
            continue
        if "parameter" in dims and parameters[0] != parameters[1]:
            continue
        if name in over and name in result:
            yield Pair(name, variable.values, _values(result[name], dims), np.empty(0))
        if "time" in dims:
            yield from _saved_pairs(name, variable, result)
        elif name in result and name not in (*over, *OUTCOMES):
            yield Pair(name, variable.values, _values(result[name], dims), None)


def _saved_pairs(name: str, variable: xr.DataArray, result: xr.Dataset) -> Iterator[Pair]:
    """Pair a variable over time with all its saves, including thinned ones and the last one."""
    dims = tuple(map(str, variable.dims))
    for label, clock in ((name, "time"), (f"{name}_thinned", "thinned_time")):
        if label in result:
            times = np.intersect1d(variable.time.values, result[clock].values)
            before = result[label].sel({clock: times})
            before = before.rename({clock: "time"} if clock != "time" else {})
            yield Pair(label, variable.sel(time=times).values, _values(before, dims), times)
    label = f"{name}_final"
    if label in result:
        last = variable.isel(time=-1)
        ends = _values(result[label], tuple(map(str, last.dims)))
        yield Pair(label, last.values, ends, variable.time.values[-1:])


def _values(variable: xr.DataArray, dims: tuple[str, ...]) -> NDArray[Any]:
    """Return the values of a variable with its dimensions in this order."""
    return np.asarray(variable.transpose(*dims).values)
