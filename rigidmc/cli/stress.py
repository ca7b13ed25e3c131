"""rigidmc stress: the hard cases, or the generic checks of one scene."""

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from rigidmc.cli.app import FLAGGED, OK, STUDY, app, load_scene
from rigidmc.cli.options import (
    AllowCode,
    Force,
    Output,
    Plot,
    Set,
    Threads,
)
from rigidmc.cli.reporting import keep, refuse_outputs, reported, written
from rigidmc.errors import in_file
from rigidmc.scene.amounts import words_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

SceneOrNone = Annotated[
    str | None,
    typer.Argument(
        metavar="[SCENE]",
        help="A scene to put through the generic checks; without it the catalogue of hard cases.",
    ),
]
Group = Annotated[
    str | None, typer.Option(help="Groups of the catalogue, e.g. H2,H7; by default all.")
]
Quick = Annotated[
    bool, typer.Option("--quick", help="A few cases and integrators; long cases shortened.")
]
Bounds = Annotated[
    str | None,
    typer.Option(
        metavar="FILE", help="Bounds instead of the shipped ones, as --write-bounds writes them."
    ),
]
WriteBounds = Annotated[
    str | None,
    typer.Option(
        "--write-bounds",
        metavar="FILE",
        help="Write four times the errors measured here as bounds (.csv).",
    ),
]
Integrator = Annotated[
    str | None,
    typer.Option(help="E.g. rk4,exact; by default all, and for a scene its own integrator."),
]


