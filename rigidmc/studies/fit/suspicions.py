"""Suspicions: what looks wrong in measurements, told before a fit.

The rates of a free body say more than its moments. With the right rates and times, some body obeys
the balance of angular momentum; times a factor s, none does: rates in degrees are 180/pi times too
large, and times in milliseconds 1,000 times. If axes are swapped or negated, the body of the scene
does not obey the balance, but does with another signed permutation of the axes. (A free
body whose moments are all unknown has two hands: negated rates suit another body.)
"""

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rigidmc.errors import OptionError
from rigidmc.physics.effects import name_of
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import nominal_of
from rigidmc.studies.fit.balance import Windows, balance, windows_of
from rigidmc.studies.fit.records import Record
from rigidmc.studies.fit.streams import Array

# Measured with random free bodies, of a known attitude of the sensor (or a free one), noise, a bias
# and drag, and with first guesses of the moments right to 10 %. Of 400 right records, 2 are
# suspected; of 60 with two columns swapped, 65 % (42 %) are, of 60 with one negated, 92 % (40 %).
# In the other cases another body moves nearly so: `answers.doubts` names it, or the residuals do.
HELD = 3  # successive readings at the extreme of a channel that are saturation
REPEATED = 0.3  # fraction of readings that equal the one before, if the sensor is slower
RESOLVED = 0.5  # rad between two readings: sums of them are integrals to some percent
TURNED = 2.0  # rad between two readings: the rates then hide most of the motion
MOST_TURNED = 1e6  # rad in a record: 4e6 saves
BETTER = 9.0  # ratio of sums of squares that tells: residuals a third as large
EXPLAINED = 0.15  # of the changes of the rates that a body may leave, if it moves so
FLOOR = 0.03  # of the changes that drag and the trapezoid rule may leave
WEIGHT = 0.18  # of all a body leaves, in squared errors of guesses: 18 numbers, each for .1
RIGHT = 0.08  # relative error of first guesses that raises no suspicion
MOST_WINDOWS = 1000  # of all records
FACTORS = {
    180.0 / np.pi: "rates in degrees, read as radians",
    np.pi / 180.0: "rates in radians, read as degrees",
    1e3: "times in ms, read as s",
    1e-3: "times in s, read as ms",
}
# others are called another rate or unit; none within 1.25 of 1, by which drag may err
SCALES = (*FACTORS, *(x for x in 10.0 ** np.arange(-4.0, 4.01, 0.1) if abs(np.log10(x)) > 0.09))
UPRIGHT = np.eye(3)
HAND = "a left-handed sensor: is one column negated, or are two swapped?"
DAMPING = ("viscous_damping", "axial_damping", "matrix_damping", "quadratic_drag", "dry_friction")
Rates = Sequence[tuple[Array, Array]]  # times and rates of each record


def examine(
    scene: Scene, records: Sequence[Record], nuisances: Sequence[str]
) -> tuple[list[Record], list[str]]:
    """Return (records without saturated readings, what looks wrong in them, in sentences)."""
    notes = [f"{r.name}: {text}" for r in records for text in r.notes]
    records = [_without_saturated(record, notes) for record in records]
    rates = [(r.times["omega"], r.values["omega"]) for r in records if "omega" in r.values]
    if rates:
        between = _turns(rates, notes)
        known = {name_of(effect) for effect in scene.effects}
        if known <= set(DAMPING) and not records[0].wheel:
            is_turned = any("alignment" in word for word in nuisances)
            notes += _balance(scene, rates, is_turned, between < RESOLVED)
    return records, notes


def _without_saturated(record: Record, notes: list[str]) -> Record:
    """Return a record with nan for readings that stay at the extreme of their channel."""
    values = {name: np.array(x) for name, x in record.values.items()}
    for name, x in values.items():
        same = np.mean((np.diff(x, axis=0) == 0.0).all(1)) if len(x) > 4 else 0.0
        is_slow = REPEATED < same < 1.0
        if is_slow:
            notes.append(
                f"{record.name}: {name} repeats each reading about {1.0 / (1.0 - same):.2g} times:"
                " its sensor is slower than the table, so its intervals are too narrow"
            )
        for c, column in enumerate(x.T):
            channel = f"{name}[{c + 1}]" if x.shape[1] > 1 else name
            if channel in record.numbers:
                continue
            text = _held(record.times[name], column, is_slow)
            notes += [f"{record.name}: {channel} {text}"] if text else []
    return record._replace(values=values)


def _held(times: Array, x: Array, is_slow: bool) -> str:
    """Return what looks wrong in a channel, and put nan in place of its saturated readings."""
    seen = np.flatnonzero(np.isfinite(x))
    steps, texts = np.abs(np.diff(x[seen])), list[str]()
    if x.size > 1 and not steps.any():
        text = f"reads {x[seen[0]]:g} at all times: a sensor that hangs?" if seen.size else ""
        return text or "has no readings"
    for extreme in () if is_slow else (np.nanmin(x), np.nanmax(x)):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], x[seen] == extreme, [0]))))
        for first, end in edges.reshape(-1, 2):
            beside = steps[[i for i in (first - 1, end - 1) if 0 <= i < steps.size]]
            # the top of a smooth curve has several equal readings, if its steps are as small as the
            # last digit
            if end - first >= HELD and beside.max() > 2.0 * steps[steps > 0.0].min():
                x[seen[first:end]] = np.nan
                texts.append(
                    f"stays at its extreme {extreme:g} in {end - first} readings from"
                    f" {times[seen[first]]:g} s on: saturated, left out"
                )
    return "; ".join(texts)


