"""The free motion over a time h, exact or by rotations: what splittings alternate with kicks."""

import math
from typing import NamedTuple

from rigidmc.dynamics.free_flow import free_flow
from rigidmc.dynamics.methods import method
from rigidmc.dynamics.turns_flow import split_flow, symmetric_flow
from rigidmc.integrators.form import Turns

# Angle lambda h of one panel [rad]. Errors: attitude 4.4e-16, momentum 1.4e-16 (25 random bodies
# against 40 digits).
PANEL_TURN = 0.125
PIECE_TURN = 1.0  # [rad] longer drifts are cut: 8 panels compile in 2 s, and more are no faster


@method
def flow(drift, body, h, l):
    """(r, change of L) of the free motion over h, which takes the attitude from q to q r."""
    return (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class Exact(NamedTuple):
    """The free motion of any body.

    The lengths of the tuples say how fine its quadrature is, see `rigidmc.dynamics.free_flow`.
    """

    halvings: tuple[float, ...] = ()
    panels: tuple[float, ...] = (1.0,)

    def flow(self, body, h, l):
        return free_flow(body, self.halvings, self.panels, h, l)


class Symmetric(NamedTuple):
    """The free motion of bodies with two equal moments: two rotations, exact for any h."""

    def flow(self, body, h, l):
        return symmetric_flow(body, h, l)


class Split(NamedTuple):
    """The free motion as four rotations: order 2; exact for bodies with two equal moments."""

    def flow(self, body, h, l):
        return split_flow(body, h, l)


def exact_drift(turns: Turns, largest: float) -> Symmetric | Exact:
    """The exact drift for steps that turn by `turns`, at most PIECE_TURN at a time.

    largest : the longest drift of a step, as a share of the step
    """
    if turns.symmetric:
        return Symmetric()
    # 1e-300 rad: a free rate of 0 has no logarithm
    angle = max(min(turns.free * largest, PIECE_TURN), 1e-300)
    doublings = max(0, math.ceil(math.log2(angle / PANEL_TURN) - 1e-9))
    return Exact((1.0,) * doublings, (0.5**doublings,) * 2**doublings)


def pieces(turns: Turns, drift: float) -> int:
    """The number of pieces of a drift, so that none turns by more than PIECE_TURN.

    drift : length of the drift, as a share of the step
    """
    return 1 if turns.symmetric else max(1, math.ceil(abs(drift) * turns.free / PIECE_TURN - 1e-9))
