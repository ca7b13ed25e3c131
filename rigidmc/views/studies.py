"""Pictures of studies."""

from textwrap import fill

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from rigidmc.studies.accuracy import count, horizon_text
from rigidmc.views.ensemble import new_figure

# Told apart in grey by marker and dash; one colour for a family.
_STYLES = {
    "rk4": ("#d94801", "o", "-"), "rk8": ("#8c2d04", "s", "-"), "rkmk4": ("#7a7a7a", "^", ":"), "cf4": ("#7a7a7a", "v", ":"),
    "ck45": ("#7a7a7a", "<", ":"), "midpoint": ("#9e7bb5", "x", ":"), "strang": ("#2a9d6f", "P", "--"), "rotations": ("#2a9d6f", "X", "--"),
    "chin4": ("#2171b5", "D", "-"), "suzuki4": ("#6baed6", ">", "--"), "srkn6": ("#08519c", "p", "-"), "srkn11": ("#08306b", "h", "-"),
    "aba864": ("#4a1486", "d", "--"), "aba1064": ("#4a1486", "*", "--"), "exact": ("#000000", "H", "-"), "closed": ("#000000", "*", "-"),
}  # fmt: skip


def work_precision(study, figure=None):
    """Work against precision: one line for each integrator, members per second against the error that 99 % of members stay below.

    The slope of a line is 1/order; where it bends up it meets rounding. The frontier, drawn wide and grey behind, is the cheapest way to
    each error, with the step that gives it.

    study : the Dataset of `rigidmc.accuracy`
    """
    title = f"{study.attrs['title']}: what accuracy costs, {count_of(study)} to {study.attrs['t_end']:g} s"
    figure = figure or new_figure(title, (11.0, 7.2))
    axes = figure.add_subplot()
    names, kinds = study.integrator.values, study["dtype"].values
    error, speed = study.error_state_upper.values, study.members_per_second.values
    shown = np.isfinite(error) & (error < 3.0)
    pairs = zip(study.dt.values, study.turn.values, strict=True)
    steps = np.array([f"{dt:.2g} s" if np.isnan(turn) else f"{turn:.2g} rad" for dt, turn in pairs])
    _frontier(axes, error[shown], speed[shown], names[shown], kinds[shown], steps[shown])
    for name in dict.fromkeys(names):
        color, marker, dash = _STYLES.get(name, ("#444444", ".", "-"))
        for kind, filled in (("float64", color), ("float32", "white")):
            here = shown & (names == name) & (kinds == kind)
            if here.any():
                label = name if kind == "float64" else f"{name} in float32"
                axes.plot(
                    error[here],
                    speed[here],
                    marker=marker,
                    ls=dash if kind == "float64" else (0, (1, 1)),
                    ms=6,
                    lw=1.2,
                    color=color,
                    mfc=filled,
                    label=label,
                )
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="error of momentum [of its size] and attitude [rad], that 99 % of the members stay below",
    )
    axes.set_ylabel(f"members to t_end per second on {study.attrs['threads']} threads")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: count(v)))
    axes.invert_xaxis()
    known = study.attrs["truth_error"]
    if known > error[shown].min() / 30.0:
        axes.axvline(known, color="#999999", lw=0.8, ls=":")
        axes.annotate(
            "the truth is known\nto here",
            (known, 0.02),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            color="#555555",
            ha="right",
            xytext=(-4, 0),
            textcoords="offset points",
        )
    axes.grid(True, which="major", lw=0.3, color="#cccccc")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9, frameon=False)
    figure.get_layout_engine().set(rect=(0.0, 0.055, 1.0, 0.945))
    words = fill(f"Truth: {study.attrs['truth']}. {horizon_text(study).capitalize()}.", 170)
    figure.text(0.01, 0.008, words, fontsize=8, color="#444444")
    return figure


def count_of(study):
    """How many members, in words."""
    return "1 member" if study.attrs["members"] == 1 else f"{study.attrs['members']} members"


def _frontier(axes, error, speed, names, kinds, steps):
    """The cheapest way to each error, stepwise, with the name and step at its corners."""
    best, corners = -np.inf, []
    for i in np.argsort(error):
        if speed[i] > best:
            best = speed[i]
            corners.append(i)
    if not corners:
        return
    x, y = error[corners], speed[corners]
    axes.step(
        x,
        y,
        where="post",
        color="#d9d9d9",
        lw=9,
        solid_capstyle="round",
        zorder=0,
        label="frontier",
    )
    last, labelled = None, list[tuple[float, float]]()
    wide, high = (np.ptp(np.log10(v)) or 1.0 for v in (error, speed))
    for i in corners:
        what = names[i] if kinds[i] == "float64" else f"{names[i]} f32"
        here = np.log10(error[i]) / wide, np.log10(speed[i]) / high
        free = all(abs(here[0] - x) > 0.16 or abs(here[1] - y) > 0.035 for x, y in labelled)
        if what != last and free:  # one label does not hide another
            labelled.append(here)
            text = what if names[i] == "closed" else f"{what}, {steps[i]}"
            axes.annotate(
                text,
                (error[i], speed[i]),
                xytext=(3, 9),
                textcoords="offset points",
                fontsize=8,
                color="#222222",
            )
        last = what
    axes.margins(x=0.06, y=0.12)


