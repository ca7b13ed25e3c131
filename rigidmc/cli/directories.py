"""rigidmc resume, status, verify, consolidate, extend, merge: runs in a directory."""

import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rigidmc.cli.app import FLAGGED, INCOMPLETE, INVALID, OK, end_of_limit, fail
from rigidmc.cli.options import (
    Accept,
    AllowCode,
    Cluster,
    Device,
    Force,
    MaxWall,
    RunArgument,
    Shards,
    ShardSize,
    ShardTime,
    Threads,
    count_option,
    gather_options,
)
from rigidmc.cli.reporting import report_errors, report_files
from rigidmc.errors import OptionError
from rigidmc.files.stores import is_folder
from rigidmc.results.labels import count_text

if TYPE_CHECKING:
    from rigidmc.runs.directory.folder import RunDirectory


def shards_of(text: str | None) -> range | None:
    """Return the range of FROM:TO; OptionError."""
    if text is None:
        return None
    low, colon, high = text.partition(":")
    digits = all(part.isascii() and part.isdigit() for part in (low, high))
    if not colon or not digits or int(low) >= int(high):
        rule = "expected FROM:TO, e.g. 0:100 for the first hundred"
        raise OptionError(rule, at="shards", value=text)
    return range(int(low), int(high))


class DirectoryOptions(NamedTuple):
    """The options of `run` and `map` that apply to run directories only."""

    max_wall: float | None
    shards: str | None
    shard_size: float | None
    shard_time: float | None
    cluster: str | None


with_directory_options = gather_options(  # decorates a command with a parameter `ways`
    "ways",
    {
        "max_wall": MaxWall, "shards": Shards, "shard_size": ShardSize, "shard_time": ShardTime,
        "cluster": Cluster,
    },
    lambda given: DirectoryOptions(**given),
)  # fmt: skip


def names_a_run(output: str) -> bool:
    """Whether an output is a run directory: a folder, but not a zarr store."""
    folder = output.endswith(os.sep) or is_folder(output)
    return folder and not output.lower().rstrip(os.sep).endswith(".zarr")


def refuse_directory_options(ways: DirectoryOptions) -> None:
    """OptionError for an option that needs a run directory."""
    for name, value in ways._asdict().items():
        if value is not None:
            raise OptionError("needs a run directory: -o RUN/", at=name, value=value)


def refuse_force(output: str, force: bool) -> None:
    """OptionError for --force with a run directory that exists."""
    if force and os.path.exists(output):
        rule = f"replaces files, never folders: remove {output} first"
        raise OptionError(rule, at="force")


# makes a run directory from: bytes per shard, range of shards, number of threads, seconds per shard
Make = Callable[[float | None, range | None, int | None, float | None], "RunDirectory"]


def start_directory(
    make: Make, ways: DirectoryOptions, threads: int | None, allow_code: bool, device: str | None
) -> tuple[int, bool]:
    """Make a run directory and compute its shards; see `resume_directory`."""
    from rigidmc.processes.threads import Late, ending
    from rigidmc.runs.directory.cluster import parse_cluster

    max_wall, shards, shard_size, shard_time, cluster = ways
    kind, count = ("", "") if cluster is None else parse_cluster(cluster)
    if shard_size is not None and not shard_size < 1e6:
        raise OptionError("expected megabytes, at most 1e6", at="shard_size", value=shard_size)
    size = None if shard_size is None else 1e6 * shard_size
    many = int(count) if kind == "local" else threads
    stop = end_of_limit(max_wall)
    try:
        with ending(stop):
            directory = make(size, shards_of(shards), many, shard_time)
    except Late:
        fail("the time limit ended while the run was planned; nothing was written", INCOMPLETE)
    return resume_directory(
        directory.path,
        threads,
        stop=stop,
        shards=shards,
        allow_code=allow_code,
        cluster=cluster,
        device=device,
    )


