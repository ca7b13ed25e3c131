"""One fit of one record by `rm.fit` and by other programs: seconds, and the error of the answer.

A phone of unknown moments spins about its middle axis for 2 s, read at 100 Hz with .002 rad/s of
noise. `rm.fit` fits moments and start from 100 guesses, and returns intervals; scipy fits both from
one guess; mujoco.sysid and gradsolve fit the moments from the true start. Times are without imports
and compilation. The other programs run in the interpreter of --python.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

import rigidmc as rm
from bench import harness

MOMENTS, START = np.array([2.13e-4, 8.11e-4, 1e-3]), np.array([0.3, 12.0, 0.2])
NOISE, EVERY, SAMPLES = 2e-3, 0.01, 201
OTHERS = ("scipy", "mujoco_sysid", "gradsolve")


def record():
    """Return the times, the rates with noise, and a first guess of the moments."""
    scene = rm.Scene(rm.Body(tuple(MOMENTS)), start=rm.Start(omega=tuple(START)))
    span = EVERY * (SAMPLES - 1)
    motion = rm.simulate(
        scene, integrator="exact", dt=EVERY, t_end=span, every=EVERY, save="omega", members=1
    )
    noise = NOISE * np.random.default_rng(0).normal(size=(SAMPLES, 3))
    return motion.time.values, motion.omega.values[..., 0] + noise, MOMENTS * (1.1, 1.03, 1.0)


def row_of(name, seconds, moments, deviation=None):
    """Return a row: the error of the ratios I1/I3 and I2/I3, and the deviation that is claimed."""
    ratios, truth = moments[:2] / moments[2], MOMENTS[:2] / MOMENTS[2]
    error = [float(x) for x in np.abs(ratios - truth)]
    claimed = deviation or [None, None]
    return harness.row(
        "fit", name=name, seconds=seconds, error_1=error[0], error_2=error[1],
        claimed_1=claimed[0], claimed_2=claimed[1],
    )  # fmt: skip


def run(quick, python=sys.executable):
    """Return a row for each program that is here."""
    t, y, guess = record()
    scene = rm.Scene(rm.Body(tuple(guess)), start=rm.Start(omega=tuple(y[0])))
    data = {"t": t, **{f"omega[{i + 1}]": y[:, i] for i in range(3)}}

    def fit(trials):
        free, noise = "body.moments,start.omega", {"omega": NOISE}
        return rm.fit(scene, data, free, noise=noise, trials=trials)

    rows = []
    for trials, name in ((1, "rigidmc, one guess"), (100, "rigidmc, 100 guesses")):
        study, seconds = fit(trials), []  # compiles
        for _ in range(1 if quick else 5):
            began = time.perf_counter()
            fit(trials)
            seconds.append(time.perf_counter() - began)
        deviation = study.ratio_deviation.values[:2, 2].tolist()
        moments = study.value.values[0, :3]
        rows.append(row_of(name, float(np.median(seconds)), moments, deviation))
    with tempfile.TemporaryDirectory(prefix="rigidmc-fit-") as folder:
        file = os.path.join(folder, "record.npz")
        np.savez(file, t=t, y=y, guess=guess, start=START)
        script = os.path.join(harness.HERE, "fit_process.py")
        for name in OTHERS:
            done = subprocess.run([python, script, file, name], capture_output=True, text=True)
            answer = json.loads(done.stdout) if done.returncode == 0 else {"missing": done.stderr}
            if "missing" in answer:
                print(f"{name} is not here: {answer['missing'].strip().splitlines()[-1]}")
                continue
            rows.append(row_of(name, answer["seconds"], np.array(answer["moments"])))
    return rows


def report(rows):
    """Print the rows."""
    columns = (
        "program {name} | seconds {seconds:.3g} | error of I1/I3 {error_1:.1e} |"
        " of I2/I3 {error_2:.1e} | deviation claimed {claimed_1:.1e} | {claimed_2:.1e}"
    )
    harness.show("one record, one answer", harness.of_kind(rows, "fit"), columns)
