"""Fits of records with a known truth: how often intervals cover it, and what the data show.

Coverage: random bodies spin freely for 1 to 3 s and are read at 100 Hz, 1 rad/s over .02 of noise,
by a sensor with unknown bias and alignment. The fit knows the law of the motion, or lacks a
quadratic drag that takes 1 to 20 % of the momentum.

Calibration: truths are drawn from the prior, and their ranks among the draws of the posterior are
uniform (Talts et al., arXiv:1804.06788). The free body has any shape, and its start is known; the
slowed ball has any start and a damping rate from 0 on.
"""

import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from itertools import permutations
from multiprocessing import get_context

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

import rigidmc as rm
from bench import fit_peers as peers
from bench import harness
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import minimise
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.visible import in_words, seen

FREE = "body.moments,start.omega"
NOISE, EVERY = 0.02, 0.01  # [rad/s], [s]
LAWS = "right model", "drag left out"
GUESS = rm.Scene(rm.Body((0.9, 1.0, 0.95)), start=rm.Start(omega=(1.0, 1.0, 1.0)))


def table_of(t, omega):
    """Return a table with the columns that `fit` finds by their names."""
    return {"t": t, **{f"omega[{k + 1}]": omega[:, k] for k in range(3)}}


def moved(scene, t_end, every, save="omega"):
    """Return the motion of one member."""
    return rm.simulate(scene, integrator="rk8", dt=every, t_end=t_end, every=every, save=save,
                       members=1, threads=1)  # fmt: skip


def record_of(seed, law):
    """Return (truth {name: value}, table) of a random body and its record."""
    random = np.random.default_rng([seed, LAWS.index(law)])
    second = np.exp(0.7 * random.normal(size=3))
    moments = (second.sum() - second) / (second.sum() - second).max()
    omega = random.normal(size=3)
    omega *= random.uniform(3.0, 12.0) / np.linalg.norm(omega)
    t_end = random.uniform(1.0, 3.0)
    share = random.uniform(0.01, 0.2) if law == LAWS[1] else 0.0
    drag = share * np.linalg.norm(moments * omega) / np.linalg.norm(omega) ** 2 / t_end
    effects = (rm.QuadraticDrag(drag),) if share else ()
    scene = rm.Scene(rm.Body(tuple(moments)), *effects, start=rm.Start(omega=tuple(omega)))
    ds = moved(scene, t_end, EVERY)
    bias, turn = 0.02 * random.normal(size=3), 0.05 * random.normal(size=3)
    read = ds.omega.values[:, :, 0] @ Rotation.from_rotvec(turn).as_matrix().T + bias
    read += NOISE * random.normal(size=read.shape)
    values = {"start.omega": omega, "omega.bias": bias, "omega.alignment": turn}
    truth = {f"{name}.{k + 1}": x[k] for name, x in values.items() for k in range(3)}
    return truth, moments, table_of(ds.time.values, read)


def fit_one(seed, law, trials=100):
    """Return the row of one record."""
    truth, moments, table = record_of(seed, law)
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        study = rm.fit(GUESS, table, FREE, nuisances="bias,alignment", trials=trials, threads=1)
    seconds = time.perf_counter() - began
    ratio, spread = study.ratio.values, study.ratio_deviation.values
    off = [(ratio[i, 2] - moments[i] / moments[2]) / spread[i, 2] for i in (0, 1)]
    for name, value in truth.items():
        one = study.sel(parameter=name)
        off.append((float(one.value[0]) - value) / float(one.deviation))
    return {
        "law": law, "seed": seed, "off": [float(x) for x in off], "seconds": seconds,
        "is_listed": is_listed(study, moments, spread), "answers": study.sizes["answer"],
        "chi2": float(study.attrs["reduced_chi_square"]),
        "lasting": float(study.attrs["lasting_gain"]),
        "told": bool((study.gain.values > 0.0).any() or study.attrs["lasting_gain"] > 4.6),
        "torque": str(study.torque.values[0]) if study.sizes["torque"] else "",
    }  # fmt: skip


