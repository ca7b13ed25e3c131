"""The plan of a run: everything that is resolved before its first step."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import NoiseKeys
from rigidmc.engine.kernel.layout import RowMap
from rigidmc.engine.machine import allocate_block
from rigidmc.engine.program_spec import NO_DERIVATIVES, Derivatives
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array, Ints
from rigidmc.physics.dynamics.methods import Flag, implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import facts, has_memory, is_conservative
from rigidmc.physics.integrators import StepScheme, keeps_remainders
from rigidmc.physics.integrators.protocol import Integrator, has_extra_state
from rigidmc.physics.integrators.splitting import ScoredLangevin
from rigidmc.physics.observables import is_own
from rigidmc.physics.observables.saving import outputs_with_derivatives
from rigidmc.physics.observables.statistics import counts_steps
from rigidmc.planning.initial import (
    InitialMembers,
    Source,
    Start,
    initial_block,
    initial_block_of,
    noise_keys,
    work_flags,
)
from rigidmc.planning.monitors import Monitors, monitor_notes, nodes, places_of
from rigidmc.planning.scheme import SPUN_UP, Limits, largest_rates, make_limits, make_scheme
from rigidmc.planning.steps import (
    TimeGrid,
    count_member_steps,
    make_time_grid,
    rate_bounds,
    round_grid,
)
from rigidmc.planning.switches import switching_parameters
from rigidmc.planning.tangents import tangents_at_start
from rigidmc.scene.model import Model
from rigidmc.scene.recording import Recording, conservation
from rigidmc.scene.settings import Run

# Derivatives of each number in a pass: with 3, 6 parameters cost 11.2 plain runs by rk8 and 12.4 by
# rk4 with gravity; with 6, 18.2 and 12.8 (512 bits, `python -m bench derivatives`). More spill.
AT_ONCE = 3
MOST_SAVES = 10**7  # their times alone use 80 MB


class Plan(NamedTuple):
    """A run, fully resolved. A plan does not depend on threads, blocks or the device.

    model, run, kind, recording : what moves, the settings, the integrator, what is recorded
    grid : steps and saves; with per-member steps, its steps are rounds, and each member makes
        several steps in a round
    has_member_steps : whether members have their own steps
    mean_steps : mean number of steps of a member to the end
    scheme : how the integrator makes a step, None for closed forms
    angle : largest turn of the pilot's members in a step at the start [rad]
    turn_rate : bound on the rate of free motion, if the integrator requires one [rad/s]
    compensated : whether sums keep their remainders
    notes : hints to the user;  limits : bounds that flag a member, () if there are none
    works : see `rigidmc.planning.initial.work_flags`
    monitors : quantities recorded at every step;  places : their rows in a block
    nodes : monitored states in a step, the last at its end; 0 if only the end is known
    conserved : see `rigidmc.scene.recording.conservation`
    paired : whether a step has the noise of two steps of half its length, as in coarse paths of a
        multilevel study, see `rigidmc.studies.multilevel.levels`
    wrt : parameters by which saved values are differentiated
    derivatives : that each number of a block and of a save has, at least one per parameter; those
        beyond are 0 and fill the last pass
    """

    model: Model
    run: Run
    kind: Integrator
    recording: Recording
    grid: TimeGrid
    has_member_steps: bool
    mean_steps: float
    scheme: StepScheme | None
    angle: float
    turn_rate: float | None
    compensated: bool
    notes: tuple[str, ...]
    limits: Limits | tuple[()]
    works: tuple[Flag, ...]
    monitors: Monitors
    places: RowMap
    nodes: int
    conserved: dict[str, str]
    paired: bool = False
    wrt: tuple[str, ...] = ()
    derivatives: Derivatives = NO_DERIVATIVES

    @property
    def has_attitude(self) -> bool:
        """Whether the attitude is followed."""
        return self.monitors.has_attitude

    @property
    def has_axes(self) -> bool:
        """Whether observables are of axes other than the principal axes."""
        return self.places.axes < self.places.end

    @property
    def has_cuts(self) -> bool:
        """Whether effects cut steps."""
        effects = self.model.effects
        return bool(switching_parameters(effects)) or any(map(has_memory, effects))

    @property
    def columns(self) -> int:
        """Number of derivatives that each number of a block and of a save has."""
        return self.derivatives.at_once * self.derivatives.passes

    def noise(self, members: Ints) -> NoiseKeys:
        """Return the keys of the noise of members by their indices."""
        return noise_keys(self.model.effects, self.run.seed, members)

    def initial(
        self, sampler: Source, members: Ints, pilot: InitialMembers | None = None
    ) -> tuple[Array, Start]:
        """Build members by their indices, which fill whole lanes.

        Returns their rows, and the sampled values they were built from. With derivatives, the
        `places.end` rows are followed by as many for each column j, from row places.end (1 + j) on:
        their derivatives by parameter j.
        pilot : the first members, if they are already built
        """
        shape, first = (self.has_attitude, self.places.end), int(members[0])
        if not np.array_equal(members, np.arange(first, first + members.size)):
            block, start = initial_block_of(self.model, sampler, members, *shape)
        elif pilot is not None and first + members.size <= pilot.block.shape[1]:
            block, start = pilot.part(self.model, first, members.size, self.places.end)
        else:
            block, start = initial_block(self.model, sampler, first, members.size, *shape)
        if self.has_axes:
            block[self.places.axes : self.places.end] = start["principal_axes"]
        if self.has_member_steps:
            rate = rate_bounds(self.model.effects, block)
            block[layout.STEPS] = count_member_steps(rate, self.grid.dt, self.run.turn)
        return self._with_tangents(block, sampler, members) if self.columns else block, start

    def _with_tangents(self, block: Array, sampler: Source, members: Ints) -> Array:
        """Return a block with the rows of its derivatives."""
        rows, count = block.shape
        wide = allocate_block(rows * (1 + self.columns), count)
        axes = self.places.axes if self.has_axes else None
        wide[:rows], wide[rows:] = block, 0.0
        tangents = wide[rows : rows * (1 + len(self.wrt))].reshape(-1, rows, count)
        at = self.model, sampler, members
        tangents_at_start(*at, self.wrt, tangents, self.has_attitude, axes)
        return wide

    def with_kernels_of(self, other: "Plan") -> "Plan":
        """Return the plan with the derivatives that the kernels of another plan compute, if these
        serve its parameters; else itself."""
        mine, others = self.derivatives, other.derivatives
        serve = others.of_body >= mine.of_body and others.of_effects >= mine.of_effects
        if not (mine.at_once and others.at_once and serve):
            return self
        passes = math.ceil(len(self.wrt) / others.at_once)
        return self._replace(derivatives=others._replace(passes=passes))

    def bounds(self) -> dict[str, float]:
        """Return the finite limits among those a scene may set, under their names in the scene."""
        if not self.limits:
            return {}
        lowest = {
            "energy_limit": self.limits.energy,
            "momentum_limit": min(self.limits.l2, self.limits.lz),
            "turn_limit": self.limits.turn,
        }
        return {name: value for name, value in lowest.items() if value < math.inf}


class _Steps(NamedTuple):
    """The time grid of a run, and the motion of members per step.

    grid : of all members, or of the rounds of members with their own steps
    has_member_steps, mean_steps : as in Plan
    angle, theta : largest turn of the pilot's members in a step, at the spin of the start, and at
        the bound on their rate [rad]
    """

    grid: TimeGrid
    has_member_steps: bool
    mean_steps: float
    angle: float
    theta: float


def make_plan(
    model: Model,
    run: Run,
    kind: Integrator,
    recording: Recording,
    monitors: Monitors,
    pilot: InitialMembers,
    wrt: tuple[str, ...] = (),
) -> Plan:
    """Return the Plan of a checked run; raise SceneError if it cannot run.

    kind : the integrator of `run`;  wrt : as in Plan
    pilot : the first members of the coarse model
    """
    effects, steps = model.effects, _steps(model.effects, run, pilot.block)
    grid, mean = steps.grid, steps.mean_steps
    scheme, rate, spin = None, None, 0.0
    if run.integrator != "closed":
        scheme, rate, spin = make_scheme(kind, model, run, pilot.block, grid.dt)
    if scheme and monitors.of_noise:
        scheme = scheme._replace(integrator=ScoredLangevin(scheme.integrator))
    # torques may raise a member's turn to theta
    reach = steps.theta if effects else steps.angle
    notes = (
        *grid.notes,
        *_step_notes(kind, steps),
        *monitor_notes(effects, monitors, reach, grid.dt, run.turn is not None),
        *_notes_on_what_is_lost(effects, run, monitors, wrt),
    )
    _refuse_saves(grid, run, effects, monitors)
    conserved = conservation(effects, recording.has_work)
    has_observables = bool(recording.recorded or monitors.events or monitors.running)
    has_axes = model.body.is_turned and model.body.frame == "described" and has_observables
    # without the attitude, L_z is not monitored
    bounded = conserved if monitors.has_attitude else {**conserved, "lz": "no"}
    return Plan(
        model=model,
        run=run,
        kind=kind,
        recording=recording,
        grid=grid,
        has_member_steps=steps.has_member_steps,
        mean_steps=mean,
        scheme=scheme,
        angle=steps.angle,
        turn_rate=rate,
        compensated=not (scheme and has_extra_state(scheme.integrator))
        and keeps_remainders(kind, effects, run.dtype, run.compensated),
        notes=notes,
        limits=make_limits(run, kind, bounded, steps.theta, mean, scheme, spin) if scheme else (),
        works=work_flags(effects, recording.has_work),
        monitors=monitors,
        places=places_of(effects, recording.has_work, monitors, has_axes),
        nodes=nodes(effects, monitors, reach),
        conserved=conserved,
        wrt=wrt,
        derivatives=choose_derivatives(wrt),
    )


def _notes_on_what_is_lost(
    effects: Sequence[Any], run: Run, monitors: Monitors, wrt: tuple[str, ...]
) -> Iterator[str]:
    """Yield notes on members that spin up beyond their own steps, and on missing derivatives."""
    own_steps = run.turn is not None and run.integrator != "closed"
    if own_steps and (driving := driving_effects(effects)):
        rule = (
            f"steps follow the spin at the start, but {', '.join(driving)} may spin members up; a "
            f"member that turns by {SPUN_UP:g} times as much in a step is flagged"
        )
        yield f"[run] turn = {run.turn:g}: {rule}; a fixed dt ignores the start"
    custom = [pair for pair in monitors.of_running if wrt and is_own(pair[1])]
    if lost := [label for label, kind in custom if not outputs_with_derivatives(label, kind)]:
        rule = "its method `results` uses functions that have none"
        yield f"[run] wrt: {', '.join(lost)} has no derivatives: {rule}"


def _refuse_saves(grid: TimeGrid, run: Run, effects: Sequence[Any], monitors: Monitors) -> None:
    """Raise SceneError for too many saves, and for steps that are shorter than monitors allow."""
    if not grid.listed and (saves := grid.steps // grid.stride) > MOST_SAVES:
        rule = f"{saves:,} saves exceed the limit of {MOST_SAVES:,}"
        raise SceneError(rule, at="run.every", value=run.every)
    if grid.is_shortened:
        _refuse_counts(monitors, "run.every", run.every, f"does not divide t_end = {run.t_end:g} s")
    for name, time in switching_parameters(effects)[:1]:
        _refuse_counts(monitors, name, time, "is a switching time")


def choose_derivatives(wrt: Sequence[str]) -> Derivatives:
    """Return the Derivatives of a run by parameters, in passes as few and as equal as possible."""
    if not wrt:
        return NO_DERIVATIVES
    passes = math.ceil(len(wrt) / AT_ONCE)
    of_body = any(name.startswith("body.") for name in wrt)
    # parameters of effects that are fixed in the body turn with its principal axes
    of_effects = any(name.startswith("effects.") for name in wrt) or of_body
    return Derivatives(math.ceil(len(wrt) / passes), passes, of_body, of_effects)


def _steps(effects: Sequence[Any], run: Run, pilot: Array) -> _Steps:
    if run.integrator == "closed":
        saves = round_grid(run.t_end, run.every)
        return _Steps(saves, False, saves.steps, 0.0, 0.0)
    if run.turn is not None:
        made = round_grid(run.t_end, run.every)
        mean = float(np.mean(count_member_steps(rate_bounds(effects, pilot), made.dt, run.turn)))
        return _Steps(made, True, made.steps * mean, run.turn, run.turn)
    even = make_time_grid(run.t_end, run.dt, run.every)
    angle, theta = (even.dt * rate for rate in largest_rates(effects, pilot))
    return _Steps(even, False, even.steps, angle, theta)


def _refuse_counts(monitors: Monitors, at: str, value: Any, why: str) -> None:
    """Raise SceneError for an observable over steps that cannot weigh shorter steps.

    at, value, why : the parameter that makes some steps shorter, and how
    """
    if monitors.of_noise:
        raise SceneError(f"{why}, and noise_score needs steps of equal length", at=at, value=value)
    for label, monitor in monitors.of_running:
        if counts_steps(monitor):
            is_last = at == "run.every"
            rule = (
                f"{why}, and {'the last steps' if is_last else 'steps around it'} are shorter: "
                f"{label} needs a method `reweighed`"
            )
            rule += ", or an `every` that divides t_end" if is_last else ""
            raise SceneError(rule, at=at, value=value)


def _step_notes(kind: Integrator, steps: _Steps) -> tuple[str, ...]:
    """Return a note if steps are so long that errors are large."""
    if kind.order == math.inf or steps.angle <= (most := longest_step(kind)):
        return ()
    longest = f"dt <= {most * steps.grid.dt / steps.angle:.2g} s"
    limit = f"turn <= {most:g}" if steps.has_member_steps else longest
    return (
        f"omega dt reaches {steps.angle:.3g} rad per step, more than {most:g}: expect large errors;"
        f" use {limit}",
    )


def longest_step(kind: Integrator) -> float:
    """Return the largest turn [rad] that a step may make without a note about large errors.

    For 64 heavy tops, a step's error reaches 1e-3 rad (median) at 0.86 rad with rk4, 0.9 to 1.2
    with the Lie-group methods, 2.8 with rk8 and 3.4 with gbs12 (free tops: 1.1, 1.2 to 1.8, 4.9
    and 6.2; tests/planning/test_limits.py). From pi on, checks flag every step.
    `midpoint`, of order 2, can solve for at most 0.5. A splitting turns exactly at any speed: a
    long step only samples the torque less often.
    """
    # the power fits these turns: 1 rad for order 4, 2.7 rad for order 8
    most = 3.0
    return most if kind.is_splitting else round(min(most, max(1.0, (kind.order / 4.0) ** 1.45)), 1)


def driving_effects(effects: Sequence[Any]) -> list[str]:
    """Return the labels of effects that may give a body more energy than its start implies: torques
    that are not a brake and have neither an energy nor a bound on one."""
    return [
        label
        for label, e in label_effects(effects)
        if implements(e, "torque")
        and not any(implements(e, verb) for verb in ("energy", "energy_scale", "is_driving"))
        and not facts(e).is_damping
        and not is_conservative(e)
    ]
