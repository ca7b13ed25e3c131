"""From a scene to a plan, everything resolved before the first step, and from a plan to a block of members at its start."""

import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.methods import implements, names
from rigidmc.effects import labelled
from rigidmc.effects.protocol import facts, is_conservative
from rigidmc.effects.sums import total_energy_scale
from rigidmc.engine import layout
from rigidmc.engine.layout import whole_lanes
from rigidmc.errors import SceneError
from rigidmc.integrators import INTEGRATORS, Turns, form, keeps_remainders
from rigidmc.observables import rows_of
from rigidmc.observables.keep import thinned
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.limits import SPUN_UP, limits
from rigidmc.planning.stage import check_starts, first_members, own_steps, physics, rates
from rigidmc.planning.watch import Watch, needs_attitude, watch
from rigidmc.scene.checks import PILOT
from rigidmc.scene.conservation import booked_labels
from rigidmc.scene.quantities import is_open, is_shared, rows

BLOCK = 4064  # members: their 30 to 40 rows are 1 MB, and a call on them is 10 ms or more; with 4096 all rows would want one place in the cache, and a block begin and end in 64 ns a member, not 47
SLAB = 32 * 2**20  # bytes of saved values that a block may hold on its way to a file
MARGIN = 2.0  # a member beyond the pilot may spin faster than all of the pilot: 7 sigma where the pilot reaches 3.5

MOST_STEPS = 10**15
# [rad] that a member may move in a step of which something is watched: of 50 heavy tops to t = 25 watched after steps of 1.6 rad, nutation was up to
# 0.43 rad off, 43 of 801 passages were missed and precession was off by whole turns in 12
WATCHED_TURN = 0.3
MOST_SAVES = 10**7  # their times alone are 80 MB
OWN_MARGIN = 1.25  # with steps of their own only the shapes of bodies beyond the pilot count: lambda of a member's rate


class Plan(NamedTuple):
    """What a run will do, resolved."""

    first: int  # index of the first member
    members: int
    steps: int
    dt: float
    stride: int  # steps between saves
    own: bool  # whether members have steps of their own: steps, dt and stride are then of rounds, of which a member makes some each
    mean_steps: float  # of a member to the end
    times: np.ndarray
    thinned: np.ndarray  # indices of those that are kept of what is thinned
    form: Any  # the integrator as it is compiled, and the parts of its step; None for closed forms
    carried: bool  # whether the attitude is
    block: int  # members of a block
    constant: frozenset  # names of the member variables that are the same for all
    angle: float  # largest |omega| dt of the pilot [rad]
    turn_rate: (
        float | None
    )  # bound on the rate of free motion, where the integrator asks for it [rad/s]
    dtype: str  # of the numbers in which steps are made
    compensated: bool  # whether sums keep their remainders
    notes: tuple  # what the user should know
    limits: Any  # what flags a member, see `rigidmc.planning.limits`
    labels: tuple  # of the effects whose works are saved
    watch: Watch  # what is kept of every step

    def bounds(self):
        """The finite ones of the limits that a scene may set, by their names there."""
        if not self.limits:
            return {}
        lowest = {
            "energy_limit": self.limits.energy,
            "momentum_limit": min(self.limits.l2, self.limits.lz),
            "turn_limit": self.limits.turn,
        }
        return {name: value for name, value in lowest.items() if value < math.inf}


def steps_and_saves(t_end, dt, every):
    """(steps, dt, stride, notes): a whole number of steps to t_end and of steps between saves, with a step not above dt.

    Decimal numbers are taken as the fractions they are written as, so that 10 / 0.3 is 100/3. Raises SceneError where `every`
    and t_end have no common step of at least dt/2.
    """
    end, step = Fraction(repr(t_end)), Fraction(repr(dt))
    if every is None or every >= t_end:
        steps = stride = max(1, math.ceil(end / step * (1 - Fraction(1, 10**9))))
    else:
        ratio = end / Fraction(
            repr(every)
        )  # p/q: steps must be a multiple of p for stride = steps q/p to be whole
        simple = ratio.limit_denominator(
            1000
        )  # of numbers that are only written to 16 digits, as t_end/7 or 2^-30 s
        ratio = simple if abs(simple / ratio - 1) < Fraction(1, 10**14) else ratio
        multiples = max(1, math.ceil(end / step / ratio.numerator * (1 - Fraction(1, 10**9))))
        steps = multiples * ratio.numerator
        stride = multiples * ratio.denominator
        if steps > 2 * math.ceil(end / step) and steps > 1000:
            rule = f"no step near dt = {dt:g} divides both it and t_end = {t_end:g}; choose an `every` that divides t_end"
            raise SceneError("run", "every", every, rule)
    if steps > MOST_STEPS:
        raise SceneError(
            "run",
            "dt",
            dt,
            f"{steps:.3g} steps to t_end = {t_end:g} are more than {MOST_STEPS:.3g}, which none live to see",
        )
    made = t_end / steps
    notes = (
        ()
        if abs(made / dt - 1) < 1e-9
        else (f"dt reduced from {dt:g} to {made:.10g} s, which divides t_end and every",)
    )
    return steps, made, stride, notes


