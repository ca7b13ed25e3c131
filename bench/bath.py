"""A bath against the Gibbs distribution with a million members: moments of L, energy, Langevin
mean.

Also how the bias falls with the step, and the cost of a step of strang in a bath against one
without: noise, and two halves of the free motion in place of one.
"""

import math
import statistics

import numpy as np

from bench import harness
from rigidmc import Bath, Body, Gravity, Scene, Start, simulate
from rigidmc.physics.dynamics.so3 import vertical

MOMENTS, KT, WEIGHT = (1.0, 1.4, 2.0), 0.7, 1.5
# of order h^2: at 0.05 the bias of <L^2> is a quarter of its standard error
STEPS = (0.8, 0.4, 0.2, 0.1, 0.05)
COSTS = {"": (), "bath": (Bath(1.0, KT),)}
COST_MEMBERS, COST_STEPS = 8128, 500  # two blocks: everything except steps takes 5 %


def scene():
    """Return a heavy body in a bath with damping rate 1, from rest and any attitude to t = 12."""
    body = Body.from_moments(MOMENTS, mass=1.0, centre=(0.0, 0.0, 0.3))
    bathed = Scene(
        body,
        (Gravity(WEIGHT / 0.3), Bath(1.0, KT)),
        Start(omega=(0.0, 0.0, 0.0), attitude="uniform"),
    )
    return bathed.with_run(integrator="strang", t_end=12.0, seed=1, save=("momentum", "attitude"))


def moments(dt, members):
    """Return [(quantity, theory, mean, standard error)] of the last state."""
    ds = simulate(scene(), dt=dt, members=members)
    l = ds.momentum.values[-1] / np.sqrt(np.array(MOMENTS) * KT)[:, None]
    u = vertical(tuple(ds.attitude.values[-1]))[2]
    x, n = WEIGHT / KT, members

    def mean(values):
        return float(values.mean()), float(values.std()) / math.sqrt(n)

    rows = [(f"<L_{i + 1}^2>/(I_{i + 1} kT)", 1.0, *mean(l[i] ** 2)) for i in range(3)]
    rows += [
        (
            f"kurtosis of L_{i + 1}",
            3.0,
            float((l[i] ** 4).mean() / (l[i] ** 2).mean() ** 2),
            math.sqrt(24.0 / n),
        )
        for i in range(3)
    ]
    rows += [(f"<L_{i + 1}>", 0.0, *mean(l[i])) for i in range(3)]
    heat, error = mean(0.5 * (l**2).sum(0))
    rows += [("<T>/kT", 1.5, heat, error), ("<cos theta>", 1.0 / x - 1.0 / math.tanh(x), *mean(u))]
    return rows


def costs(rounds):
    """Return rows with the CPU time of a step on one thread, and against one without noise."""
    body, start = scene().body, Start(omega=(0.3, 0.4, 0.5), attitude="uniform")
    cpu = {}

    def candidate(effects):
        one = Scene(body, (Gravity(WEIGHT / 0.3), *effects), start).with_run(
            integrator="strang", dt=0.1, t_end=0.1 * COST_STEPS, members=COST_MEMBERS, seed=1
        )
        return lambda: simulate(one, save=("attitude",), threads=1)

    harness.interleaved({name: candidate(e) for name, e in COSTS.items()}, rounds, cpu)
    for name in COSTS:
        yield harness.row(
            "cost",
            what=name,
            ns=1e9 * statistics.median(cpu[name]) / (COST_MEMBERS * COST_STEPS),
            ratio=statistics.median(a / b for a, b in zip(cpu[name], cpu[""], strict=True)),
        )


def run(quick):
    members, cost = 100_000 if quick else 1_000_000, list(costs(5 if quick else 15))
    rows = [
        {"kind": "moment", "dt": dt, "what": w, "theory": t, "mean": m, "error": e}
        for dt in STEPS
        for w, t, m, e in moments(dt, members)
    ]
    finest = [r for r in rows if r["dt"] == STEPS[-1]]
    worst = max(finest, key=sigmas)
    bias = {r["dt"]: r["mean"] - 1.5 for r in rows if r["what"] == "<T>/kT"}
    return [
        *cost,
        *rows,
        harness.at_most(
            f"moments from theory at dt = {STEPS[-1]:g}, worst ({worst['what']})",
            3.0,
            sigmas(worst),
            "standard errors",
        ),
        harness.target(
            "order of the bias of <T>, from dt = 0.8 to 0.4 (standard error 0.06)",
            1.85,
            math.log2(bias[0.8] / bias[0.4]),
        ),
        harness.at_most("a step of strang in a bath, of one without", 1.6, cost[-1]["ratio"], "x"),
    ]


def sigmas(row):
    """Return the distance of a mean from theory, in standard errors."""
    return abs(row["mean"] - row["theory"]) / row["error"]


def report(rows):
    moments = harness.of_kind(rows, "moment")
    harness.show(
        f"dt = {STEPS[-1]:g}",
        [r for r in moments if r["dt"] == STEPS[-1]],
        " {what} | Gibbs {theory:.6f} | mean {mean:.6f} | standard error {error:.6f}"
        " | errors apart {off:.2f}",
        off=sigmas,
    )
    harness.show(
        "bias of <T>",
        [r for r in moments if r["what"] == "<T>/kT"],
        "dt {dt:g} | of 3/2 kT {bias:+.5f} | standard error {part:.5f}",
        bias=lambda r: r["mean"] / 1.5 - 1.0,
        part=lambda r: r["error"] / 1.5,
    )
    columns = "effect besides gravity {what} | ns {ns:.1f} | of one without {ratio:.2f}"
    harness.show("a step of strang", harness.of_kind(rows, "cost"), columns)
    harness.report_targets(rows)
