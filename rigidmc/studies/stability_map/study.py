"""Map a measure over two parameters of a scene.

Pixel (i, j) has the number p = i columns + j. Its member r equals member r pixels + p of the
scene in the attributes, to the bit.

{parameters}

Returns
-------
xarray.Dataset
    over y and x: each measure with the ends `_low` and `_high` of its confidence interval; and
    counts of members per pixel: `good`; `failed`, flagged in `status` and left out; and `none`,
    with an impossible body or start. A measure is nan in pixels without a good member

Raises
------
OptionError
    for parameters and measures that the scene does not have

Examples
--------
The spin about axis 2 is unstable while I1 < I2 < I3:

>>> start = rm.Start(omega=(0.01, 1.0, 0.01))
>>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start)
>>> sides = ("body.moments.1", 1.0, 3.0), ("start.omega.1", 0.01, 0.1)
>>> flips = rm.stability_map(scene, *sides, "p(flips >= 1)", (2, 1), t_end=40.0, dt=0.1)
>>> flips["p(flips>=1)"].values.tolist()
[[1.0, 0.0]]
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path
from rigidmc.results.labels import count_text, units_text
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.options import SIDE, Options, Side, Words, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.work import StudyWork
from rigidmc.studies.stability_map.compute import prepare_map, replicas_of, run_map
from rigidmc.studies.stability_map.pixels import MapRun
from rigidmc.studies.stability_map.question import (
    MOST_LAYERS,
    Borders,
    Resolution,
    columns_and_rows,
    make_request,
)
from rigidmc.studies.stability_map.stored import create_map, open_map

RESOLUTION = 128  # pixels per side: 262,144 members with REPLICAS
ENDS = "LOW:HIGH,LOW:HIGH"


def read_part(value: Any, at: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Parse LOW:HIGH,LOW:HIGH into ((low, high), (low, high)); OptionError."""
    try:
        x, y = (side.split(":") for side in value.split(","))
        (left, right), (low, high) = map(float, x), map(float, y)
    except ValueError:
        rule = f"expected the ranges across and upwards, {ENDS}, e.g. 0.1:0.2,1:1.5"
        raise OptionError(rule, at=at, value=value) from None
    return (left, right), (low, high)


NEEDED = "is missing: a map of a scene needs x, y and of"


class MapOptions(Options):
    """The options of `stability_map`."""

    x: Side | None = option(
        None,
        "scene parameter across, e.g. body.moments.1=0:1; append :log for log spacing",
        more="or (parameter, low, high), or (parameter, low, high, True) for log spacing",
        missing=NEEDED,
        like=SIDE,
    )
    y: Side | None = option(None, "scene parameter upwards", more="as x", missing=NEEDED, like=SIDE)
    of: Words | None = option(
        None,
        'measure shown: "p(flips >= 1)", "mean(megno)", "quantile(flip_wait, 0.9)"; may be'
        " repeated",
        more="see `rigidmc.statistics.measures`",
        metavar="MEASURE",
        is_new=True,
        missing=NEEDED,
    )
    resolution: Resolution = option(
        RESOLUTION,
        "pixels along each side; by default 256 for a shipped map, 128 for a scene",
        more="or (columns, rows)",
        type=int,
        kind="int or tuple of int",
        is_new=True,
        reader=lambda value, at: columns_and_rows(value),
    )
    members: int | None = option(
        None,
        "members per pixel; by default that of the shipped map, or 16, or 1 if only x and y vary",
        is_new=True,
    )
    confidence: float = option(
        0.95,
        "confidence level of the intervals",
        above=0.0,
        below=1.0,
        in_command=False,
        is_new=True,
    )
    z: Side | None = option(
        None, "a third scene parameter: a stack of maps, one for each value", more="as x", like=SIDE
    )
    layers: int | None = option(None, "number of maps in the stack; by default 6", most=MOST_LAYERS)
    adaptive: bool | Borders = option(
        False,
        "compute a coarse grid, and more pixels where neighbouring pixels differ in class or an"
        " interval contains a border between classes; other pixels copy one nearby",
        more="`computed` in the result marks the computed pixels. The first measure defines the"
        " classes: divided at 0.5 for a fraction p(...) and at 4 for a MEGNO, else eight equal"
        " parts of its range; or give a tuple of (measure, values between its classes)",
        type=bool,
        kind="bool or tuple",
        is_new=True,
        reader=lambda value, at: value,
    )
    border: Any = option(
        None,
        "with --adaptive: a value of the first measure between two classes; may be repeated. By"
        " default 0.5 for a fraction p(...), 4 for a MEGNO, else eight equal parts of its range",
        metavar="NUMBER",
        type=list[float],
        in_function=False,
        is_new=True,
    )
    zoom: Any = option(
        None,
        "recompute this part of an existing map: ranges across and upwards, in its units",
        metavar=ENDS,
        type=str,
        reader=read_part,
        in_function=False,
        is_new=True,
    )


