"""Candidates for integrating a pilot: an integrator, a precision and a step, with their cost on
this machine and their error."""

import math
from collections.abc import Callable, Iterable

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.physics.integrators import integrators_for
from rigidmc.physics.observables import is_own
from rigidmc.planning.monitors import max_monitored_step
from rigidmc.planning.switches import switching_parameters
from rigidmc.planning.tolerance.costs import Candidate, Costs
from rigidmc.planning.tolerance.deviation import QUANTITIES, errors
from rigidmc.planning.tolerance.pilot import MOST_STEPS, Pilot, first_steps, integrate_pilot
from rigidmc.planning.tolerance.truth import Reference, closed_pilot_states

SINGLE = ("rk4", "exact", "strang")  # also tried in float32
LADDERS = 0.7  # of the effort of a search; the rest is for the check


def candidates(
    pilot: Pilot,
    true: Reference,
    integrators: Iterable[str] | None = None,
    dtype: str | None = None,
) -> list[tuple[str, str]]:
    """Return [(integrator, dtype)] that can run the scene of a pilot.

    A free body needs no splitting, which is the exact motion at more cost.
    """
    scene, kinds = pilot.scene, pilot.scene.known_integrators()
    able = [
        name
        for name in integrators_for(
            scene.effects, works="work" in scene.run.save, integrators=kinds
        )
        if name != "closed" or true.source.startswith("closed")
    ]
    # closed forms make no steps, and custom observables do not accept arrays
    has_custom = any(map(is_own, scene.recording.recorded.values()))
    if pilot.monitors.each_step or has_custom:
        able = [name for name in able if name != "closed"]
    if integrators:
        able = [name for name in integrators if name in able]
    if not scene.effects:
        able = [name for name in able if not kinds[name].is_splitting or name == "rotations"]
    # first the candidates that need no compiling: they bound the cost of the others
    able.sort(key=lambda name: name != "closed")
    both = [
        (name, real)
        for real in ("float64", "float32")
        for name in able
        if real == "float64" or name in SINGLE
    ]
    if switching_parameters(scene.effects):
        dtype = "float64"
    return [c for c in both if dtype in (None, c[1])]


def measure_candidate(costs: Costs, integrator: str, dtype: str, steps: int) -> Candidate | None:
    """Measure an integrator in `steps` steps; return None if it refuses the step."""
    pilot = costs.pilot
    if integrator == "closed":
        return _measure_closed(costs, dtype)
    try:
        states = integrate_pilot(pilot, integrator, steps, dtype)
    except SceneError:  # the step is too long for it
        return None
    mean, turn = pilot.mean_steps(steps), pilot.turn(steps) if pilot.member_steps else None
    apart = errors(pilot, states, costs.truth.states)
    ns, dt = costs.step(integrator, steps, dtype), pilot.scene.run.t_end / mean
    return Candidate(integrator, dtype, steps, mean, dt, turn, apart, ns)


def _measure_closed(costs: Costs, dtype: str) -> Candidate:
    """Measure the closed form. If it is the reference itself, its error is the effect of
    rounding."""
    pilot, saves, true = costs.pilot, costs.saves, costs.truth
    apart = errors(pilot, closed_pilot_states(pilot), true.states)
    if true.source.startswith("closed"):
        unseen = np.full(pilot.members, np.nan)
        errors_known = ("state", "momentum", "attitude")
        apart = {name: true.error if name in errors_known else unseen for name in QUANTITIES}
    ns = costs.step("closed", 1, dtype)
    return Candidate("closed", dtype, saves, saves, pilot.scene.run.t_end / saves, None, apart, ns)


def ladder(
    costs: Costs,
    integrator: str,
    dtype: str,
    finest: float = 0.0,
    ratio: float = 2.0**0.5,
    too_dear: Callable[[Candidate], bool] | None = None,
) -> list[Candidate]:
    """Measure candidates of one integrator from long steps to short ones.

    Stops once the error falls below `finest` or stops falling, or once too_dear(way) is true.

    If steps are monitored, none turns by more than `max_monitored_step`, because the error at the
    end does not show how short steps must be for events and extremes.
    """
    if integrator == "closed":
        return [_measure_closed(costs, dtype)]
    exact = costs.pilot.scene.known_integrators()[integrator].order == math.inf
    ways: list[Candidate] = []
    multiple = _first_multiple(costs.pilot, integrator)
    best, idle = math.inf, 0
    while (steps := costs.pilot.base * round(multiple)) <= MOST_STEPS:
        way = measure_candidate(costs, integrator, dtype, steps)
        if way is not None:
            ways.append(way)
            # a ladder may begin with steps so long that members fail, with errors of inf
            idle = 0 if len(ways) == 1 or way.upper < 0.8 * best else idle + 1
            best = min(best, way.upper)
            patience = 4 if best < 1e-2 else 5.5 / math.log(ratio)
            if best <= finest or idle >= patience or (too_dear and too_dear(way)):
                break
            more = costs.pilot.work(integrator, round(ratio * steps))
            if not costs.pilot.effort.allows(more, LADDERS):
                break
            if exact and idle >= 1:
                break
        multiple = max(ratio * multiple, round(multiple) + 1.0)
    return ways


def _first_multiple(pilot: Pilot, integrator: str) -> float:
    """Return the longest steps to try, as a multiple of the pilot's base."""
    # 24 times the first steps of 0.25 rad: 6 rad, about a revolution, which no step resolves
    multiple = max(1.0, first_steps(pilot) / pilot.base / 24.0)
    if pilot.scene.known_integrators()[integrator].order == math.inf:
        # one step between checks, or rounds of each member's own steps
        scene = pilot.stepped(pilot.base)[0].with_run(integrator=integrator)
        scheme = pilot.scheme(scene, pilot.scene.run.t_end)
        in_pieces = pilot.member_steps and len(scheme.substeps) > 2
        multiple = math.ceil(pilot.turn(pilot.base)) if in_pieces else 1.0
    if pilot.monitors.each_step:
        longest = max_monitored_step(pilot.scene.effects)
        multiple = max(multiple, math.ceil(pilot.turn(pilot.base) / longest))
    return multiple
