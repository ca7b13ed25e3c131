"""Derivatives: what they cost, how exact they are, and heyoka's variational equations beside them.

Costs are of the kernels on blocks, against the same run without derivatives; of whole calls of a
prepared run; and of first runs in a new process, which compile. Errors are against a Taylor series
in 26 digits, differentiated by central differences of 1e-9 of it, which leave 1e-17.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

import rigidmc
from bench import calls, gpu, harness, peers
from bench.problems import tops
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import SaveTarget, StepRange
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program_spec import Derivatives
from rigidmc.runs.assemble import make_program

# (integrator, effects) of a row: {(derivatives at once, passes): times a plain run that are asked}
COSTS = {
    ("rk4", "heavy"): {(1, 1): 2.1, (2, 1): None, (3, 1): 4.2, (6, 1): None, (3, 2): 8.5},
    ("rk8", "heavy"): {(1, 1): None, (2, 1): None, (3, 1): None, (6, 1): None, (3, 2): 10.5},
    ("exact", "free"): {(1, 1): None, (3, 1): 3.0},
}
ERRORS = (
    ("exact", "free", 1e-12), ("rk8", "free", 1e-13), ("rk8", "heavy", 1e-13),
    ("gbs12", "heavy", 1e-13),
)  # fmt: skip
MEMBERS, STEPS, H = 2048, 400, 0.01
ERROR = 1e-9
SPILLS = "spills", "spills in steps"
# {derivatives of a call: their parameters}
CALLS = {
    "none": (), "by 1 start": ("start.omega.1",), "by 3 starts": ("start.omega",),
    "by 3 moments": ("body.moments",), "by 3 starts and 3 moments": ("start.omega", "body.moments"),
}  # fmt: skip
WRT = {"wrt": ["start.omega.1"]}
WATCHED = {"save": ["omega", "flips", "nutation", "energy_mean"]}
FIRSTS = {  # {first run with an empty cache: (its settings, seconds that are asked)}
    "first run without derivatives": ({}, None),
    "first run with derivatives, empty cache": (WRT, 6.0),
    "first run with monitors": (WATCHED, None),
    "first run with derivatives of monitors": (WRT | WATCHED, None),
}
FIRST = """
import json, sys, time
began = time.perf_counter()
import rigidmc as rm
scene = rm.Scene(rm.Body((1.0, 2.0, 2.5), mass=1.0, centre=(0.0, 0.0, 0.1)),
                 (rm.Gravity(9.81),), rm.Start(omega=(1.0, 0.1, 2.0)))
