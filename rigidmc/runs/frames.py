"""Recompute one member of a result at the times that an animation needs."""

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.physics.effects.protocol import is_random
from rigidmc.planning.steps import make_time_grid
from rigidmc.runs.rerun import chosen_members, rerun
from rigidmc.runs.simulate import simulate
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.scene.settings import Run

SAVE = ("attitude", "momentum")


def frames(
    result: xr.Dataset,
    member: int,
    count: int,
    allow_code: bool = False,
    until: float | None = None,
) -> xr.Dataset:
    """Recompute a member, with attitude and momentum at `count` + 1 times from 0 to `until`.

    The times are evenly spaced to half a step. Where the run makes fewer steps, the member makes
    shorter ones here, because a line from step to step would show a motion that no body makes. With
    noise, only the steps of the run are possible, because other steps draw other noise.

    until : [s]; default the end of the run
    The attribute `frames` states whether the steps equal the steps of the run. OptionError for a
    member that the result lacks, and for a time beyond the end of the run.
    """
    scene = scene_of(result, allow_code=allow_code)
    run, end = scene.run, scene.run.t_end
    chosen_members(member, run, result, result.encoding.get("source", "the result"))
    if until is not None and until > end * (1.0 + 1e-9):
        raise OptionError(f"the run ends at {end:g} s", at="until", value=until)
    step = _own_step(run, result, member)
    to_end = until is None or until >= end
    if to_end and run.turn is None and step is not None and step * count <= end:
        if not make_time_grid(end, step, run.every).is_shortened:
            return _thinned(result, member, count, allow_code, run)
        if any(map(is_random, scene.effects)):  # only saves of the run end its own steps
            again = rerun(result, member, save=SAVE, allow_code=allow_code, wrt=())
            again.attrs["frames"] = "steps as in the run, at its saves"
            return again
    return integrate_member(scene, member, count, end if to_end or until is None else until, step)


def integrate_member(
    scene: Scene, member: int, count: int, end: float, step: float | None
) -> xr.Dataset:
    """Integrate a member, with attitude and momentum at `count` + 1 times from 0 to `end`.

    step : of the run [s], used if it is short enough; None if the step is free
    """
    if step is not None and any(map(is_random, scene.effects)):
        count = max(1, min(count, round(end / step)))
    every, dt = end / count, step
    if dt is None or dt > every * 1.5:
        dt = every
    settings = {
        "dt": every / max(1, round(every / dt)),
        "t_end": end,
        "every": every,
        "turn": None,
        "save": SAVE,
        "wrt": (),
        "keep": "full",
        "first": member,
        "members": 1,
    }
    again = simulate(scene.with_run(**settings))
    same = step is None or abs(again.attrs["dt"] / step - 1.0) < 1e-9
    words = "steps as in the run"
    if not same:
        words = f"steps of {again.attrs['dt']:.4g} s instead of {step:.4g} s"
    again.attrs["frames"] = words
    return again


def _own_step(run: Run, result: xr.Dataset, member: int) -> float | None:
    """Return the step of a member [s], or None for closed forms, which have no steps."""
    if run.integrator == "closed":
        return None
    if run.turn is None:
        return run.dt
    return float(run.t_end / result.steps.sel(member=member))


def _thinned(result: xr.Dataset, member: int, count: int, allow_code: bool, run: Run) -> xr.Dataset:
    """Recompute a member with the steps of the run, to the same bits, at about `count` + 1
    times."""
    steps = max(1, round(run.t_end / run.dt))
    between = max(1, steps // count)
    while steps % between:  # saves are evenly spaced to the end
        between -= 1
    every = run.t_end / (steps // between)
    again = rerun(result, member, every=every, save=SAVE, allow_code=allow_code, wrt=())
    nearest = np.unique(np.rint(np.linspace(0, again.sizes["time"] - 1, count + 1)).astype(int))
    again = again.isel(time=nearest)
    again.attrs["frames"] = "steps as in the run"
    return again
