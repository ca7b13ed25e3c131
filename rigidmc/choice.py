"""Which integrator and step give an accuracy at the least cost, for a scene and a machine: measured on a pilot, not guessed."""

import math
import time
from typing import Any, NamedTuple

import numpy as np

from rigidmc.ahead import compile_ahead
from rigidmc.body import Body
from rigidmc.closed_form import closed_values
from rigidmc.effects import EFFECTS, name_of
from rigidmc.engine import kernel
from rigidmc.engine.compose import as_single
from rigidmc.engine.machine import threads_available
from rigidmc.errors import SceneError, unknown
from rigidmc.integrators import INTEGRATORS, accepting
from rigidmc.observables import OBSERVABLES, SIZES
from rigidmc.pilot import MOST_STEPS, OBSERVED, QUANTITIES, errors, first_steps, follow, growth, pilot, truth, upper_quantile
from rigidmc.planning import BLOCK, form_of
from rigidmc.sampling import Start, rows
from rigidmc.scene import Scene
from rigidmc.staging import stage

PILOT = 512  # members: then the 99 % of a distribution are below the second largest error with 96 % certainty
# Those that have been the cheapest for some scene and tolerance; the others are for comparison (`rigidmc accuracy`), and each costs 3 s to compile.
CONTENDERS = ("closed", "exact", "rk4", "rk8", "strang", "chin4", "srkn6", "srkn11", "aba864", "aba1064")
SINGLE = ("rk4", "exact", "strang")  # tried in float32 too
SINGLE_REACHES = 3e-7  # five roundings of float32: not tried below
SAFETY = 0.8  # of the tolerance, that a pilot must keep


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
        made, _ = form_of(scene, scene.run.t_end / steps, self.pilot.carried)
        key = type(made.integrator), made.integrator, len(made.parts), dtype
        return self._once(key, lambda: self._stepped(made, scene.run.t_end / steps, dtype, OBSERVED))

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
            made, _ = form_of(scene, 1.0, self.pilot.carried)
            observables = tuple(OBSERVABLES[name]() for name in scene.run.save)
            h = 1e-6 * scene.run.t_end
            plain, saving = (self._stepped(made, h, "float64", observables, stride=stride) for stride in (32, 1))
            return max(0.0, saving - plain)

        return self._once("save", record)

    def _once(self, key, measure):
        if key not in self._known:
            self._known[key] = measure()
        return self._known[key]

    def _closed(self):
        scene, count = self.pilot.scene, min(512, max(kernel.LANES, self.pilot.members))
        saves, taken = min(self.saves, 50), []
        times = np.linspace(0.0, scene.run.t_end, saves + 1)
        for _ in range(3):
            block, start = stage(scene, 0, count, self.pilot.carried)
            began = time.perf_counter()
            closed_values(scene, block, start, times)
            taken.append(time.perf_counter() - began)
        return 1e9 * min(taken) / (count * saves)

    def _stepped(self, made, h, dtype, observables, stride=None):
        effects = tuple(type(e)(*[0.0] * len(e)) for e in self.pilot.scene.effects)
        integrator = as_single(made.integrator) if dtype == "float32" else made.integrator
        own = self.pilot.own and stride is None
        how = (
            integrator, made.parts, effects, observables, (0.0,) if self.pilot.carried else (), (), np.empty(0, dtype),
            (np.arange(512),) if own else (),
        )  # fmt: skip
        few, steps = self.pilot.block, 32
        block = np.ascontiguousarray(np.tile(few, -(-512 // few.shape[1]))[:, :512])
        width, values = block.shape[1] if observables else 0, sum(SIZES[o.dims] for o in observables)
        best, spent = math.inf, -1.0
        while spent < 0.03:
            out = np.empty((steps + 1) * values * width)
            given, span, slots = block.copy(), h, 1
            if own:
                given[kernel.STEPS], span, slots = steps, h * steps, steps
            began = time.perf_counter()
            kernel.advance(*how, given, out, width, 0, span, slots, 0, steps, stride or steps, steps)
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
    able = [name for name in accepting(scene.effects) if name != "closed" or true.source.startswith("closed")]
    if integrators:
        for name in integrators:
            if name not in INTEGRATORS:
                raise unknown("", "integrators", name, "integrator", INTEGRATORS)
        able = [name for name in integrators if name in able]
    if not scene.effects:
        able = [name for name in able if not hasattr(INTEGRATORS[name], "drifts") or name == "rotations"]
    able.sort(key=lambda name: name != "closed")  # what needs no compiling first: it bounds what others may cost
    both = [(name, real) for real in ("float64", "float32") for name in able if real == "float64" or name in SINGLE]
    return [c for c in both if dtype in (None, c[1])]


def measured(costs, true, integrator, dtype, steps):
    """The Way of an integrator in `steps` steps; None where it refuses the step."""
    found = costs.pilot
    if integrator == "closed":  # its error cannot be seen against itself: what rounding does
        unseen = np.full(found.members, np.nan)
        apart = {name: true.error if name in ("state", "momentum", "attitude") else unseen for name in QUANTITIES}
        ns, saves = costs.step(integrator, 1, dtype), costs.saves
        return Way(integrator, dtype, saves, saves, found.scene.run.t_end / saves, None, apart, ns)
    try:
        states = follow(found, integrator, steps, dtype)
    except SceneError:  # a step too long for it
        return None
    mean, turn = found.mean_steps(steps), found.turn(steps) if found.own else None
    apart = errors(found, states, true.states)
    return Way(integrator, dtype, steps, mean, found.scene.run.t_end / mean, turn, apart, costs.step(integrator, steps, dtype))


def ladder(costs, true, integrator, dtype, finest=0.0, ratio=2.0**0.5, most=MOST_STEPS, too_dear=None):
    """Ways of one integrator from long steps to short ones, until the error falls below `finest` or falls no more, or too_dear(way)."""
    found, ways = costs.pilot, []
    multiple = max(1.0, first_steps(found) / found.base / 24.0)
    if integrator == "closed":
        return [measured(costs, true, integrator, dtype, 1)]
    if INTEGRATORS[integrator].order == math.inf:  # one step between checks, or pieces of each member's own
        whole, _ = form_of(found.stepped(found.base)[0].with_run(integrator=integrator), found.scene.run.t_end, found.carried)
        multiple = math.ceil(found.turn(found.base)) if found.own and len(whole.parts) > 2 else 1.0
    best, idle = math.inf, 0
    while (steps := found.base * round(multiple)) <= most:
        way = measured(costs, true, integrator, dtype, steps)
        if way is not None:
            ways.append(way)
            idle = 0 if way.upper < 0.8 * best else idle + 1
            best = min(best, way.upper)
            if best <= finest or idle >= (4 if best < 1e-2 else 5.5 / math.log(ratio)) or (too_dear and too_dear(way)):
                break
            if INTEGRATORS[integrator].order == math.inf and idle >= 1:
                break
        multiple = max(ratio * multiple, round(multiple) + 1.0)
    return ways


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

    def lines(self, count, seconds=None):
        """What was picked and why, and how long `count` members will take, by a rehearsal where there was one."""
        way, other = self.way, self.runner_up
        lines = [f"for a tolerance of {self.tolerance:g}: {way.with_precision()} {way.step}, the cheapest of those that reach it"]
        if other is not None:
            lines.append(f"  next best {other[0].with_precision()} {other[0].step}, {other[1]:.2g} times the cost")
        lines.append(
            f"  error of 99 % of the members below {self.predicted:.1e}; on a second pilot of {self.members} members {100 * self.checked:.1f} % keep the tolerance"
        )
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
        return found | ({"tolerance_runner_up": f"{other[0].with_precision()} {other[0].step}"} if other else {})


def choose(scene, tolerance, integrators=None, members=PILOT, threads=None):
    """The cheapest way to keep the error of momentum and attitude of 99 % of all members below `tolerance`.

    Raises SceneError where none reaches it, with the best that can be had and why.
    """
    if not (isinstance(tolerance, float) and 0.0 < tolerance < 1.0):
        raise SceneError(
            "run", "tolerance", tolerance, "expected an error between 0 and 1: of the momentum's size, and of the attitude in rad"
        )
    first = pilot(scene, members)
    check_pilot(scene, first)
    true, costs = truth(first), Costs(first)
    known = upper_quantile(true.error)
    if known > tolerance:
        raise _unreachable(scene, tolerance, first, known, f"the truth itself is known to {known:.1e} only ({true.source})")
    found: list[Way] = []
    nearest = math.inf
    tried = candidates(scene, true, integrators or CONTENDERS, "float64" if tolerance < SINGLE_REACHES else None)
    compile_ahead(first, tried)
    for integrator, dtype in tried:
        dearest = min((costs.per_member(w) for w in found), default=math.inf)
        limit = tolerance if integrator == "closed" else SAFETY * tolerance
        ways = ladder(costs, true, integrator, dtype, limit, 2.0, too_dear=lambda w, most=2.0 * dearest: costs.per_member(w) > most)
        nearest = min([nearest, *(w.upper for w in ways)])
        if ways and ways[-1].upper <= limit:
            found.append(_refined(costs, true, ways, limit))
    if not found:
        raise _unreachable(scene, tolerance, first, nearest, "no integrator comes nearer")
    found.sort(key=costs.per_member)
    second = pilot(scene, members, first.first + first.members)._replace(own=first.own)
    other_true, faster = truth(second), float(second.rates.max() / first.rates.max()) if first.own else 1
    for way in found:
        for _ in range(4):
            check = measured(Costs(second), other_true, way.integrator, way.dtype, faster * way.steps).errors["state"]
            share = float(np.mean(check <= tolerance))
            if share >= 0.99:
                others = [w for w in found if w.integrator != way.integrator]
                cost, speed = costs.per_member(way), costs.members_per_second(way, threads)
                runner_up = (others[0], costs.per_member(others[0]) / cost) if others else None
                known = max(way.upper, upper_quantile(check))
                return Chosen(way, known, share, true.source, runner_up, speed, tolerance, second.members)
            steps = first.base * math.ceil(1.2 * way.steps / first.base)
            way = measured(costs, true, way.integrator, way.dtype, steps) or way
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


def check_pilot(scene, found):
    """Raise SceneError where no path is right, or where members of the pilot are no bodies."""
    noisy = [name_of(e) for e in scene.effects if getattr(e, "stochastic", False)]
    if noisy:
        rule = f"{', '.join(noisy)} is random: no path is right, and what can be measured is the error of averages, by halving dt"
        raise SceneError("effects", noisy[0], None, rule)
    bad = int(np.count_nonzero(found.block[kernel.STATUS, : found.members]))
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