def _turns(rates: Rates, notes: list[str]) -> float:
    """Return the angle between readings [rad], and tell a large one; OptionError for no run."""
    pairs = [
        (t, float(np.median(np.linalg.norm(np.nan_to_num(w), axis=1))))
        for t, w in rates
        if t.size > 1
    ]
    between = max((speed * float(np.median(np.diff(t))) for t, speed in pairs), default=0.0)
    longest = max((speed * float(t[-1] - t[0]) for t, speed in pairs), default=0.0)
    words = f"the body turns by {between:.3g} rad between two readings"
    asks = "are times in ms, or rates in degrees? Give units by --time, --columns"
    if longest > MOST_TURNED:
        raise OptionError(f"{words} and {longest:.3g} rad in a record: {asks}", at="data")
    if between > TURNED:
        notes.append(f"{words}: {asks}")
    return between


def _balance(scene: Scene, rates: Rates, is_turned: bool, is_resolved: bool) -> list[str]:
    """Return what the balance of angular momentum tells of units and axes.

    is_turned : whether the sensor may have any attitude in the body
    """
    windows = windows_of(rates)
    if windows is None or not np.sum(windows.change**2):
        return []
    change, turn, products = (x[:: 1 + len(x) // MOST_WINDOWS] for x in windows[:3])
    windows = Windows(change, turn, products, windows.length)
    moments = np.array(nominal_of(scene.model, ["body.moments"])["body.moments"])
    scales = 1.0, -1.0, *SCALES
    tensors = dict(zip(scales, balance(windows, True, [1.0 / s for s in scales]), strict=True))
    changes = float(np.sum(change**2))

    def any_body(s: float) -> float:
        some = [x for x in (np.diag(moments), tensors[s]) if x is not None]
        return min(float(np.sum(windows.residuals(x, 1.0 / s) ** 2)) for x in some)

    costs = {s: any_body(s) for s in (1.0, *SCALES)}
    best = min(costs.values())
    size = windows.change.size * max(float(np.nanmean(w**2)) for _, w in rates)
    if is_resolved and best > EXPLAINED**2 * max(changes, EXPLAINED * size):
        return [
            "no free body moves so, with any axes and units: was it held for a time (--between), or"
            " does a torque or a rotor act on it?"
        ]

    least = max(best, FLOOR**2 * changes)

    def wrong(s: float, axes: Array = UPRIGHT) -> float:
        each, factor, tensor = moments, np.linalg.det(axes) / s, tensors[s]
        if is_turned and tensor is not None:
            each, axes = np.sort(moments), np.linalg.eigh(tensor)[1].T
        error, left = _nearest(windows, factor, each, axes.T, is_turned, WEIGHT / least)
        return error + max(0.0, WEIGHT * (left / least - 1.0))

    given = wrong(1.0)
    if given > BETTER * RIGHT**2:
        other = {f"{text}?": wrong(s) for s, text in FACTORS.items()}
        if is_turned:
            other[HAND] = wrong(-1.0)
        else:
            asks = "are columns swapped or negated, or moments in another order?"
            for order, sign in product(permutations((1, 2, 3)), ("", "-")):
                # one of each order and hand, as a body moves alike with the others
                columns = "omega[{}], omega[{}], ".format(*order) + f"{sign}omega[{order[2]}]"
                axes = np.diag([1.0, 1.0, -1.0 if sign else 1.0])[:, np.argsort(order)]
                other[f"omega = ({columns}): {asks}"] = wrong(1.0, axes)
        text = min(other, key=lambda text: other[text])
        if given > BETTER * max(RIGHT**2, other[text]):
            return [f"the rates suit the moments of the scene far better as {text}"]
    # the balance, linear in the tensor, is best for other weights
    if costs[1.0] > BETTER * best and tensors[1.0] is not None:
        each = np.linalg.eigh(tensors[1.0])
        costs[1.0] = _nearest(windows, 1.0, *each, True, 1e6 / least)[1]
    if costs[1.0] > BETTER * best:
        near = [s for s in FACTORS if costs[s] < 2.0 * best]
        scale = near[0] if near else min(costs, key=lambda s: costs[s])
        text = FACTORS.get(scale, "another sampling rate, or another unit")
        return [
            f"no body moves so; one does if the rates, or the times, are {scale:.3g} times as large"
            f" as they should be: {text}?"
        ]
    return []


def _nearest(
    windows: Windows, factor: float, moments: Array, axes: Array, is_turned: bool, weight: float
) -> tuple[float, float]:
    """Return (sum of squares of ln(moment/first guess), what it leaves) of the body that has the
    least of the first and weight times the second; is_turned : whether its axes may turn, too"""
    second = np.maximum(0.5 * moments.sum() - moments, 1e-3 * moments.max())

    def left(x: Array) -> Array:
        values = second * np.exp(np.clip(x[:3], -9.0, 9.0))
        values = values.sum() - values
        turned = Rotation.from_rotvec(x[3:]).as_matrix() @ axes if is_turned else axes
        some = windows.residuals((turned * values) @ turned.T, factor).ravel()
        return np.concatenate([np.sqrt(weight) * some, np.log(values / moments)])

    squares = left(least_squares(left, np.zeros(3 + 3 * is_turned), max_nfev=60).x) ** 2
    return float(squares[-3:].sum()), float(squares[:-3].sum()) / weight