def resume_directory(
    run: str,
    threads: int | None,
    accept: bool = False,
    stop: float | None = None,
    shards: str | None = None,
    allow_code: bool = False,
    cluster: str | None = None,
    device: str | None = None,
) -> tuple[int, bool]:
    """Compute the missing shards of a run, or of a range, and print the progress.

    stop : as `rigidmc.cli.app.end_of_limit` returns it

    Return (exit code, whether the whole run is done).
    """
    from rigidmc.runs.directory import folder as run_directory
    from rigidmc.studies.framework import tasks
    from rigidmc.studies.stability_map.stored import resume_growing

    directory = run_directory.RunDirectory(run)
    study, mine = tasks.tasks_of(directory), shards_of(shards)
    directory, flagged = (resume_growing if study is None else tasks.resume_study)(
        directory,
        threads=threads,
        progress=True,
        accept=accept,
        max_wall=None if stop is None else max(1e-9, stop - time.monotonic()),
        only=mine,
        allow_code=allow_code,
        cluster=cluster,
        device=device,
    )
    status = run_directory.status(directory.path)
    computed = sum(flagged.values())
    print(
        f"{directory.path}: {status['done']:,} of {count_text(status['shards'], 'shard')},"
        f" {count_text(status['members_done'], 'member')}; {computed:,} computed now"
    )
    words = ", ".join(f"{n:,} {word}" for word, n in flagged.items() if n and word != "ok")
    older = f"; in all: {status['flagged']:,}" if status["members_done"] > computed else ""
    print(f"  flagged among these: {words or 'none'}{older}")
    if whole(status):
        return run_outcome(status), True
    if mine is None or directory.missing_in(mine).size:
        kept = " from the saved parts of unfinished shards" * os.path.isdir(directory.unfinished)
        print(f"  not done: `rigidmc resume` continues{kept}")
        return run_outcome(status), False
    left = count_text(status["shards"] - status["done"], "shard of", "shards of")
    words = in_ranges(directory.missing().tolist())
    print(
        f"  shards {shards} are done; {left} other jobs are missing ({words});"
        " `rigidmc merge` gathers all"
    )
    there = directory.shards()
    mine_flagged = any(run_directory.flagged_count(there[i]) for i in mine if i in there)
    return run_outcome(status, FLAGGED if mine_flagged else OK), False


def in_ranges(numbers: list[int], most: int = 4) -> str:
    """Write rising numbers as FROM:TO for each gapless part, at most `most` parts."""
    begins = [i for i, n in enumerate(numbers) if i == 0 or n != numbers[i - 1] + 1]
    ends = [*begins[1:], len(numbers)]
    words = [f"{numbers[i]}:{numbers[j - 1] + 1}" for i, j in zip(begins, ends, strict=True)]
    return ", ".join(words[:most]) + ", ..." * (len(words) > most)


def whole(status: dict[str, Any]) -> bool:
    """Whether a run is complete: it has all shards, and adds no more."""
    return status["done"] == status["shards"] and not status["growing"]


def run_outcome(status: dict[str, Any], part: int = INCOMPLETE) -> int:
    """Return the exit code for the status of a run; part : the code if shards are missing."""
    if status["strays"]:
        rule = "files among the shards do not belong to this run; `rigidmc verify` names them"
        fail(f"{status['strays']:,} {rule}", INVALID)
    if not whole(status):
        return part
    return FLAGGED if status["flagged"] else OK


Repair = Annotated[
    bool,
    typer.Option(
        "--repair", help="First delete shards that are damaged, misnamed or from another run."
    ),
]


def resume_command(
    run: RunArgument,
    threads: Threads = None,
    device: Device = None,
    accept: Accept = False,
    max_wall: MaxWall = None,
    shards: Shards = None,
    cluster: Cluster = None,
    repair: Repair = False,
    allow_code: AllowCode = False,
) -> None:
    stop = end_of_limit(max_wall)
    with report_errors():
        if repair:
            from rigidmc.runs.directory import gather

            deleted = gather.repair(run)
            print(f"  deleted {count_text(deleted, 'damaged shard')}")
        code, _ = resume_directory(run, threads, accept, stop, shards, allow_code, cluster, device)
    raise typer.Exit(code)


