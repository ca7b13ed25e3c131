"""Sobol indices against plain members: how many members give all indices the same interval.

A disc with a torque, both linear in two normal numbers, has the indices 0.1 and 0.9. Plain methods
are bins of independent members, which give first indices only; and pairs or 32 members that share
one number (first) or all but one (total), for one index at a time.
"""

import numpy as np

import rigidmc as rm
from bench import harness
from rigidmc.statistics.measures import measure
from rigidmc.studies.sensitivity.study import indices

HALF = 0.01  # half the width of the intervals
STUDIES = 200  # enough to give the spread of an index to 5 %
MEMBERS = 4096  # of each study
SHARES = np.array([0.1, 0.9])  # of torque and spin
OF = "mean(omega_mean[3])"


def values(torque, spin):
    """Return the mean spins of discs with these torques and spins, by running them."""
    scene = rm.Scene(
        rm.Body((1.0, 1.0, 2.0)),
        rm.BodyTorque((0.0, 0.0, torque)),
        rm.Start(omega=(0.0, 0.0, spin)),
    )
    run = {"integrator": "rk4", "t_end": 2.0, "dt": 0.1, "save": ("omega_mean",)}
    return rm.simulate(scene, **run, keep="final").omega_mean.sel(axis=3).values


def designed_indices(studies):
    """Return (2, studies, 4): first index of torque and spin, total of both, by
    `rigidmc.sensitivity`, with its controls and without."""
    torque = rm.BodyTorque((0.0, 0.0, rm.normal(0.0, 0.4)))
    start = rm.Start(omega=(0.0, 0.0, rm.normal(1.0, 0.6)))
    scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), torque, start)
    run = {"integrator": "rk4", "t_end": 2.0, "dt": 0.1}
    scene = rm.sensitivity.design(scene, OF, studies * MEMBERS // 4, **run)
    result = rm.simulate(scene)
    each = measure(OF, result.data_vars).values(result).reshape(studies, -1, 4)
    return np.array(
        [
            [np.concatenate([one.value for one in indices(y, controls=some)]) for y in each]
            for some in (True, False)
        ]
    )


def split(groups):
    """Estimate the fraction of the variance between groups (studies, groups, size), unbiased.

    With B the variance between means times the size n, and W the variance within, it is
    (B - W)/(B + (n - 1) W).
    """
    size = groups.shape[2]
    between = size * groups.mean(axis=2).var(axis=1, ddof=1)
    within = groups.var(axis=2, ddof=1).mean(axis=1)
    return (between - within) / (between + (size - 1) * within)


def nested(number, of_total, size, studies, draws):
    """Return (studies,): an index from groups of `size` members that share a number, or all
    others."""
    count = MEMBERS // size
    shared = np.repeat(draws.normal(size=(studies, count, 1)), size, axis=2)
    other = draws.normal(size=(studies, count, size))
    mine, rest = (other, shared) if of_total else (shared, other)
    torque, spin = (mine, rest) if number == 0 else (rest, mine)
    y = values(0.4 * torque.ravel(), 1.0 + 0.6 * spin.ravel()).reshape(studies, count, size)
    return 1.0 - split(y) if of_total else split(y)


def binned(studies, draws, size=64):
    """Return (studies, 2): the first indices by bins of independent members, of `size` each."""
    x = draws.normal(size=(2, studies, MEMBERS))
    y = values(0.4 * x[0].ravel(), 1.0 + 0.6 * x[1].ravel()).reshape(studies, MEMBERS)
    order = np.argsort(x, axis=2)
    found = [split(np.take_along_axis(y, one, axis=1).reshape(studies, -1, size)) for one in order]
    return np.stack(found, axis=1)


def needed(found, truth):
    """Return the members for intervals of +- HALF, from the errors, including bias, of studies with
    MEMBERS."""
    error = np.sqrt(((found - truth) ** 2).mean(axis=0))
    return MEMBERS * (1.96 * error / HALF) ** 2


def measured(quick):
    studies, draws = 40 if quick else STUDIES, np.random.default_rng(1)
    truth = np.concatenate([SHARES, SHARES])
    ours, bare = (needed(found, truth) for found in designed_indices(studies))
    bins = needed(binned(studies, draws), SHARES)
    rows = [
        {"kind": "shares", "way": "rm.sensitivity", "each": ours.tolist(), "all": ours.max()},
        {"kind": "shares", "way": "without controls", "each": bare.tolist(), "all": bare.max()},
        {"kind": "shares", "way": "bins of 64", "each": [*bins, None, None], "all": None},
    ]
    for size in (2, 32):
        each = [
            needed(nested(k, of_total, size, studies, draws), SHARES[k])
            for of_total in (False, True)
            for k in range(2)
        ]
        rows.append(
            {"kind": "shares", "way": f"groups of {size}", "each": each, "all": float(sum(each))}
        )
    totals = [sum(row["each"][2:]) for row in rows if row["way"].startswith("groups")]
    best = float(bins.max() + min(totals))
    rows.append({"kind": "shares", "way": "bins, and groups for totals", "each": [], "all": best})
    gains = {
        row["way"]: row["all"] / rows[0]["all"]
        for row in rows
        if row["way"] not in (rows[0]["way"], "bins of 64")
    }
    return rows + [
        harness.target(f"all Sobol indices, {way} over rm.sensitivity", 1.0, gain, "times")
        for way, gain in gains.items()
    ]


def show(rows):
    def text(count):
        return "" if count is None else f"{count:,.0f}"

    cells = [
        (row["way"], *(text(one) for one in row["each"] or [None] * 4), text(row["all"]))
        for row in rows
        if row["kind"] == "shares"
    ]
    columns = ["way", "first, torque", "first, spin", "total, torque", "total, spin", "all of them"]
    harness.table(f"members for Sobol indices to +- {HALF}", columns, cells)
