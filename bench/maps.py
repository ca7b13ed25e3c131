"""Maps and large studies: time, memory and agreement with theory of every map.

Also ten million tops with flip statistics, costs of monitored quantities, and low-discrepancy
points. Each map runs as for a user: from the shell, with nothing compiled.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import xarray as xr

import rigidmc as rm
from bench import harness, startup
from bench.memory import peak
from rigidmc.studies.stability_map.cases import MAPS

SIDES = {"intermediate_axis": 512}
ASKED = {"intermediate_axis": 30.0, "heavy_chaos": 30.0}

# free tops to 50 turns, counting flips, no trajectories: a file of final values of each member
MILLIONS = """
import sys
import rigidmc as rm
start = rm.Start(omega=rm.Cone(2, 1.0, rm.uniform(1e-3, 0.1)))
scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start)
scene = scene.with_run(integrator="rk8", dt=0.6, save=("flips",))
rm.simulate(scene, members=int(sys.argv[1]), t_end=float(sys.argv[2]), output=sys.argv[3]).close()
"""


def shell(name, side, folder):
    """Return (seconds, gigabytes, Dataset) of `rigidmc map`."""
    file = os.path.join(folder, f"{name}.nc")
    command = startup.command(f"map {name} --resolution {side} -o", file, "--plot", file + ".png")
    began = time.perf_counter()
    memory = peak(command, folder)
    seconds = time.perf_counter() - began
    with xr.open_dataset(file) as dataset:
        return seconds, memory, dataset.load()


def agreement(name, ds):
    """Return the agreement of a map with theory: (words, number) or None."""
    if name in ("intermediate_axis", "growth"):
        if name == "growth":
            off = ds.error.values[np.isfinite(ds.error.values)]
            return "fraction of bodies whose growth rate is within 1 % of theory", float(
                (off < 0.01).mean()
            )
        return "flips of the median body", float(
            np.median(ds["mean(flips)"].values[ds.none.values == 0])
        )
    if name == "disturbance":
        return "largest relative error of the time between flips, disturbances above 1e-3", float(
            ds.error.values[ds.y.values > 1e-3].max()
        )
    if name in ("sleeping_top", "kapitza"):
        fallen, stable = ds["p(passages>=1)"].values > 0.5, ds.theory.values > 0.0
        wide = np.zeros_like(stable)
        for shift in [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]:
            wide |= np.roll(stable, shift, (0, 1)) != stable
        return "pixels on the wrong side of theory by more than one", float(
            (fallen == stable)[~wide].sum()
        )
    if name == "damped_axis":
        return "fraction that ends about neither end of axis 3", float((ds.end.values == 0).mean())
    megno = ds["mean(megno)"].values
    return ("largest MEGNO" if name == "kovalevskaya" else "fraction with MEGNO above 3"), float(
        np.nanmax(megno) if name == "kovalevskaya" else (megno[np.isfinite(megno)] > 3.0).mean()
    )


def prices(processes):
    """Return [(quantity, scene, ns, ns of the bare step)] of rk4 steps on one thread.

    Medians over processes, each of interleaved rounds. The stack position of a process changes a
    kernel's time by 10 %: registers spilled 4,096 bytes from a row of the workspace wait for that
    row.
    """
    script = (
        "import json; from rigidmc.runs.price import monitored_prices; "
        "print(json.dumps(monitored_prices(rounds=3)))"
    )
    measured = [
        json.loads(
            subprocess.run(
                [sys.executable, "-c", script], capture_output=True, text=True, check=True
            ).stdout
        )
        for _ in range(processes)
    ]
    rows = []
    for word, each in measured[0].items():
        bare = np.array([one[word][""] for one in measured])
        for what in each:
            if what:
                with_it = bare + [one[word][what] for one in measured]
                rows.append((what, word, float(np.median(with_it)), float(np.median(bare))))
    return rows


def fill(members):
    """Return {points: rms error} of a smooth result's mean, 8 seeds, against 2^20 Sobol points."""
    start = rm.Start(omega=(rm.normal(0.3, 0.1), rm.normal(1.0, 0.1), rm.normal(0.2, 0.1)))
    scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start).with_run(
        dt=0.1, t_end=5.0, save=("omega_mean",)
    )

    def value(points, count, seed):
        return (
            rm.simulate(scene.with_run(points=points), members=count, seed=seed)
            .omega_mean.values[1]
            .mean()
        )

    true = value("sobol", 2**20, 99)
    return {
        p: float(np.sqrt(np.mean([(value(p, members, s) - true) ** 2 for s in range(8)])))
        for p in ("independent", "latin_hypercube", "sobol")
    }


