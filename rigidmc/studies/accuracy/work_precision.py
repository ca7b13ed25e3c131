"""Work against precision: every integrator that supports a scene, with a ladder of steps."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.kernel import layout
from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.amounts import read_count, two_digits
from rigidmc.inputs.arrays import Array
from rigidmc.physics.integrators import refusal
from rigidmc.planning.tolerance.choose import check_pilot, check_quiet
from rigidmc.planning.tolerance.costs import Candidate, Costs
from rigidmc.planning.tolerance.deviation import QUANTITIES, measure_growth, upper_quantile
from rigidmc.planning.tolerance.ladder import candidates, ladder
from rigidmc.planning.tolerance.pilot import ROUNDING, pilot
from rigidmc.planning.tolerance.search import compile_ahead
from rigidmc.planning.tolerance.truth import make_reference
from rigidmc.results.labels import count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.variables import StudyVariable, describe, make_dataset

FINEST = 1e-13  # the error at which a ladder ends: smaller errors are rounding
DEAREST = 40.0  # a ladder also ends at this multiple of the cost of the cheapest rival
WORDS = {
    "state": "larger of the errors of momentum and attitude",
    "momentum": "relative error of the angular momentum",
    "attitude": "error of the attitude [rad]",
    "energy": "error of the energy, relative to the energies involved",
    "l2": "relative error of |L|^2",
    "lz": "error of L_z, relative to |L|",
}

Statistic = Callable[[Array], Any]
STATISTICS: dict[str, Statistic] = {
    "median": np.median,
    "p99": lambda errors: np.quantile(errors, 0.99),
    "worst": np.max,
    "upper": upper_quantile,  # a bound for 99 % of all members, with 95 % confidence
}
ROWS = (
    StudyVariable("integrator", "row", "", "integrator"),
    StudyVariable("dtype", "row", "", "dtype"),
    StudyVariable("steps", "row", "", "steps"),
    StudyVariable("turn", "row", "rad", "rotation of each member per step"),
    StudyVariable("dt", "row", "s", "step, mean over members"),
    StudyVariable("ns_per_member_step", "row", "ns", "time of a member-step on one thread"),
    StudyVariable(
        "ns_per_member", "row", "ns",
        "time of a member to t_end on one thread, with start and saves",
    ),
    StudyVariable("members_per_second", "row", "s-1", "members to t_end on all threads"),
    *(
        StudyVariable(
            f"error_{quantity}_{word}", "row", "rad" if quantity == "attitude" else "1",
            f"{WORDS[quantity]}, {word} over members",
        )
        for quantity in QUANTITIES for word in STATISTICS
    ),
    StudyVariable(
        "cheapest", "tolerance", "", "row that reaches the tolerance at the least cost; -1 if none"
    ),
)  # fmt: skip


def work_precision(
    scene: Scene,
    integrators: Sequence[Any] | None,
    tolerances: Sequence[float],
    members: int,
    threads: int | None,
    say: Callable[[str], object],
) -> xr.Dataset:
    """Measure the errors and times of integrators, precisions and steps, and find the cheapest for
    each tolerance, see `rigidmc.accuracy`.

    say : called with a line of text for each stage
    """
    names = None
    if integrators is not None:
        scene, names = with_tried(scene, integrators)
    members = read_count(members, "members")
    refuse_count(members, "members of a pilot", 8 * layout.EFFECTS)
    check_quiet(scene.effects)
    first = pilot(scene, members)
    check_pilot(first)
    count = count_text(first.members, "member")
    say(f"first the truth for {count}, then each integrator with a range of steps")
    true = make_reference(first, say)
    costs = Costs(first, true)
    say(f"truth: {true.source}, known to {upper_quantile(true.error):.1e}")
    ways = _ways(costs, names, say)
    threads = threads or threads_available()
    values = _costs(ways, costs, threads) | _errors(ways)
    upper, cost = values["error_state_upper"], values["ns_per_member"]
    values["cheapest"] = np.array([
        min((i for i in range(len(cost)) if upper[i] <= t), key=lambda i: cost[i], default=-1)
        for t in tolerances
    ])  # fmt: skip
    attrs = {
        "t_end": scene.run.t_end,
        "members": first.members,
        "threads": threads,
        "truth": true.source,
        "truth_error": upper_quantile(true.error),
        **_horizon(scene.run.t_end, *measure_growth(first)),
    }
    coordinates = {"tolerance": ("tolerance", np.array(tolerances))}
    return describe(make_dataset(ROWS, values, coordinates, attrs), scene)


def with_tried(scene: Scene, integrators: Sequence[Any]) -> tuple[Scene, list[str]]:
    """Return (the scene with custom integrators, the names of all); OptionError for one that does
    not support the scene, before the truth is computed, which takes seconds."""
    scene, names = scene.with_integrators(integrators)
    by_name = scene.known_integrators()
    for name in names:
        if name not in by_name:
            raise unknown("integrator", by_name, at="integrators", value=name, error=OptionError)
        if why := refusal(name, scene.effects, known=by_name):
            raise OptionError(why, at="integrators", value=name)
    return scene, names


def _ways(
    costs: Costs, integrators: Sequence[str] | None, say: Callable[[str], object]
) -> list[Candidate]:
    """Return a ladder of steps for each integrator and precision that supports the scene."""
    ways: list[Candidate] = []

    def too_dear(way: Candidate) -> bool:
        rivals = [costs.per_member(w) for w in ways if w.upper <= way.upper]
        return bool(rivals) and costs.per_member(way) > DEAREST * min(rivals)

    # high orders first: they set the cost limit of the others
    by_name = costs.pilot.scene.known_integrators()
    pairs = candidates(costs.pilot, costs.truth, integrators)
    pairs = sorted(pairs, key=lambda pair: -by_name[pair[0]].order)
    compile_ahead(costs.pilot, pairs)
    began = time.perf_counter()
    for done, (integrator, dtype) in enumerate(pairs, 1):
        rungs = ladder(costs, integrator, dtype, FINEST, too_dear=too_dear)
        if rungs:
            best, tried = min(way.upper for way in rungs), len(rungs)
            dear = best > FINEST and too_dear(rungs[-1])
            ended = f"; stopped: others cost 1/{DEAREST:g} or less" if dear else ""
            left = (time.perf_counter() - began) * (len(pairs) / done - 1.0)
            words = f"{tried:2d} step{'s' * (tried > 1)} tried, best error {best:.1e}{ended}"
            when = f"{done} of {len(pairs)}, about {left:.0f} s left"
            say(f"{integrator:9s} {dtype}: {words}; {when}")
        ways += rungs
    return ways


def _costs(ways: list[Candidate], costs: Costs, threads: int) -> dict[str, Any]:
    """Return the variables that identify each candidate, and its cost."""
    speeds = np.array([costs.members_per_second(w, threads) for w in ways], float)
    on = {"long_name": f"members to t_end on {count_text(threads, 'thread')}"}
    return {
        "integrator": np.array([w.integrator for w in ways], object),
        "dtype": np.array([w.dtype for w in ways], object),
        "steps": np.array([w.mean_steps for w in ways], float),
        "turn": np.array([np.nan if w.turn is None else w.turn for w in ways], float),
        "dt": np.array([w.dt for w in ways], float),
        "ns_per_member_step": np.array([w.ns for w in ways], float),
        "ns_per_member": np.array([costs.per_member(w) for w in ways], float),
        "members_per_second": xr.Variable("row", speeds, on),
    }


def _errors(ways: list[Candidate]) -> dict[str, Any]:
    """Return the variables of the errors, by quantity and statistic."""
    values: dict[str, Any] = {}
    with np.errstate(invalid="ignore"):
        for quantity in QUANTITIES:
            for word, statistic in STATISTICS.items():
                errors = [_finite_or_inf(statistic, w.errors[quantity]) for w in ways]
                values[f"error_{quantity}_{word}"] = np.array(errors)
    return values


def _finite_or_inf(statistic: Statistic, errors: Array) -> float:
    """Return a statistic of errors; inf if it falls on infinite errors, nan if none is known."""
    if np.isnan(errors).all():
        return math.nan
    return float(np.nan_to_num(statistic(errors), nan=np.inf, posinf=np.inf))


def _horizon(t_end: float, factor: Array, rate: Array) -> dict[str, float]:
    """Return the growth of a disturbance, and the time at which rounding alone has grown to 1 rad
    [s]: in half of the members (median), and in the first 1 % of them (p01).

    factor : growth by t_end;  rate : its exponential rate [1/s], 0 if regular
    """
    with np.errstate(divide="ignore"):
        left = np.log(1.0 / (ROUNDING * factor))
        # the 1.0 avoids division by zero; the last line discards these values
        chaotic = t_end + left / np.where(rate > 0.0, rate, 1.0)
        times = np.where(rate > 0.0, chaotic, t_end / (ROUNDING * factor))
    return {
        "growth_median": float(np.median(factor)),
        "growth_p99": float(np.quantile(factor, 0.99)),
        "chaotic_share": float(np.mean(rate > 0.0)),
        "horizon_median": float(np.median(times)),
        "horizon_p01": float(np.quantile(times, 0.01)),
    }


def ladder_table(study: xr.Dataset) -> list[str]:
    """Return lines of text: the cheapest choice for each tolerance, and its gain over rk4."""
    a, names, upper = study.attrs, study.integrator.values, study.error_state_upper.values
    members = f"{count_text(a['members'], 'member')} to {a['t_end']:g} s"
    lines = [f"truth: {a['truth']}, known to {a['truth_error']:.1e}; {members}"]
    for tolerance, i in zip(study.tolerance.values, study.cheapest.values, strict=True):
        if i < 0:
            lines.append(f"for {tolerance:.0e}: none; the best reaches {upper.min():.1e}")
            continue
        row = study.isel(row=int(i))
        if names[i] == "closed":
            step = "at every save"
        elif np.isnan(row.turn):
            step = f"at dt {float(row.dt):.2g}"
        else:
            step = f"at turn {float(row.turn):.2g}"
        single = " in float32" if row["dtype"].values == "float32" else ""
        speed = f"{two_digits(float(row.members_per_second))} members/s"
        gain = _gain(study, int(i), tolerance)
        lines.append(f"for {tolerance:.0e}: {names[i]}{single} {step}, {speed}{gain}")
    return [*lines, horizon_text(study)]


def _gain(study: xr.Dataset, row: int, tolerance: float) -> str:
    """Return a text with the gain of a row over rk4; "" if rk4 was not tried."""
    names, cost = study.integrator.values, study.ns_per_member.values
    if names[row] == "rk4" or "rk4" not in names:
        return ""
    able = (names == "rk4") & (study.error_state_upper.values <= tolerance)
    if not able.any():
        return "; rk4 does not reach it"
    return f"; {cost[able].min() / cost[row]:.1f}x cheaper than rk4"


def horizon_text(study: xr.Dataset) -> str:
    """Return a line about the time up to which any double-precision result is meaningful."""
    a = study.attrs
    first, median = a["horizon_p01"], a["horizon_median"]
    growth = (
        f"by {a['t_end']:g} s a disturbance grows by a factor of {a['growth_median']:.0e} in the"
        f" median, {a['growth_p99']:.0e} in the worst 1 %"
    )
    if a["chaotic_share"] > 0.005:
        share = f"{100 * a['chaotic_share']:.0f} % of the members"
        return (
            f"{growth}; in {share} it grows exponentially (chaos or a separatrix): rounding alone"
            f" makes 1 % of the members meaningless after t = {first:.3g} s, half of them after"
            f" {median:.3g} s"
        )
    # 1e-300 s: 0 has no logarithm
    exponent = math.floor(math.log10(max(first, 1e-300)))
    return f"{growth}; in no member exponentially: no horizon within 1e{exponent} s"
