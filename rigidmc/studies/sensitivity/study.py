"""Find the uncertain parameters of a scene on which a measure depends, by Sobol indices.

With X_k one of d independent uncertain parameters and Y the measured quantity of a member::

    first_k = Var(E(Y | X_k)) / Var(Y),   total_k = 1 - Var(E(Y | all X but X_k)) / Var(Y)

The first index is the fraction of the variance that X_k causes alone; the total index is the
fraction that it causes alone and together with others. Both are estimated from families of d + 2
members, see `rigidmc.scene.sampling.Saltelli`, with a and b the first two values of a family and
c_k that of member 2 + k::

    first_k = <b (c_k - a)> / V,   total_k = <(a - c_k)^2> / (2 V),   V = <a^2 + b^2> / 2

Here the mean is subtracted from a, b and c_k. Control variates whose means are known to be 0,
<a b>, <b^2 - a^2> and <c_j^2 - a^2>, correct each of these means and reduce the errors of large
indices to a seventh. The intervals are Fieller's for ratios of two means, with jackknife errors;
95 % intervals cover the index in 93.5 to 95.8 % of studies with 512 families or more
(`python -m bench coverage`). The noise of random effects counts as one more uncertain parameter; it
contributes to every total index.

With `bounds`, members also have derivatives by the uncertain parameters, and each total index has
an upper bound from the mean of their squares, see `rigidmc.studies.sensitivity.bounds`.
Source: Saltelli et al., Comput. Phys. Commun. 181 (2010) 259, table 2 (b) and (f); Lavenberg &
Welch, Manage. Sci. 27 (1981) 322; MacKinnon & White, J. Econometrics 29 (1985) 305; Fieller,
J. R. Stat. Soc. B 16 (1954) 175.

{parameters}

{returns}

Raises
------
OptionError
    for measures that are not means, or that the scene does not have; with `bounds`, for measures
    without derivatives
SceneError
    if nothing in the scene is drawn

Examples
--------
A constant torque N about axis 3 turns a disc for 2 s; its mean spin is omega + N/I:

>>> torque = rm.BodyTorque((0.0, 0.0, rm.normal(0.0, 0.4)))
>>> start = rm.Start(omega=(0.0, 0.0, rm.normal(1.0, 0.6)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), torque, start)
>>> study = rm.sensitivity(scene, "mean(omega_mean[3])", 2000, t_end=2.0, dt=0.1)
>>> study.number.values.tolist()
['effects.body_torque.size.3', 'start.omega.3']
>>> bool(study.total[0, 1] > study.total[0, 0])  # fractions 0.9 and 0.1
True
"""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.results.labels import count_text
from rigidmc.results.variables import variables_of
from rigidmc.scene.scene import Scene
from rigidmc.statistics.intervals import Interval, is_constant, resolution_of
from rigidmc.statistics.measures import Measure, Variables, measure
from rigidmc.studies.framework.members import TUNING, Batches, Members, drawn_families
from rigidmc.studies.framework.options import REQUIRED, Options, Words, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, interval_of, make_dataset
from rigidmc.studies.sensitivity.bounds import constants, squared_rates, with_derivatives

FEW = 10  # least number of families that differ, and of families for each control variate
KINDS = ("p", "mean")  # measures that are means over members
VARIABLES = (
    StudyVariable(
        "first", "measure number", "1", "fraction of the variance that the parameter causes alone",
        has_interval=True,
    ),
    StudyVariable(
        "total", "measure number", "1",
        "fraction of the variance that the parameter causes alone and with others",
        has_interval=True,
    ),
    StudyVariable("mean", "measure", "", "the measure, in its units"),
    StudyVariable("variance", "measure", "", "its variance over members, in its units squared"),
    StudyVariable("differing", "measure", "1", "counted families whose members differ"),
    StudyVariable(
        "families", "measure", "1", "families counted",
        "those in which every member is ok and has a value",
    ),
    StudyVariable(
        "bound", "measure number", "1", "upper bound of the total index, from derivatives",
        "only with `bounds`", has_interval=True,
    ),
)  # fmt: skip


