"""Splittings: the exact free motion alternates with kicks by the torques."""

import math
from typing import NamedTuple

from rigidmc.dynamics.free_flow import free_flow
from rigidmc.effects.verbs import kick_all, kick_all_back
from rigidmc.integrators.exact import PANEL_TURN


class Strang(NamedTuple):
    """Kick by h/2, exact free motion by h, kick by h/2: order 2, symmetric, symplectic to the rounding of the free motion.

    For torques that depend on attitude and time, or that bring their own exact flow (damping). Energy error bounded for ever,
    L_z kept under gravity; the best choice for fast tops over long times.
    Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Celledoni et al. 2008, section 4.
    """

    halvings: tuple = ()
    panels: tuple = (1.0,)

    order = 2
    evaluations = 1
    reversible = True
    conserves = ("|q|", "|L|^2", "T", "L in space")
    accepts = "torques with an exact flow"
    largest_turn = 4.0  # [rad] in a step: 32 panels; more would compile for minutes and be no good

    def prepared(self, turn, attitude):
        """(integrator, 1) for steps that turn by `turn` = lambda dt [rad]; at most 32 panels, which is 4 rad."""
        panels = 2 ** max(0, math.ceil(math.log2(max(turn, 1e-300) / PANEL_TURN)))
        return Strang((), (1.0,) * panels), 1

    def step(self, body, effects, t, h, q, l):
        l = kick_all(effects, body, t, 0.5 * h, q, l)
        q, l = free_flow(body, self.halvings, self.panels, h, q, l)
        return q, kick_all_back(effects, body, t + h, 0.5 * h, q, l)
