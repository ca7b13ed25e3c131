"""The cost of an effect: the time that it adds to a step, compared with its operations.

Also a test that an effect which a scene does not use adds nothing.
"""

import hashlib
import itertools
import json
import os
import re
import subprocess
import sys

import numpy as np

from bench import harness
from bench.problems import tops
from rigidmc.engine.inspection import step_operations, torque_operations
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import lanes_for
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import from_numbers, is_random
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.price import cost_per_step, prices
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start
from tests.tools.assembly import assembly_of, case, counted

MEMBERS, STEPS, H = 16384, 300, 0.01
SCENES = (
    "kapitza_top",
    "hyperion",
    "damped_dzhanibekov",
    "magnetic_needle",
    "brownian_rotor",
    "gyrostat_wheel",
)
ASKED = 1.2


def some(kind):
    """Return an effect with all numbers 0.1."""
    return from_numbers(kind, itertools.repeat(0.1))


def added(quick):
    """Return rows with the time that each effect adds to a free rk4 step, interleaved."""
    ensemble, pool = tops.random_tops(MEMBERS), tops.pool(threads_available())
    steps_form = scheme_of(INTEGRATORS["rk4"], TurnBounds(0.1), ())

    def run(effects):
        def move(parts):
            tops.advance(parts, steps_form, effects, True, H, STEPS, pool)

        return lambda: tops.blocks(ensemble, effects), move

    kinds = {name: some(kind) for name, kind in EFFECTS.items() if not is_random(kind)}
    field = {"none": run(())} | {name: run((effect,)) for name, effect in kinds.items()}
    cpu: dict[str, list[float]] = {}
    harness.interleaved(field, 3 if quick else 15, cpu)
    share = 1e9 / (MEMBERS * STEPS)
    bare, base = step_operations(steps_form, (), True), counted(case("rk4"))["slots"]
    each, rows = share * harness.median(cpu["none"]), []
    for name, effect in kinds.items():
        more = step_operations(steps_form, (effect,), True).less(bare)
        issued = counted(case("rk4", (effect,)))["slots"] - base
        more_ns = [share * (a - b) for a, b in zip(cpu[name], cpu["none"], strict=True)]
        rows.append(
            {"kind": "added", "what": name, "ns": harness.median(more_ns),
            "torque": torque_operations(effect), "step": more,
             "slots": more.slots, "issued": issued, "base_ns": each, "base_slots": bare.slots,
             "base_issued": base}
        )  # fmt: skip
    return rows


