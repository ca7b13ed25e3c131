"""rigidmc map."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigidmc.cli.common import FLAGGED, OK, about, app, keep, load_scene, refuse_outputs, reported
from rigidmc.cli.options import (
    AllowCode,
    Force,
    Output,
    Plot,
    Set,
    Threads,
    count_option,
    takes_settings,
)
from rigidmc.cli.panels import STUDY
from rigidmc.errors import OptionError, unknown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME|SCENE",
        help="A map of the package (rigidmc map list), a TOML file, or a shipped scene.",
    ),
]
Listed = Annotated[
    str | None,
    typer.Argument(metavar="[NAME]", help="With `rigidmc map list`: the map to explain."),
]
Across = Annotated[
    str | None,
    typer.Option(
        metavar="KEY=LOW:HIGH",
        help="Scene parameter across, e.g. body.moments.1=0:1; with :log in even ratios.",
    ),
]
Upwards = Annotated[
    str | None, typer.Option(metavar="KEY=LOW:HIGH", help="Scene parameter upwards.")
]
Measures = Annotated[
    list[str],
    typer.Option(
        metavar="MEASURE",
        help='What a pixel shows: "p(flips >= 1)", "mean(megno)", "quantile(flip_wait, 0.9)";'
        " may be repeated.",
    ),
]
Resolution = Annotated[
    int | None,
    count_option(
        "--resolution",
        help="Pixels along each side; by default 256 for a map of the package, 128 for a scene.",
    ),
]
Members = Annotated[
    int | None,
    count_option(
        "--members",
        help="Members of a pixel; by default the map's own, or 16, or 1 if only x and y differ.",
    ),
]
SETTINGS = ("integrator", "dt", "turn", "t_end", "tolerance", "seed", "dtype", "compensated")


@app.command("map", rich_help_panel=STUDY)
@takes_settings(*SETTINGS)
def make_map(
    name: Name,
    run: dict[str, Any],
    listed: Listed = None,
    x: Across = None,
    y: Upwards = None,
    of: Measures = [],  # noqa: B006
    resolution: Resolution = None,
    members: Members = None,
    settings: Set = [],  # noqa: B006
    allow_code: AllowCode = False,
    threads: Threads = None,
    output: Output = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """Map two parameters of a scene against what its members do, with replicas and a confidence
    interval for every pixel."""
    with reported(), about(name):
        if name == "list":
            _list(listed)
            return
        if listed is not None:
            raise OptionError("", "NAME", listed, "goes with `rigidmc map list NAME`")
        from rigidmc.studies.maps import catalogue, stability_map

        of_package = _of_package(name, x, y, of, settings)
        if resolution is None:
            resolution = catalogue.RESOLUTION if of_package else stability_map.RESOLUTION
        size = 8 * max(resolution, 1) ** 2 * (4 + 3 * len(of))
        refuse_outputs(force, plot=plot, study=output, size=size)
        if of_package:
            dataset = catalogue.case_map(name, resolution, members, threads, _show, **run)
        else:
            scene = load_scene(name, settings, allow_code)
            sides = _side(x or "", "--x"), _side(y or "", "--y")
            dataset = stability_map.stability_map(
                scene, *sides, of, resolution, members, threads, _show, **run
            )

        def draw(dataset: "xr.Dataset") -> "Figure":
            from rigidmc.views import maps

            return maps.stability_map(dataset)

        lines = list[str]()
        try:
            lines = keep(dataset, output, plot, force, draw)
        finally:  # the summary is printed also if a file cannot be written
            _summarise(dataset)
            print("\n".join(lines), end="\n" * bool(lines))
    raise typer.Exit(FLAGGED if int(dataset.failed.sum()) else OK)


def _of_package(
    name: str, x: str | None, y: str | None, of: Sequence[str], settings: Sequence[str]
) -> bool:
    """Whether a map of the package is asked for; OptionError if neither it nor a map of a scene is
    described completely."""
    from rigidmc.scene.shipped import shipped
    from rigidmc.studies.maps.catalogue import MAPS

    plain = not (x or y or of or settings)
    if name in MAPS and plain:
        return True
    if plain and name not in shipped():
        raise unknown("", "map", name, "map", MAPS, OptionError)
    missing = [key for key, value in (("--x", x), ("--y", y), ("--of", of)) if not value]
    if missing and name in MAPS:
        rule = (
            "a map of the package has its own x, y, measures and scene; give --resolution,"
            " --members, --dt and the like, or a scene with all of --x, --y and --of"
        )
        raise OptionError("", "map", name, rule)
    if missing:
        own = ", ".join(MAPS)
        rule = f"is missing: a map of a scene needs --x, --y and --of; maps of the package: {own}"
        raise OptionError("", ", ".join(missing), None, rule)
    return False


def _show(done: int, total: int) -> None:
    """Show how many pixels are done, on a terminal."""
    if sys.stderr.isatty():
        end = "" if done < total else "\n"
        line = f"\r{100 * done / total:3.0f} % of {total:,} pixels"
        print(line, end=end, file=sys.stderr, flush=True)


def _list(name: str | None) -> None:
    """List the maps of the package, or explain one of them."""
    from rigidmc.studies.maps.catalogue import MAPS

    if name is not None and name not in MAPS:
        raise unknown("", "map", name, "map", MAPS, OptionError)
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


def _side(text: str, key: str) -> tuple[str, float, float, bool]:
    """(parameter, low, high, whether in even ratios) of KEY=LOW:HIGH[:log]; OptionError."""
    name, equals, ends = text.partition("=")
    parts = ends.split(":")
    try:
        low, high = float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        low = high = float("nan")
    if not equals or len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]) or low != low:
        rule = "expected KEY=LOW:HIGH or KEY=LOW:HIGH:log, e.g. body.moments.1=0.1:0.9"
        raise OptionError("", key, text, rule)
    return name.strip(), low, high, len(parts) == 3


def _summarise(dataset: "xr.Dataset") -> None:
    """Print what the map cost, the range of each measure, and how well it is known."""
    pixels, none = dataset.good.size, int(((dataset.good == 0) & (dataset.failed == 0)).sum())
    failed, count = int(dataset.failed.sum()), dataset.attrs["members"]
    seconds = dataset.attrs["seconds"]
    print(f"{dataset.attrs['title']}")
    print(
        f"  {dataset.sizes['x']} x {dataset.sizes['y']} pixels of {count} members with"
        f" {dataset.attrs['integrator']}: {seconds:.1f} s,"
        f" {pixels * count / seconds:,.0f} members/s"
    )
    for name, values in dataset.data_vars.items():
        counts = name in ("good", "failed", "none") or str(name).endswith(("_low", "_high"))
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
