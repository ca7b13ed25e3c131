"""A few hundred members of a scene, followed by every way of integrating it: what each costs and how far it is from the truth."""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import kinetic_energy
from rigidmc.dynamics.so3 import dot, up
from rigidmc.effects.parameters import blank
from rigidmc.effects.sums import total_energy_scale
from rigidmc.engine import layout
from rigidmc.engine.forces import energies
from rigidmc.engine.frame import Run, Saves
from rigidmc.engine.layout import whole_lanes
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import Program
from rigidmc.integrators import keeps_remainders
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.observables import OBSERVABLES
from rigidmc.planning.plan import carries_attitude, form_of, rounds, spinning_up
from rigidmc.planning.stage import own_steps, physics, rates, stage
from rigidmc.scene.quantities import is_shared, rows

CHECKPOINTS = 8  # times at which states are compared, evenly among those that the scene saves
ROUNDING = 1.1e-16
QUANTITIES = ("state", "momentum", "attitude", "energy", "l2", "lz")
OBSERVED = (OBSERVABLES["attitude"](), OBSERVABLES["momentum"]())
MOST_STEPS = 1_000_000
SPREAD = (
    1.25  # of the fastest member's rate over the mean, from which members have steps of their own
)


class Pilot(NamedTuple):
    """Members of a scene at their start.

    block : rows for the kernel, whole lanes;  first, members : which members;  carried : whether the attitude is part of the state
    base, stride : steps must be a multiple of `base`, and `stride` of it lie between two checks;  times : of the checks [s]
    rates : of the members [rad/s], see `rigidmc.planning.stage.rates`;  own : whether they are so different that each steps by its own, unless torques
        spin members up: their rates are soon others
    """

    scene: Any
    block: np.ndarray
    first: int
    members: int
    carried: bool
    base: int
    stride: int
    times: np.ndarray
    rates: np.ndarray
    own: bool

    def turn(self, steps):
        """How far the fastest member moves in each of `steps` steps [rad]: what all members then move in theirs."""
        return self.scene.run.t_end * float(self.rates.max()) / steps

    def stepped(self, steps):
        """The scene and the block for `steps` steps, of the fastest member where all have their own."""
        if not self.own:
            return self.scene.with_run(dt=self.scene.run.t_end / steps), self.block
        scene, block = self.scene.with_run(turn=self.turn(steps)), self.block.copy()
        block[layout.STEPS] = own_steps(
            rates(scene.effects, block), scene.run.t_end / self.base, scene.run.turn
        )
        return scene, block

    def mean_steps(self, steps):
        """Of all members, in `steps` steps of the fastest."""
        return (
            self.base * float(np.mean(self.stepped(steps)[1][layout.STEPS, : self.members]))
            if self.own
            else steps
        )


class States(NamedTuple):
    """Where members are at the checks: q (times, 4, n) and L (times, 3, n), and status (n,)."""

    q: np.ndarray
    l: np.ndarray
    status: np.ndarray


def pilot(scene, members, first=None):
    """`members` members of a scene, from index `first` on; fewer where the scene has no more rows, one where all are alike."""
    scene.check()
    scene = scene.coarse()
    run = scene.run
    first = run.first if first is None else first
    available = rows(*scene.quantities())
    if is_shared(*scene.quantities()) and not isinstance(scene.start.attitude, str):
        members = 1
    elif available is not None:
        members = min(members, available)
        first = min(first, available - members)
    carried = carries_attitude(scene)
    block, _ = stage(scene, first, members, carried)
    block = np.ascontiguousarray(
        np.pad(block, ((0, 0), (0, whole_lanes(members) - members)), mode="edge")
    )
    base, _, stride = rounds(run.t_end, run.every)
    stride *= max(1, math.ceil(base / stride / CHECKPOINTS))
    times = run.t_end * np.minimum(np.arange(stride, base + stride, stride), base) / base
    rate = rates(scene.effects, block)[:members]
    rate = rate[np.isfinite(rate)] if np.isfinite(rate).any() else np.ones(1)
    own = bool(rate.max() > SPREAD * rate.mean() > 0.0) and not spinning_up(scene)
    return Pilot(scene, block, first, members, carried, base, stride, times, rate, own)


def follow(pilot, integrator, steps, dtype="float64", compensated=False, nudge=0.0, seed=0):
    """The States of a pilot by an integrator in `steps` steps, a multiple of the pilot's base.

    nudge : move the state by so much of its size in a random direction at the start and at every check but the last
    """
    scene, block = pilot.stepped(steps)
    scene = scene.with_run(integrator=integrator)
    if not pilot.own:
        h = scene.run.t_end / steps
        return _saved(
            pilot,
            scene,
            block,
            h,
            1,
            steps,
            steps // pilot.base * pilot.stride,
            dtype,
            compensated,
            nudge,
            seed,
        )
    slots = int(block[layout.STEPS].max())
    h, total, stride = scene.run.t_end / pilot.base, slots * pilot.base, slots * pilot.stride
    return _saved(pilot, scene, block, h, slots, total, stride, dtype, compensated, nudge, seed)


