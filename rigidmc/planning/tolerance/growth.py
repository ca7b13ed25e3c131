"""How fast disturbances of a motion grow."""

import numpy as np

from rigidmc.planning.rates import Array
from rigidmc.planning.tolerance.deviation import errors
from rigidmc.planning.tolerance.pilot import Pilot, States, first_steps, follow

DISTURBANCE = 1e-11  # of the size of the state


def growth(pilot: Pilot) -> tuple[Array, Array]:
    """(factor, rate): how much a disturbance along the way has grown at t_end, and at what rate
    [1/s], for each member.

    The state is disturbed by 1e-11 of its size at the start and every t_end/2, as rounding disturbs
    it at every step (near a separatrix a disturbance at the turn weighs more than one at the
    start), and followed to 4 t_end. The rate is 0 if growth is a power of time, as in regular
    motion: free and Lagrange tops grow as t^2 at most, t^3 with disturbances all along, which is 8
    in twice the time.
    """
    end = pilot.scene.run.t_end
    apart = _distances(pilot)
    rate = np.zeros(pilot.members)
    # the longest doubling of time before the disturbance is as large as the motion
    for i in (1, 2, 3, 4):
        ratio = apart[2 * i - 1] / np.maximum(apart[i - 1], DISTURBANCE)
        exponential = np.log(np.maximum(ratio, 1.0)) / (0.5 * end * i)
        small = apart[2 * i - 1] < 0.1
        rate = np.where(small, np.where(ratio > 32.0, exponential, 0.0), rate)
    # as large as the motion before the first look: no power of time makes 1e10 of a disturbance
    early = np.log(np.maximum(apart[1] / DISTURBANCE, 1.0)) / end
    rate = np.where((rate == 0.0) & (apart[1] >= 0.1), early, rate)
    return np.maximum(apart[1] / DISTURBANCE, 1.0), rate


def _distances(pilot: Pilot) -> Array:
    """How far disturbed states are from undisturbed ones after every t_end/2, (8, n): the root mean
    square over four directions, because one alone may miss the direction that grows."""
    end = pilot.scene.run.t_end
    long = pilot._replace(
        member_steps=False,
        scene=pilot.scene.with_run(t_end=4.0 * end, every=0.5 * end),
        base=8,
        stride=1,
        times=0.5 * end * np.arange(1.0, 9.0),
    )
    name, steps = "rk8" if pilot.scene.effects else "exact", first_steps(long)
    base = follow(long, name, steps)
    squares = np.zeros((8, pilot.members))
    for seed in range(4):
        moved = follow(long, name, steps, nudge=DISTURBANCE, seed=seed)
        for i in range(8):
            pair = (States(s.q[i : i + 1], s.l[i : i + 1], s.status) for s in (moved, base))
            squares[i] += errors(long, *pair)["state"] ** 2 / 4.0
    return np.asarray(np.sqrt(squares))
