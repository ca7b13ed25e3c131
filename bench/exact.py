"""The accuracy of the closed forms, against 50-digit mpmath, and their speed.

Errors of momentum (relative to its size) and attitude [rad] are divided by 1 + conditioning. The
conditioning is the change of the result for a relative change of 1e-13 in each input, including
time, divided by 1e-13. Any double-precision answer may be off by that times 1e-16.
"""

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import mpmath as mp
import numpy as np

from bench import harness
from rigidmc.engine.machine import threads_available
from rigidmc.mechanics import textbook
from rigidmc.mechanics.free_top import analyse_free_top, solve_free_top
from rigidmc.mechanics.lagrange_top import analyse_lagrange_top, solve_lagrange_top
from rigidmc.mechanics.rotation import attitude_error
from tests.mechanics import oracles

NUDGE = 1e-13
BODIES = 10_000
TOPS = 2_000
FREE = (
    "generic", "I1 near I2", "I2 near I3", "near sphere", "needle", "flat",
    "near separatrix, above", "near separatrix, below",
    "near axis 1", "near axis 2", "near axis 3", "symmetric", "sphere",
)  # fmt: skip
HEAVY = (
    "generic",
    "fast",
    "slow",
    "near upright passage",
    "near hanging passage",
    "cusp",
    "near homoclinic",
    "near sleeping",
    "pendulum-like",
)


def bodies(kind, count, rng):
    """Return (moments, momentum) of random free bodies of a class; moments ascend."""
    small = 10.0 ** -rng.uniform(3, 15, count)
    moments = np.sort(rng.uniform(0.5, 1.0, (count, 3)), axis=1)
    l = rng.normal(size=(count, 3))
    one, wide = np.ones(count), 1.0 + rng.uniform(0.1, 0.9, count)
    if kind == "I1 near I2":
        moments = np.stack([one, one + small, wide], -1)
    if kind == "I2 near I3":
        moments = np.stack([one, wide, wide * (1 + small)], -1)
    if kind == "near sphere":
        moments = np.stack([one, one + small, one + 3 * small], -1)
    if kind == "needle":
        moments = np.stack([1e-6 * one, one, one + rng.uniform(0.1, 0.9, count) * 1e-6], -1)
        l[:, 0] *= 10.0 ** -rng.uniform(0, 8, count)
    if kind == "flat":
        moments[:, 2] = moments[:, 0] + moments[:, 1]
    if kind.startswith("near separatrix"):
        moments[:, 1] = moments[:, 0] + rng.uniform(0.2, 0.8, count) * (
            moments[:, 2] - moments[:, 0]
        )
        low, middle, high = moments.T
        slope = np.sqrt((1 / middle - 1 / high) / (1 / low - 1 / middle))
        step = 10.0 ** -rng.uniform(4, 14, count) * (1 if "below" in kind else -1)
        l[:, 0] = l[:, 2] * slope * (1 + step)
    if kind.startswith("near axis"):
        axis = int(kind[-1]) - 1
        l *= 10.0 ** -rng.uniform(2, 12, (count, 1))
        l[:, axis] = rng.choice([-1.0, 1.0], count)
    if kind == "symmetric":
        moments = np.stack([one, one, wide], -1)
    if kind == "sphere":
        moments = np.stack([one, one, one], -1)
    return moments, l


