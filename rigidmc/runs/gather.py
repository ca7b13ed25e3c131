"""What a run directory holds: checked, made one file, or read as one Dataset."""

import hashlib
import os
import random
import tempfile
import warnings

import numpy as np

from rigidmc.errors import FileError, SceneWarning
from rigidmc.files.netcdf import open_trusted, read
from rigidmc.files.outputs import refuse_existing
from rigidmc.files.trial import refuse_unreadable
from rigidmc.runs.capacity import refuse_hopeless
from rigidmc.runs.shards import fault_of, planned, scene_of_run
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted
from rigidmc.storage.run_directory import RunDirectory, flagged_of
from rigidmc.storage.schema import (
    attributes,
    coordinates,
    ensemble_variables,
    flagged_variables,
    is_rounded,
    length,
    member_variables,
    saved_variables,
)
from rigidmc.storage.sinks import joined
from rigidmc.storage.writer import Writer


def verify(path, spot=3, allow_code=False, threads=None):
    """What is wrong with a run, in words, [] for nothing: the sum of every shard, how many members its name says are flagged, the scene, and
    some members of each of `spot` shards computed again, to the bit: first, last and one by chance, of shards by chance."""
    spot = counted(spot, "spot", 0)
    directory = RunDirectory(path)
    scene = scene_of_run(directory, allow_code)
    shards, strays = directory.listed()
    faults = {i: fault for i, shard in shards.items() if (fault := fault_of(directory, i, shard))}
    found = [*faults.values(), *(f"{path}: is no shard of this run" for path in strays)]
    whole = sorted(set(shards) - set(faults))
    for i in sorted(random.sample(whole, min(spot, len(whole)))):
        members = directory.members(i)
        for member in sorted({members[0], random.choice(members), members[-1]}):
            if other := _unlike(scene, shards[i], member, threads):
                found.append(other)
                break
    return found


def _unlike(scene, path, member, threads):
    """In words, what of a member differs from what it is computed again, "" for nothing."""
    kept = read(path)
    at = (kept["member"] == member).argmax()
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "again.nc")  # with the digits that files keep
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            again = simulate(scene, members=range(member, member + 1), threads=threads, output=file)
        with again:
            names = [str(name) for name in again.data_vars if "member" in again[name].dims]
        made = read(file, *names)
    wrong = [
        name
        for name in names
        if name not in kept or made[name].tobytes() != kept[name][..., [at]].tobytes()
    ]
    words = "take the file away and resume, if this is the machine that it was computed on"
    return (
        f"{path}: member {member} is not what it is computed again: {', '.join(map(str, wrong))}; {words}"
        if wrong
        else ""
    )


def consolidate(path, output, force=False, allow_code=False):
    """Write a whole run as one file, the same as a run of that size to a file would be; FileError where shards are missing."""
    directory, output = RunDirectory(path), os.fspath(output)
    refuse_existing(output, force)
    *_, told, shown = planned(directory, allow_code)
    if (missing := directory.missing()).size:
        raise FileError(
            "",
            "run",
            directory.path,
            f"{missing.size:,} of {directory.count:,} shards are missing: resume it first",
        )
    refuse_hopeless(told, shown, 1, output)
    directory.refuse_strays()
    more = directory.facts["attributes"]
    writer, sums, pieces = (
        Writer(output, told, shown, force, more),
        dict[str, np.ndarray](),
        list[dict[str, np.ndarray]](),
    )
    shards = directory.shards()
    kept, sums_of, bad = (
        [*member_variables(told, shown.carried), *saved_variables(told)],
        ensemble_variables(told),
        flagged_variables(told),
    )
    try:
        for i in range(directory.count):
            members = directory.members(i)
            if fault := fault_of(directory, i, shards[i]):
                raise FileError(
                    "",
                    "run",
                    directory.path,
                    f"{fault}; `rigidmc resume --repair` computes it again",
                )
            writer.write(members.start, len(members), read(shards[i], *kept))
            for name, values in (read(shards[i], *sums_of) if sums_of else {}).items():
                sums[name] = sums.get(name, 0) + values
            if bad and flagged_of(shards[i]):
                pieces.append(read(shards[i], *bad))
        writer.write_all({**sums, **joined(pieces)})
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    return open_trusted(output)


