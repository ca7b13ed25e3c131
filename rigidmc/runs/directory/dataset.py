"""Open a run directory as one Dataset, which dask reads from the shards.

A chunk of its arrays holds the members of a group of shards, so that the graphs of dask stay small:
a task costs more than a small shard.
"""

import hashlib
import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, SceneWarning, in_file
from rigidmc.files.chunks import Part, read_parts
from rigidmc.files.netcdf import open_undecoded, read
from rigidmc.files.outputs import Path
from rigidmc.files.stores import absolute, local_copy
from rigidmc.inputs.amounts import count_text
from rigidmc.results.layout import ResultLayout
from rigidmc.results.reader import check_result
from rigidmc.results.variables import METHOD, NEWER, Variable
from rigidmc.runs.directory.folder import RunDirectory, flagged_count
from rigidmc.runs.directory.load import load_run, method_of_growth, scene_of_run, text_of_run
from rigidmc.scene.user_parts.registry import origin_of

GROWING = ("member", "flagged")  # the dimensions that grow with the shards
GROUP = 2**24  # bytes of the largest variable in a group of shards

Chunked = tuple[tuple[str, ...], Any, dict[str, Any]]  # dims, array, attrs


class _Shard(NamedTuple):
    """A shard to read: its path, index of its first member, and {dimension: size} that grow."""

    path: str
    first: int
    sizes: dict[str, int]


class ShardChunks:
    """The existing shards as chunks of dask arrays.

    paths, members : of each shard, in the order of their members
    """

    def __init__(self, directory: RunDirectory, shards: Mapping[int, str]) -> None:
        """shards : {number: path} of those that exist"""
        self.paths = [absolute(shards[i]) for i in sorted(shards)]
        self.members = [directory.members(i) for i in sorted(shards)]
        self._groups = list[list[_Shard]]()
        self._mark = directory.mark
        # shard names encode contents, so arrays with other contents get other labels in dask
        self._contents = hashlib.sha256("\n".join(self.paths).encode()).hexdigest()[:16]

    def indices(self) -> "pd.Index[int]":
        """Return the indices of the members; a range without gaps takes no memory."""
        members = self.members
        ranges = [part for part in members if isinstance(part, range)]
        if len(ranges) == len(members) and all(
            part.stop == other.start for part, other in pairwise(ranges)
        ):
            return pd.RangeIndex(ranges[0].start, ranges[-1].stop)
        return pd.Index(np.concatenate([np.asarray(part) for part in members]))

    def group(self, variables: Mapping[str, Variable], lengths: Mapping[Any, Any]) -> None:
        """Choose the shards of each chunk, so that the largest of the variables has about GROUP
        bytes in it."""
        each = dict.fromkeys(GROWING, 0)  # bytes of a member, and of a flagged one
        for v in variables.values():
            size = math.prod(lengths[dim] for dim in v.dims if dim not in GROWING)
            for along in {*v.dims} & {*GROWING}:
                each[along] = max(each[along], size * np.dtype(v.dtype).itemsize)
        total, groups = 0, self._groups
        for path, members in zip(self.paths, self.members, strict=True):
            sizes = {"member": len(members), "flagged": flagged_count(path)}
            more = max(each[dim] * count for dim, count in sizes.items())
            if not groups or total + more > GROUP:
                groups.append([])
                total = 0
            groups[-1].append(_Shard(path, int(members[0]), sizes))
            total += more

    def joined(self, name: str, variable: Variable, lengths: Mapping[Any, Any]) -> Chunked:
        """Return (dims, array, attrs) of a variable over members or flagged members, joined."""
        import dask.array as da

        dims, dtype, attrs = variable
        along = next(dim for dim in dims if dim in GROWING)
        counts = tuple(sum(shard.sizes[along] for shard in group) for group in self._groups)
        shards = [shard for group in self._groups for shard in group if shard.sizes[along]]
        shape = tuple(sum(counts) if dim == along else lengths[dim] for dim in dims)
        joined = _Joined(shards, self._mark, name, shape, np.dtype(dtype), dims.index(along), along)
        chunks = tuple(counts if dim == along else (lengths[dim],) for dim in dims)
        nothing = np.empty((0,) * len(dims), dtype)
        label = f"{name}-{self._contents}"
        return dims, da.from_array(joined, chunks, label, meta=nothing), attrs

    def summed(self, name: str, variable: Variable, lengths: Mapping[Any, Any]) -> Chunked:
        """Return (dims, array, attrs) of a variable that is summed over the shards."""
        import dask.array as da

        dims, dtype, attrs = variable
        shape = [lengths[dim] for dim in dims]
        label, count = f"{name}-{self._contents}", len(self._groups)
        graph = {
            (label, j, *[0] * len(shape)): (
                partial(_sum_group, group, self._mark, name, shape, dtype),
            )
            for j, group in enumerate(self._groups)
        }
        sizes = ((1,) * count, *((size,) for size in shape))
        stacked = da.Array(graph, label, sizes, np.dtype(dtype))
        return dims, stacked.sum(0, dtype=dtype), attrs