def tops(kind, count, rng):
    """Return (moments, weight, momentum, attitude) of random Lagrange tops of a class."""
    one, weight = rng.uniform(0.5, 2.0, count), rng.uniform(0.2, 3.0, count)
    three = one * rng.uniform(0.1, 1.9, count)
    l = rng.normal(size=(count, 3)) * np.sqrt(one * weight)[:, None]
    small = 10.0 ** -rng.uniform(1, 10, count)
    theta = rng.uniform(0.3, 2.8, count)
    if kind == "fast":
        l[:, 2] *= 50.0
    if kind == "slow":
        l *= 0.01
    if kind == "near upright passage":
        theta = small
    if kind == "near hanging passage":
        theta = np.pi - small
    if kind == "cusp":
        l[:, :2] = 0.0
    if kind == "near homoclinic":  # a slow top released next to the vertical
        l[:, 2], theta = l[:, 2] * 0.3, small
        l[:, :2] = 0.0
    if kind == "near sleeping":
        l[:, 2] = 2.0 * np.sqrt(one * weight) * (1.0 + rng.choice([-1e-3, 1e-3], count))
        l[:, :2] = 0.0
        theta = small
    if kind == "pendulum-like":
        l[:, 2], l[:, 1] = l[:, 2] * small, l[:, 1] * small
    phase = rng.uniform(-np.pi, np.pi, (2, count)) / 2
    q = np.stack(
        [
            np.cos(theta / 2) * np.cos(phase[0]),
            np.sin(theta / 2) * np.cos(phase[1]),
            np.sin(theta / 2) * np.sin(phase[1]),
            np.cos(theta / 2) * np.sin(phase[0]),
        ],
        -1,
    )
    return np.stack([one, one, three], -1), weight, l, q


def true_free(job):
    """Return (q, L) of one body and time as floats."""
    kind, moments, l, t = job
    q, end = (oracles.symmetric if kind in ("symmetric", "sphere") else oracles.free)(moments, l, t)
    return [float(x) for x in q], [float(x) for x in end]


def true_top(job):
    """Return (q, L) of one Lagrange top and time as floats."""
    moments, weight, l, q, t = job
    q, end = oracles.lagrange(moments[0], moments[2], weight, l, q, t)
    return [float(x) for x in q], [float(x) for x in end]


def truths(found):
    """Return (attitudes, momenta) of pairs."""
    return [np.array(values) for values in zip(*found, strict=True)]


def apart(a, b):
    """Return errors of momentum, relative to its size, and attitude [rad]."""
    return np.linalg.norm(a.momentum - b[1], axis=-1) / np.linalg.norm(
        b[1], axis=-1
    ), attitude_error(a.attitude, b[0])


def conditioning(function, arguments):
    """Return sums over all inputs of |change of the result|/NUDGE, for momentum and attitude."""
    base = function(*arguments)
    total = [0.0, 0.0]
    for k, argument in enumerate(arguments):
        for i in range(argument.shape[-1] if argument.ndim > 1 else 1):
            moved = [np.array(a) for a in arguments]
            target = moved[k] if argument.ndim == 1 else moved[k][..., i]
            target *= 1.0 + NUDGE
            moved_base = apart(function(*moved), (base.attitude, base.momentum))
            total = [a + b / NUDGE for a, b in zip(total, moved_base, strict=True)]
    return total


def true_conditioning(job):
    """Compute the conditioning of one free body by the 50-digit oracle with a nudge of 1e-25, for
    inputs where a nudge of 1e-13 is not small.
    """
    _, moments, l, t = job
    base, total = oracles.free(moments, l, t), [0.0, 0.0]
    numbers = [*moments, *l, t]
    with mp.workdps(oracles.DIGITS):
        for k in range(7):
            moved = [
                mp.mpf(x) * (1 + (mp.mpf("1e-25") if i == k else 0)) for i, x in enumerate(numbers)
            ]
            q, end = oracles.free(moved[:3], moved[3:6], moved[6])
            change = mp.norm([a - b for a, b in zip(end, base[1], strict=True)]) / mp.norm(base[1])
            turn = min(
                mp.norm([a - s * b for a, b in zip(q, base[0], strict=True)]) for s in (1, -1)
            )
            total = [
                total[0] + float(change * mp.mpf("1e25")),
                total[1] + float(2 * turn * mp.mpf("1e25")),
            ]
    return total


def accuracy(name, kind, function, arguments, truth, invariants, pool=None):
    """Return a row with the worst errors of a class.

    pool : recomputes conditionings beyond 1e10 by the oracle
    """
    motion = function(*arguments)
    momentum, attitude = apart(motion, truth)
    by_momentum, by_attitude = conditioning(function, arguments)
    if pool is not None:
        again = np.flatnonzero(by_momentum > 1e10)
        found = list(
            pool.map(
                true_conditioning,
                [(kind[0], *(a[k] for a in arguments)) for k in again],
                chunksize=5,
            )
        )
        for k, (a, b) in zip(again, found, strict=True):
            by_momentum[k], by_attitude[k] = a, b
    return {
        "kind": "class", "form": name, "class": kind[0], "times": kind[1], "count": len(momentum),
        "momentum": float(momentum.max()), "attitude": float(attitude.max()),
        "momentum_conditioned": float((momentum / (1 + by_momentum)).max()),
        "attitude_conditioned": float((attitude / (1 + by_attitude)).max()),
        "invariants": float(invariants(motion)),
    }  # fmt: skip


