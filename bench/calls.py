"""Milliseconds of one call for few members, with everything compiled: the delay of an optimiser or
of a notebook with sliders.

Runs are so short that the steps of their members take no time, which leaves Python's time. The
minimum of many calls counts, because other load of the machine only adds to it.
"""

import time
import warnings

import numpy as np

import rigidmc as rm
from bench import harness
from rigidmc.engine import threads
from rigidmc.results.sinks import Blanks

SCENES = "dzhanibekov", "heavy_top"
FEW, MANY = 32, 4096
ASKED = {  # {what: milliseconds}
    f"simulate {FEW} members": 2.5,
    f"run a prepared run of {FEW} members": 0.6,
    f"run it with other numbers of {MANY:,}, without their steps": 1.0,
}


def least(call, count):
    """Return the shortest time of a call [ms], and the part of it spent in `run_block`."""
    inside, run_block = [0.0], threads.run_block

    def timed(*arguments, **keywords):
        began = time.perf_counter()
        try:
            return run_block(*arguments, **keywords)
        finally:
            inside[0] += time.perf_counter() - began

    times = []
    threads.run_block = timed
    try:
        for _ in range(count):
            inside[0], began = 0.0, time.perf_counter()
            call()
            times.append((time.perf_counter() - began, inside[0]))
    finally:
        threads.run_block = run_block
    return [1e3 * part for part in min(times)]


def calls(name):
    """Return {name: call} of a scene."""
    scene = rm.Scene.load(name)
    scene = scene.with_run(members=FEW, t_end=20 * scene.run.dt, every=20 * scene.run.dt)
    prepared, varied = rm.prepare(scene), rm.prepare(scene, varied=("start.omega",))
    nominal = np.array([part if isinstance(part, float) else 0.0 for part in scene.start.omega])
    omega = nominal + np.random.default_rng(0).normal(0.0, 0.01, (MANY, 3))
    simulate, run, values = ASKED
    return {
        simulate: lambda: rm.simulate(scene, threads=1),
        run: lambda: prepared.run(threads=1),
        values: lambda: varied.run(values={"start.omega": omega}, threads=1),
        "prepare": lambda: rm.prepare(scene),
        **results(prepared),
    }


def results(prepared):
    """Return {name: call} of the two ways to build the Dataset of a result."""
    layout, blanks = prepared.layout, Blanks()
    dataset = prepared.run(threads=1)
    arrays = {name: variable.values for name, variable in dataset.data_vars.items()}
    blanks.of(layout)
    return {
        "make a blank Dataset": lambda: (Blanks.of(new := Blanks(), layout), new.of(layout)),
        "copy a blank Dataset": lambda: blanks.of(layout).copy(data=arrays),
    }


def run(quick):
    rows, count = [], 20 if quick else 1000
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)
        for name in SCENES[: 1 if quick else None]:
            for what, call in calls(name).items():
                least(call, 3)  # compiles
                took, steps = least(call, count)
                rows.append({"kind": "call", "scene": name, "what": what, "ms": took,
                             "steps_ms": steps})  # fmt: skip
    for what, asked in ASKED.items():
        some = [row for row in rows if row["what"] == what]
        worst = max(r["ms"] - ("steps" in what) * r["steps_ms"] for r in some)
        rows.append(harness.at_most(what, asked, worst, "ms"))
    return rows


def report(rows):
    columns = " {what} | scene {scene} | ms {ms:.2f} | in steps {steps_ms:.2f}"
    harness.show("least of 1,000 calls on one thread", harness.of_kind(rows, "call"), columns)
    harness.report_targets(rows)
