"""Multilevel Monte Carlo against plain members with a single step, and coverage of its intervals.

A fast top in a cold bath, and the mean of its omega_1 after 10 s, at three widths. Costs are in
steps and in CPU time, which includes starts and the noise of two steps. Plain members have the step
and the number that cost least for the same interval, derived from the study's measurements.
A second scene starts in thermal equilibrium and stays there, so that its mean energy is known. Many
small studies count how many intervals contain it.
"""

import math
import time
import warnings

import numpy as np

from bench import harness
from rigidmc import (
    Bath,
    Body,
    GibbsMomentum,
    Gravity,
    Pointing,
    Scene,
    SceneWarning,
    Start,
    multilevel,
    simulate,
)
from rigidmc.studies.framework.members import compute_batches
from rigidmc.studies.multilevel.study import plain_members

WIDTHS = (1e-3, 3e-4, 1e-4)  # rad/s; the spread over members is 0.093
PLAIN = 3e-4  # the finest width at which all plain members are run
CHUNK = 2**17  # plain members at once
SAMPLE = 2**17  # plain members that measure the cost of larger numbers
KT, WEIGHT = 0.7, 1.5  # of the top in equilibrium


def top():
    """Return a symmetric top of spin 4 rad/s that leans by 1 rad, in a bath of 0.3 % of its
    weight."""
    body = Body.from_moments((1.0, 1.0, 1.5), mass=1.0, centre=(0.0, 0.0, 0.3))
    effects = Gravity(5.0), Bath(gamma=0.2, kT=0.005)
    start = Start(omega=(0.0, 0.0, 4.0), attitude=(0.0, 1.0, 0.0))
    return Scene(body, effects, start).with_run(integrator="strang", dt=0.4, t_end=10.0, seed=1)


def equilibrium():
    """Return (a heavy body that starts and stays in thermal equilibrium, its mean energy)."""
    body = Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.0, 0.0, 0.3))
    x = WEIGHT / KT
    start = Start(momentum=GibbsMomentum(KT), attitude=Pointing((0.0, 0.0, -1.0), kappa=x))
    scene = Scene(body, (Gravity(WEIGHT / 0.3), Bath(1.0, KT)), start)
    potential = WEIGHT * (1.0 / x - 1.0 / math.tanh(x))  # of Langevin
    return scene.with_run(integrator="strang", dt=0.8, t_end=4.0), 1.5 * KT + potential


def covered(studies, width=0.06, batch=256):
    """Return (studies, 2): whether the truth is in the interval, and in that of level 0 alone."""
    scene, truth = equilibrium()
    inside = []
    for seed in range(studies):
        found = multilevel(
            scene, f"mean(energy_final) +- {width}", batch=batch, threads=1, seed=seed
        )
        first = found.isel(level=0)
        off = abs(float(first["mean"]) - truth) / float(first.error)
        inside.append([float(found.low) < truth < float(found.high), off < 1.96])
    return np.array(inside)


def by_levels(width):
    """Return (study, CPU seconds) at a width."""
    began = time.process_time()
    found = multilevel(top(), f"mean(omega_final[1]) +- {width}", threads=1)
    return found, time.process_time() - began


def steps_of(study):
    """Return the steps of a study's members, including fine and coarse paths."""
    both = np.where(study.level > 0, 1.5, 1.0)
    return float((study.members * study.steps * both).sum())


def plain(study, width, most=None):
    """Return a row about the plain members that give the interval of a study; `most` : number that
    is run to represent all."""
    asked = plain_members(study, width)
    run = min(most or asked.members, asked.members)
    scene = top().with_run(
        dt=10.0 / asked.steps, members=run, every=10.0, save=("omega",), keep="final"
    )
    simulate(scene, members=32, threads=1)  # compiles
    began = time.process_time()
    parts = compute_batches(scene, CHUNK, 1, None)
    values = np.concatenate([part.omega_final.sel(axis=1).values for part in parts])
    seconds = time.process_time() - began
    return harness.row(
        "plain",
        width=width,
        steps=asked.steps,
        members=asked.members,
        run=run,
        mean=float(values.mean()),
        error=float(values.std()) / math.sqrt(run),
        cost=float(asked.members * asked.steps),
        seconds=seconds * asked.members / run,
    )


def measured(quick):
    warnings.simplefilter("ignore", SceneWarning)
    by_levels(1e-2)  # compiles
    rows = []
    for width in WIDTHS[:2] if quick else WIDTHS:
        study, seconds = by_levels(width)
        rows.append(
            harness.row(
                "levels",
                width=width,
                levels=study.sizes["level"],
                mean=float(study.value),
                half=float(study.half[-1]),
                cost=steps_of(study),
                seconds=seconds,
            )
        )
        rows.append(plain(study, width, SAMPLE if quick or width < PLAIN else None))
    ours = [row for row in rows if row["kind"] == "levels"]
    theirs = [row for row in rows if row["kind"] == "plain"]
    pairs = list(zip(ours, theirs, strict=True))
    slope = np.polyfit(*(np.log([r[k] for r in ours]) for k in ("half", "seconds")), 1)[0]
    steps = np.polyfit(*(np.log([r[k] for r in ours]) for k in ("half", "cost")), 1)[0]
    return [
        *rows,
        harness.target("order of the cost in the width, in steps", -2.2, steps),
        harness.target("order of the cost in the width, in processor time", -2.2, slope),
        *(
            harness.target(
                f"plain members over levels, +- {mine['width']:g} rad/s, in {word}",
                10.0 if mine is ours[-1] else 1.0,
                other[key] / mine[key],
                "times",
                note="" if other["run"] == other["members"] else "time of a sample",
            )
            for mine, other in pairs
            for key, word in (("cost", "steps"), ("seconds", "processor time"))
        ),
    ]


def show(rows):
    harness.show(
        "mean of omega_1 after 10 s",
        [row for row in rows if row["kind"] in ("levels", "plain")],
        " {kind} | +- rad/s {width:g} | mean {mean:.6f} | {how} | steps of members {cost:.3g}"
        " | processor s {seconds:.1f}",
        how=lambda row: (
            f"{row['levels']} levels" if row["kind"] == "levels" else f"{row['steps']:,} steps"
        ),
    )
