"""Monitored quantities against steps of 1 ms: errors by length of step, and the cost in a step.

Heavy tops with three different moments and a centre of mass off all axes, attitudes over the whole
sphere. The error of the motion itself is listed for comparison: no dense output can be better.
"""

import statistics
import warnings

import numpy as np

import rigidmc as rm
from bench import harness
from rigidmc.runs.prepare import prepare_scene

TOPS = rm.Scene(
    rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.2, 0.3)),
    (rm.Gravity(9.81),),
    rm.Start(omega=tuple(rm.normal(0.0, 2.0) for _ in range(3)), attitude="uniform"),
)
T_END = 25.0
INTEGRATORS = ("rk4", "rk8", "strang")
TURNS = (0.1, 0.3, 0.8, 1.6, 1.8)  # rad per step
CONE = rm.Passage(3, 1.2)
MANY = ("nutation", "precession", "flips", CONE, "attitude")
COSTS = {
    "nutation": ("nutation",), "precession": ("precession",), "passage": (CONE,),
    "flips": ("flips",), "omega_mean": ("omega_mean",), "omega_max": ("omega_max",),
}  # fmt: skip
STEPS = 1000  # of a member: everything except steps takes 2 % of a run of rk8
ASKED = {("rk8", 1.6): 15.0, ("rk4", 0.3): 20.0}  # percent of a step, for one quantity


def run(quick):
    warnings.simplefilter("ignore", rm.SceneWarning)  # long steps, on purpose
    members, rounds = (40, 3) if quick else (400, 15)
    rows = list(errors(members))
    for integrator, turn in ASKED if quick else [(i, t) for i in INTEGRATORS for t in TURNS]:
        rows += costs(integrator, turn, rounds)
    return [*rows, *targets(rows)]


def errors(members):
    """Return a row for each integrator and step: the worst of all tops."""
    run = {"t_end": T_END, "every": T_END, "members": members, "seed": 3, "save": MANY}
    small = rm.simulate(TOPS, "rk8", dt=1e-3, **run)
    for integrator in INTEGRATORS:
        for turn in TURNS:
            ds = rm.simulate(TOPS, integrator, turn=turn, **run)

            def off(name, ds=ds):
                return np.abs(ds[name] - small[name]).values

            same = np.abs((ds.attitude * small.attitude).sum("quat").values[-1])
            yield harness.row(
                "error",
                integrator=integrator,
                turn=turn,
                members=members,
                nutation=float(max(off("nutation_min").max(), off("nutation_max").max())),
                precession=float(off("precession").max()),
                missed=int(off("passages").sum()),
                passages=int(small.passages.sum()),
                first=float(np.nanmax(off("passage_first"))),
                flips_off=int(off("flips").sum()),
                flips=int(small.flips.sum()),
                motion=float(2.0 * np.arccos(np.minimum(same, 1.0)).max()),
            )


def costs(integrator, turn, rounds):
    """Return rows with the cost of monitors in a step, in percent, on one thread, by CPU time."""
    plan = prepare_scene(TOPS.with_run(integrator=integrator, turn=turn, t_end=T_END)).plan
    pace = plan.mean_steps / T_END
    run = {"turn": turn, "t_end": STEPS / pace, "members": 2048}
    cpu = {}

    def candidate(save):
        scene = TOPS.with_run(integrator=integrator, save=("attitude", *save), **run)
        return lambda: rm.simulate(scene, threads=1)

    candidates = {"": candidate(()), **{name: candidate(save) for name, save in COSTS.items()}}
    harness.interleaved(candidates, rounds, cpu)
    for name in COSTS:
        ratios = [a / b for a, b in zip(cpu[name], cpu[""], strict=True)]
        yield harness.row(
            "cost",
            integrator=integrator,
            turn=turn,
            what=name,
            percent=100.0 * (statistics.median(ratios) - 1.0),
        )


def targets(rows):
    """Return the targets for each quantity."""
    for row in rows:
        asked = row["kind"] == "cost" and ASKED.get((row["integrator"], row["turn"]))
        if asked:
            what = f"{row['what']}, of a step of {row['integrator']} at {row['turn']} rad"
            yield harness.at_most(what, asked, row["percent"], "%")


def report(rows):
    harness.show(
        "against steps of 1 ms by rk8, the worst top",
        harness.of_kind(rows, "error"),
        " {integrator} | rad {turn} | nutation [rad] {nutation:.1e}"
        " | precession [rad] {precession:.1e} | passages missed {missed} of {passages}"
        " | first [s] {first:.1e} | flips off {flips_off} of {flips} | motion [rad] {motion:.1e}",
    )
    costs = harness.of_kind(rows, "cost")
    steps = dict.fromkeys((r["integrator"], r["turn"]) for r in costs)
    lines = [
        (*step, *(f"{r['percent']:.0f}" for r in costs if (r["integrator"], r["turn"]) == step))
        for step in steps
    ]
    harness.table("percent of a step", ("", "rad", *COSTS), lines)
    harness.report_targets(rows)
