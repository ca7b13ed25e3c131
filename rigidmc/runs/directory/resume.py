"""Resume runs after any interruption, and extend them by more members."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sized
from typing import Any

import numpy as np

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path, make_durable, write_bytes
from rigidmc.inputs.amounts import count_text, read_count, read_seconds
from rigidmc.inputs.arrays import Ints
from rigidmc.processes.progress import Progress, announce
from rigidmc.processes.threads import Late, ending
from rigidmc.runs.directory.cluster import Resume, compute_on, parse_cluster
from rigidmc.runs.directory.create import refuse_many, refuse_shards_beyond
from rigidmc.runs.directory.facts import facts_text, selection_facts
from rigidmc.runs.directory.folder import CHOSEN, RunDirectory
from rigidmc.runs.directory.load import (
    block_of_run,
    check_versions,
    load_run,
    refuse_study,
    scene_of_run,
)
from rigidmc.runs.directory.shards import compute_shards, memory_of_shards
from rigidmc.runs.prepare import PreparedRun
from rigidmc.runs.resources import check_resources
from rigidmc.runs.settled import Machine
from rigidmc.scene.quantities import count_rows


def resume(
    path: Path | RunDirectory,
    threads: int | None = None,
    progress: Progress = False,
    accept: bool = False,
    max_wall: float | str | None = None,
    only: range | None = None,
    block: int | None = None,
    allow_code: bool = False,
    cluster: str | None = None,
    device: str | None = None,
) -> tuple[RunDirectory, dict[str, int]]:
    """Compute the missing shards of a run; return (RunDirectory, {status: members computed}).

    accept : continue even if versions differ from those at the start, which may change last bits;
        another type of CPU gives the same bits
    max_wall : time limit ("3h", or seconds), after which unfinished work is stored and the next
        resume continues from there. On a cluster, no shard starts that would end later
    only : a range of shards, as in a job array whose directories are merged; it may end beyond the
        last shard
    block : members computed at once; results do not depend on it
    cluster : "tcp://host:8786" of a dask scheduler, or "local:4" for four processes on this
        machine, see `rigidmc.runs.directory.cluster`
    device : where members move, on this machine or on the workers of a cluster; as in `simulate`

    Raises FileError if the directory is not a run, is damaged or was changed, OutputExists if
    another process writes to it, NoRoom if memory or disk is too small.
    """
    directory = path if isinstance(path, RunDirectory) else RunDirectory(path)
    refuse_shards_beyond(only, directory.count)
    block = None if block is None else read_count(block, "block")
    how = read_resume(only, max_wall, cluster, accept, allow_code, device)
    with resumed(directory, how) as numbers:
        run, device = load_run(directory, allow_code), resolve_device(device)
        block = block_of_run(directory, run, device, block)
        many = threads_available() if threads is None else read_count(threads, "threads")
        machine = Machine(many, device, block, progress)
        if numbers.size:
            _refuse_hopeless(directory, run, numbers, machine, cluster)
        started = time.monotonic()
        try:
            with announce(progress), ending(how.stop):
                # also for the workers of a cluster, which find it in the cache
                if numbers.size:
                    run.program(device)
        except Late:
            numbers = numbers[:0]
        took = round(time.monotonic() - started, 3)

        def compute() -> dict[str, int]:
            if cluster is None:
                return compute_shards(directory, run, numbers, machine, how.stop)
            return compute_on(cluster, directory, numbers, how, progress)

        begun = {"threads": threads, "cluster": cluster, "compile_seconds": took}
        return directory, keep_journal(directory, numbers, compute, **begun)


def read_resume(
    only: range | None,
    max_wall: float | str | None,
    cluster: str | None,
    accept: bool,
    allow_code: bool,
    device: str | None,
) -> Resume:
    """Return how a run goes on from now; OptionError for a wrong time or cluster."""
    stop = None if max_wall is None else time.monotonic() + read_seconds(max_wall, "max_wall")
    if cluster is not None:
        parse_cluster(cluster)
    return Resume(only, stop, cluster, accept, allow_code, device)


@contextlib.contextmanager
def resumed(directory: RunDirectory, how: Resume) -> Iterator[Ints]:
    """Hold the lock of a run directory, and yield the numbers of its missing shards; FileError for
    other versions than those at the start."""
    check_versions(directory, how.accept)
    with directory.locked():
        yield missing_of(directory, how.only)


def missing_of(directory: RunDirectory, only: range | None) -> Ints:
    """Return the numbers of the missing shards, or of the missing ones in a range."""
    return directory.missing() if only is None else directory.missing_in(only)


def _refuse_hopeless(
    directory: RunDirectory, run: PreparedRun, numbers: Ints, machine: Machine, cluster: str | None
) -> None:
    """Raise NoRoom if shards of a run need more memory or disk than is free here. Workers on other
    computers have their own memory, so nothing is refused for them."""
    threads, block = machine.threads, machine.block
    if cluster is not None:
        if not cluster.startswith("local:"):
            return
        threads = int(cluster.partition(":")[2])
    left = directory.members_of(numbers)
    shard = min(directory.facts["shard"], left)
    more = memory_of_shards(run, shard, block, threads)
    place = os.path.join(directory.folder, "shards")
    if directory.store is not None:
        left = shard  # each shard leaves this disk before the next is written
    check_resources(run, left, block, threads, place, more)


def keep_journal(
    directory: RunDirectory, numbers: Sized, compute: Callable[[], dict[str, int]], **begun: Any
) -> dict[str, int]:
    """Call a function that computes some shards, and record in the journal how it began and
    ended."""
    directory.note(event="begun", shards=len(numbers), **begun)
    started = time.monotonic()
    try:
        flagged = compute()
    except BaseException as error:
        taken = round(time.monotonic() - started, 3)
        directory.note(event="stopped", reason=type(error).__name__, seconds=taken)
        raise
    taken = round(time.monotonic() - started, 3)
    directory.note(
        event="ended",
        left=len(directory.missing()),
        members=sum(flagged.values()),
        flagged=flagged,
        seconds=taken,
    )
    return flagged


def add_members(directory: RunDirectory, members: Ints, level: int) -> RunDirectory:
    """Add members, by their indices, to a run of chosen members; level 0 completes the run.

    All existing shards must be complete. The longer list of members, which includes the old one, is
    on disk before run.json refers to it.
    """
    directory.refuse_store("adding members")
    facts, chosen = directory.facts, directory.chosen
    assert chosen is not None and (not members.size or facts["members"] % facts["shard"] == 0)
    more = np.concatenate([chosen, members])
    with directory.locked():
        if members.size:
            name = os.path.join(directory.path, CHOSEN)
            write_bytes(name, more.astype("<i8").tobytes(), force=True)
        text = facts_text({**facts, **selection_facts(more), "growing": level})
        write_bytes(os.path.join(directory.path, "run.json"), text.encode(), force=True)
        directory.note(event="extended", members=more.size)
    return RunDirectory(directory.path)


def extend(
    path: Path, members: int, accept: bool = False, allow_code: bool = False
) -> RunDirectory:
    """Add members to a run and return its RunDirectory, ready for `resume`.

    Existing shards stay, except the last one if it is shorter than the others.
    accept, allow_code : as in `resume`. Any error is raised before anything changes.
    """
    directory = RunDirectory(path)
    refuse_study(directory)
    directory.refuse_store("adding members")
    facts, members = directory.facts, read_count(members, "members")
    check_versions(directory, accept)
    if directory.chosen is not None:
        rule = "a study chose the members by the results of others: start a new run"
        raise OptionError(rule, at="run.members", value=members)
    if members <= facts["members"]:
        raise OptionError(
            f"the run already has {facts['members']:,}", at="run.members", value=members
        )
    if facts["first"] + members > 2**53:
        rule = "exceed 2^53, beyond which indices are not exact integers"
        raise OptionError(rule, at="run.members", value=members)
    directory.refuse_strays()
    refuse_many(-(-members // facts["shard"]))
    scene = scene_of_run(directory, allow_code)
    if scene.run.points == "latin_hypercube":
        rule = "a Latin hypercube has one member per stratum: start a new run"
        raise OptionError(rule, at="run.members", value=members)
    if (most := count_rows(*scene.model.quantities())) is not None and members + facts[
        "first"
    ] > most:
        raise OptionError(
            f"the scene has rows for {count_text(most, 'member')}", at="run.members", value=members
        )
    run, more = load_run(directory, allow_code), members - facts["members"]
    threads, block = threads_available(), block_of_run(directory, run)
    name = os.path.join(directory.path, "run.json")
    check_resources(run, more, block, threads, name)
    with directory.locked():
        last = directory.shards().get(directory.count - 1)

        def delete_short_shard() -> None:
            if facts["members"] % facts["shard"] and last is not None:
                os.unlink(last)
                make_durable(os.path.dirname(last))  # before run.json states the longer run

        text = facts_text({**facts, "members": members})
        write_bytes(name, text.encode(), force=True, before=delete_short_shard)
        directory.note(event="extended", members=members)
    return RunDirectory(path)
