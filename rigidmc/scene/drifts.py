"""Classification of the drifts of a run: rounding, a bounded error, or one way.

A one-way drift, small compared with the total energy, can end slow motions: rk4 in steps of 0.6 rad
removes 1e-4 of the energy of a top, and with it all of its wobble of 0.01 rad
(tests/runs/test_drift_law.py).
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.arrays import Array

if TYPE_CHECKING:
    import xarray as xr

LAWS = {"not_judged": 0, "rounding": 1, "bounded": 2, "one_way": 3}
# A drift is one way if, in the second half of the run, it never falls below this fraction of its
# maximum in the first half. A bounded error returns to 0 within a few turns.
BACK = 0.7
EPSILON = {dtype: float(np.finfo(dtype).eps) for dtype in ("float32", "float64")}
JUDGED = 512  # fewest steps of a classified run: at least 4 health checks in each half
FEW = 0.05  # fraction of members: bounded errors that by chance did not return
LARGE = 5e-5  # one-way drift that causes a warning: the energy of a wobble of 0.01 rad


def drift_laws(
    conserved: Mapping[str, str],
    is_reversible: bool,
    stops: bool,
    rows: Array,
    steps: Any,
    dtype: str,
) -> NDArray[np.int8]:
    """Return the class, in LAWS, of the drift of each member of a finished block (rows, n).

    conserved : see `rigidmc.scene.recording.conservation`
    is_reversible : whether the integrator is reversible;  stops : whether an event may stop a
        member, whose drift is then constant and not classified;  steps : steps of each member

    Of the drifts of energy and |L|^2, where these are conserved, the worse counts. A drift is
    rounding up to

        eps (100 + 30 sqrt(steps))

    relative to the energies involved, or to |L|^2: 10 times the drift of 32 free tops after 1e6
    steps with all conserving integrators (6e-13, tests/runs/test_drift_law.py). Errors of
    reversible integrators in float64 always count as bounded: they return, although health checks
    synchronous with the motion may miss it. In float32 rounded coefficients break reversibility.
    """
    laws = np.full(rows.shape[1], LAWS["not_judged"], np.int8)
    kept = [i for i, name in enumerate(("energy_drift", "l2")) if conserved[name] == "yes"]
    if stops or not kept or np.max(steps, initial=0.0) < JUDGED:
        return laws
    floor = EPSILON[dtype] * (100.0 + 30.0 * np.sqrt(steps))
    returns = is_reversible and dtype == "float64"
    stays, rounds = np.zeros(laws.size, bool), np.ones(laws.size, bool)
    with np.errstate(all="ignore"):
        for i in kept:
            most = rows[layout.DRIFT + i]
            if i == 0:
                # relative to the energies involved, not to the initial energy, which may be near 0
                most = most * (rows[layout.ENERGY_SCALE] / rows[layout.ENERGY_IN_PLAY])
            small = most <= floor
            rounds &= small
            if not returns:
                stays |= (
                    rows[layout.LATE_DRIFT + i] >= BACK * rows[layout.EARLY_DRIFT + i]
                ) & ~small
    judged = (rows[layout.STATUS] == 0.0) & (steps >= JUDGED)
    for law, where in (
        ("bounded", judged),
        ("rounding", rounds & judged),
        ("one_way", stays & judged),
    ):
        np.copyto(laws, LAWS[law], where=where)
    return laws


def one_way(dataset: "xr.Dataset", least: float = LARGE, drifting: int | None = None) -> str:
    """Return a warning about one-way drifts of `least` or more; "" for none, or if so few members
    drift that it may be chance.

    Integrators that conserve nothing drift one way at any step, so the direction alone is not a
    fault: a drift of 4e-11 ends no wobble of 0.01 rad (tests/runs/test_drift_law.py).

    drifting : how many members drift one way, if known
    """
    if "drift_law" not in dataset or (
        drifting is not None and drifting < FEW * dataset.sizes["member"]
    ):
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
        f" {math.sqrt(worst):.1g} rad decays or grows in such a run; use shorter steps, or a"
        " conserving integrator"
    )
