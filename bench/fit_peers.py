"""One fit of one record by `rm.fit` and by other programs: seconds, and the error of the answer.

A phone spins about its middle axis for 4 s and flips three times, read at 100 Hz with .002 rad/s of
noise. `rm.fit` fits moments and start, and returns intervals; scipy fits both from one guess;
mujoco.sysid and gradsolve fit the moments from the true start. Times are without imports and
compilation. The other programs run in the interpreter of --python.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

import rigidmc as rm
from bench import harness

MOMENTS, OMEGA = np.array([0.25, 0.85, 1.0]), np.array([0.8, 9.0, 0.5])
NOISE, EVERY, END = 0.002, 0.01, 4.0
TIMES = np.arange(0.0, END + 1e-9, EVERY)
GUESS = MOMENTS * (1.1, 1.03, 1.0)
OTHERS = ("scipy", "mujoco_sysid", "gradsolve")


def rates(ratios, omega, t=TIMES):
    """Return the rates (n, 3) of a free body by SciPy; ratios : I1/I3, I2/I3"""
    i1, i2, i3 = *ratios, 1.0
    found = solve_ivp(
        lambda _, w: [(i2 - i3) * w[1] * w[2] / i1, (i3 - i1) * w[2] * w[0] / i2,
                      (i1 - i2) * w[0] * w[1] / i3],
        (0.0, t[-1]), omega, "DOP853", t, rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    return found.y.T


def differences(of, x, steps=1e-6):
    """Return the derivatives of `of` by central differences."""
    each = steps * np.eye(x.size)
    return np.stack([(of(x + d) - of(x - d)) / (2.0 * steps) for d in each], axis=-1)


@cache
def bound():
    """Return the deviations of I1/I3 and I2/I3 by the bound of Cramer and Rao."""
    x = np.array([*MOMENTS[:2], *OMEGA])
    slopes = differences(lambda p: rates(p[:2], p[2:]).ravel(), x)
    return NOISE * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))[:2]


def record(noise=NOISE, seed=0):
    """Return (times, rates) of a free body that flips three times."""
    omega = rates(MOMENTS[:2], OMEGA)
    return TIMES, omega + noise * np.random.default_rng(seed).normal(size=omega.shape)


def fit(seed, trials):
    """Return the study of a record."""
    t, y = record(seed=seed)
    scene = rm.Scene(rm.Body(tuple(GUESS)), start=rm.Start(omega=tuple(y[0])))
    data = {"t": t, **{f"omega[{i + 1}]": y[:, i] for i in range(3)}}
    return rm.fit(scene, data, "body.moments,start.omega", noise={"omega": NOISE}, trials=trials)


def row_of(name, seconds, moments, deviation=None):
    """Return a row: the error of the ratios I1/I3 and I2/I3, and the deviation that is claimed."""
    ratios, truth = moments[:2] / moments[2], MOMENTS[:2] / MOMENTS[2]
    error = [float(x) for x in np.abs(ratios - truth)]
    claimed = deviation or [None, None]
    return harness.row(
        "peer", name=name, seconds=seconds, error_1=error[0], error_2=error[1],
        claimed_1=claimed[0], claimed_2=claimed[1],
    )  # fmt: skip


def run(quick, python=sys.executable):
    """Return a row for each program that is here."""
    rows = []
    for trials, name in ((1, "rigidmc, one guess"), (100, "rigidmc, 100 guesses")):
        study, seconds = fit(0, trials), []  # compiles
        for _ in range(1 if quick else 5):
            began = time.perf_counter()
            fit(0, trials)
            seconds.append(time.perf_counter() - began)
        deviation = study.ratio_deviation.values[:2, 2].tolist()
        moments = study.value.values[0, :3]
        rows.append(row_of(name, float(np.median(seconds)), moments, deviation))
    with tempfile.TemporaryDirectory(prefix="rigidmc-fit-") as folder:
        file = os.path.join(folder, "record.npz")
        t, y = record()
        np.savez(file, t=t, y=y, guess=GUESS, start=OMEGA)
        script = os.path.join(harness.HERE, "fit_process.py")
        for name in OTHERS:
            done = subprocess.run([python, script, file, name], capture_output=True, text=True)
            answer = json.loads(done.stdout) if done.returncode == 0 else {"missing": done.stderr}
            if "missing" in answer:
                print(f"{name} is not here: {answer['missing'].strip().splitlines()[-1]}")
                continue
            rows.append(row_of(name, answer["seconds"], np.array(answer["moments"])))
    return rows


def show(rows):
    """Print the rows."""
    columns = (
        "program {name} | seconds {seconds:.3g} | error of I1/I3 {error_1:.1e} |"
        " of I2/I3 {error_2:.1e} | deviation claimed {claimed_1:.1e} | {claimed_2:.1e}"
    )
    harness.show("one record, one answer", harness.of_kind(rows, "peer"), columns)
