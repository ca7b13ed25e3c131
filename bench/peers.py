"""Other programs on the same problem: 4096 different heavy tops, and free ones, to t = 10.

Each is written as an experienced user would write it. Every candidate is tuned to a worst error
over all tops, in omega and in attitude: it uses the longest step, or the loosest tolerance, within
that error. It is checked against the truth and compiled before it is timed, and timed interleaved
with all others. The extra `peers` installs the others; a missing program is left out with a note.
"""

import contextlib
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import rigidmc
from bench import baselines, harness
from bench.problems import tops
from rigidmc.engine.kernel import layout
from rigidmc.engine.machine import threads_available
from rigidmc.physics.effects import Gravity
from rigidmc.planning.initial import make_pilot
from rigidmc.planning.scheme import make_scheme

T_END, MEMBERS = 10.0, 4096
# as `simulate` divides them if members have their own steps
OWN_BLOCK = MEMBERS // threads_available()
STEPS_UNIT = 32.0  # steps are tuned as turns of 32 rad divided by integers
LIMITS = (1e-4, 1e-7, 1e-10, 1e-12, 1e-13)
# kg: all tops are possible bodies from 52 kg on, and a power of 2 leaves every bit of mass times
# centre, on which alone the motion depends
MASS = 64.0
# From here on a limit holds for 99 % of the tops: the worst one multiplies rounding by 1e4, and no
# candidate brings it below 1e-12.
ROUNDING = 1e-11
OURS = {  # the candidates for each kind of top, cheapest first if known
    "heavy": (
        ("rk8", "float32"),
        ("rk8", "float64"),
        ("gbs12", "float64"),
        ("rk4", "float64"),
        ("chin4", "float64"),
        ("srkn6", "float64"),
        ("srkn11", "float64"),
    ),
    "free": (("rk8", "float64"), ("rk4", "float64"), ("exact", "float64")),
}
GRAVITY = (Gravity(1.0),)


class Truth(NamedTuple):
    """The states at the end, and the fraction of the tops that a limit holds for."""

    attitude: np.ndarray
    momentum: np.ndarray
    share: float = 1.0


class Entry(NamedTuple):
    """A tuned candidate.

    run(prepare()) is timed; read(its result) returns (attitude (4, n), momentum (3, n)); setting
    describes the tuning.
    """

    prepare: Callable
    run: Callable
    read: Callable
    setting: str


def normalised(end):
    """Return (attitude, momentum) of states (7, n)."""
    return end[:4] / np.linalg.norm(end[:4], axis=0), end[4:]


def ensemble(kind):
    """Return random tops: second moments uniform in (0.2, 1), I = sums of two; omega normal;
    attitude uniform; weight times arm normal in each axis.
    """
    many = tops.random_tops(MEMBERS, seed=11)
    return many._replace(
        static=np.random.default_rng(12).normal(size=(3, MEMBERS)) * (kind == "heavy")
    )


def run(quick):
    rows: list[dict] = []
    for kind, limits in (("heavy", LIMITS), ("free", (1e-9,))):
        many = ensemble(kind)
        true, row = truth(many, kind)
        rows.append({"kind": "truth", "body": kind, **row})
        field: dict[tuple, Entry] = {}
        notes: dict[str, str] = {}
        for limit in limits:
            for name, make in PEERS.items():
                judged = true._replace(share=1.0 if limit > ROUNDING else 0.99)
                try:
                    entry = make(many, kind, limit, judged)
                except (ImportError, OSError) as error:
                    notes[name] = f"left out: {error}"
                    continue
                if entry is not None:
                    field[name, limit] = entry
                    q, l = entry.read(entry.run(entry.prepare()))
                    rows.append(
                        harness.row(
                            "check",
                            body=kind,
                            limit=limit,
                            name=name,
                            setting=entry.setting,
                            error=worst(many, (q, l), judged),
                        )
                    )
        rows += [{"kind": "note", "name": name, "note": note} for name, note in notes.items()]
        slow = {
            key for key, entry in field.items() if harness.once((entry.prepare, entry.run))[0] > 2.0
        }
        cpu: dict = {}
        timed = {key: (warm(e), e.run) for key, e in field.items() if key not in slow}
        seconds = harness.interleaved(timed, 3 if quick else 15, cpu)
        for key in slow:
            seconds[key], cpu[key] = (
                [x] for x in harness.once((field[key].prepare, field[key].run))
            )
        for (name, limit), taken in seconds.items():
            middle = harness.median(taken)
            rows.append({"kind": "time", "body": kind, "limit": limit, "name": name,
                "setting": field[name, limit].setting, "seconds": middle,
                         "best": min(taken), "cpu_seconds": harness.median(cpu[name, limit]),
                         "rounds": taken})  # fmt: skip
        rows += targets(kind, seconds)
    return rows


