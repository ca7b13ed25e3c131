"""Choose the integrator and step that reach an accuracy at the least cost, for a scene and a
machine. Errors and costs are measured on a pilot.

A search uses up to twenty kernels. Each takes 3 s to compile, and Numba compiles one at a time, so
a second process compiles half of them ahead (`compile_ahead`).
"""

import json
import math
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.files.processes import start_helper
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import name_of
from rigidmc.physics.effects.protocol import is_random
from rigidmc.planning.check import check_scene
from rigidmc.planning.steps import Array
from rigidmc.planning.tolerance.costs import Candidate, Costs
from rigidmc.planning.tolerance.deviation import errors, measure_growth, upper_quantile
from rigidmc.planning.tolerance.ladder import candidates, ladder, measure_candidate
from rigidmc.planning.tolerance.pilot import (
    ROUNDING,
    Pilot,
    first_steps,
    integrate_pilot,
    pilot,
)
from rigidmc.planning.tolerance.truth import (
    AGREED,
    Reference,
    check_agreement,
    integrate_reference,
    make_reference,
)
from rigidmc.scene.amounts import count_text
from rigidmc.scene.recording import make_recording
from rigidmc.scene.scene import Scene
from rigidmc.scene.validation import named_integrators

# members: the 99 % quantile is then below the second largest error with 96 % certainty
PILOT = 512
# Integrators that have been the cheapest for some scene and tolerance. The others serve comparison
# (`rigidmc accuracy`), and each costs 3 s to compile.
CONTENDERS = (
    "closed", "exact", "rk4", "rk8", "gbs12", "strang", "chin4", "srkn6", "srkn11", "aba864",
    "aba1064",
)  # fmt: skip
# gbs12 is not tried for larger tolerances: its cost is 1.05 times that of rk8 at 1e-7 (4,096 heavy
# tops to 10 s), 0.87 at 1e-8, 0.75 at 1e-10 and 0.61 at 1e-12.
GBS12_PAYS = 2e-8
SINGLE_REACHES = 3e-7  # five roundings of float32: float32 is not tried for smaller tolerances
# Least factor by which half the step reduces the error for smooth torques (order 4 and more); for a
# kink the factor is 2 to 4
SMOOTH = 16.0
SAFETY = 0.8  # fraction of the tolerance that the pilot's error must keep


def choose_integrator(scene: Scene) -> tuple[Scene, "Choice | None"]:
    """Return (scene, Choice) with the integrator, precision and step chosen for its tolerance.

    If the integrator is not "auto", returns the scene itself and None.
    """
    run = scene.run
    if run.integrator != "auto":
        return scene, None
    check_scene(scene, make_recording(scene))
    # any integrator that accepts the scene can represent the candidates
    slips = any(implements(effect, "slip") for effect in scene.effects)
    some = scene.with_run(integrator="rk8" if slips else "rk4")
    chosen = choose(some, run.tolerance)
    way = chosen.way
    step = {"dt": way.dt} if way.turn is None else {"turn": way.turn}
    return scene.with_run(integrator=way.integrator, dtype=way.dtype, **step), chosen


class Choice(NamedTuple):
    """The choice for `--tolerance`: the candidate, its error, and the alternatives.

    predicted : error that 99 % of members stay below
    checked : fraction of the members of a second pilot within the tolerance
    runner_up : (Candidate, its cost relative to the chosen one), or None
    """

    way: Candidate
    predicted: float
    checked: float
    truth: str
    runner_up: tuple[Candidate, float] | None
    ns_per_member: float
    tolerance: float
    members: int

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
        lines.append(
            f"  99 % of members have errors below {self.predicted:.1e}; on a second pilot of "
            f"{count_text(self.members, 'member')}, {100 * self.checked:.1f} % keep the tolerance"
        )
        lines += [f"  note: {self.short}"] * bool(self.short)
        lines.append(f"  reference: {self.truth}")
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
        if other is not None:
            attributes["tolerance_runner_up"] = f"{other[0].with_precision()} {other[0].step}"
        return attributes


