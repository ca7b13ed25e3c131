"""What rigidmc replaces: a loop over scipy's `solve_ivp`, on the same heavy tops.

The loop runs in one process per core, with plain numbers in its right-hand side, as an experienced
user would write it. Both programs use the loosest tolerance at which 99 % of the tops reach the
error limit, in omega (relative) and attitude (rad). The loop integrates the first tops of the
ensemble; times are per top.
"""

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from scipy.integrate import solve_ivp

import rigidmc
from bench import harness
from bench.accuracy import T_END
from bench.problems import tops
from rigidmc.engine.machine import threads_available
from rigidmc.physics.effects import Gravity

LIMITS = (1e-4, 1e-6, 1e-8)
MEMBERS, LOOPED = 100_000, 128
TRUTH = 3e-14  # rtol of DOP853: close to the smallest that scipy accepts


def rates(t, y, i1, i2, i3, a1, a2, a3, c1, c2, c3):
    """Return the rates of (q, L), from 1/I, (I_2 - I_3)/(I_2 I_3) and so on, and weight times
    centre of mass."""
    w, x, y, z, l1, l2, l3 = y.tolist()
    p, q, r = i1 * l1, i2 * l2, i3 * l3
    u1, u2, u3 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
    return (
        0.5 * (-x * p - y * q - z * r),
        0.5 * (w * p + y * r - z * q),
        0.5 * (w * q + z * p - x * r),
        0.5 * (w * r + x * q - y * p),
        a1 * l2 * l3 + c3 * u2 - c2 * u3,
        a2 * l3 * l1 + c1 * u3 - c3 * u1,
        a3 * l1 * l2 + c2 * u1 - c1 * u2,
    )


def end_of_top(start, numbers, tolerance):
    """Return the state of a top at T_END."""
    found = solve_ivp(
        rates, (0.0, T_END), start, "DOP853", args=numbers, rtol=tolerance, atol=tolerance
    )
    return found.y[:, -1]


def looped(pool, many, tolerance):
    """Return (attitude, momentum) of the first tops by the loop."""
    starts = np.concatenate([many.attitude, many.momentum])[:, :LOOPED].T
    numbers = np.concatenate([many.body[:6], tops.GRAVITY * many.static])[:, :LOOPED].T
    jobs = starts, [tuple(row) for row in numbers.tolist()], [tolerance] * LOOPED
    end = np.array(list(pool.map(end_of_top, *jobs, chunksize=LOOPED // (4 * threads_available()))))
    return end.T[:4] / np.linalg.norm(end.T[:4], axis=0), end.T[4:]


def simulated(scene, many):
    """Return (attitude, momentum) of all tops by rigidmc."""
    ds = rigidmc.simulate(scene)
    return ds.attitude.values[-1], many.moments * ds.omega.values[-1]


def scene_of(many):
    """Return the tops as a scene whose result is their final state."""
    body = rigidmc.Body.from_moments(many.moments.T, mass=1.0, centre=many.static.T)
    start = rigidmc.Start(omega=many.omega.T, attitude=many.attitude.T)
    return rigidmc.Scene(body, (Gravity(tops.GRAVITY),), start).with_run(
        members=MEMBERS, t_end=T_END, every=T_END, save=("attitude", "omega")
    )


def upper_error(many, end, true):
    """Return the error that 99 % of the tops keep below."""
    count = end[0].shape[1]
    some = many._replace(moments=many.moments[:, :count])
    errors = np.maximum(
        tops.omega_error(some, end[1], true[1][:, :count]),
        tops.attitude_error(end[0], true[0][:, :count]),
    )
    return float(np.quantile(errors, 0.99, method="higher"))


def loosest(make, many, true, limit):
    """Return (candidate, tolerance, error) for the loosest tolerance that keeps the limit."""
    tolerance, error = 3.0 * limit, np.inf
    while error > limit:
        tolerance /= 3.0
        candidate = make(tolerance)
        error = upper_error(many, candidate(), true)
    return candidate, tolerance, error


def run(quick):
    many = tops.random_tops(MEMBERS)
    scene, rows = scene_of(many), []
    accurate, taken = scene.with_run(integrator="rk8", turn=0.1), []
    for _ in range(2):  # the first run compiles
        began = time.perf_counter()
        true = simulated(accurate, many)
        taken.append(time.perf_counter() - began)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(threads_available(), spawn) as pool:
        known = upper_error(many, looped(pool, many, TRUTH), true)
        rows.append({"kind": "truth", "source": "rk8, turn 0.1 rad", "error": known})
        for limit in LIMITS:

            def by_loop(tolerance):
                return lambda: looped(pool, many, tolerance)

            def by_rigidmc(tolerance):
                chosen = rigidmc.prepare(scene, tolerance=tolerance).scene
                return lambda: simulated(chosen, many)

            found = {"loop": loosest(by_loop, many, true, limit),
                     "rigidmc": loosest(by_rigidmc, many, true, limit)}  # fmt: skip
            candidates = {name: candidate for name, (candidate, _, _) in found.items()}
            seconds = harness.interleaved(candidates, 1 if quick else 7)
            seconds = {"loop": [s / LOOPED for s in seconds["loop"]],
                       "rigidmc": [s / MEMBERS for s in seconds["rigidmc"]]}  # fmt: skip
            rows += [
                {"kind": "time", "limit": limit, "name": name, "tolerance": found[name][1],
                 "error": found[name][2], "seconds": harness.median(taken)}
                for name, taken in seconds.items()
            ]  # fmt: skip
            factor = harness.ratio(seconds["loop"], seconds["rigidmc"])
            rows.append({"kind": "factor", "limit": limit, "factor": factor})
    return [*rows, {"kind": "compilation", "seconds": taken[0] - taken[1]}]


def report(rows):
    for row in rows:
        if row["kind"] == "truth":
            print(f"truth {row['source']}, which differs from DOP853 by {row['error']:.1e}")
        if row["kind"] == "compilation":
            print(f"rigidmc compiles for {row['seconds']:.1f} s in its first run")
        if row["kind"] == "factor":
            print(f"{row['limit']:.0e}: the loop takes {row['factor']:,.0f} times as long")
    harness.show(
        f"heavy tops to t = {T_END:g} s on all cores",
        harness.of_kind(rows, "time"),
        "error limit {limit:.0e} | {name} | tolerance {tolerance:.1e} | reached {error:.1e}"
        " | us a top {microseconds:,.2f}",
        microseconds=lambda row: 1e6 * row["seconds"],
    )
