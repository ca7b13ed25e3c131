"""Choose the integrator and step that reach an accuracy at the least cost, for a scene and a
machine. Errors and costs are measured on a pilot."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import name_of
from rigidmc.physics.effects.protocol import is_random
from rigidmc.planning.check import check_scene
from rigidmc.planning.tolerance.costs import Candidate, Choice, Costs
from rigidmc.planning.tolerance.deviation import errors, measure_growth, upper_quantile
from rigidmc.planning.tolerance.ladder import LADDERS, candidates, ladder, measure_candidate
from rigidmc.planning.tolerance.pilot import (
    ROUNDING,
    Pilot,
    first_steps,
    integrate_pilot,
    part_of,
    pilot,
)
from rigidmc.planning.tolerance.search import AGREEMENT, compile_ahead, growth_power, plan_search
from rigidmc.planning.tolerance.truth import (
    AGREED,
    Reference,
    check_agreement,
    integrate_reference,
    make_reference,
)
from rigidmc.processes.progress import say
from rigidmc.scene.scene import Scene

# members: the 99 % quantile is then below the second largest error with 96 % certainty
PILOT = 512
SINGLE_REACHES = 3e-7  # five roundings of float32: float32 is not tried for smaller tolerances
# Least factor by which half the step reduces the error for smooth torques (order 4 and more); for a
# kink the factor is 2 to 4
SMOOTH = 16.0
SAFETY = 0.8  # fraction of the tolerance that the pilot's error must keep


def choose_integrator(scene: Scene) -> tuple[Scene, Choice | None]:
    """Return (scene, Choice) with the integrator, precision and step chosen for its tolerance.

    If the integrator is not "auto", returns the scene itself and None.
    """
    run = scene.run
    if run.integrator != "auto":
        return scene, None
    check_scene(scene, scene.recording)
    # any integrator that accepts the scene can represent the candidates
    slips = any(implements(effect, "slip") for effect in scene.effects)
    some = scene.with_run(integrator="rk8" if slips else "rk4")
    chosen = choose(some, run.tolerance)
    way = chosen.way
    step = {"dt": way.dt} if way.turn is None else {"turn": way.turn}
    return scene.with_run(integrator=way.integrator, dtype=way.dtype, **step), chosen


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
    check_quiet(scene.effects)
    full = pilot(scene, members)
    check_pilot(full)
    extent = plan_search(full, tolerance)
    if pilots := extent.words(scene.run.t_end):
        say(f"choosing integrator and step for a tolerance of {tolerance:g}: {pilots}")
    first = part_of(full, extent.members, extent.share)
    # errors grow at most as the square of the time, unless the motion is chaotic
    agreed = max(AGREED, AGREEMENT * tolerance * extent.share**2)
    true = make_reference(first, say, agreed)
    costs, certain = Costs(first, true), upper_quantile(true.error)
    if certain > tolerance * extent.share:
        certain /= extent.share
        why = f"the reference itself is known only to {certain:.1e} ({true.source})"
        raise _unreachable(scene.run.t_end, tolerance, first, certain, why)
    names = integrators or contenders(scene, tolerance)
    ways, nearest = _ways(costs, tolerance, names, extent.share)
    if not ways:
        raise _unreachable(scene.run.t_end, tolerance, first, nearest, "no integrator does better")
    ways.sort(key=costs.per_member)
    second = pilot(scene, members, full.first + full.members)._replace(
        member_steps=first.member_steps, effort=first.effort
    )
    second = part_of(second, extent.checked, extent.checked_share)
    check = _Check(costs, second, tolerance, extent.checked_share, not pilots)
    spare = None  # keeps the tolerance on the second pilot, but too few members confirm it
    for way in ways:
        for _ in range(4):
            if not first.effort.allows(check.work(way)):
                break
            apart, source = check.of(way)
            if np.mean(apart <= tolerance) >= 0.99:
                chosen = check.choice(way, ways, apart, source)
                if pilots:
                    chosen = _of_whole_run(chosen, first, full)._replace(pilots=pilots)
                if chosen.predicted <= tolerance:
                    return chosen
                spare = spare or chosen
            if pilots:  # the check is longer than the pilot, and shows how errors grow
                nearest = upper_quantile(apart)
            way = check.finer(way, nearest if pilots else 0.0) or way
    if spare is not None:
        return spare
    raise _unreachable(
        scene.run.t_end, tolerance, first, nearest, "members beyond the pilot err more"
    )


def contenders(scene: Scene, tolerance: float) -> list[str]:
    """Return the names of the integrators that may be the cheapest; each costs 3 s to compile."""
    return [
        name
        for name, integrator in scene.known_integrators().items()
        if integrator.is_contender and tolerance <= integrator.max_tolerance
        if not (name == "closed" and scene.run.wrt)  # closed forms have no derivatives
    ]


def _limit(pilot: Pilot, integrator: str, tolerance: float, share: float) -> float:
    """Return the largest error that an integrator may have on the first pilot, which covers a share
    of the time."""
    tolerance *= share ** growth_power(pilot, integrator)
    return tolerance if integrator == "closed" else SAFETY * tolerance


def _of_whole_run(choice: Choice, first: Pilot, full: Pilot) -> Choice:
    """Return a choice of steps to the end of the first pilot for the time of the whole run."""
    costs, share = Costs(full), first.scene.run.t_end / full.scene.run.t_end

    def longer(way: Candidate) -> Candidate:
        if way.integrator == "closed":
            return way._replace(steps=costs.saves, mean_steps=costs.saves)
        steps = full.base * math.ceil(way.steps / share / full.base * (1.0 - 1e-9))
        dt = way.dt if full.member_steps else full.scene.run.t_end / steps
        return way._replace(steps=steps, mean_steps=full.scene.run.t_end / dt, dt=dt)

    way, other = longer(choice.way), choice.runner_up
    if other is not None:
        other = longer(other[0]), other[1]
    return choice._replace(way=way, runner_up=other, ns_per_member=costs.per_member(way))


def _ways(
    costs: Costs, tolerance: float, integrators: Iterable[str], share: float
) -> tuple[list[Candidate], float]:
    """Return (cheapest Candidate of each integrator that keeps the tolerance, smallest error as it
    would grow until the end of the run).

    share : of the time, to the end of the pilot
    """
    dtype = "float64" if tolerance < SINGLE_REACHES else None
    tried = candidates(costs.pilot, costs.truth, integrators, dtype)
    kinds = costs.pilot.scene.known_integrators()
    # high orders first: they bound the cost of the others
    tried.sort(key=lambda way: (way[1] != "float64", -kinds[way[0]].order))
    compile_ahead(costs.pilot, tried)
    keeping: list[Candidate] = []
    nearest = math.inf
    for integrator, precision in tried:
        # a rung may have twice the steps it needs, and `_refined` then halves them: twice the cost
        most = 2.0 * min((costs.per_member(w) for w in keeping), default=math.inf)
        limit = _limit(costs.pilot, integrator, tolerance, share)

        def too_dear(way: Candidate, most: float = most) -> bool:
            return costs.per_member(way) > most

        ways = ladder(costs, integrator, precision, limit, 2.0, too_dear=too_dear)
        grown = share ** -growth_power(costs.pilot, integrator)
        nearest = min([nearest, *(grown * way.upper for way in ways)])
        if ways and ways[-1].upper <= limit:
            keeping.append(_refined(costs, ways, limit))
    return keeping, nearest


class _Check:
    """Check of candidates on a second pilot: closed forms by an integration, integrators by the
    reference of that pilot."""

    def __init__(
        self, costs: Costs, second: Pilot, tolerance: float, share: float, is_whole: bool
    ) -> None:
        """share : of the time, to the end of the second pilot;  is_whole : of the first one"""
        self.costs, self.true, self.second = costs, costs.truth, second
        self.tolerance, self.share, self.is_whole, first = tolerance, share, is_whole, costs.pilot
        self.longer = second.scene.run.t_end / first.scene.run.t_end
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
        grown = self.share ** -growth_power(self.second, way.integrator)
        return grown * (apart + other.error), self.true.source

    def choice(self, way: Candidate, ways: list[Candidate], apart: Array, source: str) -> Choice:
        """Return a candidate that keeps the tolerance as the choice among some."""
        others = [other for other in ways if other.integrator != way.integrator]
        cost = self.costs.per_member(way)
        return Choice(
            way,
            max(way.upper if self.is_whole else 0.0, upper_quantile(apart)),
            float(np.mean(apart <= self.tolerance)),
            source,
            (others[0], self.costs.per_member(others[0]) / cost) if others else None,
            cost,
            self.tolerance,
            self.second.members,
        )

    def finer(self, way: Candidate, error: float) -> Candidate | None:
        """Return a candidate in more steps; error : that it has, 0 if only its excess is known."""
        pilot, excess = self.costs.pilot, error / (SAFETY * self.tolerance)
        # `exact` has the order inf, with which no excess would ask for more steps
        order = min(8.0, pilot.scene.known_integrators()[way.integrator].order)
        factor = min(4.0, max(1.2, excess ** (1.0 / order)))
        steps = pilot.base * math.ceil(factor * way.steps / pilot.base)
        return measure_candidate(self.costs, way.integrator, way.dtype, steps)

    def work(self, way: Candidate) -> float:
        """Return the evaluations of a check; its reference costs about five times as much."""
        if way.integrator == "closed":
            return 0.0
        return (1 if self._truths else 6) * self.second.work(way.integrator, self._steps(way))

    def _steps(self, way: Candidate) -> Any:
        """Return the steps of a candidate on the second pilot: an integer, unless members have
        their own."""
        steps = self.faster * self.longer * way.steps
        if self.second.member_steps:
            return steps
        return self.second.base * math.ceil(steps / self.second.base * (1.0 - 1e-9))

    def _truth(self, closed: bool) -> Reference:
        if closed not in self._truths:
            agreed = max(AGREED, (1e-2 if closed else AGREEMENT) * self.tolerance * self.share**2)
            second = self.second
            self._truths[closed] = (
                integrate_reference(second, agreed)
                if closed
                else make_reference(second, say, agreed)
            )
        return self._truths[closed]

    def _apart(self, way: Candidate, other: Reference) -> Array:
        steps = self._steps(way)
        checked = measure_candidate(Costs(self.second, other), way.integrator, way.dtype, steps)
        if checked is None:  # the step is too long for a member of the second pilot
            return np.full(self.second.members, np.inf)
        return checked.errors["state"]


def _refined(costs: Costs, ways: list[Candidate], limit: float) -> Candidate:
    """Find a cheaper candidate between the last that failed and the first that kept the limit, in
    two attempts, using the slope between them."""
    base, good = costs.pilot.base, ways[-1]
    bad = ways[-2] if len(ways) > 1 else None
    for _ in range(2):
        if bad is None or good.steps - bad.steps <= base or not math.isfinite(bad.upper):
            break
        if not costs.pilot.effort.allows(costs.pilot.work(good.integrator, good.steps), LADDERS):
            break
        slope = math.log(bad.upper / good.upper) / math.log(good.steps / bad.steps)
        # the error hardly depends on the step: rounding, or a kink, and no slope to follow
        if slope <= 0.5:
            break
        # aims a tenth below the limit: the slope between two rungs is not the slope between these
        steps = base * math.ceil(good.steps / base * (good.upper / (0.9 * limit)) ** (1.0 / slope))
        steps = max(bad.steps + base, min(good.steps - base, steps))
        way = measure_candidate(costs, good.integrator, good.dtype, steps)
        if way is None:
            break
        good, bad = (way, bad) if way.upper <= limit else (good, way)
    return good


def check_quiet(effects: Sequence[Any]) -> None:
    """Raise SceneError if effects are random."""
    noisy = [name_of(e) for e in effects if is_random(e)]
    if noisy:
        rule = (
            f"{', '.join(noisy)} is random, so no single path is exact; halve dt to measure the "
            "error of averages instead"
        )
        raise SceneError(rule, at=f"effects.{noisy[0]}")


def check_pilot(pilot: Pilot) -> None:
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
    # errors as large as the motion, as after chaos, do not show an order
    hidden = not coarse < 0.1 or fine < 1e4 * ROUNDING * growth
    return math.inf if hidden else coarse / fine


def _unreachable(
    t_end: float, tolerance: float, pilot: Pilot, nearest: float, why: str
) -> SceneError:
    factor, rate = measure_growth(pilot)
    worst = upper_quantile(factor)
    if (gain := _gain(pilot, worst)) < SMOOTH:
        names = ", ".join(name_of(effect) for effect in pilot.scene.effects)
        rule = (
            f"out of reach: the best is {nearest:.1e}, and half the step divides the error of rk8"
            f" by {gain:.2g}, but by 256 for smooth torques. One of {names} has a kink or a jump:"
            " round it off over a width that some steps resolve, as `rest` of dry_friction does, or"
            " give an integrator and a step instead of a tolerance"
        )
        return SceneError(rule, at="run.tolerance", value=tolerance)
    reason = (
        f"{why}; over {t_end:g} s a change of the start grows {worst:.1e} times in the "
        "worst 1 % of members"
    )
    reason += ", exponentially: chaos or a separatrix" if np.mean(rate > 0.0) > 0.01 else ""
    rule = (
        f"out of reach of double precision here: the best is {nearest:.1e}. "
        f"{reason[0].upper()}{reason[1:]}. Request less accuracy, or a shorter t_end"
    )
    return SceneError(rule, at="run.tolerance", value=tolerance)