def is_listed(study, moments, spread):
    """Return whether an answer has the true ratios of moments, in any order of the axes."""
    least = np.maximum(5.0 * np.nan_to_num(spread, posinf=0.0), 0.01)
    for value in study.value.values:
        found = value[:3]
        for order in permutations(range(3)):
            true = moments[list(order)]
            off = np.abs(found[:, None] / found - true[:, None] / true)
            if (off <= least * (1.0 + true[:, None] / true)).all():
                return True
    return False


SPIN = (0.5, 2.0, 0.4)
START, STEADY = rm.Start(omega=SPIN), rm.Start(omega=(0.0, 0.0, 2.0))
TILTED = rm.Start(omega=SPIN, attitude=(0.8, 0.36, 0.48, 0.0))
BODY, DISC = rm.Body((1.0, 2.0, 2.5)), rm.Body((1.0, 1.0, 1.8))
FREE_BODY = rm.Scene(BODY, start=START)
SLOWED = rm.Scene(BODY, rm.ViscousDamping(0.1), start=START)
DRAGGED = rm.Scene(BODY, rm.QuadraticDrag(0.05), start=START)
WHEEL = rm.Scene(BODY, rm.Rotor((0.3, 0.1, 0.2)), start=START)
DRIVEN = rm.Scene(BODY, rm.BodyTorque((0.1, -0.2, 0.1)), start=START)
TOP = rm.Body.from_moments((1.0, 2.0, 2.5), mass=1.0, centre=(0.1, 0.2, 0.4))
HEAVY = rm.Scene(TOP, rm.Gravity(3.0), start=TILTED)
STEADY_BODY, STILL_DISC = rm.Scene(BODY, start=STEADY), rm.Scene(DISC, start=START)
BY_MOMENTUM = rm.Scene(BODY, start=rm.Start(momentum=SPIN))
RATIOS = "only ratios of the principal moments"
# {name: (scene, more free parameters, saved, nuisances, unseen directions, words that tell them)}
GAUGES = {
    "rates of a free body": (FREE_BODY, "", "omega", "", 1, RATIOS),
    "attitudes of a free body": (FREE_BODY, "", "attitude", "", 1, RATIOS),
    "rates and attitudes": (FREE_BODY, "", "omega,attitude", "", 1, RATIOS),
    "bias of rates": (FREE_BODY, "", "omega", "bias", 1, RATIOS),
    "bias and alignment": (FREE_BODY, "", "omega", "bias,alignment", 1, RATIOS),
    "linear drag": (SLOWED, "effects.viscous_damping.rate", "omega", "", 1, RATIOS),
    "drift beside rates": (FREE_BODY, "", "omega", "drift", 1, RATIOS),
    "known rotor": (WHEEL, "", "omega", "", 0, ""),
    "known rotor and bias": (WHEEL, "", "omega", "bias", 0, ""),
    "unknown rotor": (WHEEL, "effects.rotor.momentum", "omega", "", 1, "effects.rotor.momentum"),
    "known torque": (DRIVEN, "", "omega", "", 0, ""),
    "unknown torque": (
        DRIVEN, "effects.body_torque.size", "omega", "", 1, "effects.body_torque.size"),
    "known weight": (HEAVY, "", "attitude", "", 0, ""),
    "unknown weight": (HEAVY, "effects.gravity.g", "attitude", "", 1, "effects.gravity.g"),
    "unknown weight by rates": (HEAVY, "effects.gravity.g", "omega", "", 1, "effects.gravity.g"),
    "unknown quadratic drag": (
        DRAGGED, "effects.quadratic_drag.drag", "omega", "", 1, "effects.quadratic_drag.drag"),
    "spin about a principal axis": (STEADY_BODY, "", "omega", "", 3, "do not show body.moments.1"),
    "bias of a steady spin": (STEADY_BODY, "", "omega", "bias", 4, "omega.bias.3"),
    "offset of a clock": (FREE_BODY, "", "omega", "offset", 2, "omega.offset"),
    "drift beside attitudes": (FREE_BODY, "", "attitude", "drift", 2, "start.omega.1"),
    "alignment of attitudes": (FREE_BODY, "", "attitude", "alignment", 1, RATIOS),
    "offset between clocks": (FREE_BODY, "", "omega,attitude", "attitude.offset", 1, RATIOS),
    "scale of each axis": (FREE_BODY, "", "omega", "scale", 3, "omega.scale"),
    "alignment of a disc": (STILL_DISC, "", "omega", "alignment", 2, "omega.alignment.3"),
    "momentum": (BY_MOMENTUM, "", "omega", "", 1, "start.momentum"),
}  # fmt: skip