def rounds(t_end, every):
    """(rounds, length, rounds between saves): the longest equal times that divide t_end and `every`."""
    if every is None or every >= t_end:
        return 1, t_end, 1
    count, length, stride, _ = steps_and_saves(t_end, every, every)
    return count, length, stride


def carries_attitude(scene, watched=None):
    """Whether anything needs the attitude: an effect that names q, or what is saved or watched of it; watched : the Watch of the scene."""
    by_effects = any("q" in names(e, "torque", "kick", "energy") for e in scene.effects)
    return by_effects or needs_attitude(scene, watch(scene) if watched is None else watched)


def prepare(scene, threads=1, streaming=False, block=None):
    """The Plan of a checked scene; raises SceneError."""
    scene.check()
    check_starts(scene.coarse())
    run = scene.run
    own, found = run.turn is not None and run.integrator != "closed", watch(scene)
    carried = carries_attitude(scene, found)
    if own:
        steps, dt, stride = rounds(run.t_end, run.every)
        notes, angle, theta = tuple[str, ...](), run.turn, run.turn
    elif run.integrator == "closed":
        closed_form(scene, whole_lanes(min(PILOT, run.members)))  # raises where there is none
        steps, dt, stride = rounds(run.t_end, run.every)
        notes, angle, theta = (), 0.0, 0.0
    else:
        steps, dt, stride, notes = steps_and_saves(run.t_end, run.dt, run.every)
        angle, theta = (dt * speed for speed in _speeds(scene, carried))
    made, rate, spin = (None, None, 0.0) if run.integrator == "closed" else form_of(scene, dt)
    mean = steps * _mean_own_steps(scene, carried, dt) if own else steps
    # a splitting turns exactly, however fast: it only sees the torque less often
    most = 3.0 if INTEGRATORS[run.integrator].splitting else 1.0
    if angle > most and INTEGRATORS[run.integrator].order < math.inf:
        would = f"turn <= {most:g}" if own else f"dt <= {most * dt / angle:.2g} s"
        notes += (
            f"omega dt reaches {angle:.3g} rad per step, more than {most:g}: expect large errors; {would} would do",
        )
    notes += watched_notes(
        found, theta if scene.effects else angle, own, dt
    )  # how far torques may bring it
    if own and (driving := spinning_up(scene)):
        rule = f"steps are those of the start, and {', '.join(driving)} may spin members up; one that turns by {SPUN_UP:g} times as much in a step is flagged"
        notes += (f"[run] turn = {run.turn:g}: {rule}; dt goes by no start",)
    if steps // stride > MOST_SAVES:
        raise SceneError(
            "run",
            "every",
            run.every,
            f"{steps // stride:,} saves are more than the limit of {MOST_SAVES:,}",
        )
    slots = np.append(np.arange(0, steps, stride), steps)
    few = thinned(len(slots), run.thin) if "thinned" in scene.kept().values() else np.empty(0, int)
    values = rows_of(scene.effects, *scene.recorded())
    if block is None:
        block = min(BLOCK, whole_lanes(math.ceil(run.members / ((1 if own else 4) * threads))))
        if streaming:
            block = min(
                block,
                max(
                    layout.LANES,
                    SLAB // (8 * max(1, values) * len(slots)) // layout.LANES * layout.LANES,
                ),
            )
    return Plan(
        run.first, run.members, steps, dt, stride, own, mean, slots * dt, few, made, carried, block, _constant(scene), angle, rate,
        run.dtype, keeps_remainders(run.integrator, scene.effects, run.dtype, run.compensated), notes, () if made is None else limits(scene, carried, theta, mean, made, spin),
        booked_labels(scene),
        found,
    )  # fmt: skip


def watched_notes(found, theta, own, dt):
    """What the user should know of steps of theta rad [rad] and what is watched after each, see `rigidmc.planning.watch.Watch`."""
    some = found.each_step
    if not some or theta <= WATCHED_TURN * (1.0 + 1e-9):
        return ()
    would = f"turn <= {WATCHED_TURN:g}" if own else f"dt <= {dt * WATCHED_TURN / theta:.2g} s"
    return (
        f"a member may move by {theta:.2g} rad in a step, and {', '.join(some)} see the ends of steps only; {would} would do",
    )


def spinning_up(scene):
    """Labels of the effects that may bring a body more energy than its start tells: torques with neither an energy nor a bound on one, that do not brake."""
    return [
        label
        for label, e in labelled(scene.effects)
        if implements(e, "torque")
        and not any(implements(e, verb) for verb in ("energy", "energy_scale", "drives"))
        and not facts(e).damps
        and not is_conservative(e)
    ]


