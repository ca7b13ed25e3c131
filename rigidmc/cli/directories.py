"""rigidmc resume, status, verify, consolidate, extend: runs in a directory."""

import os
import sys
from typing import Annotated

import typer

from rigidmc.cli.common import (
    FLAGGED,
    INCOMPLETE,
    INVALID,
    OK,
    AllowCode,
    Force,
    Threads,
    app,
    count_option,
    fail,
    reported,
    time_option,
    told,
)

RunArgument = Annotated[
    str, typer.Argument(metavar="RUN", help="A run directory, made by `rigidmc run SCENE -o RUN/`.")
]
Accept = Annotated[
    bool,
    typer.Option("--accept", help="Go on though versions are others, whose last bits may differ."),
]
OutputOrRun = Annotated[
    str | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="netCDF file to write; RUN/ makes a run directory, which survives.",
    ),
]
MaxWall = Annotated[
    float | None,
    time_option(
        "--max-wall",
        help="Begin no shard that would not be done by then, to be resumed: 3h, 1h30m, 3600s or seconds.",
    ),
]
ShardSize = Annotated[
    float | None,
    typer.Option(
        min=0.001,
        help="Of a run directory: size of a shard \\[MB], 67 by default; a block of members at least.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="WHERE",
        help="Compute on dask workers: tcp://host:8786 of a scheduler, or local:N processes here.",
    ),
]
Blocks = Annotated[
    str | None,
    typer.Option(
        "--shards",
        metavar="FROM:TO",
        help="These shards only, as of a job array: 0:100 are the first hundred. `rigidmc show` tells how many there are.",
    ),
]


def is_run(path):
    """Whether an output is to be a run directory: RUN/ is."""
    return path is not None and (path.endswith(os.sep) or os.path.isdir(path))


def shards_of(text):
    """The range of FROM:TO; OptionError."""
    from rigidmc.errors import OptionError

    if text is None:
        return None
    low, colon, high = text.partition(":")
    if (
        not colon
        or not (low + high).isascii()
        or not low.isdigit()
        or not high.isdigit()
        or int(low) >= int(high)
    ):
        raise OptionError(
            "", "--shards", text, "expected FROM:TO, such as 0:100 for the first hundred"
        )
    return range(int(low), int(high))


@app.command()
def resume(
    run: RunArgument, threads: Threads = None, accept: Accept = False, max_wall: MaxWall = None, shards: Blocks = None,
    cluster: Cluster = None,
    repair: Annotated[bool, typer.Option("--repair", help="First take away the shards that are damaged, misnamed or of another run.")] = False,
    allow_code: AllowCode = False,
):  # fmt: skip
    """Go on with a run: compute the shards that are missing, to the bits that an unbroken run has. Those that are there are taken by their names;
    `verify` and --repair read them.

    Exit code 0 where all of it is done, 4 where it is and some members are flagged, 5 where shards are missing (--max-wall, --shards)."""
    with reported():
        from rigidmc.runs import resume as runs

        if repair:
            print(f"  {runs.repair(run)} damaged shards were taken away")
        code = go_on(run, threads, accept, max_wall, shards, allow_code, cluster)
    raise typer.Exit(code)


def go_on(run, threads, accept=False, max_wall=None, shards=None, allow_code=False, cluster=None):
    """Compute what is missing of a run and say what is there; the exit code."""
    from rigidmc.runs import resume as runs
    from rigidmc.storage import run_directory

    directory, flagged = runs.resume(
        run, threads, progress=True, accept=accept, max_wall=max_wall, only=shards_of(shards), allow_code=allow_code,
        cluster=cluster,
    )  # fmt: skip
    found = run_directory.status(directory.path)
    made = sum(flagged.values())
    print(
        f"{directory.path}: {found['done']:,} of {found['shards']:,} shards, {found['members_done']:,} members; {made:,} of them made now"
    )
    bad = ", ".join(
        f"{count:,} {word}" for word, count in flagged.items() if count and word != "ok"
    )
    print(
        f"  flagged of these: {bad or 'none'}"
        + (f"; of all: {found['flagged']:,}" if found["members_done"] > made else "")
    )
    if found["done"] < found["shards"]:
        print("  not done: `rigidmc resume` goes on")
    return outcome(found)


