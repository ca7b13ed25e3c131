"""Pictures of the closed forms: Poinsot's construction, the axis of a top, its effective potential, its Euler angles.

Each is a function of one top and draws into a new Figure or into the axes given; `free_summary` and `lagrange_summary` put them together.
"""

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.mechanics.free_top import free_motion, free_top
from rigidmc.mechanics.lagrange_top import (
    effective_potential,
    lagrange_motion,
    lagrange_top,
    with_axis_third,
)
from rigidmc.planning.closed_form import NONE
from rigidmc.views.figure import GREY, HALO, INK, LIGHT, MEDIAN, PATH, new_figure

VIEW = np.array(
    [0.80, 0.45, 0.40]
)  # from where a sphere is seen; along its third axis it would look flat


def _screen(v):
    """(x, y, toward the reader) of vectors (..., 3), seen from VIEW with axis 3 upward."""
    toward = VIEW / np.linalg.norm(VIEW)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return v @ right, v @ np.cross(toward, right), v @ toward


def _sphere(axes, names):
    """A unit sphere with its outline, equator and three axes."""
    axes.set_aspect("equal")
    axes.set_axis_off()
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(turn), np.sin(turn), color=INK, linewidth=1.0)
    _line(axes, np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], -1), color=LIGHT, linewidth=0.8)
    for k, name in enumerate(names):
        tip = 1.22 * np.eye(3)[k]
        x, y, _ = _screen(np.stack([np.eye(3)[k], tip]))
        axes.plot(x, y, color=GREY, linewidth=1.0)
        axes.annotate(
            name,
            (x[1], y[1]),
            ha="center",
            va="center",
            fontsize=10,
            path_effects=HALO,
            xytext=(0, 5),
            textcoords="offset points",
        )
    axes.set(xlim=(-1.25, 1.25), ylim=(-1.5, 1.4))


def _line(axes, v, label=None, **style):
    """A curve on the sphere: full in front, thin and dotted behind."""
    x, y, z = _screen(v)
    axes.plot(np.where(z >= 0.0, x, np.nan), np.where(z >= 0.0, y, np.nan), label=label, **style)
    behind = {**style, "linewidth": 0.6 * style["linewidth"], "linestyle": ":"}
    axes.plot(np.where(z < 0.0, x, np.nan), np.where(z < 0.0, y, np.nan), **behind)


def polhodes(moments, momentum, axes=None):
    """Poinsot's construction on the momentum sphere: the curves that the momentum of a free body may follow, and the one it does.

    The sphere |L| = const is cut by energy ellipsoids in polhodes, TdC Example 3.6: grey those of other energies, black the separatrix
    2 T I_mid = |L|^2, coloured the one through `momentum` (3,), with its start and its direction.

    moments (3,) [kg m^2], momentum (3,) [kg m^2/s] in principal axes
    """
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    moments, momentum = np.asarray(moments, dtype=float), np.asarray(momentum, dtype=float)
    _sphere(axes, ("1", "2", "3"))
    order = np.argsort(moments, kind="stable")
    low, middle, high = order
    mid = np.eye(3)[middle]
    if moments[low] < moments[middle] < moments[high]:
        for pole in (low, high):
            for angle in np.radians([18, 36, 54, 72]):
                for side in (
                    -1.0,
                    1.0,
                ):  # starts on the great circle from the pole to the middle axis
                    _closed(
                        axes,
                        moments,
                        side * np.cos(angle) * np.eye(3)[pole] + np.sin(angle) * mid,
                        color=LIGHT,
                        linewidth=0.9,
                    )
        slope = np.sqrt(
            (1.0 / moments[middle] - 1.0 / moments[high])
            / (1.0 / moments[low] - 1.0 / moments[middle])
        )
        turn = np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
        for side in (-1.0, 1.0):
            pole = side * slope * np.eye(3)[low] + np.eye(3)[high]
            circle = np.cos(turn) * mid + np.sin(turn) * pole / np.linalg.norm(pole)
            _line(axes, circle, label="separatrix" if side > 0 else None, color=INK, linewidth=1.6)
    else:
        axis = (
            middle
            if moments[low] == moments[high]
            else high
            if moments[low] == moments[middle]
            else low
        )
        others = np.delete(np.eye(3), axis, axis=0)
        for angle in (
            np.radians([20, 40, 60, 80, 100, 120, 140, 160]) if moments[low] < moments[high] else []
        ):
            turn = np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
            circle = np.cos(angle) * np.eye(3)[axis] + np.sin(angle) * (
                np.cos(turn) * others[0] + np.sin(turn) * others[1]
            )
            _line(axes, circle, color=LIGHT, linewidth=0.9)
    size = np.linalg.norm(momentum)
    if size > 0.0:
        u = momentum / size
        path = _closed(axes, moments, u, color=PATH, linewidth=2.2, label="this body")
        x, y, z = _screen(path)
        axes.plot(
            x[:1],
            y[:1],
            "o",
            color=PATH,
            markersize=6,
            markerfacecolor=PATH if z[0] >= 0 else "white",
            label="start",
        )
        at = len(path) // 12
        if np.hypot(x[at + 1] - x[at], y[at + 1] - y[at]) > 0.0:
            axes.annotate(
                "",
                (x[at + 1], y[at + 1]),
                (x[at], y[at]),
                arrowprops={"arrowstyle": "-|>", "color": PATH, "lw": 1.5},
            )
    axes.legend(loc="lower center", ncols=3, fontsize=9, frameon=False)
    kind = str(free_motion(moments, momentum).kind)
    axes.set_title(
        f"Momentum sphere in body axes, I = ({', '.join(f'{i:.3g}' for i in moments)}) kg m²\n{kind}",
        fontsize=10,
    )
    return axes.figure


