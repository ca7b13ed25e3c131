"""Estimate measures of a finished ensemble under other distributions, by weights of its members.

Members drew numbers x with densities p. In the same scene with other densities p' they have

    w = p'(x)/p(x),   <f>' = sum w f/sum w,   variance sum w^2 (f - <f>')^2/(sum w)^2

and carry as much as (sum w)^2/sum w^2 members of that scene would, Kish's effective size.
Source: Owen, Monte Carlo Theory, Methods and Examples (2013), chapter 9; intervals of quantiles:
Woodruff, J. Am. Stat. Assoc. 47 (1952) 635; index of the tail: Hill, Ann. Stat. 3 (1975) 1163.
"""

from collections.abc import Iterable, Iterator
from copy import copy
from typing import Any

import numpy as np
import xarray as xr
from scipy import special

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, SceneError
from rigidmc.files.outputs import Path
from rigidmc.inputs.arrays import Array
from rigidmc.physics.observables.saving import is_event_time
from rigidmc.planning.initial import Start, initial_block, make_sampler, member_ranges
from rigidmc.planning.steps import make_time_grid
from rigidmc.results.labels import count_text, units_text
from rigidmc.runs.rerun import Pair, open_members, refuse_other_inputs
from rigidmc.scene.distributions import Common, Distribution, joint_log_density
from rigidmc.scene.sampling import named_values
from rigidmc.scene.scene import Scene, as_scene, scene_of
from rigidmc.scene.vector_distributions.bodies import TensorDistribution
from rigidmc.scene.vector_distributions.ensembles import GibbsMomentum
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, flat_parameters
from rigidmc.scene.vector_distributions.vectors import Correlated, parts_of
from rigidmc.statistics import censored
from rigidmc.statistics.estimates import why_no_interval
from rigidmc.statistics.intervals import Interval, half_of_mean, probability
from rigidmc.statistics.measures import Measure, measure
from rigidmc.studies.framework.variables import StudyVariable, describe, interval_of, make_dataset
from rigidmc.studies.gradient.study import with_ends
from rigidmc.views.summary import quantity_rows

LEAST = 100.0  # effective size below which there is no estimate
# index of the tail of the weights above which few members decide: 95 % intervals cover 93 % at 0.47
# and 89 % at 0.61 (tests/studies/test_reweight.py)
TAIL = 0.5
# probabilities at which numbers of the new scene must be where the old density is not 0
PROBABILITIES = np.array([1e-9, *(np.arange(1000) + 0.5) / 1000.0, 1.0 - 1e-9])
RUN = "run a new ensemble of the scene"
VARIABLES = (
    StudyVariable("weight", "member", "1", "weight of the member"),
    StudyVariable("estimate", "distribution measure", "", "the measure", has_interval=True),
    StudyVariable("standard_error", "distribution measure", "", "its standard error"),
    StudyVariable("share", "distribution status", "1", "fraction of the members"),
)


