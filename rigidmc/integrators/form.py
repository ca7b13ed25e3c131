"""From an integrator to its compiled form: one type for a family, and the parts of a step."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.methods import implements


class Turns(NamedTuple):
    """By how much a step turns the fastest member of a scene [rad].

    free : lambda dt, the angle by which free motion turns L in the body
    spin : |omega| dt
    symmetric : whether all bodies have two equal moments
    """

    free: float = 0.0
    spin: float = 0.0
    symmetric: bool = False


class Form(NamedTuple):
    """An integrator as the engine takes it.

    integrator : the NamedTuple whose type is compiled
    parts : (1 + n, 4) rows of (drift, kick, gradient, time of the torque) in units of the step;
        row 0 opens the state, the n others are one step
    name : by which a scene asks for it
    """

    integrator: Any
    parts: NDArray[np.float64]
    name: str = ""


ONE = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0))  # a step in one part


def form(kind: Any, turns: Turns | None = None, effects: Sequence[Any] = ()) -> Form:
    """The Form of an integrator of INTEGRATORS for steps that turn by `turns`."""
    compiled = Form(kind, np.array(ONE))
    if implements(kind, "prepared"):
        compiled = kind.prepared(turns or Turns(), effects)
    elif implements(kind, "form"):
        compiled = kind.form()
    return compiled
