"""How often 95 % intervals cover the truth, over repeated studies with a known truth.

To test a new interval, add one entry to INTERVALS.
"""

import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from scipy import stats

import rigidmc as rm
from bench import harness, multilevel
from bench.problems import cantor
from bench.problems.rare_truths import SPREAD, bathed, passed, spun
from rigidmc.scene.sampling import Saltelli
from rigidmc.statistics import censored, intervals
from rigidmc.studies.sensitivity.study import indices

FEW = 50  # studies of a quick run

# Ishigami's function with a = 7, b = 0.1; Ishigami & Homma, ISUMA (1990) 398
GROUP = {("x", 0, i): i for i in range(3)}
PARTS = np.array([0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0])
BOTH = 0.01 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)  # of x_1 and x_3 together
FIRST = PARTS / (PARTS.sum() + BOTH)
TOTAL = (PARTS + BOTH * np.array([1.0, 0.0, 1.0])) / (PARTS.sum() + BOTH)

# the mean spin of this disc over 2 s is omega + N/2
TORQUE = rm.BodyTorque((0.0, 0.0, rm.normal(0.0, 0.4)))
START = rm.Start(omega=(0.0, 0.0, rm.normal(1.0, 0.6)))
LINEAR = rm.Scene(rm.Body((1.0, 1.0, 2.0)), TORQUE, START).with_run(
    integrator="rk4", t_end=2.0, dt=0.1
)
SHARES = np.array([0.1, 0.9])  # of torque and spin, in a variance of 0.4
FAST = 1.0 + 0.4**0.5 * stats.norm.isf(0.1)  # one disc in ten spins faster [rad/s]


def ishigami(seed, families):
    """Return Ishigami's function (families, 5) on the points of a sensitivity study."""
    words = Saltelli(seed, GROUP).words("x", 0, 5 * families, 0, (0, 1, 2))[:3]
    x = np.pi * (2.0 * words - 1.0)
    y = np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])
    return y.reshape(families, 5)


def inside(found, truth):
    """Return 1 for each interval that contains its truth, else 0."""
    return ((found.low <= truth) & (truth <= found.high)).astype(int)


def of_ishigami(families, studies):
    """Return (how many intervals of first_1, _2, _3, total_1, _2, _3 cover the truth, studies)."""
    covered = 0
    for seed in range(studies):
        first, total = indices(ishigami(seed, families))
        covered += np.concatenate([inside(first, FIRST), inside(total, TOTAL)])
    return covered, studies


def of_a_top(text, first, total, families, studies):
    """Count covering intervals for a measure of discs, linear in Gaussian numbers, by runs."""
    covered, ends = np.zeros((2, len(first)), int), ("", "_low", "_high")
    for seed in range(studies):
        found = rm.sensitivity(LINEAR.with_run(seed=seed), text, families, threads=1).isel(
            measure=0
        )
        for i, (name, truth) in enumerate((("first", first), ("total", total))):
            one = intervals.Interval(*(found[f"{name}{end}"].values for end in ends))
            covered[i] += inside(one, truth)
    return covered.ravel(), studies


def of_fast_tops():
    """Return (first, total): the exact Sobol indices of being among the fastest tenth of discs.

    For two discs that share the number k, the joint probability is that of two normal numbers with
    correlation share_k.
    """
    z = stats.norm.isf(0.1)
    pairs = [stats.multivariate_normal([0.0, 0.0], [[1.0, r], [r, 1.0]]) for r in SHARES]
    both = np.array([pair.cdf([-z, -z]) for pair in pairs])
    first = (both - 0.01) / 0.09
    return first, 1.0 - first[::-1]


def of_probability(p, trials, studies):
    """Count covering Wilson intervals; returns (covering, studies)."""
    k = np.random.default_rng(1).binomial(trials, p, studies)
    return inside(intervals.probability(k, trials), p).sum(), studies


def of_mean(studies):
    """Count covering Student intervals of 60 values from a skewed distribution."""
    x = np.random.default_rng(2).gamma(4.0, size=(studies, 60))
    return inside(intervals.mean(x), 4.0).sum(), studies


