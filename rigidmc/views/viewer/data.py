"""Data of the page. For a member: its body, and attitude and momentum at evenly spaced times; for
an ensemble: the density of the momentum directions; for a map: its pixels, and the first member of
each, which turns when the reader clicks the pixel.
"""

import base64
from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from numpy.typing import ArrayLike

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.body_axes import body_axes
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.gravity_gradient import GravityGradient, place
from rigidmc.physics.effects.protocol import Effect
from rigidmc.planning.saves import ATTITUDE, BODY, sparse
from rigidmc.results.labels import count_text, long_label, units_text
from rigidmc.results.principal_axes import in_principal_axes, is_described
from rigidmc.runs.frames import integrate_member
from rigidmc.runs.rerun import rerun
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.views.figures import colour_scale
from rigidmc.views.sample import fastest, omega_or_momentum, thin_result
from rigidmc.views.surfaces import form_of, member_body, surface_of, surface_radius

TURN = 0.2  # rad between two frames: halfway, a chord is off by 5e-3 of the arc's radius, and the
# page, which turns along the arc, by 1e-5
FEWEST, MOST = 300, 4000  # frames of a member
POINTS = 1000  # points of a drift curve
DENSITIES, MEMBERS = 60, 2000  # times and members of the density
WIDTH = 0.12  # rad: standard deviation of the kernel of the density
GRID = 37, 72  # rows and columns of the density, 5 degrees apart: less than the kernel


def to_base64(values: ArrayLike) -> dict[str, Any]:
    """Encode numbers as base64 of little-endian float32, with their shape."""
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"shape": array.shape, "f4": base64.b64encode(array.tobytes()).decode()}


def short(values: ArrayLike) -> dict[str, Any]:
    """Encode numbers from -1 to 1 as base64 of 16 bits each, accurate to 0.5/32767."""
    array = np.round(np.asarray(values) * 32767.0).astype("<i2")
    return {"shape": array.shape, "i2": base64.b64encode(array.tobytes()).decode()}


def motion_span(start: xr.Dataset, end: float, most: int = MOST) -> tuple[int, float, float]:
    """Return (frames, time of the last frame, rate) of the first member of a result or its start.

    rate : upper bound of the turn rate from the first momentum [rad/s], |L| over the least moment
    """
    l, _ = omega_or_momentum(start, "momentum")
    rate = float(np.linalg.norm(l[0, :, 0]) / start.moments.values.min())
    count = int(np.clip(np.ceil(rate * end / TURN), min(FEWEST, most), most))
    return count, min(end, count * 2.5 * TURN / rate) if rate > 0.0 else end, rate


def closer(shown: xr.Dataset, end: float) -> tuple[int, float, float] | None:
    """Return (frames, time of the last frame, rate) if a member turns too far between its frames;
    else None. A torque may spin a member up beyond the bound from its first momentum."""
    if shown.sizes["time"] < 2:
        return None
    rate = float(_fastest(shown)[0])
    if rate * float(np.diff(shown.time.values).max()) <= 2.5 * TURN * (1.0 + 1e-6):
        return None
    count = int(np.clip(np.ceil(rate * end / TURN), FEWEST, MOST))
    return count, min(end, count * 2.5 * TURN / rate), rate


def unseen(shown: xr.Dataset) -> str:
    """Return a warning if a member turns too far between its frames; "" if the frames show the
    motion. Members with noise have frames only at the steps of their run."""
    if shown.sizes["time"] < 2:
        return ""
    between = float(np.diff(shown.time.values).max())
    turn = sparse(_fastest(shown), between)
    if turn is None:
        return ""
    return (
        f"; it {turn.who()} between frames, so the apparent motion is wrong; use dt <="
        f" {turn.every:g} s"
    )


def _fastest(shown: xr.Dataset) -> Array:
    """Return the largest rate of attitude and momentum of a member (1,) [rad/s]."""
    return np.maximum(fastest(shown, ATTITUDE), fastest(shown, BODY))