def gauge_of(name):
    """Return the row of a scene: what its fit says of a record without noise."""
    scene, more, save, nuisances, number, words = GAUGES[name]
    saved, start = tuple(save.split(",")), f"start.{scene.start.spin_name}"
    free = ["body.moments", start, *filter(None, [more])]
    ds = moved(scene, 6.0, 0.02, saved)
    records = records_of(scene, ds, {}, None, None, ())
    records = [one._replace(
        times={k: v for k, v in one.times.items() if k in saved},
        values={k: v for k, v in one.values.items() if k in saved}) for one in records]  # fmt: skip
    noise = dict.fromkeys(saved, 1e-3)
    sensors = tuple(filter(None, nuisances.split(",")))
    problem = make_problem(scene, free, (), records, noise, sensors, 1)
    x = problem.parameters.coordinates({})
    solution = minimise(problem, x[None])
    shown = seen(solution.sums.matrix[0])
    text = in_words(problem.parameters, solution.x[0], shown)
    found = len(shown.unseen)
    right = found == number and (not words or any(words in line for line in text))
    return {"gauge": name, "unseen": found, "asked": number, "right": right, "text": text}


POSTERIORS = "free body", "slowed ball"
RATE = "effects.viscous_damping.rate"


def free_body(random):
    """Return (moments of any shape, scene, table) of a free body whose start is known."""
    moments = 1.0 - random.dirichlet([1.0, 1.0, 1.0])
    scene = rm.Scene(rm.Body(tuple(moments)), start=rm.Start(omega=(3.0, 4.0, 5.0)))
    return moments, scene, noisy(scene, random)


def noisy(scene, random):
    """Return the table of 2 s of a scene, read at 20 Hz with noise of .2 rad/s."""
    ds = moved(scene, 1.95, 0.05)
    read = ds.omega.values[:, :, 0] + 0.2 * random.normal(size=(ds.time.size, 3))
    return table_of(ds.time.values, read)


def ranks_of(seed, name):
    """Return the row of a truth: its ranks among the draws, from 0 to 1."""
    random = np.random.default_rng([seed, 7])
    if name == POSTERIORS[0]:
        moments, guess, table = free_body(random)
        truth = {f"body.moments.{i + 1}/body.moments.3": moments[i] / moments[2] for i in (0, 1)}
        limits, free = {}, "body.moments"
    else:
        omega, rate = random.uniform(-3.0, 3.0, 3), random.uniform(0.0, 0.5)
        truth = {RATE: rate} | {f"start.omega.{k + 1}": omega[k] for k in range(3)}
        scene, guess = (
            rm.Scene(rm.Body((1.0, 1.0, 1.0)), rm.ViscousDamping(k), start=rm.Start(omega=w))
            for k, w in ((rate, tuple(omega)), (0.2, (1.0, 1.0, 1.0)))
        )
        limits = {RATE: (0.0, 0.5)} | {f"start.omega.{k + 1}": (-3.0, 3.0) for k in range(3)}
        free, table = f"start.omega,{RATE}", noisy(scene, random)
    words = {"posterior": "emcee", "chains": 2, "trials": 8, "noise": {"omega": 0.2}, "threads": 1}
    study = rm.fit(guess, table, free, **words)
    drawn = {str(q): study.drawn.sel(quantity=q).values.ravel() for q in study.quantity.values}
    inside = np.ones(study.lp.size, bool)
    for key, (low, high) in limits.items():  # the prior of the truths ends there
        inside &= (drawn[key] > low) & (drawn[key] < high)
    ranks = [float(np.mean(drawn[key][inside] < x)) for key, x in truth.items()]
    return {
        "posterior": name,
        "seed": seed,
        "ranks": ranks,
        "converged": int(study.attrs["converged"]),
        "r_hat": float(study.r_hat.max()),
        "worst": str(study.quantity.values[np.argmax(study.r_hat.values)]),
        "effective": float(study.effective.min()),
    }


