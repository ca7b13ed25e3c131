"""The search for a root within a step, by regula falsi after Illinois."""

import sys

from rigidmc.dynamics.so3 import select
from rigidmc.engine.compose import inline_all


def guess(ends):
    """Where the level is 0 by a straight line between two steps back, and within the step.

    ends = (share of the step, level there, share, level there)
    """
    low, below, high, above = ends
    apart = above - below
    # what is divided by 1 is not taken
    share = low - (high - low) * (below / select(apart == 0.0, 1.0, apart))
    return select(apart == 0.0, low, min(max(share, min(low, high)), max(low, high)))


def narrowed(ends, share, here):
    """The next ends after Illinois, one of them `share` with the level `here`.

    An end that stays has its level halved.
    """
    low, below, high, above = ends
    between = here * above < 0.0  # the level is 0 between `share` and the newer end
    return select(between, high, low), select(between, above, 0.5 * below), share, here


inline_all(sys.modules[__name__])
