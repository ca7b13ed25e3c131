"""Runs that survive: started in a directory, resumed after whatever ended them, extended, and made of the parts of a job array."""

import contextlib
import errno
import math
import os
import shutil
import time
import tomllib
import warnings

import numpy as np

from rigidmc.effects import EFFECTS
from rigidmc.effects.own import source_of
from rigidmc.engine.machine import this_machine, threads_available
from rigidmc.errors import FileError, OptionError, OutputExists, SceneWarning
from rigidmc.files.locks import refuse_lockless
from rigidmc.files.outputs import (
    Part,
    content_of,
    folder_beside,
    make_durable,
    naming,
    refuse_unwritable,
    write_bytes,
)
from rigidmc.planning.job import program_of
from rigidmc.planning.notes import notes
from rigidmc.planning.plan import BLOCK
from rigidmc.planning.settle import settled
from rigidmc.planning.stage import stage
from rigidmc.planning.units import told
from rigidmc.progress import announcing
from rigidmc.runs.capacity import refuse_hopeless
from rigidmc.runs.cluster import checked, compute_on
from rigidmc.runs.shards import (
    SHARD,
    compute_shards,
    fault_of,
    members_of,
    memory_of_shards,
    planned,
    refuse_others,
    scene_in,
    scene_of_run,
)
from rigidmc.scene import amounts
from rigidmc.scene.amounts import counted
from rigidmc.scene.quantities import rows
from rigidmc.storage.run_directory import RunDirectory, hash_of, hash_of_file
from rigidmc.storage.run_facts import FORMAT, MOST, rendered
from rigidmc.storage.schema import attributes
from rigidmc.storage.writer import write_columns


