"""Pictures of an ensemble, one function each: the only importer of matplotlib. A picture is a Figure; pyplot is left alone.

All take a Dataset of simulate() and, to draw into a figure of one's own, its axes. They read evenly spaced members and times, so
that a million members take seconds; of the drifts, all. A flagged member (status not 0) is in no picture: the heading of a new
figure counts them. ValueError where a picture has nothing to draw, with what to save.
"""

import io
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter

from rigidmc.files.outputs import check_suffix, refuse_existing, write_bytes
from rigidmc.views.sphere import central_axis, density, lambert, polhodes

TIMES, MEMBERS, POINTS = (
    400,
    20_000,
    2_000_000,
)  # read are TIMES saves at most, and MEMBERS members, or more up to POINTS vectors
DRAWN = 4  # members drawn one by one: more are spaghetti
COARSE = 0.8  # mean cosine of the turn from one save to the next; below it a path is dots, as lines would cut its corners
SWINGS = 25  # where members turn back more often than this, only one is drawn: of the few, the one that swings widest
DENSITY, INK, PATH, BAND, CORE, MEDIAN = (
    "cividis_r",
    "#222222",
    "#d94801",
    "#c6dbef",
    "#6baed6",
    "#08306b",
)
HALO = [withStroke(linewidth=2.0, foreground="white")]


def summary(ds, figure=None):
    """The picture of a run: momentum sphere, with attitude also the axis in space, middle component against time, drifts.

    With fewer than three saves of omega or momentum, the spread at the start and at the end stands in for the time series.
    """
    spheres = [momentum_sphere, axis_sphere] if "attitude" in ds else [momentum_sphere]
    figure = figure or _figure(ds, (13.0, 8.0) if len(spheres) > 1 else (10.0, 8.0))
    if not (ds.status.values == 0).any():
        figure.text(0.5, 0.5, "nothing to draw: every member is flagged", ha="center")
        return figure
    sample, grid = _sample(ds), figure.add_gridspec(2, 1, height_ratios=[1.15, 1.0])
    for place, picture in zip(grid[0].subgridspec(1, len(spheres)), spheres, strict=True):
        picture(sample, figure.add_subplot(place))
    left, right = grid[1].subgridspec(1, 2, width_ratios=[1.4, 1.0])
    series = ("omega" in ds or "momentum" in ds) and ds.sizes["time"] > 2
    (middle_component if series else start_and_end)(sample, figure.add_subplot(left))
    drift_histogram(ds, figure.add_subplot(right))
    return figure


def momentum_sphere(ds, axes=None):
    """Where the angular momentum points in the body: density on the momentum sphere, with the paths of a few members.

    Two hemispheres in Lambert's equal-area projection, seen from both ends of the axis of the middle moment (a symmetric top: of
    its symmetry axis); where all stay inside a cap, the cap alone. All saves are shown together; where there are two, the last.
    The path of a free body is its polhode, the curve of constant energy and |L|^2 through its start; with torques it is the saves.
    Where all members are one asymmetric body, its separatrices 2 T I_mid = L^2 are drawn: great circles, here straight lines.

    ds : with omega or momentum; else start_omega or start_momentum is shown, and the title says so
    """
    sample = _sample(ds)
    l, when = _vectors(sample, "momentum")
    moments = sample.moments.values
    body = np.median(moments, axis=1)
    turn = np.roll(
        np.arange(3), 2 - central_axis(body)
    )  # the axes that point right, up and at the reader
    right, up, toward = body[turn]
    with np.errstate(all="ignore"):
        slope = np.sqrt((toward / right - 1.0) / (1.0 - toward / up))
    one_body = np.ptp(moments, axis=1).max() <= 1e-12 * body.max()
    axes = axes or _figure(ds, (8.0, 5.2)).add_subplot()
    kept = all(
        sample[f"{name}_drift_max"].attrs.get("conserved") == "yes" for name in ("energy", "l2")
    )
    free = kept and "work" not in ds
    few = _few(l)
    paths = polhodes(l[0][:, few], moments[:, few]) if free else l[..., few]
    lines = [slope, -slope] if one_body and 0.0 < slope < np.inf else []
    v = l if len(l) > 2 else l[-1:]
    _hemispheres(axes, v[:, turn], paths[:, turn], [str(axis + 1) for axis in turn], lines)
    axes.set_title(f"Direction of the angular momentum in body axes, {when}", fontsize=10)
    return axes.figure


