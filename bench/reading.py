"""A run directory of many shards: open, status, mean of one variable, summary, and peak memory.

A few shards are computed, and the others are their copies with the indices of other members: the
files are as in a real run, but the values repeat.
"""

import hashlib
import json
import os
import sys
import tempfile
import time

import numpy as np

from bench import harness, startup
from bench.memory import peak
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.load import load_run
from rigidmc.runs.directory.shards import compute_shards
from rigidmc.runs.settled import Machine
from rigidmc.scene.scene import Scene

SHARDS, REAL, SIZE = 19_686, 16, 0.5e6  # 80 million members in 8 GB
ASKED = {"open": 1.0, "mean": 12.0, "summary": 15.0}

STEPS = """
import json, sys, time
import dask.array, xarray
import rigidmc as rm
import rigidmc.runs.directory.dataset, rigidmc.views.summary
began = time.perf_counter()
dataset = rm.open(sys.argv[1])
opened = time.perf_counter()
dataset.energy_drift_max.mean().compute()
averaged = time.perf_counter()
if sys.argv[2] == "all":
    dataset.rigid.summary()
ended = time.perf_counter()
taken = dict(open=opened - began, mean=averaged - opened, summary=ended - averaged)
json.dump(taken, open(sys.argv[3], "w"))
"""


def make(path, shards):
    """Make a complete run directory; return its number of members."""
    scene = Scene.load("dzhanibekov").with_run(t_end=0.5, every=0.5, save=("omega",), keep="final")
    each = create(scene.with_run(members=10**6), f"{path}-1", SIZE).facts["shard"]
    directory = create(scene.with_run(members=each * shards), path, SIZE)
    with directory.locked():
        run = load_run(directory).compile()
        machine = Machine(1, "cpu", directory.facts["block"])
        compute_shards(directory, run, range(min(REAL, shards)), machine)
    there = directory.shards()
    for i in range(REAL, shards):
        with open(there[i % REAL], "rb") as file:
            data = bytearray(file.read())
        members = np.arange(each, dtype="<i8")
        at = data.find((members + i % REAL * each).tobytes())
        data[at : at + 8 * each] = (members + i * each).tobytes()
        name = f"{i:08d}-0-{hashlib.sha256(data).hexdigest()[:16]}.nc"
        with open(os.path.join(path, "shards", name), "wb") as file:
            file.write(data)
    return each * shards


def run(quick):
    shards = 200 if quick else SHARDS
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        path, times = os.path.join(folder, "run"), os.path.join(folder, "times")
        members = make(path, shards)
        steps = [sys.executable, "-c", STEPS, path]
        few = peak([*steps, "mean", times], folder)
        memory = peak([*steps, "all", times], folder)
        with open(times) as file:
            taken = json.load(file)
        status = harness.median([_status(path) for _ in range(3)])
    what = f"{shards:,} shards, {members:,} members"
    note = f"peak memory {few:.2f} GB for the mean, {memory:.2f} GB for all"
    return [
        {"kind": "reading", "shards": shards, "members": members, "status": status, **taken},
        *(
            harness.at_most(f"{name} of {what}", limit, taken[name], "s", note=note)
            for name, limit in ASKED.items()
        ),
        harness.at_most(f"`rigidmc status` of {what}", 1.0, status, "s"),
        harness.at_most(f"peak memory, {what}", 1.0, memory, "GB"),
    ]


def _status(path):
    """Return the seconds of `rigidmc status`, with the start of the program."""
    began = time.perf_counter()
    startup.silently("status", path)
    return time.perf_counter() - began


def report(rows):
    harness.report_targets(rows)