def _closed(axes, moments, u, **style):
    """Draw the polhode through u (3,); the points of one period of it."""
    motion = free_motion(moments, u)
    period = (
        float(motion.period)
        if np.isfinite(motion.period)
        else 40.0 / max(float(motion.rate), 1e-300)
    )
    t = np.linspace(0.0, 1.0, 721) if motion.rate == 0.0 else np.linspace(0.0, period, 721)
    path = free_top(moments, u, (1.0, 0.0, 0.0, 0.0), t).momentum
    _line(axes, path, **style)
    return path


def axis_path(moments, weight, momentum, attitude, axes=None, periods=8):
    """The path of a Lagrange top's axis on the unit sphere, with the circles of its turning angles: loops, cusps or waves.

    moments (3,) [kg m^2], weight k = m g l [N m], momentum (3,) [kg m^2/s] in principal axes, attitude (4,)
    """
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    what = lagrange_motion(moments, weight, momentum, attitude)
    t = _times(what, periods)
    q = lagrange_top(moments, weight, momentum, attitude, t).attitude
    w, x, y, z = np.moveaxis(q, -1, 0)
    tip = np.stack(
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z], -1
    )
    _sphere(axes, ("x", "y", "z"))
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    for theta, style in ((what.high, "--"), (what.low, "-.")):
        circle = np.stack(
            [
                np.sin(theta) * np.cos(turn),
                np.sin(theta) * np.sin(turn),
                np.cos(theta) + 0.0 * turn,
            ],
            -1,
        )
        if np.sin(theta) > 1e-6:
            _line(
                axes,
                circle,
                color=GREY,
                linewidth=1.0,
                linestyle=style,
                label=f"theta = {np.degrees(theta):.4g} deg",
            )
    _line(axes, tip, color=PATH, linewidth=1.8, label="axis of the top")
    px, py, _ = _screen(tip)
    axes.plot(px[:1], py[:1], "o", color=PATH, markersize=6, label="start")
    axes.legend(loc="lower center", ncols=2, fontsize=9, frameon=False)
    axes.set_title(f"Axis of the top in space, {periods} nutations: {what.kind}", fontsize=10)
    return axes.figure


def potential(moments, weight, momentum, attitude, axes=None):
    """The effective potential of theta, TdC (3.42), with the energy and the turning angles between which the axis nutates."""
    axes = axes if axes is not None else new_figure("", (6.0, 4.2)).add_subplot()
    what = lagrange_motion(moments, weight, momentum, attitude)
    high, low = float(what.high), float(what.low)
    rest = (
        0.5 * float(what.p_psi) ** 2 / moments[2]
    )  # the energy of the spin, which does not change: left out of the scale
    margin = 0.35 * max(low - high, 0.02)
    theta = np.linspace(max(high - margin, 1e-6), min(low + margin, np.pi - 1e-6), 1001)
    u, energy = (
        effective_potential(moments, weight, what.p_phi, what.p_psi, theta) - rest,
        float(what.energy) - rest,
    )
    floor = u.min()
    axes.plot(np.degrees(theta), u, color=MEDIAN, linewidth=2.0, label="effective potential")
    axes.axhline(energy, color=PATH, linewidth=1.5, label="energy")
    for k, angle in enumerate((high, low)):
        axes.axvline(
            np.degrees(angle),
            color=GREY,
            linestyle="--",
            linewidth=1.0,
            label="_" if k else f"turning angles {np.degrees(high):.4g}, {np.degrees(low):.4g} deg",
        )
    allowed = (theta >= high) & (theta <= low)
    axes.fill_between(
        np.degrees(theta), u, energy, where=allowed, color=PATH, alpha=0.15, linewidth=0
    )
    span = max(energy - floor, 1e-12 * max(abs(energy), 1e-300))
    axes.set(xlim=np.degrees(theta[[0, -1]]), ylim=(floor - 0.25 * span, energy + 1.1 * span))
    axes.set(xlabel="theta [deg]", ylabel="energy less that of the spin [J]")
    axes.set_title("Effective potential of the nutation", fontsize=10, pad=24)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9, frameon=False)
    return axes.figure


