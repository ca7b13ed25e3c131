"""Pictures of the closed forms of one top: its axis, effective potential and Euler angles.

Each function draws into a new Figure or into given axes; `free_summary` and `lagrange_summary`
combine them.
"""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.mechanics.free_top import solve_free_top
from rigidmc.mechanics.lagrange_steady import effective_potential
from rigidmc.mechanics.lagrange_top import (
    NutationRange,
    analyse_lagrange_top,
    solve_lagrange_top,
    with_axis_third,
)
from rigidmc.mechanics.rotation import to_space
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.closed_form import NONE, ClosedMotion
from rigidmc.planning.saves import Drive, turning_rates
from rigidmc.results.labels import in_symbols, with_units
from rigidmc.views.figures import (
    GREY,
    INK,
    MEDIAN,
    PATH,
    add_density,
    figure_of,
    line_styles,
    mark_starts,
    new_figure,
)
from rigidmc.views.polhodes import draw_polhodes
from rigidmc.views.quadric import CIRCLE, draw_curve, draw_quadric, screen
from rigidmc.views.sample import DENSE, FINE, LINES

NARROW = 0.02  # rad: smallest width of a nutation that sets the scale of a picture

LARGE, SMALL = "kMGTPEZYRQ", "qryzafpn\N{MICRO SIGN}m"  # prefixes of 10^3, 10^6, ...; ..., 10^-3

TIME = with_units("time", "s")
UPRIGHT = 0.05  # relative to the largest sin theta: below it phi and psi run fast and opposite


def axis_path(
    moments: ArrayLike,
    weight: float,
    momentum: ArrayLike,
    attitude: ArrayLike,
    axes: Axes | None = None,
    periods: int = 8,
) -> Figure:
    """Draw the path of a Lagrange top's axis on the unit sphere: loops, cusps or waves.

    Circles mark the turning angles.
    moments (3,) [kg m^2], weight k = m g l [N m], momentum (3,) [kg m^2/s] in principal axes,
    attitude (4,)
    """
    axes = axes if axes is not None else new_figure("", (5.2, 5.4)).add_subplot()
    nutation = analyse_lagrange_top(moments, weight, momentum, attitude)
    t = _times(moments, momentum, nutation, periods)
    q = solve_lagrange_top(moments, weight, momentum, attitude, t).attitude
    draw_quadric(axes, ("x", "y", "z"))
    draw_turning_angles(axes, float(nutation.high), float(nutation.low))
    tip = to_space(q, (0.0, 0.0, 1.0))
    draw_curve(axes, tip, color=PATH, linewidth=1.8, label="axis of the top")
    x, y, _ = screen(tip)
    mark_starts(axes, x[:1], y[:1])
    axes.legend(loc="lower center", ncols=2, fontsize=9, frameon=False)
    period = float(nutation.period)
    is_complete = not t[-1] < 0.999 * periods * period
    shown = f"{periods} nutations" if is_complete else f"{t[-1] / period:.2g} of a nutation"
    axes.set_title(f"Axis of the top in space, {shown}: {nutation.kind}", fontsize=10)
    return figure_of(axes)


def draw_turning_angles(
    axes: Axes, high: float, low: float, draw: Callable[..., None] = draw_curve
) -> None:
    """Draw the circles on the unit sphere on which the axis of a top turns back, by `draw`."""
    for theta, style in ((high, "--"), (low, "-.")):
        if np.sin(theta) > 1e-6:
            x, y = np.sin(theta) * np.cos(CIRCLE), np.sin(theta) * np.sin(CIRCLE)
            circle = np.stack([x, y, np.cos(theta) + 0.0 * CIRCLE], -1)
            label = f"θ = {np.degrees(theta):.4g}°"
            draw(axes, circle, color=GREY, linewidth=1.0, linestyle=style, label=label)


