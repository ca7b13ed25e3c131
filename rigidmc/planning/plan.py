"""From a scene to a Plan: everything that is resolved before the first step."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.cuda.devices import chosen, device_now, number_of
from rigidmc.engine.kernel.layout import whole_lanes
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import labelled
from rigidmc.physics.effects.protocol import facts, is_conservative, is_random
from rigidmc.physics.integrators import Form, keeps_remainders
from rigidmc.physics.integrators.protocol import Integrator, keeps_its_own
from rigidmc.physics.observables import value_rows
from rigidmc.physics.observables.keep import thinned
from rigidmc.physics.observables.statistics import counts_steps
from rigidmc.planning.block_size import WAVE, block_of
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.initial import check_starts
from rigidmc.planning.limits import SPUN_UP, Limits, limits
from rigidmc.planning.monitors import Watch, watch
from rigidmc.planning.scheme import carries_attitude, form_of, largest_rates, mean_own_steps
from rigidmc.planning.steps import Grid, grid, rounds
from rigidmc.scene.conservation import booked_labels
from rigidmc.scene.quantities import is_shared
from rigidmc.scene.scene import Scene
from rigidmc.scene.validation import PILOT

ARC = 1.6  # [rad] that a member may move between two states of a step that are watched
LARGEST_TURN = 3.0  # [rad] in a step that is watched: beyond it the attitude within is 1e-3 off
# [rad] with noise, where only the ends of steps are known: of 50 heavy tops to t = 25 watched after
# steps of 1.6 rad, nutation was up to 0.43 rad off and 43 of 801 passages were missed
RANDOM_TURN = 0.3
MOST_SAVES = 10**7  # their times alone are 80 MB


class Plan(NamedTuple):
    """What a run will do, resolved.

    first, members : place of the first member, and how many there are
    which : the indices of the members at places 0, 1, ...; None if they are these numbers
    steps, dt, stride : steps to the end, their length [s], steps between saves; with member steps
        these are of rounds, in each of which a member makes some steps
    head, last_dt : steps before the last interval if that is shorter than others, and the length of
        those in it [s]; else all steps, and dt
    member_steps : whether members have steps of their own;  mean_steps : of a member to the end
    times : of the saves [s];  thinned : indices of the saves that are kept of thinned observables
    form : the compiled form of the integrator; None for closed forms
    carried : whether the attitude is followed;  block : members of a block
    constant : names of the member variables that are the same for all
    angle : largest |omega| dt of the pilot [rad]
    turn_rate : bound on the rate of free motion if the integrator asks for it [rad/s]
    dtype : of the numbers in which steps are made;  compensated : whether sums keep their
        remainders
    notes : what the user should know;  limits : what flags a member, () if nothing does
    labels : of the effects whose works are saved;  watch : what is kept of every step
    nodes : states that are watched in a step, the last at its end; 0 if only the end is known
    saved : {observable: rows of its values} of what is recorded at saves
    paired : whether a step has the noise of two steps of half its length, as
        coarse paths of a multilevel study have, see `rigidmc.studies.multilevel.levels`
    device : where members move, see `rigidmc.engine.cuda.devices`
    """

    first: int
    members: int
    steps: int
    dt: float
    stride: int
    head: int
    last_dt: float
    member_steps: bool
    mean_steps: float
    times: NDArray[np.float64]
    thinned: NDArray[np.int64]
    form: Form | None
    carried: bool
    block: int
    constant: frozenset[str]
    angle: float
    turn_rate: float | None
    dtype: str
    compensated: bool
    notes: tuple[str, ...]
    limits: Limits | tuple[()]
    labels: tuple[str, ...]
    watch: Watch
    nodes: int
    saved: dict[str, slice]
    which: NDArray[np.int64] | None = None
    paired: bool = False
    device: str = "cpu"

    def indices(self, first: int, count: int) -> NDArray[np.int64]:
        """The indices of `count` members from place `first` on; beyond the end, of the last."""
        if self.which is None:
            return np.arange(first, first + count)
        return self.which[np.minimum(np.arange(first, first + count), self.which.size - 1)]

    def of(self, which: NDArray[np.int64]) -> "Plan":
        """The plan of some of the members, by their indices."""
        return self._replace(first=0, members=which.size, which=which)

    @property
    def grid(self) -> Grid:
        """The steps, of rounds with member steps."""
        return Grid(self.steps, self.dt, self.stride, self.head, self.last_dt)

    @property
    def values(self) -> int:
        """How many numbers a member records at a save."""
        return max((rows.stop for rows in self.saved.values()), default=0)

    def moved_at_once(self, threads: int) -> float:
        """For how many members a thread or a graphics processor needs the time of all of them."""
        each = self.members / self.movers(threads)
        return each if self.device == "cpu" else max(WAVE, each)

    def movers(self, threads: int) -> int:
        """How many threads or graphics processors move members at once."""
        return threads if self.device == "cpu" else len(chosen(number_of(self.device)))

    def bounds(self) -> dict[str, float]:
        """The finite limits among those that a scene may set, by their names there."""
        if not self.limits:
            return {}
        lowest = {
            "energy_limit": self.limits.energy,
            "momentum_limit": min(self.limits.l2, self.limits.lz),
            "turn_limit": self.limits.turn,
        }
        return {name: value for name, value in lowest.items() if value < math.inf}


class _Steps(NamedTuple):
    """The time grid of a run, and how far a step moves a member.

    grid : of all members, or of the rounds of members with steps of their own
    member_steps, mean_steps : as in Plan
    angle, theta : how far the fastest member of the pilot turns in a step at the start, and at its
        rate [rad]
    """

    grid: Grid
    member_steps: bool
    mean_steps: float
    angle: float
    theta: float


def prepare(
    scene: Scene, threads: int = 1, streaming: bool = False, block: int | None = None
) -> Plan:
    """The Plan of a scene, which is checked; SceneError if it cannot be run.

    streaming : whether blocks go to a file, which limits their size;  block : members of a block
    """
    scene.check()
    check_starts(scene.coarse())
    run, watched = scene.run, watch(scene)
    carried = carries_attitude(scene, watched)
    steps = _steps(scene, carried)
    times, mean = steps.grid, steps.mean_steps
    form, rate, spin = (None, None, 0.0) if run.integrator == "closed" else form_of(scene, times.dt)
    notes = times.notes + _step_notes(scene, steps)
    # torques may bring a member to theta
    reach = steps.theta if scene.effects else steps.angle
    notes += watched_notes(scene, watched, reach, times.dt)
    if steps.member_steps and (driving := spinning_up(scene)):
        rule = (
            f"steps are those of the start, and {', '.join(driving)} may spin members up; one that "
            f"turns by {SPUN_UP:g} times as much in a step is flagged"
        )
        notes += (f"[run] turn = {run.turn:g}: {rule}; dt goes by no start",)
    if (saves := times.steps // times.stride) > MOST_SAVES:
        rule = f"{saves:,} saves are more than the limit of {MOST_SAVES:,}"
        raise SceneError("run", "every", run.every, rule)
    if times.is_shortened:
        _refuse_counts(scene, watched)
    slots = np.append(np.arange(0, times.steps, times.stride), times.steps)
    saved = value_rows(scene.recorded(), len(scene.effects))
    few = thinned(len(slots), run.thin) if "thinned" in scene.kept().values() else np.empty(0, int)
    plan = Plan(
        first=run.first,
        members=run.members,
        steps=times.steps,
        dt=times.dt,
        stride=times.stride,
        head=times.head,
        last_dt=times.last_dt,
        member_steps=steps.member_steps,
        mean_steps=mean,
        times=times.clock.time(slots),
        thinned=few,
        form=form,
        carried=carried,
        block=block or 0,  # or what `block_of` makes of this plan, below
        constant=_constant(scene),
        angle=steps.angle,
        turn_rate=rate,
        dtype=run.dtype,
        compensated=not (form and keeps_its_own(form.integrator))
        and keeps_remainders(scene.integrator, scene.effects, run.dtype, run.compensated),
        notes=notes,
        limits=limits(scene, carried, steps.theta, mean, form, spin) if form else (),
        labels=booked_labels(scene),
        watch=watched,
        nodes=nodes(scene, watched, reach),
        saved=saved,
        device="cpu" if form is None else device_now(),
    )
    return plan if block else plan._replace(block=block_of(plan, threads, streaming))


def _steps(scene: Scene, carried: bool) -> _Steps:
    run = scene.run
    if run.integrator == "closed":
        closed_form(scene, whole_lanes(min(PILOT, run.members)))  # raises if there is none
        saves = rounds(run.t_end, run.every)
        return _Steps(saves, False, saves.steps, 0.0, 0.0)
    if run.turn is not None:
        made = rounds(run.t_end, run.every)
        mean = made.steps * mean_own_steps(scene, carried, made.dt)
        return _Steps(made, True, mean, run.turn, run.turn)
    even = grid(run.t_end, run.dt, run.every)
    angle, theta = (even.dt * rate for rate in largest_rates(scene, carried))
    return _Steps(even, False, even.steps, angle, theta)


def _refuse_counts(scene: Scene, watched: Watch) -> None:
    """Raise SceneError for a user's observable over steps that cannot tell shorter steps apart."""
    for label, one in watched.of_running:
        if counts_steps(one):
            rule = (
                f"does not divide t_end = {scene.run.t_end:g} s, and the last steps are shorter:"
                f" {label} needs a method reweighed, or an `every` that divides t_end"
            )
            raise SceneError("run", "every", scene.run.every, rule)


