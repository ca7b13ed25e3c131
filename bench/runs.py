"""Run directories: memory by number of members, cost of writing, opening and status of 1000 shards.

Also a cluster of two local processes against two threads.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time

from bench import harness, startup
from bench.memory import peak
from rigidmc.results.sinks import Sink
from rigidmc.runs.blocks import compute
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.load import load_run
from rigidmc.runs.directory.shards import compute_shards
from rigidmc.runs.resources import free_memory
from rigidmc.runs.settled import Machine
from rigidmc.scene.scene import Scene

STUDY = "run dzhanibekov --t-end 12 --save omega,attitude --keep final"
MEMBERS = (2_000_000, 5_000_000, 20_000_000)

OPEN = """
import sys, time
import rigidmc as rm
import rigidmc.runs.directory.dataset
from rigidmc.runs.directory import folder as run_directory
import dask.array, xarray
began = time.perf_counter()
rm.open(sys.argv[1])
opened = time.perf_counter()
run_directory.status(sys.argv[1])
print(opened - began, time.perf_counter() - opened)
"""


class Nothing(Sink):
    """A sink that stores nothing, so that only computing is left."""

    def __init__(self, layout):
        self.layout = layout


def share(folder, members, rounds):
    """Return rows of seconds with and without writing, interleaved."""
    scene = Scene.load("dzhanibekov").with_run(
        members=members, t_end=12.0, save=("omega", "attitude"), keep="final"
    )
    rows, threads = [], len(os.sched_getaffinity(0))
    for i in range(rounds):
        directory = create(scene, os.path.join(folder, f"share{i}"))
        ready, block = load_run(directory).compile(), directory.facts["block"]
        began = time.perf_counter()
        machine = Machine(threads, "cpu", block)
        compute(ready, Nothing(ready.layout), machine)
        without = time.perf_counter() - began
        with directory.locked():
            began = time.perf_counter()
            compute_shards(directory, ready, range(directory.count), machine)
            seconds = time.perf_counter() - began
        rows.append(
            {
                "kind": "share",
                "members": members,
                "steps": ready.plan.grid.steps,
                "without": without,
                "with": seconds,
            }
        )
        shutil.rmtree(directory.path)
    return rows


def thousand(folder, shards):
    """Measure the seconds of rm.open and of status, for a run with a number of shards."""
    path = os.path.join(folder, "many")
    text = f"run dzhanibekov --members {4096 * shards} --t-end 0.1 --shard-size 0.5 --save omega -o"
    startup.silently(text, path + "/")
    taken = []
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-c", OPEN, path], check=True, capture_output=True, text=True
        )
        taken.append([float(word) for word in done.stdout.split()])
    began = time.perf_counter()
    startup.silently("status", path)
    return (
        len(os.listdir(os.path.join(path, "shards"))),
        *map(harness.median, zip(*taken, strict=True)),
        time.perf_counter() - began,
    )


def cluster(folder, members, t_end, rounds, size):
    """Return rows of seconds of the same run on two threads and in two processes.

    The second includes the start of the cluster. A third row times a shard without that start.

    size : of a shard [MB], small enough that each worker gets many and none waits long for the last
    """
    text = f"run dzhanibekov --members {members} --t-end {t_end} --save omega --keep final"
    rows = []
    for i in range(rounds):
        row: dict = {"kind": "cluster", "members": members, "t_end": t_end}
        for name, how in (("threads", "--threads 2"), ("cluster", "--cluster local:2")):
            path = os.path.join(folder, f"{name}{i}")
            startup.silently(f"{text} --shard-size {size} {how} -o", path + "/")
            with open(os.path.join(path, "journal.jsonl")) as file:
                row[name] = [json.loads(line) for line in file][-1]["seconds"]
            shards = sorted(
                os.scandir(os.path.join(path, "shards")), key=lambda entry: entry.stat().st_mtime
            )
            row[f"{name}_a_shard"] = (shards[-1].stat().st_mtime - shards[3].stat().st_mtime) / (
                len(shards) - 4
            )
            row[f"{name}_shards"] = sorted(entry.name for entry in shards)
            shutil.rmtree(path)
        row["equal"] = row.pop("threads_shards") == row.pop("cluster_shards")
        rows.append(row)
    return rows


# in a process whose workers are elsewhere, so its CPU seconds are for scheduler, client and locks
SCHEDULE = """
import resource, sys
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.create import create
from rigidmc.scene.scene import Scene
if __name__ == "__main__":
    members = 4096 * int(sys.argv[2])
    scene = Scene.load("dzhanibekov").with_run(members=members, t_end=0.1, every=0.1)
    directory = create(scene, sys.argv[1], 0.5e6)
    usage = []
    for which in (range(2), range(2, directory.count)):
        resume.resume(directory.path, cluster="local:2", only=which)
        found = resource.getrusage(resource.RUSAGE_SELF)
        usage.append(found.ru_utime + found.ru_stime)
    print((usage[1] - usage[0]) / (directory.count - 2), directory.count)
