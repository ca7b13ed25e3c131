"""The picture of finite-time Lyapunov exponents: the field over two parameters of the start."""

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rigidmc.errors import OptionError, nearest
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_degrees, in_symbols, with_units
from rigidmc.views.figures import VALUES, figure_of, new_figure

PIXELS = 500  # most pixels per side


def ftle_field(
    study: xr.Dataset, x: str | None = None, y: str | None = None, figure: Figure | None = None
) -> Figure:
    """Draw the field over two parameters of the start, bright where a change grows most: bright
    lines are stable manifolds. A pixel has the value of the nearest start. With one parameter the
    picture is a curve; with three or more it has dots in place of pixels.

    study : the Dataset of `rigidmc.ftle`
    x, y : names of parameters, such as "start.omega.1"; by default the first two

    Raises OptionError for a parameter that the study does not have.
    """
    numbers = [str(n) for n in study.number.values if study.start.sel(number=n).notnull().any()]
    names = [n for n in (x or "".join(numbers[:1]), y or "".join(numbers[1:2])) if n]
    for name in names:
        if name not in numbers:
            rule = f"is not an uncertain parameter of the start; known: {', '.join(numbers)}"
            raise OptionError(rule, at="x and y", value=name, nearest=nearest(name, numbers))
    if not names:
        rule = "the start has only vector distributions, so it has no parameter for an axis"
        raise OptionError(rule, at="x and y")
    time = f"{study.attrs['t_end']:g} s"
    title = f"{study.attrs['title']}: growth of a change of the start after {time}"
    figure = figure or new_figure(title, (8.2, 6.2))
    axes, values = figure.add_subplot(), study.ftle.values
    order = np.argsort(values)[: int(np.isfinite(values).sum())]
    places, labels = [], []
    for number in names:
        of_number = study.sel(number=number)
        place, unit = in_degrees(of_number.start.values[order], of_number.units.item())
        places.append(place)
        labels.append(with_units(in_symbols(number), unit))
    exponent = f"{study.ftle.attrs['long_name']} over {time}"
    words = with_units(exponent, study.ftle.attrs["units"])
    axes.set_xlabel(labels[0])
    if len(names) == 1:
        axes.plot(places[0], values[order], ".", ms=2.0, rasterized=True)
        axes.set_ylabel(words)
        return figure_of(axes)
    low, high = np.quantile(values[order], [0.01, 0.995]) if order.size else (0.0, 1.0)
    colours: dict[str, Any] = {"cmap": VALUES, "vmin": low, "vmax": high, "rasterized": True}
    if study.attrs["numbers"] == 2 and order.size:
        edges, nearby = _nearest(places)
        dots: Any = axes.pcolormesh(*edges, values[order][nearby], **colours)
    else:
        size = float(np.clip(200000.0 / max(1, order.size), 0.5, 60.0))  # [pt2] of 130,000
        style: dict[str, Any] = {"marker": "s", "linewidths": 0.0, "s": size}
        dots = axes.scatter(places[0], places[1], c=values[order], **style, **colours)
    axes.set_ylabel(labels[1])
    axes.margins(0.0)
    figure.colorbar(dots, ax=axes, extend="both").set_label(words)
    return figure_of(axes)


def _nearest(places: list[Array]) -> tuple[list[Array], NDArray[np.intp]]:
    """Return (pixel edges across and up, start nearest to each pixel), for starts in a plane."""
    side = int(np.clip(math.sqrt(2.0 * places[0].size), 16, PIXELS))
    edges = [np.linspace(x.min(), x.max(), side + 1) for x in places]
    # avoid division by zero for a side without length
    long = [max(float(np.ptp(x)), 1e-300) for x in places]
    centres = [0.5 * (e[1:] + e[:-1]) / w for e, w in zip(edges, long, strict=True)]
    grid = np.stack(np.meshgrid(*centres), axis=-1)
    tree = cKDTree(np.stack([x / w for x, w in zip(places, long, strict=True)], axis=-1))
    return edges, np.asarray(tree.query(grid)[1], np.intp)
