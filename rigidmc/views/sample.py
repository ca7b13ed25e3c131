"""What the pictures of an ensemble read: evenly spaced times and members, without flagged ones.

So a million members take seconds.
"""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

TIMES = 400  # saves read at most
MEMBERS, POINTS = 20_000, 2_000_000  # members read, or more up to so many vectors
DRAWN = 4  # members drawn as lines: more are hard to follow

_STATES = ("omega", "momentum", "attitude", "start_omega", "start_momentum")


def sample(ds: xr.Dataset) -> xr.Dataset:
    """Evenly spaced members and times in memory, without flagged members.

    The last time is among them. A sample of a sample is the sample itself.
    """
    times, members = ds.sizes.get("time", 1), ds.sizes["member"]
    every, stride = -(-times // TIMES), -(-members // max(MEMBERS, POINTS // min(times, TIMES)))
    states = [name for name in _STATES if name in ds]
    even = {
        "time": slice((times - 1) % every, None, every),
        "member": slice(None, None, stride),
    }
    names = [*states, "moments", "status", "energy_drift_max", "l2_drift_max"]
    part = ds[names].isel(even, missing_dims="ignore").load()
    good = part.status == 0
    for name in states:
        others = [dim for dim in part[name].dims if dim != "member"]
        good = good & (abs(part[name]) < np.inf).all(others)
    if not good.any():
        raise ValueError(
            f"nothing to draw: all of the {good.size:,} members looked at are flagged or not finite"
        )
    return part if good.all() else part.isel(member=good.values)


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


def members_in_words(count: int) -> str:
    """ "1 member", "20,000 members"."""
    return f"{count:,} member{'' if count == 1 else 's'}"


def drawn_members(values: NDArray[Any]) -> NDArray[np.int_]:
    """Indices of DRAWN members, evenly spaced over the last axis."""
    return np.unique(np.linspace(0, values.shape[-1] - 1, DRAWN).round().astype(int))
