"""The cost of accuracy: `rigidmc.accuracy` on random free and heavy tops.

Also whether the time of a step follows from its arithmetic.
"""

import math

import numpy as np

import rigidmc
from bench import harness
from bench.problems import tops
from rigidmc.physics.effects import Gravity
from rigidmc.planning.tolerance.costs import Costs
from rigidmc.planning.tolerance.pilot import pilot
from rigidmc.studies.accuracy.study import accuracy

T_END, MEMBERS = 10.0, 512
TARGETS = (1e-4, 1e-6, 1e-8, 1e-10)
EFFECTS = {"free": (), "heavy": (Gravity(tops.GRAVITY),)}
# case of tests/engine/compiler/test_vectorisation.py -> integrator; heavy tops, float64
COUNTED = {
    "rk4 gravity": "rk4",
    "rk8 gravity": "rk8",
    "cf4 gravity": "cf4",
    "ck45 gravity": "ck45",
    "strang gravity": "strang",
    "rotations gravity": "rotations",
    "chin4 gravity": "chin4",
}


def run(quick):
    rows = []
    for body, effects in EFFECTS.items():
        study = accuracy(scene(effects), tolerances=TARGETS, members=128 if quick else MEMBERS)
        rows.append(
            harness.row(
                "truth", body=body, truth=study.attrs["truth"], error=study.attrs["truth_error"]
            )
        )
        names = ("integrator", "dtype", "dt", "steps", "turn", "error_state_median",
            "error_state_upper", "error_state_worst",
                 "ns_per_member_step", "members_per_second")  # fmt: skip
        errors = [
            {name: _plain(study[name].values[i]) for name in names}
            for i in range(study.sizes["row"])
        ]
        rows += [{"kind": "error", "body": body, **row} for row in errors]
        rows += choices(body, errors)
    return rows + arithmetic()


def scene(effects):
    """Return random tops, all different, with t_end = 10 s."""
    some = tops.random_tops(4 * MEMBERS)
    body = rigidmc.Body.from_moments(some.moments.T, mass=1.0, centre=some.static.T)
    start = rigidmc.Start(omega=some.omega.T, attitude=some.attitude.T)
    return rigidmc.Scene(body, effects, start).with_run(
        t_end=T_END, members=4 * MEMBERS, save=("omega", "attitude")
    )


def choices(body, errors):
    """Return rows with the fastest integrator and step for an error, and the best step of each
    integrator."""
    rows = []
    for limit in TARGETS:
        good = [r for r in errors if r["error_state_upper"] <= limit]
        # the last is the fastest
        each = {r["integrator"]: r for r in sorted(good, key=lambda r: r["members_per_second"])}
        best = sorted(each.values(), key=lambda r: -r["members_per_second"])
        rows += [
            {"kind": "choice", "body": body, "limit": limit, "best": i == 0, **r}
            for i, r in enumerate(best)
        ]
    return rows


def arithmetic():
    """Return rows with the cost of a step relative to rk4, measured and predicted from its
    instructions.

    Slots count every vector instruction except moves as one, a division of eight numbers as ten,
    and a square root of eight numbers as eighteen. Flops count floating-point operations.
    """
    from tests.engine.compiler.test_vectorisation import CASES
    from tests.tools.assembly import counted

    members = pilot(scene(EFFECTS["heavy"]), 64)._replace(member_steps=False)
    rows = []
    for case, name in COUNTED.items():
        counts = counted(CASES[case])
        steps = members.base * 4096  # one part, one panel
        ns = min(Costs(members).step(name, steps, "float64") for _ in range(5))
        rows.append(
            harness.row(
                "step",
                integrator=name,
                ns=ns,
                flops=counts["flops"] * counts["parts"],
                slots=counts["slots"],
            )
        )
    base = rows[0]
    for row in rows:
        row["cost"] = row["ns"] / base["ns"]
        row["by_flops"], row["by_slots"] = (
            row["flops"] / base["flops"],
            row["slots"] / base["slots"],
        )
    off = max(abs(r["cost"] / r["by_slots"] - 1.0) for r in rows)
    far = max(rows, key=lambda r: abs(r["cost"] / r["by_slots"] - 1.0))["integrator"]
    rows.append(
        harness.at_most(
            f"cost of a step against its arithmetic, worst ({far})", 15.0, 100.0 * off, "%"
        )
    )
    return rows


def _plain(value):
    """Convert a value to a type that JSON stores."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def report(rows):
    for r in harness.of_kind(rows, "truth"):
        print(f"{r['body']}: reference {r['truth']}, known to {r['error']:.1e}")
    harness.show(
        f"cost of accuracy, 99 % of {MEMBERS} random tops to t = {T_END:g} s",
        harness.of_kind(rows, "choice"),
        " {body} | | error {limit:.0e} | integrator {integrator} | step {step}"
        " | members/s {members_per_second:,.0f} | {first}",
        step=step_text, first=lambda r: "best" if r["best"] else "",
    )  # fmt: skip
    harness.show(
        "cost of a step on one thread",
        harness.of_kind(rows, "step"),
        "heavy tops {integrator} | ns a step {ns:.1f} | of rk4 {cost:.2f}"
        " | by arithmetic {by_slots:.2f} | by flops {by_flops:.2f} | flops {flops:.0f} |",
    )
    harness.report_targets(rows)


def step_text(row):
    """Describe the step of a row in words."""
    if row["integrator"] == "closed":
        return "at once"
    single = ", float32" if row["dtype"] == "float32" else ""
    return (f"{row['dt']:.2g} s" if row["turn"] is None else f"{row['turn']:.2g} rad") + single
