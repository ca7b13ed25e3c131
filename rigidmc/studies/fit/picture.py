"""The pictures of a fit: readings on the band of the model and their residuals, and the fitted
parameters with their correlations."""

import re
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from scipy import stats

from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_symbols, units_text, with_units
from rigidmc.studies.fit.dataset import AXES
from rigidmc.studies.fit.table import in_digits
from rigidmc.studies.fit.uncertainty import SEEN
from rigidmc.views.figures import (
    BAND,
    COLOURS,
    CORE,
    GREY,
    INK,
    LIGHT,
    MEDIAN,
    PATH,
    add_title,
    figure_of,
    new_figure,
)  # fmt: skip

MOST = 4  # records drawn side by side
SHOWN = 36  # parameters of a corner: more are too small to see
WIDEST = 3.5  # standard deviations from the middle of a cell of the corner to its edge


def pictures(
    study: xr.Dataset,
    picture: str = "data",
    record: int | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Draw the readings of each record on the fitted motion, or the corner of the parameters.

    study : the Dataset of `rigidmc.fit`

    Raises OptionError for a picture or a record that there is not.
    """
    if picture not in KINDS:
        raise unknown("picture", KINDS, at="picture", value=picture, error=OptionError)
    return KINDS[picture](study, record, figure)


def data_and_model(study: xr.Dataset, record: int | None, figure: Figure | None) -> Figure:
    """Draw readings on the model and its band, each observable by itself, and residuals below."""
    records = np.unique(study.record.values)
    if record is not None and record not in records:
        rule = f"expected a record from 1 to {records[-1]}"
        raise OptionError(rule, at="record", value=record)
    drawn = [record] if record is not None else records[:MOST].tolist()
    pairs = zip(study.channel.values, study.channel_unit.values, strict=True)
    names = {str(channel).partition("[")[0]: str(unit) for channel, unit in pairs}
    rows = len(names)
    figure = figure or new_figure(
        f"{study.attrs['title']}: readings and fitted motion",
        (4.0 + 2.4 * len(drawn), 2.4 + 3.2 * rows),
    )
    panels = figure.subplots(
        rows + 1, len(drawn), squeeze=False, sharex="col", sharey="row",
        height_ratios=(*(3,) * rows, 1.5),
    )  # fmt: skip
    for column, number in enumerate(drawn):
        part = study.isel(sample=study.record.values == number)
        _draw(panels[:, column], part, list(names))
        if len(records) > 1:
            panels[0, column].set_title(f"record {number}", fontsize=9)
        panels[-1, column].set_xlabel(with_units("time", "s"))
    for axes, (name, unit) in zip(panels[:, 0], names.items(), strict=False):
        axes.set_ylabel(with_units(in_symbols(name), unit))
    panels[-1, 0].set_ylabel("residual/noise")
    if study.attrs["lasting_gain"] > SEEN:
        note = "residuals are correlated: the model leaves something out"
        add_title(panels[-1, 0], "", note)
    figure.legend(
        *panels[-1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
        fontsize=8, frameon=False,
    )  # fmt: skip
    return figure_of(panels[0, 0])


def _draw(panels: Array, part: xr.Dataset, names: list[str]) -> None:
    """Draw one record: each observable on its band, and the residuals of all in the last panel."""
    below, confidence = panels[-1], part.attrs["confidence"]
    largest = max(3.0, below.get_ylim()[1])  # records share the axis
    width, share = stats.norm.ppf(0.5 + 0.5 * confidence), f"{100.0 * confidence:g} %"
    error = part.attrs["white"] + part.attrs["lasting"]
    channels = list(dict.fromkeys(map(str, part.channel.values)))
    for i, name in enumerate(channels):
        some = part.isel(sample=part.channel.values == name).sortby("sample_time")
        t, model, noise = some.sample_time.values, some.model.values, some.noise.values
        residual, motion = (some.data.values - model) / noise, some.model_deviation.values / noise
        largest = max(largest, 1.1 * float(np.abs(residual).max()))
        colour, mark, word = COLOURS[i % len(COLOURS)], "ox+"[i % 3], in_symbols(name)
        marks: Any = {"ls": "", "marker": mark, "mfc": "none", "mew": 0.6, "color": colour}
        above, is_last = panels[names.index(name.partition("[")[0])], name == channels[-1]
        above.plot(t, some.data.values, ms=3.5, **marks)
        above.plot(t, model, ("-", "--", ":")[i % 3], lw=1.2, color=colour)
        below.plot(t, residual, ms=3.0, label=f"readings of {word}", **marks)
        for axes, middle, by in ((above, model, width * noise), (below, 0.0, width)):
            reach, label = by * motion, f"{share} interval of the motion" if is_last else None
            axes.fill_between(t, middle - reach, middle + reach, color=BAND, lw=0, label=label)
            reach, label = (
                by * np.sqrt(motion**2 + error),
                f"{share} interval of readings" if is_last else None,
            )
            axes.plot(t, middle - reach, "-.", lw=0.6, color=GREY, label=label)
            axes.plot(t, middle + reach, "-.", lw=0.6, color=GREY)
    below.axhline(0.0, lw=0.8, color=GREY)
    below.set_ylim(-largest, largest)


def corner(study: xr.Dataset, record: int | None, figure: Figure | None) -> Figure:
    """Draw the density of each parameter, and the ellipse of each pair of them.

    Each cell reaches to WIDEST standard deviations, so the form of an ellipse is the correlation.
    """
    names, units, values, deviation, relative = shown_parameters(study, record)
    count = len(names)
    scale, small = 0.5 / WIDEST, float(np.clip(220.0 / count, 5.0, 9.0))
    size = float(np.clip(2.0 + 0.6 * count, 5.0, 14.0))
    title = f"{study.attrs['title']}: fitted parameters"
    figure = figure or new_figure(title, (size + 3.0, size))
    axes, (i, j) = figure.add_subplot(), np.tril_indices(count, -1)
    places, share = np.stack([j, i], axis=-1), relative[i, j]
    for level, fill in ((0.95, BAND), (0.5, CORE)):
        radius = 2.0 * scale * np.sqrt(stats.chi2.ppf(level, 2))
        widths = radius * np.sqrt(1.0 + share), radius * np.sqrt(np.maximum(0.0, 1.0 - share))
        axes.add_collection(EllipseCollection(
            *widths, 45.0, units="x", offsets=places, offset_transform=axes.transData,
            facecolor=fill, edgecolor=MEDIAN, linewidth=0.3,
        ))  # fmt: skip
    z = np.linspace(-WIDEST, WIDEST, 101)
    for k in range(count):
        axes.fill_between(k + scale * z, k + 0.5, k + 0.5 - 0.9 * np.exp(-0.5 * z**2), color=CORE)
    others = np.clip((values[1:] - values[0]) / deviation, -0.85 * WIDEST, 0.85 * WIDEST)
    for number, away in enumerate(others * scale, 2):
        style: Any = {"ls": "", "marker": f"${number}$", "ms": 0.8 * small, "color": PATH}
        axes.plot(j + away[j], i - away[i], **style)
    for row, column in np.argwhere(np.triu(np.ones_like(relative), 1)).tolist():
        number = relative[row, column]
        weight = "bold" if abs(number) > 0.9 else "normal"
        axes.text(
            column, row, _text(f"{number:.2f}"), ha="center", va="center", fontsize=small,
            weight=weight, color=INK,
        )  # fmt: skip
    edges = np.arange(count + 1) - 0.5
    axes.hlines(edges, -0.5, count - 0.5, color=LIGHT, lw=0.5)
    axes.vlines(edges, -0.5, count - 0.5, color=LIGHT, lw=0.5)
    numbers = [
        _text(f"{' ± '.join(in_digits(*pair))} {units_text(unit)}")
        for *pair, unit in zip(values[0], deviation, units, strict=True)
    ]
    axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), aspect="equal")
    axes.set_xticks(range(count), names, rotation=90, fontsize=small)
    axes.set_yticks(range(count), names, fontsize=small)
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(count), numbers, fontsize=small)
    for side in (axes, right):
        side.tick_params(length=0)
    more = "; red: other answers, at the edge if beyond" if len(others) else ""
    add_title(axes, f"50 and 95 % of each pair, and their correlation{more}")
    return figure_of(axes)


def shown_parameters(
    study: xr.Dataset, record: int | None
) -> tuple[list[str], list[str], Array, Array, Array]:
    """Return (symbols, units, values at each answer, standard deviations, correlations) of the
    parameters that the data show, with ratios in place of moments of which they show no more."""
    names, units = ([str(x) for x in study[key].values] for key in ("parameter", "unit"))
    value, deviation = study.value.values.copy(), study.deviation.values.copy()
    slopes = np.eye(len(names))
    is_shown, symbols = np.isfinite(deviation) & (deviation > 0.0), list[str]()
    for i, name in enumerate(names):
        own = re.search(r"\[(\d+)\]", name)
        is_shown[i] &= record is None or own is None or int(own[1]) == record
        words = f" of record {own[1]}" if own else ""
        symbols.append(in_symbols(re.sub(r"\[\d+\]", "", name)) + words)
    moments = [i for i, name in enumerate(names) if name in AXES]
    for i in moments[:2] if not is_shown[moments].any() else ():
        last = moments[2]
        ratio = value[:, i] / value[:, last]
        slopes[i, [i, last]] = np.array([1.0, -ratio[0]]) / value[0, last]
        deviation[i] = study.ratio_deviation.sel(moment=names[i], over=names[last])
        value[:, i], units[i], is_shown[i] = ratio, "1", np.isfinite(deviation[i])
        symbols[i] += f"/{symbols[last]}"
    some = np.flatnonzero(is_shown)[:SHOWN]
    covariance = slopes[some] @ study.covariance.values @ slopes[some].T
    size = np.sqrt(np.diag(covariance))
    names, units = ([words[i] for i in some] for words in (symbols, units))
    return names, units, value[:, some], deviation[some], covariance / np.outer(size, size)


def _text(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}").rstrip()


KINDS = {"data": data_and_model, "corner": corner}