def _step_notes(scene: Scene, steps: _Steps) -> tuple[str, ...]:
    """A note if steps are so long that the errors are large."""
    kind = scene.integrator
    if kind.order == math.inf or steps.angle <= (most := longest_step(kind)):
        return ()
    longest = f"dt <= {most * steps.grid.dt / steps.angle:.2g} s"
    would = f"turn <= {most:g}" if steps.member_steps else longest
    return (
        f"omega dt reaches {steps.angle:.3g} rad per step, more than {most:g}: expect large errors;"
        f" {would} would do",
    )


def longest_step(kind: Integrator) -> float:
    """By how much a step may turn a body [rad] before a note says that errors are large.

    Of 64 heavy tops a step errs by 1e-3 rad (median) from 0.86 rad on with rk4, 0.9 to 1.2 with the
    Lie-group methods and 2.8 with rk8 (free tops: 1.1, 1.2 to 1.8 and 4.9;
    tests/planning/test_limits.py). `midpoint`, of order 2, solves for no more than 0.5. A splitting
    turns exactly, however fast: it only sees the torque less often.
    """
    return 3.0 if kind.splitting else round(max(1.0, (kind.order / 4.0) ** 1.45), 1)


def nodes(scene: Scene, watched: Watch, theta: float) -> int:
    """How many states of a step are watched if members move by up to `theta` [rad] in it.

    0 stands for its end and nothing else: noise leaves nothing to interpolate.
    """
    if not watched.each_step or any(map(is_random, scene.effects)):
        return 0
    return max(1, math.ceil(min(theta, LARGEST_TURN) / ARC * (1.0 - 1e-9)))


