"""Errors and drifts of a pilot's states, and the growth of disturbances of its motion."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigidmc.engine.formulas import energies
from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import StepRange
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.euler import kinetic_energy
from rigidmc.physics.dynamics.so3 import dot, vertical
from rigidmc.physics.effects.sums import total_energy_scale
from rigidmc.planning.steps import physics
from rigidmc.planning.tolerance.pilot import (
    Pilot,
    PilotStates,
    first_steps,
    integrate_pilot,
    states_along,
)

QUANTITIES = ("state", "momentum", "attitude", "energy", "l2", "lz")


def relative(change: Array, size: Array) -> Array:
    """Divide a change by a size of the same unit: 0 for no change, inf if only the size is 0."""
    with np.errstate(all="ignore"):
        return np.where(change == 0.0, 0.0, change / size)


def _sizes(body: Any, effects: Any, l: Any) -> tuple[Array, Array]:
    """Return (energies in play [J], |L|); at rest, |L| is the largest that the energies allow."""
    play = kinetic_energy(body, l) + total_energy_scale(effects, body)
    size = np.sqrt(dot(l, l))
    widest = np.sqrt(2.0 * play / np.min([body.i1, body.i2, body.i3], axis=0))
    return play, np.where(size > 0.0, size, widest)


def _turned(q: Array, true_q: Array) -> Array:
    """Return angles between attitudes (4, n); nan where steps were so long that there is none."""
    sizes = np.linalg.norm([q, true_q], axis=1)  # inf of finite numbers beyond 1e154, too
    valid = (np.isfinite(sizes) & (sizes > 0.0)).all(0)
    # any attitude stands in for a missing one, whose angle is nan
    pair = (np.where(valid, each, 1.0).T for each in (q, true_q))
    turned: Array = np.where(valid, attitude_error(*pair), np.nan)
    return turned


def errors(pilot: Pilot, states: PilotStates, true: PilotStates) -> dict[str, Array]:
    """Return {quantity: largest error over the checks of each member}.

    momentum : relative to its size;  attitude : [rad];  state : the larger of these two
    energy : relative to the energies in play;  l2, lz : of |L|^2 and L_z, relative to the size
    """
    body, effects = physics(pilot.scene.effects, pilot.block[:, : pilot.members])
    zeros = np.zeros(pilot.members)
    checks: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    with np.errstate(all="ignore"):
        for q, l, true_q, true_l in zip(states.q, states.l, true.q, true.l, strict=True):
            scale, size = _sizes(body, effects, true_l)
            momentum = relative(np.sqrt(((l - true_l) ** 2).sum(0)), size)
            turned = _turned(q, true_q) if pilot.has_attitude else zeros
            energy = np.abs(
                kinetic_energy(body, l)
                - kinetic_energy(body, true_l)
                + energies(effects, body, q)
                - energies(effects, body, true_q)
            )
            lz = dot(l, vertical(q)) - dot(true_l, vertical(true_q))
            checks["momentum"].append(momentum)
            checks["attitude"].append(turned)
            checks["state"].append(np.maximum(momentum, turned))
            checks["energy"].append(relative(energy, scale))
            checks["l2"].append(relative(np.abs(dot(l, l) - dot(true_l, true_l)), size**2))
            checks["lz"].append(relative(np.abs(lz), size) if pilot.has_attitude else zeros)
    return {
        name: np.where(
            states.status == 0, np.max(np.nan_to_num(x, nan=np.inf, posinf=np.inf), axis=0), np.inf
        )
        for name, x in checks.items()
    }


def drift_along(
    pilot: Pilot, integrator: str, steps: int, at: ArrayLike, dt: float, looks: int = 4096
) -> dict[str, Array]:
    """Return {quantity: largest drift so far of the worst member, after each step in `at`} for
    energy, |L|^2 and L_z.

    The drift is evaluated at each of the first `looks` steps, and at equally many evenly spaced
    steps of the whole run.
    """
    at = [int(n) for n in np.atleast_1d(at)]
    body, effects = physics(pilot.scene.effects, pilot.block[:, : pilot.members])
    q0 = pilot.block[layout.ATTITUDE : layout.MOMENTUM, : pilot.members]
    l0 = pilot.block[layout.MOMENTUM : layout.EXTRA, : pilot.members]
    first, (play, size) = _conserved(body, effects, q0, l0), _sizes(body, effects, l0)
    scales = {"energy": play, "l2": size**2, "lz": size}
    scene = pilot.scene.with_run(integrator=integrator, dt=dt)
    largest: dict[str, dict[int, float]] = {name: {} for name in scales}
    for total in dict.fromkeys((min(steps, looks), steps)):
        stride = max(1, total // looks)
        run = StepRange(dt, 1, stride, total, int(scene.run.turn is not None), 0, total)
        states = states_along(pilot, scene, pilot.block, run)
        after = np.append(np.arange(stride, total, stride), total)
        q, l = np.moveaxis(states.q, 1, 0), np.moveaxis(states.l, 1, 0)
        for name, values in _conserved(body, effects, q, l).items():
            drift = relative(np.abs(values - first[name]), scales[name])
            drift = np.nan_to_num(
                np.where(states.status == 0, drift, np.inf), nan=np.inf, posinf=np.inf
            )
            worst, seen = np.maximum.accumulate(drift.max(1)), largest[name]
            for n in at:
                if after[0] <= n <= total:
                    last = np.searchsorted(after, n, "right") - 1
                    seen[n] = max(worst[last], seen.get(n, 0.0))
    return {name: np.maximum.accumulate([seen[n] for n in at]) for name, seen in largest.items()}


def _conserved(body: Any, effects: tuple[Any, ...], q: Any, l: Any) -> dict[str, Array]:
    """Return {quantity: values} for quantities that a top may conserve."""
    return {
        "energy": kinetic_energy(body, l) + energies(effects, body, q),
        "l2": dot(l, l),
        "lz": dot(l, vertical(q)),
    }


def upper_quantile(values: ArrayLike, share: float = 0.99, sure: float = 0.95) -> float:
    """Return the smallest element of a sample that exceeds the quantile of its distribution with
    probability `sure`, or the largest element if none does."""
    from scipy.special import bdtr  # takes 0.25 s, needed only when a tolerance chooses the step

    ordered = np.sort(np.asarray(values))
    n = len(ordered)
    # The quantile of the binomial distribution; importing `scipy.stats` takes 0.4 s more.
    rank = int(np.searchsorted(bdtr(np.arange(n + 1), n, share), sure)) + 1
    return float(ordered[min(n, rank) - 1])


DISTURBANCE = 1e-11  # relative to the size of the state


def measure_growth(pilot: Pilot) -> tuple[Array, Array]:
    """Return (factor, rate) for each member: the growth of a disturbance at t_end, and its
    exponential rate [1/s].

    The state is disturbed by 1e-11 of its size at the start and every t_end/2, as rounding disturbs
    it at every step, and followed to 4 t_end. (Near a separatrix, a disturbance at the turn matters
    more than one at the start.) The rate is 0 if growth is a power of time, as in regular motion:
    free and Lagrange tops grow at most as t^2, or as t^3 with disturbances all along, which is a
    factor of 8 in twice the time.
    """
    end = pilot.scene.run.t_end
    apart = _distances(pilot)
    rate = np.zeros(pilot.members)
    # the longest doubling of time before the disturbance is as large as the motion
    for i in (1, 2, 3, 4):
        ratio = apart[2 * i - 1] / np.maximum(apart[i - 1], DISTURBANCE)
        exponential = np.log(np.maximum(ratio, 1.0)) / (0.5 * end * i)
        small = apart[2 * i - 1] < 0.1
        # t^3, the fastest growth of regular motion, is a factor of 8 in twice the time
        rate = np.where(small, np.where(ratio > 32.0, exponential, 0.0), rate)
    # as large as the motion at the first save: no power of time amplifies a disturbance by 1e10
    early = np.log(np.maximum(apart[1] / DISTURBANCE, 1.0)) / end
    rate = np.where((rate == 0.0) & (apart[1] >= 0.1), early, rate)
    return np.maximum(apart[1] / DISTURBANCE, 1.0), rate


def _distances(pilot: Pilot) -> Array:
    """Return the distances of disturbed from undisturbed states after every t_end/2, (8, n).

    Each is the root mean square over four directions, because a single direction may miss the
    growing one.
    """
    end = pilot.scene.run.t_end
    long = pilot._replace(
        member_steps=False,
        scene=pilot.scene.with_run(t_end=4.0 * end, every=0.5 * end),
        base=8,
        stride=1,
        times=0.5 * end * np.arange(1.0, 9.0),
    )
    name, steps = "rk8" if pilot.scene.effects else "exact", first_steps(long)
    base = integrate_pilot(long, name, steps)
    squares = np.zeros((8, pilot.members))
    for seed in range(4):
        moved = integrate_pilot(long, name, steps, nudge=DISTURBANCE, seed=seed)
        for i in range(8):
            pair = (PilotStates(s.q[i : i + 1], s.l[i : i + 1], s.status) for s in (moved, base))
            squares[i] += errors(long, *pair)["state"] ** 2 / 4.0
    return np.asarray(np.sqrt(squares))
