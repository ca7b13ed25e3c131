"""Ways of integrating a pilot: an integrator, a precision and a step, what it costs on this machine and how far it errs."""

import math
import time
from typing import NamedTuple

import numpy as np

from rigidmc.effects import EFFECTS
from rigidmc.effects.parameters import blank
from rigidmc.engine import layout
from rigidmc.engine.frame import Run, Saves
from rigidmc.engine.machine import threads_available
from rigidmc.engine.program import Program
from rigidmc.errors import SceneError, unknown
from rigidmc.integrators import INTEGRATORS, accepting, keeps_remainders
from rigidmc.observables import OBSERVABLES
from rigidmc.observables.protocol import size
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.plan import BLOCK, WATCHED_TURN, form_of
from rigidmc.planning.stage import stage
from rigidmc.planning.tolerance.pilot import (
    MOST_STEPS,
    OBSERVED,
    QUANTITIES,
    errors,
    first_steps,
    follow,
    pilot,
    upper_quantile,
)
from rigidmc.planning.tolerance.truth import closed_states
from rigidmc.planning.watch import watch
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import rows
from rigidmc.scene.scene import Scene
from rigidmc.scene.start import Start

SINGLE = ("rk4", "exact", "strang")  # tried in float32 too


class Way(NamedTuple):
    """One way of integrating a pilot.

    steps : of the fastest member of the pilot;  mean_steps, dt : of its members in the mean;  turn : of their own steps [rad], None where
        all have the same;  errors : {quantity: (members,)};  ns : time per member and step on one thread [ns]
    """

    integrator: str
    dtype: str
    steps: int
    mean_steps: float
    dt: float
    turn: float | None
    errors: dict
    ns: float

    @property
    def upper(self):
        """What 99 % of all members stay below, with 95 % certainty."""
        return upper_quantile(self.errors["state"])

    @property
    def step(self):
        """How far at a time, in words."""
        if self.integrator == "closed":
            return "at every save"
        if self.turn is None:
            return f"at dt = {self.dt:.4g} s ({self.steps:,} steps)"
        return f"at turn = {self.turn:.4g} rad ({self.mean_steps:,.1f} steps in the mean, {self.steps:,} of the fastest member)"

    def with_precision(self):
        """The integrator, and its precision where it is not double."""
        return self.integrator + (" in float32" if self.dtype == "float32" else "")