def warm(entry):
    """Prepare a candidate when the machine is quiet, and run it untimed for a tenth of a second.

    BLAS threads of the previous candidate spin on a core for up to 0.1 s, and two threads that wake
    together share a core for their first 10 ms, unless one of them was running. Without the untimed
    run, 12 ms of rigidmc become 24 and 20 ms of heyoka become 26.
    """

    def prepare():
        time.sleep(0.15)
        began = time.perf_counter()
        while time.perf_counter() - began < 0.1:
            entry.run(entry.prepare())
        return entry.prepare()

    return prepare


def worst(many, end, true):
    """Return the largest error over true.share of the tops of omega (relative) and attitude [rad];
    inf if not finite."""
    with np.errstate(over="ignore", invalid="ignore"):  # too long a step
        errors = np.maximum(
            tops.omega_error(many, end[1], true.momentum),
            tops.attitude_error(end[0], true.attitude),
        )
    if not np.isfinite(errors).all():
        return math.inf
    return float(np.quantile(errors, true.share, method="higher"))


def truth(many, kind):
    """Return (Truth, row): rk8 in 4,000 steps, confirmed by srkn11 in 2,000, or the exact motion;
    sums keep their remainders.
    """
    pool = tops.pool(threads_available())
    ways = (("exact", 1), ("rk8", 4000)) if kind == "free" else (("rk8", 4000), ("srkn11", 2000))
    ends = []
    for name, steps in ways:
        made, parts = (
            _form(many, name, kind, T_END / steps),
            tops.blocks(many, GRAVITY if kind == "heavy" else (), 256),
        )
        tops.advance(
            parts, made, GRAVITY if kind == "heavy" else (), True, T_END / steps, steps, pool,
            compensated=True,
        )  # fmt: skip
        ends.append(Truth(*tops.state(parts)))
    return ends[0], {
        "source": f"{ways[0][0]} in {ways[0][1]:,} steps",
        "against": ways[1][0],
        "error": worst(many, ends[1], ends[0]),
    }


def _form(many, name, kind, dt, turn=None):
    """Return the compiled scheme for steps of dt, or of `turn` in at most dt, as for a scene."""
    body = rigidmc.Body.from_moments(many.moments.T, mass=MASS, centre=many.static.T / MASS)
    start = rigidmc.Start(omega=many.omega.T, attitude=many.attitude.T)
    scene = rigidmc.Scene(body, GRAVITY if kind == "heavy" else (), start)
    scene = scene.with_run(integrator=name, members=MEMBERS, turn=turn)
    pilot = make_pilot(scene.model, scene.run.seed, True).block
    return make_scheme(scene.integrator, scene.model, scene.run, pilot, dt)[0]


def longest(error_of, limit, first=8, most=200_000):
    """Return the fewest steps within the limit, to 3 %; None if no number of steps meets it."""
    steps = first
    while error_of(steps) > limit:
        steps *= 2
        if steps > most:
            return None
    low, high = steps // 2, steps
    while high - low > max(1, 0.03 * high):
        middle = (low + high) // 2
        low, high = (low, middle) if error_of(middle) <= limit else (middle, high)
    return high


