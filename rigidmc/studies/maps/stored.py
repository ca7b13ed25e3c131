"""Maps that are stored: in a run directory, which loses nothing when it is killed, or in a file."""

import os
import warnings
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, OptionError, SceneWarning
from rigidmc.files.netcdf import open_undecoded, read
from rigidmc.files.outputs import Path
from rigidmc.runs.create import Chosen, create
from rigidmc.runs.reopen import planned, scene_of_run
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.storage.run_directory import RunDirectory
from rigidmc.storage.schema import NEWER, lengths
from rigidmc.studies.maps.catalogue import with_theory
from rigidmc.studies.maps.pixels import ASKED, COMPUTED, COUNTS, Collected, Pixels, names_of
from rigidmc.studies.maps.question import MOST, Question, stored_question
from rigidmc.studies.maps.refine import BEGUN, members_of, refined, unit
from rigidmc.studies.maps.stability_map import Prepared, described, finished

MAP = "map"  # of the question, among the attributes in run.json


def create_map(
    ready: Prepared,
    path: Path,
    size: float | None = None,
    only: range | None = None,
    threads: int | None = None,
    limit: float | None = None,
) -> RunDirectory:
    """Make a run directory for a map; the arguments and errors are those of `create`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # `prepared` gave the notes
        asked, about = ready.question, {MAP: ready.question.text()}
        if asked.borders is None:
            return create(ready.scene, path, size, only, threads, about, None, limit)
        nothing = Collected(asked, ready.measures).pixel_values()
        first = refined(asked, nothing, BEGUN)
        shard = unit(asked) * asked.replicas
        chosen = Chosen(members_of(asked, first.wanted), shard, first.level)
        return create(ready.scene, path, size, None, threads, about, chosen)


def is_map(path: Path) -> bool:
    """Whether a path is a map: a netCDF file, or a run directory."""
    if os.path.isdir(path):
        run = os.path.isfile(os.path.join(path, "run.json"))
        return run and MAP in RunDirectory(path).facts["attributes"]
    if not (os.path.isfile(path) and os.fspath(path).lower().endswith(".nc")):
        return False
    with open_undecoded(os.fspath(path)) as file:
        return ASKED in file.attrs


def open_map(path: Path, allow_code: bool = False) -> xr.Dataset:
    """Open a map.

    Parameters
    ----------
    path : path_like
        a netCDF file of a map, or the run directory of one, also of one that has not ended
    allow_code : bool, optional
        whether to run the Python files of a user's own effects

    Returns
    -------
    xarray.Dataset
        as of `stability_map`. If members of a run directory are missing, pixels have the others,
        and `missing` in the attributes counts them

    Raises
    ------
    FileError
        for anything else, and for a run directory without a shard

    Examples
    --------
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)))
    >>> sides = ("body.moments.1", 1.0, 3.0), ("start.omega.2", 0.1, 1.0)
    >>> rm.stability_map(scene, *sides, "p(flips >= 1)", 2, t_end=1.0).to_netcdf("map.nc")
    >>> dict(rm.open_map("map.nc").sizes)
    {'y': 2, 'x': 2}
    """
    if os.path.isdir(path):
        return map_of_run(path, allow_code)
    return _map_in_file(os.fspath(path), allow_code)


def asked_of(source: Path | xr.Dataset, allow_code: bool = False) -> tuple[Question, Scene]:
    """What a map asks, and of which scene: a file, a run directory or a Dataset; FileError."""
    if isinstance(source, xr.Dataset):
        name = str(source.encoding.get("source", "the Dataset"))
        asked = stored_question(str(source.attrs.get(ASKED, "")), name)
        return asked, scene_of(source, allow_code=allow_code)
    if os.path.isdir(source):
        directory = RunDirectory(source)
        return question_of(directory), scene_of_run(directory, allow_code)
    with open_undecoded(os.fspath(source)) as file:
        return asked_of(file, allow_code)


def _map_in_file(path: str, allow_code: bool) -> xr.Dataset:
    """The map in a file: its numbers, laid out as what it asks of its scene demands."""
    with open_undecoded(path) as file:
        asked, scene = asked_of(file, allow_code)
        ready = described(asked, scene, False)
        shape = asked.shape

        def numbers(name: str, kinds: str) -> NDArray[Any]:
            variable = file.variables.get(name)
            if variable is None or variable.shape != shape or variable.dtype.kind not in kinds:
                raise FileError("", name, None, f"expected {shape} numbers", file=path)
            return np.asarray(variable.values).reshape(-1)

        intervals = {}
        for one in ready.measures:
            *names, lacking = names_of(one)
            found = [numbers(name, "f") for name in names]
            none = np.where(np.isnan(found[0]), np.nan, 0.0)
            found.append(numbers(lacking, "f") if lacking in file.variables else none)
            intervals[one.text] = np.stack(found)
        counts = np.stack([numbers(name, "iu") for name in COUNTS]).astype("i4")
        computed = None if asked.borders is None else numbers(COMPUTED, "iu") > 0
        more = {key: file.attrs[key] for key in ("seconds", "missing") if key in file.attrs}
        sound = all(isinstance(value, (float, int, np.number)) for value in more.values())
    if not sound:
        raise FileError("", "seconds", None, "expected a number", file=path)
    whole = finished(ready, Pixels(intervals, counts), computed)
    return with_theory(whole, asked.name).assign_attrs(more)


def question_of(directory: RunDirectory) -> Question:
    """What the map of a run directory asks; FileError if it is no map."""
    text = directory.facts["attributes"].get(MAP)
    if text is None:
        raise FileError("", "map", None, "is the run of a scene, and no map", file=directory.path)
    asked = stored_question(str(text), directory.path)
    if asked.borders is not None:
        return asked
    return asked._replace(replicas=-(-int(directory.facts["members"]) // asked.pixels))


def members_of_pixels(path: Path, replicas: int) -> int:
    """How many members a map has with so many in each pixel."""
    if replicas > (most := 2**53 // MOST**2):
        raise OptionError("", "members", replicas, f"a pixel has at most {most:,} members")
    asked = question_of(RunDirectory(path))
    if asked.borders is not None:
        rule = "an adaptive map chose its pixels by the members that these have: start a new map"
        raise OptionError("", "members", replicas, rule)
    return replicas * asked.pixels


def map_of_run(path: Path, allow_code: bool = False) -> xr.Dataset:
    """The Dataset of a map from the shards that exist, see `rigidmc.stability_map`.

    A pixel has the members that are there; `missing` in the attributes counts the others, if any.
    Raises FileError for a directory that is no map, or has no shard yet.
    """
    directory = RunDirectory(path)
    directory.refuse_strays()
    ready, collected = there(directory, allow_code)
    if not directory.shards():
        raise FileError("", "run", directory.path, "no shard is there yet: resume it first")
    asked, pixels = ready.question, collected.pixel_values()
    found = with_theory(finished(ready, pixels), asked.name)
    missing = collected.missing()
    if asked.borders is not None:
        missing -= asked.members - int(directory.facts["members"])
        if not missing and (level := directory.facts.get("growing")):
            missing = refined(asked, pixels, level).wanted.size * asked.replicas
    return found.assign_attrs(missing=missing) if missing else found


def there(directory: RunDirectory, allow_code: bool = False) -> tuple[Prepared, Collected]:
    """The map of a run directory, and the numbers of its members from the shards that exist."""
    asked, run = question_of(directory), planned(directory, allow_code)
    ready = described(asked, run.original, run.shown.carried)
    collected = Collected(asked, ready.measures)
    names = {name: ready.known[name] for one in ready.measures for name in one.names}
    sizes = lengths(run.shown)
    for i, shard in sorted(directory.shards().items()):
        members = np.asarray(directory.members(i))
        values = read(shard, "member", "status", *names, mark=directory.mark, newer=NEWER)
        variables: dict[str, Any] = {"status": (("member",), values["status"])}
        variables |= {name: (v.dims, values[name], v.attrs) for name, v in names.items()}
        wanted = {**sizes, "member": len(members)}
        fits = all(
            np.shape(one) == tuple(wanted[dim] for dim in dims)
            for dims, one, *_ in variables.values()
        )
        if not fits or not np.array_equal(values["member"], members):
            rule = "has the members of another shard; `rigidmc verify` tells more"
            raise FileError("", "shard", i, rule, file=shard)
        t_end = {"t_end": ready.scene.run.t_end}
        collected.take(xr.Dataset(variables, {"member": members, "axis": [1, 2, 3]}, t_end))
    return ready, collected