class Costs:
    """Nanoseconds per member, measured once for each thing that is compiled, on one thread."""

    def __init__(self, pilot):
        self.pilot, self._known, run = pilot, {}, pilot.scene.run
        self.saves = 1 if run.every is None else max(1, math.ceil(run.t_end / run.every))

    def step(self, integrator, steps, dtype):
        """Per member and step, without saves; of `closed` per member and save."""
        if integrator == "closed":
            return self._once("closed", self._closed)
        scene = self.pilot.stepped(steps)[0].with_run(integrator=integrator)
        made, *_ = form_of(scene, scene.run.t_end / steps)
        key = type(made.integrator), made.integrator, len(made.parts), dtype
        kept = keeps_remainders(integrator, scene.effects, dtype)
        return self._once(
            key,
            lambda: self._stepped(made, scene.run.t_end / steps, dtype, OBSERVED, compensated=kept),
        )

    def start(self):
        """Per member, to draw its start."""

        def draw():
            available = rows(*self.pilot.scene.quantities())
            count = min(BLOCK, available or BLOCK)
            began = time.perf_counter()
            stage(self.pilot.scene, 0, count, self.pilot.carried)
            return 1e9 * (time.perf_counter() - began) / count

        return self._once("start", lambda: min(draw() for _ in range(3)))

    def save(self):
        """Per member and save."""

        def record():
            scene = self.pilot.scene.with_run(integrator="rk4")
            made, *_ = form_of(scene, 1.0)
            observables = tuple(OBSERVABLES[name]() for name in scene.saved() if name != "work")
            h = 1e-6 * scene.run.t_end
            plain, saving = (
                self._stepped(made, h, "float64", observables, stride=stride) for stride in (32, 1)
            )
            return max(0.0, saving - plain)

        return self._once("save", record)

    def _once(self, key, measure):
        if key not in self._known:
            self._known[key] = measure()
        return self._known[key]

    def _closed(self):
        scene, count = self.pilot.scene, min(512, max(layout.LANES, self.pilot.members))
        saves, taken = min(self.saves, 50), []
        times = np.linspace(0.0, scene.run.t_end, saves + 1)
        for _ in range(3):
            block, start = stage(scene, 0, count, self.pilot.carried)
            began = time.perf_counter()
            closed_values(scene, block, start, times, times[1])
            taken.append(time.perf_counter() - began)
        return 1e9 * min(taken) / (count * saves)

    def _stepped(self, made, h, dtype, observables, stride=None, compensated=False):
        program = Program(
            made,
            blank(self.pilot.scene.effects),
            observables,
            self.pilot.carried,
            compensated,
            dtype,
        )
        own = int(self.pilot.own and stride is None)
        few, steps = self.pilot.block, 32
        block, order = (
            np.ascontiguousarray(np.tile(few, -(-512 // few.shape[1]))[:, :512]),
            np.arange(512),
        )
        width, values = (
            block.shape[1] if observables else 0,
            sum(size(o.dims) for o in observables),
        )
        best, spent = math.inf, -1.0
        while spent < 0.03:
            out = np.empty((steps + 1) * values * width)
            given, span, slots = block.copy(), h, 1
            if own:
                given[layout.STEPS], span, slots = steps, h * steps, steps
            began = time.perf_counter()
            program.advance(
                given,
                Run(span, slots, stride or steps, steps, own, 0, steps),
                saves=Saves(out, width, 0, order),
            )
            took = time.perf_counter() - began
            if spent >= 0.0:  # the first may have compiled
                best = min(best, took / (steps * block.shape[1]))
            spent = max(spent, 0.0) + (took if spent >= 0.0 else 0.0)
            if stride is None and took < 0.003:
                steps *= 2
        return 1e9 * best

    def per_member(self, way):
        """One member to t_end, with its saves [ns]."""
        saves = 0.0 if way.integrator == "closed" else self.saves * self.save()
        return way.ns * way.mean_steps + saves + self.start()

    def members_per_second(self, way, threads=None):
        """Members to t_end per second on all threads."""
        return 1e9 * (threads or threads_available()) / self.per_member(way)


def candidates(scene, true, integrators=None, dtype=None):
    """[(integrator, dtype)] that a scene can be run with; a free body needs no splitting, which is the exact motion at more cost."""
    able = [
        name
        for name in accepting(scene.effects, works="work" in scene.run.save)
        if name != "closed" or true.source.startswith("closed")
    ]
    if watch(scene).each_step:  # closed forms make no steps
        able = [name for name in able if name != "closed"]
    if integrators:
        for name in integrators:
            if name not in INTEGRATORS:
                raise unknown("", "integrators", name, "integrator", INTEGRATORS)
        able = [name for name in integrators if name in able]
    if not scene.effects:
        able = [name for name in able if not INTEGRATORS[name].splitting or name == "rotations"]
    able.sort(
        key=lambda name: name != "closed"
    )  # what needs no compiling first: it bounds what others may cost
    both = [
        (name, real)
        for real in ("float64", "float32")
        for name in able
        if real == "float64" or name in SINGLE
    ]
    return [c for c in both if dtype in (None, c[1])]


def measured(costs, true, integrator, dtype, steps):
    """The Way of an integrator in `steps` steps; None where it refuses the step."""
    found = costs.pilot
    if integrator == "closed":
        apart = errors(found, closed_states(found), true.states)
        if true.source.startswith("closed"):  # it is its own truth: its error is that of rounding
            unseen = np.full(found.members, np.nan)
            apart = {
                name: true.error if name in ("state", "momentum", "attitude") else unseen
                for name in QUANTITIES
            }
        ns, saves = costs.step(integrator, 1, dtype), costs.saves
        return Way(integrator, dtype, saves, saves, found.scene.run.t_end / saves, None, apart, ns)
    try:
        states = follow(found, integrator, steps, dtype)
    except SceneError:  # a step too long for it
        return None
    mean, turn = found.mean_steps(steps), found.turn(steps) if found.own else None
    apart = errors(found, states, true.states)
    return Way(
        integrator,
        dtype,
        steps,
        mean,
        found.scene.run.t_end / mean,
        turn,
        apart,
        costs.step(integrator, steps, dtype),
    )


def ladder(
    costs, true, integrator, dtype, finest=0.0, ratio=2.0**0.5, most=MOST_STEPS, too_dear=None
):
    """Ways of one integrator from long steps to short ones, until the error falls below `finest` or falls no more, or too_dear(way).

    If steps are watched, none turns by more than WATCHED_TURN: the error at the end does not tell how short steps must be for
    events and extremes.
    """
    found, ways = costs.pilot, []
    multiple = max(1.0, first_steps(found) / found.base / 24.0)
    if integrator == "closed":
        return [measured(costs, true, integrator, dtype, 1)]
    if (
        INTEGRATORS[integrator].order == math.inf
    ):  # one step between checks, or pieces of each member's own
        whole, *_ = form_of(
            found.stepped(found.base)[0].with_run(integrator=integrator), found.scene.run.t_end
        )
        multiple = math.ceil(found.turn(found.base)) if found.own and len(whole.parts) > 2 else 1.0
    if watch(found.scene).each_step:
        multiple = max(multiple, math.ceil(found.turn(found.base) / WATCHED_TURN))
    best, idle = math.inf, 0
    while (steps := found.base * round(multiple)) <= most:
        way = measured(costs, true, integrator, dtype, steps)
        if way is not None:
            ways.append(way)
            idle = 0 if way.upper < 0.8 * best else idle + 1
            best = min(best, way.upper)
            if (
                best <= finest
                or idle >= (4 if best < 1e-2 else 5.5 / math.log(ratio))
                or (too_dear and too_dear(way))
            ):
                break
            if INTEGRATORS[integrator].order == math.inf and idle >= 1:
                break
        multiple = max(ratio * multiple, round(multiple) + 1.0)
    return ways


def step_costs():
    """{integrator: {"free": ns, "heavy": ns}} of one step on one thread of this machine: asymmetric bodies that turn by 0.1 rad."""
    body = Body.from_moments((1.0, 1.4, 2.0), centre=(0.1, 0.2, 0.3))
    start = Start(omega=(0.5, 0.7, 0.5), attitude=(1.0, 0.0, 0.0, 0.0))
    made: dict[str, dict] = {}
    for word, effects in (("free", ()), ("heavy", (EFFECTS["gravity"](1.0),))):
        scene = Scene(body, effects, start).with_run(t_end=1.0, save=("attitude",))
        costs = Costs(pilot(scene, 1))
        for name in accepting(effects):
            if name != "closed":
                made.setdefault(name, {})[word] = costs.step(name, 10, "float64")
    return made