def outcome(found):
    """The exit code of a run, by its status."""
    if found["strays"]:
        fail(
            f"{found['strays']:,} files among the shards are none of this run; `rigidmc verify` names them",
            INVALID,
        )
    return INCOMPLETE if found["done"] < found["shards"] else FLAGGED if found["flagged"] else OK


@app.command()
def status(run: RunArgument):
    """Say how far a run is by the names of its shards, also while it runs: exit code 0 where all of it is done, 4 where it is and some members are flagged, 5 where shards are missing."""
    with reported():
        from rigidmc.storage import run_directory

        found = run_directory.status(run)
    print(
        f"{run}: {found['done']:,} of {found['shards']:,} shards, {found['members_done']:,} of {found['members']:,} members"
    )
    print(f"  flagged so far: {found['flagged']:,} members")
    print(
        f"  code generated for {found['machine']}, by {', '.join(f'{name} {number}' for name, number in found['versions'].items())}"
    )
    if found["rate"]:
        print(
            f"  {found['rate']:,.0f} members/s since it was last begun"
            + (f", {found['seconds_left']:,.0f} s left" if found["seconds_left"] else "")
        )
    raise typer.Exit(outcome(found))


@app.command()
def verify(
    run: RunArgument,
    spot: Annotated[
        int,
        count_option(
            "--spot",
            0,
            help="Shards, by chance, of which some members are computed again, to the bit.",
        ),
    ] = 3,
    allow_code: AllowCode = False,
):
    """Check a run: the sum of every shard against its name, run.json and scene, and some of them computed again.

    Exit code 0 where all of it is there and sound, 5 where it is sound and shards are missing, 3 where something is wrong."""
    with reported():
        from rigidmc.runs import gather
        from rigidmc.storage import run_directory

        found = run_directory.status(run)
        wrong = gather.verify(run, spot, allow_code)
        for line in wrong:
            print(line, file=sys.stderr)
        if wrong:
            fail(
                f"{run}: {len(wrong):,} faults; `rigidmc resume {run} --repair` computes shards again that are damaged, misnamed or of another run",
                INVALID,
            )
        print(
            f"{run}: {found['done']:,} of {found['shards']:,} shards, all of them sound; of {min(spot, found['done'])} by chance some members were computed again and compared"
        )
    raise typer.Exit(OK if found["done"] == found["shards"] else INCOMPLETE)


@app.command()
def consolidate(
    run: RunArgument, output: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="netCDF file to write.")],
    force: Force = False, allow_code: AllowCode = False,
):  # fmt: skip
    """Write a whole run as one netCDF file; exit code 4 where some of its members are flagged."""
    with reported():
        from rigidmc.runs import gather
        from rigidmc.storage import run_directory

        gather.consolidate(run, output, force, allow_code).close()
        found = run_directory.status(run)
        print(f"{told([output])[0]}; flagged members: {found['flagged'] or 'none'}")
    raise typer.Exit(outcome(found))


@app.command()
def extend(
    run: RunArgument, members: Annotated[int, count_option("--members", help="Members that it shall have in all.")], threads: Threads = None,
    accept: Accept = False, max_wall: MaxWall = None, cluster: Cluster = None, allow_code: AllowCode = False,
):  # fmt: skip
    """Give a run more members; those that are there are not changed by a bit."""
    with reported():
        from rigidmc.runs import resume as runs
        from rigidmc.runs.cluster import checked

        if cluster is not None:
            checked(cluster)
        runs.extend(run, members, accept, allow_code)
        code = go_on(run, threads, accept, max_wall, None, allow_code, cluster)
    raise typer.Exit(code)


@app.command()
def merge(
    run: RunArgument, parts: Annotated[list[str], typer.Argument(metavar="PART...", help="Run directories of the same run.")],
):  # fmt: skip
    """Gather the shards of a job array in one run directory, which may be a new one; scene, seed, members and shard size of all parts are the same."""
    with reported():
        from rigidmc.runs import resume as runs
        from rigidmc.storage import run_directory

        directory, copied = runs.merge(run, parts)
        found = run_directory.status(directory.path)
    print(
        f"{directory.path}: {copied:,} shards copied; {found['done']:,} of {found['shards']:,} are there"
    )
    raise typer.Exit(outcome(found))
