"""Candidates of a search and its choice, for `show` and for the attributes of a result; and the
costs of a candidate's steps, starts and saves, measured on one thread of this machine."""

import math
import time
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.arguments import SaveTarget, StepRange
from rigidmc.engine.kernel.layout import BLOCK
from rigidmc.engine.program import Program
from rigidmc.engine.program_spec import ProgramSpec
from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects.protocol import blank
from rigidmc.physics.integrators import StepScheme, keeps_remainders
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.closed_form import closed_values
from rigidmc.planning.initial import initial_block
from rigidmc.planning.steps import Clock, round_grid
from rigidmc.planning.tolerance.deviation import upper_quantile
from rigidmc.planning.tolerance.pilot import OBSERVED, Pilot
from rigidmc.scene.quantities import count_rows


class Candidate(NamedTuple):
    """One way of integrating a pilot.

    steps : of the fastest member of the pilot;  mean_steps, dt : mean over its members
    turn : of per-member steps [rad], None if all members have the same steps
    errors : {quantity: (members,)};  ns : time per member and step on one thread [ns]
    """

    integrator: str
    dtype: str
    steps: int
    mean_steps: float
    dt: float
    turn: float | None
    errors: dict[str, Array]
    ns: float

    @property
    def upper(self) -> float:
        """The error that 99 % of all members stay below, with 95 % certainty."""
        return upper_quantile(self.errors["state"])

    @property
    def step(self) -> str:
        """The length of a step, in words."""
        if self.integrator == "closed":
            return "at every save"
        if self.turn is None:
            return f"at dt = {self.dt:.4g} s ({self.steps:,} steps)"
        steps = f"{self.mean_steps:,.1f} steps on average, {self.steps:,} of the fastest member"
        return f"at turn = {self.turn:.4g} rad ({steps})"

    def with_precision(self) -> str:
        """Name the integrator, and its precision unless that is double."""
        return self.integrator + (" in float32" if self.dtype == "float32" else "")