"""


def scheduler(folder, shards):
    """Return a row with the cost of a task in the process that submits it."""
    path = os.path.join(folder, "schedule.py")
    with open(path, "w") as file:
        file.write(SCHEDULE)
    done = subprocess.run(
        [sys.executable, path, os.path.join(folder, "tasks"), str(shards)],
        check=True,
        capture_output=True,
        text=True,
    )
    seconds, count = done.stdout.split()
    return {"kind": "scheduler", "shards": int(count), "seconds": float(seconds)}


def run(quick):
    sizes = (100_000, 200_000) if quick else MEMBERS
    rows: list[dict] = []
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        for members in (sizes[0], *sizes):  # the first compiles
            path = os.path.join(folder, f"m{members}-{len(rows)}")
            began = time.perf_counter()
            words = startup.command(f"{STUDY} --members {members} -o", path + "/")
            memory = peak(words, folder)
            taken = time.perf_counter() - began
            size = sum(
                os.path.getsize(os.path.join(path, "shards", name))
                for name in os.listdir(os.path.join(path, "shards"))
            )
            rows.append(
                harness.row("peak", members=members, gigabytes=memory, seconds=taken, bytes=size)
            )
            shutil.rmtree(path)
        peaks = [row["gigabytes"] for row in rows[1:]]
        rows.append(
            harness.at_most(
                f"peak memory, {sizes[-1]:,} members to a run directory", 1.5, peaks[-1], "GB"
            )
        )
        rows.append(
            harness.at_most(
                f"{sizes[-1]:,} members against {sizes[0]:,}", 1.15, peaks[-1] / peaks[0], "x"
            )
        )
        rows += share(folder, sizes[1], 1 if quick else 5)
        ratios = [row["with"] / row["without"] - 1.0 for row in rows if row["kind"] == "share"]
        note = f"{len(ratios)} rounds, {min(ratios):.3f} to {max(ratios):.3f}"
        rows.append(
            harness.at_most("what writing adds to a run", 0.10, harness.median(ratios), note=note)
        )
        count, opened, asked, command = thousand(folder, 20 if quick else 1000)
        rows.append(harness.at_most(f"rm.open of {count:,} shards", 2.0, opened, "s"))
        rows.append(
            harness.at_most(
                f"status of {count:,} shards",
                0.5,
                asked,
                "s",
                note=f"`rigidmc status` {command:.2f} s",
            )
        )
        rows.append(scheduler(folder, 10 if quick else 1000))
        rows += cluster(
            folder, sizes[0], 2.0 if quick else 400.0, 1 if quick else 2, 0.5 if quick else 4
        )
        clusters = [row for row in rows if row["kind"] == "cluster"]
        assert all(row["equal"] for row in clusters)
        ratio = harness.median([row["threads"] / row["cluster"] for row in clusters])
        shares = [row["threads_a_shard"] / row["cluster_a_shard"] for row in clusters]
        steady, seconds = harness.median(shares), clusters[0]["threads"]
        note = f"once it has started; a run of {seconds:.0f} s with its start {ratio:.2f}"
        rows.append(
            harness.target(
                "two processes of a cluster here against two threads", 0.9, steady, "x", note=note
            )
        )
    rows.append({"kind": "machine", "free_memory": free_memory()})
    return rows


def report(rows):
    for row in harness.of_kind(rows, "peak"):
        speed, written = row["members"] / row["seconds"], row["bytes"] / 1e9
        print(
            f"  {row['members']:12,d} members  {row['gigabytes']:.3f} GB  {row['seconds']:6.1f} s"
            f"  {speed:9,.0f} members/s  {written:.2f} GB written"
        )
    harness.report_targets(rows)
