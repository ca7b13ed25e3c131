"""Pictures of studies: accuracy, drift, hard cases, trust."""

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from rigidmc.scene.amounts import in_two_digits
from rigidmc.studies.accuracy import horizon_text
from rigidmc.studies.stress.run import AMBER, VERDICTS
from rigidmc.views.figure import ALARM, COLOURS, GREY, INK, LIGHT, MARKERS, new_figure
from rigidmc.views.styles import style_of


def work_precision(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Members per second against the error that 99 % of members stay below.

    One line per integrator, of slope 1/order; it bends up where it meets rounding. The wide grey
    line is the cheapest way to each error, with its steps.

    study : the Dataset of `rigidmc.accuracy`
    """
    to = f"{study.attrs['t_end']:g} s"
    title = f"{study.attrs['title']}: what accuracy costs, {count_of(study)} to {to}"
    figure = figure or new_figure(title, (11.0, 7.2))
    axes = figure.add_subplot()
    error = study.error_state_upper.values
    shown = np.isfinite(error) & (error < 3.0)
    _frontier(axes, study.isel(row=shown))
    for name in dict.fromkeys(study.integrator.values):
        _work_precision_lines(axes, study.isel(row=shown & (study.integrator.values == name)), name)
    what = "error of momentum [of its size] and attitude [rad]"
    axes.set(xscale="log", yscale="log", xlabel=f"{what}, that 99 % of the members stay below")
    axes.set_ylabel(f"members to t_end per second on {study.attrs['threads']} threads")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: in_two_digits(v)))
    axes.invert_xaxis()
    known = study.attrs["truth_error"]
    if known > error[shown].min() / 30.0:
        axes.axvline(known, color=GREY, lw=0.8, ls=":")
        axes.annotate(
            "the truth is known\nto here",
            (known, 0.02),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            color=GREY,
            ha="right",
            xytext=(-4, 0),
            textcoords="offset points",
        )
    axes.grid(True, which="major", lw=0.3, color=LIGHT)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9, frameon=False)
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, 0.055, 1.0, 0.945))
    words = fill(f"Truth: {study.attrs['truth']}. {horizon_text(study).capitalize()}.", 170)
    figure.text(0.01, 0.008, words, fontsize=8, color=INK)
    return figure


def count_of(study: xr.Dataset) -> str:
    """The number of members in words."""
    return "1 member" if study.attrs["members"] == 1 else f"{study.attrs['members']} members"


def _work_precision_lines(axes: Axes, rows: xr.Dataset, name: str) -> None:
    """The lines of one integrator, in float64 and float32."""
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
    """The cheapest way to each error as a staircase, with name and step at its corners."""
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
        if what != last and free:  # labels must not hide each other
            labelled.append(here)
            step = f"{dt:.2g} s" if np.isnan(turn) else f"{turn:.2g} rad"
            axes.annotate(
                what if name == "closed" else f"{what}, {step}",
                (error[i], speed[i]),
                xytext=(3, 9),  # at the upper right of the frontier no line passes
                textcoords="offset points",
                fontsize=8,
                color=INK,
            )
        last = what
    axes.margins(x=0.13, y=0.12)  # for the rightmost label


def long_drift(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """Drift of energy, |L|^2 and L_z against steps, with the law that fits each integrator.

    study : the Dataset of `rigidmc.studies.drift.long_drift`
    """
    words = {
        "energy": "energy, of the energies in play",
        "l2": "|L|$^2$, of its size",
        "lz": "L$_z$, of |L|",
    }
    shown = [name for name in words if study.attrs[f"{name}_conserved"] == "yes"]
    steps = f"{study.step.values[-1]:,} steps of {study.attrs['dt']:.3g} s"
    title = f"{study.attrs['title']}: drift over {steps}, worst of {study.attrs['members']} members"
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
        axes.grid(True, which="major", lw=0.3, color=LIGHT)
        axes.legend(fontsize=8, frameon=False)
    return figure


# {verdict: (colour, words)} of `rigidmc.studies.stress.run.VERDICTS`; "not claimed" stays white
_VERDICTS = {
    "good": ("#d9ead3", "good"),
    "close": ("#f6b26b", f"above {AMBER:g} of its bound"),
    "not up to it": ("#999999", "not up to it"),
    "not judged": ("#cfe2f3", "no bound"),
    "above": (ALARM, "above its bound"),
    "crashed": ("#000000", "crashed"),
}
_ALWAYS = ("good", "close", "above")  # in the legend even if no case has them


def hard_cases(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """The hard cases as a heat map of error over bound, with the error in each field.

    study : the Dataset of `rigidmc.studies.stress.run.stress`
    """
    cases, names = study.case.values, study.integrator.values
    size = 4.8 + 0.62 * len(names), 1.6 + 0.175 * len(cases)
    figure = figure or new_figure(f"{len(cases)} hard cases: error over bound", size)
    axes = figure.add_subplot()
    verdict, error = np.array(VERDICTS)[study.verdict.values], study.error.values
    colors = np.ones((*verdict.shape, 3))
    for word, (color, _) in _VERDICTS.items():
        colors[verdict == word] = to_rgb(color)
    axes.imshow(colors, aspect="auto", interpolation="none")
    for i, j in np.argwhere(verdict != "not claimed"):
        value = error[i, j]
        words = "0" if value == 0.0 else "X" if np.isnan(value) else f"{value:.0e}"
        color = "white" if verdict[i, j] in ("above", "crashed") else INK
        axes.text(j, i, words, ha="center", va="center", fontsize=6.5, color=color)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="left")
    axes.set_yticks(range(len(cases)), cases, fontsize=7.5)
    axes.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
    _groups(axes, study.group.values)
    handles = [
        Patch(facecolor=color, edgecolor=GREY, label=words)
        for word, (color, words) in _VERDICTS.items()
        if (verdict == word).any() or word in _ALWAYS
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=8,
        frameon=False,
        title="number: the error; blank: not claimed",
        title_fontsize=8,
    )
    return figure


def _groups(axes: Axes, groups: NDArray[Any]) -> None:
    """A line above each group of cases, and its name at the right."""
    starts = [i for i in range(len(groups)) if i == 0 or groups[i] != groups[i - 1]]
    for start, stop in zip(starts, [*starts[1:], len(groups)], strict=True):
        axes.axhline(start - 0.5, color=INK, lw=0.8)
        axes.annotate(
            groups[start],
            (1.005, 0.5 * (start + stop) - 0.5),
            xycoords=("axes fraction", "data"),
            fontsize=8,
            va="center",
        )


def trust(study: xr.Dataset, figure: Figure | None = None) -> Figure:
    """The error of each check against time for the worst member, and the limit of two digits.

    study : the Dataset of `rigidmc.studies.trust.trust`
    """
    title = f"{study.attrs['title']}: {study.attrs['verdict']}"
    figure = figure or new_figure(title, (9.5, 5.6))
    axes = figure.add_subplot()
    dashes = {"accuracy": "-", "rounding": ":"}
    for i, (name, kind) in enumerate(zip(study.check.values, study.tells.values, strict=True)):
        axes.plot(
            study.time.values,
            np.maximum(study.error.values[i], 1e-17),
            ls=dashes[kind],
            marker=MARKERS[i % len(MARKERS)],
            ms=4,
            lw=1.3,
            color=COLOURS[i % len(COLOURS)],
            label=f"{name} ({kind})",
        )
    axes.axhline(1e-2, color=ALARM, lw=0.8)
    axes.annotate(
        "two digits are left",
        (1.0, 1e-2),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=ALARM,
    )
    worst = f"error of the worst of {study.attrs['members']} members"
    axes.set(yscale="log", xlabel="time [s]", ylabel=worst)
    axes.grid(True, which="major", lw=0.3, color=LIGHT)
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
