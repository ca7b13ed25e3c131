"""The body itself at a few instants of its motion, in perspective."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.free_top import solve_free_top
from rigidmc.mechanics.rotation import matrix, to_space
from rigidmc.planning.saves import ATTITUDE, MOST
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.scene.scene import scene_of
from rigidmc.views.figures import GREY, INK, PATH, add_title, figure_of
from rigidmc.views.globes import is_free
from rigidmc.views.sample import (
    DENSE,
    FINE,
    LINES,
    MemberPath,
    drawn_members,
    figure_of_result,
    member_paths,
    starts_of,
    thin_result,
)
from rigidmc.views.sphere import central_axis
from rigidmc.views.stage import Solid, Stage
from rigidmc.views.surfaces import body_surface, member_body

COUNT = 8  # instants
MEMBERS = 500  # of which the median is taken
STILL = 1e-6  # relative to its size: a value that varies less has no oscillation
NEAR = 0.98  # relative to an extreme: there a flip begins and ends
BELOW = -1.5  # height below the times
TRAIL = 2.0  # rad of the path of an axis before an instant


class Flight(NamedTuple):
    """The motion of one member, and the times to show (COUNT,) [s].

    axis : of the body whose path is drawn, in principal axes (3,);  value (n,) : the angle of axis
    3 from the vertical [deg] if `has_angle`, else omega about the axis of the middle moment [rad/s]
    """

    path: MemberPath
    instants: Array
    axis: Array
    value: Array

    def turn(self) -> str:
        """Describe how far the body turns between two instants, if that is more than MOST."""
        omega = float(np.linalg.norm(self.path.omega, axis=1).max())
        angle = omega * float(np.diff(self.instants).max())
        # 1 %: an axis turns by less than the body between two points of its path
        return f"; it turns {angle:.2g} rad from one to the next" if angle > 1.01 * MOST else ""


def snapshots(ds: xr.Dataset, axes: Axes | None = None) -> Figure:
    """Draw the body of a typical member at eight instants of its motion.

    The body is the solid of its scene, or the ellipsoid of its moments, with the path of an axis:
    the axis of the middle moment of a free body, whose momentum is upward, and axis 3 of another
    body, whose vertical is upward. The instants cover the first flip of that axis; else the run, or
    as much of it as they show at 2 rad of this motion apart. The title tells how far the body
    turns between them, if that is more.

    ds : result with its scene
    Raises ValueError without a scene, and if the member cannot be recomputed.
    """
    try:
        flown = flight(ds)
    except ValueError as error:
        raise ValueError(f"snapshots needs a result with its scene ({error})") from None
    axes = axes or figure_of_result(ds, (10.0, 2.2)).add_subplot()
    draw_flight(ds, flown, axes)
    add_title(axes, f"Member {flown.path.member} at eight instants{flown.turn()}")
    return figure_of(axes)


def has_angle(ds: xr.Dataset) -> bool:
    """Return whether the angle of axis 3 from the vertical tells the motion: torques act, and the
    attitude was saved."""
    return "attitude" in ds and not is_free(ds)


def flight(ds: xr.Dataset, part: xr.Dataset | None = None) -> Flight:
    """Return the motion of a typical member and the instants to show; ValueError if it cannot be
    computed, as without a scene, or without states and permission to run custom code.

    part : sample of the result, see `rigidmc.views.sample`
    """
    scene_of(ds, allow_code=None)  # without it there is no body to draw
    member = ds.sel(member=[_typical(thin_result(ds) if part is None else part)])
    if is_free(ds):
        path = _free_path(member)
        axis = np.eye(3)[central_axis(path.moments)]
    else:
        path = member_paths(member, ATTITUDE)[0][0]
        axis = (matrix(path.principal_attitude[0]).T @ matrix(path.attitude[0]))[:, 2]
    if has_angle(ds):
        value = np.degrees(np.arccos(np.clip(matrix(path.attitude)[:, 2, 2], -1.0, 1.0)))
    else:
        value = path.omega[:, np.argsort(path.moments, kind="stable")[1]]
    tip = matrix(path.principal_attitude) @ axis
    most = MOST / _rate(path.t, value, tip) if len(path.t) > 1 else 0.0
    return Flight(path, _instants(path.t, value, is_free(ds), most), axis, value)


def _rate(t: Array, value: Array, tip: Array) -> float:
    """Return the rate of the drawn motion [rad/s]: of an axis with directions tip (n, 3), or of the
    oscillation of a value (n,), whichever is faster."""
    step = np.diff(t)
    turning = np.linalg.norm(np.diff(tip, axis=0), axis=1) / step
    half = 0.5 * float(np.ptp(value))
    swing = np.abs(np.diff(value)) / step / half if half > STILL * np.abs(value).max() else 0.0
    # 1e-300 only separates 0 from the divisor of a body at rest
    return max(float(np.nanmax(turning)), float(np.nanmax(swing)), 1e-300)


def _typical(part: xr.Dataset) -> int:
    """Return the drawn member of a sample whose saved momentum or angular velocity is nearest to
    the median; of a few members the first one."""
    if part.sizes["member"] <= LINES:
        return int(part.member.values[0])
    some = drawn_members(part.status.values)
    name = next((name for name in ("omega", "momentum") if name in part), None)
    if name is not None:
        v = part[name].transpose("time", "axis", "member").values
        middle = np.median(v[..., :: -(-v.shape[-1] // MEMBERS)], axis=-1, keepdims=True)
        some = some[[int(np.argmin(np.abs(v[..., some] - middle).sum((0, 1))))]]
    return int(part.member.values[some[0]])


def _free_path(flown: xr.Dataset) -> MemberPath:
    """Return the motion of a free body in closed form from its start."""
    if "start_omega" not in flown and "start_momentum" not in flown:
        raise ValueError("the result does not hold the start of its members")
    principal = in_principal_axes(flown)
    moments, l, q = (v[0] for v in starts_of(principal))
    rate = float(np.linalg.norm(l) / moments.min())
    end = float(np.max(flown.time.values))
    count = int(np.clip(np.ceil(rate * end / FINE), *DENSE))
    t = np.linspace(0.0, min(end, count * FINE / rate) if rate > 0.0 else end, count)
    motion = solve_free_top(moments, l, q, t)
    member = int(flown.member.values[0])
    return MemberPath(
        member, t, motion.attitude, motion.attitude, motion.momentum, motion.omega, moments
    )


def _instants(t: Array, value: Array, is_rate: bool, most: float) -> Array:
    """Return COUNT times over the first flip, at which a rate changes sign; without one, over t,
    with at most `most` [s] between two."""
    turns = np.flatnonzero(np.diff(np.sign(value)) != 0)
    if not is_rate or not turns.size:
        return np.linspace(t[0], min(t[-1], t[0] + (COUNT - 1) * most), COUNT)
    size, at = np.abs(value), int(turns[0])
    after = at + 1 + np.argmax(np.diff(size[at + 1 :], append=0.0) < 0.0)
    before = at - np.argmax(np.diff(size[at::-1], append=0.0) < 0.0)
    first = before + np.flatnonzero(size[before : at + 1] >= NEAR * size[before])[-1]
    last = at + 1 + np.flatnonzero(size[at + 1 : after + 1] >= NEAR * size[after])[0]
    margin = 0.1 * (t[last] - t[first])
    return np.linspace(max(t[0], t[first] - margin), min(t[-1], t[last] + margin), COUNT)


def body_place(k: int) -> float:
    """Return the place of body k on the horizontal axis."""
    return 2.3 * k


def draw_flight(ds: xr.Dataset, flown: Flight, axes: Axes) -> None:
    """Draw the bodies of a flight side by side, with their times."""
    path, body = flown.path, scene_of(ds, allow_code=None).body
    member = ds.sel(member=[path.member])
    solid = Solid(body_surface(member, body), member_body(member, body)[2])
    frame = np.eye(3)
    l = to_space(path.principal_attitude[0], path.momentum[0])
    if is_free(ds) and l.any():
        frame = _upright(l / np.linalg.norm(l))
    turn = frame @ matrix(path.principal_attitude)
    tip = 1.05 * turn @ flown.axis
    stage = Stage(axes, -0.95, 0.32, 1.1)
    bent = np.cumsum(np.linalg.norm(np.diff(tip, axis=0, prepend=tip[:1]), axis=1))
    for k, t in enumerate(flown.instants):
        at = (body_place(k), 0.0)
        i = int(np.argmin(np.abs(path.t - t)))
        stage.solid(solid, turn[i], at)
        stage.stick(solid, turn[i], INK, 1.5, at=at)
        since = int(np.searchsorted(bent, bent[i] - TRAIL))
        stage.curve(tip[since : i + 1], PATH, 1.3, at, is_fading=True)
        words = f"{round(t):,} s" if 999.5 <= t < 1e6 else f"{t:.3g} s"
        axes.text(at[0], -1.15, words, ha="center", va="top", fontsize=8, color=GREY)
    stage.end()
    axes.set_axis_off()
    axes.set(xlim=(-1.2, body_place(COUNT - 1) + 1.2), ylim=(-2.1, 1.15), aspect="equal")


def _upright(up: Array) -> Array:
    """Return the rotation (3, 3) whose third row is the unit vector up (3,)."""
    across = np.eye(3)[0] - up[0] * up if abs(up[0]) < 0.9 else np.eye(3)[1] - up[1] * up
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])
