"""Open results from files, and check them against the scene that they contain.

A file is a result only if its variables, dimensions, types and units match the scene in it.
"""

import os
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import FileError, RigidmcError, SceneWarning, in_file
from rigidmc.files.kinds import another_kind
from rigidmc.files.netcdf import open_undecoded
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.protocol import shape
from rigidmc.physics.observables import dimensions, is_opaque
from rigidmc.physics.observables.protocol import DIMENSIONS
from rigidmc.physics.observables.saving import CENSORED, FOLLOWED
from rigidmc.results.layout import Axes, labels_of_works
from rigidmc.results.variables import (
    NEWER,
    Variable,
    describe_variables,
    member_variables,
    parameter_variable,
)
from rigidmc.scene.derivatives import parameters_of_run
from rigidmc.scene.parameters import units_at
from rigidmc.scene.recording import Recording
from rigidmc.scene.scene import Scene, loads
from rigidmc.scene.settings import Run
from rigidmc.scene.toml.read import scene_text
from rigidmc.scene.user_parts.registry import origin_of


def open_result(path: str | os.PathLike[str], allow_code: bool = False) -> xr.Dataset:
    """Open a result as a lazy Dataset; FileError if the file is not a result of rigidmc, see
    `rigidmc.results.reader`. Keeps variables that a user added."""
    path = os.fspath(path)
    try:
        dataset = open_undecoded(path)
    except FileError:
        if rule := another_kind(path, "result"):
            raise FileError(rule, at="result", value=path) from None
        raise
    try:
        with in_file(path):
            scene_text(dataset)
            if "status" not in dataset:
                rule = (
                    "a map or a study, not a result with members; xarray.open_dataset reads both,"
                    " `rigidmc map FILE` reads a map"
                )
                raise FileError(rule, at="file")
            result, strange = check_result(dataset, path)
    except BaseException:
        dataset.close()
        raise
    left = []
    for name in strange:
        try:
            result = result.assign({name: _added(dataset, name)})
        except Exception:  # attributes of an unknown file may be anything
            left.append(name)
    if left:
        more = f" and {len(left) - 5:,} more" if len(left) > 5 else ""
        names = ", ".join(left[:5]) + more
        warnings.warn(
            f"{path}: ignored variables whose attributes cannot be decoded: {names}",
            SceneWarning,
            stacklevel=3,
        )
    result.set_close(dataset.close)
    origin_of(result)["allow_code"] = allow_code
    result.encoding["source"] = dataset.encoding.get("source", os.path.abspath(path))
    return result


def _added(dataset: xr.Dataset, name: str) -> xr.Variable:
    """Decode a variable that a user added to a result, as xarray does."""
    alone = xr.Dataset({name: dataset.variables[name]})
    decoded = xr.decode_cf(alone, decode_timedelta=False)
    variable: xr.Variable = decoded.variables[name]
    return variable


_OVER = ("time", "thinned_time", "parameter", "member", "flagged")


def check_result(dataset: xr.Dataset, path: str) -> tuple[xr.Dataset, list[str]]:
    """Check an undecoded Dataset. Return it in the layout of a result of its scene, and the names
    of variables that do not belong to this layout. Raises FileError if it is not a result."""

    scene = _scene_of(dataset, path)
    for name in ("member", "time"):
        if name not in dataset.variables or dataset.sizes.get(name, 0) < 1:
            raise FileError("is missing or empty; a result has at least one", at=name)
    axes, variables, needed = _layout(scene, dataset)
    sizes, expected = axes.lengths(0), axes.coordinates()
    for name in needed:
        if name not in dataset.variables:
            raise FileError("is missing; every result of this scene has it", at=name)
    for name, (dims, dtype, attrs) in variables.items():
        if name in dataset.variables:
            _refuse_unlike(dataset[name], dims, np.dtype(dtype), attrs, sizes)
    for name, (dims, values, attrs) in expected.items():
        if name in dataset.variables and values.dtype.kind != "U":
            _refuse_unlike(dataset[name], dims, values.dtype, attrs, sizes)
    _refuse_members(dataset, scene.run)
    _refuse_attributes(dataset.attrs, scene.run)
    strange = [
        str(name) for name in dataset.variables if name not in variables and name not in expected
    ]
    # the values of text coordinates are known: read no text from the file
    words = [name for name, (_, values, _) in expected.items() if values.dtype.kind == "U"]
    result = dataset.drop_vars([*strange, *(name for name in words if name in dataset.variables)])
    result = result.assign_coords({name: expected[name] for name in words})
    # in the order of the scene; zarr sorts them by name
    ordered = {name: result.variables[name] for name in variables if name in result.variables}
    result = xr.Dataset(ordered, result.coords, result.attrs)
    for key, variable in result.variables.items():
        name = str(key)
        attrs = expected[name][2] if name in expected else variables[name].attrs
        trusted = ("units", "significant_digits")
        variable.attrs = {k: variable.attrs[k] for k in trusted if k in variable.attrs} | attrs
    return result, strange