def free_rows(count, pool):
    """Return rows of the free top."""
    rng, rows = np.random.default_rng(1), []
    for kind in FREE:
        moments, l = bodies(kind, count // len(FREE) + 1, rng)
        what, spin = analyse_free_top(moments, l), np.linalg.norm(l / moments, axis=1)
        period = np.minimum(np.where(np.isfinite(what.period), what.period, np.inf), 200.0 / spin)
        for words, most in (("one period", 1.0), ("1e3 periods", 1e3)):
            t = rng.uniform(-1.0, 1.0, len(l)) * most * period
            jobs = [(kind, *job) for job in zip(moments, l, t, strict=True)]
            truth = truths(pool.map(true_free, jobs, chunksize=25))

            def drift(motion, moments=moments, l=l):
                squares = (
                    (motion.momentum**2).sum(-1) / (l**2).sum(-1),
                    (motion.momentum**2 / moments).sum(-1) / (l**2 / moments).sum(-1),
                )
                return max(np.abs(s - 1.0).max() for s in squares)

            rows.append(
                accuracy(
                    "free top",
                    (kind, words),
                    lambda i, l, t: solve_free_top(i, l, (1.0, 0.0, 0.0, 0.0), t),
                    (moments, l, t),
                    truth,
                    drift,
                    pool if "separatrix" in kind else None,
                )
            )
    return rows


def heavy_rows(count, pool):
    """Return rows of the Lagrange top."""
    rng, rows = np.random.default_rng(2), []
    for kind in HEAVY:
        moments, weight, l, q = tops(kind, count // len(HEAVY) + 1, rng)
        what = analyse_lagrange_top(moments, weight, l, q)
        for words, most in (("one period", 1.0), ("1e3 periods", 1e3)):
            t = (
                rng.uniform(-1.0, 1.0, len(l))
                * most
                * np.where(np.isfinite(what.period), what.period, 10.0)
            )
            jobs = list(zip(moments, weight, l, q, t, strict=True))
            truth = truths(pool.map(true_top, jobs, chunksize=10))

            def drift(motion, moments=moments, weight=weight, what=what):
                w, x, y, z = np.moveaxis(motion.attitude, -1, 0)
                energy = 0.5 * (motion.momentum**2 / moments).sum(-1) + weight * (
                    w * w + z * z - x * x - y * y
                )
                return np.abs((energy - what.energy) / (np.abs(what.energy) + weight)).max()

            # I1 = I2 move together: nudging only one would not leave a Lagrange top
            def function(one, three, weight, l, q, t):
                return solve_lagrange_top(np.stack([one, one, three], -1), weight, l, q, t)

            rows.append(
                accuracy(
                    "Lagrange top",
                    (kind, words),
                    function,
                    (moments[:, 0], moments[:, 2], weight, l, q, t),
                    truth,
                    drift,
                )
            )
    return rows


def elliptic_rows(count):
    """Return the worst errors of sn, cn, dn over 0 < u < 4 K, for each 1 - m, also for scipy."""
    from scipy.special import ellipj

    rng, rows = np.random.default_rng(3), []
    with mp.workdps(40):
        for mc in (1.0, 0.5, 1e-1, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14):
            u = rng.uniform(0.0, 4.0, count) * textbook.elliptic_k(mc=mc)
            m = 1 - mp.mpf(mc)
            truth = np.array(
                [[float(mp.ellipfun(k, mp.mpf(x), m=m)) for x in u] for k in ("sn", "cn", "dn")]
            )
            ours = np.abs(np.array(textbook.elliptic_functions(u, mc=mc)[:3]) - truth).max()
            rows.append(
                harness.row(
                    "elliptic",
                    mc=mc,
                    error=float(ours),
                    scipy=float(np.abs(np.array(ellipj(u, 1.0 - mc)[:3]) - truth).max()),
                )
            )
    return rows


def speed_rows(rounds):
    """Measure evaluations per second, bodies times times, and the cost of the first call."""
    rng = np.random.default_rng(4)
    n, times = 4096, np.linspace(0.0, 1000.0, 1000)
    one = rng.uniform(0.5, 1.0, (n, 1))
    symmetric = np.stack([one, one, one * rng.uniform(0.1, 1.0, (n, 1))], -1)
    moments = np.sort(rng.uniform(0.5, 1.0, (n, 1, 3)), axis=-1)
    l, q = rng.normal(size=(n, 1, 3)), rng.normal(size=(n, 1, 4))
    candidates = {
        "free top with attitude": lambda: solve_free_top(moments, l, q, times),
        "Lagrange top": lambda: solve_lagrange_top(symmetric, 1.0, l, q, times),
    }
    rows = []
    for name, call in candidates.items():
        began = time.perf_counter()
        call()
        rows.append({"kind": "first call", "form": name, "seconds": time.perf_counter() - began})
    cpu: dict[str, list[float]] = {}
    wall = harness.interleaved(candidates, rounds, cpu)
    threads = threads_available()
    for name in candidates:
        rate, busy = (
            n * times.size / harness.median(wall[name]) / 1e6,
            threads * n * times.size / harness.median(cpu[name]) / 1e6,
        )
        rows.append({"kind": "speed", "form": name, "wall": rate, "cpu": busy, "threads": threads})
    return rows


def run(quick):
    with ProcessPoolExecutor(threads_available(), mp_context=get_context("spawn")) as pool:
        rows = free_rows(300 if quick else BODIES, pool) + heavy_rows(100 if quick else TOPS, pool)
    rows += elliptic_rows(50 if quick else 400) + speed_rows(3 if quick else 9)
    classes = [r for r in rows if r["kind"] == "class"]
    for form, asked in (("free top", 1e-13), ("Lagrange top", 1e-12)):
        of_form = [r for r in classes if r["form"] == form]
        total = sum(r["count"] for r in of_form)
        for what in ("momentum", "attitude"):
            worst = max(r[f"{what}_conditioned"] for r in of_form)
            rows.append(
                harness.at_most(
                    f"{form}, {what} / (1 + conditioning)",
                    asked,
                    worst,
                    note=f"{total:,} evaluations",
                )
            )
    worst = max(r["invariants"] for r in classes if r["form"] == "free top")
    rows.append(harness.at_most("free top, |L|^2 and T", 2e-15, worst))
    rows.append(
        harness.at_most(
            "sn, cn, dn", 1e-14, max(r["error"] for r in rows if r["kind"] == "elliptic")
        )
    )
    for row in [r for r in rows if r["kind"] == "speed"]:
        asked = 15.0 if row["form"].startswith("free") else 5.0
        rows.append(
            harness.target(
                row["form"],
                asked,
                row["wall"],
                "M/s",
                note=f"{row['cpu']:.1f} M/s from CPU seconds, {row['threads']} threads",
            )
        )
    return rows


def report(rows):
    harness.show(
        "worst errors against 50 digits; c is the conditioning",
        harness.of_kind(rows, "class"),
        " {form} | class {class} | times {times} | tops {count} | momentum {momentum:.1e}"
        " | attitude {attitude:.1e} | momentum/(1+c) {momentum_conditioned:.1e}"
        " | attitude/(1+c) {attitude_conditioned:.1e} | invariants {invariants:.1e}",
    )
    harness.show(
        "worst error of sn, cn, dn, 0 < u < 4 K",
        harness.of_kind(rows, "elliptic"),
        "1 - m {mc:.0e} | rigidmc {error:.1e} | scipy.special.ellipj {scipy:.1e}",
    )
    for row in harness.of_kind(rows, "first call"):
        what = f"first call of {row['form']}, compiling into an empty cache"
        print(f"{what}: {row['seconds']:.1f} s")
    harness.report_targets(rows)