def long_drift(study, figure=None):
    """Drift of energy, |L|^2 and L_z against the number of steps, for each integrator, with the law that fits.

    study : the Dataset of `rigidmc.studies.accuracy.long_drift`
    """
    shown = [name for name in ("energy", "l2", "lz") if study.attrs[f"{name}_conserved"] == "yes"]
    title = f"{study.attrs['title']}: drift over {study.step.values[-1]:,} steps of {study.attrs['dt']:.3g} s, worst of {study.attrs['members']} members"
    figure = figure or new_figure(title, (4.6 * len(shown) + 1.6, 5.6))
    words = {
        "energy": "energy, of the energies in play",
        "l2": "|L|$^2$, of its size",
        "lz": "L$_z$, of |L|",
    }
    for place, name in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), place + 1)
        for i, integrator in enumerate(study.integrator.values):
            color, marker, dash = _STYLES.get(integrator, ("#444444", ".", "-"))
            drift = study[f"{name}_drift"].values[i]
            label = f"{integrator}: {study[f'{name}_law'].values[i]}"
            axes.plot(
                study.step.values,
                np.maximum(drift, 1e-17),
                marker=marker,
                ls=dash,
                ms=5,
                lw=1.2,
                color=color,
                label=label,
            )
        axes.set(xscale="log", yscale="log", xlabel="steps", title=f"drift of {words[name]}")
        axes.grid(True, which="major", lw=0.3, color="#cccccc")
        axes.legend(fontsize=8, frameon=False)
    return figure


_VERDICTS = {1: ("#d9ead3", "good"), 2: ("#f6b26b", "above 0.3 of its bound"), 3: ("#999999", "not up to it"), 4: ("#a61c00", "above its bound"), 5: ("#000000", "crashed")}  # fmt: skip


def hard_cases(study, figure=None):
    """The catalogue as a heat map: a field for each case and integrator, coloured by error over bound, with the error's power of ten in it.

    study : the Dataset of `rigidmc.studies.stress.run.stress`
    """
    cases, names, groups = study.case.values, study.integrator.values, study.group.values
    figure = figure or new_figure(
        f"{len(cases)} hard cases: error over bound",
        (4.8 + 0.62 * len(names), 1.6 + 0.175 * len(cases)),
    )
    axes = figure.add_subplot()
    verdict, error = study.verdict.values, study.error.values
    colors = np.ones((*verdict.shape, 3))
    for code, (color, _) in _VERDICTS.items():
        colors[verdict == code] = to_rgb(color)
    axes.imshow(colors, aspect="auto", interpolation="none")
    for i, j in np.argwhere(verdict > 0):
        words = (
            "0" if error[i, j] == 0.0 else "X" if np.isnan(error[i, j]) else f"{error[i, j]:.0e}"
        )
        axes.text(
            j,
            i,
            words,
            ha="center",
            va="center",
            fontsize=6.5,
            color="white" if verdict[i, j] >= 4 else "#333333",
        )
    axes.set_xticks(range(len(names)), names, rotation=45, ha="left")
    axes.set_yticks(range(len(cases)), cases, fontsize=7.5)
    axes.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
    starts = [i for i in range(len(cases)) if i == 0 or groups[i] != groups[i - 1]]
    for start, stop in zip(starts, [*starts[1:], len(cases)], strict=True):
        axes.axhline(start - 0.5, color="#333333", lw=0.8)
        axes.annotate(
            groups[start],
            (1.005, 0.5 * (start + stop) - 0.5),
            xycoords=("axes fraction", "data"),
            fontsize=8,
            va="center",
        )
    shown = [
        (color, word)
        for code, (color, word) in _VERDICTS.items()
        if (verdict == code).any() or code in (1, 2, 4)
    ]
    handles = [Patch(facecolor=color, edgecolor="#666666", label=word) for color, word in shown]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False, title="number: the error; blank: not claimed", title_fontsize=8)  # fmt: skip
    return figure


def trust(study, figure=None):
    """The error of each check against time, worst member, with the two digits below which nothing is a result.

    study : the Dataset of `rigidmc.studies.trust.trust`
    """
    figure = figure or new_figure(f"{study.attrs['title']}: {study.attrs['verdict']}", (9.5, 5.6))
    axes = figure.add_subplot()
    dashes = {"accuracy": "-", "rounding": ":"}
    for i, name in enumerate(study.check.values):
        kind = str(study.tells.values[i])
        color, marker = list(_STYLES.values())[2 * i][0], "osD^vPX*"[i % 8]
        values = np.maximum(study.error.values[i], 1e-17)
        axes.plot(
            study.time.values,
            values,
            ls=dashes[kind],
            marker=marker,
            ms=4,
            lw=1.3,
            color=color,
            label=f"{name} ({kind})",
        )
    axes.axhline(1e-2, color="#a61c00", lw=0.8)
    axes.annotate("two digits are left", (1.0, 1e-2), xycoords=("axes fraction", "data"), xytext=(-4, 3), textcoords="offset points", ha="right", fontsize=8, color="#a61c00")  # fmt: skip
    axes.set(
        yscale="log",
        xlabel="time [s]",
        ylabel=f"error of the worst of {study.attrs['members']} members",
    )
    axes.grid(True, which="major", lw=0.3, color="#cccccc")
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