def draw_effective_potential(
    moments: ArrayLike,
    weight: ArrayLike,
    momentum: ArrayLike,
    attitude: ArrayLike,
    axes: Axes | None = None,
    labels: list[str | None] | None = None,
) -> Figure:
    """Draw the effective potential of theta, TdC (3.42), with energies and turning angles.

    Up to 20 tops are lines, with the labels (n,), more are a density of potentials. The constant
    energy of each spin is subtracted. Tops with one potential share its line.

    moments (n, 3) [kg m^2], weight k = m g l (n,) [N m], momentum (n, 3) [kg m^2/s] in principal
    axes, attitude (n, 4), all also without n
    """
    axes = axes if axes is not None else new_figure("", (6.0, 4.2)).add_subplot()
    moments, momentum, attitude = map(np.atleast_2d, (moments, momentum, attitude))
    weight = np.atleast_1d(weight)
    tops = analyse_lagrange_top(moments, weight, momentum, attitude)
    spin = 0.5 * tops.p_psi**2 / moments[:, 2]
    high, low = float(tops.high.min()), float(tops.low.max())
    margin = 0.35 * max(low - high, NARROW)
    theta = np.linspace(max(high - margin, 1e-6), min(low + margin, np.pi - 1e-6), 1001)
    p_phi, p_psi = tops.p_phi[:, None], tops.p_psi[:, None]
    u = effective_potential(moments[:, None], weight[:, None], p_phi, p_psi, theta) - spin[:, None]
    # a picture has every well that is a line, and half the wells of a density
    energy, lowest = tops.energy - spin, np.median if len(u) > LINES else np.min
    floor = float(lowest(u.min(axis=1)))
    size = max(float(np.median(np.abs(u))), float(np.abs(energy).max()))
    unit, symbol = _prefixed(size)
    u, energy, floor = u / unit, energy / unit, floor / unit
    top = float(energy.max())
    # height of the drawing in `unit`; 1e-300 only keeps its ends apart
    height = max(top - floor, 1e-12 * max(abs(top), 1e-300))
    if low - high < NARROW:  # the energy is close to the floor: the well sets the scale
        height = max(height, 0.5 * (float(np.median(u[:, [0, -1]])) - floor))
    axes.set(ylim=(floor - 0.25 * height, top + 1.1 * height))
    degrees = np.degrees(theta)
    turns = np.degrees(np.stack([tops.high, tops.low], -1))
    if len(u) == 1:
        _one_well(axes, degrees, u[0], float(energy[0]), turns[0])
    else:
        _wells(axes, degrees, u, energy, turns, labels or [None] * len(u))
    axes.set(
        xlim=degrees[[0, -1]],
        xlabel=with_units("θ", "deg"),
        ylabel=with_units("energy minus spin energy", symbol),
    )
    axes.ticklabel_format(useOffset=False)
    few = "Effective potentials, and energies between the turning angles"
    _finish(axes, few if 1 < len(u) <= LINES else "Effective potential of the nutation")
    return figure_of(axes)


def _prefixed(size: float) -> tuple[float, str]:
    """Return a unit of energy [J] for values up to `size` [J], and its symbol: one with a prefix of
    SI, or a power of ten beyond them."""
    # if all energies are 0, the unit is 1 J
    power = 3 * int(np.floor(np.log10(size) / 3.0)) if size > 0.0 else 0
    if -len(SMALL) <= power // 3 <= len(LARGE):
        prefixes = ("", *LARGE, *SMALL)  # SMALL counts from the end
        return 10.0**power, f"{prefixes[power // 3]}J"
    return 10.0**power, f"1e{power} J"


def _one_well(axes: Axes, degrees: Array, u: Array, energy: float, turns: Array) -> None:
    """Draw the effective potential of one top, its energy, and its turning angles [deg]."""
    axes.plot(degrees, u, color=MEDIAN, linewidth=2.0, label="effective potential")
    axes.axhline(energy, color=PATH, linewidth=1.5, label="energy")
    words = f"turning angles {turns[0]:.4g}°, {turns[1]:.4g}°"
    for angle, label in zip(turns, (words, "_"), strict=True):
        axes.axvline(angle, color=GREY, linestyle="--", linewidth=1.0, label=label)
    inside = (degrees >= turns[0]) & (degrees <= turns[1])
    axes.fill_between(degrees, u, energy, where=inside, color=PATH, alpha=0.15, linewidth=0)


