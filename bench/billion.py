"""A billion members on one machine, of which nothing but totals is kept: rate against the kernel's,
and peak memory.

`python -m bench billion` measures fewer members, whose memory is the same; `python -m bench.billion
1e9` runs the billion, in about eight minutes of two cores.
"""

import os
import sys
import tempfile
import time

import rigidmc as rm
from bench import harness
from bench.memory import peak
from bench.runs import Nothing
from rigidmc.runs.blocks import compute
from rigidmc.runs.resources import block_of
from rigidmc.runs.settled import Machine
from rigidmc.studies.totals import MORE, simulate_totals

MEMBERS = 10_000_000, 40_000_000
ROUNDS = 3
MEASURES = "mean(omega_last[3])", "p(omega_last[2] > 0)", "mean(energy_drift_max)"
T_END = 1.0  # 100 steps

WHOLE = """
import sys, time
from bench.billion import scene
from rigidmc.studies.totals import simulate_totals
from bench.billion import MEASURES
if __name__ == "__main__":
    began = time.perf_counter()
    totals = simulate_totals(scene(int(sys.argv[1])), MEASURES)
    assert int(totals.members.sum()) == int(
        sum(totals[name][-1].sum() for name in ("histogram", "histogram_below", "histogram_above"))
    ) == int(sys.argv[1])
    print(time.perf_counter() - began, file=open(sys.argv[2], "w"))
"""


def scene(members):
    """Return free tops with random starts, whose last omega_1 are counted in 64 bins."""
    histogram = rm.Histogram("omega[1]", -0.2, 0.2, 64)
    return rm.Scene.load("dzhanibekov").with_run(
        members=members, t_end=T_END, every=T_END, save=(histogram, "omega_last")
    )


class Kernel(Nothing):
    """A sink that neither stores nor takes anything: only computing is left."""

    def gather(self, job, results):
        return None


def rates(members, rounds):
    """Return [members a second of the kernel, and of the run with totals], interleaved."""
    threads, rows = len(os.sched_getaffinity(0)), []
    run = rm.prepare(scene(members)).compile()
    size = MORE * block_of(run, threads, "cpu", True)
    simulate_totals(scene(100_000), MEASURES)
    for _ in range(rounds):
        began = time.perf_counter()
        compute(run, Kernel(run.layout), Machine(threads, "cpu", size))
        middle = time.perf_counter()
        simulate_totals(scene(members), MEASURES)
        end = time.perf_counter()
        rows.append((members / (middle - began), members / (end - middle)))
    return [harness.median(rate) for rate in zip(*rows, strict=True)]


def whole(members, folder):
    """Return a row of a run in a process of its own."""
    path = os.path.join(folder, "seconds")
    memory = peak([sys.executable, "-c", WHOLE, str(members), path], folder)
    with open(path) as file:
        seconds = float(file.read())
    return {"kind": "whole", "members": members, "gigabytes": memory, "seconds": seconds}


def run(quick):
    sizes = [n // 10 for n in MEMBERS] if quick else MEMBERS
    kernel, totals = rates(sizes[0], 1 if quick else ROUNDS)
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        rows = [whole(members, folder) for members in sizes]
    few, many = (row["gigabytes"] for row in rows)
    note = f"{totals:,.0f} members/s of {round(T_END / 0.01)} steps"
    return [
        *rows,
        harness.target("rate with totals, of the kernel's", 0.95, totals / kernel, "x", note=note),
        harness.at_most("peak memory", 1.0, many, "GB"),
        harness.at_most("its growth for 4 times the members", 1.05, many / few, "x"),
    ]


def report(rows):
    for row in harness.of_kind(rows, "whole"):
        speed = row["members"] / row["seconds"]
        print(
            f"  {row['members']:13,d} members  {row['gigabytes']:.3f} GB  {row['seconds']:6.1f} s"
            f"  {speed:9,.0f} members/s"
        )
    harness.report_targets(rows)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as where:
        report([whole(int(float(sys.argv[1])), where)])