@app.command(rich_help_panel=STUDY)
def stress(
    scene: SceneOrNone = None,
    group: Group = None,
    integrator: Integrator = None,
    quick: Quick = False,
    bounds: Bounds = None,
    write_bounds: WriteBounds = None,
    threads: Threads = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    output: Output = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """Hard cases on this machine, each against its bound; or how far your own scene can be trusted.
    Exit code 4 if something fails."""
    with reported():
        refuse_outputs(force, plot=plot, study=output, bounds=write_bounds)
        if scene is not None:
            from rigidmc.studies.stress import trust

            run = {} if integrator is None else {"integrator": integrator}
            with in_file(scene):
                dataset = trust.trust(
                    load_scene(scene, settings, allow_code, run), quick=quick, progress=True
                )
            failed = trust.failed(dataset)
        else:
            from rigidmc.studies.stress import study as cases

            dataset = cases.stress(
                list(words_of(group)) if group else None,
                list(words_of(integrator)) if integrator else None,
                quick,
                cases.load_bounds(bounds) if bounds else None,
                threads,
                progress=True,
            )
            failed = cases.failed(dataset)

        def draw(dataset: "xr.Dataset") -> "Figure":
            from rigidmc.studies.stress import picture

            return (picture.trust if scene is not None else picture.hard_cases)(dataset)

        lines = list[str]()
        try:
            lines += keep(dataset, output, plot, force, draw)
            if scene is None and write_bounds is not None:
                cases.save_bounds(dataset, write_bounds, force)
                lines += written([write_bounds])
        finally:  # the table is printed also if a file cannot be written
            if scene is not None:
                print("\n".join(trust.table(dataset)))
            else:
                show(dataset)
            print("\n".join(lines), end="\n" * bool(lines))
    raise typer.Exit(FLAGGED if failed else OK)


_STYLES = {
    "good": "green",
    "close": "bold yellow",
    "not up to it": "dim",
    "not judged": "cyan",
    "above": "bold white on red",
    "crashed": "bold white on red",
}
WORST = 8  # runs that are told in full


def show(study: "xr.Dataset", console: "Console | None" = None) -> None:
    """Print the table of error over bound, the worst runs, those that crashed, and a verdict."""
    from rich.console import Console
    from rich.text import Text

    from rigidmc.studies.stress.study import AMBER, VERDICTS

    console = console or Console(width=max(150, Console().width), highlight=False)
    verdict, names = study.verdict.values, study.integrator.values
    with np.errstate(all="ignore"):
        ratio = study.error.values / study.bound.values
    ratio = np.where(np.isnan(ratio) & (study.error.values == 0.0), 0.0, ratio)
    console.print(_sheet(study, ratio))
    console.print(Text("the worst:", style="bold"))
    known = np.nan_to_num(ratio, nan=0.0)
    rank = np.where(verdict >= VERDICTS.index("above"), 1e300, 1.0) * known
    for flat in np.argsort(-np.nan_to_num(rank, nan=0.0), axis=None)[:WORST]:
        i, j = divmod(int(flat), len(names))
        _print_run(console, study, i, j, ratio[i, j])
    for i, j in np.argwhere(verdict == VERDICTS.index("crashed")):
        line = f"crashed: {study.case.values[i]}, {names[j]}: {study.reason.values[i, j]}"
        console.print(line, style="red")
    for i, j in np.argwhere(verdict == VERDICTS.index("not up to it")):
        console.print(
            f"not up to it: {study.case.values[i]}, {names[j]}: error"
            f" {study.error.values[i, j]:.1e}; {study.reason.values[i, j]}"
        )
    count = {word: int((verdict == place).sum()) for place, word in enumerate(VERDICTS)}
    parts = [f"{count[word]:,} {word}" for word in VERDICTS[1:] if count[word]]
    idle = int((verdict == 0).all(axis=1).sum())
    claimed = f" ({idle} claimed by no integrator here)" if idle else ""
    console.print(
        f"{study.sizes['case']} cases{claimed}, {int((verdict > 0).sum()):,} runs:"
        f" {', '.join(parts)} (close: above {AMBER:g} of the bound;"
        f" {'not judged: no bound; ' * bool(count['not judged'])}"
        f"{float(np.nansum(study.seconds.values)):.0f} s of work)"
    )


def _sheet(study: "xr.Dataset", ratio: np.ndarray) -> "Table":
    """The table of error over bound: a row for each case, a column for each integrator."""
    from rich.table import Table
    from rich.text import Text

    from rigidmc.studies.stress import GROUPS
    from rigidmc.studies.stress.study import VERDICTS

    sheet = Table(
        "case",
        *study.integrator.values,
        title="error over bound (. not claimed, ? not judged: no bound, X crashed)",
        title_justify="left",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    sheet.columns[0].no_wrap = True
    for column in sheet.columns[1:]:
        column.justify = "right"
    last = None
    for case, group, verdicts, ratios in zip(
        study.case.values, study.group.values, study.verdict.values, ratio, strict=True
    ):
        if group != last:
            last = group
            sheet.add_section()
            sheet.add_row(Text(f"{last} {GROUPS[last]}", style="bold"))
        cells = zip(verdicts, ratios, strict=True)
        sheet.add_row(case, *(_cell(VERDICTS[verdict], value) for verdict, value in cells))
    return sheet


def _print_run(console: "Console", study: "xr.Dataset", i: int, j: int, ratio: float) -> None:
    """Print one run: its error, its bound, why the case is hard, and the truth it is held to."""
    from rich.text import Text

    from rigidmc.studies.stress.study import VERDICTS

    error, bound, measured = (
        float(study[name].values[i, j]) for name in ("error", "bound", "measured")
    )
    known = "" if math.isnan(measured) else f", {measured:.1e} where the bounds were made"
    style = _STYLES.get(VERDICTS[int(study.verdict.values[i, j])], "")
    case = f"{study.group.values[i]} {study.case.values[i]}, {study.integrator.values[j]}"
    line = f"  {ratio:6.2f}  {case}: error {error:.1e}, bound {bound:.1e}{known}"
    console.print(Text(line, style=style if "red" in style else ""))
    why = f"          {study.why.values[i]} (truth: {study.truth.values[i]})"
    console.print(Text(why, style="dim"))


def _cell(verdict: str, ratio: float) -> "Text":
    """A cell of the table."""
    from rich.text import Text

    if verdict == "not claimed":
        return Text(".", style="dim")
    if verdict in ("crashed", "not judged"):
        return Text("X" if verdict == "crashed" else "?", style=_STYLES[verdict])
    words = f"{ratio:.2f}" if ratio < 10 else f"{ratio:.0e}"
    words = "0" if ratio == 0.0 else "<.01" if ratio < 0.01 else words
    return Text(words + ("!" if verdict == "above" else ""), style=_STYLES[verdict])