def choose(
    scene: Scene,
    tolerance: float | None,
    integrators: Iterable[str] | None = None,
    members: int = PILOT,
) -> Choice:
    """Choose the cheapest candidate that keeps the error of 99 % of members below `tolerance`.

    The error is that of momentum, relative to its size, and that of attitude [rad].

    Raises SceneError if no candidate reaches it, with the best accuracy and the reason.
    """
    if not (isinstance(tolerance, float) and 0.0 < tolerance < 1.0):
        rule = (
            "expected an error between 0 and 1: relative for the momentum, in rad for the attitude"
        )
        raise SceneError(rule, at="run.tolerance", value=tolerance)
    check_quiet(scene)
    first = pilot(scene, members)
    check_pilot(scene, first)
    true, costs = make_reference(first), Costs(first)
    known = upper_quantile(true.error)
    if known > tolerance:
        why = f"the reference itself is known only to {known:.1e} ({true.source})"
        raise _unreachable(scene, tolerance, first, known, why)
    contenders = integrators or _contenders(scene, tolerance)
    ways, nearest = _ways(costs, true, tolerance, contenders)
    if not ways:
        raise _unreachable(scene, tolerance, first, nearest, "no integrator does better")
    ways.sort(key=costs.per_member)
    second = pilot(scene, members, first.first + first.members)._replace(
        member_steps=first.member_steps
    )
    check = _Check(costs, true, second, tolerance)
    spare = None  # keeps the tolerance on the second pilot, but too few members confirm it
    for way in ways:
        for _ in range(4):
            apart, source = check.of(way)
            share = float(np.mean(apart <= tolerance))
            if share >= 0.99:
                predicted = max(way.upper, upper_quantile(apart))
                others = [w for w in ways if w.integrator != way.integrator]
                cost = costs.per_member(way)
                runner_up = (others[0], costs.per_member(others[0]) / cost) if others else None
                chosen = Choice(
                    way, predicted, share, source, runner_up, cost, tolerance, second.members
                )
                if predicted <= tolerance:
                    return chosen
                spare = spare or chosen
            steps = first.base * math.ceil(1.2 * way.steps / first.base)
            way = measure_candidate(costs, true, way.integrator, way.dtype, steps) or way
    if spare is not None:
        return spare
    raise _unreachable(scene, tolerance, first, nearest, "members beyond the pilot err more")


def _contenders(scene: Scene, tolerance: float) -> list[str]:
    """Return the names of the integrators to try by default, including custom ones."""
    able = [name for name in CONTENDERS if name != "gbs12" or tolerance <= GBS12_PAYS]
    if scene.run.wrt:
        able.remove("closed")  # closed forms have no derivatives
    return [*able, *named_integrators(scene.integrators)]


def _limit(integrator: str, tolerance: float) -> float:
    """Return the largest error that an integrator may have on the first pilot."""
    return tolerance if integrator == "closed" else SAFETY * tolerance


def _ways(
    costs: Costs, true: Reference, tolerance: float, integrators: Iterable[str]
) -> tuple[list[Candidate], float]:
    """Return (cheapest Candidate of each integrator that keeps the tolerance, smallest error)."""
    dtype = "float64" if tolerance < SINGLE_REACHES else None
    tried = candidates(costs.pilot, true, integrators, dtype)
    compile_ahead(costs.pilot, tried)
    keeping: list[Candidate] = []
    nearest = math.inf
    for integrator, precision in tried:
        most = 2.0 * min((costs.per_member(w) for w in keeping), default=math.inf)
        limit = _limit(integrator, tolerance)

        def too_dear(way: Candidate, most: float = most) -> bool:
            return costs.per_member(way) > most

        ways = ladder(costs, true, integrator, precision, limit, 2.0, too_dear=too_dear)
        nearest = min([nearest, *(way.upper for way in ways)])
        if ways and ways[-1].upper <= limit:
            keeping.append(_refined(costs, true, ways, limit))
    return keeping, nearest


class _Check:
    """Check of candidates on a second pilot: closed forms by an integration, integrators by the
    reference of that pilot."""

    def __init__(self, costs: Costs, true: Reference, second: Pilot, tolerance: float) -> None:
        self.true, self.second, self.tolerance = true, second, tolerance
        first = costs.pilot
        # members of the second pilot may be faster, and then need more steps
        self.faster = float(second.rates.max() / first.rates.max()) if first.member_steps else 1
        self._truths: dict[bool, Reference] = {}

    def of(self, way: Candidate) -> tuple[Array, str]:
        """Return (errors of the members, source of the reference)."""
        closed = way.integrator == "closed"
        other = self._truth(closed)
        apart = self._apart(way, other)
        if closed:
            check_agreement(apart, other.error, self.true, other.source)
            # the integration's own error must not count against the closed form
            apart = np.maximum(apart - other.error, 0.0)
            return apart, f"{self.true.source}; the second pilot by {other.source}"
        return apart, self.true.source

    def _truth(self, closed: bool) -> Reference:
        if closed not in self._truths:
            agreed = max(AGREED, 1e-2 * self.tolerance)
            second = self.second
            self._truths[closed] = (
                integrate_reference(second, agreed) if closed else make_reference(second)
            )
        return self._truths[closed]

    def _apart(self, way: Candidate, other: Reference) -> Array:
        steps: Any = self.faster * way.steps  # an integer unless members have their own steps
        checked = measure_candidate(Costs(self.second), other, way.integrator, way.dtype, steps)
        if checked is None:  # the step is too long for a member of the second pilot
            return np.full(self.second.members, np.inf)
        return checked.errors["state"]


def _refined(costs: Costs, true: Reference, ways: list[Candidate], limit: float) -> Candidate:
    """Find a cheaper candidate between the last that failed and the first that kept the limit, in
    two attempts, using the slope between them."""
    base, good = costs.pilot.base, ways[-1]
    bad = ways[-2] if len(ways) > 1 else None
    for _ in range(2):
        if bad is None or good.steps - bad.steps <= base or not math.isfinite(bad.upper):
            break
        slope = math.log(bad.upper / good.upper) / math.log(good.steps / bad.steps)
        if slope <= 0.5:
            break
        steps = base * math.ceil(good.steps / base * (good.upper / (0.9 * limit)) ** (1.0 / slope))
        steps = max(bad.steps + base, min(good.steps - base, steps))
        way = measure_candidate(costs, true, good.integrator, good.dtype, steps)
        if way is None:
            break
        good, bad = (way, bad) if way.upper <= limit else (good, way)
    return good


