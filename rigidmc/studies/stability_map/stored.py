"""Maps on disk: a file, or a run directory, which loses nothing when its process is killed.

The directory of an adaptive map grows: resuming it adds pixels until none are needed
(`members_there`, `resume_growing`). A part of a stored map is computed as a new map with the same
request (`zoom_map`).
"""

import os
import time
import warnings
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, OptionError, SceneWarning
from rigidmc.files.netcdf import open_undecoded, read
from rigidmc.files.outputs import Path
from rigidmc.files.stores import is_folder, is_url
from rigidmc.inputs.amounts import read_seconds
from rigidmc.results.variables import NEWER, variables_of
from rigidmc.runs.directory.create import MemberSelection, create
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.load import load_run, scene_of_run
from rigidmc.runs.directory.resume import add_members, resume
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.studies.framework.options import Whole
from rigidmc.studies.stability_map.compute import (
    Progress,
    describe_map,
    finish_map,
    prepare_map,
    run_map,
)
from rigidmc.studies.stability_map.pixels import (
    ASKED,
    COMPUTED,
    COUNTS,
    MapRun,
    PixelCollector,
    Pixels,
    measure_variables,
)
from rigidmc.studies.stability_map.question import (
    MOST,
    MapRequest,
    Resolution,
    columns_and_rows,
    read_stored_request,
)
from rigidmc.studies.stability_map.refine import BEGUN, pixel_members, pixel_multiple, refine

MAP = "map"  # attribute in run.json with the request