def longest_watched(scene: Scene) -> float:
    """How far a member of a scene may move in a step that is watched [rad]."""
    return RANDOM_TURN if any(map(is_random, scene.effects)) else LARGEST_TURN


def watched_notes(scene: Scene, watched: Watch, theta: float, dt: float) -> tuple[str, ...]:
    """A note if steps `dt` [s] of `theta` [rad] are too long for what is watched in each."""
    labels, most = watched.each_step, longest_watched(scene)
    if not labels or theta <= most * (1.0 + 1e-9):
        return ()
    own = scene.run.turn is not None
    would = f"turn <= {most:g}" if own else f"dt <= {dt * most / theta:.2g} s"
    return (
        f"a member may move by {theta:.2g} rad in a step, too far for {', '.join(labels)}; {would}"
        " would do",
    )


def spinning_up(scene: Scene) -> list[str]:
    """Labels of the effects that may bring a body more energy than its start tells: torques that do
    not brake, and have neither an energy nor a bound on one."""
    return [
        label
        for label, e in labelled(scene.effects)
        if implements(e, "torque")
        and not any(implements(e, verb) for verb in ("energy", "energy_scale", "drives"))
        and not facts(e).damps
        and not is_conservative(e)
    ]


def _constant(scene: Scene) -> frozenset[str]:
    """Member variables that are the same for all, and are stored once in memory."""
    spin = "omega" if scene.start.momentum is None else "momentum"
    variables = {
        "moments": scene.body.moments,
        "mass": scene.body.mass,
        "centre": scene.body.centre,
        f"start_{spin}": getattr(scene.start, spin),
        "start_attitude": scene.start.attitude,
    }
    if scene.body.given == "tensor":  # each member has axes of its own
        return frozenset()
    return frozenset(name for name, value in variables.items() if is_shared(value))
