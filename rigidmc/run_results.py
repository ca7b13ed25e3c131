"""What a run directory holds: checked, made one file, or read as one Dataset."""

import os
import tempfile

import numpy as np

from rigidmc.capacity import refuse_hopeless
from rigidmc.errors import SceneError
from rigidmc.retention import joined
from rigidmc.run_directory import RunDirectory, damaged
from rigidmc.shards import planned, scene_of_run
from rigidmc.simulation import simulate
from rigidmc.storage import Writer, open_result
from rigidmc.storage.netcdf import read
from rigidmc.storage.schema import (
    attributes,
    coordinates,
    ensemble_variables,
    flagged_variables,
    length,
    member_variables,
    saved_variables,
)


def verify(path, spot=3, allow_code=False, threads=None):
    """What is wrong with a run, in words, [] for nothing: the sum of every shard, how many members its name says are flagged, the scene, and
    `spot` members of each of as many shards computed again, to the bit."""
    directory = RunDirectory(path)
    scene = scene_of_run(directory, allow_code)
    shards, flagged = directory.shards(), directory.flagged()
    bad = {i for i, shard in shards.items() if damaged(shard)}
    found = [f"{shards[i]}: is not what was written: its sum is not that of its name" for i in sorted(bad)]
    whole = sorted(set(shards) - bad)
    for i in whole:
        count = np.count_nonzero(read(shards[i], "status")["status"])
        if count != flagged[i]:
            found.append(f"{shards[i]}: its name says {flagged[i]:,} flagged members, its content {count:,}")
    for i in whole[:: max(1, len(whole) // max(1, spot))][:spot]:
        members = directory.members(i)
        for member in {members[0], members[len(members) // 2], members[-1]}:
            found += _unlike(scene, shards[i], member, threads)
    return found


def _unlike(scene, path, member, threads):
    """What of a member differs from what it is computed again."""
    kept = read(path)
    at = (kept["member"] == member).argmax()
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "again.nc")  # with the digits that files keep
        with simulate(scene, members=range(member, member + 1), threads=threads, output=file) as again:
            names = [name for name in again.data_vars if "member" in again[name].dims]
        made = read(file, *names)
    wrong = [name for name in names if name not in kept or made[name].tobytes() != kept[name][..., [at]].tobytes()]
    return [f"{path}: member {member} is not what it is computed again: {', '.join(map(str, wrong))}"] if wrong else []


def consolidate(path, output, force=False, allow_code=False):
    """Write a whole run as one file, the same as a run of that size to a file would be; SceneError where shards are missing."""
    directory, output = RunDirectory(path), os.fspath(output)
    *_, told, shown = planned(directory, allow_code)
    if missing := directory.missing():
        raise SceneError("", "run", directory.path, f"{len(missing):,} of {directory.count:,} shards are missing: resume it first")
    refuse_hopeless(told, shown, 1, output)
    writer, sums, pieces = Writer(output, told, shown, force), dict[str, np.ndarray](), list[dict[str, np.ndarray]]()
    shards, flagged = directory.shards(), directory.flagged()
    kept, counted, bad = (
        [*member_variables(told, shown.carried), *saved_variables(told)],
        ensemble_variables(told),
        flagged_variables(told),
    )
    try:
        for i in range(directory.count):
            members = directory.members(i)
            writer.write(members.start, len(members), read(shards[i], *kept))
            for name, values in (read(shards[i], *counted) if counted else {}).items():
                sums[name] = sums.get(name, 0) + values
            if bad and flagged[i]:
                pieces.append(read(shards[i], *bad))
        writer.write_all({**sums, **joined(pieces)})
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    return open_result(output)


def open_run(path, allow_code=False):
    """A run as one Dataset of the members that are there, read from the shards when they are asked for: no file is opened now.

    Needs dask, which comes with rigidmc[cluster]; without it `consolidate` makes one file. Histograms are sums over the shards.
    """
    import xarray as xr

    try:
        import dask.array as da
    except ImportError as error:
        rule = f"is read through dask: pip install 'rigidmc[cluster]', or consolidate it ({error})"
        raise SceneError("", "run", os.fspath(path), rule) from None
    directory = RunDirectory(path)
    *_, told, shown = planned(directory, allow_code)
    shards, bad = directory.shards(), directory.flagged()
    done = sorted(shards)
    ranges = [directory.members(i) for i in done]
    counts = {"member": [len(r) for r in ranges], "flagged": [bad[i] for i in done]}
    each = {**member_variables(told, shown.carried), **saved_variables(told), **flagged_variables(told)}
    variables = {}
    for name, (dims, dtype, attrs) in each.items():
        long = next(d for d in dims if d in counts)
        sizes = tuple(tuple(counts[d]) if d in counts else (length(d, shown),) for d in dims)
        label = f"{name}-{directory.path}-{directory.facts['scene'][:16]}"
        graph = {
            (label, *[j if d == long else 0 for d in dims]): (_read, shards[i], name)
            if counts[long][j]
            else (np.empty, [s[j] if d == long else s[0] for d, s in zip(dims, sizes, strict=True)], dtype)
            for j, i in enumerate(done)
        }
        variables[name] = dims, da.Array(graph, label, sizes, np.dtype(dtype)), attrs
    for name, (dims, dtype, attrs) in ensemble_variables(told).items():
        size = [length(d, shown) for d in dims]
        label = f"{name}-{directory.path}"
        graph = {(label, j, *[0] * len(size)): (_read_one, shards[i], name) for j, i in enumerate(done)}
        stacked = da.Array(graph, label, ((1,) * len(done), *((n,) for n in size)), np.dtype(dtype))
        variables[name] = dims, stacked.sum(0, dtype=dtype), attrs
    known = {
        **coordinates(shown),
        "member": (("member",), np.concatenate([np.empty(0, int), *ranges]), coordinates(shown)["member"][2]),
    }
    made = xr.Dataset(variables, known, attributes(told, shown))
    made.encoding["source"] = directory.path
    return made


def _read(path, name):
    """A variable of a shard."""
    return read(path, name)[name]


def _read_one(path, name):
    """A variable of a shard, as one of a stack."""
    return read(path, name)[name][None]