def rigidmc_steps(many, kind, limit, true):
    """Tune the cheapest integrator of rigidmc, by the kernel on blocks, two threads."""
    pool, effects = tops.pool(threads_available()), GRAVITY if kind == "heavy" else ()
    best = None
    for name, real in OURS[kind]:
        dtype = np.dtype(real).type

        forms: dict[int, Any] = {}

        def go(steps, parts, name=name, dtype=dtype, forms=forms):
            """Move each member in its own steps, each STEPS_UNIT/steps rad of its motion."""
            if steps not in forms:
                forms[steps] = _form(many, name, kind, T_END, STEPS_UNIT / steps)
            tops.advance_own(parts, forms[steps], effects, STEPS_UNIT / steps, T_END, pool, dtype)
            return parts

        def error(steps, go=go):
            return worst(many, tops.state(go(steps, tops.blocks(many, effects, OWN_BLOCK))), true)

        steps = longest(error, limit, 4, 20_000)
        if steps is None:
            continue
        mean = np.mean(
            np.concatenate(
                [b[layout.STEPS] for b in go(steps, tops.blocks(many, effects, OWN_BLOCK))]
            )
        )
        entry = Entry(
            lambda: tops.blocks(many, effects, OWN_BLOCK),
            lambda parts, s=steps, go=go: go(s, parts),
            tops.state,
            f"{name} {real}, turn {STEPS_UNIT / steps:.3g} rad, {mean:.0f} steps on average",
        )
        seconds = min(harness.once((entry.prepare, entry.run))[0] for _ in range(7))
        if best is None or seconds < best[0]:
            best = seconds, entry
    return best[1] if best else None


def rigidmc_prepared(many, kind, limit, true, again=True):
    """Tune the public call: `run` of a prepared run with omega given, or `simulate`, by the
    loosest tolerance within the limit; final state.
    """
    if kind == "free":
        return None
    scene, tolerance = _scene(many, kind), 3.0 * limit
    given = {"start.omega": many.omega.T}
    names = ("start.omega",) if again else ()

    def read(ds):
        return ds.attitude.values[-1], many.moments * ds.omega.values[-1]

    end = None
    while end is None or worst(many, end, true) > limit:
        tolerance /= 3.0
        if tolerance < 0.05 * limit:
            return None
        try:
            chosen = rigidmc.prepare(scene, tolerance=tolerance).scene
        except rigidmc.SceneError:
            return None
        prepared = rigidmc.prepare(chosen, varied=names)
        end = read(prepared.run(values=given if again else None))
    settings = chosen.run
    step = f"turn {settings.turn:.3g} rad" if settings.turn else f"dt {settings.dt:.3g} s"
    what = f"{settings.integrator} {settings.dtype}, {step}, tolerance {tolerance:.1e}"
    if again:
        return Entry(lambda: None, lambda _: prepared.run(values=given), read, what)
    return Entry(lambda: None, lambda _: rigidmc.simulate(chosen), read, what)


def rigidmc_simulate(many, kind, limit, true):
    """Tune `simulate` like a prepared run."""
    return rigidmc_prepared(many, kind, limit, true, again=False)


def _scene(many, kind):
    """Return the tops as a scene whose result is their final state."""
    body = rigidmc.Body.from_moments(many.moments.T, mass=MASS, centre=many.static.T / MASS)
    start = rigidmc.Start(omega=many.omega.T, attitude=many.attitude.T)
    scene = rigidmc.Scene(body, GRAVITY if kind == "heavy" else (), start)
    return scene.with_run(members=MEMBERS, t_end=T_END, every=T_END, save=("attitude", "omega"))


def rigidmc_closed(many, kind, limit, true):
    """Compute the closed form at the end, on all cores."""
    if kind != "free":
        return None
    moments, momentum, attitude = (
        np.ascontiguousarray(x.T) for x in (many.moments, many.momentum, many.attitude)
    )

    def read(motion):
        return motion.attitude.T, motion.momentum.T

    return Entry(
        lambda: None,
        lambda _: rigidmc.solve_free_top(moments, momentum, attitude, T_END),
        read,
        "closed form",
    )


def rigidmc_stepping(many, kind, limit, true):
    """Compute the exact motion in 100 steps, each saved."""
    if kind != "free":
        return None
    pool, made = tops.pool(threads_available()), _form(many, "exact", kind, T_END / 100)
    return Entry(
        lambda: tops.blocks(many, (), 512),
        lambda p: tops.advance(p, made, (), True, T_END / 100, 100, pool) or p,
        tops.state,
        "exact, 100 steps of 0.1",
    )


