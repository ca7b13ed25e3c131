"""One member of a result again, to the same bits, with more saved."""

import os
import warnings

import numpy as np

from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.observables import OBSERVABLES, outputs
from rigidmc.observables.keep import summaries
from rigidmc.planning.plan import prepare
from rigidmc.runs.gather import open_run
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted, seconds
from rigidmc.scene.file import scene_of
from rigidmc.storage.reader import open_result
from rigidmc.storage.writer import encoded

# variables of a member that the steps and saves decide; every other variable without times is part of its start
FOUND = ("energy_drift_max", "l2_drift_max", "status", "status_step", "status_time", "steps")


def rerun(
    source, member, every=None, save=None, allow_code=False, output=None, force=False, **options
):
    """Integrate a member of a result once more: a Dataset like that of `rigidmc.simulate`, equal to it where both have saves.

    source : a result: a file (.nc), a run directory or a Dataset
    member : its index, or a range of indices
    every : time between saves [s]; default that of the result. If it is no whole number of steps, the nearest whole number is
        taken, and a SceneWarning tells that time. The steps of members with steps of their own (`turn`) depend on `every`, so there
        it cannot change
    save : names of observables; default all, work only where the result has booked it
    output : write this netCDF file too; `force` replaces one that is there
    allow_code, options : as of `rigidmc.Scene.load` and `rigidmc.simulate`

    The attribute `rerun` tells at how many times both were compared. Raises OptionError for a member that the result does not have
    and for an `every` that would change the steps; warns (SceneWarning) if a value differs, as it may with another version of rigidmc or of a library.
    """
    if output is not None:
        refuse_existing(os.fspath(output), force)
    if not hasattr(source, "data_vars"):
        path = os.fspath(source)
        with open_run(path, allow_code) if os.path.isdir(path) else open_result(path) as result:
            return rerun(result, member, every, save, allow_code, output, force, **options)
    scene = scene_of(source, allow_code=allow_code)
    called = source.encoding.get("source", "the result")
    wanted = (
        member
        if isinstance(member, range)
        else range(counted(member, "member", 0), counted(member, "member", 0) + 1)
    )
    run = scene.run
    known = range(run.first, run.first + run.members)
    if not wanted or wanted.step != 1 or wanted[0] not in known or wanted[-1] not in known:
        raise OptionError(
            "", "member", member, f"{called} has the members {known[0]} to {known[-1]}"
        )
    if not np.isin(wanted, source.member.values).all():
        rule = f"{called} has only {source.sizes['member']:,} of its {run.members:,} members, and not this one"
        raise OptionError("", "member", member, rule)
    asked = run.every if every is None else _whole_steps(run, seconds(every, "every", "run"))
    names = _everything(scene) if save is None else tuple(save)
    booked = ("work",) * (
        "work" in run.save and "work" not in names
    )  # without it energy_drift would be another quantity
    # of a selection only its own members have rows
    scene = scene.with_run(
        every=asked, save=(*names, *booked), keep="full", first=wanted[0], members=len(wanted)
    )
    if run.turn is not None and asked != run.every:
        raise SceneError(
            "run",
            "every",
            every,
            f"members have steps of their own in each {run.every} s: another time between saves changes them",
        )
    own = run.turn is not None or run.integrator == "closed"
    if not own and asked is not None and abs(prepare(scene).dt / run.dt - 1.0) > 1e-9:
        rule = f"saves {asked / run.dt:.0f} steps of {run.dt:.10g} s apart do not fit t_end = {run.t_end:g} s without another step"
        raise SceneError("run", "every", every, rule)
    made = simulate(scene, members=wanted, **options)
    made.attrs["rerun"] = _compared(made, source.sel(member=list(wanted)), called)
    if output is not None:
        write_bytes(os.fspath(output), encoded(made), force)
    return made