def status_command(run: RunArgument) -> None:
    with report_errors():
        from rigidmc.runs.directory import folder as run_directory

        facts = run_directory.status(run)
    print(
        f"{run}: {facts['done']:,} of {count_text(facts['shards'], 'shard')},"
        f" {facts['members_done']:,} of {count_text(facts['members'], 'member')}"
    )
    if facts["growing"]:
        print("  the results may call for more members")
    print(f"  flagged so far: {count_text(facts['flagged'], 'member')}")
    versions = ", ".join(f"{name} {number}" for name, number in facts["versions"].items())
    print(f"  code generated for {facts['machine']} by {versions}")
    if facts["rate"]:
        left = f", {facts['seconds_left']:,.0f} s left" if facts["seconds_left"] else ""
        print(f"  {facts['rate']:,.0f} members/s since the last start{left}")
    raise typer.Exit(run_outcome(facts))


Spot = Annotated[
    int,
    count_option(
        "--spot", 0, help="Number of random shards from which some members are recomputed."
    ),
]


def verify_command(run: RunArgument, spot: Spot = 3, allow_code: AllowCode = False) -> None:
    with report_errors():
        from rigidmc.runs.directory import folder as run_directory
        from rigidmc.studies.framework import tasks

        facts = run_directory.status(run)
        faults = tasks.verify_study(run, spot, allow_code)
        for line in faults:
            print(line, file=sys.stderr)
        if faults:
            cure = f"`rigidmc resume {run} --repair` recomputes bad shards"
            fail(f"{run}: {count_text(len(faults), 'fault')}; {cure}", INVALID)
        print(
            f"{run}: {facts['done']:,} of {count_text(facts['shards'], 'shard')}, all sound; some"
            f" members of {min(spot, facts['done'])} random shards were recomputed and are"
            " identical"
        )
    raise typer.Exit(OK if whole(facts) else INCOMPLETE)


def consolidate_command(
    run: RunArgument,
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="FILE", help="netCDF file to write.")
    ],
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    with report_errors():
        from rigidmc.runs.directory import folder as run_directory
        from rigidmc.runs.directory import gather

        gather.consolidate(run, output, force, allow_code).close()
        facts = run_directory.status(run)
        print(f"{report_files([output])[0]}; flagged members: {facts['flagged'] or 'none'}")
    raise typer.Exit(run_outcome(facts))


def extend_command(
    run: RunArgument,
    members: Annotated[
        int, count_option("--members", help="New total of members; for a map, of each pixel.")
    ],
    threads: Threads = None,
    device: Device = None,
    accept: Accept = False,
    max_wall: MaxWall = None,
    cluster: Cluster = None,
    allow_code: AllowCode = False,
) -> None:
    stop = end_of_limit(max_wall)
    with report_errors():
        from rigidmc.runs.directory import resume as runs
        from rigidmc.runs.directory.cluster import parse_cluster
        from rigidmc.studies.stability_map.stored import is_map, members_of_pixels

        if cluster is not None:
            parse_cluster(cluster)
        if is_map(run):
            members = members_of_pixels(run, members)
        runs.extend(run, members, accept, allow_code)
        code, _ = resume_directory(run, threads, accept, stop, None, allow_code, cluster, device)
    raise typer.Exit(code)


Parts = Annotated[
    list[str], typer.Argument(metavar="PART...", help="Run directories of the same run.")
]


def merge_command(run: RunArgument, parts: Parts) -> None:
    with report_errors():
        from rigidmc.runs.directory import folder as run_directory
        from rigidmc.runs.directory import gather

        directory, copied = gather.merge(run, parts)
        facts = run_directory.status(directory.path)
    print(
        f"{directory.path}: {count_text(copied, 'shard')} copied;"
        f" {facts['done']:,} of {facts['shards']:,} exist"
    )
    raise typer.Exit(run_outcome(facts))
