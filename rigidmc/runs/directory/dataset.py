"""Open a run directory as one Dataset, which dask reads from the shards."""

import os
import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import xarray as xr

from rigidmc.errors import FileError, SceneWarning, in_file
from rigidmc.files.netcdf import open_undecoded
from rigidmc.files.outputs import Path
from rigidmc.files.stores import absolute, local_copy
from rigidmc.inputs.amounts import count_text
from rigidmc.results.layout import ResultLayout
from rigidmc.results.reader import check_result
from rigidmc.results.variables import METHOD, Variable
from rigidmc.runs.directory.chunks import GROWING, ShardChunks
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.load import (
    load_run,
    method_of_growth,
    scene_of_run,
    text_of_run,
)


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
    found, strays = directory.listed()
    directory.refuse_strays(strays)
    shards = ShardChunks(directory, found)
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
    dataset.encoding |= {"source": absolute(directory.path), "allow_code": allow_code}
    return dataset


class _Layout(NamedTuple):
    """The variables of a run, the sizes of their dimensions, its coordinates and attributes."""

    variables: dict[str, Variable]
    sizes: Mapping[Any, Any]
    coordinates: dict[str, Any]
    attributes: dict[str, Any]


def _of_run(layout: ResultLayout) -> _Layout:
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
    known = dict[str, Any](layout.axes.coordinates())
    return _Layout(variables, layout.axes.lengths(0), known, layout.attributes())


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