def axis_sphere(ds, axes=None):
    """Where axis 3 of the body points in space: density on the unit sphere, from above (+z) and below, with a few members' paths.

    The third column of A, (2(xz + wy), 2(yz - wx), w^2 - x^2 - y^2 + z^2), projected and chosen in time as in `momentum_sphere`.

    ds : with attitude
    """
    if "attitude" not in ds:
        raise ValueError(
            'axis_sphere needs the attitude, which was not saved: run with save=("attitude",)'
        )
    sample = _sample(ds)
    w, x, y, z = np.moveaxis(sample.attitude.transpose("time", "quat", "member").values, 1, 0)
    e3 = np.stack(
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=1
    )
    axes = axes or _figure(ds, (8.0, 5.2)).add_subplot()
    _hemispheres(axes, e3 if len(e3) > 2 else e3[-1:], e3[..., _few(e3)], ["x", "y", "z"])
    axes.set_title(f"Axis 3 of the body in space, {_span(sample)}", fontsize=10)
    return axes.figure


def middle_component(ds, axes=None):
    """The angular velocity about the axis of the middle moment against time: median, quantile bands and a few members.

    ds : with omega or momentum at three times or more
    """
    sample = _sample(ds)
    omega, _ = _vectors(sample, "omega")
    if len(omega) < 3:
        raise ValueError(
            'middle_component needs omega at three times or more: run with every=... and save=("omega",)'
        )
    moments, t = sample.moments.values, sample.time.values
    axis = np.argsort(moments, axis=0, kind="stable")[1]
    value = np.take_along_axis(omega, axis[None, None], axis=1)[:, 0]
    low, quarter, median, three_quarters, high = np.quantile(
        value, [0.05, 0.25, 0.5, 0.75, 0.95], axis=1
    )
    axes = axes or _figure(ds, (7.0, 4.2)).add_subplot()
    axes.fill_between(t, low, high, color=BAND, linewidth=0, label="5 to 95 %")
    axes.fill_between(t, quarter, three_quarters, color=CORE, linewidth=0, label="25 to 75 %")
    axes.plot(t, median, color=MEDIAN, linewidth=2.0, label="median")
    few = value[:, _few(value)]
    if np.count_nonzero(np.diff(np.sign(np.diff(few, axis=0)), axis=0)) > SWINGS * few.shape[1]:
        few = few[:, np.argmax(np.ptp(few, axis=0)), None]
    for k, line in enumerate(axes.plot(t, few, color=PATH, linewidth=0.8)):
        line.set_label("_" if k else "one member" if few.shape[1] == 1 else "single members")
    name = f"\\omega_{axis[0] + 1}" if np.ptp(axis) == 0 else "\\omega_\\mathrm{mid}"
    axes.set(xlabel="time [s]", ylabel=f"${name}$ [rad/s]", xlim=(t[0], t[-1]))
    symmetric = central_axis(np.median(moments, axis=1)) != axis[0]
    where = "across the symmetry axis" if symmetric else "about the axis of the middle moment"
    axes.set_title(f"Angular velocity {where}", fontsize=10, pad=20)
    _legend_above(axes, ncols=4)
    return axes.figure