def open_run(path, allow_code=False):
    """A run as one Dataset of the members that are there, read from the shards when they are asked for: no file is opened now.

    Needs dask, which comes with rigidmc[cluster]; without it `consolidate` makes one file. Histograms are sums over the shards.
    """
    import xarray as xr

    try:
        import dask.array as da
    except ImportError as error:
        rule = f"is read through dask: pip install 'rigidmc[cluster]', or consolidate it ({error})"
        raise FileError("", "run", os.fspath(path), rule) from None
    directory = RunDirectory(path)
    *_, told, shown = planned(directory, allow_code)
    directory.refuse_strays()
    shards = {i: os.path.abspath(shard) for i, shard in directory.shards().items()}
    if not shards:
        raise FileError("", "run", directory.path, "no shard is there yet: resume it first")
    if len(shards) < directory.count:
        there = sum(len(directory.members(i)) for i in shards)
        warnings.warn(
            f"{directory.path}: {there:,} of {told.run.members:,} members are there",
            SceneWarning,
            stacklevel=3,
        )
    done = sorted(shards)
    mark = hashlib.sha256("\n".join(shards.values()).encode()).hexdigest()[
        :16
    ]  # names tell contents: others are other arrays
    ranges = [directory.members(i) for i in done]
    counts = {"member": [len(r) for r in ranges], "flagged": [flagged_of(shards[i]) for i in done]}
    each = {
        **member_variables(told, shown.carried),
        **saved_variables(told),
        **flagged_variables(told),
    }
    variables = {}
    for name, (dims, dtype, attrs) in each.items():
        long = next(d for d in dims if d in counts)
        sizes = tuple(tuple(counts[d]) if d in counts else (length(d, shown),) for d in dims)
        label = f"{name}-{mark}"
        if is_rounded(told, dims, dtype):
            attrs = {**attrs, "significant_digits": told.run.digits}
        graph = {
            (label, *[j if d == long else 0 for d in dims]): (
                _read,
                shards[i],
                directory.mark,
                name,
                ranges[j].start,
                shape,
                dtype,
            )
            if counts[long][j]
            else (np.empty, shape, dtype)
            for j, i in enumerate(done)
            for shape in [[s[j] if d == long else s[0] for d, s in zip(dims, sizes, strict=True)]]
        }
        variables[name] = dims, da.Array(graph, label, sizes, np.dtype(dtype)), attrs
    for name, (dims, dtype, attrs) in ensemble_variables(told).items():
        size = [length(d, shown) for d in dims]
        label = f"{name}-{mark}"
        graph = {
            (label, j, *[0] * len(size)): (
                _read_one,
                shards[i],
                directory.mark,
                name,
                ranges[j].start,
                size,
                dtype,
            )
            for j, i in enumerate(done)
        }
        stacked = da.Array(graph, label, ((1,) * len(done), *((n,) for n in size)), np.dtype(dtype))
        variables[name] = dims, stacked.sum(0, dtype=dtype), attrs
    known = {
        **coordinates(shown),
        "member": (
            ("member",),
            np.concatenate([np.arange(r.start, r.stop) for r in ranges]),
            coordinates(shown)["member"][2],
        ),
    }
    made = xr.Dataset(
        variables, known, {**attributes(told, shown), **directory.facts["attributes"]}
    )
    made.encoding["source"] = os.path.abspath(directory.path)
    return made


def _read(path, mark, name, first, shape, dtype):
    """A variable of a shard, whose mark, first member, shape and type are checked."""
    try:
        refuse_unreadable(path)
        found = read(path, "member", name, mark=mark)
    except OSError as error:  # it is gone
        raise FileError(
            "", name, None, f"cannot be read: {error}; `rigidmc verify` tells more", file=path
        ) from None
    except (
        FileError
    ) as error:  # a chunk with a wrong checksum, a file that is not netCDF, a shard of another run
        error.rule = f"cannot be read: {error.rule}; `rigidmc verify` tells more"
        raise
    values = found[name]
    # of any shape: a hostile shard may have one number for all members
    if found["member"].ravel()[:1].tolist() != [first] or (values.shape, values.dtype) != (
        tuple(shape),
        np.dtype(dtype),
    ):
        raise FileError(
            "",
            name,
            None,
            "has the members of another shard; `rigidmc verify` tells more",
            file=path,
        )
    return values


def _read_one(*shard):
    """A variable of a shard, as one of a stack."""
    return _read(*shard)[None]