def c_rk4(many, kind, limit, true):
    """Tune rk4 in C with explicit 512-bit vectors."""
    library = baselines.build("tops512.c")
    if not hasattr(library, "rk4_heavy_512"):
        raise OSError("this CPU has no AVX-512")
    function = library.rk4_heavy_512 if kind == "heavy" else library.rk4_free_512

    def prepare():
        return np.ascontiguousarray(
            np.concatenate([many.attitude, many.momentum, many.body[:6], many.static])
        )

    def go(steps, rows):
        function(rows.ctypes.data, MEMBERS, steps, T_END / steps)
        return rows

    def error(steps):
        rows = go(steps, prepare())
        return worst(many, (rows[:4], rows[4:7]), true)

    steps = longest(error, limit)
    return steps and Entry(
        prepare,
        lambda rows: go(steps, rows),
        lambda rows: (rows[:4], rows[4:7]),
        f"rk4, {steps} steps",
    )


def _heyoka_rates(q, l, kind):
    """Return the rates of (q, L) as expressions of heyoka; its parameters are the body's numbers
    and weight times centre of mass.
    """
    import heyoka as hy

    i, a, c = ([hy.par[k + j] for j in range(3)] for k in (0, 3, 6))
    w = [i[k] * l[k] for k in range(3)]
    up = [
        2.0 * (q[1] * q[3] - q[0] * q[2]),
        2.0 * (q[2] * q[3] + q[0] * q[1]),
        q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2,
    ]
    torque = (
        [c[2] * up[1] - c[1] * up[2], c[0] * up[2] - c[2] * up[0], c[1] * up[0] - c[0] * up[1]]
        if kind == "heavy"
        else [0.0, 0.0, 0.0]
    )
    return [
        0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]),
        0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1]),
        0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2]),
        0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0]),
        a[0] * l[1] * l[2] + torque[0],
        a[1] * l[2] * l[0] + torque[1],
        a[2] * l[0] * l[1] + torque[2],
    ]


def heyoka_rk4(many, kind, limit, true):
    """Tune rk4 as one compiled function of heyoka that makes a step, on two threads."""
    if kind == "free" or limit < 1e-7:
        return None  # 1e-10 takes 1,600 steps
    import heyoka as hy

    names = [f"x{k}" for k in range(7)]
    state, h = list(hy.make_vars(*names)), hy.par[9]

    def rates(x):
        return _heyoka_rates(x[:4], x[4:], kind)

    def moved(by, k):
        return [x + by * r for x, r in zip(state, k, strict=True)]

    one = rates(state)
    two = rates(moved(0.5 * h, one))
    three = rates(moved(0.5 * h, two))
    four = rates(moved(h, three))
    new = [
        x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for x, a, b, c, d in zip(state, one, two, three, four, strict=True)
    ]
    pool, size = tops.pool(threads_available()), MEMBERS // threads_available()
    step = hy.cfunc(new, state)
    steppers = [step, *(_copy(step) for _ in range(threads_available() - 1))]
    start = np.concatenate([many.attitude, many.momentum])
    numbers = np.concatenate([many.body[:6], many.static, np.ones((1, MEMBERS))])

    def go(steps):
        end = np.empty_like(start)

        def share(k):
            part = slice(k * size, (k + 1) * size)
            old, new = np.ascontiguousarray(start[:, part]), np.empty((7, size))
            pars = np.ascontiguousarray(numbers[:, part])
            pars[9] = T_END / steps
            for _ in range(steps):
                steppers[k](inputs=old, outputs=new, pars=pars)
                old, new = new, old
            end[:, part] = old

        list(pool.map(share, range(len(steppers))))
        return end

    steps = longest(lambda steps: worst(many, normalised(go(steps)), true), limit)
    return steps and Entry(lambda: None, lambda _: go(steps), normalised, f"rk4, {steps} steps")