def chi_square(ranks, bins):
    """Return the probability of counts in bins that are as uneven, for each column of ranks."""
    ranks = np.asarray(ranks)
    counts = np.stack([np.histogram(x, bins, (0.0, 1.0))[0] for x in ranks.T])
    expected = len(ranks) / bins
    return stats.chi2.sf(((counts - expected) ** 2 / expected).sum(1), bins - 1)


def phone_of(seed):
    """Return the row of a record of a phone: the errors of its ratios, over the least deviations
    and over the deviations that are told."""
    study = peers.fit(seed, 20)
    off = study.ratio.values[:2, 2] - peers.MOMENTS[:2]
    told = study.ratio_deviation.values[:2, 2]
    return {"off": (off / peers.bound()).tolist(), "told": (told / peers.bound()).tolist()}


def memory(word="VmRSS"):
    """Return the memory of this process [MB]; VmHWM : the largest so far"""
    with open("/proc/self/status") as file:
        return int(dict(line.split(":") for line in file)[word].split()[0]) / 1e3


def speed_of(trials):
    """Return the row of many trials: 2,000 rates of a body in three turns, 6 parameters."""
    imports, end = memory(), 2.0 * np.pi / 3.7 * 3.0
    scene = rm.Scene(rm.Body((0.45, 0.8, 1.1)), start=rm.Start(omega=(1.0, 3.0, -2.0)))
    ds = moved(scene, end, end / 1999)
    read = ds.omega.values[:, :, 0] + NOISE * np.random.default_rng(1).normal(size=(2000, 3))
    table = table_of(ds.time.values, read)
    problem = make_problem(
        GUESS, FREE.split(","), (), records_of(GUESS, table, {}, None, None, ()),
        {"omega": NOISE}, (), harness.threads_available(),
    )  # fmt: skip
    x = make_starts(problem, 1000, 1)
    problem.sums(x[:32])  # compiles
    step, step_busy = harness.once(lambda: problem.sums(x))
    rm.fit(GUESS, table, FREE, noise={"omega": NOISE}, trials=4)
    few = memory("VmHWM")
    seconds, busy = harness.once(
        lambda: rm.fit(GUESS, table, FREE, noise={"omega": NOISE}, trials=trials)
    )
    return {"trials": trials, "step": step, "step_busy": step_busy, "seconds": seconds,
            "busy": busy, "imports": imports,
            "few": few, "most": memory("VmHWM")}  # fmt: skip


KINDS = {"fit": fit_one, "gauge": gauge_of, "ranks": ranks_of, "phone": phone_of, "speed": speed_of}


def work(job):
    """Return the row of a job, in a process of its own."""
    kind, *rest = job
    return harness.row(kind, **KINDS[kind](*rest))


def run(quick, python=sys.executable):
    """Return the rows: gauges, records of both laws and of a phone, ranks, speed, other programs,
    and what is asked."""
    count = 8 if quick else 200
    jobs = [("gauge", name) for name in GAUGES] + [("phone", seed) for seed in range(count)]
    jobs += [("fit", seed, law) for law in LAWS for seed in range(count)]
    jobs += [("ranks", seed, name) for name in POSTERIORS for seed in range(count)]
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        rows = list(pool.map(work, jobs))
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        rows.append(pool.submit(work, ("speed", 2000 if quick else 100_000)).result())
    rows += peers.run(quick, python)
    return rows + asked(rows)