class SensitivityOptions(Options):
    """The options of `sensitivity`."""

    of: Words = option(
        REQUIRED,
        'measure, such as "mean(nutation_max)" or "p(flips >= 1)"; may be repeated',
        more="means and probabilities",
        metavar="MEASURE",
    )
    families: int = option(
        4096,
        "number of families; with d uncertain parameters, a family has d + 2 members",
        is_new=True,
    )
    confidence: float = confidence_option("confidence level of the intervals")
    bounds: bool = option(False, "also upper bounds of the total indices, from derivatives")


def scene_of_families(
    scene: Scene, options: SensitivityOptions, settings: Mapping[str, Any]
) -> Scene:
    """Return the scene with the members of the study; OptionError for measures that are not means,
    SceneError if nothing is drawn."""
    scene = drawn_families(scene, options.of, "saltelli", options.families)
    measures = [_mean_of(text, variables_of(scene)) for text in options.of]
    return with_derivatives(scene, measures) if options.bounds else scene


def indices(
    values: Array, confidence: float = 0.95, controls: bool = True, resolved: float | None = None
) -> tuple[Interval, Interval]:
    """Return (first, total): the Sobol indices of d parameters as Intervals of arrays (d,).

    The indices are nan if fewer than FEW families have members that differ. Values differ seldom if
    n < FEW k^2, with n families and k = <y^4>/<y^2>^2 (1/p for a small probability p). Then no
    control variates are used, because <a b> is the mean of few pairs in which both differ, or of
    none; and the interval of the first index is widened for unseen cases, by
    -ln((1 - confidence)/2) of the largest products, as in the rule of three.

    values : (families, d + 2), see `sensitivity`; families with a nan are left out
    controls : whether control variates correct the means
    resolved : as in `rigidmc.statistics.intervals.is_constant`
    """
    y = values[np.isfinite(values).all(axis=1)]
    if count_differing(values, resolved) < FEW:
        none = Interval(*np.full((3, values.shape[1] - 2), np.nan))
        return none, none
    with np.errstate(all="ignore"):
        y = y - y[:, :2].mean()
        a, b, c = y[:, :1], y[:, 1:2], y[:, 2:]
        zero = np.concatenate([a * b, b * b - a * a, c * c - a * a], axis=1)
        n, squares = y.shape[0], y[:, :2] ** 2
        seldom = n < FEW * (squares**2).mean() ** 2 / squares.mean() ** 4
        if not controls or seldom or n < FEW * zero.shape[1]:
            zero = zero[:, :0]
        size = 0.5 * (a * a + b * b)
        alone = _means(np.concatenate([size, b * (c - a)], axis=1), zero)
        shared = _means(np.concatenate([size, 0.5 * (a - c) ** 2], axis=1), zero)
        factor = stats.t.ppf(0.5 + 0.5 * confidence, max(n - 1 - zero.shape[1], 1)) ** 2
        first, total = _ratios(*alone, factor), _ratios(*shared, factor)
        unseen = -np.log(0.5 - 0.5 * confidence) * squares.max() / (n * squares.mean())
        if seldom:
            first = Interval(first.value, first.low - unseen, first.high + unseen)
        return first, total


def bounds_of(
    values: Array, squares: Array, factors: Array, confidence: float = 0.95,
    resolved: float | None = None,
) -> Interval:  # fmt: skip
    """Return upper bounds of the total indices of k parameters as an Interval of arrays (k,), nan
    as in `indices`.

    values : (families, d + 2)
    squares : squared derivatives by the parameters (k, families, d + 2)
    factors : Poincare constants (k,)
    """
    there = np.isfinite(values).all(axis=1)
    if count_differing(values, resolved) < FEW:
        return Interval(*np.full((3, len(factors)), np.nan))
    y = values[there, :2]
    size = 0.5 * ((y - y.mean()) ** 2).sum(axis=1)
    above = factors * squares[:, there].mean(axis=2).T
    means, errors = _means(np.column_stack([size, above]), np.empty((size.size, 0)))
    return _ratios(means, errors, stats.t.ppf(0.5 + 0.5 * confidence, size.size - 1) ** 2)