def create(scene, path, size=SHARD, only=None, threads=None):
    """Make a run directory for a scene; returns its RunDirectory.

    size : approximate bytes of a shard, which has at least one block of members;  only : the range of shards that will be computed
    threads : how many will compute, which decides how much memory is needed

    Raises OutputExists if there is anything in that folder, OptionError if the run has no shard in `only`, NoRoom if memory or disk
    is too small.
    """
    if not isinstance(size, (int, float)) or not 0.0 < size < math.inf:
        raise OptionError("", "size", size, "expected the bytes of a shard")
    path = _place_of(path)
    if os.path.lexists(path) and not (os.path.isdir(path) and not os.listdir(path)):
        hint = (
            "; `rigidmc resume` goes on with it"
            if os.path.isfile(os.path.join(path, "run.json"))
            else ""
        )
        raise OutputExists(f"{path} exists; nothing was written{hint}")
    refuse_unwritable(os.path.dirname(os.path.abspath(path)))
    refuse_lockless(os.path.dirname(os.path.abspath(path)))
    if scene.run.points == "latin_hypercube" and scene.run.strata is None:
        scene = scene.with_run(strata=scene.run.first + scene.run.members)
    ready = settled(scene, streaming=True)
    mine, shown = told(ready.scene, ready.plan, ready.units)
    for note in notes(scene, ready.plan, ready.units):
        warnings.warn(note, SceneWarning, stacklevel=2)
    block, shard = members_of(mine, shown, size)
    run, count = mine.run, -(-mine.run.members // shard)
    _refuse_beyond(only, count)
    _refuse_many(count)
    threads = threads or threads_available()
    refuse_hopeless(
        mine, shown, threads, path, memory_of_shards(mine, shown, min(shard, run.members), threads)
    )
    versions, machine = this_machine(*["scipy"] * bool(mine.drawn_through()))
    sources = [
        file
        for e in mine.effects
        if type(e) not in EFFECTS.values() and (file := source_of(type(e))) is not None
    ]
    with _made_beside(path) as folder:
        write_bytes(os.path.join(folder, "scene.toml"), attributes(mine, shown)["scene"].encode())
        facts = {
            "format": FORMAT, "scene": "", "columns": "", "code": {file: hash_of_file(file) for file in sources},
            "attributes": {} if ready.chosen is None else ready.chosen.attributes(), "seed": run.seed, "first": run.first, "members": run.members, "shard": shard,
            "block": block, "versions": versions, "machine": machine,
        }  # fmt: skip
        if (count := rows(*mine.quantities())) is not None:
            file = os.path.join(folder, "columns.nc")
            write_columns(file, _columns(mine, count))
            facts["columns"] = hash_of_file(file)
        facts["scene"] = hash_of(scene_in(folder, facts, True))
        write_bytes(os.path.join(folder, "run.json"), rendered(facts).encode())
    return RunDirectory(path)


@contextlib.contextmanager
def _made_beside(path):
    """A new run directory, made beside its place and moved there when it is whole: what is killed meanwhile leaves nothing under that name.
    OutputExists where something appeared there."""
    with folder_beside(path) as folder:
        os.mkdir(os.path.join(folder, "shards"))
        yield folder
        try:
            os.replace(folder, path)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
            raise OutputExists(f"{path} appeared meanwhile; nothing was overwritten") from None
        make_durable(os.path.dirname(os.path.abspath(path)))


def _place_of(path):
    """Where a run directory is to be: a link to an empty folder is that folder."""
    path = os.path.normpath(os.fspath(path))
    return os.path.realpath(path) if os.path.islink(path) else path


def _refuse_many(count):
    if count > MOST:
        raise OptionError(
            "",
            "--shard-size",
            None,
            f"{count:,} shards are too many, {MOST:,} is the most: make them larger",
        )


def _refuse_beyond(only, count):
    """OptionError where of a range of shards there is none."""
    if only is not None and (
        not isinstance(only, range) or only.step != 1 or not only or not 0 <= only[0] < count
    ):
        given = f"{only.start}:{only.stop}" if isinstance(only, range) else only
        raise OptionError(
            "", "--shards", given, f"expected a range of shards; the run has 0 to {count - 1}"
        )


def _columns(scene, count):
    """{name: rows} of what a scene has of one row per member, by the names that its text refers to them with."""

    def referred(value):
        if isinstance(value, dict):
            return (
                [value["stored"]]
                if "stored" in value
                else [name for v in value.values() for name in referred(v)]
            )
        return [name for v in value for name in referred(v)] if isinstance(value, list) else []

    names = sorted(set(referred(tomllib.loads(scene.dumps()))))
    pieces = [stage(scene, low, min(BLOCK, count - low), True)[1] for low in range(0, count, BLOCK)]
    return {name: np.concatenate([piece[name] for piece in pieces], axis=-1) for name in names}


def resume(
    path, threads=None, progress=False, accept=False, max_wall=None, only=None, block=None, allow_code=False, cluster=None
):  # fmt: skip
    """Compute the shards of a run that are missing; (RunDirectory, {status: members} of what was computed).

    accept : go on though versions are others, whose last bits may differ; a processor of another type makes the same bits
    max_wall : time limit ("3h", or seconds): no shard is begun that would not be done by then, judged by the time of the others
        without compiling
    only : a range of shards, of a job array whose directories are merged; it may end beyond the last;  block : members computed at once; nothing depends on it
    cluster : "tcp://host:8786" of a dask scheduler, or "local:4" for so many processes here, see `rigidmc.runs.cluster`
    Raises FileError for what is no run or no longer the same, OutputExists where another process writes, NoRoom where there is none.
    """
    directory = path if isinstance(path, RunDirectory) else RunDirectory(path)
    began = time.monotonic()
    refuse_others(directory, accept)
    _refuse_beyond(only, directory.count)
    threads, block = (
        None if v is None else counted(v, name)
        for name, v in (("threads", threads), ("block", block))
    )
    max_wall = None if max_wall is None else amounts.seconds(max_wall, "max_wall")
    if cluster is not None:
        checked(cluster)
    with directory.locked():
        which = directory.missing()
        which = which if only is None else which[(which >= only.start) & (which < only.stop)]
        left, many = directory.members_of(which), threads or threads_available()
        parts = planned(directory, allow_code, threads or 1, block)
        if which.size and (
            cluster is None or cluster.startswith("local:")
        ):  # workers elsewhere have memory of their own
            here = many if cluster is None else int(cluster.partition(":")[2])
            *_, mine, shown = parts
            more = memory_of_shards(mine, shown, min(directory.facts["shard"], left), here)
            refuse_hopeless(
                mine,
                shown._replace(members=left),
                here,
                os.path.join(directory.path, "shards"),
                more,
            )
        started = time.monotonic()
        with announcing(progress):
            program = (
                program_of(*parts[:2]) if which.size else None
            )  # for the workers of a cluster too, which find it in the cache
        compiled, started = time.monotonic() - started, time.monotonic()
        directory.note(
            event="begun",
            shards=len(which),
            threads=threads,
            cluster=cluster,
            compile_seconds=round(compiled, 3),
        )
        stop = None if max_wall is None else began + max_wall
        try:
            if cluster is not None:
                flagged = compute_on(cluster, directory, which, progress, stop, allow_code, accept)
            else:
                flagged = compute_shards(directory, parts, program, which, many, progress, stop)
        except BaseException as error:
            directory.note(
                event="stopped",
                reason=type(error).__name__,
                seconds=round(time.monotonic() - started, 3),
            )
            raise
        seconds = round(time.monotonic() - started, 3)
        directory.note(
            event="ended",
            left=len(directory.missing()),
            members=sum(flagged.values()),
            flagged=flagged,
            seconds=seconds,
        )
    return directory, flagged


def extend(path, members, accept=False, allow_code=False):
    """Give a run more members; those that are there stay, but for the last shard where that was no whole one. The RunDirectory, to be resumed.

    accept, allow_code : as of `resume`. Whatever is wrong is said before anything is changed.
    """
    directory = RunDirectory(path)
    facts, members = directory.facts, counted(members, "members")
    refuse_others(directory, accept)
    if members <= facts["members"]:
        raise OptionError("run", "members", members, f"the run has {facts['members']:,} already")
    if facts["first"] + members > 2**53:
        raise OptionError(
            "run", "members", members, "are more than 2^53, and could not be told apart"
        )
    directory.refuse_strays()
    _refuse_many(-(-members // facts["shard"]))
    scene = scene_of_run(directory, allow_code)
    if scene.run.points == "latin_hypercube":
        raise OptionError(
            "run",
            "members",
            members,
            "a Latin hypercube has as many members as strata: start a new run",
        )
    if (most := rows(*scene.quantities())) is not None and members + facts["first"] > most:
        raise OptionError("run", "members", members, f"the scene has rows for {most:,} members")
    *_, mine, shown = planned(directory, allow_code)
    more = shown._replace(members=members - facts["members"])
    refuse_hopeless(mine, more, threads_available(), os.path.join(directory.path, "run.json"))
    with directory.locked():
        name, last = (
            os.path.join(directory.path, "run.json"),
            directory.shards().get(directory.count - 1),
        )

        def shorten():
            if facts["members"] % facts["shard"] and last is not None:
                os.unlink(last)
                make_durable(os.path.dirname(last))  # before run.json says that it is longer

        write_bytes(
            name, rendered({**facts, "members": members}).encode(), force=True, before=shorten
        )
        directory.note(event="extended", members=members)
    return RunDirectory(path)


def repair(path):
    """Take away the shards that are damaged or not of their number, to be computed again, and files that are no shards; how many there were."""
    directory = RunDirectory(path)
    with directory.locked():
        shards, strays = directory.listed()
        bad = [shard for i, shard in shards.items() if fault_of(directory, i, shard)]
        bad += [stray for stray in strays if not os.path.isdir(stray) or os.path.islink(stray)]
        for path in bad:
            os.unlink(path)
        directory.note(event="repaired", shards=[os.path.basename(path) for path in bad])
    return len(bad)


def merge(path, others):
    """Gather the shards of other directories of the same run, as job arrays make them; (RunDirectory, how many were copied).

    A `path` that is not there yet becomes such a directory. Raises FileError where one is of another run, or has a shard that is damaged or
    another than the one that is there; what was copied before stays, and is not copied again.
    """
    if isinstance(others, (str, os.PathLike)) or not others:
        raise OptionError("", "others", others, "expected a list of run directories")
    path = _place_of(path)
    others = [RunDirectory(other) for other in others]
    for other in others[1:]:
        _refuse_unlike(others[0], other)
    if not os.path.lexists(path) or (os.path.isdir(path) and not os.listdir(path)):
        refuse_unwritable(os.path.dirname(os.path.abspath(path)))
        refuse_lockless(os.path.dirname(os.path.abspath(path)))
        with _made_beside(path) as folder:
            for name in ("columns.nc", "scene.toml", "run.json"):
                if os.path.isfile(os.path.join(others[0].path, name)):
                    write_bytes(os.path.join(folder, name), content_of(others[0].path, name))
    directory, copied = RunDirectory(path), 0
    for other in others:
        _refuse_unlike(directory, other)
    with directory.locked():
        for other in others:
            have = directory.shards()
            for i, shard in other.shards().items():
                if i in have and os.path.basename(have[i]) != os.path.basename(shard):
                    raise FileError(
                        "",
                        "run",
                        other.path,
                        f"has another shard {i} than {path}; `rigidmc verify` tells which is right",
                    )
                if i in have:
                    continue
                if fault := fault_of(other, i, shard):
                    raise FileError("", "run", other.path, fault)
                final = os.path.join(path, "shards", os.path.basename(shard))
                with Part(final, True) as part, naming(final, part):
                    shutil.copyfile(shard, part)
                copied += 1
        directory.note(event="merged", shards=copied, others=[other.path for other in others])
    return directory, copied


def _refuse_unlike(one, other):
    """FileError where two directories are not of the same run."""
    apart = [key for key, value in one.facts.items() if other.facts[key] != value]
    apart += [
        name
        for name in ("scene.toml", "columns.nc")
        if content_of(one.path, name) != content_of(other.path, name)
    ]
    if apart:
        raise FileError(
            "", "run", other.path, f"is of another run than {one.path}: {', '.join(apart)} differ"
        )