def start_and_end(ds, axes=None):
    """How each component of the angular velocity is spread at the start and at the end; each histogram is scaled to its own peak.

    ds : with omega or momentum; else start_omega or start_momentum is shown alone
    """
    sample = _sample(ds)
    omega, when = _vectors(sample, "omega")
    names = {0: when} if len(omega) == 1 else {0: _span(sample, 0), -1: _span(sample, -1)}
    edges = (
        np.linspace(omega.min(), omega.max(), 102)
        if np.ptp(omega)
        else omega.min() + np.linspace(-0.5, 0.5, 102)
    )
    axes = axes or _figure(ds, (7.0, 4.2)).add_subplot()
    for row in range(3):
        for time, name in names.items():
            count = np.histogram(omega[time, row], edges)[0]
            style = {"color": MEDIAN, "linewidth": 1.2} if time else {"color": BAND, "fill": True}
            axes.stairs(
                0.85 * count / count.max() - row,
                edges,
                baseline=-row,
                label=None if row else name,
                **style,
            )
    axes.set(
        xlabel="angular velocity, body axes [rad/s]",
        ylabel="members, each row to its peak",
        ylim=(-2.1, 1.0),
    )
    axes.set_yticks([0, -1, -2], [f"$\\omega_{i}$" for i in (1, 2, 3)])
    axes.set_title("Spread of the angular velocity", fontsize=10, pad=20)
    _legend_above(axes, ncols=2)
    return axes.figure


def drift_histogram(ds, axes=None):
    """Histograms of energy_drift_max and l2_drift_max over all members, on logarithmic axes, with median and worst.

    A drift of exactly 0 has no place on the axis: the legend counts them. Where physics does not conserve a quantity (its attribute
    `conserved`), the title says why.
    """
    axes = axes or _figure(ds, (7.0, 4.2)).add_subplot()
    drifts = {"E - work" if "work" in ds else "E": ds.energy_drift_max, "$|L|^2$": ds.l2_drift_max}
    values = {
        symbol: drift.values[(ds.status.values == 0) & np.isfinite(drift.values)]
        for symbol, drift in drifts.items()
    }
    decades = np.concatenate([np.log10(v[v > 0.0]) for v in values.values()])
    first, last = (
        (np.floor(decades.min()), np.floor(decades.max()) + 1) if decades.size else (-17, -15)
    )
    edges = 10.0 ** np.linspace(first, last, round(10 * (last - first)) + 1)
    title, top = ["Largest relative drift of each member"], 5
    styles = ({"color": CORE, "fill": True}, MEDIAN), ({"color": INK, "linewidth": 1.2}, INK)
    for (symbol, v), (style, color) in zip(values.items(), styles, strict=True):
        zeros, worst, middle = (
            np.count_nonzero(v == 0.0),
            v.max(initial=0.0),
            np.median(v) if v.size else 0.0,
        )
        label = f"{symbol}: median (¦) {middle:.1e}, worst (▾) {worst:.1e}" + (
            f"; {_members(zeros)} at 0" if zeros else ""
        )
        count = np.histogram(v, edges)[0]
        top = max(top, count.max())
        axes.stairs(count, edges, label=label, **style)
        if worst > 0.0:
            axes.axvline(max(middle, edges[0]), color=color, linestyle="--", linewidth=1.0)
            axes.plot(
                worst, 0.03, "v", color=color, markersize=7, transform=axes.get_xaxis_transform()
            )
        conserved = drifts[symbol].attrs.get("conserved", "yes")
        if conserved != "yes":
            title.append(
                fill(f"{symbol} is not conserved: {conserved.removeprefix('no').lstrip(':, ')}", 62)
            )
    axes.set(
        xlabel="largest relative drift [1]",
        ylabel="members per bin",
        xlim=(edges[0], edges[-1]),
        ylim=(0.7, 2 * top),
    )
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title("\n".join(title), fontsize=10 if len(title) == 1 else 9, pad=32)
    _legend_above(axes, ncols=1)
    return axes.figure


def save(figure, path, force=False):
    """Write a picture by its suffix, whole or not at all; OutputExists where a file is there and not `force`, OptionError as `check_suffix`."""
    refuse_existing(path, force, "pictures")
    write_bytes(path, drawn(figure, path), force)