def _scene_of(dataset: xr.Dataset, path: str) -> Scene:
    """Read the scene of a result, with the first of its rows; runs no code."""

    def stored(name: str) -> NDArray[Any] | None:
        if name not in dataset.variables or dataset[name].ndim not in (1, 2):
            return None
        return np.asarray(dataset[name][..., :32].values)

    try:
        return loads(dataset.attrs["scene"], path, stored=stored, allow_code=None)
    except RigidmcError as error:
        error.rule = f"of the scene in this result: {error.rule}"
        raise


def _layout(scene: Scene, dataset: xr.Dataset) -> tuple[Axes, dict[str, Variable], list[str]]:
    """Return (axes of a result, {name: Variable} of all variables that results of a scene may have,
    names of the required ones)."""
    model, run, recorded = scene.model, scene.run, scene.recording
    opaque = [
        (label, effect)
        for label, effect in label_effects(scene.effects)
        if hasattr(effect, "stand_in")
    ]
    # only the code defines the units of their parameters
    of_opaque = tuple(f"effects.{label}." for label, _ in opaque)
    parameters = parameters_of_run(model, run.wrt)
    bins = tuple(
        (f"{label}_bin", entry.edges(), _units(recorded, entry.name, f"{label}_bin", dataset))
        for label, entry in recorded.histograms
    )
    axes = Axes(
        times=np.empty(dataset.sizes["time"]),
        thinned=np.zeros(dataset.sizes.get("thinned_time", 0), int),
        labels=labels_of_works(scene.effects, recorded),
        bins=bins,
        dims=dimensions(recorded.recorded, recorded.monitored),
        parameters=parameters,
        parameter_units=tuple(
            "" if name.startswith(of_opaque) else unit
            for name, unit in zip(parameters, units_at(model, parameters), strict=True)
        ),
    )
    groups = describe_variables(model, run, recorded, axes.parameter_units, True)
    always = member_variables(model, run, recorded, False)
    variables = always | {name: entry for group in groups.values() for name, entry in group.items()}
    if scene.body.inertia_key == "tensor":
        # only the code defines which vectors are turned into each body
        turned = {
            f"{label}_{name}": parameter_variable(label, name, size, "1")
            for label, effect in opaque
            for name in effect._fields
            if (size := shape(effect, name)) in (3, 6)
        }
        variables = turned | variables
    for name in {
        f"{label}_{field}" for label, effect in opaque for field in effect._fields
    } & variables.keys():
        # only the code defines the units
        words = {"long_name": variables[name].attrs["long_name"]}
        variables[name] = variables[name]._replace(attrs=words)
    if any(map(is_opaque, scene.observables)):  # only the code defines their variables
        variables |= _of_opaque(dataset, variables)
    # only the code defines whether an effect has an energy; without one, mass and centre may be
    # missing
    free = (*("mass", "centre") * bool(opaque), *NEWER)
    return axes, variables, [name for name in always if name not in free]


def _units(recorded: Recording, name: str, bins: str, dataset: xr.Dataset) -> str:
    """Return the units of an observable, from the bins of its histogram if its code is not run."""
    units = dataset[bins].attrs.get("units", "") if bins in dataset.variables else ""
    return recorded.observable(name).units or str(units)