def count_differing(values: Array, resolved: float | None = None) -> int:
    """Return the number of families whose members differ by more than rounding; see `indices`."""
    y = values[np.isfinite(values).all(axis=1)]
    return int((~is_constant(y, resolved=resolved)).sum())


def _means(x: Array, zero: Array) -> tuple[Array, Array]:
    """Return (means of the columns of `x`, covariance of their errors), after a least-squares fit
    to the control variates, the columns of `zero`, whose means are known to be 0.

    The covariance is the jackknife's, from leaving out one row at a time. That of a normal
    distribution is too small for skewed rows.

    Source: Lavenberg & Welch, Manage. Sci. 27 (1981) 322; MacKinnon & White, J. Econometrics 29
    (1985) 305.
    """
    z = np.insert(zero, 0, 1.0, axis=1)
    inverse = np.linalg.pinv(z.T @ z)
    slopes = inverse @ (z.T @ x)
    pull = ((z @ inverse) * z).sum(axis=1)  # leverage of each row
    errors = (x - z @ slopes) * ((z @ inverse[0]) / (1.0 - pull))[:, None]
    n = x.shape[0]
    return slopes[0], (n - 1) / n * (errors.T @ errors)


def _ratios(means: Array, errors: Array, factor: float) -> Interval:
    """Return the ratios of all means to the first, with Fieller's intervals: the ratios theta for
    which Student's test accepts mean - theta first = 0. Ends are nan if this set is unbounded.

    factor : Student's quantile, squared
    Source: Fieller, J. R. Stat. Soc. B 16 (1954) 175.
    """
    size, value = means[0], means[1:] / means[0]
    known = size**2 - factor * errors[0, 0]
    known = np.where(known > 0.0, known, np.nan)
    # the set is value + shift +- half, where `half` exceeds |shift| after rounding, too
    shift = factor * (value * errors[0, 0] - errors[0, 1:]) / known
    spread = np.diag(errors)[1:] - 2.0 * value * errors[0, 1:] + value**2 * errors[0, 0]
    half = np.hypot(shift, np.sqrt(factor * np.maximum(spread, 0.0) / known))
    return Interval(value, value + (shift - half), value + (shift + half))


def _mean_of(text: str, variables: Variables, may_save_more: bool = True) -> Measure:
    """Return the Measure of a text; OptionError unless it is a mean over members."""
    asked = measure(text, variables, may_save_more)
    if asked.kind not in KINDS:
        rule = "is not a mean over members: use mean(NAME) or p(NAME >= NUMBER)"
        raise OptionError(rule, at="of", value=text)
    return asked


def _numbers(part: xr.Dataset, measures: Sequence[Measure], by: Sequence[str]) -> Array:
    """Return the value of each measure, and its squared derivatives by some parameters, of members
    (measures, 1 + parameters, members); nan for flagged members."""
    values = np.stack([measure.numbers(part) for measure in measures])[:, None]
    if not by:
        return values
    rates = [squared_rates(part, measure, by) for measure in measures]
    return np.concatenate([values, rates], axis=1)


