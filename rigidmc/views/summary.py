"""Summarise a result in a few lines: flagged members, and statistics with their intervals."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError
from rigidmc.files.reading import toml
from rigidmc.inputs.arrays import Ints
from rigidmc.physics.observables.saving import is_event_time
from rigidmc.results.labels import count_text, units_text
from rigidmc.scene.drifts import LAWS, one_way
from rigidmc.scene.toml.read import scene_text
from rigidmc.statistics import censored, intervals
from rigidmc.statistics.estimates import estimate, why_no_interval
from rigidmc.statistics.spread import Row, Spread, spreads

QUANTILES = (0.05, 0.5, 0.95)
# not in the summary
_PLAIN = ("status", "status_step", "status_time", "drift_law", "mass", "steps", "followed_until")


def summary_text(
    dataset: xr.Dataset, confidence: float = 0.95, of: str | Iterable[str] = ()
) -> str:
    """Summarise a result of `rigidmc.simulate` as text.

    of : measures to report instead, such as "p(flips >= 1)", see `rigidmc.statistics.measures`

    The summary lists the flagged members. For each quantity with one value per member, it shows the
    mean with its confidence interval, the median, the middle 90 %, and the number of members
    without a value. For an event that has not occurred in all members, it shows the median time
    with its interval; the median may be beyond the end. Derivatives are only named.
    """
    settings = toml(scene_text(dataset))["run"]
    unknown = why_no_interval(dataset)
    texts = (of,) if isinstance(of, str) else tuple(of)
    rows = {} if texts else quantity_rows(dataset)
    codes = [name for name in ("status", "drift_law") if name in dataset]
    counted, spread_of = spreads(dataset, list(rows.values()), QUANTILES, codes)
    lines = [_heading(dataset, settings["members"]), _flagged(counted["status"])]
    if "drift_law" in counted:
        drifts = one_way(dataset, drifting=int(counted["drift_law"][LAWS["one_way"]]))
        lines += [f"  {drifts}"] if drifts else []
    lines += [_measured(dataset, text, confidence) for text in texts]
    sure = None if unknown else confidence
    for (label, row), spread in zip(rows.items(), spread_of, strict=True):
        attrs = dataset[row.name].attrs
        if is_event_time(label, attrs) and spread.unknown:  # it has not occurred in some members
            line: str | None = _time(dataset, label, sure)
        else:
            line = _line(label, attrs, spread, sure)
        lines += [line] if line else []
    if unknown:
        lines.append(f"  {unknown}")
    if texts:
        return "\n".join(lines)
    saved = [str(name) for name, v in dataset.data_vars.items() if "time" in v.dims]
    times = count_text(dataset.sizes["time"], "save time")
    lines.append(f"  {times}: {', '.join(saved) or 'no variables'}")
    if thinned := [str(name) for name, v in dataset.data_vars.items() if "thinned_time" in v.dims]:
        lines.append(f"  and at {dataset.sizes['thinned_time']:,}: {', '.join(thinned)}")
    if "parameter" in dataset.coords:
        lines.append(f"  derivatives, d_NAME, by {', '.join(map(str, dataset.parameter.values))}")
    return "\n".join(lines)


def _heading(dataset: xr.Dataset, planned: int) -> str:
    """Return title, members, end, integrator and step."""
    attrs, count = dataset.attrs, dataset.sizes["member"]
    step = f"turn = {attrs.get('turn', float('nan')):.6g} rad"
    step = f"dt = {attrs['dt']:.6g} s" if "dt" in attrs else step
    part = f"{count:,} of " if count < planned else ""
    members = part + count_text(max(count, planned), "member")
    end = f"{float(dataset.time.values[-1]):g} s"
    return f"{attrs.get('title', 'result')}: {members} to {end} with {attrs['integrator']}, {step}"


def _measured(dataset: xr.Dataset, text: str, confidence: float) -> str:
    """Return a line on a measure of the good members; OptionError if the result lacks it."""
    try:
        return f"  {text}: {estimate(dataset, text, confidence).words(confidence)}"
    except OptionError as error:
        error.at = "of"
        raise


def _flagged(counts: Ints) -> str:
    """Return a line on the number of flagged members and the reasons; counts : of each status."""
    flags = [f"{counts[i]:,} {word}" for word, i in STATUSES.items() if i and counts[i]]
    if not flags:
        return "  flagged: none"
    return f"  flagged: {', '.join(flags)}; excluded below"


def quantity_rows(dataset: xr.Dataset) -> dict[str, Row]:
    """Return {label: Row} of each quantity per member for the summary."""
    rows = {}
    for name, variable in dataset.data_vars.items():
        over = set(variable.dims)
        if {"time", "thinned_time", "parameter"} & over or "member" not in over:
            continue
        if name in _PLAIN or str(name).startswith("start_"):
            continue
        if variable.ndim == 1:
            rows[str(name)] = Row(str(name))
        else:
            more = {f"{name}[{i + 1}]": Row(str(name), i) for i in range(variable.shape[0])}
            rows |= more
    return rows


def _time(dataset: xr.Dataset, name: str, confidence: float | None) -> str:
    """Return a line on the time of an event that has not occurred in all members."""
    times = censored.signed_times(dataset, name, dataset[name].values)
    there = times[~np.isnan(times)]
    none, count = int(censored.is_censored(there).sum()), there.size
    low, middle, high = (
        censored.censored_quantile(there, q, confidence or 0.95).each(float)
        for q in (0.05, 0.5, 0.95)
    )
    left = f"by {middle.until:.6g} s for {none:,} of {count_text(count, 'member')}"
    if none == count:
        return f"  {name:24s} not {left}"
    words = (
        f"beyond {x.until:.4g}" if np.isposinf(x.value) else f"{x.value:.4g}" for x in (low, high)
    )
    median = middle.words(confidence or 0.95).split(";")[0]
    if confidence is None:
        median = median.split(",")[0]
    spread = "90 % in {} to {} s".format(*words)
    return f"  {name:24s} median {median}, {spread}; not {left}"


def _line(label: str, attrs: dict[str, Any], of: Spread, confidence: float | None) -> str | None:
    """Return a line on one quantity of the good members, None if it is not worth a line.

    confidence : None if the spread of the members gives no interval
    """
    units, all_members = units_text(attrs.get("units", "1")), count_text(of.members, "member")
    if not of.finite:  # also if every member is flagged
        is_input = label.startswith("moments")
        return None if is_input else f"  {label:24s} no value in any of {all_members}"
    if of.finite == of.members and of.is_constant:
        if label.startswith("moments"):
            return None
        every = "" if of.finite == 1 else f" in all {of.finite:,} members"
        if is_event_time(label, attrs) and of.first == 0.0:
            every += ": each starts past it"  # such as an axis that starts beyond its cone
        return f"  {label:24s} {of.first:.6g} {units}".rstrip() + every
    half = intervals.half_of_mean(of.variance, of.finite, confidence or 0.95)
    width = f" +- {half:.2g}" if confidence else ""
    low, median, high = of.quantiles
    missing = of.members - of.finite
    never = f"; no value for {missing:,} of {all_members}" if missing else ""
    spread = f"median {median:.6g}, 90 % in {low:.4g} to {high:.4g} {units}{never}".rstrip()
    conserved = attrs.get("conserved", "yes")
    why = "" if conserved == "yes" else f"   (not conserved: {conserved.removeprefix('no: ')})"
    return f"  {label:24s} {of.mean:.6g}{width}, {spread}{why}"