def of_median(studies):
    """Count covering intervals of the median of 300 values from a skewed distribution."""
    x = np.random.default_rng(3).exponential(size=(studies, 300))
    return inside(intervals.quantiles(x, 0.5), np.log(2.0)).sum(), studies


def of_correlation(r, studies):
    """Count covering Fisher intervals of 60 pairs."""
    x, y = np.random.default_rng(4).normal(size=(2, studies, 60))
    return inside(intervals.correlation(x, r * x + (1.0 - r * r) ** 0.5 * y), r).sum(), studies


def censored_times(law, share, several, saved, size):
    """Return signed times from a distribution, negative for the fraction `share` that did not come.

    share : fraction later than the end of their member. All members have the same end, or (several)
        exponential ends; against an exponential distribution these come first with probability
        rate/(rate + 1)
    saved : time between saves, to which times are rounded up; 0 for exact times
    """
    some = np.random.default_rng(5)
    times = law.rvs(size, random_state=some)
    ends = np.full(size, law.isf(share))
    if several:
        ends = some.exponential((1.0 - share) / share, size)
    if saved:
        times, ends = (saved * np.ceil(x / saved) for x in (times, ends))
    return np.where(times <= ends, times, -ends)


def of_censored_quantile(law, q, share, members, studies, several=False, saved=0.0):
    """Count covering intervals for a quantile of the time of an event, with a fraction `share`
    censored."""
    truth = law.ppf(q)
    times = censored_times(law, share, several, saved, (studies, members))
    found = censored.censored_quantile(times, q, 0.95)
    return inside(found, saved * np.ceil(truth / saved) if saved else truth).sum(), studies


def of_censored_share(law, p, share, members, studies, several=False, saved=0.0):
    """Count covering intervals for the probability that an event is later than the time of a save,
    before which a fraction 1 - p has come."""
    at = law.isf(p)
    at = saved * np.ceil(at / saved) if saved else at
    times = censored_times(law, share, several, saved, (studies, members))
    found = censored.censored_probability(times, ">", at, 0.95)
    return inside(found, law.sf(at)).sum(), studies


def of_rare(scene, of, truth, members, repetitions, studies):
    """Count covering intervals for the probability of a rare event. Each study draws 16 repetitions
    from a larger computed set."""
    found = rm.rare(scene, of, 1e-12, members, repetitions, threads=1).probability.values
    drawn = np.random.default_rng(6).choice(found, (studies, 16))
    each = [intervals.mean_of_skew(one) for one in drawn]
    return sum(int(one.low <= truth <= one.high) for one in each), studies


def of_levels(studies):
    """Count covering intervals for a mean by multilevel Monte Carlo."""
    return multilevel.covered(studies)[:, 0].sum(), studies


def of_boundary(families, studies):
    """Count covering intervals for the exponent of a boundary between basins."""
    each = [
        cantor.found(cantor.ends_of(seed, families, lambda x: cantor.gap(x) % 2))
        for seed in range(studies)
    ]
    return sum(int(one.low <= cantor.CANTOR <= one.high) for one in each), studies


