"""Checks whether a file is a result: variables, dimensions, types and units must be those that the scene in it demands."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from rigidmc.effects import labelled
from rigidmc.engine.layout import STATUSES
from rigidmc.errors import SceneError
from rigidmc.observables import OBSERVABLES
from rigidmc.scene.conservation import booked_labels
from rigidmc.storage.schema import (
    coordinates,
    ensemble_variables,
    flagged_variables,
    length,
    member_variables,
    saved_variables,
)

ROWS = (
    10_000_000  # a selection is spread out to a column of all indices if they are below this: 80 MB
)


def as_result(dataset, path):
    """Check an undecoded Dataset; returns it as results of its scene are laid out, and the names of variables that no such result
    has. SceneError if it is not a result."""

    def wrong(key, rule, value=None):
        return SceneError("", key, value, rule, file=path)

    scene = _scene_of(dataset, path)
    for name in ("member", "time"):
        if name not in dataset.variables or dataset.sizes.get(name, 0) < 1:
            raise wrong(name, "a result has at least one")
    plan, known, needed = _layout(scene, dataset)
    for name in needed:
        if name not in dataset.variables:
            raise wrong(name, "is missing, and every result of its scene has it")
    for name, (dims, dtype, attrs) in known.items():
        if name in dataset.variables:
            _refuse_unlike(dataset[name], dims, np.dtype(dtype), attrs, plan, wrong)
    own = coordinates(plan)
    for name, (dims, values, attrs) in own.items():
        if name in dataset.variables and values.dtype.kind != "U":
            _refuse_unlike(dataset[name], dims, values.dtype, attrs, plan, wrong)
    _refuse_members(dataset, scene, wrong)
    _refuse_attributes(dataset.attrs, scene, wrong)
    strange = [str(name) for name in dataset.variables if name not in known and name not in own]
    words = [name for name, (_, values, _) in own.items() if values.dtype.kind == "U"]
    found = dataset.drop_vars([*strange, *(name for name in words if name in dataset.variables)])
    found = found.assign_coords(
        {name: own[name] for name in words}
    )  # their values are known: no text is read from the file
    for name, variable in found.variables.items():
        attrs = own[name][2] if name in own else known[str(name)].attrs
        variable.attrs = {
            k: variable.attrs[k] for k in ("units", "significant_digits") if k in variable.attrs
        } | attrs
    return found, strange


def _scene_of(dataset, path):
    """The scene of a result, with the first of its rows, and with no code run."""
    from rigidmc.scene.file import loads

    def stored(name):
        return (
            np.asarray(dataset[name][..., :32].values)
            if name in dataset.variables and dataset[name].ndim in (1, 2)
            else None
        )

    try:
        return loads(dataset.attrs["scene"], path, stored=stored, allow_code=None)
    except SceneError as error:
        error.rule = f"of the scene in this result: {error.rule}"
        raise


def _layout(scene, dataset):
    """(a stand-in for the plan of a scene, {name: Variable} of all that its results may have, names they must have)."""
    bins = tuple(
        (f"{label}_bin", one.edges(), OBSERVABLES[one.name].units)
        for label, one in scene.histograms()
    )
    labels = booked_labels(scene)
    times = np.empty(dataset.sizes["time"])
    few = np.zeros(dataset.sizes.get("thinned_time", 0), int)
    plan: Any = SimpleNamespace(
        first=0,
        members=0,
        times=times,
        thinned=few,
        labels=labels,
        watch=SimpleNamespace(bins=bins),
    )
    always = member_variables(scene, False)
    known = {
        **always,
        **member_variables(scene, True),
        **saved_variables(scene),
        **ensemble_variables(scene),
        **flagged_variables(scene),
    }
    opaque = [
        (label, effect) for label, effect in labelled(scene.effects) if hasattr(effect, "stand_in")
    ]
    for name in {
        f"{label}_{field}" for label, effect in opaque for field in effect._fields
    } & known.keys():
        known[name] = known[name]._replace(
            attrs={"long_name": known[name].attrs["long_name"]}
        )  # only the code tells the units
    # only the code tells whether an effect has an energy; if none has, mass and centre may be missing
    return plan, known, [name for name in always if not (opaque and name in ("mass", "centre"))]


def _refuse_unlike(variable, dims, dtype, attrs, plan, wrong):
    """SceneError for a variable of other dimensions, another type or another unit than a scene demands, or one that is packed."""
    name = str(variable.name)
    if variable.dims != tuple(dims):
        raise wrong(
            name,
            f"has the dimensions {', '.join(map(str, variable.dims)) or 'none'}, expected {', '.join(dims)}",
        )
    for dim in dims:
        size = None if dim in ("member", "flagged") else length(dim, plan)
        if size is not None and variable.sizes[dim] != size:
            raise wrong(name, f"is {variable.sizes[dim]:,} long along {dim}, expected {size:,}")
    if variable.dtype.kind != dtype.kind:
        raise wrong(name, f"is of type {variable.dtype}, expected {dtype}")
    if packed := [word for word in ("scale_factor", "add_offset") if word in variable.attrs]:
        raise wrong(name, f"is packed, by {' and '.join(packed)}: results are not")
    units = variable.attrs.get("units", "")
    if not isinstance(units, str) or ("units" in attrs and units not in ("", attrs["units"])):
        raise wrong(name, f"is in units of {units!r}, expected {attrs.get('units', 'text')!r}")
    digits = variable.attrs.get("significant_digits", 1)
    if not isinstance(digits, (int, np.integer)) or not 1 <= digits <= 15:
        raise wrong(name, "expected 1 to 15 significant digits", value=str(digits))


def _refuse_members(dataset, scene, wrong):
    """SceneError for members that the scene does not have, times that do not ascend, and a status that there is none of."""
    run, members = scene.run, dataset.member.values
    if members.min() < run.first or members.max() >= run.first + run.members:
        raise wrong(
            "member", f"its scene has the members {run.first:,} to {run.first + run.members - 1:,}"
        )
    if not (np.diff(members) > 0).all() and np.unique(members).size < members.size:
        raise wrong("member", "is there twice")
    for name in ("time", "thinned_time"):
        times = (
            dataset[name].values
            if dataset.sizes.get(name, 0) and name in dataset.variables
            else np.zeros(1)
        )
        if (
            not np.isfinite(times).all()
            or not (np.diff(times) > 0.0).all()
            or times[0] < 0.0
            or times[-1] > run.t_end * (1 + 1e-9)
        ):
            raise wrong(
                name, f"expected times that ascend from 0 to t_end = {run.t_end:g} s at most"
            )
    if not np.isin(dataset.status.values, list(STATUSES.values())).all():
        raise wrong("status", f"expected {min(STATUSES.values())} to {max(STATUSES.values())}")
    if (
        "flagged_member" in dataset.variables
        and not np.isin(dataset.flagged_member.values, members).all()
    ):
        raise wrong("flagged_member", "is none of the members")


def _refuse_attributes(attrs, scene, wrong):
    """SceneError for attributes that contradict the scene."""
    run = scene.run
    told = {
        "integrator": run.integrator,
        "seed": run.seed,
        "dtype": run.dtype,
        "title": attrs.get("title", ""),
    }
    told |= {"turn": run.turn} if run.turn is not None and "turn" in attrs else {"dt": run.dt}
    for name, value in told.items():
        given = attrs.get(name, value)
        if (
            not isinstance(given, (str, int, float, np.number))
            or isinstance(given, str) != isinstance(value, str)
            or given != value
        ):
            raise wrong(name, f"contradicts the scene, which has {value!r}", value=str(given))
    attrs |= told
    if attrs.get("steps", 0) and run.turn is None and run.integrator != "closed":
        steps = attrs["steps"]
        if (
            not isinstance(steps, (int, np.integer))
            or abs(float(steps) * run.dt - run.t_end) > 1e-6 * run.t_end
        ):
            raise wrong(
                "steps",
                f"steps of {run.dt:g} s do not make t_end = {run.t_end:g} s",
                value=str(steps),
            )