def heyoka(many, kind, limit, true, saves=False):
    """Tune heyoka: adaptive Taylor series in batches of the vector width, on two Python threads,
    which it does not block.
    """
    import heyoka as hy

    q, l = hy.make_vars("q0", "q1", "q2", "q3"), hy.make_vars("l1", "l2", "l3")
    system = list(zip((*q, *l), _heyoka_rates(q, l, kind), strict=True))
    width = hy.recommended_simd_size()
    groups = [slice(low, low + width) for low in range(0, MEMBERS, width)]
    start = np.concatenate([many.attitude, many.momentum])
    parameters = np.concatenate([many.body[:6], many.static]) if kind == "heavy" else many.body[:6]
    states, numbers = ([np.ascontiguousarray(x[:, g]) for g in groups] for x in (start, parameters))
    times = np.repeat(np.linspace(0.0, T_END, 101)[:, None], width, axis=1)

    def solvers(tolerance):
        one = hy.taylor_adaptive_batch(
            system,
            states[0],
            pars=numbers[0],
            tol=tolerance,
            high_accuracy=False,
            compact_mode=False,
        )
        return [one, *(_copy(one) for _ in range(threads_available() - 1))]

    pool = tops.pool(threads_available())

    def go(made):
        end = np.empty_like(start)

        def share(k):
            solver = made[k]
            state, pars = solver.state, solver.pars
            for n in range(k, len(groups), len(made)):
                state[:] = states[n]
                pars[:] = numbers[n]
                solver.set_time(0.0)
                solver.propagate_grid(times) if saves else solver.propagate_until(T_END)
                end[:, groups[n]] = state

        list(pool.map(share, range(len(made))))
        return end

    tolerance, made = limit, None
    while made is None or worst(many, normalised(go(made)), true) > limit:
        tolerance /= 3.0
        made = solvers(tolerance)
        if tolerance < 1e-17:
            return None
    with contextlib.suppress(AttributeError):
        return Entry(
            lambda: made,
            go,
            normalised,
            f"Taylor order {made[0].order}, tolerance {tolerance:.1e}"
            + (", 101 outputs" if saves else ""),
        )
    return None


def _copy(solver):
    import copy

    return copy.deepcopy(solver)


def heyoka_saving(many, kind, limit, true):
    """Tune heyoka with 100 saves, by its dense output."""
    return heyoka(many, kind, limit, true, saves=True) if kind == "free" else None