def asked(rows):
    """Return the rows of the closing table, of the rows that there are."""
    found, at_most = [], harness.at_most
    for law, least in zip(LAWS, (0.93, 0.90), strict=True):
        some = [row for row in harness.of_kind(rows, "fit") if row["law"] == law]
        if some:
            inside = (np.abs([row["off"] for row in some]) < 1.96).mean(axis=1)
            listed, told = (np.mean([row[k] for row in some]) for k in ("is_listed", "told"))
            note = f"+- {error_of(inside):.1%}; told {told:.1%}"
            found += [
                harness.target(f"95 % intervals cover, {law}", least, inside.mean(), note=note),
                harness.target(f"true or listed, {law}", 0.99, listed),
            ]
    if phones := harness.of_kind(rows, "phone"):
        off = np.square([row["off"] for row in phones])
        told = np.median([row["told"] for row in phones], axis=0)
        for i, each in enumerate(off.T):
            size = np.sqrt(each.mean())
            note = f"+- {0.5 * error_of(each) / size:.3f}; told {told[i]:.3f}"
            what = f"error of I{i + 1}/I3 over Cramer and Rao's"
            found.append(at_most(what, 1.1, size, note=note))
    if gauges := harness.of_kind(rows, "gauge"):
        right = np.mean([row["right"] for row in gauges])
        found.append(harness.target("gauge named right", 1.0, right, note=f"of {len(gauges)}"))
    for row in harness.of_kind(rows, "speed"):
        what = f"{row['trials']:,} trials x 2,000 samples x 6"
        beyond = f"imports {row['imports']:.0f}, 4 trials {row['few']:.0f} MB"
        found += [
            at_most(
                "1,000 trials x 2,000 x 6, a step",
                1.0,
                row["step"],
                "s",
                note=f"{row['step_busy']:.2g} s of processor",
            ),
            at_most(what, 60.0, row["seconds"], "s", note=f"{row['busy']:.0f} s of processor"),
            at_most(f"{what}, memory", 200.0, row["most"], "MB", note=beyond),
        ]
    each = {row["name"]: row["seconds"] for row in harness.of_kind(rows, "peer")}
    for name in filter(each.get, peers.OTHERS):
        what = f"a fit with intervals, beside {name}"
        found.append(at_most(what, round(each[name], 2), each["rigidmc, one guess"], "s", aim=True))
    return found


def error_of(values):
    """Return the standard error of a mean."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def report(rows):
    """Print what the rows say."""
    for row in harness.of_kind(rows, "gauge"):
        if not row["right"]:
            print(f"{row['gauge']}: {row['unseen']} for {row['asked']}: {row['text']}")
    for law in LAWS:
        coverage_lines(law, [row for row in harness.of_kind(rows, "fit") if row["law"] == law])
    for name in POSTERIORS:
        some = [row for row in harness.of_kind(rows, "ranks") if row["posterior"] == name]
        if some:
            chance = chi_square([row["ranks"] for row in some], max(2, len(some) // 10))
            print(f"ranks of {name}: {len(some)} truths, chi-square by chance {chance.round(2)},"
                  f" {np.mean([row['converged'] for row in some]):.1%} converged")  # fmt: skip
        for row in some:
            if not row["converged"]:
                print(f"  seed {row['seed']}: R-hat {row['r_hat']:.3f} of {row['worst']},"
                      f" {row['effective']:.0f} effective")  # fmt: skip
    peers.show(rows)
    harness.report_targets(rows)


def coverage_lines(law, rows):
    """Print the shares of one law."""
    off = np.abs([row["off"] for row in rows])
    inside = off < 1.96
    print(
        f"{law}: {len(rows)} records, intervals that cover {inside.mean():.1%} (ratios"
        f" {inside[:, :2].mean():.1%}, start {inside[:, 2:5].mean():.1%}, bias"
        f" {inside[:, 5:8].mean():.1%}, alignment {inside[:, 8:].mean():.1%}), true or listed"
        f" {np.mean([row['is_listed'] for row in rows]):.1%}, told"
        f" {np.mean([row['told'] for row in rows]):.1%},"
        f" {np.mean([row['seconds'] for row in rows]):.2f} s each"
    )
    for row, x in zip(rows, off, strict=True):
        if not x.max() < 5.0 or not row["is_listed"]:
            print(f"  seed {row['seed']}: off {x.round(1)}, {row['answers']} answers, chi2"
                  f" {row['chi2']:.3f}, {row['torque']}, listed {row['is_listed']}")  # fmt: skip
