"""What the pictures of an ensemble read: evenly spaced times and members, without flagged ones.

So a million members take seconds.

The figure of a result, headed by what was run.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigidmc.figures import new_figure
from rigidmc.results.labels import count_text

TIMES = 4000  # saves read at most: as many as a line on a picture can show
# members read at most: MEMBERS, more up to POINTS vectors, fewer beyond VECTORS
MEMBERS, POINTS, VECTORS = 20_000, 2_000_000, 8_000_000
DRAWN = 4  # members drawn as lines: more are hard to follow

SAVES = "rigidmc_saves"  # of the result, in the encoding of a sample

_STATES = ("omega", "momentum", "attitude", "start_omega", "start_momentum")


def sample(ds: xr.Dataset) -> xr.Dataset:
    """Evenly spaced members and times in memory, without flagged members.

    The last time is among them. A sample of a sample is the sample itself.
    """
    times, members = ds.sizes.get("time", 1), ds.sizes["member"]
    read = min(times, TIMES)
    most = min(VECTORS // read, max(MEMBERS, POINTS // read))
    every, stride = -(-times // TIMES), -(-members // most)
    states = [name for name in _STATES if name in ds]
    even = {
        "time": slice((times - 1) % every, None, every),
        "member": slice(None, None, stride),
    }
    # the momentum of rotors decides how fast omega turns, see `rigidmc.views.resolution`
    held = [name for name in map(str, ds.data_vars) if name.endswith("_momentum")]
    held = [name for name in held if name not in states and ds[name].dims == ("axis", "member")]
    names = [*states, *held, "moments", "status", "energy_drift_max", "l2_drift_max"]
    part = ds[names].isel(even, missing_dims="ignore").load()
    good = part.status == 0
    for name in states:
        others = [dim for dim in part[name].dims if dim != "member"]
        good = good & (abs(part[name]) < np.inf).all(others)
    if not good.any():
        raise ValueError(
            f"nothing to draw: all of the {good.size:,} members looked at are flagged or not finite"
        )
    part = part if good.all() else part.isel(member=good.values)
    part.encoding[SAVES] = ds.encoding.get(SAVES) or _saves(ds)
    return part


def _saves(ds: xr.Dataset) -> tuple[int, float]:
    """How many saves a result has, and the longest time between two [s]."""
    t = np.atleast_1d(ds.time.values)
    return t.size, float(np.diff(t).max(initial=0.0))


def vectors(part: xr.Dataset, name: str) -> tuple[NDArray[np.float64], str]:
    """omega or momentum (time, axis, member) and its times in words.

    Either gives the other by L_i = I_i omega_i. If neither was saved, those of the start.
    """
    for prefix in ("", "start_"):
        for saved in ("omega", "momentum"):
            if prefix + saved in part:
                v = part[prefix + saved].transpose(..., "axis", "member").values
                v = v if v.ndim == 3 else v[None]
                moments = part.moments.transpose("axis", "member").values
                v = v if saved == name else v * moments if name == "momentum" else v / moments
                return v, "at the start (nothing later was saved)" if prefix else span(part)
    raise ValueError(
        "nothing to draw: neither omega nor momentum, not even at the start:"
        ' run with save=("omega",)'
    )


def span(part: xr.Dataset, save: int | None = None) -> str:
    """The times of a sample in words, or the time of one save."""
    t = part.time.values
    if save is None and t.size > 2:
        return f"t = {t[0]:,.7g} to {t[-1]:,.7g} s"
    return f"t = {t[-1 if save is None else save]:,.7g} s"


def drawn_members(values: NDArray[Any]) -> NDArray[np.int_]:
    """Indices of DRAWN members, evenly spaced over the last axis."""
    return np.unique(np.linspace(0, values.shape[-1] - 1, DRAWN).round().astype(int))


def headed_figure(ds: xr.Dataset, size: tuple[float, float]) -> Figure:
    """An empty figure headed by title, members, integrator, dt, seed, and the flagged members."""
    flagged = np.count_nonzero(ds.status.values)
    facts = [count_text(ds.sizes["member"], "member"), ds.attrs.get("integrator", "")]
    facts += [f"dt = {ds.attrs['dt']:.6g} s"] if "dt" in ds.attrs else []
    facts += [f"seed {ds.attrs['seed']}"] if "seed" in ds.attrs else []
    facts += [f"{flagged:,} flagged and left out"] if flagged else []
    title = ds.attrs.get("title", "ensemble")
    return new_figure(f"{title}: {', '.join(filter(None, facts))}", size)
