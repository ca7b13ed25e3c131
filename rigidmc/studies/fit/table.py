"""The table of a fit, as lines of text."""

import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from rigidmc.results.labels import count_text, units_text
from rigidmc.studies.fit.dataset import AXES
from rigidmc.studies.fit.draws import lines_of
from rigidmc.studies.fit.parameters import record_of
from rigidmc.studies.fit.uncertainty import SEEN

MOST_ANSWERS = 4  # printed besides the best: a screen has 24 lines


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    a, records = study.attrs, int(study.record.max())
    lines = [
        f"{a['title']}: {a['residuals']:,} readings"
        + f" of {records} records" * (records > 1)
        + f", {count_text(study.sizes['parameter'], 'parameter')},"
        f" residuals {a['reduced_chi_square'] ** 0.5:.3g} times their noise"
    ]
    lines += [f"  {text}" for key in ("notes", "unseen") for text in a[key].splitlines()]
    rows = [("parameter", "value", "std. dev.", "unit"), *_rows(study)]
    if np.isinf(study.deviation[study.parameter.isin(AXES)]).any():
        for i in range(2):
            value, deviation = study.ratio.values[i, 2], study.ratio_deviation.values[i, 2]
            rows.append((f"{AXES[i]}/{AXES[2]}", *in_digits(value, deviation), ""))
    for name, size, width in zip(
        study.sensor.values, study.jitter.values, study.jitter_deviation.values, strict=True
    ):
        if width > 0.0:
            rows.append((f"{name}.jitter", *in_digits(size, width), "s"))
    widths = [max(map(len, column)) for column in list(zip(*rows, strict=True))[:3]]
    for name, value, deviation, unit in rows:
        line = f"  {name:{widths[0]}}  {value:>{widths[1]}}  {deviation:>{widths[2]}}  {unit}"
        lines.append(line.rstrip())
    lines += _other_answers(study) + _missing(study)
    return lines + (lines_of(study, in_digits) if "drawn" in study else [])


def in_digits(value: float, deviation: float) -> tuple[str, str]:
    """Write a value with the digits that its standard deviation leaves, and the deviation."""
    if not 0.0 < deviation < math.inf:
        return f"{value:.4g}", "not shown" if deviation > 0.0 else "0"
    leading = math.floor(math.log10(abs(value) or deviation)) - math.floor(math.log10(deviation))
    digits = min(15, max(0, leading) + 2)
    return f"{value:#.{digits}g}".rstrip("."), f"{deviation:.2g}"


def _rows(study: xr.Dataset) -> Iterator[tuple[str, str, str, str]]:
    """Yield the rows of the table of parameters; a number of each record is one row for all."""
    families: dict[str, list[int]] = {}
    for i, name in enumerate(study.parameter.values):
        families.setdefault(record_of(name)[0], []).append(i)
    values, deviations = study.value.values[0], study.deviation.values
    for name, some in families.items():
        unit = units_text(str(study.unit.values[some[0]]))
        if len(some) == 1:
            yield (name, *in_digits(values[some[0]], deviations[some[0]]), unit)
        else:
            least, largest = values[some].min(), values[some].max()
            width = in_digits(largest, deviations[some].max())[1]
            yield f"{name} ({len(some)} records)", f"{least:.3g} to {largest:.3g}", width, unit


def _other_answers(study: xr.Dataset) -> list[str]:
    """Return lines about further answers, with the parameters of all records."""
    lines, names = list[str](), [str(name) for name in study.parameter.values]
    names = [name for name in names if not name.startswith("start.") and "[" not in name]
    for i in range(1, study.sizes["answer"])[:MOST_ANSWERS]:
        values = zip(names, study.value[i].sel(parameter=names).values, strict=True)
        text = ", ".join(f"{name} {value:.4g}" for name, value in values)
        cost, least = study.cost.values[[i, 0]]
        lines.append(f"  another answer, cost {cost:.4g} beside {least:.4g}: {text}")
    if study.sizes["answer"] - 1 > MOST_ANSWERS:
        lines.append(f"  {study.sizes['answer'] - 1 - MOST_ANSWERS} more answers in the Dataset")
    return lines


def _missing(study: xr.Dataset) -> list[str]:
    """Return lines about what the model leaves out."""
    a = study.attrs
    if not a["lasting_gain"] > SEEN:
        return []
    lines = [
        f"  residuals are correlated over {a['lasting_time']:.2g} s: the model leaves something"
        " out; the standard deviations allow for it"
    ]
    for i, gain in enumerate(study.gain.values[:2]):
        if gain > SEEN:
            name, setting, free = (
                str(study[key].values[i]) for key in ("torque", "setting", "torque_parameter")
            )
            lines.append(f"  {name} gains {gain:.4g} in ln likelihood; to fit it, too, add")
            lines.append(f'    --set "{setting}" --free ...,{free}')
    if len(lines) == 1:
        lines.append("  no torque tried explains them: was the body held for a time (--between)?")
    return lines