def diffrax(many, kind, limit, true):
    """Tune diffrax on JAX: Dopri8, adaptive, one compiled program for all tops, float64."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import diffrax as dx
    import jax.numpy as jnp

    def rates(t, y, p):
        q, l = y[:4], y[4:]
        w = p[:3] * l
        up = jnp.array(
            [
                2.0 * (q[1] * q[3] - q[0] * q[2]),
                2.0 * (q[2] * q[3] + q[0] * q[1]),
                q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2,
            ]
        )
        dq = 0.5 * jnp.array([-q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
            q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
                              q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
                              q[0] * w[2] + q[1] * w[1] - q[2] * w[0]])  # fmt: skip
        dl = p[3:6] * jnp.array([l[1] * l[2], l[2] * l[0], l[0] * l[1]]) - jnp.cross(p[6:], up)
        return jnp.concatenate([dq, dl])

    start = jnp.array(np.concatenate([many.attitude, many.momentum]).T)
    parameters = jnp.array(np.concatenate([many.body[:6], many.static]).T)

    def solver(tolerance):
        def one(y, p):
            control = dx.PIDController(rtol=tolerance, atol=tolerance)
            found = dx.diffeqsolve(
                dx.ODETerm(rates),
                dx.Dopri8(),
                0.0,
                T_END,
                0.05,
                y,
                args=p,
                stepsize_controller=control,
                max_steps=100_000,
            )
            return found.ys[-1]

        return jax.jit(jax.vmap(one))

    def read(end):
        return normalised(np.asarray(end).T)

    tolerance, made = limit, None
    while made is None or worst(many, read(made(start, parameters)), true) > limit:
        tolerance /= 10.0
        made = solver(tolerance)
        if tolerance < 1e-15:
            return None
    return Entry(
        lambda: None,
        lambda _: made(start, parameters).block_until_ready(),
        read,
        f"Dopri8, tolerance {tolerance:.0e}",
    )


def scipy_dop853(many, kind, limit, true):
    """Tune scipy: solve_ivp with DOP853 on all tops as one system, NumPy right-hand side."""
    from scipy.integrate import solve_ivp

    body, c = many.body, many.static

    def rates(t, y):
        y = y.reshape(7, MEMBERS)
        q, l = y[:4], y[4:]
        w = body[:3] * l
        up = (
            2.0 * (q[1] * q[3] - q[0] * q[2]),
            2.0 * (q[2] * q[3] + q[0] * q[1]),
            q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2,
        )
        out = np.empty_like(y)
        out[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2])
        out[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1])
        out[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2])
        out[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0])
        out[4] = body[3] * l[1] * l[2] + c[2] * up[1] - c[1] * up[2]
        out[5] = body[4] * l[2] * l[0] + c[0] * up[2] - c[2] * up[0]
        out[6] = body[5] * l[0] * l[1] + c[1] * up[0] - c[0] * up[1]
        return out.reshape(-1)

    start = np.concatenate([many.attitude, many.momentum]).reshape(-1)

    def go(tolerance):
        return (
            solve_ivp(rates, (0.0, T_END), start, method="DOP853", rtol=tolerance, atol=tolerance)
            .y[:, -1]
            .reshape(7, MEMBERS)
        )

    tolerance = limit
    while worst(many, normalised(go(tolerance)), true) > limit:
        tolerance /= 10.0
        if tolerance < 3e-14:
            return None
    return Entry(
        lambda: None, lambda _: go(tolerance), normalised, f"DOP853, tolerance {tolerance:.0e}"
    )


PEERS: dict[str, Any] = {
    "rigidmc": rigidmc_steps, "rigidmc, prepared": rigidmc_prepared,
    "rigidmc, simulate": rigidmc_simulate, "rigidmc, closed form": rigidmc_closed,
    "rigidmc, 100 saves": rigidmc_stepping, "C rk4, 512-bit intrinsics": c_rk4, "heyoka": heyoka,
    "heyoka, rk4": heyoka_rk4,
    "heyoka, 100 saves": heyoka_saving, "diffrax": diffrax, "scipy": scipy_dop853,
}  # fmt: skip


def targets(kind, seconds):
    """Return rows of targets and measurements: medians over rounds of ratios within a round."""

    def row(what, asked, limit, name, other):
        ratio = (
            harness.ratio(seconds[other, limit], seconds[name, limit])
            if (name, limit) in seconds and (other, limit) in seconds
            else None
        )
        return harness.target(what, asked, ratio, "x")

    c = "C rk4, 512-bit intrinsics"
    if kind == "heavy":
        return [
            row(
                "heavy tops at 1e-4: rigidmc / C rk4 with 512-bit intrinsics",
                1.3,
                1e-4,
                "rigidmc",
                c,
            ),
            row("heavy tops at 1e-7: rigidmc / heyoka", 5.0, 1e-7, "rigidmc", "heyoka"),
            row(
                "heavy tops at 1e-7: rigidmc / C rk4 with 512-bit intrinsics",
                4.0,
                1e-7,
                "rigidmc",
                c,
            ),
            row("heavy tops at 1e-10: rigidmc / heyoka", 3.0, 1e-10, "rigidmc", "heyoka"),
        ]
    return [
        row(
            "free tops at 1e-9, 100 saves: exact / heyoka",
            8.0,
            1e-9,
            "rigidmc, 100 saves",
            "heyoka, 100 saves",
        ),
        row(
            "free tops at 1e-9, final state: closed form / heyoka",
            30.0,
            1e-9,
            "rigidmc, closed form",
            "heyoka",
        ),
    ]


def report(rows):
    for r in rows:
        if r["kind"] == "note":
            print(f"{r['name']}: {r['note']}")
        if r["kind"] == "truth":
            found = f"truth {r['source']}, which differs from {r['against']} by {r['error']:.1e}"
            print(f"{r['body']}: {found} at worst")
    errors = {
        (r["body"], r["limit"], r["name"]): r["error"] for r in harness.of_kind(rows, "check")
    }
    harness.show(
        f"{MEMBERS:,} tops to t = {T_END:g} s on {threads_available()} threads",
        sorted(harness.of_kind(rows, "time"), key=lambda r: (r["body"], -r["limit"], r["seconds"])),
        "worst error {body}, {limit:.0e} | {name} | how {setting} | reached {reached:.1e}"
        " | s {seconds:.4f} | best {best:.4f} | CPU s {cpu_seconds:.4f}",
        reached=lambda r: errors[r["body"], r["limit"], r["name"]],
    )
    harness.report_targets(rows)
