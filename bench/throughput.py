"""Member-steps per second of kernels and simulate(), against C, naive Numba and the FMA peak.

All are interleaved in one run.
"""

import statistics
import time

import numpy as np

from bench import harness
from bench.problems import candidates, tops
from rigidmc.engine.machine import threads_available

FLOPS = 217  # of a free rk4 step with attitude, counted on the textbook form
# largest and median relative error of omega against the candidate with which it must agree;
# measured 1.5e-11 and 1.0e-14, in heavy tops, where rounding grows a thousandfold in 10 s; free
# 4e-13
SAME = (1e-10, 1e-13)
OTHER_METHOD = {
    "kernel exact": (1e-5, 1e-8),
    "kernel exact, momentum only": (1e-5, 1e-8),
    "kernel strang heavy": (1.0, 1e-3),
}


def run(quick):
    ensemble, notes = tops.random_tops(candidates.MEMBERS), {}
    field = candidates.kernels(ensemble) | candidates.compiled(ensemble, notes)
    field |= candidates.numba(ensemble) | candidates.simulate(ensemble)
    rows = [{"kind": "note", "name": name, "note": note} for name, note in notes.items()]
    first, ends = {}, {}
    for name, candidate in field.items():
        if candidate.read:
            given = candidate.prepare()
            began = time.perf_counter()
            result = candidate.run(given)
            first[name] = time.perf_counter() - began
            ends[name] = candidate.read(result)
    rows += [check(name, *ends[name], *ends[field[name].same_as], ensemble) for name in ends]
    cpu = {}
    seconds = harness.interleaved(
        {name: (c.prepare, c.run) for name, c in field.items()}, 3 if quick else 11, cpu
    )
    rows += [
        rate(name, field[name].work, seconds[name], cpu[name], first.get(name)) for name in field
    ]
    return rows + targets(seconds, cpu, field, threads_available())


def check(name, q, l, other_q, other_l, ensemble):
    """Return a row of errors against the candidate with the same answer; AssertionError if too
    large."""
    error = tops.omega_error(ensemble, l, other_l)
    turn = float(tops.attitude_error(q, other_q).max()) if q is not None else None
    worst, middle = float(error.max()), float(np.median(error))
    limits = OTHER_METHOD.get(name, SAME)
    assert worst <= limits[0], (
        f"{name}: omega is off by {worst:.2g}, more than {limits[0]:g}: not the same problem"
    )
    assert middle <= limits[1], (
        f"{name}: omega is off by {middle:.2g} in the middle, more than {limits[1]:g}"
    )
    return harness.row(
        "check", name=name, omega_worst=worst, omega_median=middle, attitude_worst=turn
    )


def rate(name, work, seconds, cpu, first):
    """Return a row with the rate of a candidate.

    undisturbed : the rate if every core were free for it, from CPU seconds.
    """
    scale, unit = (1e-9, "GFLOP/s") if name.startswith("peak") else (1e-6, "M member-steps/s")
    middle, best = statistics.median(seconds), min(seconds)
    threads = 1 if name.endswith("one thread") else threads_available()
    undisturbed = scale * work * threads / statistics.median(cpu)
    row = harness.row(
        "rate", name=name, unit=unit, rate=scale * work / middle, best=scale * work / best
    )
    row["undisturbed"] = undisturbed
    return {
        **row,
        "compile_s": max(0.0, first - middle) if first else None,
        "seconds": seconds,
        "cpu_seconds": cpu,
    }


