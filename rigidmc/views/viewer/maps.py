"""A map as a page: a pixel tells its numbers, and a click shows its first member turning."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from numpy.typing import NDArray

from rigidmc.errors import OptionError
from rigidmc.figures import colour_scale
from rigidmc.runs.rerun import integrated
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.views.viewer.motion import TURN, closer, encoded, motion, reach, unseen

SIDE = 16  # pixels per side whose members are integrated for the page
FRAMES = 240  # of each
BODIES = 12  # different bodies whose polhodes are drawn


def is_map(ds: xr.Dataset) -> bool:
    """Whether a Dataset is of `rigidmc.stability_map`."""
    return {"x", "y"} <= set(ds.dims) and "good" in ds


def map_data(ds: xr.Dataset, allow_code: bool) -> tuple[Scene, dict[str, Any], list[list[float]]]:
    """(scene, what the page knows of a map, moments of its bodies)."""
    if "z" in ds.coords:
        rule = "a stack of maps has no page: draw it with `rigidmc map FILE --plot`"
        raise OptionError(rule, at="view")
    scene = scene_of(ds, allow_code=allow_code)
    places = _places(ds)
    facts, bodies = [], list[list[float]]()
    end, rate = _end(ds, scene, places)
    for i, j in places:
        member = i * ds.sizes["x"] + j
        shown = integrated(scene, member, FRAMES, end, _step(scene))
        if int(shown.status.values[0]) == 2:
            continue
        if (again := closer(shown, end)) is not None:  # as far as FRAMES show it
            far = FRAMES * 2.0 * TURN / again[2]
            shown = integrated(scene, member, FRAMES, min(end, far), _step(scene))
        shown.attrs["frames"] += unseen(shown)
        known = motion(shown, scene) | {"pixel": (i, j), "rate": rate}
        if known["moments"] not in bodies and len(bodies) < BODIES:
            bodies.append(known["moments"])
        family = bodies.index(known["moments"]) if known["moments"] in bodies else -1
        facts.append(
            known
            | {"status": "ok", "whole": known["end"] >= 0.999 * scene.run.t_end, "family": family}
        )
    data = {"members": facts, "density": None, "map": _pixels(ds)}
    return scene, data, bodies


def _step(scene: Scene) -> float | None:
    return scene.run.dt if scene.run.turn is None and scene.run.integrator != "closed" else None


def _places(ds: xr.Dataset) -> list[tuple[int, int]]:
    """(row, column) of evenly spaced pixels that have a body and a start."""
    rows, columns = (
        np.unique(np.linspace(0, ds.sizes[key] - 1, SIDE).round().astype(int)) for key in "yx"
    )
    there = (ds.good + ds.failed).values > 0
    return [(int(i), int(j)) for i in rows for j in columns if there[i, j]]


def _end(ds: xr.Dataset, scene: Scene, places: list[tuple[int, int]]) -> tuple[float, float]:
    """(time that FRAMES reach, turn rate of the fastest of some members)."""
    rates = []
    for i, j in (places[0], places[len(places) // 2], places[-1]):
        member = i * ds.sizes["x"] + j
        start = integrated(scene, member, 1, min(scene.run.t_end, scene.run.dt), _step(scene))
        rates.append(reach(start, 1.0)[2])
    rate = max(rates)
    most = FRAMES * 2.0 * TURN / rate if rate > 0.0 else scene.run.t_end
    return min(scene.run.t_end, most), rate


def _pixels(ds: xr.Dataset) -> dict[str, Any]:
    """Values of the measures with their intervals and colours, rows from low y to high."""
    measures = [
        name
        for name in map(str, ds.data_vars)
        if f"{name}_low" in ds or name not in ("good", "failed", "none")
    ]
    measures = [name for name in measures if not name.endswith(("_low", "_high", "_without"))]
    return {
        "sides": [_side(ds[key]) for key in ("x", "y")],
        "members": int(ds.attrs["members"]),
        "good": encoded(ds.good.values),
        "failed": encoded(ds.failed.values),
        "measures": [_measure(ds, name) for name in measures],
    }


def _side(coordinate: xr.DataArray) -> dict[str, Any]:
    a = coordinate.attrs
    units = "" if a["units"] == "1" else f" [{a['units']}]"
    return {
        "values": coordinate.values.tolist(),
        "log": int(a["log"]),
        "name": a["long_name"] + units,
    }


def _measure(ds: xr.Dataset, name: str) -> dict[str, Any]:
    values: NDArray[np.float64] = ds[name].values
    cmap, norm, _ = colour_scale(name, values, {})
    map_of = colormaps[cmap] if isinstance(cmap, str) else cmap
    table = (np.array([map_of(k / 255.0)[:3] for k in range(256)]) * 255.0).round().astype(int)
    places = np.ma.filled(np.ma.masked_invalid(np.asarray(norm(values), dtype=float)), np.nan)
    has = f"{name}_low" in ds
    return {
        "name": name,
        "words": ds[name].attrs.get("long_name", name),
        "units": ds[name].attrs.get("units", "1"),
        # in the units of the variable; a scale without ends is that of a share
        "range": [float(norm.vmin or 0.0), float(norm.vmax or 1.0)],
        "places": encoded(places),
        "values": encoded(values),
        "low": encoded(ds[f"{name}_low"].values) if has else None,
        "high": encoded(ds[f"{name}_high"].values) if has else None,
        "colours": table.tolist(),
    }
