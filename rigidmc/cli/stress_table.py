"""The table of hard cases on a terminal."""

import math

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rigidmc.studies.stress.catalogue import GROUPS
from rigidmc.studies.stress.run import AMBER, VERDICTS

_STYLES = {
    "good": "green",
    "close": "bold yellow",
    "not up to it": "dim",
    "above": "bold white on red",
    "crashed": "bold white on red",
}
WORST = 8


def show(study, console=None):
    """Print the heat map of error over bound, the worst first, and a verdict."""
    console = console or Console(width=max(150, Console().width), highlight=False)
    verdict = study.verdict.values
    names = study.integrator.values
    with np.errstate(all="ignore"):
        ratio = study.error.values / study.bound.values
    ratio = np.where(np.isnan(ratio) & (study.error.values == 0.0), 0.0, ratio)
    sheet = Table(
        "case",
        *names,
        title="error over bound (. not claimed, X crashed)",
        title_justify="left",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    sheet.columns[0].no_wrap = True
    for column in sheet.columns[1:]:
        column.justify = "right"
    last = None
    for i, case in enumerate(study.case.values):
        if study.group.values[i] != last:
            last = study.group.values[i]
            sheet.add_section()
            sheet.add_row(Text(f"{last} {GROUPS[last]}", style="bold"))
        sheet.add_row(
            case, *(_cell(VERDICTS[verdict[i, j]], ratio[i, j]) for j in range(len(names)))
        )
    console.print(sheet)
    order = np.argsort(
        -np.nan_to_num(
            np.where(verdict >= VERDICTS.index("above"), 1e300, 1.0)
            * np.nan_to_num(ratio, nan=0.0),
            nan=0.0,
        ),
        axis=None,
    )
    console.print(Text("the worst:", style="bold"))
    for flat in order[:WORST]:
        i, j = divmod(int(flat), len(names))
        _line(console, study, i, j, ratio[i, j])
    for i, j in np.argwhere(verdict == VERDICTS.index("crashed")):
        console.print(
            f"crashed: {study.case.values[i]}, {names[j]}: {study.reason.values[i, j]}", style="red"
        )
    for i, j in np.argwhere(verdict == VERDICTS.index("not up to it")):
        console.print(
            f"not up to it: {study.case.values[i]}, {names[j]}: error {study.error.values[i, j]:.1e}; {study.reason.values[i, j]}"
        )
    count = {word: int((verdict == place).sum()) for place, word in enumerate(VERDICTS)}
    parts = [f"{count[word]:,} {word}" for word in VERDICTS[1:] if count[word]]
    seconds = float(np.nansum(study.seconds.values))
    console.print(
        f"{study.sizes['case']} cases, {int((verdict > 0).sum()):,} runs: {', '.join(parts)} (close: above {AMBER:g} of the bound); {seconds:.0f} s of work"
    )


def _line(console, study, i, j, ratio):
    error, bound, measured = (
        float(study[name].values[i, j]) for name in ("error", "bound", "measured")
    )
    known = "" if math.isnan(measured) else f", {measured:.1e} where it was made"
    style = _STYLES.get(VERDICTS[int(study.verdict.values[i, j])], "")
    what = f"  {ratio:6.2f}  {study.group.values[i]} {study.case.values[i]}, {study.integrator.values[j]}: error {error:.1e}, bound {bound:.1e}{known}"
    console.print(Text(what, style=style if "red" in style else ""))
    console.print(
        Text(f"          {study.why.values[i]} (truth: {study.truth.values[i]})", style="dim")
    )


def _cell(verdict, ratio):
    if verdict == "not claimed":
        return Text(".", style="dim")
    if verdict == "crashed":
        return Text("X", style=_STYLES[verdict])
    words = (
        "0"
        if ratio == 0.0
        else "<.01"
        if ratio < 0.01
        else f"{ratio:.2f}"
        if ratio < 10
        else f"{ratio:.0e}"
    )
    return Text(words + ("!" if verdict == "above" else ""), style=_STYLES[verdict])