def targets(seconds, cpu, field, cores):
    """Return rows of targets and measurements: medians over rounds of ratios within a round, of
    wall and CPU seconds.
    """

    def row(what, asked, unit, name, other, factor=1.0, aim=False):
        if name not in seconds or other not in seconds:
            return harness.target(what, asked, None, unit, aim=aim)
        ratio, busy = (factor * harness.ratio(s[other], s[name]) for s in (seconds, cpu))
        return harness.target(
            what, asked, ratio, unit, aim=aim, note=f"{busy:.3g} {unit} in CPU seconds"
        )

    free, heavy, saves, exact = (
        "kernel rk4 free",
        "kernel rk4 heavy",
        "simulate rk4 free, 100 saves",
        "kernel exact",
    )
    c_free, c_heavy, c_fastest = (
        "C structure of arrays, free",
        "C structure of arrays, heavy",
        "C 512-bit intrinsics, ",
    )
    percent = 100 * FLOPS * field[free].work / field["peak"].work if "peak" in field else 0.0
    rows = [
        row("rk4 free, kernel / C structure of arrays", 1.0, "x", free, c_free),
        row("rk4 free, kernel / naive prange", 6.0, "x", free, "naive prange, free"),
        row(
            f"rk4 free, kernel / FMA peak ({FLOPS} flops a step)", 60.0, "%", free, "peak", percent
        ),
        row(
            "rk4 free, kernel / C with 512-bit intrinsics",
            1.0,
            "x",
            free,
            c_fastest + "free",
            aim=True,
        ),
        row("rk4 heavy, kernel / C structure of arrays", 0.9, "x", heavy, c_heavy),
        row("rk4 heavy, kernel / naive prange", 5.0, "x", heavy, "naive prange, heavy"),
        row(
            "rk4 heavy, kernel / C with 512-bit intrinsics",
            1.0,
            "x",
            heavy,
            c_fastest + "heavy",
            aim=True,
        ),
        row(
            "simulate(), free, final state / C with 512-bit intrinsics",
            0.95,
            "x",
            "simulate rk4 free, final state",
            c_fastest + "free",
        ),
        row(
            "prepared run of other tops, free / C with 512-bit intrinsics",
            0.92,
            "x",
            "prepared rk4 free, final state",
            c_fastest + "free",
        ),
        row(
            "prepared run of other tops, heavy / C with 512-bit intrinsics",
            0.93,
            "x",
            "prepared rk4 heavy, final state",
            c_fastest + "heavy",
        ),
        row(
            "simulate(), free, 4,000 steps / C with 512-bit intrinsics",
            1.0,
            "x",
            "simulate rk4 free, 4,000 steps",
            c_fastest + "free, 4,000 steps",
        ),
        row(
            "simulate(), heavy, final state / C with 512-bit intrinsics",
            0.95,
            "x",
            "simulate rk4 heavy, final state",
            c_fastest + "heavy",
        ),
        row(
            "simulate(), 100 saves / C with the same saves", 1.0, "x", saves, c_free + ", 100 saves"
        ),
        row(
            "exact, momentum only / C's rk4 steps", 0.8, "x", "kernel exact, momentum only", c_free
        ),
        row("exact with attitude / C's rk4 steps", 0.45, "x", exact, c_free),
    ]
    if cores > 1:
        ratio, busy = (harness.ratio(s[free + ", one thread"], s[free]) for s in (seconds, cpu))
        what, asked = (
            f"rk4 free, kernel: {cores} threads / one",
            1.85 if cores == 2 else 0.9 * cores,
        )
        rows.append(
            harness.target(what, asked, ratio, "x", note=f"{cores * busy:.3g} x in CPU seconds")
        )
    return rows


def report(rows):
    for row in harness.of_kind(rows, "note"):
        print(f"{row['name']}: {row['note']}")
    harness.show(
        "same answers? omega relative, attitude in rad",
        harness.of_kind(rows, "check"),
        "against rigidmc's rk4 {name} | worst {omega_worst:.1e} | median {omega_median:.1e}"
        " | attitude {attitude_worst:.1e}",
    )
    harness.show(
        f"{candidates.MEMBERS:,} different tops, {candidates.STEPS:,} steps, "
        f"{threads_available()} threads",
        harness.of_kind(rows, "rate"),
        " {name} | median {rate:.0f} | best {best:.0f} | in CPU seconds {undisturbed:.0f} | {unit}"
        " | first call, more {more}",
        more=lambda r: "-" if r["compile_s"] is None else f"{r['compile_s']:.1f} s",
    )
    harness.report_targets(rows)
