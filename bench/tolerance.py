"""Test whether `--tolerance` keeps its promise in every shipped scene, and its predictions hold.

The predictions are of time and error.
"""

import math
import os
import tempfile

import numpy as np

import rigidmc
from bench import harness
from rigidmc.errors import RigidmcError
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.planning.tolerance.deviation import errors
from rigidmc.planning.tolerance.pilot import pilot
from rigidmc.planning.tolerance.truth import make_reference
from rigidmc.scene.library import shipped_names
from rigidmc.studies.accuracy.study import accuracy

TOLERANCES = (1e-4, 1e-7, 1e-10)
SAVED = ("final state", "all in memory", "all in a file")
# members outside all pilots; members of a run whose time is predicted
FIRST, JUDGED, MANY = (20_000, 1000, 100_000)


def run(quick):
    rows = []
    for name in ("heavy_top", "nasa_brick") if quick else shipped_names():
        for tolerance in TOLERANCES:
            rows.append(kept(name, tolerance))
    for name in ("heavy_top",) if quick else ("heavy_top", "dzhanibekov", "cylinder_on_edge"):
        for tolerance in (1e-4, 1e-7):
            rows += [predicted(name, tolerance, saved) for saved in SAVED]
        rows += study_errors(name)
    shares = [r["share"] for r in rows if r["kind"] == "kept" and r["share"] is not None]
    off = {
        saved: 100.0
        * max(
            abs(r["seconds"] / r["predicted_seconds"] - 1.0)
            for r in rows
            if r["kind"] == "time" and r["saved"] == saved
        )
        for saved in SAVED
    }
    memory = (
        "a virtual machine gets memory from its host as it is first touched, 2 s/GB here "
        "or nothing: not to be foreseen"
    )
    notes = {"all in memory": memory}
    factors = [max(r["ratio"], 1.0 / r["ratio"]) for r in rows if r["kind"] == "error"]
    return [
        *rows,
        harness.target(
            "members within the tolerance, fewest of all scenes", 99.0, 100.0 * min(shares), "%"
        ),
        *(
            harness.at_most(
                f"time of 100,000 members off its prediction, {saved}, worst",
                25.0,
                off[saved],
                "%",
                note=notes.get(saved, ""),
            )
            for saved in SAVED
        ),
        harness.at_most(
            "error of 99 % of other members over that of the study, worst", 2.0, max(factors), "x"
        ),
    ]


def others(scene, count):
    """Return members outside all pilots, and their truth."""
    other = pilot(scene, count, first=FIRST)
    return other, make_reference(other)


def kept(name, tolerance):
    """Return the fraction of a scene's other members within a tolerance at all compared times."""
    scene = rigidmc.Scene.load(name)
    alike = scene.run.members == 1
    row = {"kind": "kept", "scene": name, "tolerance": tolerance}
    try:
        other, true = others(scene, 1 if alike else JUDGED)
        ds = rigidmc.simulate(
            scene,
            tolerance=tolerance,
            save=("momentum", "attitude"),
            members=range(other.first, other.first + other.members),
        )
    except RigidmcError as error:
        return {**row, "share": None, "why": error.rule}
    at = np.searchsorted(ds.time.values, other.times * (1.0 - 1e-9))
    l, q = (ds[x].values[at] for x in ("momentum", "attitude"))
    states = true.states._replace(q=q, l=l)
    apart = errors(other._replace(carried=True), states, true.states)
    turned = attitude_error(np.moveaxis(q, 1, -1), np.moveaxis(true.states.q, 1, -1)).max(0)
    apart = np.maximum(apart["momentum"], turned if other.carried else 0.0)
    share, way = float(np.mean(apart <= tolerance)), ds.attrs["tolerance_chosen"].split(":")[0]
    return {
        **row,
        "share": share,
        "worst": float(apart.max()),
        "p99": float(np.quantile(apart, 0.99)),
        "chosen": way,
        "truth": true.source,
    }


def predicted(name, tolerance, saved):
    """Return seconds of a run of 100,000 members, median of three, and the prediction before."""
    scene = rigidmc.Scene.load(name)
    scene = scene.with_run(every=scene.run.t_end) if saved == "final state" else scene
    seconds, prediction, chosen = [], math.nan, ""
    with tempfile.TemporaryDirectory() as folder:
        for i in range(3):
            output = os.path.join(folder, f"{i}.nc") if saved == "all in a file" else None
            ds = rigidmc.simulate(
                scene, tolerance=None if i else tolerance, members=MANY, output=output
            )
            seconds.append(ds.encoding["rigidmc"]["run_seconds"])
            if i == 0:
                prediction, chosen = (
                    ds.encoding["rigidmc"]["predicted_seconds"],
                    ds.attrs["tolerance_chosen"].split(":")[0],
                )
                scene = rigidmc.Scene.loads(ds.attrs["scene"])
            ds.close()
            del ds
    row = {"kind": "time", "scene": name, "saved": saved, "tolerance": tolerance, "chosen": chosen}
    return {
        **row,
        "seconds": harness.median(seconds),
        "all_seconds": seconds,
        "predicted_seconds": prediction,
    }


def study_errors(name):
    """Return the error of 99 % of other members against that of the study, at two accuracies."""
    from rigidmc.planning.tolerance.pilot import integrate_pilot

    scene, rows = rigidmc.Scene.load(name), []
    study = accuracy(
        scene, ("rk4", "rk8", "srkn6") if scene.effects else ("rk4", "rk8"), (1e-4, 1e-7)
    )
    other, true = others(scene, JUDGED)
    for row in sorted(set(study.cheapest.values) - {-1}):
        integrator, dtype, steps = (study[x].values[row] for x in ("integrator", "dtype", "steps"))
        if not np.isnan(study.turn.values[row]):
            steps = other.turn(1.0) / study.turn.values[row]
            other = other._replace(member_steps=True)
        apart = errors(
            other,
            integrate_pilot(other, integrator, steps if other.member_steps else int(steps), dtype),
            true.states,
        )["state"]
        rows.append({"kind": "error", "scene": name, "integrator": integrator, "dtype": dtype,
            "steps": float(steps),
                     "study": float(study.error_state_p99.values[row]),
                     "others": float(np.quantile(apart, 0.99)),
                     "ratio": float(np.quantile(apart,
                     0.99) / study.error_state_p99.values[row])})  # fmt: skip
    return rows


def report(rows):
    kept = [
        {"p99": None, "worst": None, "chosen": r.get("why", "")[:100], **r}
        for r in harness.of_kind(rows, "kept")
    ]
    harness.show(
        "run --tolerance on members that no pilot has seen",
        kept,
        "scene {scene} | asked {tolerance:.0e} | keep it {kept} | 99 % {p99:.1e}"
        " | worst {worst:.1e} | chosen {chosen}",
        kept=lambda r: "refused" if r["share"] is None else f"{100 * r['share']:.1f} %",
    )
    harness.show(
        f"{MANY:,} members",
        harness.of_kind(rows, "time"),
        "scene {scene} | saves {saved} | asked {tolerance:.0e}"
        " | predicted s {predicted_seconds:.2f} | s {seconds:.2f} | chosen {chosen}",
    )
    harness.show(
        "error of 99 % of the members",
        harness.of_kind(rows, "error"),
        "scene {scene} | {integrator} | {dtype} | steps {steps:.0f} | study {study:.1e}"
        " | others {others:.1e} | ratio {ratio:.2f} |",
    )
    harness.report_targets(rows)
