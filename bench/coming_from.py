"""The codes of docs/coming_from: the same problem in another program and in rigidmc.

Every code is a process that imports its program, runs each task once, which compiles, and then
takes turns with the other. Errors are relative to a closed form, or to scipy's DOP853 at 3e-14.
`--python PATH` names an interpreter that has the other programs; missing programs are skipped.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

import rigidmc
from bench import harness

ROOT = Path(__file__).parents[1]
CODE = ROOT / "docs" / "coming_from" / "code"
SLOW = 1.0  # s: slower tasks run in fewer rounds
BUSY = 1.0  # load average from which figures are marked as disturbed
HEAVY_MOMENTS, WEIGHT, TILT = (0.02, 0.02, 0.01), 0.981, 0.5


class Pair(NamedTuple):
    """A page: its program, the package that has its version, tasks of both codes, tasks of ours."""

    program: str
    package: str
    both: tuple[str, ...]
    ours: tuple[str, ...] = ()


PAIRS = {
    "basilisk": Pair("Basilisk", "bsk", ("one",), ("ensemble",)),
    "mujoco": Pair("MuJoCo", "mujoco", ("one", "ensemble")),
    "heyoka": Pair("heyoka", "heyoka", ("one", "ensemble")),
    "diffrax": Pair("diffrax", "diffrax", ("ensemble",), ("exact",)),
    "rebound": Pair("REBOUND", "rebound", ("one",), ("ensemble",)),
    "sympy": Pair("sympy", "sympy", ("one",)),
}


class Code:
    """A running code; `ask(task)` returns its answer. missing: what could not be imported."""

    def __init__(self, python, file, cache):
        self.process = subprocess.Popen(
            [python, str(Path(__file__).with_name("coming_from_process.py")), str(file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "RIGIDMC_CACHE_DIR": cache},
        )
        found = self._read()
        self.missing, self.seconds = found.get("missing", ""), found.get("seconds")

    def ask(self, task):
        print(task, file=self.process.stdin, flush=True)
        return self._read()

    def close(self):
        self.process.communicate()

    def _read(self):
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(self.process.communicate()[1])
        return json.loads(line)


def run(quick, python=sys.executable):
    rows = [{"kind": "load", "before": os.getloadavg()[0], "busy": os.getloadavg()[0] > BUSY}]
    for name in PAIRS:
        rows += rows_of(name, quick, python)
    rows[0]["after"] = os.getloadavg()[0]
    return rows


def rows_of(name, quick, python):
    """The rows of a page."""
    pair = PAIRS[name]
    rows, codes, seconds = [], {}, {}
    with tempfile.TemporaryDirectory() as cache:
        ours = CODE / f"{name}_rigidmc.py"
        first = Code(sys.executable, ours, cache)
        cold = {task: first.ask(task)["seconds"] for task in (*pair.both, *pair.ours)}
        first.close()
        codes["rigidmc"] = Code(sys.executable, ours, cache)
        theirs = Code(python, CODE / f"{name}_theirs.py", cache)
        if theirs.missing:
            rows.append({"kind": "skipped", "page": name, "why": theirs.missing})
        else:
            codes[pair.program] = theirs
        tasks = {"rigidmc": (*pair.both, *pair.ours), pair.program: pair.both}
        ends = {}
        for program, code in codes.items():
            for task in tasks[program]:
                answer = code.ask(task)
                ends[program, task] = answer
                rows.append(
                    {
                        "kind": "start",
                        "page": name,
                        "program": program,
                        "version": version_of(program, pair, python),
                        "task": task,
                        "import": code.seconds,
                        "first": cold[task] if program == "rigidmc" else answer["seconds"],
                        "cached": answer["seconds"] if program == "rigidmc" else None,
                        "error": error_of(name, task, answer),
                    }
                )
        for task in tasks["rigidmc"]:
            programs = [program for program in codes if task in tasks[program]]
            slow = max(ends[program, task]["seconds"] for program in programs) > SLOW
            for turn in range(1 if quick else 5 if slow else 25):
                for program in programs[:: 1 if turn % 2 else -1]:
                    taken = codes[program].ask(task)["seconds"]
                    seconds.setdefault((program, task), []).append(taken)
        for code in codes.values():
            code.close()
    for (program, task), taken in seconds.items():
        row = {"kind": "time", "page": name, "program": program, "task": task}
        rows.append({**row, "seconds": statistics.median(taken), "rounds": taken})
    for task in pair.both if pair.program in codes else ():
        both = [ends[program, task] for program in (pair.program, "rigidmc")]
        row = {"kind": "difference", "page": name, "task": task}
        rows.append({**row, "difference": distance(*both)})
    return rows


def version_of(program, pair, python):
    """The version of a program in its interpreter."""
    if program == "rigidmc":
        return rigidmc.__version__
    if python == sys.executable:
        return version(pair.package)
    ask = f"from importlib.metadata import version; print(version({pair.package!r}))"
    return subprocess.run([python, "-c", ask], capture_output=True, text=True).stdout.strip()


def distance(one, other):
    """Largest difference of two ends, in omega (relative) and attitude [rad]."""
    (q, w), (p, v) = ((np.array(x["attitude"]), np.array(x["omega"])) for x in (one, other))
    q, p = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (q, p))
    chord = np.minimum(np.linalg.norm(q - p, axis=1), np.linalg.norm(q + p, axis=1))
    turned = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    off = np.linalg.norm(w - v, axis=1) / np.linalg.norm(v, axis=1)
    return float(max(turned.max(), off.max()))


def error_of(name, task, answer):
    """Largest error over all members; None where no reference is computed."""
    if name == "rebound" and task == "ensemble":
        return None
    attitude, omega = truth(name, task)
    return distance(answer, {"attitude": attitude, "omega": omega})


def truth(name, task):
    """(attitude (n, 4), omega (n, 3)) at the end of a task."""
    draws = np.random.default_rng(1)
    still = (1.0, 0.0, 0.0, 0.0)
    if name == "rebound":
        return hyperion()
    if name in ("diffrax", "basilisk"):
        if name == "diffrax":
            moments, t_end = np.array((0.061, 0.144, 0.149)), 60.0
            omega = draws.normal((0.02, 0.5, 0.0), (0.01, 0.01, 0.01), (4096, 3))
        else:
            moments, t_end, omega = np.array((900.0, 800.0, 600.0)), 600.0, (0.01, 0.05, 0.001)
            omega = [omega] if task == "one" else draws.normal(omega, 1e-3, (4096, 3))
        end = rigidmc.solve_free_top(moments, moments * omega, still, t_end)
        return end.attitude, end.omega
    members = {"heyoka": 4096, "mujoco": 64}.get(name)
    spins = np.array([30.0]) if task == "one" else draws.normal(30.0, 1.0, members)
    momentum = np.array([0.0, 0.0, HEAVY_MOMENTS[2]]) * spins[:, None]
    tilted = (np.cos(TILT / 2), np.sin(TILT / 2), 0.0, 0.0)
    end = rigidmc.solve_lagrange_top(HEAVY_MOMENTS, WEIGHT, momentum, tilted, 10.0)
    return end.attitude, end.omega


def hyperion():
    """The moon of the page on REBOUND, on its Kepler ellipse."""
    squares = np.array([190.0, 145.0, 114.0]) ** 2
    moments = (squares.sum() - squares) / squares.sum()

    def rates(t, y):
        q, s, w = y[0], y[1:4], y[4:]
        anomaly = t
        for _ in range(30):  # Kepler's equation: each pass gains a digit
            anomaly = t + 0.1 * np.sin(anomaly)
        r = np.array([np.cos(anomaly) - 0.1, np.sqrt(0.99) * np.sin(anomaly), 0.0])
        u = r + 2.0 * np.cross(s, np.cross(s, r) - q * r)  # in body axes
        torque = 3.0 / np.linalg.norm(r) ** 5 * np.cross(u, moments * u)
        turned = 0.5 * np.array([-s @ w, *(q * w + np.cross(s, w))])
        return [*turned, *((torque - np.cross(w, moments * w)) / moments)]

    start = [np.cos(0.05), np.sin(0.05), 0.0, 0.0, 0.0, 0.0, 1.3]
    end = solve_ivp(rates, (0.0, 6.0 * np.pi), start, method="DOP853", rtol=3e-14, atol=1e-15)
    return end.y[:4, -1][None], end.y[4:, -1][None]


def report(rows):
    for row in rows:
        if row["kind"] == "load" and row["busy"]:
            print(f"load average {row['before']:.1f}: other processes disturbed the times")
        if row["kind"] == "skipped":
            print(f"{row['page']}: skipped: {row['why']}")
        if row["kind"] == "difference":
            print(f"{row['page']}, {row['task']}: ends differ by {row['difference']:.1e}")
    harness.show(
        "the codes of docs/coming_from",
        harness.of_kind(rows, "start"),
        "page {page} | task {task} | program {program} | s {taken:.3g} | error {error:.1e}"
        " | first run {first:.2f} | from the cache {cached:.2f} | import {import:.2f}",
        taken=lambda row: seconds_of(rows, row),
    )


def seconds_of(rows, start):
    """The median seconds of the task of a row of kind "start"."""
    key = ("page", "program", "task")
    return next(
        row["seconds"]
        for row in rows
        if row["kind"] == "time" and all(row[word] == start[word] for word in key)
    )