def reweight(
    result: Path | xr.Dataset,
    scene: Scene | Path,
    of: str | Iterable[str] = (),
    confidence: float = 0.95,
    allow_code: bool = False,
) -> xr.Dataset:
    """Estimate measures of a finished ensemble under other distributions, without a new run.

    Each member has the weight p'(x)/p(x) of the numbers x that it drew, with the densities p of the
    result and p' of the scene.

    Parameters
    ----------
    result : path_like or xarray.Dataset
        a result: a file (.nc, .zarr), a run directory or a Dataset
    scene : Scene or path_like
        the scene of the result with other distributions. Run settings that it states must be equal
        if they move members
    of : str or sequence of str, optional
        measures, such as "p(flips >= 1)"; by default the means and medians of all results of a
        member and of its last state
    confidence : float, optional
        confidence level of the intervals
    allow_code : bool, optional
        as in `Scene.load`; not needed for a result that was opened with it

    Returns
    -------
    xarray.Dataset
        `weight` (member), whose sum is 1; `estimate` (distribution, measure), with `estimate_low`
        and `estimate_high`, and its `standard_error`, for the distributions "old" and "new";
        `share` (distribution, status). The attribute `effective_size` is the number of members of
        the new scene that carry as much, `tail` the index of the tail of the weights

    Raises
    ------
    SceneError
        for a scene that differs in anything but distributions with a density, for distributions
        that reach where the result has no members, and for an effective size below 100
    OptionError
        for a measure that the result lacks, and for a correlation

    Examples
    --------
    A disc spins with omega drawn from N(1, 0.1^2), and turns out to be faster by 0.1:

    >>> disc = rm.Scene(rm.Body((1, 1, 2)), start=rm.Start(omega=(0, 0, rm.normal(1.0, 0.1))))
    >>> ds = rm.simulate(disc, t_end=1.0, members=2000)
    >>> new = rm.Scene(rm.Body((1, 1, 2)), start=rm.Start(omega=(0, 0, rm.normal(1.1, 0.1))))
    >>> rm.reweight(ds, new, "mean(omega_final[3])").estimate.values.round(1).tolist()
    [[1.0], [1.1]]
    """
    if not isinstance(result, xr.Dataset):
        with open_members(result, allow_code) as members:
            return reweight(members, scene, of, confidence, allow_code)
    if "member" not in result.coords:
        rule = "expected a result with members: a map or a study stores none"
        raise OptionError(rule, at="result")
    old, new = scene_of(result, allow_code=allow_code), as_scene(scene)
    logs, status = _log_weights(result, old, new), result.status.values.astype(int)
    weight = np.exp(logs - logs.max()) if np.isfinite(logs.max()) else np.zeros(logs.size)
    if not (effective := _effective(weight[status == 0])) >= LEAST:
        rule = f"the result carries as much as {effective:.3g} members of this scene, fewer than"
        raise SceneError(f"{rule} {LEAST:g}: no estimate is reliable, so {RUN}", at="scene")
    ended, both = with_ends(result), np.stack([np.ones(weight.size), weight])
    texts = [of] if isinstance(of, str) else list(of) or _measures(ended, old)
    asked = [measure(text, ended.data_vars, may_save_more=False) for text in texts]
    found = np.array([_estimates(ended, one, both, confidence) for one in asked]).swapaxes(0, 1)
    if not of:  # without results that no member has
        known = np.isfinite(found[0, :, 0])
        asked, found = [asked[i] for i in np.flatnonzero(known)], found[:, known]
    if unknown := why_no_interval(result):
        found[..., 1:] = np.nan
    values = {
        "weight": weight / weight.sum(),
        "estimate": Interval(*np.moveaxis(found[..., :3], -1, 0)),
        "standard_error": found[..., 3],
        "share": np.stack([np.bincount(status, by, len(STATUSES)) / by.sum() for by in both]),
    }
    coordinates = {
        "member": result.member.values,
        "distribution": ["old", "new"],
        "measure": [one.text for one in asked],
        "unit": ("measure", [one.units(ended.data_vars) for one in asked]),
        "status": list(STATUSES),
    }
    ranked = np.sort(logs[np.isfinite(logs)])[::-1]
    most = int(min(0.2 * ranked.size, 3.0 * np.sqrt(ranked.size)))
    tail = float(ranked[:most].mean() - ranked[most])
    attrs = {"effective_size": effective, "tail": tail, "confidence": confidence, "why": unknown}
    return describe(make_dataset(VARIABLES, values, coordinates, attrs), new)


def _measures(result: xr.Dataset, scene: Scene) -> list[str]:
    """Return measures of the results of a member and of its last state, but not of its inputs."""
    inputs = initial_block(scene.model, 0, 0, 1)[1]
    return [
        f"{kind}({label})"
        for label, (name, part) in quantity_rows(result).items()
        if name not in inputs and (part is None or result[name].dims[0] == "axis")
        for kind in ("mean", "median")
        if kind == "median" or not is_event_time(name, result[name].attrs)
    ]


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, members = study.attrs, count_text(study.sizes["member"], "member")
    lines = [f"{a['title']}: {members}, as good as {a['effective_size']:,.4g} new ones"]
    if a["tail"] > TAIL:
        lines.append(
            f"  a few members decide (tail index {a['tail']:.2g}, above {TAIL}): intervals are too"
            f" narrow; {RUN}"
        )
    for text, unit in zip(study.measure.values, study.unit.values, strict=True):
        each = [
            interval_of(study.sel(measure=text, distribution=x), "estimate") for x in ("old", "new")
        ]
        old, new = ("{:.5g} ({:.4g} to {:.4g})".format(*x) for x in each)
        lines.append(f"  {text:28s} {old:>32s} -> {new} {units_text(unit)}".rstrip())
    for name in study.status.values[1:][study.share.values.any(0)[1:]]:
        old, new = (f"{100.0 * float(x):.3g} %" for x in study.share.sel(status=name))
        lines.append(f"  members flagged {name}: {old} -> {new}")
    return [*lines, *([f"  {a['why']}"] if a["why"] else [])]