def _saved(
    pilot,
    scene,
    block,
    h,
    slots,
    steps,
    stride,
    dtype="float64",
    compensated=False,
    nudge=0.0,
    seed=0,
):
    """The States after every `stride` of `steps` slots, and at the end."""
    made, *_ = form_of(scene, h)
    compensated = keeps_remainders(scene.run.integrator, scene.effects, dtype, compensated)
    program = Program(made, blank(scene.effects), OBSERVED, pilot.carried, compensated, dtype)
    width, saves, some = (
        block.shape[1],
        (steps + stride - 1) // stride + 1,
        np.random.default_rng(seed),
    )
    share = layout.LANES * max(1, math.ceil(width / layout.LANES / threads_available()))
    parts = [block[:, low : low + share].copy() for low in range(0, width, share)]
    out, own = np.empty(saves * 7 * width), int(scene.run.turn is not None)

    def advance(i, first, last):
        saved = Saves(out, width, i * share, np.arange(parts[i].shape[1]))
        program.advance(parts[i], Run(h, slots, stride, steps, own, first, last), saves=saved)

    with ThreadPoolExecutor(len(parts)) as pool:
        for first in range(0, steps, stride if nudge else steps):
            for block in parts if nudge else ():
                push(block, nudge, pilot.carried, some)
            last = min(first + stride, steps) if nudge else steps
            for _ in pool.map(
                advance, range(len(parts)), [first] * len(parts), [last] * len(parts)
            ):
                pass
    found = out.reshape(saves, 7, width)[1:, :, : pilot.members]
    return States(
        found[:, :4],
        found[:, 4:],
        np.concatenate([block[layout.STATUS] for block in parts])[: pilot.members],
    )