def create_map(
    map_run: MapRun,
    path: Path,
    size: float | None = None,
    only: range | None = None,
    threads: int | None = None,
    limit: float | None = None,
    device: str | None = None,
) -> RunDirectory:
    """Create a run directory for a map; arguments and errors as in `create`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # `prepare_map` gave the notes
        request, about = map_run.request, {MAP: map_run.request.text()}
        if request.borders is None:
            return create(map_run.scene, path, size, only, threads, about, None, limit, device)
        nothing = PixelCollector(map_run).pixel_values()
        first = refine(request, nothing, BEGUN)
        shard = pixel_multiple(request) * request.replicas
        chosen = MemberSelection(pixel_members(request, first.wanted), shard, first.level)
        return create(map_run.scene, path, size, None, threads, about, chosen)


def is_map(path: Path) -> bool:
    """Return whether a path is a map: a netCDF file, or a run directory."""
    if is_folder(path):
        run = is_url(path) or os.path.isfile(os.path.join(path, "run.json"))
        return run and MAP in RunDirectory(path).facts["attributes"]
    if not (os.path.isfile(path) and os.fspath(path).lower().endswith(".nc")):
        return False
    with open_undecoded(os.fspath(path)) as file:
        return ASKED in file.attrs


def open_map(path: Path, allow_code: bool = False) -> xr.Dataset:
    """Return the Dataset of a map, see `rigidmc.open`; FileError for anything else."""
    if is_folder(path):
        return map_of_run(path, allow_code)
    return _map_in_file(os.fspath(path), allow_code)


def read_request(source: Path | xr.Dataset, allow_code: bool = False) -> tuple[MapRequest, Scene]:
    """Return the request and scene of a map: a file, a run directory or a Dataset; FileError."""
    if isinstance(source, xr.Dataset):
        name = str(source.encoding.get("source", "the Dataset"))
        request = read_stored_request(str(source.attrs.get(ASKED, "")), name)
        return request, scene_of(source, allow_code=allow_code)
    if is_folder(source):
        directory = RunDirectory(source)
        return request_of(directory), scene_of_run(directory, allow_code)
    with open_undecoded(os.fspath(source)) as file:
        return read_request(file, allow_code)


def _map_in_file(path: str, allow_code: bool) -> xr.Dataset:
    """Read the map in a file, and check its variables against its request and scene."""
    with open_undecoded(path) as file:
        request, scene = read_request(file, allow_code)
        map_run = describe_map(request, scene, variables_of(scene))
        shape = request.shape

        def numbers(name: str, kinds: str) -> NDArray[Any]:
            variable = file.variables.get(name)
            if variable is None or variable.shape != shape or variable.dtype.kind not in kinds:
                raise FileError(f"expected {shape} numbers", at=name, file=path)
            return np.asarray(variable.values).reshape(-1)

        intervals = {}
        for measure in map_run.measures:
            *names, lacking = measure_variables(measure)
            columns = [numbers(name, "f") for name in names]
            none = np.where(np.isnan(columns[0]), np.nan, 0.0)
            columns.append(numbers(lacking, "f") if lacking in file.variables else none)
            intervals[measure.text] = np.stack(columns)
        counts = np.stack([numbers(name, "iu") for name in COUNTS]).astype("i4")
        computed = None if request.borders is None else numbers(COMPUTED, "iu") > 0
        more = {key: file.attrs[key] for key in ("seconds", "missing") if key in file.attrs}
        sound = all(isinstance(value, (float, int, np.number)) for value in more.values())
    if not sound:
        raise FileError("expected a number", at="seconds", file=path)
    return finish_map(map_run, Pixels(intervals, counts), computed).assign_attrs(more)


def request_of(directory: RunDirectory) -> MapRequest:
    """Return the request of a map in a run directory; FileError if it is not a map."""
    text = directory.facts["attributes"].get(MAP)
    if text is None:
        raise FileError("is the run of a scene, not a map", at="map", file=directory.path)
    request = read_stored_request(str(text), directory.path)
    if request.borders is not None:
        return request
    return request._replace(replicas=-(-int(directory.facts["members"]) // request.pixels))


def members_of_pixels(path: Path, replicas: int) -> int:
    """Return the number of members of a map with `replicas` members per pixel."""
    if replicas > (most := 2**53 // MOST**2):
        raise OptionError(f"a pixel has at most {most:,} members", at="members", value=replicas)
    request = request_of(RunDirectory(path))
    if request.borders is not None:
        rule = "an adaptive map has chosen its pixels with fewer members: start a new map"
        raise OptionError(rule, at="members", value=replicas)
    return replicas * request.pixels


def map_of_run(path: Path, allow_code: bool = False) -> xr.Dataset:
    """Return the Dataset of a map from the finished shards, see `rigidmc.stability_map`.

    Pixels use the finished members; the attribute `missing` counts the others, if any. Raises
    FileError for a directory that is not a map, or has no finished shard.
    """
    directory = RunDirectory(path)
    directory.refuse_strays()
    map_run, collected = members_there(directory, allow_code)
    if not directory.shards():
        raise FileError("no shard is finished yet: resume it first", at="run", value=directory.path)
    request, pixels = map_run.request, collected.pixel_values()
    ds = finish_map(map_run, pixels)
    missing = collected.missing()
    if request.borders is not None:
        missing -= request.members - int(directory.facts["members"])
        if not missing and (level := directory.facts.get("growing")):
            missing = refine(request, pixels, level).wanted.size * request.replicas
    return ds.assign_attrs(missing=missing) if missing else ds


def members_there(
    directory: RunDirectory, allow_code: bool = False
) -> tuple[MapRun, PixelCollector]:
    """Return the map of a run directory, and the values of its members from the finished shards."""
    request, run = request_of(directory), load_run(directory, allow_code)
    map_run = describe_map(request, run.scene, run.layout.by_member)
    collected = PixelCollector(map_run)
    names = {name: map_run.by_member[name] for x in map_run.measures for name in x.names}
    sizes = run.layout.axes.lengths(0)
    for i, shard in sorted(directory.shards().items()):
        members = np.asarray(directory.members(i))
        values = read(shard, "member", "status", *names, mark=directory.mark, newer=NEWER)
        variables: dict[str, Any] = {"status": (("member",), values["status"])}
        variables |= {name: (v.dims, values[name], v.attrs) for name, v in names.items()}
        wanted = {**sizes, "member": len(members)}
        fits = all(
            np.shape(x) == tuple(wanted[dim] for dim in dims) for dims, x, *_ in variables.values()
        )
        if not fits or not np.array_equal(values["member"], members):
            rule = "has the members of another shard; see `rigidmc verify`"
            raise FileError(rule, at="shard", value=i, file=shard)
        t_end = {"t_end": map_run.scene.run.t_end}
        collected.take(xr.Dataset(variables, {"member": members, "axis": [1, 2, 3]}, t_end))
    return map_run, collected


def resume_growing(
    directory: RunDirectory,
    max_wall: float | str | None = None,
    only: range | None = None,
    allow_code: bool = False,
    **options: Any,
) -> tuple[RunDirectory, dict[str, int]]:
    """Resume a map, as `rigidmc.runs.directory.resume.resume`; for an adaptive map, repeat: when
    all shards are finished, add those that their results require.

    Raises OptionError for a range of shards of an adaptive map.
    """
    if only is not None and directory.chosen is not None:
        rule = "the next shards of an adaptive map depend on all others: resume without a range"
        raise OptionError(rule, at="shards", value=f"{only.start}:{only.stop}")
    stop = None if max_wall is None else time.monotonic() + read_seconds(max_wall, "max_wall")
    options |= {"only": only, "allow_code": allow_code}
    directory, flagged = resume(directory, max_wall=max_wall, **options)
    while (level := directory.facts.get("growing")) and not directory.missing().size:
        map_run, collected = members_there(directory, allow_code)
        state = refine(map_run.request, collected.pixel_values(), level)
        directory = add_members(
            directory, pixel_members(map_run.request, state.wanted), state.level
        )
        left = None if stop is None else stop - time.monotonic()
        if not state.level or (left is not None and left <= 0.0):
            break
        directory, more = resume(directory, max_wall=left, **options)
        flagged = {word: count + more[word] for word, count in flagged.items()}
    return directory, flagged


Ends = tuple[float, float]


def zoom_map(
    source: Path | xr.Dataset,
    x: Ends,
    y: Ends,
    threads: int | None = None,
    progress: Progress = None,
    allow_code: bool = False,
    resolution: Resolution | None = None,
    device: str | None = None,
) -> xr.Dataset:
    """Recompute a part of a map, with the same scene, settings, measures and members per pixel.

    Parameters
    ----------
    source : path_like or xarray.Dataset
        a map: a netCDF file, a run directory or a Dataset
    x : tuple of float
        range (low, high) of x, in the units of the map
    y : tuple of float
        range (low, high) of y, in the units of the map
    threads : int, optional
        number of threads; by default one for each core that the process may use
    progress : bool or callable, optional
        True for a bar, or a function of (members done, all)
    allow_code : bool, optional
        whether to run the Python files of custom effects
    resolution : int or tuple of int, optional
        pixels per side, or (columns, rows); by default as many as the map has
    device : str, optional
        CPU or GPU that computes the members, as in `simulate`

    Returns
    -------
    xarray.Dataset
        as from `stability_map`

    Raises
    ------
    OptionError
        for ends that are not in order or outside the map, or if every pixel has an impossible body
        or start
    FileError
        for a source that is not a map

    Examples
    --------
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)))
    >>> sides = ("body.moments.1", 1.0, 3.0), ("start.omega.2", 0.1, 1.0)
    >>> whole = rm.stability_map(scene, *sides, "p(flips >= 1)", 2, t_end=1.0)
    >>> rm.zoom_map(whole, (1.0, 1.5), (0.5, 1.0)).x.values.tolist()
    [1.125, 1.375]
    """
    return run_map(prepare_zoom(source, x, y, allow_code, resolution), threads, progress, device)


def prepare_zoom(
    source: Path | xr.Dataset,
    x: Ends,
    y: Ends,
    allow_code: bool = False,
    resolution: Resolution | None = None,
) -> MapRun:
    """Prepare a part of a map, before its first step; arguments and errors as in `zoom_map`."""
    request, scene = read_request(source, allow_code)
    across, upwards = _side("x", request.x, x), _side("y", request.y, y)
    request = request._replace(x=across, y=upwards)
    if resolution is not None:
        columns, rows = columns_and_rows(resolution)
        request = request._replace(columns=columns, rows=rows)
    return prepare_map(request, scene, save=scene.run.save)


def _side(key: str, side: Whole, ends: Ends) -> Whole:
    """Return a side with other ends; OptionError unless these are two numbers within the side."""
    try:
        low, high = map(float, ends)
    except (TypeError, ValueError):
        raise OptionError(f"expected (low, high) of {side[0]}", at=key, value=ends) from None
    if low < side[1] or high > side[2]:
        rule = f"is outside the map, whose {side[0]} ranges from {side[1]:g} to {side[2]:g}"
        raise OptionError(rule, at=key, value=f"{low:g} to {high:g}")
    return side[0], low, high, side[3]
