"""Suspicions: what looks wrong in measurements, told before a fit.

The rates of a free body say more than its moments. With the right rates and times, some body obeys
the balance of angular momentum; times a factor s, none does: rates in degrees are 180/pi times too
large, and times in milliseconds 1,000 times. If axes are swapped or negated, the body of the scene
does not obey the balance, but does with another signed permutation of the axes. (A free
body whose moments are all unknown has two hands: negated rates suit another body.)
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rigidmc.errors import OptionError
from rigidmc.physics.effects import name_of
from rigidmc.scene.scene import Scene
from rigidmc.scene.varied import nominal_of
from rigidmc.studies.fit.records import Record
from rigidmc.studies.fit.starts import WINDOWS, balance
from rigidmc.studies.fit.streams import Array

HELD = 3  # successive readings at the extreme of a channel that are saturation
REPEATED = 0.3  # fraction of readings that equal the one before, if the sensor is slower
RESOLVED = 0.5  # rad between two readings: sums of them are integrals to some percent
TURNED = 2.0  # rad between two readings: the rates then hide most of the motion
MOST_TURNED = 1e6  # rad in a record: 4e6 saves
WINDOW_COUNT = 400  # of all records, in the balance of angular momentum
BETTER = 9.0  # ratio of sums of squares that tells: residuals a third as large
ALIKE = 1.25  # ratio up to which rates may err by what the model leaves out
EXPLAINED = 0.15  # of the changes of the rates that a body may leave, if it moves so
FACTORS = {
    180.0 / np.pi: "rates in degrees, read as radians",
    np.pi / 180.0: "rates in radians, read as degrees",
    1e3: "times in ms, read as s",
    1e-3: "times in s, read as ms",
}
DAMPING = ("viscous_damping", "axial_damping", "matrix_damping", "quadratic_drag", "dry_friction")


class Windows(NamedTuple):
    """The balance of angular momentum over intervals: change + s I^-1 [omega x I omega] is about
    -damping turn.

    change : of the rates (n, 3);  products : integrals of omega_j omega_k dt (n, 3, 3)
    turn : integrals of omega dt (n, 3)
    """

    change: Array
    products: Array
    turn: Array

    def turned(self, axes: Array) -> "Windows":
        """Return the balance in other axes."""
        products = axes @ self.products @ axes.T
        return Windows(self.change @ axes.T, products, self.turn @ axes.T)

    def residuals(self, tensor: Array, factor: float) -> Array:
        """Return what a body with the rates times factor leaves, with the damping that fits."""
        l = np.einsum("nij,jk->nik", self.products, tensor)
        torque = np.stack([l[:, (i + 1) % 3, (i + 2) % 3] - l[:, (i + 2) % 3, (i + 1) % 3]
                           for i in range(3)], axis=1)  # fmt: skip
        left = self.change + factor * torque @ np.linalg.inv(tensor)
        size = float(np.vdot(self.turn, self.turn))
        damping = max(0.0, -float(np.vdot(left, self.turn))) / size if size else 0.0
        return np.asarray(left + damping * self.turn)


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
        if known <= set(DAMPING) and records[0].wheel is None:
            is_turned = any("alignment" in word for word in nuisances)
            notes += _balance(scene, rates, is_turned, between < RESOLVED)
    return records, notes


def _channels(record: Record) -> list[tuple[str, str, int, Array]]:
    """Return (name, observable, column, readings) of the channels of a record."""
    return [
        (f"{name}[{c + 1}]" if x.shape[1] > 1 else name, name, c, x[:, c])
        for name, x in record.values.items()
        for c in range(x.shape[1])
    ]


def _without_saturated(record: Record, notes: list[str]) -> Record:
    """Return a record with nan for readings that stay at the extreme of their channel."""
    values, slow = {name: np.array(x) for name, x in record.values.items()}, set[str]()
    for name, x in values.items():
        same = np.mean((np.diff(x, axis=0) == 0.0).all(1)) if len(x) > 4 else 0.0
        if REPEATED < same < 1.0:
            slow.add(name)
            notes.append(
                f"{record.name}: {name} repeats each reading about {1.0 / (1.0 - same):.2g} times:"
                " its sensor is slower than the table, so its intervals are too narrow"
            )
    for channel, name, column, x in _channels(record):
        t, seen = record.times[name][np.isfinite(x)], x[np.isfinite(x)]
        steps = np.abs(np.diff(seen))
        if not steps.any():
            notes.append(
                f"{record.name}: {channel} reads {seen[0]:g} at all times: a sensor that hangs?"
                if seen.size
                else f"{record.name}: {channel} has no readings"
            )
            continue
        if name in slow:
            continue
        for extreme in (seen.min(), seen.max()):
            for first, last in _runs(seen == extreme):
                beside = steps[[i for i in (first - 1, last - 1) if 0 <= i < steps.size]]
                # the top of a smooth curve has several equal readings, if its steps are as small
                # as the last digit
                if last - first < HELD or beside.max() <= 2.0 * steps[steps > 0.0].min():
                    continue
                inside = (record.times[name] >= t[first]) & (record.times[name] <= t[last - 1])
                values[name][inside & (x == extreme), column] = np.nan
                notes.append(
                    f"{record.name}: {channel} stays at its extreme {extreme:g} in"
                    f" {last - first} readings from {t[first]:g} s on: saturated, left out"
                )
    return record._replace(values=values)


def _runs(is_in: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return (first, end) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], is_in, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _turns(rates: Sequence[tuple[Array, Array]], notes: list[str]) -> float:
    """Return the angle between readings [rad], and tell a large one; OptionError for no run."""
    between, longest = 0.0, 0.0
    for t, w in rates:
        speed = float(np.median(np.linalg.norm(np.nan_to_num(w), axis=1)))
        between = max(between, speed * float(np.median(np.diff(t))))
        longest = max(longest, speed * float(t[-1] - t[0]))
    words = f"the body turns by {between:.3g} rad between two readings"
    asks = "are times in ms, or rates in degrees? State the units"
    if longest > MOST_TURNED:
        raise OptionError(f"{words} and {longest:.3g} rad in a record: {asks}", at="data")
    if between > TURNED:
        notes.append(f"{words}: {asks}")
    return between


def _balance(
    scene: Scene, rates: Sequence[tuple[Array, Array]], is_turned: bool, is_resolved: bool
) -> list[str]:
    """Return what the balance of angular momentum tells of units and axes."""
    windows = _windows(rates)
    moments = np.array(nominal_of(scene.model, ["body.moments"])["body.moments"])
    if windows is None:
        return []
    return _units(windows, rates, moments, is_resolved) or _axes(windows, moments, is_turned)


def _windows(rates: Sequence[tuple[Array, Array]]) -> Windows | None:
    parts = []
    for t, w in rates:
        sound = np.isfinite(w).all(1)
        t, w = t[sound], w[sound]
        if t.size < 2 * WINDOWS:
            continue
        both = [w[:, :, None] * w[:, None, :], w]
        sums = []
        for x in both:
            step = 0.5 * (x[1:] + x[:-1]) * np.diff(t).reshape(-1, *[1] * (x.ndim - 1))
            sums.append(np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(step, axis=0)]))
        width = (t.size - 1) // WINDOWS
        first = np.arange(0, t.size - width, 1 + t.size * len(rates) // WINDOW_COUNT)
        parts.append([x[first + width] - x[first] for x in (w, *sums)])
    if not parts:
        return None
    return Windows(*(np.concatenate(x) for x in zip(*parts, strict=True)))


def _units(
    windows: Windows, rates: Sequence[tuple[Array, Array]], moments: Array, is_resolved: bool
) -> list[str]:
    """Tell rates, or times, that suit a body only if multiplied by a factor."""

    def left(x: Array, factor: float) -> Array:
        second = np.exp(np.clip(np.append(x[3:5], 0.0), -9.0, 9.0))
        axes = Rotation.from_rotvec(x[:3]).as_matrix()
        tensor = (axes * (second.sum() - second)) @ axes.T
        return windows.residuals(tensor, factor * float(np.exp(x[5:].sum()))).ravel()

    best, costs, scale = np.inf, dict[float, float](), 1.0
    for wrong in (1.0, *FACTORS):
        ends = []
        for tensor in np.diag(moments), balance([(t, w / wrong) for t, w in rates], whole=True):
            if tensor is None:
                continue
            values, axes = np.linalg.eigh(tensor)
            second = np.maximum(0.5 * values.sum() - values, 1e-3 * values[-1])
            turn = Rotation.from_matrix(axes * [1.0, 1.0, np.linalg.det(axes)]).as_rotvec()
            x = np.concatenate([turn, np.log(second[:2] / second[2])])
            ends.append(least_squares(left, x, args=(1.0 / wrong,), max_nfev=60))
        end = min(ends, key=lambda one: float(one.cost))
        costs[wrong] = float(end.cost)
        end = least_squares(left, np.append(end.x, 0.0), args=(1.0 / wrong,), max_nfev=60)
        if end.cost < best:
            best, scale = float(end.cost), wrong / float(np.exp(end.x[5]))
    size = windows.change.size * max(float(np.nanmean(w**2)) for _, w in rates)
    if is_resolved and 2.0 * best > EXPLAINED**2 * max(
        float(np.sum(windows.change**2)), EXPLAINED * size
    ):
        return [
            "no free body moves so, with any axes and units: does a torque or a rotor act on it?"
        ]
    # a scale is a pure number, the factor between two units
    if costs[1.0] <= BETTER * best or 1.0 / ALIKE < scale < ALIKE:
        return []
    text = "another sampling rate, or another unit"
    if near := [factor for factor in FACTORS if costs[factor] < 2.0 * best]:
        scale, text = near[0], FACTORS[near[0]]
    return [
        f"no body moves so; one does if the rates, or the times, are {scale:.3g} times as large as"
        f" they should be: {text}?"
    ]


def _axes(windows: Windows, moments: Array, is_turned: bool) -> list[str]:
    """Tell axes, or units, that suit the body of the scene far better.

    is_turned : whether the sensor may have any attitude in the body
    """

    def cost(axes: Array, factor: float) -> float:
        def left(turn: Array) -> Array:
            turned = Rotation.from_rotvec(turn).as_matrix() @ axes
            return windows.turned(turned).residuals(np.diag(moments), factor).ravel()

        if not is_turned:
            return float(np.sum(left(np.zeros(3)) ** 2))
        return 2.0 * float(least_squares(left, np.zeros(3), max_nfev=30).cost)

    signed = {
        tuple(s * (i + 1) for s, i in zip(signs, order, strict=True)): np.array(signs)[:, None]
        * np.eye(3)[list(order)]
        for signs in itertools.product((1, -1), repeat=3)
        for order in itertools.permutations(range(3))
    }
    starts, other = [np.eye(3)], dict[str, tuple[list[Array], float]]()
    if is_turned:  # the signs of two axes change no moment: six turns are all
        right = {tuple(map(abs, k)): x for k, x in signed.items() if np.linalg.det(x) > 0.0}
        starts = list(right.values())
        text = "a left-handed sensor: is one column negated, or are two swapped?"
        other[text] = [-axes for axes in starts], 1.0
    else:
        for name in sorted(signed, key=lambda word: sum(x != i + 1 for i, x in enumerate(word))):
            words = ", ".join(f"{'-' * (x < 0)}omega[{abs(x)}]" for x in name)
            text = (
                f"omega = ({words}): are columns swapped or negated, or moments in another order?"
            )
            other[text] = [signed[name]], 1.0
    other |= {f"{text}?": (starts, 1.0 / factor) for factor, text in FACTORS.items()}
    given = min(cost(axes, 1.0) for axes in starts)
    costs = {text: min(cost(x, factor) for x in some) for text, (some, factor) in other.items()}
    least = min(costs.values())
    if given <= BETTER * least or least > EXPLAINED**2 * float(np.sum(windows.change**2)):
        return []
    best = next(text for text in costs if costs[text] <= 1.0001 * least)
    return [f"the rates suit the moments of the scene far better as {best}"]
