"""Gather the shards of a run directory: verify, repair, merge with the shards of other directories,
and write one file."""

import os
import random
import tempfile
import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from rigidmc.errors import FileError, OptionError, SceneWarning
from rigidmc.files.netcdf import open_trusted, read
from rigidmc.files.opening import copy
from rigidmc.files.outputs import (
    PartialFile,
    Path,
    content_of,
    naming_the_path,
    refuse_existing,
    write_bytes,
)
from rigidmc.files.stores import is_url, local_copy
from rigidmc.inputs.amounts import count_text, read_count
from rigidmc.planning.saves import first_and_last
from rigidmc.results.layout import ResultLayout
from rigidmc.results.sinks import Arrays, concat_flagged
from rigidmc.results.variables import NEWER
from rigidmc.results.writer import Writer
from rigidmc.runs.directory.create import is_free, new_directory, place_of, refuse_unusable
from rigidmc.runs.directory.folder import CHOSEN, RunDirectory, flagged_count
from rigidmc.runs.directory.load import block_of_run, load_run, scene_of_run
from rigidmc.runs.directory.shards import fault_of
from rigidmc.runs.resources import check_resources
from rigidmc.runs.simulate import simulate
from rigidmc.scene.scene import Scene


def verify(
    path: Path, spot: int = 3, allow_code: bool = False, threads: int | None = None
) -> list[str]:
    """Return the faults of a run, in words, or [] if there are none.

    Checks the checksum of every shard, the number of flagged members in its name, and the scene.
    For `spot` random shards, three members are recomputed, to the bit: the first, the last and a
    random one. Without recomputing, custom code needs no `allow_code`.
    """
    spot = read_count(spot, "spot", 0)
    directory = RunDirectory(path)
    scene = scene_of_run(directory, allow_code if spot or allow_code else None)
    shards, strays = directory.listed()
    bad = {i: fault for i, shard in shards.items() if (fault := fault_of(directory, i, shard))}
    faults = [*bad.values(), *(f"{path}: is not a shard of this run" for path in strays)]
    sound = sorted(set(shards) - set(bad))
    for i in sorted(random.sample(sound, min(spot, len(sound)))):
        members = directory.members(i)
        some = members[0], members[random.randrange(len(members))], members[-1]
        for member in sorted(set(map(int, some))):
            if fault := _unlike(scene, shards[i], member, threads):
                faults.append(fault)
                break
    return faults


def _unlike(scene: Scene, path: str, member: int, threads: int | None) -> str:
    """Describe which values of a member differ when recomputed; "" if none do."""
    stored = read(path)
    at = (stored["member"] == member).argmax()
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "again.nc")  # a file, because files may keep fewer digits
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            alone, stated = range(member, member + 1), first_and_last(scene)
            again = simulate(stated, members=alone, threads=threads, output=file)
        with again:
            names = [str(name) for name in again.data_vars if "member" in again[name].dims]
        values = read(file, *names)
    wrong = [
        name
        for name in names
        if (name not in stored and name not in NEWER)
        or (name in stored and values[name].tobytes() != stored[name][..., [at]].tobytes())
    ]
    if not wrong:
        return ""
    cure = "delete the file and resume, if this is the machine that computed it"
    return f"{path}: member {member} differs when recomputed: {', '.join(wrong)}; {cure}"


def repair(path: Path) -> int:
    """Delete shards that are damaged, misnamed or of another run, and files that are not shards;
    return how many were deleted. The next resume computes the missing shards."""
    directory = RunDirectory(path)
    with directory.locked():
        shards, strays = directory.listed()
        bad = [shard for i, shard in shards.items() if fault_of(directory, i, shard)]
        bad += [stray for stray in strays if not os.path.isdir(stray) or os.path.islink(stray)]
        for file in bad:
            directory.delete(file)
        directory.note(event="repaired", shards=[os.path.basename(file) for file in bad])
    return len(bad)