def reduce(batches: Batches, options: SensitivityOptions) -> xr.Dataset:
    """Return the Dataset of the study of members. Incomplete families of an unfinished run are left
    out."""
    saved, is_new = batches.variables, batches.stored is None
    measures = [_mean_of(text, saved, is_new) for text in options.of]
    names = uncertain_numbers(batches.scene.model)[0]
    by = constants(batches.scene.model) if options.bounds else {}
    parts = [(part.member.values, _numbers(part, measures, tuple(by))) for part in batches.results]
    size, last = 2 + len(names), max(int(members.max()) for members, _ in parts)
    shape = len(measures), 1 + len(by), last // size + 1, size
    numbers = np.full(shape, np.nan)
    for members, values in parts:
        numbers.reshape(*shape[:2], -1)[..., members] = values
    resolved, confidence = resolution_of(batches.scene.run), options.confidence
    values = numbers[:, 0]
    pairs = [indices(families, confidence, resolved=resolved) for families in values]
    counts = np.logical_and.reduce(np.isfinite(values), axis=2)
    kept = [families[there][:, :2] for families, there in zip(values, counts, strict=True)]
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        means, variances = ([f(families) for families in kept] for f in (np.mean, np.var))
    arrays = {
        "first": np.stack([first for first, _ in pairs], axis=1),
        "total": np.stack([total for _, total in pairs], axis=1),
        "mean": means,
        "variance": variances,
        "differing": [count_differing(families, resolved) for families in values],
        "families": counts.sum(axis=1),
    }
    if options.bounds:
        factors, rows = np.array(list(by.values())), [names.index(name) for name in by]
        arrays["bound"] = np.full((3, len(measures), len(names)), np.nan)
        for i, (families, *squares) in enumerate(numbers):
            ends = bounds_of(families, np.array(squares), factors, confidence, resolved)
            arrays["bound"][:, i, rows] = ends
    attrs = {
        "confidence": confidence,
        "members": values[0].size,
        "left_out": int((~counts).sum(axis=1).max()),
    }
    coordinates = {
        "measure": [measure.text for measure in measures],
        "number": names,
        "units": ("measure", [measure.units(saved) for measure in measures]),
    }
    return make_dataset(VARIABLES[: len(arrays)], arrays, coordinates, attrs)


def _shares(indices: xr.Dataset) -> list[str]:
    """Return the indices of a measure as lines of text, the largest first."""
    if indices.differing < FEW:
        differing = count_text(int(indices.differing), "family")
        often = f"in {differing}" if indices.differing else "in no family"
        return [
            f"  members differ by more than rounding {often}; indices require {FEW}: add families,"
            " or use a quantity that differs more often"
        ]
    heads = {"first": "alone", "total": "with others"}
    if "bound" in indices:
        heads["bound"] = "at most"
    lines = [f"  {'':32s} {' '.join(f'{head:>22s}' for head in heads.values())}"]
    for i in np.argsort(-indices.total.values, kind="stable"):
        row = indices.isel(number=i)
        cells = " ".join(f"{_cell(interval_of(row, name)):>22s}" for name in heads)
        lines.append(f"  {row.number.item()!s:32s} {cells}")
    if (indices["first"] > indices["total"]).any():
        lines.append("  a fraction alone above that with others is sampling noise: add families")
    return lines


def _cell(index: Interval) -> str:
    """Return an index with its interval as text; "-" for a bound that is not known."""
    if index.value != index.value:
        return "-"
    return f"{index.value:.3f} ({index.low:.3f} to {index.high:.3f})".replace("-0.000", "0.000")


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text, the most important parameter first."""
    lines = [study.attrs["title"]]
    for text in study.measure.values:
        row = study.sel(measure=text)
        families = count_text(int(row.families), "family")
        members = f"{families} of {2 + study.sizes['number']} members"
        if not row.families:
            lines.append(f"  {text}: no family has a value")
            continue
        lines.append(f"  {text} = {float(row['mean']):.6g}, {members}")
        lines += _shares(row)
    if left := study.attrs["left_out"]:
        lines.append(f"  families with a member that is flagged or has no value: {left:,}")
    return lines


sensitivity = Study(
    name="sensitivity",
    text=__doc__,
    options=SensitivityOptions,
    work=Members(scene_of_families, reduce, batch=2**17, points="saltelli"),
    table=table,
    variables=VARIABLES,
    picture="sensitivity_bars",
    settings=TUNING,
    scene_text="a scene, its file, or the name of a shipped scene; its distributions are the"
    " uncertain parameters",
    example=Example("dzhanibekov", {"of": "mean(omega_max[1])", "families": 16}, {"t_end": 4.0}),
)
