"""One member of a result again, to the same bits, with more saved."""

import os
import warnings

import numpy as np

import rigidmc
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.observables import OBSERVABLES, outputs
from rigidmc.planning import prepare
from rigidmc.retention import summaries
from rigidmc.simulation import simulate
from rigidmc.storage import refuse_existing, scene_of, write


def rerun(source, member, every=None, save=None, allow_code=False, output=None, force=False, **options):
    """Integrate a member of a result once more: a Dataset like that of `rigidmc.simulate`, equal to it where both have saves.

    source : a result: a file (.nc), a run directory or a Dataset
    member : its index, or a range of indices
    every : time between saves [s], a whole number of steps; default that of the result. A member's bits are those of its steps: with steps of its
        own (`turn`) these follow `every`, which has to stay
    save : names of observables; default all but work, which the result may not have booked
    output : write this netCDF file too; `force` replaces one that is there
    allow_code, options : as of `rigidmc.Scene.load` and `rigidmc.simulate`

    The attribute `rerun` tells at how many times it was compared. Raises SceneError for a member that the result has not and an `every` between
    steps; a SceneWarning where a value differs, as it may on another type of processor or with another version.
    """
    if output is not None:
        refuse_existing(os.fspath(output), force)
    if not hasattr(source, "data_vars"):
        with rigidmc.open(os.fspath(source), allow_code) as result:
            return rerun(result, member, every, save, allow_code, output, force, **options)
    scene = scene_of(source, allow_code=allow_code)
    called = source.encoding.get("source", "the result")
    if not isinstance(member, range) and (isinstance(member, bool) or not isinstance(member, (int, np.integer))):
        raise SceneError("", "member", member, "expected the index of a member, or a range of them")
    wanted = member if isinstance(member, range) else range(member, member + 1)
    run = scene.run
    known = range(run.first, run.first + run.members)
    if not wanted or wanted.step != 1 or wanted[0] not in known or wanted[-1] not in known:
        raise SceneError("", "member", member, f"{called} has the members {known[0]} to {known[-1]}")
    if not np.isin(wanted, source.member.values).all():
        rule = f"{called} has only {source.sizes['member']:,} of its {run.members:,} members, and not this one"
        raise SceneError("", "member", member, rule)
    asked = run.every if every is None else every
    scene = scene.with_run(every=asked, save=_everything(scene) if save is None else tuple(save), keep="full")
    if run.turn is not None and asked != run.every:
        raise SceneError(
            "run", "every", every, f"members have steps of their own in each {run.every} s: another time between saves changes them"
        )
    if run.turn is None and run.integrator != "closed" and asked is not None:
        steps = asked / run.dt
        if abs(steps - round(steps)) > 1e-9 * steps or round(steps) < 1 or abs(prepare(scene).dt / run.dt - 1.0) > 1e-9:
            rule = f"has to be a whole number of steps of {run.dt:.10g} s and to divide t_end = {run.t_end:g} s"
            raise SceneError("run", "every", every, rule)
    made = simulate(scene, members=wanted, **options)
    made.attrs["rerun"] = _compared(made, source.sel(member=list(wanted)), called)
    if output is not None:
        write(made, os.fspath(output), force)
    return made


def frames(source, member, count, allow_code=False):
    """A member of a Dataset again with attitude and momentum at `count` + 1 times or as many steps as there are, evenly spaced to half a step, as
    an animation needs them."""
    run = scene_of(source, allow_code=allow_code).run
    steps = max(1, round(run.t_end / run.dt)) if run.turn is None else 0
    if run.turn is not None:  # members have steps of their own between saves: those are all there is
        return rerun(source, member, save=("attitude", "momentum"), allow_code=allow_code)
    between = max(1, steps // count)
    while steps % between:  # saves are evenly spaced to the end
        between -= 1
    made = rerun(source, member, every=run.t_end / (steps // between), save=("attitude", "momentum"), allow_code=allow_code)
    nearest = np.unique(np.rint(np.linspace(0, made.sizes["time"] - 1, count + 1)).astype(int))
    return made.isel(time=nearest)


def _everything(scene):
    """Names of all observables at save times but work, and of those over all steps that the scene has."""
    over = (name for name in (*scene.run.save, *summaries(scene.kept())) if name not in OBSERVABLES)
    return (*(name for name in OBSERVABLES if name != "work"), *over)


def _compared(made, result, source):
    """In words, at how many times the saves of both are equal to the bit; warns where they are not."""
    scene = scene_of(result, allow_code=None)
    digits, times, names, apart = scene.run.digits, np.empty(0), [], dict[str, float]()
    for name, one, two, saves in _pairs(made, result, scene):
        names.append(name)
        times = np.union1d(times, saves)
        rounded = digits is not None and saves.size and not name.endswith("_final")
        if not np.array_equal(one, two, equal_nan=True) and not (rounded and np.allclose(one, two, 10.0**-digits, 0.0, True)):
            apart[name] = float(np.nanmax(np.abs(one - two)))
    if apart:
        worst = ", ".join(f"{name} by {off:.1e}" for name, off in apart.items())
        warnings.warn(f"differs from {source}: {worst}; another processor or version rounds otherwise", SceneWarning, stacklevel=3)
        return f"differs: {worst}"
    if not names:
        return "compared with nothing: no save of both is the same quantity at the same time"
    how = "to the bit" if digits is None or not times.size else f"to the {digits} digits that were kept"
    return f"equal {how}{f' at {times.size:,} times' * bool(times.size)} in {', '.join(names)}"


def _pairs(made, result, scene):
    """(name, values, values, their times) of what both results have."""
    over = {name for label, one in scene.watched() for name in outputs(label, one)} if made.sizes["time"] else set()
    for name in made.data_vars:
        dims = made[name].dims
        if "member" not in dims:  # of the ensemble as a whole
            continue
        if name in over and name in result:
            yield name, made[name].values, _values(result[name], dims), np.empty(0)
        for kept, clock in ((name, "time"), (f"{name}_thinned", "thinned_time")):
            if "time" in dims and kept in result:
                times = np.intersect1d(made.time.values, result[clock].values)
                theirs = result[kept].sel({clock: times})
                yield (
                    kept,
                    made[name].sel(time=times).values,
                    _values(theirs.rename({clock: "time"} if clock != "time" else {}), dims),
                    times,
                )
        if "time" in dims and f"{name}_final" in result:
            last = made[name].isel(time=-1)
            yield f"{name}_final", last.values, _values(result[f"{name}_final"], last.dims), made.time.values[-1:]


def _values(variable, dims):
    return np.asarray(variable.transpose(*dims).values)