rm.simulate(scene, "rk4", dt=0.01, t_end=1.0, members=1000, **json.loads(sys.argv[1]))
print(time.perf_counter() - began)
"""


def scene_of(many, kind):
    """Return tops as a scene."""
    body = rigidmc.Body.from_moments(many.moments.T, mass=1.0, centre=many.static.T)
    start = rigidmc.Start(omega=many.omega.T, attitude=many.attitude.T)
    return rigidmc.Scene(body, peers.GRAVITY if kind == "heavy" else (), start)


def costs(name, kind, cases, rounds):
    """Return rows with the time of a run with derivatives, in plain runs."""
    many = tops.random_tops(MEMBERS)
    run = rigidmc.prepare(
        scene_of(many, kind), name, members=MEMBERS, dt=H, t_end=H * STEPS, every=H * STEPS,
        save=("omega", "attitude"),
    )  # fmt: skip
    plan, rows = run.plan, run.initial(0, MEMBERS)[0]

    def candidate(at_once, passes):
        program = make_program(plan, derivatives=Derivatives(at_once, passes, False, False))
        copies = program.copies
        out = np.empty(plan.grid.saves * run.layout.values * copies * MEMBERS)
        steps = StepRange(plan.grid.dt, 1, STEPS, STEPS, 0, 0, STEPS)

        def prepare():
            block = np.zeros((copies, *rows.shape))
            block[0], block[1:, layout.MOMENTUM : layout.EXTRA] = rows, 0.1
            return block.reshape(-1, MEMBERS)

        def go(block):
            target = SaveTarget(out, MEMBERS, 0, np.arange(MEMBERS))
            program.advance(block, steps, saves=target)

        return prepare, go

    field = {case: candidate(*case) for case in ((0, 1), *cases)}
    seconds = harness.interleaved(field, rounds)
    found = []
    for case, asked in cases.items():
        at_once, passes = case
        ratio = harness.ratio(seconds[case], seconds[0, 1])
        what = (
            f"{name} {kind}, {at_once * passes} derivatives in {passes} pass{'es' * (passes > 1)}"
        )
        found.append({
            "kind": "cost", "name": what, "ratio": ratio,
            "nanoseconds": 1e9 * min(seconds[0, 1]) / (MEMBERS * STEPS),
        })  # fmt: skip
        if asked:
            found.append(harness.at_most(what, asked, ratio, "plain runs"))
    return found


def errors(count):
    """Return rows with the errors of derivatives over 10 s, relative to the largest of a member."""
    many, found = tops.random_tops(count), []
    for name, kind, asked in ERRORS:
        run = rigidmc.simulate(
            scene_of(many, kind), name, members=count, dt=0.01, t_end=10.0, every=10.0,
            save=("momentum",), wrt=("start.omega.1", "body.moments.2"), compensated=name == "rk8",
        )  # fmt: skip
        worst = 0.0
        for i in range(count):
            for j in range(2):
                true = true_change(many, kind, i, j)
                here = run.d_momentum.values[j, -1, :, i]
                worst = max(worst, np.abs(here - true).max() / np.abs(true).max())
        what = f"{name} {kind}, tangents over 10 s"
        found.append(harness.at_most(what, asked, worst))
    return found


def true_change(many, kind, i, j):
    """Return the derivative of L of top i after 10 s by omega 1 (j = 0) or by moment 2 (j = 1)."""
    import mpmath as mp

    from tests.tools.reference import taylor

    with mp.workdps(40):
        step, ends = mp.mpf("1e-9"), []
        for sign in (1, -1):
            moments = [mp.mpf(x) for x in many.moments[:, i]]
            omega = [mp.mpf(x) for x in many.omega[:, i]]
            if j:
                moments[1] += sign * step
            else:
                omega[0] += sign * step
            momentum = [a * b for a, b in zip(moments, omega, strict=True)]
            g = peers.GRAVITY[0].g if kind == "heavy" else 0
            weight = [g * mp.mpf(x) for x in many.static[:, i]]
            ends.append(taylor(moments, momentum, 10, many.attitude[:, i], weight)[1])
        return np.array([(a - b) / (2 * step) for a, b in zip(*ends, strict=True)], float)


def ours(many, true):
    """Return (prepare, run, setting) of the tops with derivatives by their seven starts."""
    best, given = None, {"start.omega": many.omega.T}
    for name in ("rk8", "gbs12"):
        turn, right = 2.0, False
        while not right:
            turn /= 1.15
            run = variational(many, name, turn)
            ds = run.run(values=given)
            off = np.abs(ds.d_momentum - true.d_momentum).max(("parameter", "axis", "time"))
            size = np.abs(true.d_momentum).max(("parameter", "axis", "time"))
            right = float(np.quantile(off / size, 0.99)) <= ERROR
        candidate = (lambda: given), (lambda given, run=run: run.run(values=given))
        seconds = min(harness.once(candidate)[0] for _ in range(3))
        if best is None or seconds < best[0]:
            best = seconds, candidate, f"{name}, turn {turn:.2g} rad"
    return best[1:]


def variational(many, name, turn):
    """Return a prepared run of heavy tops with derivatives by their seven starts."""
    return rigidmc.prepare(
        scene_of(many, "heavy"), name, members=peers.MEMBERS, turn=turn, t_end=10.0, every=10.0,
        save=("attitude", "momentum"), wrt=("start.omega", "start.attitude"),
        varied=("start.omega",), energy_limit=0.1, momentum_limit=0.1, turn_limit=3.0,
    )  # fmt: skip


def heyoka(many):
    """Return {name: (prepare, run)} of heyoka's variational equations by the seven starts."""
    import heyoka as hy

    q, l = hy.make_vars("q0", "q1", "q2", "q3"), hy.make_vars("l1", "l2", "l3")
    system = list(zip((*q, *l), peers._heyoka_rates(q, l, "heavy"), strict=True))
    system = hy.var_ode_sys(system, hy.var_args.vars, order=1)
    width = hy.recommended_simd_size()
    start = np.concatenate([many.attitude, many.momentum])
    start = np.concatenate([start, np.repeat(np.eye(7).reshape(49, 1), peers.MEMBERS, 1)])
    numbers = np.concatenate([many.body[:6], many.static])
    groups = [slice(low, low + width) for low in range(0, peers.MEMBERS, width)]
    pool, field = tops.pool(threads_available()), {}
    for compact in (False, True):
        one = hy.taylor_adaptive_batch(
            system, np.ascontiguousarray(start[:, groups[0]]),
            pars=np.ascontiguousarray(numbers[:, groups[0]]), tol=ERROR, compact_mode=compact,
        )  # fmt: skip
        made = [one, *(peers._copy(one) for _ in range(threads_available() - 1))]

        def go(made):
            def share(k):
                solver = made[k]
                for n in range(k, len(groups), len(made)):
                    solver.state[:], solver.pars[:] = start[:, groups[n]], numbers[:, groups[n]]
                    solver.set_time(0.0)
                    solver.propagate_until(10.0)

            list(pool.map(share, range(len(made))))

        field[f"heyoka, {'compact' if compact else 'unrolled'}"] = (lambda made=made: made), go
    return field