def _of_opaque(dataset: xr.Dataset, variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the variables by members that may belong to observables whose code is not run."""
    more = {}
    for name, variable in dataset.data_vars.items():
        dims = tuple(map(str, variable.dims))
        by_members = dims[-1:] in (("member",), ("flagged",)) and variable.dtype.kind == "f"
        if name not in variables and by_members and {*dims} <= {*DIMENSIONS, *_OVER}:
            words = {k: str(variable.attrs.get(k, "")) for k in ("units", "long_name")}
            if variable.attrs.get(CENSORED) == FOLLOWED:
                words[CENSORED] = FOLLOWED
            more[str(name)] = Variable(dims, "f8", words)
    return more


def _refuse_unlike(
    variable: xr.DataArray,
    dims: tuple[str, ...],
    dtype: np.dtype[Any],
    attrs: dict[str, Any],
    sizes: dict[str, Any],
) -> None:
    """Raise FileError for a variable whose dimensions, type or units do not match the scene, and
    for a packed variable."""
    name = str(variable.name)
    if variable.dims != tuple(dims):
        text = ", ".join(map(str, variable.dims)) or "none"
        raise FileError(f"has the dimensions {text}, expected {', '.join(dims)}", at=name)
    for dim in dims:
        size = None if dim in ("member", "flagged") else sizes[dim]
        if size is not None and variable.sizes[dim] != size:
            raise FileError(
                f"is {variable.sizes[dim]:,} long along {dim}, expected {size:,}", at=name
            )
    if variable.dtype.kind != dtype.kind:
        raise FileError(f"is of type {variable.dtype}, expected {dtype}", at=name)
    if packed := [word for word in ("scale_factor", "add_offset") if word in variable.attrs]:
        raise FileError(f"is packed with {' and '.join(packed)}; results are not packed", at=name)
    units = variable.attrs.get("units", "")
    if not isinstance(units, str) or ("units" in attrs and units not in ("", attrs["units"])):
        raise FileError(
            f"is in units of {units!r}, expected {attrs.get('units', 'text')!r}", at=name
        )
    digits = variable.attrs.get("significant_digits", 1)
    if not isinstance(digits, (int, np.integer)) or not 1 <= digits <= 15:
        raise FileError("expected 1 to 15 significant digits", at=name, value=str(digits))


def _refuse_members(dataset: xr.Dataset, run: Run) -> None:
    """Raise FileError for members that the scene lacks, unordered times and unknown statuses."""
    members = dataset.member.values
    last = run.first + run.members - 1
    if members.min() < run.first or members.max() > last:
        raise FileError(f"the scene has the members {run.first:,} to {last:,}", at="member")
    if not (np.diff(members) > 0).all() and np.unique(members).size < members.size:
        raise FileError("has duplicate indices", at="member")
    for name in ("time", "thinned_time"):
        if dataset.sizes.get(name, 0) and name in dataset.variables:
            _refuse_times(name, dataset[name].values, run.t_end)
    if not np.isin(dataset.status.values, list(STATUSES.values())).all():
        raise FileError(
            f"expected {min(STATUSES.values())} to {max(STATUSES.values())}", at="status"
        )
    if (
        "flagged_member" in dataset.variables
        and not np.isin(dataset.flagged_member.values, members).all()
    ):
        raise FileError("is not one of the members", at="flagged_member")


def _refuse_times(name: str, times: NDArray[Any], t_end: float) -> None:
    ascending = np.isfinite(times).all() and (np.diff(times) > 0.0).all()
    if not ascending or times[0] < 0.0 or times[-1] > t_end * (1 + 1e-9):
        raise FileError(f"expected ascending times between 0 and t_end = {t_end:g} s", at=name)


def _refuse_attributes(attrs: dict[str, Any], run: Run) -> None:
    """Raise FileError for attributes that contradict the scene, and add missing ones."""
    demanded = {
        "integrator": run.integrator,
        "seed": run.seed,
        "dtype": run.dtype,
        "title": attrs.get("title", ""),
    }
    own_steps = run.turn is not None
    demanded |= {"turn": run.turn} if own_steps and "turn" in attrs else {"dt": run.dt}
    for name, value in demanded.items():
        stored = attrs.get(name, value)
        if (
            not isinstance(stored, (str, int, float, np.number))
            or isinstance(stored, str) != isinstance(value, str)
            or stored != value
        ):
            raise FileError(
                f"contradicts the scene, which has {value!r}", at=name, value=str(stored)
            )
    attrs |= demanded
    steps = attrs.get("steps", 0)
    is_whole = isinstance(steps, (int, np.integer))
    if own_steps or run.integrator == "closed" or (is_whole and steps == 0):
        return
    # the last interval and its steps may be shorter; the number of steps is then rounded up
    off = float(steps) * run.dt - run.t_end if is_whole else 0.0
    most = run.dt if isinstance(run.every, float) and run.every < run.t_end else 0.0
    if not is_whole or not -1e-6 * run.t_end < off < most + 1e-6 * run.t_end:
        rule = f"steps of {run.dt:g} s do not add up to t_end = {run.t_end:g} s"
        raise FileError(rule, at="steps", value=str(steps))