def _whole_steps(run, every):
    """The time of the whole number of steps that is nearest to `every` [s]; a SceneWarning if the two differ."""
    if run.turn is not None or run.integrator == "closed" or every >= run.t_end:
        return every
    steps, count = max(1, round(run.t_end / run.dt)), max(1, round(every / run.dt))
    found = run.t_end * count / steps
    if abs(every / found - 1.0) < 1e-9:
        return every
    note = f"every = {every:.10g} s is no whole number of steps of {run.dt:.10g} s: saves are {found:.10g} s apart, {count:,} steps"
    warnings.warn(note, SceneWarning, stacklevel=3)
    return found


def frames(source, member, count, allow_code=False):
    """A member of a Dataset again with attitude and momentum at `count` + 1 times or as many steps as there are, evenly spaced to half a step, as
    an animation needs them."""
    run = scene_of(source, allow_code=allow_code).run
    steps = max(1, round(run.t_end / run.dt)) if run.turn is None else 0
    if (
        run.turn is not None
    ):  # members have steps of their own between saves: those are all there is
        return rerun(source, member, save=("attitude", "momentum"), allow_code=allow_code)
    between = max(1, steps // count)
    while steps % between:  # saves are evenly spaced to the end
        between -= 1
    made = rerun(
        source,
        member,
        every=run.t_end / (steps // between),
        save=("attitude", "momentum"),
        allow_code=allow_code,
    )
    nearest = np.unique(np.rint(np.linspace(0, made.sizes["time"] - 1, count + 1)).astype(int))
    return made.isel(time=nearest)


def _everything(scene):
    """Names of all observables at save times, of work only where the scene books it, and of those over all steps that the scene has."""
    over = (name for name in (*scene.run.save, *summaries(scene.kept())) if name not in OBSERVABLES)
    return (*(name for name in OBSERVABLES if name != "work" or "work" in scene.run.save), *over)


def _compared(made, result, source):
    """In words, at how many times the saves of both are equal to the bit; warns where they are not."""
    scene = scene_of(result, allow_code=None)
    digits, times, names, apart = scene.run.digits, np.empty(0), [], dict[str, float]()
    for name, one, two, saves in _pairs(made, result, scene):
        names += [name] if saves is not None else []
        saves = np.empty(0) if saves is None else saves
        times = np.union1d(times, saves)
        rounded = digits is not None and saves.size and not name.endswith("_final")
        if not np.array_equal(one, two, equal_nan=True) and not (
            rounded and np.allclose(one, two, 10.0 ** -(digits or 0), 0.0, True)
        ):
            apart[name] = float(np.nanmax(np.abs(one - two)))
    if apart:
        worst = ", ".join(f"{name} by {off:.1e}" for name, off in apart.items())
        warnings.warn(
            f"differs from {source}: {worst}; another version rounds otherwise",
            SceneWarning,
            stacklevel=3,
        )
        return f"differs: {worst}"
    if not names:
        return "compared with nothing: no save of both is the same quantity at the same time"
    how = (
        "to the bit"
        if digits is None or not times.size
        else f"to the {digits} digits that were kept"
    )
    return f"equal {how}{f' at {times.size:,} times' * bool(times.size)} in {', '.join(names)}"


def _pairs(made, result, scene):
    """(name, values, values, times) of each variable that both results have; times is None for what members start from."""
    over = (
        {name for label, one in scene.watched() for name in outputs(label, one)}
        if made.sizes["time"]
        else set()
    )
    for name in made.data_vars:
        dims = made[name].dims
        if "member" not in dims:  # of the ensemble as a whole
            continue
        if "time" not in dims and name not in (*over, *FOUND) and name in result:
            yield name, made[name].values, _values(result[name], dims), None
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
            yield (
                f"{name}_final",
                last.values,
                _values(result[f"{name}_final"], last.dims),
                made.time.values[-1:],
            )


def _values(variable, dims):
    return np.asarray(variable.transpose(*dims).values)