def merge(path: Path, others: Sequence[Path]) -> tuple[RunDirectory, int]:
    """Copy the shards of other directories of the same run, such as the tasks of a job array.

    Returns (RunDirectory, number of copied shards). If `path` does not exist, it becomes a
    directory of this run. Raises FileError if a directory is of another run, or has a shard that is
    damaged or differs from the one in `path`. Shards copied before stay, and are not copied again.
    """
    if isinstance(others, (str, os.PathLike)) or not others:
        raise OptionError("expected a list of run directories", at="others", value=others)
    path = place_of(path)
    parts = [RunDirectory(other) for other in others]
    for part in parts[1:]:
        _refuse_unlike(parts[0], part)
    if is_free(path):
        if not is_url(path):
            refuse_unusable(path)
        with new_directory(path) as folder:
            for name in ("columns.nc", CHOSEN, "scene.toml", "run.json"):
                if os.path.isfile(os.path.join(parts[0].folder, name)):
                    write_bytes(os.path.join(folder, name), content_of(parts[0].folder, name))
    directory = RunDirectory(path)
    for part in parts:
        _refuse_unlike(directory, part)
    with directory.locked():
        copied = sum(_copy_shards(part, directory) for part in parts)
        directory.note(event="merged", shards=copied, others=[part.path for part in parts])
    return directory, copied


def _copy_shards(source: RunDirectory, target: RunDirectory) -> int:
    """Copy shards that a run directory lacks; return how many. Shard names encode contents."""
    copied, have = 0, target.shards()
    for i, shard in source.shards().items():
        if i in have:
            if os.path.basename(have[i]) != os.path.basename(shard):
                rule = (
                    f"has a different shard {i} than {target.path};"
                    " `rigidmc verify` reports which one is right"
                )
                raise FileError(rule, at="run", value=source.path)
            continue
        if fault := fault_of(source, i, shard):
            raise FileError(fault, at="run", value=source.path)
        final = os.path.join(target.folder, "shards", os.path.basename(shard))
        with (
            local_copy(shard) as file,
            PartialFile(final, True) as unfinished,
            naming_the_path(final, unfinished),
        ):
            copy(file, unfinished)
        target.publish(final)
        copied += 1
    return copied


def _refuse_unlike(first: RunDirectory, other: RunDirectory) -> None:
    """Raise FileError if two directories are not of the same run."""
    keys = {**first.facts, **other.facts}
    apart = [key for key in keys if first.facts.get(key) != other.facts.get(key)]
    apart += [
        name
        for name in ("scene.toml", "columns.nc")
        if content_of(first.folder, name) != content_of(other.folder, name)
    ]
    if apart:
        rule = f"is of another run than {first.path}: {', '.join(apart)} differ"
        raise FileError(rule, at="run", value=other.path)


def consolidate(
    path: Path, output: Path, force: bool = False, allow_code: bool = False
) -> xr.Dataset:
    """Write a complete run as one file, equal to the file of a run with `output`; FileError if
    shards are missing."""
    directory, output = RunDirectory(path), os.fspath(output)
    refuse_existing(output, force, "netCDF files")
    run = load_run(directory, allow_code)
    if (missing := directory.missing()).size:
        shards = count_text(directory.count, "shard")
        rule = f"{missing.size:,} of {shards} are missing: resume it first"
        raise FileError(rule, at="run", value=directory.path)
    block = block_of_run(directory, run)
    members = run.members._replace(block=block)
    check_resources(run, members.size, block, 1, output)
    directory.refuse_strays()
    attrs = {**run.layout.attributes(), **directory.facts["attributes"]}
    writer = Writer(output, run.layout, members, attrs, force)
    try:
        _write_shards(writer, directory, run.layout)
        writer.finish()
    except BaseException:
        writer.discard()
        raise
    return open_trusted(output)


def _write_shards(writer: Writer, directory: RunDirectory, layout: ResultLayout) -> None:
    """Write the shards of a complete run, and the variables summed or joined over them."""
    shards, by_member = directory.shards(), [*layout.by_member, *layout.at_saves]
    summed, of_flagged = layout.of_ensemble, layout.of_flagged
    sums, pieces = dict[str, np.ndarray](), list[Arrays]()
    for i in range(directory.count):
        places = directory.places(i)
        if fault := fault_of(directory, i, shards[i]):
            rule = f"{fault}; `rigidmc resume --repair` recomputes it"
            raise FileError(rule, at="run", value=directory.path)
        with local_copy(shards[i]) as shard:
            of_members = read(shard, *by_member, newer=NEWER)
            writer.write(places.start, len(places), of_members)
            for name, values in (read(shard, *summed) if summed else {}).items():
                sums[name] = sums.get(name, 0) + values
            if of_flagged and flagged_count(shard):
                pieces.append(read(shard, *of_flagged))
    writer.write_all({**sums, **concat_flagged(pieces)})
