"""Pilots: a few hundred members of a scene that candidates integrate, to measure their errors."""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import SaveTarget, StepRange
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import Program
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators import StepScheme, keeps_remainders
from rigidmc.physics.observables import OBSERVABLES
from rigidmc.planning.check import check_scene
from rigidmc.planning.initial import Source, initial_block, make_pilot, make_sampler
from rigidmc.planning.monitors import Monitors, make_monitors
from rigidmc.planning.plan import driving_effects
from rigidmc.planning.scheme import make_scheme
from rigidmc.planning.steps import Clock, count_member_steps, rate_bounds, round_grid
from rigidmc.planning.switches import cut_rows
from rigidmc.processes.threads import Task, threads_of
from rigidmc.scene.quantities import count_rows, is_shared
from rigidmc.scene.save_times import settled
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run

CHECKPOINTS = 8  # times at which states are compared, evenly spaced among the scene's saves
ROUNDING = 1.1e-16
OBSERVED = (OBSERVABLES["attitude"](), OBSERVABLES["momentum"]())
MOST_STEPS = 1_000_000
# members have their own steps if the fastest rate is at least this multiple of the mean
SPREAD = 1.25


class Effort:
    """The evaluations of the torque that a search has spent, and how many it may spend."""

    def __init__(self) -> None:
        self.spent, self.limit = 0.0, math.inf

    def allows(self, evaluations: float, share: float = 1.0) -> bool:
        """Return whether some more evaluations stay within a share of the limit."""
        return self.spent + evaluations <= share * self.limit


class Pilot(NamedTuple):
    """Members of a scene at their start.

    scene : with coarser grids, in the units of integration;  sampler : source of its draws
    monitors : of the scene;  bounds : a block of members whose motion bounds all others
    block : rows for the kernel, whole lanes;  first, members : the range of members
    has_attitude : whether the attitude is part of the state
    base, stride : steps are a multiple of `base`, with `stride` of these units between two checks
    times : of the checks [s];  rates : of the members [rad/s], see
        `rigidmc.planning.steps.rate_bounds`
    member_steps : whether members have their own steps, because their rates differ much; false if
        torques spin members up, because the rates soon change
    effort : of all integrations of this pilot and of its parts
    """

    scene: Scene
    sampler: Source
    monitors: Monitors
    bounds: Array
    block: Array
    first: int
    members: int
    has_attitude: bool
    base: int
    stride: int
    times: Array
    rates: Array
    member_steps: bool
    effort: Effort

    def work(self, integrator: str, steps: int) -> float:
        """Return the evaluations of the torque of an integration; a step without any takes as long
        as four."""
        evaluations = self.scene.known_integrators()[integrator].evaluations
        return self.members * self.mean_steps(steps) * max(4, evaluations)

    def turn(self, steps: int) -> float:
        """Return how far the fastest member moves in each of `steps` steps [rad]; with per-member
        steps, this bounds all members."""
        return float(self.scene.run.t_end * float(self.rates.max()) / steps)

    def stepped(self, steps: int) -> tuple[Scene, Array]:
        """Return the scene and block for `steps` steps, of the fastest member if each has its
        own."""
        if not self.member_steps:
            return self.scene.with_run(dt=self.scene.run.t_end / steps), self.block
        scene, block = self.scene.with_run(turn=self.turn(steps)), self.block.copy()
        span = scene.run.t_end / self.base
        block[layout.STEPS] = count_member_steps(
            rate_bounds(scene.effects, block), span, scene.run.turn
        )
        return scene, block

    def scheme(self, scene: Scene, h: float) -> StepScheme:
        """Return how the scene's integrator makes steps of h [s]; SceneError if these are too
        long for it."""
        return make_scheme(scene.integrator, scene.model, scene.run, self.bounds, h)[0]

    def mean_steps(self, steps: int) -> float:
        """Return the mean number of steps of all members for `steps` steps of the fastest."""
        if not self.member_steps:
            return steps
        return self.base * float(np.mean(self.stepped(steps)[1][layout.STEPS, : self.members]))


