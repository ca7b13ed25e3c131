"""The pictures of a fit: readings on the band of the model and their residuals, and the fitted
parameters with their correlations."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from scipy.special import ndtri

from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.arrays import Array
from rigidmc.results.labels import in_symbols, units_text, with_units
from rigidmc.studies.fit.dataset import AXES
from rigidmc.studies.fit.parameters import ratios, record_of
from rigidmc.studies.fit.table import in_digits
from rigidmc.studies.fit.uncertainty import SEEN
from rigidmc.views.figures import BAND, COLOURS, CORE, GREY, PATH, add_title, figure_of, new_figure

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
    units = {str(channel).partition("[")[0]: str(unit) for channel, unit in pairs}
    size = 4.0 + 2.4 * len(drawn), 2.4 + 3.2 * len(units)
    title = f"{study.attrs['title']}: readings and fitted motion"
    figure = figure or new_figure(title, size)
    panels = figure.subplots(
        len(units) + 1, len(drawn), squeeze=False, sharex="col", sharey="row",
        height_ratios=(*[3.0] * len(units), 1.5),
    )  # fmt: skip
    for column, number in zip(panels.T, drawn, strict=True):
        _draw(column, study.isel(sample=study.record.values == number), list(units))
        if len(records) > 1:
            column[0].set_title(f"record {number}", fontsize=9)
        column[-1].set_xlabel(with_units("time", "s"))
    for axes, (name, unit) in zip(panels[:, 0], units.items(), strict=False):
        axes.set_ylabel(with_units(in_symbols(name), unit))
    below = panels[-1, 0]
    below.set_ylabel("residual/noise")
    if study.attrs["lasting_gain"] > SEEN:
        add_title(below, "", "residuals are correlated: the model leaves something out")
    handles, labels = below.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(
        once.values(), once, loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    return figure_of(below)


def _draw(panels: Array, part: xr.Dataset, names: list[str]) -> None:
    """Draw one record: each observable on its band, and the residuals of all in the last panel."""
    below, confidence = panels[-1], part.attrs["confidence"]
    largest = max(3.0, below.get_ylim()[1])  # records share the axis
    width, share = ndtri(0.5 + 0.5 * confidence), f"{100.0 * confidence:g} % interval of"
    error = part.attrs["white"] + part.attrs["lasting"]
    for i, name in enumerate(dict.fromkeys(map(str, part.channel.values))):
        some = part.isel(sample=part.channel.values == name).sortby("sample_time")
        t, model, noise = some.sample_time.values, some.model.values, some.noise.values
        residual, motion = (some.data.values - model) / noise, some.model_deviation.values / noise
        largest = max(largest, 1.1 * float(np.abs(residual).max()))
        above, reach = panels[names.index(name.partition("[")[0])], np.sqrt(motion**2 + error)
        for axes, middle, by in ((above, model, width * noise), (below, 0.0, width)):
            band = middle - by * motion, middle + by * motion
            axes.fill_between(t, *band, color=BAND, lw=0, label=f"{share} the motion")
            ends = np.transpose([middle - by * reach, middle + by * reach])
            axes.plot(t, ends, "-.", lw=0.6, color=GREY, label=f"{share} readings")
        style: Any = {"color": COLOURS[i % len(COLOURS)], "mfc": "none", "mew": 0.6}
        above.plot(t, some.data.values, "ox+s^v"[i % 6], ms=3.5, **style)
        above.plot(t, model, ("-", "--", ":")[i % 3], lw=1.2, **style)
        label = f"readings of {in_symbols(name)}"
        below.plot(t, residual, "ox+s^v"[i % 6], ms=3.0, label=label, **style)
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
    for level, fill in ((0.95, BAND), (0.5, CORE)):
        radius = 2.0 * scale * np.sqrt(-2.0 * np.log(1.0 - level))
        wide, high = (radius * np.sqrt(np.maximum(0.0, 1.0 + s * relative[i, j])) for s in (1, -1))
        axes.add_collection(EllipseCollection(
            wide, high, 45.0, units="x", offsets=np.stack([j, i], axis=-1),
            offset_transform=axes.transData, facecolor=fill, edgecolor="black", linewidth=0.3,
        ))  # fmt: skip
    z = np.linspace(-WIDEST, WIDEST, 101)
    for k in range(count):
        axes.fill_between(k + scale * z, k + 0.5, k + 0.5 - 0.9 * np.exp(-0.5 * z**2), color=CORE)
    others = np.clip((values[1:] - values[0]) / deviation, -0.85 * WIDEST, 0.85 * WIDEST)
    for number, away in enumerate(others * scale, 2):
        style: Any = {"ls": "", "marker": f"${number}$", "ms": 0.8 * small, "color": PATH}
        axes.plot(j + away[j], i - away[i], **style)
    middle: Any = {"ha": "center", "va": "center", "fontsize": small}
    for x, y in zip(i.tolist(), j.tolist(), strict=True):
        weight = "bold" if abs(relative[x, y]) > 0.9 else "normal"
        axes.text(x, y, _text(f"{relative[x, y]:.2f}"), weight=weight, **middle)
    edges = np.arange(count + 1) - 0.5
    axes.hlines(edges, -0.5, count - 0.5, color=GREY, lw=0.3)
    axes.vlines(edges, -0.5, count - 0.5, color=GREY, lw=0.3)
    axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), aspect="equal")
    axes.set_xticks(range(count), names, rotation=90, fontsize=small)
    axes.set_yticks(range(count), names, fontsize=small)
    right = axes.secondary_yaxis("right")
    each = zip(values[0], deviation, units, strict=True)
    numbers = [_text(f"{' ± '.join(in_digits(x, d))} {units_text(unit)}") for x, d, unit in each]
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
    value, deviation = study.value.values.copy(), study.deviation.values.copy()
    slopes, units = np.eye(deviation.size), study.unit.values.astype(object)
    owners = [record_of(str(name)) for name in study.parameter.values]
    symbols = [in_symbols(name) + (f" of record {own}" if own else "") for name, own in owners]
    is_drawn = np.array([not own or record in (None, own) for _, own in owners])
    is_drawn &= np.isfinite(deviation) & (deviation > 0.0)
    moments = np.flatnonzero(study.parameter.isin(AXES))
    if moments.size and not is_drawn[moments].any():
        i, last = moments[:2], moments[[2, 2]]
        slopes[i] = ratios(value[0], slopes, i, last)[1]
        value[:, i] /= value[:, last]
        deviation[i], units[i] = study.ratio_deviation[:2, 2], "1"
        is_drawn[i] = np.isfinite(deviation[i])
        for k in i:
            symbols[k] += f"/{symbols[last[0]]}"
    some = np.flatnonzero(is_drawn)[:SHOWN]
    covariance = slopes[some] @ study.covariance.values @ slopes[some].T
    size = np.sqrt(np.diag(covariance))
    names = [symbols[k] for k in some]
    relative = covariance / np.outer(size, size)
    return names, units[some].tolist(), value[:, some], deviation[some], relative


def _text(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}").rstrip()


KINDS = {"data": data_and_model, "corner": corner}
