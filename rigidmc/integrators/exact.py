"""The closed-form motion of a free body, as an integrator."""

import math
from typing import NamedTuple

from rigidmc.dynamics.free_flow import free_flow

PANEL_TURN = 0.125  # turn lambda h of one panel: attitude off by 4.4e-16, momentum by 1.4e-16 (25 random bodies against 40 digits)


class Exact(NamedTuple):
    """The free motion itself: any step, no error but rounding. Refuses torques.

    Long steps are cut into pieces that turn by at most 1 rad, with up to 8 panels of the phase each, chosen once for the scene.
    Source: Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30 (2008) 2084; see `rigidmc.dynamics.free_flow`.
    """

    halvings: tuple = ()
    panels: tuple = (1.0,)

    order = math.inf
    evaluations = 1
    reversible = True
    conserves = ("|q|", "|L|^2", "T", "L in space")
    accepts = "no torque"
    largest_turn = math.inf  # [rad] in a step

    def prepared(self, turn, attitude):
        """(integrator, pieces per step) for steps that turn by `turn` = lambda dt [rad]."""
        pieces = max(1, math.ceil(turn))
        doublings = max(0, math.ceil(math.log2(max(turn / pieces, 1e-300) / PANEL_TURN)))
        made = Exact((), (1.0,) * 2**doublings) if attitude else Exact((1.0,) * doublings, (1.0,))
        return made, pieces

    def step(self, body, h, q, l):
        return free_flow(body, self.halvings, self.panels, h, q, l)