class PilotStates(NamedTuple):
    """States of members at the checks: q (times, 4, n) and L (times, 3, n), and status (n,)."""

    q: Array
    l: Array
    status: Array


def pilot(scene: Scene, members: int, first: int | None = None) -> Pilot:
    """Build a pilot of `members` members of a scene, from index `first` on.

    It has fewer members if the scene has too few rows, and one if all are alike.
    """
    recorded = scene.recording
    check_scene(scene, recorded)
    monitors = make_monitors(scene.model, recorded, scene.run.seed)
    scene = scene.with_model(scene.model.coarse())
    run, model = scene.run, scene.model
    sampler = make_sampler(model, run)
    first = run.first if first is None else first
    available = count_rows(*model.quantities())
    if is_shared(*model.quantities()) and not isinstance(model.start.attitude, str):
        members = 1
    elif available is not None:
        members = min(members, available)
        first = min(first, available - members)
    attitude = monitors.has_attitude
    block, _ = initial_block(model, sampler, first, members, attitude)
    bounds = make_pilot(model, sampler, attitude).block
    padding = whole_lanes(members) - members
    block = np.ascontiguousarray(np.pad(block, ((0, 0), (0, padding)), mode="edge"))
    rate = rate_bounds(scene.effects, block)[:members]
    rate = rate[np.isfinite(rate)] if np.isfinite(rate).any() else np.ones(1)
    own_steps = bool(rate.max() > SPREAD * rate.mean() > 0.0) and not driving_effects(scene.effects)
    shape = *_checks(run), rate, own_steps
    return Pilot(
        scene, sampler, monitors, bounds, block, first, members, attitude, *shape, Effort()
    )


def _checks(run: Run) -> tuple[int, int, Array]:
    """Return (base, stride, times) of the checks of a pilot."""
    saves = round_grid(run.t_end, run.every)
    # a pilot has steps of one length, so its checks are evenly spaced even if the saves are not
    base, stride = (CHECKPOINTS, 1) if saves.is_shortened else (saves.steps, saves.stride)
    stride = 1 if saves.listed else stride
    stride *= max(1, math.ceil(base / stride / CHECKPOINTS))
    times = run.t_end * np.minimum(np.arange(stride, base + stride, stride), base) / base
    return base, stride, times


def part_of(pilot: Pilot, members: int, share: float) -> Pilot:
    """Return the first members of a pilot over the first `share` of the time, or to the next
    save."""
    members = min(members, pilot.members)
    some = pilot._replace(
        block=np.ascontiguousarray(pilot.block[:, : whole_lanes(members)]),
        members=members,
        rates=pilot.rates[:members],
    )
    run = pilot.scene.run
    end, every = share * run.t_end, settled(run.every)
    if share >= 1.0:
        return some
    if isinstance(every, float) and every < end:
        end = min(every * math.ceil(end / every), run.t_end)
    else:  # states are compared along the way, not only at the end
        every = end / CHECKPOINTS
    scene = pilot.scene.with_run(t_end=end, every=every)
    base, stride, times = _checks(scene.run)
    return some._replace(scene=scene, base=base, stride=stride, times=times)


def integrate_pilot(
    pilot: Pilot,
    integrator: str,
    steps: int,
    dtype: str = "float64",
    compensated: bool = False,
    nudge: float = 0.0,
    seed: int = 0,
) -> PilotStates:
    """Integrate a pilot in `steps` steps, a multiple of its base.

    nudge : move the state by this fraction of its size in a random direction, set by `seed`, at the
        start and at every check but the last
    """
    pilot.effort.spent += pilot.work(integrator, steps)
    scene, block = pilot.stepped(steps)
    scene = scene.with_run(integrator=integrator)
    if pilot.member_steps:
        slots = int(block[layout.STEPS].max())
        h, total, stride = scene.run.t_end / pilot.base, slots * pilot.base, slots * pilot.stride
    else:
        slots, h, total = 1, scene.run.t_end / steps, steps
        stride = steps // pilot.base * pilot.stride
    disturb = None
    if nudge:
        chance = np.random.default_rng(seed)
        disturb = partial(perturb, size=nudge, has_attitude=pilot.has_attitude, chance=chance)
    run = StepRange(h, slots, stride, total, int(scene.run.turn is not None), 0, total)
    return states_along(pilot, scene, block, run, dtype, compensated, disturb)