class Maps(StudyWork):
    """The work of a map: the members of one scene, sorted into pixels."""

    sources = "NAME|SCENE|FILE|MAP/"

    @property
    def keywords(self) -> dict[str, tuple[str, str]]:
        told = "bool or callable", "True for a bar, or a function of (members done, all)"
        return {**super().keywords, "progress": told}

    def design(self, scene: Scene, options: Any, settings: Mapping[str, Any]) -> MapRun:
        """Prepare the map, before its first step."""
        x, y, members = options.x, options.y, options.members
        if members is None:
            members = replicas_of(scene, x, y)
        sizes = options.resolution, members, options.z, options.layers
        more = {"confidence": options.confidence, "adaptive": options.adaptive}
        request = make_request(x, y, options.of, *sizes, scene.model, **more)
        return prepare_map(request, scene, save=settings.get("save", ()))

    def compute(
        self, map_run: MapRun, options: Any, threads: int | None, device: str | None, progress: Any
    ) -> xr.Dataset:
        """Compute the map now."""
        return run_map(map_run, threads, progress, device)

    def stored(
        self, name: str, path: Path, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """Return a map on disk; FileError."""
        return open_map(path, allow_code)

    def create(
        self, name: str, map_run: MapRun, options: Any, path: Path, **ways: Any
    ) -> RunDirectory:
        """Create a run directory; see `rigidmc.runs.directory.create.create`."""
        return create_map(map_run, path, **ways)


def outcome(dataset: xr.Dataset) -> str:
    """Return "incomplete" if members are missing, "flagged" if some failed, else "done"."""
    if "missing" in dataset.attrs:
        return "incomplete"
    return "flagged" if int(dataset.failed.sum()) else "done"


def table(dataset: xr.Dataset) -> list[str]:
    """Return the map as lines of text: its cost, and the range and interval of each measure."""
    there = dataset["computed"] if "computed" in dataset else 1 + 0 * dataset.good
    pixels, none = int(there.sum()), int(((dataset.good == 0) & (dataset.failed == 0)).sum())
    failed, count = int((dataset.failed * there).sum()), dataset.attrs["members"]
    seconds, missing = dataset.attrs.get("seconds"), dataset.attrs.get("missing", 0)
    took = f": {seconds:.1f} s, {pixels * count / seconds:,.0f} members/s" if seconds else ""
    stack = f" x {dataset.sizes['z']}" if "z" in dataset.sizes else ""
    lines = [
        dataset.attrs["title"],
        f"  {dataset.sizes['x']} x {dataset.sizes['y']}{stack} pixels of"
        f" {count_text(count, 'member')} with {dataset.attrs['integrator']}{took}",
    ]
    if "computed" in dataset:
        lines.append(f"  {100 * pixels / there.size:.3g} % of the pixels were computed")
    if missing and "computed" in dataset:
        lacking = count_text(missing, "member is", "members are")
        lines.append(f"  at least {lacking} missing; continue with `rigidmc resume`")
    elif missing:
        share = 100 * (1 - missing / (pixels * count))
        lines.append(f"  {share:.3g} % of the members are done; continue with `rigidmc resume`")
    for name, values in dataset.data_vars.items():
        ends = str(name).endswith(("_low", "_high"))
        counts = name in ("good", "failed", "none", "computed") or ends
        if not counts and bool(values.notnull().any()):
            units = values.attrs.get("units", "1")
            unit = "" if units == "1" else f" {units_text(units)}"
            lines.append(
                f"  {name:28s} {float(values.min()):.4g} to {float(values.max()):.4g}{unit},"
                f" median {float(values.median()):.4g}{unit}{_interval(dataset, str(name), count)}"
            )
    return [*lines, f"  impossible pixels (body or start): {none:,}; failed members: {failed:,}"]


def _interval(dataset: xr.Dataset, name: str, count: int) -> str:
    """Return a text with the half-width of the confidence interval in the median pixel."""
    if f"{name}_low" not in dataset or count == 1:
        return ""
    width = dataset[f"{name}_high"] - dataset[f"{name}_low"]
    is_known = np.isfinite(width)
    if not is_known.any():
        return ", too few members for intervals"
    half = float(width.where(is_known).median()) / 2
    return f", {100 * dataset.attrs['confidence']:g} % interval +-{half:.2g} in the median"


stability_map = Study(
    name="stability_map",
    command="map",
    text=__doc__,
    options=MapOptions,
    work=Maps(),
    table=table,
    picture="stability_map",
    settings=("integrator", "dt", "turn", "t_end", "tolerance", "seed", "dtype", "compensated"),
    outcome=outcome,
    example=Example(
        "dzhanibekov",
        {
            "x": "start.omega.1=0.01:0.1", "y": "start.omega.3=0.01:0.1", "of": "p(flips >= 1)",
            "resolution": 4, "members": 4,
        },
        {"t_end": 5.0},
    ),
)  # fmt: skip
