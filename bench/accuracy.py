"""What accuracy costs: error at t = 10 s against members per second, for every integrator on free and on heavy tops."""

import math

import numpy as np

import rigidmc
from bench import harness, tops
from rigidmc.effects import Gravity
from rigidmc.engine.machine import threads_available
from rigidmc.errors import SceneError
from rigidmc.integrators import INTEGRATORS
from rigidmc.planning import prepare

T_END, MEMBERS = 10.0, 2048
TIMED = 32768  # members of a timed run: enough blocks for 8 threads
TARGETS = (1e-4, 1e-6, 1e-8, 1e-10)
EFFECTS = {"free": (), "heavy": (Gravity(tops.GRAVITY),)}


def run(quick):
    """All rows of the bench."""
    ensemble, pool, rows = tops.random_tops(MEMBERS), tops.pool(threads_available()), []
    ladder = [round(16 * 2 ** (k / 2)) for k in range(0, 15 if quick else 19, 2 if quick else 1)]  # 16 to 8,192 steps
    forms, runs = {}, []
    for body, effects in EFFECTS.items():
        reference, row = _reference(body, effects, ensemble, pool)
        rows.append(row)
        for integrator in INTEGRATORS:
            if integrator == "closed" or (not effects and hasattr(INTEGRATORS[integrator], "drifts") and integrator != "rotations"):
                continue  # not steps, or the exact motion at more cost
            for steps in [1] if integrator == "exact" else ladder:
                form = _form(ensemble, effects, integrator, steps)
                if form is None:
                    continue
                errors = _errors(_end(ensemble, effects, form, steps, pool), reference, ensemble)
                # by name too: NamedTuples without fields are equal, RK4() == RKMK4() == ()
                key = body, integrator, form.integrator, len(form.parts)
                forms[key] = form, effects
                runs.append((key, steps, errors))
    costs = _costs(forms, pool, 3 if quick else 7)
    for key, steps, errors in runs:
        body, integrator, _, parts = key
        cost = costs[key]
        row = {
            "kind": "error",
            "body": body,
            "integrator": integrator,
            "steps": steps,
            "parts": parts - 1,
            "dt": T_END / steps,
            **errors,
        }
        rows.append({**row, "ns_per_member_step": cost, "members_per_s": 1e9 / (cost * steps)})
    return rows + choices(rows)


def _form(ensemble, effects, integrator, steps):
    """Form of an integrator at a step of T_END/steps, or None where it refuses."""
    body = rigidmc.Body.from_moments(ensemble.moments.T, mass=1.0, centre=ensemble.static.T)
    scene = rigidmc.Scene(body, effects=effects, start=rigidmc.Start(omega=ensemble.omega.T, attitude=ensemble.attitude.T))
    settings = {"integrator": integrator, "dt": T_END / steps, "t_end": T_END, "every": None, "save": ("omega", "attitude")}
    try:
        plan = prepare(scene.with_run(members=ensemble.omega.shape[1], **settings))
    except SceneError:  # exact with a torque, or a step too long for the splitting
        return None
    return plan.form


def _end(ensemble, effects, kind, steps, pool):
    """(attitude, momentum) at T_END."""
    parts = tops.blocks(ensemble, effects, size=256)
    tops.advance(parts, kind, effects, True, T_END / steps, steps, pool)
    return tops.state(parts)


def _reference(body, effects, ensemble, pool):
    """((attitude, momentum), row): the end by the best means there are, and how well two of them agree."""
    if not effects:
        ways = {"exact in 64 steps": ("exact", 64), "exact in one step": ("exact", 1)}
    else:
        ways = {"rk8 in 4,096 steps": ("rk8", 4096), "srkn11 in 2,048 steps": ("srkn11", 2048)}
    ends = []
    for integrator, steps in ways.values():
        form = _form(ensemble, effects, integrator, steps)
        assert form is not None
        ends.append(_end(ensemble, effects, form, steps, pool))
    errors = _errors(ends[1], ends[0], ensemble)
    what, other = ways
    return ends[0], {"kind": "reference", "body": body, "reference": what, "compared_with": other, **errors}


