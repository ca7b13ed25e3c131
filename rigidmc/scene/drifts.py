"""By what law the drifts of a run grow: rounding, a bounded error, or one way.

A drift one way is small against all the energy, and yet it ends slow things: rk4 in steps of
0.6 rad takes 1e-4 of the energy of a top, and with it all of its wobble of 0.01 rad
(tests/runs/test_drift_law.py).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.scene.amounts import count_text

LAWS = {"not_judged": 0, "rounding": 1, "bounded": 2, "one_way": 3}
# A drift goes one way if in the second half of the run it never falls below this part of the
# largest of the first half. A bounded error comes back to 0 within a few turns.
BACK = 0.7
JUDGED = 512  # steps of a run that is judged: it has 4 looks or more in each half
FEW = 0.05  # of the members: bounded errors that did not come back by chance
LARGE = 5e-5  # a drift one way that a run warns of: that of a wobble of 0.01 rad


def drift_laws(
    conserved: Mapping[str, str],
    is_reversible: bool,
    stops: bool,
    rows: NDArray[np.float64],
    steps: Any,
    dtype: str,
) -> NDArray[np.int8]:
    """The law of each member of a finished block (rows, n), of LAWS.

    conserved : see `rigidmc.scene.recording.conservation`
    is_reversible : whether the integrator is;  stops : whether an event may stop a member, which
        then keeps its drift and is not judged;  steps : made by each

    Of energy and |L|^2, where they are conserved, the worse counts. Up to

        eps (100 + 30 sqrt(steps))

    of the energies in play, or of |L|^2, a drift is rounding: 10 times that of 32 free tops after
    1e6 steps by all integrators that conserve (6e-13, tests/runs/test_drift_law.py). Reversible
    integrators are not asked for more: their errors come back, but for rounded coefficients in
    float32, and looks in time with the motion may not see it.
    """
    laws = np.zeros(rows.shape[1], np.int8)
    floor = np.finfo(dtype).eps * (100.0 + 30.0 * np.sqrt(steps))
    returns = is_reversible and dtype == "float64"
    with np.errstate(all="ignore"):
        # relative to the energies in play, not to the energy of the start, which may be near 0
        play = rows[layout.START + 1] / rows[layout.START + 3]
        for i, (name, scale) in enumerate((("energy_drift", play), ("l2", 1.0))):
            if conserved[name] != "yes":
                continue
            most, early, least = (
                rows[at + i] for at in (layout.DRIFT, layout.EARLY_DRIFT, layout.LATE_DRIFT)
            )
            stays = (least >= BACK * early) & (not returns)
            law = np.where(stays, LAWS["one_way"], LAWS["bounded"])
            law = np.where(most * scale <= floor, LAWS["rounding"], law)
            laws = np.maximum(laws, law.astype(np.int8))
    judged = (rows[layout.STATUS] == 0.0) & (steps >= JUDGED) & (not stops)
    return np.where(judged, laws, np.int8(LAWS["not_judged"]))


def one_way(dataset: xr.Dataset, least: float = 0.0) -> str:
    """What there is to say of drifts that go one way by `least` and more; "" if nothing, or if so
    few members drift that it may be chance."""
    if "drift_law" not in dataset:
        return ""
    which = dataset["drift_law"].values == LAWS["one_way"]
    if which.mean() < FEW:
        return ""
    names, worst = [], 0.0
    for name, word in (("energy_drift_max", "energy"), ("l2_drift_max", "|L|^2")):
        if dataset[name].attrs["conserved"] == "yes":
            names.append(word)
            worst = max(worst, float(np.nanmax(dataset[name].values[which])))
    if worst < least:
        return ""
    words = f"{names[0]} and {names[1]} drift" if len(names) > 1 else f"{names[0]} drifts"
    return (
        f"{words} one way in {which.sum():,} of {count_text(which.size, 'member')},"
        f" by up to {worst:.1e}: with {dataset.attrs['integrator']} a wobble of"
        f" {math.sqrt(worst):.1g} rad dies or grows in such a run; use shorter steps, or an"
        " integrator that conserves them"
    )