def _log_weights(result: xr.Dataset, old: Scene, new: Scene) -> Array:
    """Return the logarithms of the weights of members, up to a constant. Their numbers follow from
    scene and seed, so the result need not have them."""
    model = old.model.mapped(_heard)
    before, after = _changes(old.with_model(model), new)
    sampler, parts, done = make_sampler(old.model, old.run), list[Array](), 0
    for low, columns, count in member_ranges(result.member.values):
        start = initial_block(model, sampler, low, count)[1]
        part = result.isel(member=slice(done, done := done + columns.size))
        for key in start.keys() & set(part.data_vars):
            stored = part[key].transpose(..., "member").values
            pair = Pair(key, start[key][..., columns], stored, None)
            refuse_other_inputs(pair, part.member.values, "the result")
        numbers = {at: _drawn(at, law, start) for at, law in before.items()}
        ratio = _log_density(after, numbers, start) - _log_density(before, numbers, start)
        parts.append(ratio[columns])
    return np.concatenate(parts)


def _heard(quantity: Any) -> Any:
    """Return a copy of a distribution that keeps the numbers that members drew, as `heard`."""
    if not isinstance(quantity, Distribution):
        return quantity
    law = copy(quantity)

    def of_words(words: Array, own: int) -> Array:
        object.__setattr__(law, "heard", numbers := quantity.of_words(words, own))
        return numbers

    object.__setattr__(law, "of_words", of_words)
    return law


def _drawn(at: str, law: Any, start: Start) -> Array:
    """Return the numbers (n,), vectors (3, n) or attitudes (4, n) that members drew."""
    if hasattr(law, "heard"):
        return np.asarray(law.heard)
    table, key, *row = at.split(".")
    x = start[f"start_{key}" if table == "start" else key]
    return x[int(row[0]) - 1] if row else x


def _log_density(laws: dict[str, Any], numbers: dict[str, Array], start: Start) -> Array:
    """Return the logarithms of the joint density (n,) of what members drew."""
    total, together = np.zeros(start["mass"].size), dict[str, list[tuple[Any, Array]]]()
    for at, law in laws.items():
        if isinstance(law, Common):
            vector = law.stream or at.rpartition(".")[0]
            together.setdefault(vector, []).append((law, numbers[at]))
        elif isinstance(law, Distribution):
            total += law.log_density(numbers[at])
        elif law != "uniform":
            total += law.log_density(numbers[at], start["moments"])
    return total + sum(joint_log_density(*zip(*some, strict=True)) for some in together.values())


def _changes(old: Scene, new: Scene) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the distributions, old and new, in which a scene differs, with those correlated with
    them; SceneError for other differences, and for a new distribution that reaches farther."""
    _refuse_other_motion(old, new)
    before, after = (
        {at: law for slot in named_values(scene.model) for at, law in _parts(*slot)}
        for scene in (old, new)
    )
    for at in before.keys() ^ after.keys():
        where = "the result" if at in before else "this scene"
        raise SceneError(f"is only in {where}: only distributions may differ", at=at)
    differ = {at for at, law in before.items() if not np.array_equal(law, after[at])}
    common = {at for laws in (before, after) for at, law in laws.items() if isinstance(law, Common)}
    differ |= common if differ & common else set()
    paths = [at for at in before if at in differ]
    for at in paths:
        a, b = before[at], after[at]
        are_numbers = isinstance(a, Distribution) and isinstance(b, Distribution)
        are_vectors = all(isinstance(x, VectorDistribution) or str(x) == "uniform" for x in (a, b))
        is_kept = hasattr(a, "heard") or not _is_transformed(old, at, a, b)
        if not (are_numbers or are_vectors) or not is_kept:
            raise SceneError(f"differs, and has no density by which to weigh: {RUN}", at=at)
        if are_numbers and np.isneginf(a.log_density(b.ppf(PROBABILITIES))).any():
            raise SceneError(f"reaches where the result has no members: {RUN}", at=at)
    return {at: before[at] for at in paths}, {at: after[at] for at in paths}


def _parts(at: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield (path, part) of the numbers and distributions of a quantity, and of vectors that have a
    density for given numbers."""
    value = parts_of(value) if isinstance(value, Correlated) else value
    if isinstance(value, VectorDistribution):
        is_drawn = any(isinstance(part, Distribution) for part in flat_parameters(value))
        if is_drawn or type(value).log_density is VectorDistribution.log_density:
            yield at, value.name
            for key, part in value.as_dict().items():
                yield from _parts(f"{at}.{key}", part)
            return
    elif isinstance(value, tuple):
        for i, part in enumerate(value):
            yield from _parts(f"{at}.{i + 1}", part)
        return
    yield at, value


