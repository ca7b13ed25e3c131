"""Sobol indices, rare events, and means without the error of the step: their costs compared with
plain members for the same interval.

The rare events have independent truths: a Gaussian tail; a chain whose distribution is known by
quadrature; a free body, by running a billion (10^9) plain members; a body in a bath that escapes
over a barrier, by Kramers's rate.
"""

import math
import time
import warnings

from scipy import stats

import rigidmc as rm
from bench import harness, multilevel, shares
from bench.problems.rare_truths import (
    FAR,
    SPREAD,
    TIMES,
    TURN,
    bathed,
    escape_rate,
    escaping,
    passed,
    spun,
    turning,
)
from rigidmc.studies.framework.members import compute_batches

REPETITIONS = 64  # of each study, which give their spread to 9 %
PLAIN = 10**9  # plain members of the body that turns over
CHUNK = 2**18  # plain members at once
TAIL = 1e-9


def studied(name, scene, of, truth, repetitions, members=1000):
    """Return the row of a study of a rare event.

    gain : member-steps of plain sampling for the same interval, relative to the study; the variance
        of the fraction is p (1 - p)/n for n plain members, and Var(p_i)/r for r repetitions
    """
    began = time.process_time()
    found = rm.rare(scene, of, 1e-12, members, repetitions, threads=1)
    p, each, steps = float(found.p), found.probability.values, found.member_steps.values
    of_a_member = round(scene.run.t_end / scene.run.dt)
    plain = p * (1.0 - p) * of_a_member
    return harness.row(
        "rare",
        what=name,
        p=p,
        error=float(each.std(ddof=1) / math.sqrt(each.size)),
        truth=truth,
        steps=float(steps.sum()),
        gain=plain / (each.var(ddof=1) * steps.mean()),
        seconds=time.process_time() - began,
    )


def turned(members):
    """Return (how many plain members of `turning` turn over in time, CPU seconds)."""
    scene = turning().with_run(members=members, save=("flips",), keep="final")
    began = time.process_time()
    count = sum(
        int((part.flip_first.values < TURN).sum())
        for part in compute_batches(scene, CHUNK, None, None)
    )
    return count, time.process_time() - began


def escaped(depth, repetitions):
    """Return (the row of `escaping`, its rate by theory).

    The measured rate is the difference of the fractions that escaped at two times, over the time
    between, once the rest is in equilibrium.
    """
    rows = [
        studied(
            f"escape over {depth} kT within {end:g} s",
            escaping(depth).with_run(t_end=end, seed=int(end)),
            f"p(nutation_max >= {FAR})",
            None,
            repetitions,
        )
        for end in TIMES
    ]
    per = TIMES[1] - TIMES[0]
    rate = (rows[1]["p"] - rows[0]["p"]) / per
    error = math.hypot(rows[0]["error"], rows[1]["error"]) / per
    rigid, factor = escape_rate(depth)
    return [
        *rows,
        {
            "kind": "escape",
            "depth": depth,
            "rate": rate,
            "error": error,
            "kramers": rigid * factor,
            "without friction": rigid,
        },
    ]


def rare_rows(quick):
    """Return the rows about rare events."""
    few = 8 if quick else REPETITIONS
    members = 10**6 if quick else PLAIN
    count, seconds = turned(members)
    plain = {"kind": "counted", "members": members, "count": count, "seconds": seconds}
    interval = stats.binomtest(count, members).proportion_ci(0.95, "wilson")
    plain |= {"p": count / members, "low": interval.low, "high": interval.high}
    normal = [
        studied(
            f"Gaussian tail, subsets, {p:g}",
            spun(),
            f"p(omega_max[3] >= {stats.norm.isf(p):.17g})",
            p,
            few,
        )
        for p in (TAIL, 1e-6)
    ]
    level = 5.25 * SPREAD
    chain = studied(
        "disc in a bath, splitting",
        bathed(),
        f"p(omega_max[3] >= {level:.17g})",
        passed(level),
        few,
    )
    body = studied(
        "free body that turns over, subsets", turning(), f"p(flip_first < {TURN})", plain["p"], few
    )
    return [*normal, chain, body, plain, *escaped(14, few)]


def rare_targets(rows):
    """Return the targets of rare events."""
    found = {row["what"]: row for row in rows if row["kind"] == "rare"}
    (plain,) = (row for row in rows if row["kind"] == "counted")
    (escape,) = (row for row in rows if row["kind"] == "escape")
    targets = []
    for what, row in found.items():
        if row["truth"] is None:
            continue
        targets.append(harness.target(f"{what}: gain", 300.0, row["gain"], "times"))
        errors = row["error"]
        if "turns over" in what:
            errors = math.hypot(errors, math.sqrt(plain["p"] / plain["members"]))
        off = abs(row["p"] - row["truth"]) / errors
        targets.append(harness.at_most(f"{what}: from the truth", 3.0, off, "standard errors"))
    off = abs(escape["rate"] - escape["kramers"]) / escape["error"]
    without = abs(escape["rate"] - escape["without friction"]) / escape["error"]
    return [
        *targets,
        harness.at_most("escape: from Kramers's rate", 3.0, off, "standard errors"),
        harness.target("escape: from the rate without friction", 3.0, without, "standard errors"),
    ]


def run(quick):
    warnings.simplefilter("ignore", rm.SceneWarning)
    rare = rare_rows(quick)
    return [*rare, *rare_targets(rare), *shares.measured(quick), *multilevel.measured(quick)]


def report(rows):
    harness.show(
        "rare events",
        harness.of_kind(rows, "rare"),
        "event {what} | p {p:.3e} | +- {error:.1e} | truth {true} | member-steps {steps:.2g}"
        " | plain takes, times {gain:,.0f} | processor s {seconds:.1f}",
        true=lambda row: "" if row["truth"] is None else f"{row['truth']:.3e}",
    )
    for row in harness.of_kind(rows, "counted"):
        print(
            "{members:,} plain members: {count:,} turn over in time, p = {p:.3e} ({low:.3e} to"
            " {high:.3e}), {seconds:,.0f} processor s".format(**row)
        )
    for row in harness.of_kind(rows, "escape"):
        print(
            "escape over {depth} kT: {rate:.3e} +- {error:.1e} 1/s, Kramers {kramers:.3e},"
            " without friction {without friction:.3e}".format(**row)
        )
    shares.show(rows)
    multilevel.show(rows)
    harness.report_targets(rows)
