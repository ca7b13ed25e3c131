"""Common parts of all pictures: palette, empty figures, and saving a figure to a file.

A picture is a matplotlib Figure, made without pyplot and its global state. The position of an
integrator in the registry determines its line style, so a new one has a style at once.
"""

import io
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import (
    BoundaryNorm,
    Colormap,
    LinearSegmentedColormap,
    ListedColormap,
    LogNorm,
    Normalize,
)
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike
from PIL import Image

from rigidmc.files.opening import check_suffix
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.inputs.arrays import Array
from rigidmc.physics.integrators import INTEGRATORS

INK, GREY, LIGHT = "#222222", "#777777", "#c8c8c8"  # lines and text, from strong to faint
PATH = "#d94801"  # single members and highlights
BAND, CORE, MEDIAN = "#c6dbef", "#6baed6", "#08306b"  # outer and inner quantiles, median
ALARM = "#a61c00"  # limits and failures
DENSITY, VALUES = "cividis_r", "cividis"  # colour maps, dark or bright at large values
CROWD = LinearSegmentedColormap.from_list("crowd", (BAND, CORE, MEDIAN))  # of members, as on pages
HALO = [withStroke(linewidth=2.0, foreground="white")]  # around text and lines over an image
# distinguish lines: by colour, and in greyscale by marker and dash
COLOURS = (
    "#d94801", "#8c2d04", "#7a7a7a", "#9e7bb5", "#2a9d6f",
    "#2171b5", "#08306b", "#000000", "#4a1486", "#6baed6",
)  # fmt: skip
MARKERS = (
    "o", "s", "^", "v", "<", "x", "P", "X", "D", ">", "p", "h", "d", "*", "H", "+", "1",
    "2", "3", "4", "|", "_",
)  # fmt: skip
DASHES = ("-", "--", ":", "-.")

AXES = ("#2171b5", "#b5651d", "#5a5a5a")  # axes 1, 2 and 3 of a body, as on pages
PULL = COLOURS[4]  # gravity and fields

# lines of a few members
FEW: tuple[dict[str, Any], ...] = (
    {"color": PATH, "linestyle": "-"},
    {"color": MEDIAN, "linestyle": "--"},
    {"color": CORE, "linestyle": "-."},
    {"color": INK, "linestyle": (0, (6, 1, 1, 1, 1, 1))},
)

# low, middle and high of three values, dark to light
THREE = (MEDIAN, "#bbbbbb", "#fdd49e")
# {part of a measure's name: (low, high, ticks)} of measures with a logarithmic scale
LOGARITHMIC = {"megno": (1.5, 200.0, (2, 5, 10, 20, 50, 100, 200))}

Ticks = tuple[list[float], list[str]]
Scale = tuple[str | Colormap, Normalize, Ticks | None]  # colour map, norm, ticks


DPI, MOST_PIXELS = 150, 2000  # resolution, and the longest side of a .png: taller tables get less


class Picture(Figure):
    """A figure that notebooks display even without pyplot, which registers the display of a plain
    Figure.

    has_few_colours : whether a .png has a palette, as for tables with a background in a few colours
    """

    has_few_colours = False

    def draw(self, renderer: Any) -> None:
        """Draw the figure. Axes of equal scales get other ticks when the layout resizes them, so
        that only a second layout has room for their labels."""
        engine = self.get_layout_engine()
        if engine is not None and any(axes.get_aspect() != "auto" for axes in self.axes):
            engine.execute(self)
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png", dpi=100)
        return data.getvalue()


def new_figure(title: str, size: tuple[float, float]) -> Picture:
    """Return an empty figure with a heading; size in inches."""
    figure = Picture(size, layout="constrained")
    FigureCanvasAgg(figure)
    # a scene's title is plain text, not a formula
    figure.suptitle(title, fontsize=11, parse_math=False)
    return figure


def figure_of(axes: Axes) -> Figure:
    """Return the figure that contains the axes."""
    return cast(Figure, axes.figure)


def add_title(
    axes: Axes, text: str, note: str = "", pad: float | None = None, wide: int = 74
) -> None:
    """Give axes a title, and below it in red a note on omissions from the picture.

    wide : characters of a line of the note
    """
    lines = [text, *([fill(note, wide)] if note else [])]
    colour = ALARM if note else "black"
    axes.set_title("\n".join(lines), fontsize=9 if note else 10, pad=pad, color=colour)


def name_powers(axes: Axes) -> None:
    """Write powers of ten of large and small ticks in the labels, "time [$10^9$ s]"; matplotlib
    writes them beside the axes, where they cover other parts."""
    for axis in (axes.xaxis, axes.yaxis):
        size = float(np.abs(axis.get_view_interval()).max())
        power = int(np.floor(np.log10(size))) if 0.0 < size < np.inf else 0
        if -5 < power < 6:
            continue
        unit, label = 10.0**power, axis.get_label_text()
        axis.set_major_formatter(FuncFormatter(lambda x, _, unit=unit: f"{x / unit:g}"))
        axis.set_label_text(label.replace("[", f"[$10^{{{power}}}$ ", 1))


def mark_starts(axes: Axes, x: ArrayLike, y: ArrayLike, is_seen: ArrayLike = True) -> None:
    """Mark the starts (n,) of paths by dark dots, hollow behind a surface, and name them in the
    legend."""
    x, y, is_seen = np.broadcast_arrays(x, y, is_seen)
    style: dict[str, Any] = {"marker": "o", "ls": "", "color": INK, "ms": 5.0, "zorder": 4}
    axes.plot(x[~is_seen], y[~is_seen], mfc="white", **style)
    axes.plot(x[is_seen], y[is_seen], label="start", **style)


