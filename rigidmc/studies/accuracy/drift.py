"""Drift of constants of the motion over very many steps, and its growth law."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel import layout
from rigidmc.inputs.amounts import read_count, read_seconds
from rigidmc.inputs.arrays import Array
from rigidmc.physics.integrators import integrators_for
from rigidmc.planning.tolerance.choose import check_pilot
from rigidmc.planning.tolerance.deviation import drift_along
from rigidmc.planning.tolerance.pilot import ROUNDING, pilot
from rigidmc.results.labels import count_text
from rigidmc.runs.resources import refuse_count
from rigidmc.scene.recording import conservation
from rigidmc.scene.scene import Scene
from rigidmc.studies.accuracy.work_precision import WORDS, with_tried
from rigidmc.studies.framework.variables import StudyVariable, describe, make_dataset

SYMBOLS = {"energy": "energy", "l2": "|L|^2", "lz": "L_z"}
DRIFTS = tuple(
    variable
    for key in SYMBOLS
    for variable in (
        StudyVariable(
            f"{key}_drift", "integrator step", "1", f"largest drift so far: {WORDS[key]}",
            "of the worst member",
        ),
        StudyVariable(f"{key}_power", "integrator", "1", "fitted power of the steps"),
        StudyVariable(
            f"{key}_law", "integrator", "", "growth law in the number of steps",
            '"bounded", "sqrt" or "linear"',
        ),
    )
)  # fmt: skip


def long_drift(
    scene: Scene,
    integrators: Sequence[Any] | None = None,
    steps: int = 1_000_000,
    dt: float | None = None,
    members: int = 64,
    say: Callable[[str], object] = lambda line: None,
) -> xr.Dataset:
    """Measure the drift of energy, |L|^2 and L_z over very many steps, powers of two up to `steps`;
    return a Dataset of DRIFTS.

    integrators : names or integrators; by default one of each kind (`drifts_like`) that fits
    dt : step [s], by default the scene's;  members : number of members, from the scene's first on
    Raises SceneError as `accuracy`.
    """
    scene, names = with_tried(scene, integrators or ())
    names = names or one_of_each_kind(scene)
    dt = read_seconds(dt or scene.run.dt, "dt")
    steps, members = read_count(steps, "steps"), read_count(members, "members")
    refuse_count(members, "members of a pilot", 8 * layout.EFFECTS)
    at = np.unique(np.append(2 ** np.arange(4, int(math.log2(steps)) + 1), steps))
    first = pilot(scene.with_run(t_end=dt * steps, every=None), members)
    check_pilot(first)
    drifts = {}
    for name in names:
        drifts[name] = drift_along(first, name, steps, at, dt)
        ends = [f"{s} {drifts[name][key][-1]:.1e}" for key, s in SYMBOLS.items()]
        say(f"{name:9s} {', '.join(ends)}")
    values: dict[str, Any] = {}
    for key in SYMBOLS:
        rows = np.array([drifts[name][key] for name in names])
        laws, powers = zip(*(growth_law(at, row) for row in rows), strict=True)
        values[f"{key}_drift"], values[f"{key}_power"] = rows, np.array(powers)
        values[f"{key}_law"] = np.array(laws, dtype=object)
    conserved = conservation(scene.effects, "work" in scene.run.save)
    attrs = {
        "dt": dt,
        "members": first.members,
        "lz_conserved": conserved["lz"] if first.has_attitude else "no: no attitude",
        "energy_conserved": conserved["energy"],
        "l2_conserved": conserved["l2"],
    }
    coordinates = {"integrator": np.array(names, dtype=object), "step": at}
    return describe(make_dataset(DRIFTS, values, coordinates, attrs), scene)


def one_of_each_kind(scene: Scene) -> list[str]:
    """Return the integrators that accept a scene and do not drift like another one."""
    by_name = scene.known_integrators()
    able = integrators_for(scene.effects, integrators=by_name)
    return [name for name in able if name != "closed" and not by_name[name].drifts_like]


def growth_law(steps: NDArray[np.int_], drift: Array) -> tuple[str, float]:
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
    end = study.isel(step=-1)
    for i, name in enumerate(study.integrator.values):
        parts = [
            f"{symbol} {end[f'{key}_drift'].values[i]:.1e} ({end[f'{key}_law'].values[i]}, power"
            f" {end[f'{key}_power'].values[i]:.2f})"
            for key, symbol in SYMBOLS.items()
            if a[f"{key}_conserved"] == "yes"
        ]
        lines.append(f"{name:10s} {'; '.join(parts)}")
    return lines
