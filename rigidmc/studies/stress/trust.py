"""How far a scene can be trusted: checks of its own members that need no truth, and a verdict."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.planning.plan import Plan
from rigidmc.planning.tolerance.choose import check_quiet, choose_integrator
from rigidmc.planning.tolerance.deviation import growth
from rigidmc.planning.tolerance.pilot import Pilot
from rigidmc.progress import reporter
from rigidmc.runs.prepare import prepared
from rigidmc.scene.scene import Scene
from rigidmc.studies.stress.checks import Check, Runs, pilot_of, steps_of
from rigidmc.version import VERSION

MEMBERS, FEW = 64, 32  # members checked, and with `quick`
LEFT = 1e-2  # error at which two digits are left: beyond it nothing is a result


def trust(
    scene: Scene,
    quick: bool = False,
    progress: bool | Callable[[int, int], object] = False,
) -> xr.Dataset:
    """Put a scene through the generic checks: a Dataset over `check` and `time`.

    scene : with the integrator and step to be judged;  quick : fewer members
    progress : as of `rigidmc.simulate`

    Checks of accuracy: half the step, another integrator at a short step, the closed form if there
    is one, there and back. Checks of rounding compute the same motion with other numbers: other
    units, permuted axes, space rotated about the vertical.
    Variables: error (of the worst member) and error_median, the larger of momentum [of its size]
    and attitude [rad]; `tells` over check. Attributes: verdict, digits (that all members keep to
    t_end), horizon [s] (beyond which fewer than two are left), chaotic_share, flagged.
    Raises SceneError for a scene that cannot be run.
    """
    check_quiet(scene)
    scene, _ = choose_integrator(scene)
    plan = prepared(scene).plan
    first = pilot_of(scene, FEW if quick else MEMBERS)
    with reporter(progress, 9, 1) as report:
        runs = Runs(first, scene.run.integrator, steps_of(first, plan), report)
        checks = list(runs.checks())
    factor, rate = growth(pilot_of(scene, min(first.members, FEW)))
    return _dataset(scene, plan, first, checks, runs.states.status != 0, factor, rate)


def _dataset(
    scene: Scene,
    plan: Plan,
    pilot: Pilot,
    checks: list[Check],
    flagged: NDArray[np.bool_],
    factor: NDArray[np.float64],
    rate: NDArray[np.float64],
) -> xr.Dataset:
    """The Dataset of a study; factor, rate : growth of a disturbance, see `pilot.growth`."""
    shown = flagged if flagged.all() else ~flagged
    worst = np.array([check.error[:, shown].max(1) for check in checks])
    median = np.array([np.median(check.error[:, shown], axis=1) for check in checks])
    over = ("check", "time")
    variables = {
        "error": (over, worst, {"units": "1", "long_name": "error of the worst member"}),
        "error_median": (over, median, {"units": "1"}),
        "tells": ("check", np.array([check.tells for check in checks], dtype=object)),
    }
    coordinates = {
        "check": np.array([check.name for check in checks], dtype=object),
        "time": ("time", pilot.times, {"units": "s"}),
    }
    attrs = {
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "scene": scene.dumps(),
        "integrator": scene.run.integrator,
        "step": f"turn = {scene.run.turn:g} rad"
        if plan.has_member_steps
        else f"dt = {plan.grid.dt:.6g} s",
        "members": pilot.members,
        "flagged": int(flagged.sum()),
        "chaotic_share": float(np.mean(rate > 0.0)),
        "growth": float(np.median(factor)),
    }
    study = xr.Dataset(variables, coordinates, attrs)
    return study.assign_attrs(_verdict(study))


def _verdict(study: xr.Dataset) -> dict[str, Any]:
    """{verdict, digits, horizon} in words and numbers."""
    tells, t = study.tells.values, study.time.values
    rounding = np.zeros(len(t))
    if (tells == "rounding").any():
        rounding = study.error.values[tells == "rounding"].max(0)
    error = np.maximum(study.error.values[tells == "accuracy"].max(0), rounding)
    beyond = np.flatnonzero(error > LEFT)
    if not beyond.size:
        digits = _digits(error[-1])
        words = f"trust {digits} digits to t = {t[-1]:.4g} s"
        return {"verdict": words, "digits": digits, "horizon": float(t[-1])}
    chaos = study.attrs["chaotic_share"] > 0.0 and rounding[-1] > 1e-3 * min(error[-1], 1.0)
    why = "chaos" if chaos else "the step is too long for this: take a shorter one, or --tolerance"
    if beyond[0] == 0:
        words = f"trust nothing: fewer than two digits are left at t = {t[0]:.4g} s; {why}"
        return {"verdict": words, "digits": 0, "horizon": 0.0}
    horizon = float(t[beyond[0] - 1])
    # the most digits that last for a good part of the horizon
    lasting = [
        (digits, t[np.flatnonzero(error > 10.0**-digits)[0] - 1])
        for digits in (9, 6, 4, 3, 2)
        if error[0] <= 10.0**-digits
    ]
    digits, end = next((d, end) for d, end in lasting if end >= 0.4 * horizon or d == 2)
    more = "" if digits == 2 else f", 2 digits to t = {horizon:.4g} s"
    words = f"trust {digits} digits to t = {end:.4g} s{more}; beyond, {why}"
    return {"verdict": words, "digits": 0, "horizon": horizon}


def _digits(error: float) -> int:
    """The digits that an error leaves, at most 15."""
    if not math.isfinite(error):
        return 0
    return 15 if error < 1e-15 else max(0, math.floor(-math.log10(error) + 1e-9))


def table(study: xr.Dataset) -> list[str]:
    """Lines of text: each check at a quarter, half and the whole of the time, and the verdict."""
    a, t = study.attrs, study.time.values
    at = [len(t) // 4 - 1, len(t) // 2 - 1, len(t) - 1]
    members = f"{a['members']} member{'s' * (a['members'] > 1)}"
    lines = [
        f"{a['title']}: {a['integrator']}, {a['step']}, {members}; worst of them (median) at t =",
        f"{'':32s}" + "".join(f"{f'{t[i]:.4g} s':>22s}" for i in at),
    ]
    for name, worst, median in zip(
        study.check.values, study.error.values, study.error_median.values, strict=True
    ):
        cells = [f"{worst[i]:.1e} ({median[i]:.1e})" for i in at]
        lines.append(f"{name:32s}" + "".join(f"{cell:>22s}" for cell in cells))
    if a["flagged"]:
        lines.append(f"{a['flagged']} of {a['members']} members turn non-finite and are left out")
    if a["chaotic_share"] > 0.0:
        share = f"{100 * a['chaotic_share']:.0f} % of the members"
        words = "errors grew faster than a power of time (chaos, or a separatrix nearby)"
        lines.append(f"in {share} {words}")
    return [*lines, f"verdict: {a['verdict']}"]


def failed(study: xr.Dataset) -> bool:
    """Whether members fail, or no digit is left although the motion is not chaotic."""
    a = study.attrs
    return bool(a["flagged"]) or (a["digits"] == 0 and "chaos" not in a["verdict"])
