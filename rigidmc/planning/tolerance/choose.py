"""Which integrator and step give an accuracy at the least cost, for a scene and a machine: measured on a pilot, not guessed."""

import math
from typing import Any, NamedTuple

import numpy as np

from rigidmc.effects import name_of
from rigidmc.effects.protocol import is_random
from rigidmc.engine import layout
from rigidmc.errors import SceneError
from rigidmc.planning.tolerance.compile_ahead import compile_ahead
from rigidmc.planning.tolerance.ladder import Costs, Way, candidates, ladder, measured
from rigidmc.planning.tolerance.pilot import growth, pilot, upper_quantile
from rigidmc.planning.tolerance.truth import AGREED, check_agreement, integrated, truth

PILOT = 512  # members: then the 99 % of a distribution are below the second largest error with 96 % certainty
# Those that have been the cheapest for some scene and tolerance; the others are for comparison (`rigidmc accuracy`), and each costs 3 s to compile.
CONTENDERS = (
    "closed",
    "exact",
    "rk4",
    "rk8",
    "strang",
    "chin4",
    "srkn6",
    "srkn11",
    "aba864",
    "aba1064",
)
SINGLE_REACHES = 3e-7  # five roundings of float32: not tried below
SAFETY = 0.8  # of the tolerance, that a pilot must keep


def resolved(scene, threads=None):
    """(scene with the integrator, precision and step that `choose` found for its tolerance, Chosen); as it is, and None, unless "auto"."""
    run = scene.run
    if run.integrator != "auto":
        return scene, None
    scene.check()
    found = choose(scene.with_run(integrator="rk4"), run.tolerance, threads=threads)
    way = found.way
    step = {"dt": way.dt} if way.turn is None else {"turn": way.turn}
    return scene.with_run(integrator=way.integrator, dtype=way.dtype, **step), found


class Chosen(NamedTuple):
    """What `--tolerance` found: the way, how sure it is, and what else there was."""

    way: Way
    predicted: float  # error that 99 % of members stay below
    checked: float  # share of the members of a second pilot within the tolerance
    truth: str
    runner_up: Any
    members_per_second: float
    tolerance: float
    members: int

    @property
    def short(self):
        """A sentence that says so if the predicted error is above the tolerance although finer steps were tried, else ""."""
        missed = f"the error bound of 99 % of the members, {self.predicted:.2g}, is above the tolerance of {self.tolerance:g}"
        return f"{missed}; finer steps were tried" if self.predicted > self.tolerance else ""

    def lines(self, count, seconds=None):
        """What was picked and why, and how long `count` members will take, by a rehearsal where there was one."""
        way, other = self.way, self.runner_up
        lines = [
            f"for a tolerance of {self.tolerance:g}: {way.with_precision()} {way.step}, the cheapest of those that reach it"
        ]
        if other is not None:
            lines.append(
                f"  next best {other[0].with_precision()} {other[0].step}, {other[1]:.2g} times the cost"
            )
        lines.append(
            f"  error of 99 % of the members below {self.predicted:.1e}; on a second pilot of {self.members} members {100 * self.checked:.1f} % keep the tolerance"
        )
        lines += [f"  note: {self.short}"] * bool(self.short)
        lines.append(f"  against the {self.truth}")
        seconds = count / self.members_per_second if seconds is None else seconds
        lines.append(f"  about {seconds:.2g} s for {count:,} members")
        return lines

    def attributes(self):
        """What a result tells of the choice; nothing of it is a time of this machine."""
        way, other = self.way, self.runner_up
        found: dict[str, Any] = {
            "tolerance": self.tolerance,
            "tolerance_predicted_error": self.predicted,
            "tolerance_checked_share": self.checked,
        }
        found |= {
            "tolerance_truth": self.truth,
            "tolerance_chosen": f"{way.with_precision()} {way.step}: the cheapest that reaches it",
        }
        return found | (
            {"tolerance_runner_up": f"{other[0].with_precision()} {other[0].step}"} if other else {}
        )