def check_quiet(scene: Scene) -> None:
    """Raise SceneError if effects are random."""
    noisy = [name_of(e) for e in scene.effects if is_random(e)]
    if noisy:
        rule = (
            f"{', '.join(noisy)} is random, so no single path is exact; halve dt to measure the "
            "error of averages instead"
        )
        raise SceneError(rule, at=f"effects.{noisy[0]}")


def check_pilot(scene: Scene, pilot: Pilot) -> None:
    """Raise SceneError if members of the pilot have impossible bodies."""
    bad = int(np.count_nonzero(pilot.block[layout.STATUS, : pilot.members]))
    if bad:
        rule = (
            f"{bad} of {count_text(pilot.members, 'member')} of the pilot have impossible bodies:"
            " fix the scene before requesting an accuracy"
        )
        raise SceneError(rule, at="body.moments")


def _gain(pilot: Pilot, growth: float) -> float:
    """Return the factor by which half the step reduces the error of rk8; inf where rounding, which
    grows with the motion, hides it."""
    if not pilot.scene.effects:
        return math.inf
    steps = 2 * first_steps(pilot)
    ends = [integrate_pilot(pilot, "rk8", count) for count in (steps, 2 * steps, 4 * steps)]
    coarse, fine = (upper_quantile(errors(pilot, end, ends[2])["state"]) for end in ends[:2])
    hidden = not math.isfinite(coarse) or fine < 1e4 * ROUNDING * growth
    return math.inf if hidden else coarse / fine


def _unreachable(
    scene: Scene, tolerance: float, pilot: Pilot, nearest: float, why: str
) -> SceneError:
    factor, rate = measure_growth(pilot)
    worst = upper_quantile(factor)
    if (gain := _gain(pilot, worst)) < SMOOTH:
        names = ", ".join(name_of(effect) for effect in scene.effects)
        rule = (
            f"out of reach: the best is {nearest:.1e}, and half the step divides the error of rk8"
            f" by {gain:.2g}, but by 256 for smooth torques. One of {names} has a kink or a jump:"
            " round it off over a width that some steps resolve, as `rest` of dry_friction does, or"
            " give an integrator and a step instead of a tolerance"
        )
        return SceneError(rule, at="run.tolerance", value=tolerance)
    reason = (
        f"{why}; over {scene.run.t_end:g} s a change of the start grows {worst:.1e} times in the "
        "worst 1 % of members"
    )
    reason += ", exponentially: chaos or a separatrix" if np.mean(rate > 0.0) > 0.01 else ""
    rule = (
        f"out of reach of double precision here: the best is {nearest:.1e}. "
        f"{reason[0].upper()}{reason[1:]}. Request less accuracy, or a shorter t_end"
    )
    return SceneError(rule, at="run.tolerance", value=tolerance)


Precision = tuple[str, str]  # integrator and dtype


def compile_ahead(pilot: Pilot, candidates: Sequence[Precision]) -> None:
    """Compile the kernels of some candidates for a pilot.

    If a kernel is not in the cache, a second process compiles from the end of the list and stores
    its kernels in the cache.
    """
    helper = None
    try:
        for place, candidate in enumerate(candidates):
            began = time.perf_counter()
            _compile(pilot, *candidate)
            slow = time.perf_counter() - began > 0.7
            if helper is None and slow and len(candidates) - place > 3:
                helper = _helper(pilot, candidates[place + 1 :])
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()


def _compile(pilot: Pilot, integrator: str, dtype: str) -> None:
    """Compile the kernel of one candidate, at a step in the middle of its ladder."""
    if integrator == "closed":
        return
    few = pilot._replace(block=pilot.block[:, :32])
    for finer in (1, 8):
        try:
            integrate_pilot(few, integrator, finer * first_steps(pilot), dtype)
            return
        except SceneError:  # the step is too long for it
            continue


def _helper(pilot: Pilot, candidates: Sequence[Precision]) -> subprocess.Popen[str] | None:
    """Start the second process; return None if the scene cannot be written as text."""
    try:
        text = pilot.scene.dumps()
        Scene.loads(text)
    except (SceneError, ValueError, TypeError):  # arrays, custom effects, varied parameters
        return None
    task = json.dumps({"scene": text, "own": pilot.member_steps, "candidates": candidates})
    helper = start_helper(__name__, answers=False)
    assert helper.stdin is not None
    helper.stdin.write(task)
    helper.stdin.close()
    return helper


def main() -> None:
    """Compile, as the second process, the candidates listed on standard input, last one first."""
    task = json.load(sys.stdin)
    members = pilot(Scene.loads(task["scene"]), 32)._replace(member_steps=task["own"])
    for candidate in reversed(task["candidates"]):
        _compile(members, *candidate)