def motion_data(shown: xr.Dataset, scene: Scene) -> dict[str, Any]:
    """Return the frames of a member for the page; the body is scaled to a largest distance of 1."""
    body, axes = scene.body, {}
    if is_described(shown):
        rows = body_axes(tuple(shown.principal_axes.values[:, 0].tolist()))
        axes, shown = {"axes": (rows.x, rows.y, rows.z)}, in_principal_axes(shown)
    l = shown.momentum.transpose("time", "axis", "member").values[..., 0]
    q = shown.attitude.transpose("time", "quat", "member").values[..., 0]
    size = np.linalg.norm(l, axis=1)
    # at rest all are 0; avoids 0/0 [kg m2/s]
    largest = max(size.max(), 1e-300)
    form = form_of(shown, body)
    surface = surface_of(body)
    corners = surface.corners @ form[:, :3].T + form[:, 3]
    scale = 1.0 / np.linalg.norm(corners, axis=1).max()
    # the surface on the page has size 1
    form = np.column_stack([form[:, :3] * surface_radius(surface), form[:, 3]])
    return {
        "index": int(shown.member.values[0]),
        "end": float(shown.time.values[-1]),
        "steps": shown.attrs["frames"],
        "moments": shown.moments.values[:, 0].tolist(),
        "largest": largest,
        "form": (scale * form).ravel().tolist(),
        "centre": (scale * member_body(shown, body)[2]).tolist(),
        "q": short(_continuous(q)),
        # at rest L = 0; dividing by 1 keeps it 0
        "u": short(l / np.where(size > 0.0, size, 1.0)[:, None]),
        "size": short(size / largest),
        **axes,
        **radius(shown, scene.effects),
    }


def radius(shown: xr.Dataset, effects: Iterable[Effect]) -> dict[str, Any]:
    """Return {"radius": cosine and sine of the true anomaly at each frame} for a member on an
    orbit: the local vertical, away from the central body; {} without an orbit."""
    for label, effect in label_effects(effects):
        if isinstance(effect, GravityGradient):
            fields = {name: f"{label}_{name}" for name in effect._fields}
            sizes = {k: float(shown[v].values[0]) for k, v in fields.items() if v in shown}
            orbit = effect._replace(**sizes)
            return {"radius": short([place(orbit, t) for t in shown.time.values.tolist()])}
    return {}


def status_of(ds: xr.Dataset, member: int) -> str:
    """Return the name of a member's status."""
    code = int(ds.status.sel(member=member))
    return next(word for word, number in STATUSES.items() if number == code)


def _continuous(q: Array) -> Array:
    """Choose the signs of quaternions (times, 4) without jumps."""
    flips = np.sign(np.einsum("ti,ti->t", q[1:], q[:-1]))
    return q * np.cumprod(np.concatenate([[1.0], np.where(flips < 0.0, -1.0, 1.0)]))[:, None]