def beside(rounds):
    """Return rows of 4,096 heavy tops to t = 10 with derivatives by all starts, beside heyoka."""
    many = tops.random_tops(peers.MEMBERS)
    fine = variational(many, "gbs12", 0.2).run(values={"start.omega": many.omega.T})
    mine, setting = ours(many, fine)
    field = {"rigidmc": mine}
    with contextlib.suppress(ImportError):
        field |= heyoka(many)
    seconds = harness.interleaved(field, rounds)
    rows = [
        {"kind": "peer", "name": name, "milliseconds": 1e3 * harness.median(s),
         "setting": setting if name == "rigidmc" else "Taylor, tolerance 1e-9"}
        for name, s in seconds.items()
    ]  # fmt: skip
    if len(field) > 1:
        best = min((n for n in field if n != "rigidmc"), key=lambda n: harness.median(seconds[n]))
        ratio = harness.ratio(seconds[best], seconds["rigidmc"])
        rows.append(harness.target(f"derivatives by 7 starts: {best} / rigidmc", 4.0, ratio, "x"))
    return rows


def registers():
    """Return rows with the registers that the GPU code of heavy tops takes; nothing is run."""
    scene, found = gpu.scenes(True)["gravity"], []
    names = "start.omega.1", "body.moments.2", "effects.gravity.g"
    for name in ("rk4", "rk8"):
        for count in (0, 1, 3):
            row = gpu.inspected("gravity", name, scene, (), gpu.CAPABILITIES[-1], names[:count])
            if "registers" in row:  # of an assembler
                words = "integrator", "derivatives", "registers", "local", *SPILLS
                found.append({"kind": "registers", **{word: row[word] for word in words}})
    return found


def first_runs():
    """Return rows of the first run in a new process with an empty cache, which compiles."""
    found = []
    for name, (settings, asked) in FIRSTS.items():
        with tempfile.TemporaryDirectory() as folder:
            known = {**os.environ, "RIGIDMC_CACHE_DIR": folder}
            words = [sys.executable, "-c", FIRST, json.dumps(settings)]
            output = subprocess.run(words, env=known, capture_output=True, text=True, check=True)
        seconds = float(output.stdout)
        found.append({"kind": "first", "name": name.partition(",")[0], "seconds": seconds})
        if asked:
            found.append(harness.at_most(name, asked, seconds, "s"))
    return found


def called(count):
    """Return rows of a call of a prepared run with other values, which chooses its derivatives."""
    many, steps = tops.random_tops(calls.FEW), 20
    run = rigidmc.prepare(
        scene_of(many, "heavy"), "rk4", members=calls.FEW, dt=H, t_end=H * steps, every=H * steps,
        varied=("start.omega",), wrt=("start.omega", "body.moments"),
    )  # fmt: skip
    given, found = {"start.omega": many.omega.T}, []
    for name, wrt in CALLS.items():

        def call(wrt=wrt):
            run.run(values=given, wrt=wrt, threads=1)

        calls.least(call, 3)  # compiles
        whole, inside = calls.least(call, count)
        found.append({"kind": "call", "name": name, "ms": whole, "steps_ms": inside})
    return found


def run(quick):
    rounds, rows = 3 if quick else 9, []
    for (name, kind), cases in COSTS.items():
        rows += costs(name, kind, cases, rounds)
    rows += errors(2 if quick else 8)
    rows += [*called(20 if quick else 1000), *first_runs(), *registers()]
    return rows + beside(rounds)


def report(rows):
    for kind, title, columns in (
        ("cost", "time of a run with derivatives, in plain runs",
         "run {name} | plain runs {ratio:.2f}"),
        ("call", f"one call of a prepared run, {calls.FEW} heavy tops on a thread",
         "derivatives {name} | ms {ms:.2f} | in steps {steps_ms:.2f}"),
        ("first", "first run in a new process, empty cache", " {name} | s {seconds:.1f}"),
        ("registers", "registers of a GPU thread, memory and spills [B]",
         "integrator {integrator} | derivatives {derivatives} | registers {registers}"
         " | local {local} | spills {spills} | spills in steps {spills in steps}"),
        ("peer", "4,096 heavy tops to 10 s with derivatives by 7 starts, error 1e-9",
         "program {name} | ms {milliseconds:.1f} | setting {setting}"),
    ):  # fmt: skip
        harness.show(title, harness.of_kind(rows, kind), columns)
    harness.report_targets(rows)
