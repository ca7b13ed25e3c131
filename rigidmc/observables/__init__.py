"""What is recorded at save times. An observable is a NamedTuple with `value` and its facts; a new one is one class and one line below.

    value(self, [body, effects, t, q, l, start, works]) -> tuple of floats      start = (E, 1/scale of E, |L|^2, 1/|L|^2) at t = 0

Facts: units, long_name, dims (() for a number, ("axis",) for 3, ("quat",) for 4, ("effect",) for one of each effect).
"""

from typing import Any

from rigidmc.observables.invariants import L2, Energy, EnergyDrift, L2Drift
from rigidmc.observables.state import Attitude, Momentum, Omega
from rigidmc.observables.work import Work

OBSERVABLES: dict[str, Any] = {
    "omega": Omega,
    "momentum": Momentum,
    "attitude": Attitude,
    "energy": Energy,
    "l2": L2,
    "energy_drift": EnergyDrift,
    "l2_drift": L2Drift,
    "work": Work,
}
SIZES = {(): 1, ("axis",): 3, ("quat",): 4}


def rows_of(effects, *names):
    """How many numbers the named observables are for one member at one time."""
    return sum({**SIZES, ("effect",): len(effects)}[OBSERVABLES[name].dims] for name in names)
