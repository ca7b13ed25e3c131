"""Open a run directory as one Dataset, which dask reads from the shards."""

import hashlib
import os
import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, SceneWarning, in_file
from rigidmc.files.netcdf import open_undecoded, read
from rigidmc.files.outputs import Path
from rigidmc.files.stores import absolute, local_copy
from rigidmc.results.layout import ResultLayout
from rigidmc.results.reader import check_result
from rigidmc.results.run_directory import RunDirectory, flagged_count
from rigidmc.results.variables import NEWER, Variable
from rigidmc.runs.directory.load import load_run, scene_of_run, text_of_run
from rigidmc.scene.amounts import count_text


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
    own = bool(directory.facts["code"]) and not allow_code
    run = None if own else load_run(directory, allow_code)
    directory.refuse_strays()
    shards = _Chunks(directory)
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
    members = np.concatenate([np.asarray(members) for members in shards.members])
    layout = _of_shard(directory, shards.paths[0]) if run is None else _of_run(run.layout, members)
    layout.coordinates["member"] = (("member",), members, layout.coordinates["member"][2])
    variables = {
        name: (shards.joined if {*variable.dims} & {*_GROW} else shards.summed)(
            name, variable, layout.sizes
        )
        for name, variable in layout.variables.items()
    }
    attrs = {**layout.attributes, **directory.facts["attributes"]}
    dataset = xr.Dataset(variables, layout.coordinates, attrs)
    dataset.encoding |= {"source": absolute(directory.path), "allow_code": allow_code}
    return dataset


_GROW = ("member", "flagged")  # the dimensions that grow with the shards


class _Layout(NamedTuple):
    """The variables of a run, the sizes of their dimensions, its coordinates and attributes."""

    variables: dict[str, Variable]
    sizes: Mapping[Any, Any]
    coordinates: dict[str, Any]
    attributes: dict[str, Any]


def _of_run(layout: ResultLayout, members: NDArray[np.int64]) -> _Layout:
    variables = {
        **layout.by_member,
        **layout.at_saves,
        **layout.of_flagged,
        **layout.of_ensemble,
    }
    for name, (dims, dtype, attrs) in variables.items():
        if layout.is_rounded(name):
            more = {**attrs, "significant_digits": layout.scene.run.digits}
            variables[name] = Variable(dims, dtype, more)
    known = layout.axes.coordinates(members)
    return _Layout(variables, layout.lengths(), known, layout.attributes())


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
        known = {str(k): (v.dims, v.values, dict(v.attrs)) for k, v in result.coords.items()}
        told = {name: value for name, value in result.attrs.items() if name != "run"}
        told["title"] = scene.title
        return _Layout(variables, dict(result.sizes), known, told)


_Chunked = tuple[tuple[str, ...], Any, dict[str, Any]]  # dims, array, attrs


class _Chunks:
    """The existing shards as chunks of dask arrays.

    paths, members : of each shard, in the order of their members
    """

    def __init__(self, directory: RunDirectory) -> None:
        shards = directory.shards()
        self.paths = [absolute(shards[i]) for i in sorted(shards)]
        self.members = [directory.members(i) for i in sorted(shards)]
        self._counts = {
            "member": [len(members) for members in self.members],
            "flagged": [flagged_count(path) for path in self.paths],
        }
        self._mark = directory.mark
        # shard names encode contents, so arrays with other contents get other labels in dask
        self._contents = hashlib.sha256("\n".join(self.paths).encode()).hexdigest()[:16]

    def joined(self, name: str, variable: Variable, lengths: Mapping[Any, Any]) -> _Chunked:
        """Return (dims, array, attrs) of a variable over members or flagged members, joined."""
        import dask.array as da

        dims, dtype, attrs = variable
        counts = self._counts
        along = next(dim for dim in dims if dim in counts)
        sizes = tuple(tuple(counts[dim]) if dim in counts else (lengths[dim],) for dim in dims)
        label, graph = f"{name}-{self._contents}", {}
        for j, count in enumerate(counts[along]):
            key = (label, *[j if dim == along else 0 for dim in dims])
            shape = [s[j if dim == along else 0] for dim, s in zip(dims, sizes, strict=True)]
            task = (_read, *self._shard(j, name), shape, dtype)
            graph[key] = task if count else (np.empty, shape, dtype)
        return dims, da.Array(graph, label, sizes, np.dtype(dtype)), attrs

    def summed(self, name: str, variable: Variable, lengths: Mapping[Any, Any]) -> _Chunked:
        """Return (dims, array, attrs) of a variable that is summed over the shards."""
        import dask.array as da

        dims, dtype, attrs = variable
        shape = [lengths[dim] for dim in dims]
        label, count = f"{name}-{self._contents}", len(self.paths)
        graph = {
            (label, j, *[0] * len(shape)): (_read_one, *self._shard(j, name), shape, dtype)
            for j in range(count)
        }
        sizes = ((1,) * count, *((size,) for size in shape))
        stacked = da.Array(graph, label, sizes, np.dtype(dtype))
        return dims, stacked.sum(0, dtype=dtype), attrs

    def _shard(self, j: int, name: str) -> tuple[str, str, str, int]:
        """Return the first arguments of `_read`."""
        return self.paths[j], self._mark, name, int(self.members[j][0])


def _read(
    path: str, mark: str, name: str, first: int, shape: list[int], dtype: str
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
    if not members_agree or (array.shape, array.dtype) != (tuple(shape), np.dtype(dtype)):
        rule = "has the members of another shard; see `rigidmc verify`"
        raise FileError(rule, at=name, file=path)
    return array


def _read_one(
    path: str, mark: str, name: str, first: int, shape: list[int], dtype: str
) -> NDArray[Any]:
    """Read a variable of a shard as one element of a stack."""
    return _read(path, mark, name, first, shape, dtype)[None]
