"""The table of the hard cases for rich: error / bound, the worst runs, crashes, and a verdict."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from rich.table import Table
from rich.text import Text

from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import count_text
from rigidmc.studies.stress import groups
from rigidmc.studies.stress.hard_cases import AMBER, VERDICTS

_STYLES = {
    "good": "green",
    "close": "bold yellow",
    "not up to it": "dim",
    "not judged": "cyan",
    "above": "bold white on red",
    "crashed": "bold white on red",
}
WORST = 8  # number of runs listed in full


def case_table(study: xr.Dataset) -> list[Any]:
    """Return the table of error / bound, the worst runs, the crashed runs, and a verdict."""
    verdict, names = study.verdict.values, study.integrator.values
    with np.errstate(all="ignore"):
        ratio = study.error.values / study.bound.values
    ratio = np.where(np.isnan(ratio) & (study.error.values == 0.0), 0.0, ratio)
    lines: list[Any] = [_sheet(study, ratio), Text("the worst:", style="bold")]
    size = np.nan_to_num(ratio, nan=0.0)
    rank = np.where(verdict >= VERDICTS.index("above"), 1e300, 1.0) * size
    for flat in np.argsort(-np.nan_to_num(rank, nan=0.0), axis=None)[:WORST]:
        i, j = divmod(int(flat), len(names))
        lines += _run(study, i, j, ratio[i, j])
    for i, j in np.argwhere(verdict == VERDICTS.index("crashed")):
        line = f"crashed: {study.case.values[i]}, {names[j]}: {study.reason.values[i, j]}"
        lines.append(Text(line, style="red"))
    for i, j in np.argwhere(verdict == VERDICTS.index("not up to it")):
        error, reason = study.error.values[i, j], study.reason.values[i, j]
        line = f"not up to it: {study.case.values[i]}, {names[j]}: error {error:.1e}; {reason}"
        lines.append(Text(line))
    return [*lines, Text(_counts(study))]


def _counts(study: xr.Dataset) -> str:
    """Return a line with the number of cases, of runs, and of each verdict."""
    verdict = study.verdict.values
    count = {word: int((verdict == place).sum()) for place, word in enumerate(VERDICTS)}
    parts = [f"{count[word]:,} {word}" for word in VERDICTS[1:] if count[word]]
    idle = int((verdict == 0).all(axis=1).sum())
    claimed = f" ({idle} claimed by no integrator here)" if idle else ""
    return (
        f"{count_text(study.sizes['case'], 'case')}{claimed},"
        f" {count_text(int((verdict > 0).sum()), 'run')}: {', '.join(parts)}"
        f" (close: above {AMBER:g} of the bound;"
        f" {'not judged: no bound; ' * bool(count['not judged'])}"
        f"{float(np.nansum(study.seconds.values)):.0f} s of work)"
    )


def _sheet(study: xr.Dataset, ratio: Array) -> Table:
    """Return the table of error / bound: a row for each case, a column for each integrator."""
    sheet = Table(
        "case",
        *study.integrator.values,
        title="error / bound (. not claimed, ? not judged: no bound, X crashed)",
        title_justify="left",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    sheet.columns[0].no_wrap = True
    for column in sheet.columns[1:]:
        column.justify = "right"
    last, titles = None, groups()
    for case, group, verdicts, ratios in zip(
        study.case.values, study.group.values, study.verdict.values, ratio, strict=True
    ):
        if group != last:
            last = group
            sheet.add_section()
            sheet.add_row(Text(f"{last} {titles[last].title}", style="bold"))
        cells = zip(verdicts, ratios, strict=True)
        sheet.add_row(case, *(_cell(VERDICTS[verdict], value) for verdict, value in cells))
    return sheet


def _run(study: xr.Dataset, i: int, j: int, ratio: float) -> Iterator[Text]:
    """Yield lines about one run: its error, its bound, why the case is hard, and the truth."""
    error, bound, measured = (
        float(study[name].values[i, j]) for name in ("error", "bound", "measured")
    )
    before = "" if math.isnan(measured) else f", {measured:.1e} when the bounds were measured"
    style = _STYLES.get(VERDICTS[int(study.verdict.values[i, j])], "")
    case = f"{study.group.values[i]} {study.case.values[i]}, {study.integrator.values[j]}"
    line = f"  {ratio:6.2f}  {case}: error {error:.1e}, bound {bound:.1e}{before}"
    yield Text(line, style=style if "red" in style else "")
    why = f"          {study.why.values[i]} (truth: {study.truth.values[i]})"
    yield Text(why, style="dim")


def _cell(verdict: str, ratio: float) -> Text:
    """Return a cell of the table."""
    if verdict == "not claimed":
        return Text(".", style="dim")
    if verdict in ("crashed", "not judged"):
        return Text("X" if verdict == "crashed" else "?", style=_STYLES[verdict])
    words = f"{ratio:.2f}" if ratio < 10 else f"{ratio:.0e}"
    words = "0" if ratio == 0.0 else "<.01" if ratio < 0.01 else words
    return Text(words + ("!" if verdict == "above" else ""), style=_STYLES[verdict])