def _wells(
    axes: Axes, degrees: Array, u: Array, energy: Array, turns: Array, labels: list[str | None]
) -> None:
    """Draw effective potentials (n, points) with energies (n,) and turning angles (n, 2) [deg]."""
    low, high = axes.get_ylim()
    styles = line_styles(len(u))
    if np.ptp(u, axis=0).max() <= 1e-9 * (high - low):
        axes.plot(degrees, u[0], color=MEDIAN, linewidth=2.0, label="effective potential of all")
    elif len(u) <= LINES:
        for well, style, label in zip(u, styles, labels, strict=True):
            axes.plot(degrees, well, label=label or "_", **style)
    else:
        some = u[:: -(-len(u) // 2000)]
        shown = np.where((some > low) & (some < high), some, np.nan)
        add_density(axes, np.broadcast_to(degrees, some.shape).ravel(), shown.ravel(), "curves")
    if len(u) > LINES:
        few = slice(None, None, -(-len(u) // 500))
        both = np.repeat(energy[few], 2)
        axes.plot(turns[few].ravel(), both, ".", color=PATH, ms=3.0, label="turning points")
        return
    for e, ends, style in zip(energy, turns, styles, strict=True):
        axes.plot(ends, (e, e), "o-", color=style["color"], ms=4.0, lw=1.0)


def euler_curves(attitude: Array) -> tuple[Array, Array, Array]:
    """Return Euler angles theta, phi, psi (n,) [rad] of attitudes (n, 4).

    Near theta = 0 and pi only phi + psi or phi - psi is well defined: phi and psi are nan there,
    unless the body stays there. Between these gaps they are continuous.
    """
    w, x, y, z = np.moveaxis(attitude, -1, 0)
    theta = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    tilted = np.sin(theta) > UPRIGHT * np.sin(theta).max()
    tilted |= np.count_nonzero(tilted) < 2
    plus, minus = np.full((2, theta.size), np.nan)
    for angle, *parts in ((plus, z, w), (minus, y, x)):
        for piece in _pieces(tilted):
            angle[piece] = np.unwrap(2.0 * np.arctan2(*(part[piece] for part in parts)))
    return theta, 0.5 * (plus + minus), 0.5 * (plus - minus)


def _pieces(there: Bools) -> list[slice]:
    """Return the slices of `there` (n,) that are True without a gap."""
    ends = np.flatnonzero(np.diff(there, prepend=False, append=False))
    return [slice(*map(int, piece)) for piece in ends.reshape(-1, 2)]


def mean_rate(t: Array, angle: Array) -> float:
    """Return the mean rate of an angle [rad/s]: one slope for all pieces between gaps, by least
    squares with the weights sin^2(pi t/T) on a piece of length T.

    Each piece has its own constant, because no turns can be counted across a gap. The values at the
    ends are anywhere in a nutation. Small weights there keep the rate right once a few nutations
    are in the picture.
    """
    above = below = 0.0
    for piece in _pieces(np.isfinite(angle)):
        passed, values = t[piece] - t[piece][0], angle[piece]
        if passed.size < 2:
            continue
        # half a save time beyond each end, so that two values have weights, too
        edge = 0.5 * passed[-1] / (passed.size - 1)
        weight = np.sin(np.pi * (passed + edge) / (passed[-1] + 2.0 * edge)) ** 2
        from_mean = weight * (passed - np.average(passed, weights=weight))
        above += float(from_mean @ values)
        below += float(from_mean @ passed)
    return above / below if below > 0.0 else 0.0


def without_mean_rate(t: Array, angle: Array, rate: float | None = None) -> tuple[Array, float]:
    """Return an angle minus its mean rate, and this rate [rad/s], by default `mean_rate`; each
    piece between gaps begins at most half a turn from the end of the piece before, the first one
    from 0."""
    rate = mean_rate(t, angle) if rate is None else rate
    rest, last = angle - rate * (t - t[0]), 0.0
    for piece in _pieces(np.isfinite(rest)):
        rest[piece] -= 2.0 * np.pi * np.round((rest[piece.start] - last) / (2.0 * np.pi))
        last = rest[piece.stop - 1]
    return rest, rate


def euler_angles(
    attitude: Array, t: Array, axes: Axes | None = None, rates: tuple[float, float] | None = None
) -> Figure:
    """Draw Euler angles z-x-z of attitudes (n, 4) against t (n,).

    The curves are theta, and phi and psi minus their mean rates, which the legend shows. Near
    theta = 0 and pi, where phi and psi are undefined, their curves end, and the picture is grey;
    see `euler_curves`.

    rates : mean rates of phi and psi [rad/s] where they are known; by default estimates
    """
    axes = axes if axes is not None else new_figure("", (6.0, 4.6)).add_subplot()
    theta, phi, psi = euler_curves(attitude)
    gaps = np.isnan(phi)
    of_phi, of_psi = (None, None) if rates is None or gaps.any() else rates
    for name, values, style, color, mean in (
        ("θ", theta, "-", MEDIAN, 0.0),
        ("φ", phi, "--", PATH, of_phi),
        ("ψ", psi, ":", INK, of_psi),
    ):
        angle, rate = (theta, 0.0) if name == "θ" else without_mean_rate(t, values, mean)
        sign = "−" if rate > 0.0 else "+"
        label = name if rate == 0.0 else f"{name} {sign} ({abs(rate):.4g} rad/s) t"
        axes.plot(t, np.degrees(angle), style, color=color, linewidth=1.8, label=label)
    if gaps.any():
        place = axes.get_xaxis_transform()
        words = "φ, ψ left out: axis 3 is near the vertical"
        axes.fill_between(
            t, 0.0, 1.0, where=gaps, label=words, color="0.9", lw=0, zorder=0, transform=place
        )
    axes.set(xlabel=TIME, ylabel=with_units("angle", "deg"), xlim=(t[0], t[-1]))
    _finish(axes, "Euler angles (z-x-z)")
    return figure_of(axes)


def lagrange_summary(
    moments: ArrayLike,
    weight: float,
    momentum: ArrayLike,
    attitude: ArrayLike,
    title: str = "Lagrange top",
) -> Figure:
    """Draw axis on the sphere, effective potential and Euler angles of one Lagrange top."""
    figure, left, upper, lower = _three(title)
    axis_path(moments, weight, momentum, attitude, left)
    draw_effective_potential(moments, weight, momentum, attitude, upper)
    top = analyse_lagrange_top(moments, weight, momentum, attitude)
    t = _times(moments, momentum, top, 4)
    attitudes = solve_lagrange_top(moments, weight, momentum, attitude, t).attitude
    period = float(top.period)
    means = float(top.precession) / period, float(top.spin) / period
    euler_angles(attitudes, t, lower, means if np.isfinite(means).all() else None)
    return figure


def free_summary(
    moments: ArrayLike,
    momentum: ArrayLike,
    attitude: ArrayLike,
    t_end: float,
    title: str = "free top",
) -> Figure:
    """Draw momentum sphere, angular velocity and Euler angles of one free body."""
    figure, left, upper, lower = _three(title)
    draw_polhodes(moments, momentum, left)
    t = _resolved(moments, momentum, t_end)
    motion = solve_free_top(moments, momentum, attitude, t)
    for k, (color, style) in enumerate(((MEDIAN, "-"), (PATH, "--"), (INK, ":"))):
        label = in_symbols(f"omega[{k + 1}]")
        upper.plot(t, motion.omega[:, k], style, color=color, linewidth=1.8, label=label)
    up = with_units("angular velocity", OBSERVABLES["omega"].units)
    upper.set(xlabel=TIME, ylabel=up, xlim=(0.0, t[-1]))
    _finish(upper, "Angular velocity in body axes")
    euler_angles(motion.attitude, t, lower)
    return figure


def case_summary(case: ClosedMotion, title: str, t_end: float) -> Figure:
    """Draw the summary of the first member of a `rigidmc.planning.closed_form.ClosedMotion`."""
    moments, momentum, attitude = case.moments[0], case.momentum[0], case.attitude[0]
    form = int(case.form[0])
    if form == NONE:
        rule = "impossible body or start of the first member: no motion to draw"
        raise OptionError(rule, at="members")
    if form == 0:
        return free_summary(moments, momentum, attitude, t_end, title)
    moments, momentum, attitude = with_axis_third(form, moments, momentum, attitude)
    return lagrange_summary(moments, case.weight[0], momentum, attitude, title)


def _three(title: str) -> tuple[Figure, Axes, Axes, Axes]:
    """Return (figure, left, upper right, lower right) with empty axes."""
    figure = new_figure(title, (12.0, 6.6))
    grid = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.15])
    right = grid[1].subgridspec(2, 1)
    left, upper, lower = (figure.add_subplot(place) for place in (grid[0], right[0], right[1]))
    return figure, left, upper, lower


def _finish(axes: Axes, title: str) -> None:
    """Add a title, and a legend of one or two rows between title and axes."""
    lines = len(axes.get_legend_handles_labels()[1])
    axes.set_title(title, fontsize=10, pad=38 if lines > 3 else 24 if lines else 6)
    columns = 2 if lines == 4 else 3
    if lines:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, fontsize=8, frameon=False
        )


def _times(moments: ArrayLike, momentum: ArrayLike, nutation: NutationRange, periods: int) -> Array:
    """Return times over some periods of the nutation.

    For a top without a period, the slow time 6/rate replaces the period. For a top at rest, the
    times cover 1 s.
    """
    rate, period = float(nutation.rate), float(nutation.period)
    if not rate > 0.0:
        return _resolved(moments, momentum, 1.0)  # second
    return _resolved(moments, momentum, periods * (period if np.isfinite(period) else 6.0 / rate))


def _resolved(moments: ArrayLike, momentum: ArrayLike, end: float) -> Array:
    """Return times until `end` [s], between which a body turns by at most FINE; at most DENSE[1]
    times, which may end earlier."""
    rates = turning_rates(
        np.asarray(moments, float)[:, None], np.asarray(momentum, float)[:, None], Drive(True)
    )
    rate = max(float(each[0]) for each in rates)
    count = int(np.clip(np.ceil(rate * end / FINE), *DENSE))
    last = min(end, count * FINE / rate) if rate > 0.0 else end
    return np.linspace(0.0, last, count)