class Costs:
    """Times in ns per member of a pilot on one thread, measured once for each compiled program;
    beside the truth with which its candidates are compared."""

    def __init__(self, pilot: Pilot, truth: Any = None) -> None:
        self.pilot, self.truth, run = pilot, truth, pilot.scene.run
        self._known: dict[Hashable, float] = {}
        self.saves = round_grid(run.t_end, run.every).save_steps.size - 1

    def step(self, integrator: str, steps: int, dtype: str) -> float:
        """Measure the time per member and step, without saves; of `closed`, per member and
        save."""
        if integrator == "closed":
            return self._once("closed", self._closed)
        scene = self.pilot.stepped(steps)[0].with_run(integrator=integrator)
        h = scene.run.t_end / steps
        form = self.pilot.scheme(scene, h)
        compensated = keeps_remainders(scene.integrator, scene.effects, dtype)
        key = type(form.integrator), form.integrator, len(form.substeps), dtype
        return self._once(
            key, lambda: self._stepped(form, dtype, OBSERVED, compensated=compensated)
        )

    def start(self) -> float:
        """Measure the time to draw the start of a member."""

        def draw() -> float:
            model, sampler = self.pilot.scene.model, self.pilot.sampler
            count = min(BLOCK, count_rows(*model.quantities()) or BLOCK)
            began = time.perf_counter()
            initial_block(model, sampler, 0, count, self.pilot.has_attitude)
            return 1e9 * (time.perf_counter() - began) / count

        return self._once("start", lambda: min(draw() for _ in range(3)))

    def save(self) -> float:
        """Measure the time per member and save."""

        def record() -> float:
            scene = self.pilot.scene.with_run(integrator="rk4")
            form = self.pilot.scheme(scene, 1.0)
            recorded = scene.recording.recorded
            observables = tuple(o for n, o in recorded.items() if n != "work")
            plain, saving = (
                self._stepped(form, "float64", observables, stride=stride) for stride in (32, 1)
            )
            return max(0.0, saving - plain)

        return self._once("save", record)

    def _once(self, key: Hashable, measure: Callable[[], float]) -> float:
        if key not in self._known:
            self._known[key] = measure()
        return self._known[key]

    def _closed(self) -> float:
        scene, count = self.pilot.scene, min(512, max(layout.LANES, self.pilot.members))
        model, recorded = scene.model, list(scene.recording.recorded.values())
        saves, taken = min(self.saves, 50), []
        times = np.linspace(0.0, scene.run.t_end, saves + 1)
        for _ in range(3):
            drawn = self.pilot.sampler, 0, count, self.pilot.has_attitude
            block, start = initial_block(model, *drawn)
            began = time.perf_counter()
            clock = Clock(times[1], saves, times[1])
            closed_values(model.effects, recorded, block, start, times, clock)
            taken.append(time.perf_counter() - began)
        return 1e9 * min(taken) / (count * saves)

    def _stepped(
        self,
        form: StepScheme,
        dtype: str,
        observables: tuple[Any, ...],
        stride: int | None = None,
        compensated: bool = False,
    ) -> float:
        """Measure the time per member and step; `stride` : steps between saves, None for the last
        only.

        The steps are short, whatever steps the scheme has: a member that a long step of an explicit
        method throws off is frozen, and then a step seems to take almost no time.
        """
        h = 1e-6 * self.pilot.scene.run.t_end / self.pilot.base
        effects = blank(self.pilot.scene.effects)
        attitude = self.pilot.has_attitude
        spec = ProgramSpec(form, effects, observables, attitude, compensated, dtype)
        program = Program(spec)
        own_steps = int(self.pilot.member_steps and stride is None)
        few, steps = self.pilot.block, 32
        block = np.ascontiguousarray(np.tile(few, -(-512 // few.shape[1]))[:, :512])
        order, width = np.arange(512), block.shape[1] if observables else 0
        values = sum(size(o.dims) for o in observables)
        best, spent = math.inf, -1.0
        while spent < 0.03:
            saves = SaveTarget(np.empty((steps + 1) * values * width), width, 0, order)
            moved, span, slots = block.copy(), h, 1
            if own_steps:
                moved[layout.STEPS], span, slots = steps, h * steps, steps
            began = time.perf_counter()
            run = StepRange(span, slots, stride or steps, steps, own_steps, 0, steps)
            program.advance(moved, run, saves=saves)
            took = time.perf_counter() - began
            if spent >= 0.0:  # the first call may have compiled
                best = min(best, took / (steps * block.shape[1]))
            spent = max(spent, 0.0) + (took if spent >= 0.0 else 0.0)
            if stride is None and took < 0.003:
                steps *= 2
        return 1e9 * best

    def per_member(self, way: Candidate) -> float:
        """Return the time of one member to t_end, with its saves [ns]."""
        saves = 0.0 if way.integrator == "closed" else self.saves * self.save()
        return way.ns * way.mean_steps + saves + self.start()

    def members_per_second(self, way: Candidate, threads: int) -> float:
        """Return members to t_end per second on all threads."""
        return 1e9 * threads / self.per_member(way)


SURE = 299  # members that state something about 99 % of all members with 95 % certainty


class Choice(NamedTuple):
    """The choice for `--tolerance`: the candidate, its error, and the alternatives.

    predicted : error that 99 % of members stay below
    checked : fraction of the members of a second pilot within the tolerance
    runner_up : (Candidate, its cost relative to the chosen one), or None
    pilots : which members were integrated how far, if not all to t_end; else ""
    """

    way: Candidate
    predicted: float
    checked: float
    truth: str
    runner_up: tuple[Candidate, float] | None
    ns_per_member: float
    tolerance: float
    members: int
    pilots: str = ""

    def members_per_second(self, threads: int) -> float:
        """Return members to t_end per second on all threads."""
        return 1e9 * threads / self.ns_per_member

    @property
    def short(self) -> str:
        """A warning if the predicted error exceeds the tolerance although finer steps were tried,
        else ""."""
        if self.predicted <= self.tolerance:
            return ""
        return (
            f"the error bound for 99 % of members, {self.predicted:.2g}, exceeds the tolerance of "
            f"{self.tolerance:g}; finer steps were tried"
        )

    def lines(self, count: int, seconds: float) -> list[str]:
        """Describe the choice, its reasons, and the time that `count` members take."""
        way, other = self.way, self.runner_up
        lines = [
            f"for a tolerance of {self.tolerance:g}: {way.with_precision()} {way.step}, the "
            "cheapest that reaches it"
        ]
        if other is not None:
            second = f"{other[0].with_precision()} {other[0].step}"
            lines.append(f"  next best: {second}, at {other[1]:.2g} times the cost")
        few = self.members < SURE
        lines.append(
            f"  {'the members of both pilots' if few else '99 % of members'} have errors below "
            f"{self.predicted:.1e}; on a second pilot of "
            f"{count_text(self.members, 'member')}, {100 * self.checked:.1f} % keep the tolerance"
        )
        lines += [f"  note: {self.short}"] * bool(self.short)
        lines.append(f"  reference: {self.truth}")
        lines += [f"  pilot: {self.pilots}"] * bool(self.pilots)
        lines.append(f"  about {seconds:.2g} s for {count_text(count, 'member')}")
        return lines

    def attributes(self) -> dict[str, Any]:
        """Return the choice as attributes of a result, without any timing of this machine."""
        way, other = self.way, self.runner_up
        attributes: dict[str, Any] = {
            "tolerance": self.tolerance,
            "tolerance_predicted_error": self.predicted,
            "tolerance_checked_share": self.checked,
            "tolerance_truth": self.truth,
            "tolerance_chosen": f"{way.with_precision()} {way.step}: the cheapest that reaches it",
        }
        if self.pilots:
            attributes["tolerance_pilot"] = self.pilots
        if other is not None:
            attributes["tolerance_runner_up"] = f"{other[0].with_precision()} {other[0].step}"
        return attributes
