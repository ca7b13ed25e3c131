"""The picture of a fit: the data on the model, and the residuals."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.results.labels import in_symbols, with_units
from rigidmc.views.figures import COLOURS, GREY, INK, figure_of, new_figure

MOST = 4  # records drawn side by side


def data_and_model(
    study: xr.Dataset, record: int | None = None, figure: Figure | None = None
) -> Figure:
    """Draw the readings of each record on the fitted motion, and the residuals below, in units of
    their noise.

    study : the Dataset of `rigidmc.fit`
    """
    records = np.unique(study.record.values)
    drawn = [record] if record is not None else records[:MOST].tolist()
    figure = figure or new_figure(
        f"{study.attrs['title']}: readings and fitted motion", (4.0 + 2.4 * len(drawn), 5.6)
    )
    panels = figure.subplots(
        2, len(drawn), squeeze=False, sharex="col", sharey="row", height_ratios=(3, 1)
    )
    for column, number in enumerate(drawn):
        part = study.isel(sample=study.record.values == number)
        _draw(panels[0, column], panels[1, column], part)
        if len(records) > 1:
            panels[0, column].set_title(f"record {number}", fontsize=9)
        panels[1, column].set_xlabel(with_units("time", "s"))
    pairs = zip(study.channel.values, study.channel_unit.values, strict=True)
    names = {str(channel).partition("[")[0]: str(unit) for channel, unit in pairs}
    label = ", ".join(with_units(in_symbols(name), unit) for name, unit in names.items())
    panels[0, 0].set_ylabel(label)
    panels[1, 0].set_ylabel("residual/noise")
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8,
        frameon=False,
    )  # fmt: skip
    return figure_of(panels[0, 0])


def _draw(above: Axes, below: Axes, part: xr.Dataset) -> None:
    """Draw one record: data and model above, residuals below."""
    for i, name in enumerate(dict.fromkeys(map(str, part.channel.values))):
        some = part.channel.values == name
        t, data = part.sample_time.values[some], part.data.values[some]
        model, noise = part.model.values[some], part.noise.values[some]
        colour, style, mark = COLOURS[i % len(COLOURS)], ("-", "--", ":")[i % 3], "ox+"[i % 3]
        above.plot(t, data, mark, ms=3.5, mfc="none", mew=0.6, color=colour)
        above.plot(t, model, style, lw=1.2, color=colour, label=in_symbols(name))
        below.plot(t, (data - model) / noise, mark, ms=3.0, mfc="none", mew=0.6, color=colour)
    below.axhline(0.0, lw=0.8, color=GREY)
    above.tick_params(colors=INK)
