"""From an integrator to what is compiled: one type for a whole family, and a table of the parts of its step."""

from typing import Any, NamedTuple

import numpy as np


class Turns(NamedTuple):
    """How far the members of a scene turn in one step at most [rad].

    free : lambda dt, by which free motion turns L in the body;  spin : |omega| dt;  symmetric : all bodies have two equal moments
    """

    free: float = 0.0
    spin: float = 0.0
    symmetric: bool = False


class Form(NamedTuple):
    """An integrator as a kernel wants it.

    integrator : the NamedTuple whose type is compiled
    parts : (1 + n, 4) rows of (drift, kick, gradient, time of the torque) in units of the step: row 0 opens the state, the others are
        one step
    name : by which a scene asks for it
    """

    integrator: Any
    parts: np.ndarray
    name: str = ""


ONE = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0))  # a step in one part


def form(kind, turns=None, effects=()):
    """The Form of an integrator of INTEGRATORS for steps that turn by `turns`."""
    if hasattr(kind, "prepared"):
        return kind.prepared(turns or Turns(), effects)
    return kind.form() if hasattr(kind, "form") else Form(kind, np.array(ONE))