def euler_angles(attitude, t, axes=None):
    """Euler angles z-x-z of attitudes (n, 4) against t (n,): theta as it is, phi and psi less their mean rates, which the legend tells.

    Near theta = 0 and pi only phi + psi or phi - psi has a meaning; there the two run fast and apart.
    """
    axes = axes if axes is not None else new_figure("", (6.0, 4.6)).add_subplot()
    w, x, y, z = np.moveaxis(attitude, -1, 0)
    theta = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    plus, minus = (np.unwrap(2.0 * np.arctan2(*v)) for v in ((z, w), (y, x)))
    for name, values, style in (
        ("theta", theta, "-"),
        ("phi", 0.5 * (plus + minus), "--"),
        ("psi", 0.5 * (plus - minus), ":"),
    ):
        rate = 0.0 if name == "theta" else (values[-1] - values[0]) / (t[-1] - t[0])
        label = name if rate == 0.0 else f"{name} - {rate:.4g} rad/s t"
        color = {"theta": MEDIAN, "phi": PATH, "psi": INK}[name]
        axes.plot(
            t,
            np.degrees(values - rate * (t - t[0])),
            style,
            color=color,
            linewidth=1.8,
            label=label,
        )
    axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(t[0], t[-1]))
    axes.set_title("Euler angles (z-x-z)", fontsize=10, pad=24)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9, frameon=False)
    return axes.figure


def _times(what, periods, count=1600):
    """Times over some nutation periods; of a top that has none, over as many of its own slow times."""
    period = float(what.period) if np.isfinite(what.period) else 6.0 / max(float(what.rate), 1e-300)
    return (
        np.linspace(0.0, periods * period, count)
        if what.rate > 0.0
        else np.linspace(0.0, 1.0, count)
    )


def lagrange_summary(moments, weight, momentum, attitude, title="Lagrange top"):
    """The axis on the sphere, the effective potential and the Euler angles of one Lagrange top."""
    figure = new_figure(title, (12.0, 6.6))
    left, right = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.15])
    upper, lower = right.subgridspec(2, 1)
    axis_path(moments, weight, momentum, attitude, figure.add_subplot(left))
    potential(moments, weight, momentum, attitude, figure.add_subplot(upper))
    t = _times(lagrange_motion(moments, weight, momentum, attitude), 4)
    euler_angles(
        lagrange_top(moments, weight, momentum, attitude, t).attitude, t, figure.add_subplot(lower)
    )
    return figure


def free_summary(moments, momentum, attitude, t_end, title="free top"):
    """The momentum sphere, the angular velocity and the Euler angles of one free body."""
    figure = new_figure(title, (12.0, 6.6))
    left, right = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.15])
    upper, lower = right.subgridspec(2, 1)
    polhodes(moments, momentum, figure.add_subplot(left))
    t = np.linspace(0.0, t_end, 1600)
    motion, axes = free_top(moments, momentum, attitude, t), figure.add_subplot(upper)
    for k, (color, style) in enumerate(((MEDIAN, "-"), (PATH, "--"), (INK, ":"))):
        axes.plot(
            t, motion.omega[:, k], style, color=color, linewidth=1.8, label=f"$\\omega_{k + 1}$"
        )
    axes.set(xlabel="time [s]", ylabel="angular velocity [rad/s]", xlim=(0.0, t_end))
    axes.set_title("Angular velocity in body axes", fontsize=10, pad=24)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9, frameon=False)
    euler_angles(motion.attitude, t, figure.add_subplot(lower))
    return figure


def case_summary(case, title, t_end):
    """The summary of the first member of a `rigidmc.planning.closed_form.Case`."""
    moments, momentum, attitude, form = (
        case.moments[0],
        case.momentum[0],
        case.attitude[0],
        int(case.form[0]),
    )
    if form == NONE:
        raise SceneError(
            "", "members", None, "the first member has no body or no start: no motion to draw"
        )
    if form == 0:
        return free_summary(moments, momentum, attitude, t_end, title)
    moments, momentum, attitude = with_axis_third(form, moments, momentum, attitude)
    return lagrange_summary(moments, case.weight[0], momentum, attitude, title)