def _errors(end, reference, ensemble):
    """Worst and median over members of the errors of omega (relative) and attitude [rad], and of the larger of the two."""
    omega = tops.omega_error(ensemble, end[1], reference[1])
    attitude = tops.attitude_error(end[0], reference[0])
    omega, attitude = (np.where(np.isfinite(e), e, math.inf) for e in (omega, attitude))
    both = {"omega": omega, "attitude": attitude, "error": np.maximum(omega, attitude)}
    return {f"{name}_{how}": float(of(e)) for name, e in both.items() for how, of in (("worst", np.max), ("median", np.median))}


def _costs(forms, pool, rounds):
    """{key: ns per member-step on all cores}, interleaved; a piece of a step counts as a step.

    From CPU seconds, as if no neighbour took a core meanwhile: the candidates share nothing and keep all cores busy.
    """
    ensemble = tops.random_tops(TIMED)

    def candidate(kind, effects):
        return (
            lambda: tops.blocks(ensemble, effects, TIMED // 32),
            lambda parts: tops.advance(parts, kind, effects, True, 1e-3, _rounds(kind), pool),
        )

    cpu: dict = {}
    harness.interleaved({key: candidate(*form) for key, form in forms.items()}, rounds, cpu)
    return {key: 1e9 * harness.median(taken) / (TIMED * _rounds(forms[key][0]) * threads_available()) for key, taken in cpu.items()}


def _rounds(made):
    """Steps of a timed run: fewer where a step has many parts."""
    return max(5, 100 // (len(made.parts) - 1))


def choices(rows):
    """Rows saying which integrator and step reach an error with the most members per second."""
    found = []
    for body in EFFECTS:
        for limit in TARGETS:
            good = [r for r in rows if r["kind"] == "error" and r["body"] == body and r["error_worst"] <= limit]
            each = [
                max((r for r in good if r["integrator"] == i), key=lambda r: r["members_per_s"], default=None) for i in INTEGRATORS
            ]
            each = sorted((r for r in each if r), key=lambda r: -r["members_per_s"])
            keys = ("body", "integrator", "steps", "dt", "error_worst", "error_median", "members_per_s")
            found += [{"kind": "choice", "limit": limit, "best": i == 0, **{k: r[k] for k in keys}} for i, r in enumerate(each)]
    return found


def report(rows):
    """Print what was measured."""
    for r in rows:
        if r["kind"] == "reference":
            agreement = f"{r['error_worst']:.1e} at worst, {r['error_median']:.1e} in the middle"
            print(f"{r['body']}: reference {r['reference']}, which differs from {r['compared_with']} by {agreement}")
    columns = ("", "steps", "dt [s]", "omega worst", "median", "attitude worst", "median", "ns", "members/s", "")
    for body in EFFECTS:
        lines = [
            (r["integrator"], f"{r['steps']:,}", f"{r['dt']:.4g}")
            + tuple(f"{r[k]:.1e}" for k in ("omega_worst", "omega_median", "attitude_worst", "attitude_median"))
            + (f"{r['ns_per_member_step']:.2f}", f"{r['members_per_s']:,.0f}", "")
            for r in rows
            if r["kind"] == "error" and r["body"] == body
        ]
        harness.table(f"{body} tops at t = {T_END:g} s, {MEMBERS:,} members", columns, lines)
    lines = [
        (
            r["body"],
            f"{r['limit']:.0e}",
            r["integrator"],
            f"{r['dt']:.4g}",
            f"{r['error_worst']:.1e}",
            f"{r['members_per_s']:,.0f}",
            "best" if r["best"] else "",
        )
        for r in rows
        if r["kind"] == "choice"
    ]
    harness.table("what accuracy costs, worst member", ("", "error", "integrator", "dt [s]", "reached", "members/s", ""), lines)
