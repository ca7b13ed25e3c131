"""Drift of constants of the motion over very many steps, and its growth law."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.amounts import read_count, read_seconds
from rigidmc.physics.integrators import integrators_for, refusal
from rigidmc.planning.tolerance.choose import check_pilot
from rigidmc.planning.tolerance.deviation import drift_along
from rigidmc.planning.tolerance.pilot import ROUNDING, pilot
from rigidmc.results.labels import count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.recording import conservation
from rigidmc.scene.scene import Scene
from rigidmc.studies.accuracy.work_precision import WORDS

SYMBOLS = {"energy": "energy", "l2": "|L|^2", "lz": "L_z"}


def long_drift(
    scene: Scene,
    integrators: Sequence[Any] | None = None,
    steps: int = 1_000_000,
    dt: float | None = None,
    members: int = 64,
    say: Callable[[str], object] = lambda line: None,
) -> xr.Dataset:
    """Measure the drift of energy, |L|^2 and L_z over very many steps; return a Dataset over
    `integrator` and `step`.

    integrators : names or integrators; by default one of each kind (`drifts_like`) that fits
    dt : step [s], by default the scene's;  members : number of members, from the scene's first on
    `step` : powers of two up to `steps`

    Variables: energy_drift, l2_drift, lz_drift, the largest drift so far of the worst member,
    relative to the scale of each quantity; energy_law, l2_law, lz_law, its growth law in the number
    of steps ("bounded", "sqrt" or "linear"); and energy_power, ..., the fitted exponent.
    Raises SceneError as `accuracy`.
    """
    scene, given = scene.with_integrators(integrators or ())
    known = scene.known_integrators()
    names = given or one_of_each_kind(scene)
    for name in names:
        if name not in known:
            raise unknown("integrator", known, at="integrators", value=name, error=OptionError)
        if why := refusal(name, scene.effects, known=known):
            raise OptionError(why, at="integrators", value=name)
    dt = read_seconds(dt or scene.run.dt, "dt")
    steps, members = read_count(steps, "steps"), read_count(members, "members")
    refuse_count(members, "members of a pilot", 8 * layout.EFFECTS)
    at = np.unique(np.append(2 ** np.arange(4, int(math.log2(steps)) + 1), steps))
    first = pilot(scene.with_run(t_end=dt * steps, every=None), members)
    check_pilot(scene, first)
    drifts = {}
    for name in names:
        drifts[name] = drift_along(first, name, steps, at, dt)
        ends = [f"{s} {drifts[name][key][-1]:.1e}" for key, s in SYMBOLS.items()]
        say(f"{name:9s} {', '.join(ends)}")
    variables: dict[str, Any] = {}
    for key in SYMBOLS:
        values = np.array([drifts[name][key] for name in names])
        laws, powers = zip(*(growth_law(at, row) for row in values), strict=True)
        attrs = {"units": "1", "long_name": f"largest drift so far: {WORDS[key]}"}
        variables[f"{key}_drift"] = ("integrator", "step"), values, attrs
        variables[f"{key}_law"] = "integrator", np.array(laws, dtype=object)
        variables[f"{key}_power"] = "integrator", np.array(powers)
    conserved = conservation(scene.effects, "work" in scene.run.save)
    facts = {
        "title": scene.title,
        "scene": scene.dumps(),
        "dt": dt,
        "members": first.members,
        "lz_conserved": conserved["lz"] if first.has_attitude else "no: no attitude",
        "energy_conserved": conserved["energy"],
        "l2_conserved": conserved["l2"],
    }
    return xr.Dataset(variables, {"integrator": np.array(names, dtype=object), "step": at}, facts)


def one_of_each_kind(scene: Scene) -> list[str]:
    """Return the integrators that accept a scene and do not drift like another one."""
    known = scene.known_integrators()
    able = integrators_for(scene.effects, integrators=known)
    return [name for name in able if name != "closed" and not known[name].drifts_like]


def growth_law(steps: NDArray[np.int_], drift: NDArray[np.float64]) -> tuple[str, float]:
    """Return (law, power): drift ~ steps^power, fitted over the later half of the decades.

    The law is "bounded" for a power below 0.2 or a drift below 20 roundings, "sqrt" below 0.75,
    "linear" below 1.5, else "faster than linear"; "failed" if the drift is not finite.
    """
    later = steps >= np.sqrt(steps[0] * steps[-1])
    values = np.maximum(drift[later], ROUNDING)
    if not np.isfinite(values).all():
        return "failed", math.nan
    power = float(np.polyfit(np.log(steps[later]), np.log(values), 1)[0])
    if power < 0.2 or drift[-1] < 20 * ROUNDING:
        return "bounded", power
    return ("sqrt" if power < 0.75 else "linear" if power < 1.5 else "faster than linear"), power


def long_table(study: xr.Dataset) -> list[str]:
    """Return lines of text: final drift and growth law, by integrator and conserved quantity."""
    a = study.attrs
    steps = f"{study.step.values[-1]:,} steps of {a['dt']:.6g} s"
    lines = [f"drift over {steps}, worst of {count_text(a['members'], 'member')}"]
    for i, name in enumerate(study.integrator.values):
        parts = []
        for key, symbol in SYMBOLS.items():
            if a[f"{key}_conserved"] == "yes":
                law = (
                    f"{study[f'{key}_law'].values[i]}, power {study[f'{key}_power'].values[i]:.2f}"
                )
                parts.append(f"{symbol} {study[f'{key}_drift'].values[i, -1]:.1e} ({law})")
        lines.append(f"{name:10s} {'; '.join(parts)}")
    return lines