def _is_transformed(scene: Scene, at: str, *laws: Any) -> bool:
    """Return whether sampled values are not those drawn, or whether they decide on attitudes."""
    start, body = scene.start, scene.body
    turned = isinstance(body.moments, TensorDistribution) and body.frame == "principal"
    if any(isinstance(law, GibbsMomentum) for law in laws):
        turned |= body.is_turned or start.attitude == "ensemble"
    return turned or at.split(".")[1] in start.relative_to_orbit


def _refuse_other_motion(old: Scene, new: Scene) -> None:
    """Raise SceneError for axes, conventions and stated settings that move members differently."""
    run, stated = old.run, new.run.model_fields_set
    names = ["t_end", "integrator", "turn", "dt", "dtype", "compensated"]
    names = names[:1] if new.run.integrator == "auto" else names  # it chooses the others
    names = [name for name in names if name in stated or (name == "turn" and "dt" in stated)]
    own = {"body": ("axes", "frame"), "start": ("sequence", "relative_to_orbit"), "run": names}
    for table, name in [(table, name) for table, names in own.items() for name in names]:
        a, b = (getattr(getattr(scene, table), name) for scene in (old, new))
        if name == "dt" and run.turn is None:  # a run shortens it to fit the time between saves
            fits = abs(make_time_grid(run.t_end, b, run.every).dt / a - 1.0) < 1e-9
            b = a if fits or run.integrator == "closed" else b
        if a != b:
            rule = f"is {a} in the result and {b} in this scene: set it to {a}, or {RUN}"
            raise SceneError(rule, at=f"{table}.{name}")


def _effective(weight: Array) -> float:
    """Return Kish's effective size of weights; 0 without any."""
    squares = float(np.square(weight).sum())
    return float(weight.sum()) ** 2 / squares if squares else 0.0


def _estimates(
    result: xr.Dataset, asked: Measure, weights: Array, confidence: float
) -> list[tuple[float, ...]]:
    """Return (estimate, ends of its interval, standard error) of a measure for each row of weights
    (rows, n)."""
    if asked.kind == "correlation":
        raise OptionError("a correlation has no estimate by weights", at="of", value=asked.text)
    if asked.kind == "quantile" and asked.result.timed:
        times = np.where(asked.asks(result), asked.values(result), np.nan)
        numbers = np.where(censored.is_censored(times), np.inf, times)
    else:
        numbers = asked.numbers(result)
    some = np.flatnonzero(~np.isnan(numbers))
    if asked.kind == "quantile":
        some = some[np.argsort(numbers[some])]
    return [_estimate(asked, numbers[some], w[some], confidence) for w in weights]


def _estimate(asked: Measure, y: Array, w: Array, confidence: float) -> tuple[float, ...]:
    """Return `_estimates` from known numbers and their weights, sorted for a quantile."""
    if not w.any():
        return (np.nan,) * 4
    w = w / w.sum()
    if asked.kind == "quantile":
        below, q = np.cumsum(w), asked.number
        z = special.ndtri(0.5 + 0.5 * confidence)
        half = z * np.sqrt(np.square(w * ((below <= q) - q)).sum())
        ranks = np.searchsorted(below, [q, q - half, q + half])
        value, low, high = y[np.minimum(ranks, y.size - 1)]
        return value, low, high, (high - low) / (2.0 * z) if np.isfinite(high) else np.nan
    value, count = float(w @ y), _effective(w)
    error = float(np.sqrt(np.square(w * (y - value)).sum()))
    if asked.kind == "p":
        trials = value * (1.0 - value) / error**2 if error > 0.0 else count
        return (*map(float, probability(value * trials, trials, confidence)), error)
    half = half_of_mean(error**2 * count, count, confidence)
    return value, value - half, value + half, error
