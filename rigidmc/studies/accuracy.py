"""What accuracy costs in time: every integrator that takes a scene, over a ladder of steps, against the truth."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import OptionError, unknown
from rigidmc.integrators import INTEGRATORS, accepting, refusal
from rigidmc.planning.tolerance.choose import check_pilot
from rigidmc.planning.tolerance.compile_ahead import compile_ahead
from rigidmc.planning.tolerance.costs import Costs
from rigidmc.planning.tolerance.deviation import QUANTITIES, drift_along, upper_quantile
from rigidmc.planning.tolerance.growth import growth
from rigidmc.planning.tolerance.ladder import candidates, ladder
from rigidmc.planning.tolerance.pilot import ROUNDING, pilot
from rigidmc.planning.tolerance.truth import truth
from rigidmc.scene.amounts import counted, seconds
from rigidmc.scene.conservation import conservation
from rigidmc.version import VERSION

TOLERANCES = tuple(10.0**-k for k in range(3, 13))
FINEST = 1e-13  # ladders end there: below it is rounding
DEAREST = 40.0  # a ladder ends where it costs so many times the cheapest way seen to the same error
LONG = (
    "rk4",
    "rk8",
    "midpoint",
    "strang",
    "rotations",
    "chin4",
    "srkn11",
    "aba1064",
)  # of every kind one
_WHAT = {
    "state": "larger of the errors of momentum and attitude",
    "momentum": "error of the angular momentum, of its size",
    "attitude": "error of the attitude [rad]",
    "energy": "error of the energy, of the energies in play",
    "l2": "error of |L|^2, of its size",
    "lz": "error of L_z, of |L|",
}


def accuracy(
    scene, integrators=None, tolerances=TOLERANCES, members=256, threads=None, progress=None
):
    """What accuracy costs: a Dataset with one row for each integrator, precision and step.

    scene : Scene;  integrators : names, default all that take the scene;  tolerances : for the table of the cheapest ways
    members : of the pilot, the first of the scene's own ensemble;  threads : that the members per second are for
    progress : function of a line of text

    Where the members' rates are very different each takes steps of its own: `turn` [rad] is what they have in common, dt and steps are means.

    Variables over `row`: integrator, dtype, dt [s], steps, turn, error_Q_S with Q of state, momentum, attitude, energy, l2, lz and S of median,
    p99, worst, upper (what 99 % of all members stay below with 95 % certainty), ns_per_member_step and ns_per_member on one thread,
    members_per_second. Errors are the largest over up to 8 of the times that the scene saves. `cheapest` over `tolerance` is the row that
    reaches it at the least cost, -1 where none does. Attributes tell the truth, how well it is known, and the horizon of rounding.

    Raises SceneError for a scene that cannot be run, has noise, or whose pilot fails.
    """
    if integrators:
        for name in integrators:
            if name in INTEGRATORS and (why := refusal(name, scene.effects)):
                raise OptionError("", "integrators", name, why)
    found = pilot(scene, counted(members, "members"))
    check_pilot(scene, found)
    say = progress or (lambda line: None)
    true, costs = truth(found), Costs(found)
    say(f"truth: {true.source}, known to {upper_quantile(true.error):.1e}")
    ways: list = []

    def too_dear(way):
        rivals = [costs.per_member(w) for w in ways if w.upper <= way.upper]
        return bool(rivals) and costs.per_member(way) > DEAREST * min(rivals)

    tried = sorted(candidates(scene, true, integrators), key=_promising)
    compile_ahead(found, tried)
    for integrator, dtype in tried:
        made = ladder(costs, true, integrator, dtype, FINEST, too_dear=too_dear)
        ways += made
        if made:
            say(
                f"{integrator:9s} {dtype}: {len(made):2d} steps tried, best error {min(w.upper for w in made):.1e}"
            )
    return _dataset(scene, found, true, costs, ways, tolerances, threads or threads_available())


def _promising(candidate):
    """High orders first: they bound what the others may cost."""
    return -INTEGRATORS[candidate[0]].order


def _dataset(scene, found, true, costs, ways, tolerances, threads):
    many = costs.members_per_second
    columns = {
        "integrator": np.array([w.integrator for w in ways], dtype=object),
        "dtype": np.array([w.dtype for w in ways], dtype=object),
        "steps": np.array([float(w.mean_steps) for w in ways]),
        "turn": np.array([np.nan if w.turn is None else w.turn for w in ways]),
        "dt": np.array([w.dt for w in ways]),
        "ns_per_member_step": np.array([w.ns for w in ways]),
        "ns_per_member": np.array([costs.per_member(w) for w in ways]),
        "members_per_second": np.array([many(w, threads) for w in ways]),
    }
    units = {
        "dt": "s",
        "turn": "rad",
        "ns_per_member_step": "ns",
        "ns_per_member": "ns",
        "members_per_second": "s-1",
    }
    names = {
        "dt": "step, of the members in the mean", "turn": "how far each member moves in a step of its own", "ns_per_member_step": "time of a member-step on one thread", "members_per_second": f"members to t_end on {threads} threads",
        "ns_per_member": "time of a member to t_end on one thread, start and saves included",
    }  # fmt: skip
    variables = {
        k: ("row", v, {**({"units": units[k]} if k in units else {}), "long_name": names.get(k, k)})
        for k, v in columns.items()
    }
    takes: dict[str, Callable] = {
        "median": np.median,
        "p99": lambda e: np.quantile(e, 0.99),
        "worst": np.max,
        "upper": upper_quantile,
    }
    for quantity in QUANTITIES:
        for word, take in takes.items():
            with np.errstate(invalid="ignore"):
                values = np.array([_finite_or_inf(take, w.errors[quantity]) for w in ways])
            about = {
                "units": "rad" if quantity == "attitude" else "1",
                "long_name": f"{_WHAT[quantity]}, {word} over members",
            }
            variables[f"error_{quantity}_{word}"] = ("row", values, about)
    upper, cost = variables["error_state_upper"][1], columns["ns_per_member"]
    cheapest = [
        min((i for i in range(len(ways)) if upper[i] <= t), key=lambda i: cost[i], default=-1)
        for t in tolerances
    ]
    variables["cheapest"] = (
        "tolerance",
        np.array(cheapest),
        {"long_name": "row that reaches the tolerance at the least cost, -1: none"},
    )
    factor, rate = growth(found)
    attrs: dict[str, Any] = {
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "scene": scene.dumps(),
        "t_end": scene.run.t_end,
        "members": found.members,
        "threads": threads,
        "truth": true.source,
        "truth_error": upper_quantile(true.error),
        "growth_median": float(np.median(factor)),
        "growth_p99": float(np.quantile(factor, 0.99)),
        "chaotic_share": float(np.mean(rate > 0.0)),
        **_horizon(scene.run.t_end, factor, rate),
    }
    return xr.Dataset(variables, {"tolerance": ("tolerance", np.array(tolerances))}, attrs)


def _finite_or_inf(take, errors):
    """A quantile; between inf and inf it is inf. nan where no error is known."""
    return math.nan if np.isnan(errors).all() else float(np.nan_to_num(take(errors), nan=np.inf))


def _horizon(t_end, factor, rate):
    """When rounding alone has grown to 1 rad: in half of the members, and in the first of a hundred [s]."""
    with np.errstate(divide="ignore"):
        left = np.log(1.0 / (ROUNDING * factor))
        times = np.where(
            rate > 0.0, t_end + left / np.where(rate > 0.0, rate, 1.0), t_end / (ROUNDING * factor)
        )
    return {
        "horizon_median": float(np.median(times)),
        "horizon_p01": float(np.quantile(times, 0.01)),
    }


def table(study):
    """Lines of text: for each tolerance the cheapest way, and how much cheaper than rk4 it is."""
    names, upper, cost = (
        study.integrator.values,
        study.error_state_upper.values,
        study.ns_per_member.values,
    )
    lines = [
        f"truth: {study.attrs['truth']}, known to {study.attrs['truth_error']:.1e}; {study.attrs['members']} member{'s' * (study.attrs['members'] > 1)} to {study.attrs['t_end']:g} s"
    ]
    for tolerance, row in zip(study.tolerance.values, study.cheapest.values, strict=True):
        if row < 0:
            lines.append(f"for {tolerance:.0e}: none; the best reaches {upper.min():.1e}")
            continue
        plain = [cost[i] for i in range(len(names)) if names[i] == "rk4" and upper[i] <= tolerance]
        against = (
            f"; {min(plain) / cost[row]:.1f}x cheaper than rk4"
            if plain and names[row] != "rk4"
            else ""
        )
        against = against or ("" if names[row] == "rk4" else "; rk4 does not reach it")
        single = " in float32" if study["dtype"].values[row] == "float32" else ""
        step = (
            f"at dt {study.dt.values[row]:.2g}"
            if np.isnan(study.turn.values[row])
            else f"at turn {study.turn.values[row]:.2g}"
        )
        step = "at every save" if names[row] == "closed" else step
        lines.append(
            f"for {tolerance:.0e}: {names[row]}{single} {step}, {count(study.members_per_second.values[row])} members/s{against}"
        )
    lines.append(horizon_text(study))
    return lines


def horizon_text(study):
    """A line on how far any double-precision answer reaches."""
    a = study.attrs
    worst, middle = a["horizon_p01"], a["horizon_median"]
    grown = f"a disturbance along the way grows {a['growth_median']:.0e} times by {a['t_end']:g} s in the middle, {a['growth_p99']:.0e} in the worst 1 %"
    if a["chaotic_share"] > 0.005:
        why = (
            f"{100 * a['chaotic_share']:.0f} % of the members exponentially (chaos or a separatrix)"
        )
        return f"{grown}, {why}: rounding alone makes 1 % of them meaningless beyond t = {worst:.3g} s, half of them beyond {middle:.3g} s"
    return f"{grown}, nowhere exponentially: no horizon within 1e{math.floor(math.log10(max(worst, 1e-300)))} s"


def long_drift(scene, integrators=None, steps=1_000_000, dt=None, members=64, progress=None):
    """Drift of energy, |L|^2 and L_z over very many steps: a Dataset over `integrator` and `step` (powers of two up to `steps`).

    scene : Scene;  integrators : names, default LONG of those that take it;  dt : step [s], default the scene's
    members : the first of the scene

    Variables: energy_drift, l2_drift, lz_drift, largest so far of the worst member, of the sizes in play; and energy_law, l2_law, lz_law,
    the law by which each grows: "bounded", "sqrt" or "linear" in the number of steps, with the exponent of the fit in energy_power, ...
    Raises SceneError as `accuracy`.
    """
    names = list(integrators or [name for name in LONG if name in accepting(scene.effects)])
    for name in names:
        if name not in INTEGRATORS:
            raise unknown("", "integrators", name, "integrator", INTEGRATORS, OptionError)
        if why := refusal(name, scene.effects):
            raise OptionError("", "integrators", name, why)
    dt, steps, members = (
        seconds(dt or scene.run.dt, "dt"),
        counted(steps, "steps"),
        counted(members, "members"),
    )
    at = np.unique(np.append(2 ** np.arange(4, int(math.log2(steps)) + 1), steps))
    found = pilot(scene.with_run(t_end=dt * steps, every=None), members)
    check_pilot(scene, found)
    drifts = {}
    for name in names:
        drifts[name] = drift_along(found, name, steps, at, dt)
        if progress:
            progress(
                f"{name:9s} energy {drifts[name]['energy'][-1]:.1e}, |L|^2 {drifts[name]['l2'][-1]:.1e}, L_z {drifts[name]['lz'][-1]:.1e}"
            )
    variables: dict = {}
    for quantity in ("energy", "l2", "lz"):
        values = np.array([drifts[name][quantity] for name in names])
        fits = [growth_law(at, row) for row in values]
        variables[f"{quantity}_drift"] = (
            ("integrator", "step"),
            values,
            {"units": "1", "long_name": f"largest drift so far: {_WHAT[quantity]}"},
        )
        variables[f"{quantity}_law"] = (
            "integrator",
            np.array([law for law, _ in fits], dtype=object),
        )
        variables[f"{quantity}_power"] = ("integrator", np.array([power for _, power in fits]))
    kept = conservation(scene)
    attrs: dict[str, Any] = {
        "title": scene.title,
        "scene": scene.dumps(),
        "dt": dt,
        "members": found.members,
        "lz_conserved": kept["lz"] if found.carried else "no: no attitude",
    }
    attrs |= {
        f"{name}_conserved": "yes" if kept[name] == "yes" else kept[name]
        for name in ("energy", "l2")
    }
    return xr.Dataset(variables, {"integrator": np.array(names, dtype=object), "step": at}, attrs)


def growth_law(steps, drift):
    """(law, power): drift ~ steps^power, fitted over the later half of the decades; "bounded" below 0.2, "sqrt" to 0.75, else "linear".

    What stays below 20 roundings is "bounded" whatever its fit.
    """
    later = steps >= np.sqrt(steps[0] * steps[-1])
    values = np.maximum(drift[later], ROUNDING)
    if not np.isfinite(values).all():
        return "failed", math.nan
    power = float(np.polyfit(np.log(steps[later]), np.log(values), 1)[0])
    if power < 0.2 or drift[-1] < 20 * ROUNDING:
        return "bounded", power
    return ("sqrt" if power < 0.75 else "linear" if power < 1.5 else "faster than linear"), power


def long_table(study):
    """Lines of text: drift at the end and the law of growth, for each integrator and each quantity that the scene keeps."""
    lines = [
        f"drift over {study.step.values[-1]:,} steps of {study.attrs['dt']:.6g} s, worst of {study.attrs['members']} members"
    ]
    words = {"energy": "energy", "l2": "|L|^2", "lz": "L_z"}
    for i, name in enumerate(study.integrator.values):
        parts = [
            f"{word} {study[f'{key}_drift'].values[i, -1]:.1e} ({study[f'{key}_law'].values[i]}, power {study[f'{key}_power'].values[i]:.2f})"
            for key, word in words.items()
            if study.attrs[f"{key}_conserved"] == "yes"
        ]
        lines.append(f"{name:10s} {'; '.join(parts)}")
    return lines


def count(number):
    """Two digits of a large number for people."""
    for size, word in ((1e6, " M"), (1e3, " k")):
        if number >= size:
            return (
                f"{number / size:.2g}{word}"
                if number < 99.5 * size
                else f"{number / size:.0f}{word}"
            )
    return f"{number:.2g}"