def form_of(scene, dt):
    """(the Form of a scene's integrator for steps of dt, or of its `turn` in times of at most dt; bound on the rate of free motion where it
    asks for that, with `turn` of the members' own rate; and the turn |omega| dt for which it is then prepared)."""
    run = scene.run
    kind, rate, turns = INTEGRATORS[run.integrator], None, Turns()
    if implements(kind, "prepared"):
        found, spin, symmetric = _turn_rates(scene)
        rate = found if run.turn_rate is None else run.turn_rate
        unit, key = (dt, "dt") if run.turn is None else (run.turn, "turn")
        turns = Turns(rate * unit, spin * unit, symmetric)
        largest = kind.largest_spin
        if turns.spin > largest:
            rule = f"a step may turn by {turns.spin:.3g} rad, more than the {largest:g} for which {run.integrator} can be solved; "
            raise SceneError(
                "run",
                key,
                getattr(run, key),
                rule + f"use {key} <= {unit * largest / turns.spin:.2g}",
            )
    return form(kind, turns, scene.effects)._replace(name=run.integrator), rate, turns.spin


def _constant(scene):
    """Member variables that need not be stored a million times in memory."""
    same = {"moments"} if is_shared(scene.body.moments) else set()
    same |= {"mass"} if is_shared(scene.body.mass) else set()
    same |= {"centre"} if is_shared(scene.body.centre) else set()
    which = "omega" if scene.start.momentum is None else "momentum"
    same |= {f"start_{which}"} if is_shared(getattr(scene.start, which)) else set()
    if is_shared(scene.start.attitude):
        same |= {"start_attitude"}
    return frozenset(same)


def _pilot(scene):
    """How many members a look at the ensemble takes in: always the same first ones, and every row of arrays."""
    alike = is_shared(*scene.quantities()) and not isinstance(scene.start.attitude, str)
    return layout.LANES if alike else whole_lanes(max(PILOT, rows(*scene.quantities()) or 0))


def _speeds(scene, carried):
    """(largest |omega| at the start, largest rate) of the pilot [rad/s], see `rigidmc.planning.stage.rates`."""
    scene = scene.coarse()
    block = first_members(scene, _pilot(scene), carried).block
    with np.errstate(all="ignore"):
        omega = block[layout.BODY : layout.BODY + 3] * block[layout.MOMENTUM : layout.REST]
        found = np.sqrt((omega**2).sum(0)), rates(scene.effects, block)
    return tuple(float(np.max(x, where=np.isfinite(x), initial=0.0)) for x in found)


def _mean_own_steps(scene, carried, span):
    """How many steps of their own the members of the pilot make in a time, on average."""
    block = first_members(scene.coarse(), _pilot(scene), carried).block
    return float(np.mean(own_steps(rates(scene.effects, block), span, scene.run.turn)))


def _turn_rates(scene):
    """(bound on lambda [rad/s], bound on |omega| [rad/s], whether all bodies have two equal moments) over the pilot.

    lambda is the rate at which free motion turns L in the body. Where members have steps of their own, both are in units of their rates.
    """
    scene = scene.coarse()
    block = first_members(scene, _pilot(scene), carries_attitude(scene)).block
    body, effects = physics(scene.effects, block)
    l = block[layout.MOMENTUM : layout.REST]
    a, i = np.array([body.a1, body.a2, body.a3]), np.array([body.i1, body.i2, body.i3])
    with np.errstate(all="ignore"):
        products = np.stack(
            [a[1] * a[2] * l[0] * l[0], a[2] * a[0] * l[1] * l[1], a[0] * a[1] * l[2] * l[2]]
        )
        rate = np.sqrt(products.max(0) - products.min(0))
        spin = np.sqrt(((i * l) ** 2).sum(0))
        scale = total_energy_scale(effects, body) + np.zeros(l.shape[1])
        # torques can bring the kinetic energy from T to T + 2 V, and |L| and omega with it
        kinetic = 0.5 * (i * l * l).sum(0) + 2.0 * scale
        bound = np.sqrt(2.0 * kinetic / i.min(0)) * np.sqrt(
            np.abs(a).max(0) * np.sort(np.abs(a), axis=0)[1]
        )
        rate = np.where(scale > 0.0, bound, rate)
        spin = np.where(scale > 0.0, spin + np.sqrt(2.0 * scale * i.max(0)), spin)
        if scene.run.turn is not None:
            own = rates(scene.effects, block)
            rate, spin = rate / own, np.ones_like(own)  # no member is faster than its rate
        alike = bool(np.all(np.abs(a).min(0) <= 4e-15 * i.max(0))) and _symmetric_by_construction(
            scene
        )
    margin = (
        1.0
        if not is_open(*scene.quantities())
        else MARGIN
        if scene.run.turn is None
        else OWN_MARGIN
    )
    rate, spin = (float(np.max(x, where=np.isfinite(x), initial=0.0)) for x in (rate, spin))
    return (
        margin * rate,
        (margin if scene.run.turn is None else 1.0) * spin,
        alike,
    )  # a member past that is flagged, not planned for


def _symmetric_by_construction(scene):
    """Whether a look at the pilot tells for all members that they have two equal moments."""
    return not is_open(scene.body.moments)