@dataclass(eq=False)
class _Joined:
    """A variable of shards as one array, which dask reads by slices: only the shards of the members
    that are needed are opened.

    shards : with at least one value;  axis, along : the dimension that grows
    """

    shards: list[_Shard]
    mark: str
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    axis: int
    along: str

    def __post_init__(self) -> None:
        self.ndim = len(self.shape)
        self._ends = np.cumsum([shard.sizes[self.along] for shard in self.shards])

    def __getitem__(self, index: Any) -> NDArray[Any]:
        """Return the values at an index with a slice, number or list of numbers for each axis."""
        axis, where = self.axis, index[self.axis]
        if isinstance(where, slice):
            wanted: Any = range(self.shape[axis])[where]
        else:
            wanted = np.ravel(where) % self.shape[axis]
        low = high = 0
        if len(wanted):
            some = (wanted[0], wanted[-1]) if isinstance(where, slice) else wanted
            low, high = int(np.min(some)), int(np.max(some)) + 1
        begin, out = self._read(low, high)
        if isinstance(where, slice) and where.step in (None, 1):
            place: Any = slice(low - begin, high - begin)
        else:
            numbers = np.asarray(wanted, np.intp) - begin
            place = numbers if isinstance(where, slice) else numbers.reshape(np.shape(where))
        values: NDArray[Any] = out[(*index[:axis], place, *index[axis + 1 :])]
        return values

    def _read(self, low: int, high: int) -> tuple[int, NDArray[Any]]:
        """Return (number of the first value, values) of the shards with the values low to high."""
        axis, ends, shape = self.axis, self._ends, [*self.shape]
        some = slice(0, 0)
        if high > low:
            first, last = np.searchsorted(ends, (low, high - 1), "right")
            some = slice(int(first), int(last) + 1)
        begin = int(ends[some.start - 1]) if some.start else 0
        shape[axis] = int(ends[some.stop - 1]) - begin if some.stop else 0
        out, places, at = np.empty(shape, self.dtype), list[tuple[_Shard, NDArray[Any]]](), 0
        for shard, end in zip(self.shards[some], ends[some], strict=True):
            part = slice(at, int(end) - begin)
            places.append((shard, out[(*[slice(None)] * axis, part)]))
            at = part.stop
        _fill(places, self.mark, self.name)
        return begin, out


def _fill(places: list[tuple[_Shard, NDArray[Any]]], mark: str, name: str) -> None:
    """Fill arrays with a variable of shards; the C library reads those that are unfamiliar."""
    left = read_parts(
        [Part(shard.path, shard.first, shard.sizes["member"], array) for shard, array in places],
        name,
        mark,
    )
    for part in left:
        part.out[...] = _read(part.path, mark, name, part.first, part.out.shape, part.out.dtype)


def _sum_group(
    group: list[_Shard], mark: str, name: str, shape: list[int], dtype: str
) -> NDArray[Any]:
    """Return the sum of a variable over a group of shards, as one element of a stack."""
    total, values = np.zeros(shape, dtype), np.empty(shape, dtype)
    for shard in group:
        _fill([(shard, values)], mark, name)
        total += values
    return total[None]