def line_styles(count: int) -> list[dict[str, Any]]:
    """Return the styles of the lines of some members: up to four differ in dashes, more are thinner
    and differ in shade, from dark to light."""
    if count <= len(FEW):
        return [{**style, "linewidth": 1.5} for style in FEW[:count]]
    shades = colormaps[VALUES](np.linspace(0.0, 0.85, count))
    return [{"color": tuple(shade), "linestyle": "-", "linewidth": 0.9} for shade in shades]


def add_density(axes: Axes, x: Array, y: Array, of: str, edges: Array | None = None) -> None:
    """Draw how many points there are in each bin, on a logarithmic scale.

    of : what is counted, such as "states";  edges : of the bins of x
    """
    there = np.isfinite(x) & np.isfinite(y)
    # about four points in a bin, if they fill the picture
    across = int(np.clip(0.5 * np.sqrt(np.count_nonzero(there)), 40, 160))
    bins = (across if edges is None else edges, across)
    count, *places = np.histogram2d(x[there], y[there], bins=bins)
    norm = LogNorm(1.0, max(count.max(), 10.0))
    shown = np.where(count > 0.0, count, np.nan).T
    image = axes.pcolormesh(*places, shown, cmap=CROWD, norm=norm, rasterized=True)
    bar = figure_of(axes).colorbar(image, ax=axes, aspect=30, pad=0.02)
    bar.set_label(f"{of} per bin", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def legend_above(axes: Axes, columns: int, of: Axes | None = None) -> None:
    """Draw a legend between the axes and their title.

    of : axes whose lines it names, by default the same
    """
    axes.legend(
        *(of or axes).get_legend_handles_labels(),
        loc="lower center",
        bbox_to_anchor=(0.5, 0.99),
        ncols=columns,
        fontsize=8,
        frameon=False,
        columnspacing=1.2,
    )


def colour_scale(name: str, values: Array, named: Mapping[float, str]) -> Scale:
    """Return (colour map, norm, ticks) for a variable.

    named : {value: word} of a variable with a few values
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return VALUES, Normalize(0.0, 1.0), None
    if name.startswith("p("):  # a probability
        return DENSITY, Normalize(0.0, 1.0), None
    if name.startswith("correlation("):
        return VALUES, Normalize(-1.0, 1.0), None
    if named:
        places = sorted(named)
        bounds = [places[0] - 0.5, *(place + 0.5 for place in places)]
        colours = ListedColormap(list(THREE[: len(places)]))
        words = [named[place] for place in places]
        return colours, BoundaryNorm(bounds, len(places)), (places, words)
    for part, (low, high, ticks) in LOGARITHMIC.items():
        if part in name:
            return VALUES, LogNorm(low, high), (list(ticks), [str(tick) for tick in ticks])
    low, high = np.quantile(finite, [0.005, 0.995])
    if high <= low:
        # all values are equal; 1e-300 only separates the limits of zeros, and is invisible
        low, high = low - 0.01 * abs(low) - 1e-300, high + 0.01 * abs(high) + 1e-300
    return VALUES, Normalize(low, high), None


def save(figure: Figure, path: str | PathLike[str], force: bool = False) -> None:
    """Write a picture in the format of its suffix, completely or not at all.

    Raises OutputExists if the file exists and `force` is False; OptionError as in `check_suffix`.
    """
    refuse_existing(path, force, "pictures")
    write_bytes(path, picture_bytes(figure, path), force)


def picture_bytes(figure: Figure, path: str | PathLike[str]) -> bytes:
    """Return the bytes of a picture in the format of the path's suffix; OptionError as in
    `check_suffix`."""
    check_suffix(path, "pictures")
    suffix = Path(path).suffix[1:].lower()
    buffer = io.BytesIO()
    dpi = min(DPI, MOST_PIXELS / max(figure.get_size_inches()))
    figure.savefig(buffer, dpi=dpi, format=suffix)
    if suffix == "png" and getattr(figure, "has_few_colours", False):
        with Image.open(buffer) as image:
            buffer = io.BytesIO()
            # the octree keeps colours of few pixels, which the default method averages
            few = image.convert("RGB").quantize(
                128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
            )
            few.save(buffer, "png", optimize=True)
    return buffer.getvalue()


class Style(NamedTuple):
    """Line style of an integrator."""

    color: str
    marker: str
    dash: str


def styles() -> dict[str, Style]:
    """Return {integrator: Style} from the registry.

    Integrators of one family (defined in one file) and order share a colour and differ in dashes;
    each integrator has its own marker, up to len(MARKERS) of them.
    """
    families: dict[tuple[str, float], int] = {}  # {(file, order): members so far}
    table = {}
    for place, (name, kind) in enumerate(INTEGRATORS.items()):
        family = type(kind).__module__, kind.order
        before = families.setdefault(family, 0)
        colour = COLOURS[list(families).index(family) % len(COLOURS)]
        table[name] = Style(colour, MARKERS[place % len(MARKERS)], DASHES[before % len(DASHES)])
        families[family] += 1
    return table


STYLES = styles()


def style_of(name: str) -> Style:
    """Return the style of an integrator; custom integrators share one."""
    return STYLES.get(name, Style("0.15", "*", "-"))