def states_along(
    pilot: Pilot,
    scene: Scene,
    block: Array,
    run: StepRange,
    dtype: str = "float64",
    compensated: bool = False,
    disturb: Callable[[Array], None] | None = None,
) -> PilotStates:
    """Return the states of a pilot after every `run.stride` of `run.total` slots, and at the end.

    disturb : called with each part of the block at the start and after every stride but the last
    """
    scheme = pilot.scheme(scene, run.h)
    compensated = keeps_remainders(scene.integrator, scene.effects, dtype, compensated)
    units = run.total // run.slots
    clock = Clock(run.h, units, run.h)
    cuts = cut_rows(scene.effects, clock, units, bool(run.member_steps))
    shortens, run = len(cuts) > 1, run.cut(cuts)
    effects, attitude = blank(scene.effects), pilot.has_attitude
    spec = ProgramSpec(scheme, effects, OBSERVED, attitude, compensated, dtype, shortens=shortens)
    program = Program(spec)
    width, saves = block.shape[1], (run.total + run.stride - 1) // run.stride + 1
    share = layout.LANES * max(1, math.ceil(width / layout.LANES / threads_available()))
    parts = [block[:, low : low + share].copy() for low in range(0, width, share)]
    out = np.empty(saves * 7 * width)

    def advance(i: int, first: int, last: int) -> None:
        saved = SaveTarget(out, width, i * share, np.arange(parts[i].shape[1]))
        program.advance(parts[i], run._replace(first=first, last=last), saves=saved)

    stride = run.stride if disturb else run.total
    pool = threads_of("pilot", len(parts))
    for first in range(0, run.total, stride):
        if disturb:
            for part in parts:
                disturb(part)
        last = min(first + stride, run.total)
        pool.run([Task(advance, i, first, last) for i in range(len(parts))])
    values = out.reshape(saves, 7, width)[1:, :, : pilot.members]
    status = np.concatenate([part[layout.STATUS] for part in parts])[: pilot.members]
    return PilotStates(values[:, :4], values[:, 4:], status)


def perturb(block: Array, size: float, has_attitude: bool, chance: np.random.Generator) -> None:
    """Move the states of a block by `size`, relative to their size, in random directions."""
    l = block[layout.MOMENTUM : layout.EXTRA]
    direction = chance.normal(size=l.shape)
    l += size * direction * np.linalg.norm(l, axis=0) / np.linalg.norm(direction, axis=0)
    if has_attitude:
        q = block[: layout.MOMENTUM]
        q += 0.5 * size * chance.normal(size=q.shape)
        q /= np.linalg.norm(q, axis=0)


def first_steps(pilot: Pilot) -> int:
    """Return steps of 0.25 rad at the start's spin, at least 40, as a multiple of the base."""
    inverse = pilot.block[layout.BODY : layout.BODY + 3]
    momentum = pilot.block[layout.MOMENTUM : layout.EXTRA]
    omega: NDArray[np.float64] = np.sqrt(((inverse * momentum) ** 2).sum(0))
    rate = float(np.max(omega, where=np.isfinite(omega), initial=0.0))
    # with steps of 0.25 rad rk8 is 5e-12 off after 10 s of heavy_top; 2e-9 with 0.5 rad, 6e-7 with
    # 1 rad
    steps = max(pilot.scene.run.t_end * rate / 0.25, 40)
    return int(pilot.base * max(1, math.ceil(steps / pilot.base)))
