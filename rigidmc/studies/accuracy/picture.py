"""Pictures of an accuracy study: work-precision diagram, and drift over many steps."""

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from rigidmc.inputs.amounts import two_digits
from rigidmc.results.labels import count_text, with_units
from rigidmc.studies.accuracy.work_precision import horizon_text
from rigidmc.views.figures import GREY, INK, LIGHT, new_figure, style_of


def accuracy_picture(study: xr.Dataset) -> Figure:
    """Draw the picture that suits a study."""
    return (long_drift if "step" in study.dims else work_precision)(study)


def work_precision(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw members per second against the upper bound of the error of 99 % of the members.

    Each integrator has one line, of slope 1/order; it bends up where it meets rounding. The wide
    grey line shows the cheapest integrator and step for each error.

    study : the Dataset of `rigidmc.accuracy`
    """
    to = f"{study.attrs['t_end']:g} s"
    members = count_text(study.attrs["members"], "member")
    title = f"{study.attrs['title']}: cost of accuracy, {members} to {to}"
    figure = figure or new_figure(title, (11.0, 7.2))
    axes = figure.add_subplot()
    error = study.error_state_upper.values
    shown = np.isfinite(error) & (error < 3.0)
    _frontier(axes, study.isel(row=shown))
    for name in dict.fromkeys(study.integrator.values):
        _work_precision_lines(axes, study.isel(row=shown & (study.integrator.values == name)), name)
    what = f"error of momentum [relative] and {with_units('attitude', 'rad')}"
    axes.set(xscale="log", yscale="log", xlabel=f"{what}, upper bound for 99 % of the members")
    axes.set_ylabel(
        f"members to the end per second on {count_text(study.attrs['threads'], 'thread')}"
    )
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: two_digits(v)))
    axes.invert_xaxis()
    limit = study.attrs["truth_error"]
    if limit > error[shown].min() / 30.0:
        axes.axvline(limit, color=GREY, lw=0.8, ls=":")
        axes.annotate(
            "error of\nthe truth", (limit, 0.02), xycoords=("data", "axes fraction"), fontsize=8,
            color=GREY, ha="right", xytext=(-4, 0), textcoords="offset points",
        )  # fmt: skip
    axes.grid(True, which="major", lw=0.3, color=LIGHT)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9, frameon=False)
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, 0.055, 1.0, 0.945))
    words = fill(f"Truth: {study.attrs['truth']}. {horizon_text(study).capitalize()}.", 170)
    figure.text(0.01, 0.008, words, fontsize=8, color=INK)
    return figure


def _work_precision_lines(axes: Axes, rows: xr.Dataset, name: str) -> None:
    """Draw the lines of one integrator, in float64 and float32."""
    style = style_of(name)
    for kind, fill_color in (("float64", style.color), ("float32", "white")):
        part = rows.isel(row=rows["dtype"].values == kind)
        if part.sizes["row"]:
            axes.plot(
                part.error_state_upper.values,
                part.members_per_second.values,
                marker=style.marker,
                ls=style.dash if kind == "float64" else (0, (1, 1)),
                ms=6,
                lw=1.2,
                color=style.color,
                mfc=fill_color,
                label=name if kind == "float64" else f"{name} in float32",
            )


def _frontier(axes: Axes, rows: xr.Dataset) -> None:
    """Draw the cheapest choice for each error as a staircase, with name and step at its corners."""
    error, speed = rows.error_state_upper.values, rows.members_per_second.values
    corners: list[int] = []
    for i in np.argsort(error):
        if not corners or speed[i] > speed[corners[-1]]:
            corners.append(int(i))
    if not corners:
        return
    x, y = error[corners], speed[corners]
    style: dict[str, Any] = {"color": LIGHT, "lw": 9, "solid_capstyle": "round", "zorder": 0}
    axes.step(x, y, where="post", label="frontier", **style)
    last, labelled = None, list[tuple[float, float]]()
    # decades
    width, height = (np.ptp(np.log10(v)) or 1.0 for v in (error, speed))
    for i in corners:
        row = rows.isel(row=i)
        name, dt, turn = str(row.integrator.values), float(row.dt), float(row.turn)
        what = name if row["dtype"].values == "float64" else f"{name} f32"
        here = np.log10(error[i]) / width, np.log10(speed[i]) / height
        free = all(abs(here[0] - x) > 0.16 or abs(here[1] - y) > 0.035 for x, y in labelled)
        if what != last and free:  # avoid overlapping labels
            labelled.append(here)
            step = f"{dt:.2g} s" if np.isnan(turn) else f"{turn:.2g} rad"
            axes.annotate(
                what if name == "closed" else f"{what}, {step}",
                (error[i], speed[i]),
                xytext=(3, 9),  # no line passes at the upper right of the frontier
                textcoords="offset points",
                fontsize=8,
                color=INK,
            )
        last = what
    axes.margins(x=0.13, y=0.12)  # for the rightmost label


def long_drift(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Draw the drift of energy, |L|^2 and L_z against steps, with the growth law of each
    integrator.

    study : the Dataset of `rigidmc.studies.accuracy.drift.long_drift`
    """
    words = {"energy": "energy / energies involved", "l2": "|L|², relative", "lz": "L_z / |L|"}
    shown = [name for name in words if study.attrs[f"{name}_conserved"] == "yes"]
    steps = f"{study.step.values[-1]:,} steps of {study.attrs['dt']:.3g} s"
    members = count_text(study.attrs["members"], "member")
    title = f"{study.attrs['title']}: drift over {steps}, worst of {members}"
    figure = figure or new_figure(title, (4.6 * len(shown) + 1.6, 5.6))
    for place, name in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), place + 1)
        for i, integrator in enumerate(study.integrator.values):
            style = style_of(integrator)
            axes.plot(
                study.step.values,
                np.maximum(study[f"{name}_drift"].values[i], 1e-17),
                marker=style.marker,
                ls=style.dash,
                ms=5,
                lw=1.2,
                color=style.color,
                label=f"{integrator}: {study[f'{name}_law'].values[i]}",
            )
        axes.set(xscale="log", yscale="log", xlabel="steps", title=f"drift of {words[name]}")
        axes.set_ylabel("largest drift so far")
        axes.grid(True, which="major", lw=0.3, color=LIGHT)
        axes.legend(fontsize=8, frameon=False)
    return figure
