"""The figure of a result, headed by what was run."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from rigidmc.views.figure import new_figure
from rigidmc.views.sample import members_in_words


def headed_figure(ds: xr.Dataset, size: tuple[float, float]) -> Figure:
    """An empty figure headed by title, members, integrator, dt, seed, and the flagged members."""
    flagged = np.count_nonzero(ds.status.values)
    facts = [members_in_words(ds.sizes["member"]), ds.attrs.get("integrator", "")]
    facts += [f"dt = {ds.attrs['dt']:.6g} s"] if "dt" in ds.attrs else []
    facts += [f"seed {ds.attrs['seed']}"] if "seed" in ds.attrs else []
    facts += [f"{flagged:,} flagged and left out"] if flagged else []
    title = ds.attrs.get("title", "ensemble")
    return new_figure(f"{title}: {', '.join(filter(None, facts))}", size)