def choose(scene, tolerance, integrators=None, members=PILOT, threads=None):
    """The cheapest way to keep the error of momentum and attitude of 99 % of all members below `tolerance`.

    Raises SceneError where none reaches it, with the best that can be had and why.
    """
    if not (isinstance(tolerance, float) and 0.0 < tolerance < 1.0):
        raise SceneError(
            "run",
            "tolerance",
            tolerance,
            "expected an error between 0 and 1: of the momentum's size, and of the attitude in rad",
        )
    check_quiet(scene)
    first = pilot(scene, members)
    check_pilot(scene, first)
    true, costs = truth(first), Costs(first)
    known = upper_quantile(true.error)
    if known > tolerance:
        raise _unreachable(
            scene,
            tolerance,
            first,
            known,
            f"the truth itself is known to {known:.1e} only ({true.source})",
        )
    found: list[Way] = []
    nearest = math.inf
    tried = candidates(
        scene, true, integrators or CONTENDERS, "float64" if tolerance < SINGLE_REACHES else None
    )
    compile_ahead(first, tried)
    for integrator, dtype in tried:
        dearest = min((costs.per_member(w) for w in found), default=math.inf)
        limit = tolerance if integrator == "closed" else SAFETY * tolerance
        ways = ladder(
            costs,
            true,
            integrator,
            dtype,
            limit,
            2.0,
            too_dear=lambda w, most=2.0 * dearest: costs.per_member(w) > most,
        )
        nearest = min([nearest, *(w.upper for w in ways)])
        if ways and ways[-1].upper <= limit:
            found.append(_refined(costs, true, ways, limit))
    if not found:
        raise _unreachable(scene, tolerance, first, nearest, "no integrator comes nearer")
    found.sort(key=costs.per_member)
    second = pilot(scene, members, first.first + first.members)._replace(own=first.own)
    faster = float(second.rates.max() / first.rates.max()) if first.own else 1
    truths: dict[bool, Any] = {}
    spare = None
    for way in found:
        closed = way.integrator == "closed"
        if closed not in truths:  # a choice is checked by another method than its own
            truths[closed] = (
                integrated(second, max(AGREED, 1e-2 * tolerance)) if closed else truth(second)
            )
        other = truths[closed]
        for _ in range(4):
            check = measured(
                Costs(second), other, way.integrator, way.dtype, faster * way.steps
            ).errors["state"]
            if closed:
                check_agreement(check, other.error, true, other.source)
                check = np.maximum(
                    check - other.error, 0.0
                )  # the integration's own error does not count against the closed form
            share = float(np.mean(check <= tolerance))
            if share >= 0.99:
                others = [w for w in found if w.integrator != way.integrator]
                cost, speed = costs.per_member(way), costs.members_per_second(way, threads)
                runner_up = (others[0], costs.per_member(others[0]) / cost) if others else None
                known = max(way.upper, upper_quantile(check))
                source = (
                    f"{true.source}; the second pilot by {other.source}" if closed else true.source
                )
                made = Chosen(
                    way, known, share, source, runner_up, speed, tolerance, second.members
                )
                if known <= tolerance:
                    return made
                spare = spare or made
            steps = first.base * math.ceil(1.2 * way.steps / first.base)
            way = measured(costs, true, way.integrator, way.dtype, steps) or way
    if spare is not None:
        return spare
    raise _unreachable(scene, tolerance, first, nearest, "members beyond the pilot err more")


def _refined(costs, true, ways, limit):
    """A cheaper way between the last that failed and the first that kept the limit, by the slope between them, once."""
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
        way = measured(costs, true, good.integrator, good.dtype, steps)
        if way is None:
            break
        good, bad = (way, bad) if way.upper <= limit else (good, way)
    return good


def check_quiet(scene):
    """Raise SceneError where effects are random."""
    noisy = [name_of(e) for e in scene.effects if is_random(e)]
    if noisy:
        rule = f"{', '.join(noisy)} is random: no path is right, and what can be measured is the error of averages, by halving dt"
        raise SceneError("effects", noisy[0], None, rule)


def check_pilot(scene, found):
    """Raise SceneError where members of the pilot are no bodies."""
    bad = int(np.count_nonzero(found.block[layout.STATUS, : found.members]))
    if bad:
        raise SceneError(
            "body",
            "moments",
            None,
            f"{bad} of {found.members} members of the pilot are no bodies: mend the scene before asking for accuracy",
        )


def _unreachable(scene, tolerance, found, nearest, why):
    factor, rate = growth(found)
    worst = upper_quantile(factor)
    reason = f"{why}; over {scene.run.t_end:g} s a change of the start grows {worst:.1e} times in the worst 1 % of members"
    reason += ", exponentially: chaos or a separatrix" if np.mean(rate > 0.0) > 0.01 else ""
    rule = f"out of reach of double precision here: the best is {nearest:.1e}. {reason[0].upper()}{reason[1:]}. Ask for less, or for a shorter t_end"
    return SceneError("run", "tolerance", tolerance, rule)