def drift_along(pilot, integrator, steps, at, dt, looks=4096):
    """{quantity: largest drift so far of the worst member, after each number of steps in `at`} for energy, |L|^2 and L_z.

    Every one of the first `looks` steps is looked at, and as many evenly spaced ones of all.
    """
    body, effects = physics(pilot.scene.effects, pilot.block[:, : pilot.members])
    q0, l0 = (
        pilot.block[rows, : pilot.members]
        for rows in (slice(layout.ATTITUDE, layout.MOMENTUM), slice(layout.MOMENTUM, layout.REST))
    )
    first, size, largest = _kept(body, effects, q0, l0), np.sqrt(dot(l0, l0)), dict[str, dict]()
    scales = {
        "energy": kinetic_energy(body, l0) + total_energy_scale(effects, body),
        "l2": size**2,
        "lz": size,
    }
    for total in dict.fromkeys((min(steps, looks), steps)):
        stride = max(1, total // looks)
        states = _saved(
            pilot,
            pilot.scene.with_run(integrator=integrator, dt=dt),
            pilot.block,
            dt,
            1,
            total,
            stride,
        )
        after = np.append(np.arange(stride, total, stride), total)
        for name, values in _kept(
            body, effects, np.moveaxis(states.q, 1, 0), np.moveaxis(states.l, 1, 0)
        ).items():
            with np.errstate(all="ignore"):
                drift = np.abs(values - first[name]) / np.where(
                    scales[name] > 0.0, scales[name], 1.0
                )
            worst = np.maximum.accumulate(
                np.nan_to_num(np.where(states.status == 0, drift, np.inf), nan=np.inf).max(1)
            )
            seen = {
                n: worst[np.searchsorted(after, n, "right") - 1]
                for n in at
                if after[0] <= n <= total
            }
            largest.setdefault(name, {}).update(
                {n: max(x, largest.get(name, {}).get(n, 0.0)) for n, x in seen.items()}
            )
    return {name: np.maximum.accumulate([found[n] for n in at]) for name, found in largest.items()}


def _kept(body, effects, q, l):
    """{quantity: values} of what a top may keep."""
    return {
        "energy": kinetic_energy(body, l) + energies(effects, body, q),
        "l2": dot(l, l),
        "lz": dot(l, up(q)),
    }


def push(block, size, carried, some):
    """Move the states of a block by `size` of their own size in random directions."""
    l = block[layout.MOMENTUM : layout.REST]
    push = some.normal(size=l.shape)
    l += size * push * np.linalg.norm(l, axis=0) / np.linalg.norm(push, axis=0)
    if carried:
        q = block[: layout.MOMENTUM]
        q += 0.5 * size * some.normal(size=q.shape)
        q /= np.linalg.norm(q, axis=0)


def errors(pilot, states, true):
    """{quantity: largest error over the checks of each member}: momentum of its size, attitude [rad], the larger of the two as
    "state", energy and L_z of the sizes in play, |L|^2 of its size."""
    body, effects = physics(pilot.scene.effects, pilot.block[:, : pilot.members])
    found: dict[str, list] = {name: [] for name in QUANTITIES}
    with np.errstate(all="ignore"):
        for q, l, true_q, true_l in zip(states.q, states.l, true.q, true.l, strict=True):
            size = np.sqrt(dot(true_l, true_l))
            size = np.where(size > 0.0, size, 1.0)
            momentum = np.sqrt(((l - true_l) ** 2).sum(0)) / size
            turned = attitude_error(q.T, true_q.T) if pilot.carried else np.zeros(pilot.members)
            kinetic = kinetic_energy(body, true_l)
            energy = np.abs(
                kinetic_energy(body, l)
                - kinetic
                + energies(effects, body, q)
                - energies(effects, body, true_q)
            )
            scale = kinetic + total_energy_scale(effects, body)
            found["momentum"].append(momentum)
            found["attitude"].append(turned)
            found["state"].append(np.maximum(momentum, turned))
            found["energy"].append(energy / np.where(scale > 0.0, scale, 1.0))
            found["l2"].append(np.abs(dot(l, l) - dot(true_l, true_l)) / size**2)
            lz = dot(l, up(q)) - dot(true_l, up(true_q))
            found["lz"].append(np.abs(lz) / size if pilot.carried else np.zeros(pilot.members))
    return {
        name: np.where(states.status == 0, np.max(np.nan_to_num(x, nan=np.inf), axis=0), np.inf)
        for name, x in found.items()
    }


def growth(pilot):
    """(factor, rate): how much a disturbance along the way has grown at t_end, and at what rate [1/s], for each member.

    The state is disturbed by 1e-11 of its size at the start and every t_end/2, as rounding disturbs it at every step (near a separatrix a
    disturbance at the turn weighs more than one at the start), and followed to 4 t_end. The rate is 0 where growth is a power of time, as
    in regular motion: free and Lagrange tops grow as t^2 at most, t^3 with disturbances all along, which is 8 in twice the time.
    """
    size, end = 1e-11, pilot.scene.run.t_end
    long = pilot._replace(
        own=False,
        scene=pilot.scene.with_run(t_end=4.0 * end, every=0.5 * end),
        base=8,
        stride=1,
        times=0.5 * end * np.arange(1, 9),
    )
    name, steps = "rk8" if pilot.scene.effects else "exact", first_steps(long)
    base = follow(long, name, steps)
    squares = np.zeros((8, pilot.members))
    for seed in range(4):  # in as many directions: one alone may miss the one that grows
        moved = follow(long, name, steps, nudge=size, seed=seed)
        for i in range(8):
            squares[i] += (
                errors(
                    long, *(States(s.q[i : i + 1], s.l[i : i + 1], s.status) for s in (moved, base))
                )["state"]
                ** 2
                / 4.0
            )
    apart = np.sqrt(squares)
    rate = np.zeros(pilot.members)
    for i in (
        1,
        2,
        3,
        4,
    ):  # the longest doubling of time before the disturbance is as large as the motion
        ratio = apart[2 * i - 1] / np.maximum(apart[i - 1], size)
        seen = apart[2 * i - 1] < 0.1
        rate = np.where(
            seen,
            np.where(ratio > 32.0, np.log(np.maximum(ratio, 1.0)) / (0.5 * end * i), 0.0),
            rate,
        )
    # as large as the motion before the first look: no power of time makes 1e10 of a disturbance
    rate = np.where(
        (rate == 0.0) & (apart[1] >= 0.1), np.log(np.maximum(apart[1] / size, 1.0)) / end, rate
    )
    return np.maximum(apart[1] / size, 1.0), rate


def first_steps(pilot):
    """Steps that turn by a quarter of a radian at the start's spin, at least 40; a multiple of the base."""
    block = pilot.block
    omega = np.sqrt(
        ((block[layout.BODY : layout.BODY + 3] * block[layout.MOMENTUM : layout.REST]) ** 2).sum(0)
    )
    rate = float(np.max(omega, where=np.isfinite(omega), initial=0.0))
    return pilot.base * max(1, math.ceil(max(pilot.scene.run.t_end * rate / 0.25, 40) / pilot.base))


def upper_quantile(values, share=0.99, sure=0.95):
    """The smallest element of a sample that exceeds the quantile of its distribution with probability `sure`; else the largest."""
    ordered, n = np.sort(values), len(values)
    from scipy import stats  # half a second, which only a chosen step has to wait for

    rank = int(stats.binom.ppf(sure, n, share)) + 1
    return float(ordered[min(n, rank) - 1])