FAR, STEPS, LEVEL = stats.norm.isf(1e-5), 10, 3.6 * SPREAD  # rad/s, steps, rad/s
THROWN = spun(), f"p(omega_max[3] >= {FAR:.17g})", 1e-5
BATHED = bathed(STEPS), f"p(omega_max[3] >= {LEVEL:.17g})", passed(LEVEL, STEPS)
MEAN, FASTEST = "mean(omega_mean[3])", f"p(omega_mean[3] > {FAST})"
# Waiting times without memory, and the time at which Brownian motion with drift reaches a level,
# both with closed forms.
WAIT, HIT = stats.expon(), stats.invgauss(1.0)
CENSORED = {
    f"{what}, {100 * share:g} % not by {ends}, {n:,} members": (
        partial(function, law, p, share, n, several=several, saved=saved), 1000)
    for what, function, law, p, share, n, several, saved in (
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.0, 300, False, 0.0),
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.2, 40, False, 0.0),
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.46, 100, False, 0.0),
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.46, 1000, False, 0.0),
        ("quartile of waits", of_censored_quantile, WAIT, 0.25, 0.6, 300, False, 0.0),
        ("median of hits", of_censored_quantile, HIT, 0.5, 0.46, 300, False, 0.0),
        ("tenth of hits", of_censored_quantile, HIT, 0.1, 0.6, 1000, False, 0.0),
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.2, 100, True, 0.0),
        ("median of waits", of_censored_quantile, WAIT, 0.5, 0.46, 300, True, 0.0),
        ("quartile of waits", of_censored_quantile, WAIT, 0.25, 0.6, 300, True, 0.0),
        ("share of waits", of_censored_share, WAIT, 0.5, 0.46, 20, True, 0.0),
        ("share of waits", of_censored_share, WAIT, 0.7, 0.6, 100, True, 0.0),
        ("share of waits at saves", of_censored_share, WAIT, 0.5, 0.46, 100, True, 0.2),
    )
    for ends in ("their ends" if several else "the end",)
}  # fmt: skip
# {name: (function of a number of studies, which returns (covering intervals, studies), and that
# number)}. The count may be an array, for several intervals of each study.
INTERVALS = {
    "Sobol indices, Ishigami, 1,024 families": (partial(of_ishigami, 1024), 1000),
    "Sobol indices, Ishigami, 512 families": (partial(of_ishigami, 512), 2000),
    "Sobol indices, linear top, 1,024 families": (
        partial(of_a_top, MEAN, SHARES, SHARES, 1024), 1000),
    "Sobol indices, linear top, 512 families": (
        partial(of_a_top, MEAN, SHARES, SHARES, 512), 2000),
    "Sobol indices, fastest tenth, 1,024 families": (
        partial(of_a_top, FASTEST, *of_fast_tops(), 1024), 1000),
    "rare event by subsets, p = 1e-5, 1,000 members": (
        partial(of_rare, *THROWN, 1000, 2000), 1000),
    "rare event by splitting, p = 2.8e-5, 300 members": (
        partial(of_rare, *BATHED, 300, 2000), 1000),
    "mean by multilevel Monte Carlo": (of_levels, 1000),
    "exponent of a boundary, 4,096 families": (partial(of_boundary, 4096), 1000),
    "probability 0.1 of 400 (Wilson)": (partial(of_probability, 0.1, 400), 10_000),
    "probability 0.5 of 400 (Wilson)": (partial(of_probability, 0.5, 400), 10_000),
    "mean of 60 (Student)": (of_mean, 10_000),
    "median of 300 (ranks)": (of_median, 2000),
    "correlation 0.6 of 60 pairs (Fisher)": (partial(of_correlation, 0.6), 10_000),
    **CENSORED,
}  # fmt: skip


def shares(name, studies=None):
    """Return the fraction of an entry's intervals that cover the truth, as an array."""
    function, count = INTERVALS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)
        covered, studies = function(studies or count)
    return np.atleast_1d(covered) / studies


def run(quick):
    """Return all rows of the bench, using a process on each core."""
    counts = {name: FEW if quick else count for name, (_, count) in INTERVALS.items()}
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        found = list(pool.map(shares, counts, counts.values()))
    rows = [
        {"kind": "coverage", "what": name, "studies": count, "covered": covered.tolist()}
        for (name, count), covered in zip(counts.items(), found, strict=True)
    ]
    return rows + [
        harness.at_most(
            f"{row['what']}: farthest from 95 %",
            2.0,
            100.0 * max(abs(share - 0.95) for share in row["covered"]),
            "points",
        )
        for row in rows
    ]


def report(rows):
    harness.show(
        "intervals of 95 %",
        harness.of_kind(rows, "coverage"),
        "intervals {what} | studies {studies:,} | covered [%] {shares}",
        shares=lambda r: ", ".join(f"{100 * share:.1f}" for share in r["covered"]),
    )
    harness.report_targets(rows)