def run(quick):
    rows = []
    with tempfile.TemporaryDirectory(prefix="rigidmc-maps-") as folder:
        for name in MAPS:
            side = 32 if quick else SIDES.get(name, 256)
            os.environ["RIGIDMC_CACHE_DIR"] = os.path.join(folder, "cache", name)
            seconds, memory, ds = shell(name, side, folder)
            words, number = agreement(name, ds)
            rows.append(
                harness.row(
                    "map",
                    name=name,
                    side=side,
                    members=int(ds.attrs["members"]),
                    seconds=seconds,
                    gigabytes=memory,
                    words=words,
                    number=number,
                )
            )
            if name in ASKED:
                rows.append(
                    harness.at_most(
                        f"{name}, {side} x {side} x {ds.attrs['members']}, compile included",
                        ASKED[name],
                        seconds,
                        "s",
                    )
                )
        count, turns = 200_000 if quick else 10_000_000, 2.0 * np.pi * 50.0
        for t_end in (turns, 4.0 * turns):
            began = time.perf_counter()
            words = [str(count), str(t_end), os.path.join(folder, f"{t_end:.0f}.nc")]
            memory = peak([sys.executable, "-c", MILLIONS, *words], folder)
            seconds = time.perf_counter() - began
            rows.append(
                harness.row(
                    "millions", members=count, t_end=t_end, seconds=seconds, gigabytes=memory
                )
            )
            if t_end == turns:
                rows.append(
                    harness.at_most(
                        f"{count:.0e} free members to 50 turns with flips", 60.0, seconds, "s"
                    )
                )
                rows.append(harness.at_most("its memory", 1.5, memory, "GB"))
    for what, word, ns, bare in prices(1 if quick else 7):
        asked = 2.2 if what == "megno" else 1.1
        rows.append({"kind": "price", "what": what, "scene": word, "ns": ns, "bare": bare})
        rows.append(
            harness.at_most(
                f"{what}, {word} rk4 step with attitude", asked, ns / bare, "of the bare step"
            )
        )
    off = fill(2**12 if quick else 2**16)
    rows += [{"kind": "points", "points": word, "error": error} for word, error in off.items()]
    rows.append(
        harness.target(
            "error of independent points over that of Sobol points",
            10.0,
            off["independent"] / off["sobol"],
        )
    )
    return rows


def report(rows):
    harness.show(
        "maps",
        harness.of_kind(rows, "map"),
        " {name} | members {side}^2 x {members} | s {seconds:.1f} | GB {gigabytes:.2f}"
        " | against theory {number:.4g} | {words}",
    )
    harness.show(
        "flip statistics, no trajectories",
        harness.of_kind(rows, "millions"),
        " {members:,} to {t_end:.0f} s | s {seconds:.1f} | GB {gigabytes:.2f} |",
    )
    harness.show(
        "ns per member-step of rk4 on one thread",
        harness.of_kind(rows, "price"),
        " {what}, {scene} | bare {bare:.2f} | with it {ns:.2f} | ratio {ratio:.3f} |",
        ratio=lambda r: r["ns"] / r["bare"],
    )
    points = harness.of_kind(rows, "points")
    harness.show("error of the mean, 2^16 members", points, " {points} | rms {error:.2e} |")
    harness.report_targets(rows)
