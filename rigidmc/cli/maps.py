"""rigidmc map."""

from functools import partial
from typing import TYPE_CHECKING, Any

import typer

from rigidmc.cli.app import FLAGGED, INCOMPLETE, OK, STUDY, app
from rigidmc.cli.directories import (
    Ways,
    begun,
    names_a_run,
    refuse_force,
    refuse_ways,
    takes_ways,
)
from rigidmc.cli.map_options import (
    Across,
    Adaptive,
    Border,
    Layers,
    Listed,
    Measures,
    Members,
    Name,
    Request,
    Resolution,
    Third,
    Upwards,
    Zoom,
)
from rigidmc.cli.options import (
    AllowCode,
    Device,
    Force,
    OutputOrRun,
    Plot,
    Set,
    Threads,
    takes_settings,
)
from rigidmc.cli.reporting import keep, refuse_outputs, reported, show_done
from rigidmc.errors import OptionError, unknown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SETTINGS = ("integrator", "dt", "turn", "t_end", "tolerance", "seed", "dtype", "compensated")


@app.command("map", rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
@takes_ways
def make_map(
    name: Name,
    run: dict[str, Any],
    ways: Ways,
    listed: Listed = None,
    x: Across = None,
    y: Upwards = None,
    of: Measures = [],  # noqa: B006
    resolution: Resolution = None,
    members: Members = None,
    z: Third = None,
    layers: Layers = None,
    adaptive: Adaptive = False,
    border: Border = [],  # noqa: B006
    zoom: Zoom = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    device: Device = None,
    output: OutputOrRun = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """Map two parameters of a scene against what its members do, with replicas and a confidence
    interval for every pixel. With -o MAP/ the map is a run directory, which survives a kill:
    `rigidmc map MAP/` draws what is there."""
    with reported(name):
        if name == "list":
            _list(listed)
            return
        if listed is not None:
            raise OptionError("goes with `rigidmc map list NAME`", at="NAME", value=listed)
        from rigidmc.studies.stability_map.case import with_theory
        from rigidmc.studies.stability_map.stored import create_map, open_map
        from rigidmc.studies.stability_map.study import mapped

        third = z, layers, adaptive, border
        request = Request(name, x, y, of, resolution, members, settings, run, zoom, *third)
        folder = output is not None and names_a_run(output)
        if request.draws(ways):
            refuse_outputs(force, plot=plot, study=output)
            dataset = open_map(name, allow_code)
        elif output is not None and folder:
            refuse_outputs(force, plot=plot)
            refuse_force(output, force)
            make = partial(create_map, request.prepared(threads, allow_code), output)
            code, whole = begun(make, ways, threads, allow_code)
            if not whole:
                raise typer.Exit(code)
            dataset, output = open_map(output, allow_code), None
        else:
            refuse_ways(ways)
            refuse_outputs(force, plot=plot, study=output, size=request.size())
            ready = request.prepared(threads, allow_code)
            dataset = with_theory(mapped(ready, threads, show_done), ready.question.name)
        _told(dataset, output, plot, force)
    if "missing" in dataset.attrs:
        raise typer.Exit(INCOMPLETE)
    raise typer.Exit(FLAGGED if int(dataset.failed.sum()) else OK)


def _told(dataset: "xr.Dataset", output: str | None, plot: str | None, force: bool) -> None:
    """Write a map and its picture, and print what it says."""

    def draw(dataset: "xr.Dataset") -> "Figure":
        from rigidmc.studies.stability_map import picture as maps

        return maps.stability_map(dataset)

    lines = list[str]()
    try:
        lines = keep(dataset, output, plot, force, draw)
    finally:  # the summary is printed also if a file cannot be written
        _summarise(dataset)
        print("\n".join(lines), end="\n" * bool(lines))


def _list(name: str | None) -> None:
    """List the maps of the package, or explain one of them."""
    from rigidmc.studies.stability_map.case import MAPS

    if name is not None and name not in MAPS:
        raise unknown("map", MAPS, at="map", value=name, error=OptionError)
    for word in MAPS if name is None else (name,):
        case = MAPS[word]()
        print(f"{word:18s} {case.title}")
        print(f"{'':18s} {case.x[0]} and {case.y[0]}: {', '.join(case.of)}")
        if case.source:
            print(f"{'':18s} theory: {case.source}")
        if name is not None:
            across, upwards = (
                f"{key} from {low:g} to {high:g}{' in even ratios' * bool(log)}"
                for key, low, high, *log in (case.x, case.y)
            )
            settings = ", ".join(f"{key} = {value}" for key, value in case.settings.items())
            print(f"{'':18s} across {across}; upwards {upwards}")
            print(f"{'':18s} {case.members} members of each pixel; {settings}")
            print(f"\n{case.scene.dumps()}", end="")


def _summarise(dataset: "xr.Dataset") -> None:
    """Print what the map cost, the range of each measure, and how well it is known."""
    from rigidmc.results.labels import count_text

    there = dataset["computed"] if "computed" in dataset else 1 + 0 * dataset.good
    pixels, none = int(there.sum()), int(((dataset.good == 0) & (dataset.failed == 0)).sum())
    failed, count = int((dataset.failed * there).sum()), dataset.attrs["members"]
    seconds, missing = dataset.attrs.get("seconds"), dataset.attrs.get("missing", 0)
    took = f": {seconds:.1f} s, {pixels * count / seconds:,.0f} members/s" if seconds else ""
    print(f"{dataset.attrs['title']}")
    stack = f" x {dataset.sizes['z']}" if "z" in dataset.sizes else ""
    print(
        f"  {dataset.sizes['x']} x {dataset.sizes['y']}{stack} pixels of"
        f" {count_text(count, 'member')} with {dataset.attrs['integrator']}{took}"
    )
    if "computed" in dataset:
        print(f"  {100 * pixels / there.size:.3g} % of the pixels were computed")
    if missing and "computed" in dataset:
        print(f"  at least {missing:,} members are missing; `rigidmc resume` goes on")
    elif missing:
        share = 100 * (1 - missing / (pixels * count))
        print(f"  {share:.3g} % of the members are there; `rigidmc resume` goes on")
    for name, values in dataset.data_vars.items():
        counts = name in ("good", "failed", "none", "computed") or str(name).endswith(
            ("_low", "_high")
        )
        if not counts and bool(values.notnull().any()):
            print(
                f"  {name:28s} {float(values.min()):.4g} to {float(values.max()):.4g},"
                f" median {float(values.median()):.4g}{_interval(dataset, str(name), count)}"
            )
    print(f"  pixels without body or start: {none:,}; members that failed: {failed:,}")


def _interval(dataset: "xr.Dataset", name: str, count: int) -> str:
    """In words, half the width of the confidence interval in the median pixel."""
    import numpy as np

    if f"{name}_low" not in dataset or count == 1:
        return ""
    width = dataset[f"{name}_high"] - dataset[f"{name}_low"]
    known = np.isfinite(width)
    if not known.any():
        return ", too few members for intervals"
    half = float(width.where(known).median()) / 2
    return f", intervals of {100 * dataset.attrs['confidence']:g} % +-{half:.2g} in the median"