def drawn(figure, path):
    """The bytes of a picture of the kind that a path names; OptionError as `check_suffix`."""
    check_suffix(path, "pictures")
    made = io.BytesIO()
    figure.savefig(made, dpi=150, format=Path(path).suffix[1:].lower())
    return made.getvalue()


def _sample(ds):
    """Evenly spaced members and times, in memory, without flagged members; a sample of a sample is the sample."""
    times, members = ds.sizes.get("time", 1), ds.sizes["member"]
    every, stride = -(-times // TIMES), -(-members // max(MEMBERS, POINTS // min(times, TIMES)))
    states = [
        name
        for name in ("omega", "momentum", "attitude", "start_omega", "start_momentum")
        if name in ds
    ]
    even = {
        "time": slice((times - 1) % every, None, every),
        "member": slice(None, None, stride),
    }  # the last time is kept
    sample = (
        ds[[*states, "moments", "status", "energy_drift_max", "l2_drift_max"]]
        .isel(even, missing_dims="ignore")
        .load()
    )
    good = sample.status == 0
    for name in states:
        good = good & np.isfinite(sample[name]).all(
            [dim for dim in sample[name].dims if dim != "member"]
        )
    if not good.any():
        raise ValueError(
            f"nothing to draw: all of the {good.size:,} members looked at are flagged or not finite"
        )
    return sample if good.all() else sample.isel(member=good.values)


def _vectors(sample, name):
    """omega or momentum (time, axis, member), from either by L_i = I_i omega_i, or else at the start; and its times in words."""
    for prefix in ("", "start_"):
        for found in ("omega", "momentum"):
            if prefix + found in sample:
                v = sample[prefix + found].transpose(..., "axis", "member").values
                v = v if v.ndim == 3 else v[None]
                moments = sample.moments.transpose("axis", "member").values
                v = v if found == name else v * moments if name == "momentum" else v / moments
                return v, "at the start (nothing later was saved)" if prefix else _span(sample)
    raise ValueError(
        'nothing to draw: neither omega nor momentum, not even at the start: run with save=("omega",)'
    )


def _span(sample, save=None):
    t = sample.time.values
    return (
        f"t = {t[0]:,.7g} to {t[-1]:,.7g} s"
        if save is None and t.size > 2
        else f"t = {t[-1 if save is None else save]:,.7g} s"
    )


def _members(count):
    return f"{count:,} member{'' if count == 1 else 's'}"


def _few(values):
    """DRAWN members, evenly spaced over the last axis."""
    return np.unique(np.linspace(0, values.shape[-1] - 1, DRAWN).round().astype(int))


def _hemispheres(axes, v, paths, names, slopes=()):
    """Density of v and lines along paths, both (time, axis, member), on two discs or one cap; axes right, up and at the reader."""
    with np.errstate(all="ignore"):
        v, paths = (
            v / np.linalg.norm(v, axis=1, keepdims=True),
            paths / np.linalg.norm(paths, axis=1, keepdims=True),
        )
    axes.set_axis_off()
    if not np.isfinite(v).any():
        axes.text(
            0.5, 0.5, "no direction: every member is at rest", ha="center", transform=axes.transAxes
        )
        return
    heights = np.append(v[:, 2], paths[:, 2])
    lowest, highest = np.nanmin(heights), np.nanmax(heights)
    sides = [1, -1] if lowest <= 0.0 <= highest else [1 if lowest > 0.0 else -1]
    inner = max(lowest, -highest, 0.0)
    angle = next(
        (a for a in (1, 2, 5, 10, 20, 30, 45, 60) if np.cos(np.radians(a)) <= inner + 1e-12), 90
    )
    limit = 2.0 * np.sin(np.radians(angle) / 2.0)
    shown = density(v, sides, limit)
    first, last = np.floor(np.log10(np.nanmin(shown))), np.ceil(np.log10(np.nanmax(shown)))
    norm = LogNorm(10.0**first, 10.0 ** max(last, first + 1))
    step = np.diff(paths, axis=0)
    length = np.linalg.norm(step, axis=1)
    dense = np.nansum(step[1:] * step[:-1]) >= COARSE * np.nansum(length[1:] * length[:-1])
    style = (
        {"linewidth": 0.8, "path_effects": HALO}
        if dense
        else {"linestyle": "", "marker": ".", "markersize": 3}
    )
    for disc, side in enumerate(sides):
        centre = 2.45 * limit * disc
        rim = axes.add_patch(
            Circle((centre, 0.0), limit, facecolor="none", edgecolor=INK, linewidth=0.8, zorder=4)
        )
        box = (centre - limit, centre + limit, -limit, limit)
        image = axes.imshow(
            shown[disc],
            DENSITY,
            norm,
            extent=box,
            origin="lower",
            interpolation="nearest",
            clip_path=rim,
        )
        for slope in slopes:
            x = np.array([-limit, limit]) / np.hypot(1.0, slope)
            axes.plot(
                centre + x,
                slope * x,
                "--",
                color=INK,
                linewidth=0.8,
                zorder=3,
                label="separatrices",
            )
        for right, up, toward in paths.transpose(2, 1, 0) if len(paths) > 2 else ():
            x, y = lambert(side * right, up, side * toward)
            axes.plot(x + centre, y, color=PATH, clip_path=rim, label="single members", **style)
        for x, y, sign, name in (
            (1, 0, side, 0),
            (-1, 0, -side, 0),
            (0, 1, 1, 1),
            (0, -1, -1, 1),
            (0, 0, side, 2),
        ):
            offset = (
                (12 * x, 9 * y)
                if name < 2
                else (14, 0)
                if max(slopes, default=0.0) > 1.0
                else (0, 9)
            )
            text, where = (
                f"${'+' if sign > 0 else '-'}{names[name]}$",
                {"xy": (centre + x * limit, y * limit), "xytext": offset},
            )
            axes.annotate(
                text,
                **where,
                textcoords="offset points",
                ha="center",
                va="center",
                path_effects=HALO,
                zorder=5,
            )
        axes.plot(centre, 0.0, "o", color=INK, markersize=4, markeredgecolor="white", zorder=5)
    axes.set(
        xlim=(-1.2 * limit, centre + 1.2 * limit), ylim=(-1.2 * limit, 1.2 * limit), aspect="equal"
    )
    entries = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    note = None if angle == 90 else f"rim: {angle}° from centre"
    if entries or note:
        place = (
            {"loc": "lower center"}
            if len(sides) > 1
            else {"loc": "lower left", "bbox_to_anchor": (0.85, 0.0)}
        )
        axes.legend(
            entries.values(),
            entries,
            title=note,
            fontsize=8,
            title_fontsize=8,
            frameon=False,
            handlelength=1.4,
            **place,
        )
    bar = axes.figure.colorbar(image, ax=axes, location="bottom", shrink=0.5, aspect=40, pad=0.01)
    bar.set_label("density (isotropic: 1)", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _legend_above(axes, ncols):
    axes.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 0.99),
        ncols=ncols,
        fontsize=8,
        frameon=False,
        columnspacing=1.2,
    )


def _figure(ds, size):
    """An empty figure headed by what was run: title, members, integrator, dt, seed, and how many members are flagged."""
    flagged = np.count_nonzero(ds.status.values)
    facts = [_members(ds.sizes["member"]), ds.attrs.get("integrator", "")]
    facts += [f"dt = {ds.attrs['dt']:.6g} s"] if "dt" in ds.attrs else []
    facts += [f"seed {ds.attrs['seed']}"] if "seed" in ds.attrs else []
    facts += [f"{flagged:,} flagged and left out"] if flagged else []
    return new_figure(
        f"{ds.attrs.get('title', 'ensemble')}: {', '.join(filter(None, facts))}", size
    )


def new_figure(title, size):
    """An empty figure with a heading."""
    figure = Figure(size, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11, parse_math=False)  # a scene may say what it likes
    return figure