def _read(
    path: str, mark: str, name: str, first: int, shape: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Read a variable of a shard, and check its mark, first member, shape and type."""
    try:
        values = read(path, "member", name, mark=mark, newer=NEWER)
    except OSError as error:  # the file is gone
        rule = f"cannot be read: {error}; see `rigidmc verify`"
        raise FileError(rule, at=name, file=path) from None
    except FileError as error:
        # a chunk with a wrong checksum, a file that is not netCDF, or a shard of another run
        error.rule = f"cannot be read: {error.rule}; see `rigidmc verify`"
        raise
    array = values[name]
    # ravel: a malicious shard may have one number for all members
    members_agree = values["member"].ravel()[:1].tolist() == [first]
    if not members_agree or (array.shape, array.dtype) != (shape, dtype):
        rule = "has the members of another shard; see `rigidmc verify`"
        raise FileError(rule, at=name, file=path)
    return array


def open_run(path: Path, allow_code: bool = False) -> xr.Dataset:
    """Open a run as one Dataset of the members that exist. Shards are opened only when their values
    are needed.

    Needs dask, which comes with rigidmc[cluster]; without it `consolidate` makes one file.
    Histograms are sums over the shards. Without `allow_code`, a run with custom code opens too: its
    layout is then that of its first shard, and no code runs.
    """
    try:
        import dask.array  # noqa: F401
    except ImportError as error:
        rule = f"is read through dask: pip install 'rigidmc[cluster]', or consolidate it ({error})"
        raise FileError(rule, at="run", value=os.fspath(path)) from None
    directory = RunDirectory(path)
    has_hidden_code = bool(directory.facts["code"]) and not allow_code
    run = None if has_hidden_code else load_run(directory, allow_code)
    present, strays = directory.listed()
    directory.refuse_strays(strays)
    shards = ShardChunks(directory, present)
    if not shards.paths:
        raise FileError("no shard exists yet: resume it first", at="run", value=directory.path)
    if len(shards.paths) < directory.count:
        there = sum(len(members) for members in shards.members)
        warnings.warn(
            f"{directory.path}: {there:,} of {count_text(directory.facts['members'], 'member')}"
            " exist",
            SceneWarning,
            stacklevel=3,
        )
    layout = _of_shard(directory, shards.paths[0]) if run is None else _of_run(run.layout)
    for _, _, attrs in layout.variables.values() if run is not None else ():
        if METHOD in attrs:
            attrs[METHOD] = method_of_growth(directory)
    about = layout.coordinates["member"][2]
    layout.coordinates["member"] = xr.IndexVariable(("member",), shards.indices(), about)
    shards.group(layout.variables, layout.sizes)
    variables = {
        name: (shards.joined if {*variable.dims} & {*GROWING} else shards.summed)(
            name, variable, layout.sizes
        )
        for name, variable in layout.variables.items()
    }
    attrs = {**layout.attributes, **directory.facts["attributes"]}
    dataset = xr.Dataset(variables, layout.coordinates, attrs)
    dataset.encoding["source"] = absolute(directory.path)
    origin_of(dataset)["allow_code"] = allow_code
    return dataset


class _Layout(NamedTuple):
    """The variables of a run, the sizes of their dimensions, its coordinates and attributes."""

    variables: dict[str, Variable]
    sizes: Mapping[Any, Any]
    coordinates: dict[str, Any]
    attributes: dict[str, Any]


def _of_run(layout: ResultLayout) -> _Layout:
    variables = {**layout.by_member, **layout.at_saves, **layout.of_flagged, **layout.of_ensemble}
    for name, (dims, dtype, attrs) in variables.items():
        if layout.is_rounded(name):
            more = {**attrs, "significant_digits": layout.scene.run.digits}
            variables[name] = Variable(dims, dtype, more)
    coordinates = dict[str, Any](layout.axes.coordinates())
    return _Layout(variables, layout.axes.lengths(0), coordinates, layout.attributes())


def _of_shard(directory: RunDirectory, path: str) -> _Layout:
    """Read the layout of a run from one of its shards, without running its code."""
    scene = scene_of_run(directory, None)  # this also checks the scene
    names = ("members", "first") if directory.chosen is None else ()
    text = text_of_run(directory, **{name: int(directory.facts[name]) for name in names})
    with local_copy(path) as file, open_undecoded(file) as shard:
        with in_file(path):
            result, _ = check_result(shard.assign_attrs(scene=text), path)
        variables = {
            str(name): Variable(tuple(map(str, v.dims)), v.dtype.str[1:], dict(v.attrs))
            for name, v in result.data_vars.items()
        }
        coordinates = {str(k): (v.dims, v.values, dict(v.attrs)) for k, v in result.coords.items()}
        told = {name: value for name, value in result.attrs.items() if name != "run"}
        told["title"] = scene.title
        return _Layout(variables, dict(result.sizes), coordinates, told)