def told(name):
    """Fingerprint the kernel with gravity alone, in a process that has all effects or only one:
    digests of its instructions and of its result.
    """
    script = f"""
import rigidmc.physics.effects as e
for word in [word for word in e.EFFECTS if {name!r} not in ("", word)]:
    del e.EFFECTS[word]
import json
from bench.effects import fingerprint
print(json.dumps([len(e.EFFECTS), *fingerprint()]))
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": "."},
    )
    return json.loads(done.stdout.splitlines()[-1])


def fingerprint():
    """Return (instructions, their digest, digest of a result) of rk4 with gravity."""
    words = [
        line.split()[0]
        for line in assembly_of(
            case("rk4", (some(EFFECTS["gravity"]),)), lanes_for("float64")
        ).splitlines()
        if re.match(r"\t[a-z]", line)
    ]
    ensemble, gravity = tops.random_tops(256), (some(EFFECTS["gravity"]),)
    parts = tops.blocks(ensemble, gravity)
    tops.advance(
        parts,
        scheme_of(INTEGRATORS["rk4"], TurnBounds(0.1), ()),
        gravity,
        True,
        H,
        100,
        tops.pool(1),
    )
    digest = [
        hashlib.sha256(x).hexdigest()[:16]
        for x in (" ".join(words).encode(), np.concatenate(parts, axis=1).tobytes())
    ]
    return len(words), *digest


def run(quick):
    rows = added(quick)
    every, one = told(""), told("gravity")
    rows += [
        {"kind": "absent", "known": known, "instructions": count, "code": code, "result": result}
        for known, count, code, result in (every, one)
    ]
    for name in SCENES:
        scene = Scene.load(name)
        ready = prepare_scene(scene)
        free, _, _, noise, predicted = prices(ready)
        cost = min(cost_per_step(ready) for _ in range(1 if quick else 5))
        rows.append(
            harness.row(
                "scene", what=name, free=free, noise=noise, predicted=predicted, measured=cost
            )
        )
    rows += noise_rows(3 if quick else 15)
    noise = {r["what"]: r["noisy"] / r["quiet"] for r in rows if r["kind"] == "noise"}
    worst = max(
        (r for r in rows if r["kind"] == "added" and r["ns"] > 0.5),
        key=lambda r: against(r, "slots"),
    )
    within = [
        r
        for r in rows
        if r["kind"] == "added" and (r["ns"] <= 0.5 or against(r, "issued") <= ASKED)
    ]
    return [
        *rows,
        harness.at_most(
            f"instructions that {len(EFFECTS) - 1} absent effects add",
            0,
            every[1] - one[1] if every[2] == one[2] else None,
        ),
        harness.target("results with them and without, digits alike", 1, float(every[3] == one[3])),
        harness.at_most(
            f"time added against operations, worst ({worst['what']})",
            ASKED,
            against(worst, "slots"),
            "x",
        ),
        harness.target(
            f"effects that add less than 0.5 ns or no more than {ASKED} of the instructions issued",
            sum(r["kind"] == "added" for r in rows),
            len(within),
        ),
        *[
            harness.at_most(f"a noisy step of strang against the quiet one, {what}", 3.0, x, "x")
            for what, x in noise.items()
        ],
    ]


def noise_rows(rounds):
    """Return the time that a bath adds to a strang step with gravity, for a general body at two
    step angles and for a body with two equal moments.
    """
    rows, start = [], Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))
    for what, moments, dt in (
        ("0.1 rad a step", (1.0, 1.4, 2.0), 0.1),
        ("0.3 rad a step", (1.0, 1.4, 2.0), 0.3),
        ("two equal moments", (1.0, 1.0, 2.0), 0.1),
    ):
        quiet = Scene(
            Body.from_moments(moments, mass=1.0, centre=(0.0, 0.0, 0.3)),
            (EFFECTS["gravity"](1.0),),
            start,
        )
        quiet = quiet.with_run(
            integrator="strang", dt=dt, t_end=10 * dt, save=("attitude",), checks=False
        )
        noisy = Scene(quiet.body, (*quiet.effects, EFFECTS["bath"](1.0, 1.0)), start, quiet.run)
        runs = [prepare_scene(scene) for scene in (quiet, noisy)]
        ns = np.median([[cost_per_step(one) for one in runs] for _ in range(rounds)], axis=0)
        rows.append({"kind": "noise", "what": what, "quiet": float(ns[0]), "noisy": float(ns[1])})
    return rows


def against(row, what):
    """Return the time that an effect adds, relative to the time of its operations at the pace of
    the step without it.
    """
    return row["ns"] / (row["base_ns"] * row[what] / row["base_" + what])


def report(rows):
    added = harness.of_kind(rows, "added")
    harness.show(
        "added to a step of rk4 with attitude ({base_ns:.2f} ns of CPU time, {base_slots}"
        " operations, {base_issued:.0f} instructions)".format(**added[0]),
        added,
        "effect {what} | ns added {ns:.2f} | a torque {torque} | operations a step {slots:.0f}"
        " | time against them {by_slots:.2f} | instructions {issued:.0f}"
        " | time against them {by_issued:.2f}",
        by_slots=lambda r: against(r, "slots"),
        by_issued=lambda r: against(r, "issued"),
    )
    harness.show(
        "a kernel with gravity alone",
        harness.of_kind(rows, "absent"),
        " {known} effects known | instructions {instructions} | digest of them {code}"
        " | digest of the result {result}",
    )
    harness.show(
        "price of a step, ns",
        harness.of_kind(rows, "scene"),
        "scene {what} | without effects {free:.2f} | predicted {predicted:.2f}"
        " | measured {measured:.2f} | ratio {ratio:.2f}",
        ratio=lambda r: r["measured"] / r["predicted"],
    )
    harness.show(
        "a step of strang with gravity, ns",
        harness.of_kind(rows, "noise"),
        " {what} | quiet {quiet:.2f} | in a bath {noisy:.2f} | ratio {ratio:.2f}",
        ratio=lambda r: r["noisy"] / r["quiet"],
    )
    harness.report_targets(rows)
