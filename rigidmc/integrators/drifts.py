"""The free motion over a time h, exactly or nearly: what splittings alternate with kicks."""

import math
from typing import NamedTuple

from rigidmc.dynamics.free_flow import free_flow
from rigidmc.dynamics.methods import method
from rigidmc.dynamics.turns_flow import split_flow, symmetric_flow

PANEL_TURN = 0.125  # turn lambda h of one panel: attitude off by 4.4e-16, momentum by 1.4e-16 (25 random bodies against 40 digits)
PIECE_TURN = 1.0  # longer drifts are cut: 8 panels compile in 2 s, and more would be no faster


@method
def flow(drift, body, h, l):
    """(turn, change of L) of the free motion over h: the attitude goes from q to q turn."""
    return (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class Exact(NamedTuple):
    """The free motion of any body; the lengths of the tuples say how finely, see `rigidmc.dynamics.free_flow`."""

    halvings: tuple = ()
    panels: tuple = (1.0,)

    def flow(self, body, h, l):
        return free_flow(body, self.halvings, self.panels, h, l)


class Symmetric(NamedTuple):
    """The free motion of bodies with two equal moments: two turns, exact for any h."""

    def flow(self, body, h, l):
        return symmetric_flow(body, h, l)


class Split(NamedTuple):
    """Four turns, order 2; exact for bodies with two equal moments."""

    def flow(self, body, h, l):
        return split_flow(body, h, l)


def exact_drift(turns, largest):
    """The exact drift for steps of `turns` whose longest drift is `largest` of a step; at most PIECE_TURN at a time."""
    if turns.symmetric:
        return Symmetric()
    turn = max(min(turns.free * largest, PIECE_TURN), 1e-300)
    doublings = max(0, math.ceil(math.log2(turn / PANEL_TURN) - 1e-9))
    return Exact((1.0,) * doublings, (0.5**doublings,) * 2**doublings)


def pieces(turns, drift):
    """Into how many pieces a drift over `drift` of a step is cut, so that none turns by more than PIECE_TURN."""
    return 1 if turns.symmetric else max(1, math.ceil(abs(drift) * turns.free / PIECE_TURN - 1e-9))