def drifts(ds: xr.Dataset, member: int, end: float, allow_code: bool) -> dict[str, Any]:
    """Return the drifts of energy and |L|^2 of a member at the saves of the run itself."""
    run = rerun(ds, member, save=("energy_drift", "l2_drift"), allow_code=allow_code)
    run = run.isel(time=run.time.values <= end * (1.0 + 1e-9))
    run = run.isel(time=slice(None, None, -(-run.sizes["time"] // POINTS)))
    values = {name: to_base64(run[name].values[:, 0]) for name in ("energy_drift", "l2_drift")}
    kept = {name: run[name].attrs.get("conserved", "") for name in values}
    return {"t": to_base64(run.time.values), **values, "conserved": kept}


def sphere_density(ds: xr.Dataset) -> dict[str, Any]:
    """Return the density of the momentum directions on a grid of the unit sphere, at up to
    DENSITIES times: bytes (times, GRID[0], GRID[1]), 255 at the maximum.

    Rows go from axis 3 to its opposite, columns around it from axis 1.
    """
    part = in_principal_axes(thin_result(ds))
    l, _ = omega_or_momentum(part, "momentum")
    every, stride = -(-len(l) // DENSITIES), -(-l.shape[-1] // MEMBERS)
    l = l[::every, :, ::stride]
    times = part.time.values[::every] if len(l) > 1 else np.zeros(1)
    size = np.linalg.norm(l, axis=1, keepdims=True)
    # at rest L = 0; dividing by 1 keeps it 0
    u = (l / np.where(size > 0.0, size, 1.0)).astype(np.float32)
    from_pole = np.linspace(0.0, np.pi, GRID[0])[:, None]
    around = np.linspace(0.0, 2.0 * np.pi, GRID[1], endpoint=False)
    flat = np.sin(from_pole) * np.cos(around), np.sin(from_pole) * np.sin(around)
    grid = np.stack([*flat, np.broadcast_to(np.cos(from_pole), GRID)], -1).reshape(-1, 3)
    dense = np.empty((len(u), len(grid)))
    for k, directions in enumerate(u):
        dense[k] = np.exp((grid.astype(np.float32) @ directions - 1.0) / WIDTH**2).sum(1)
    # 1e-300 avoids 0/0
    shown = np.round(255.0 * np.sqrt(dense / max(dense.max(), 1e-300))).astype(np.uint8)
    return {
        "t": to_base64(times),
        "members": int(u.shape[-1]),
        "shape": (len(u), *GRID),
        "bytes": base64.b64encode(shown.tobytes()).decode(),
    }


SIDE = 16  # pixels per side with a member on the page
FRAMES = 240  # frames of each member


def map_data(ds: xr.Dataset, allow_code: bool) -> tuple[Scene, dict[str, Any]]:
    """Return (scene, data of the map for the page)."""
    if "z" in ds.coords:
        rule = "pages cannot show a stack of maps: draw it with `rigidmc map FILE --plot`"
        raise OptionError(rule, at="view")
    scene = scene_of(ds, allow_code=allow_code)
    places = _places(ds)
    facts = []
    end, rate = _end(ds, scene, places)
    for i, j in places:
        member = i * ds.sizes["x"] + j
        shown = integrate_member(scene, member, FRAMES, end, _step(scene))
        if int(shown.status.values[0]) == 2:
            continue
        if (again := closer(shown, end)) is not None:  # end where FRAMES still resolve the motion
            far = FRAMES * 2.0 * TURN / again[2]
            shown = integrate_member(scene, member, FRAMES, min(end, far), _step(scene))
        shown.attrs["frames"] += unseen(shown)
        data = motion_data(shown, scene) | {"pixel": (i, j), "rate": rate}
        facts.append(data | {"status": "ok", "whole": data["end"] >= 0.999 * scene.run.t_end})
    return scene, {"members": facts, "density": None, "map": _pixels(ds)}


def _step(scene: Scene) -> float | None:
    return scene.run.dt if scene.run.turn is None and scene.run.integrator != "closed" else None


def _places(ds: xr.Dataset) -> list[tuple[int, int]]:
    """Return (row, column) of evenly spaced pixels that have a body and a start."""
    rows, columns = (
        np.unique(np.linspace(0, ds.sizes[key] - 1, SIDE).round().astype(int)) for key in "yx"
    )
    there = (ds.good + ds.failed).values > 0
    return [(int(i), int(j)) for i in rows for j in columns if there[i, j]]


def _end(ds: xr.Dataset, scene: Scene, places: list[tuple[int, int]]) -> tuple[float, float]:
    """Return (time of the last of FRAMES, largest turn rate of some members)."""
    rates = []
    for i, j in (places[0], places[len(places) // 2], places[-1]):
        member = i * ds.sizes["x"] + j
        start = integrate_member(scene, member, 1, min(scene.run.t_end, scene.run.dt), _step(scene))
        rates.append(motion_span(start, 1.0)[2])
    rate = max(rates)
    most = FRAMES * 2.0 * TURN / rate if rate > 0.0 else scene.run.t_end
    return min(scene.run.t_end, most), rate


def _pixels(ds: xr.Dataset) -> dict[str, Any]:
    """Return values, intervals and colours of the measures, rows from low y to high."""
    measures = [
        name
        for name in map(str, ds.data_vars)
        if f"{name}_low" in ds or name not in ("good", "failed", "none")
    ]
    measures = [name for name in measures if not name.endswith(("_low", "_high", "_without"))]
    return {
        "sides": [_side(ds[key]) for key in ("x", "y")],
        "members": count_text(int(ds.attrs["members"]), "member"),
        "good": to_base64(ds.good.values),
        "failed": to_base64(ds.failed.values),
        "measures": [_measure(ds, name) for name in measures],
    }


def _side(coordinate: xr.DataArray) -> dict[str, Any]:
    a = coordinate.attrs
    return {
        "values": coordinate.values.tolist(),
        "log": int(a["log"]),
        "name": long_label(coordinate),
    }


def _measure(ds: xr.Dataset, name: str) -> dict[str, Any]:
    values: Array = ds[name].values
    cmap, norm, _ = colour_scale(name, values, {})
    map_of = colormaps[cmap] if isinstance(cmap, str) else cmap
    table = (np.array([map_of(k / 255.0)[:3] for k in range(256)]) * 255.0).round().astype(int)
    places = np.ma.filled(np.ma.masked_invalid(np.asarray(norm(values), dtype=float)), np.nan)
    has = f"{name}_low" in ds
    return {
        "name": name,
        "words": ds[name].attrs.get("long_name", name),
        "units": units_text(ds[name].attrs.get("units", "1")),
        # in the units of the variable; a scale without ends is for a fraction
        "range": [float(norm.vmin or 0.0), float(norm.vmax or 1.0)],
        "places": to_base64(places),
        "values": to_base64(values),
        "low": to_base64(ds[f"{name}_low"].values) if has else None,
        "high": to_base64(ds[f"{name}_high"].values) if has else None,
        "colours": table.tolist(),
    }
