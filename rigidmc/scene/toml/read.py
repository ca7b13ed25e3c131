"""Reading of scene files: body, effects, observables, start. They execute nothing.

A result contains the text of its scene, and the rows to which the text refers (`stored_rows`).
"""

import inspect
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, PartError, SceneError, unknown
from rigidmc.files.opening import is_zarr
from rigidmc.files.reading import toml
from rigidmc.files.user_code import source_of
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import Effect, user_parameters
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import WATCHED, WITH_TABLE
from rigidmc.scene.amounts import count_text
from rigidmc.scene.body import Body
from rigidmc.scene.inertia_about import is_about_centre
from rigidmc.scene.quantities import vector
from rigidmc.scene.settings import Run, Table, check_table, with_changes
from rigidmc.scene.shape import read_shape
from rigidmc.scene.start import Start
from rigidmc.scene.toml.values import (
    DataSources,
    check_keys,
    check_plain,
    read_measured,
    read_plain,
    read_quantity,
)
from rigidmc.scene.units import BODY, in_si, size_units
from rigidmc.scene.user_parts.registry import Code, load_user_class, make_stand_in
from rigidmc.units import list_text

Settings = Sequence[tuple[str, str]]  # (dotted key, value as TOML or as a plain word)


class _File(Table):
    """Tables of a scene file. Body, effects and start check the contents of their tables."""

    title: str = ""
    summary: str = ""
    source: str = ""
    body: dict[str, Any]
    effects: dict[str, Any] = {}
    observables: dict[str, Any] = {}
    integrators: dict[str, Any] = {}
    start: dict[str, Any]
    run: dict[str, Any] = {}


def locate_source(source: str | os.PathLike[str]) -> str:
    """Return for a user's source the path of its scene file, the name of a shipped scene, or the
    path of a result (.nc, .zarr); FileError for a folder that is not a run directory."""
    source = os.fspath(source)
    if not os.path.isdir(source) or is_zarr(source):
        return source
    if not os.path.isfile(os.path.join(source, "scene.toml")):
        raise FileError("is a folder, not a run directory", at="scene", file=source)
    return os.path.join(source, "scene.toml")


def read_parts(
    text: str,
    file: str,
    settings: Settings,
    stored: Callable[[str], np.ndarray | None] | None,
    title: str,
    allow_code: bool | None,
) -> dict[str, Any]:
    """Return the fields of the scene in a TOML text; see `rigidmc.scene.scene.loads`."""
    data = toml(text)
    for key, value in settings:
        _set(data, key, value)
    overridden = {key.split(".")[1] for key, _ in settings if key.startswith("run.")}
    folder = os.path.dirname(file)
    is_run = os.path.basename(file) == "scene.toml" and os.path.isfile(
        os.path.join(folder, "run.json")
    )
    code = folder if allow_code else allow_code
    columns = DataSources(stored, folder, code, stored is not None or is_run)
    tables = check_table(_File, data, "")
    return {
        "effects": read_effects(tables.effects, columns),
        "observables": read_observables(tables.observables, columns.code),
        "integrators": read_integrators(tables.integrators, columns.code),
        "run": _run(tables.run, overridden, stored is not None),
        "start": read_start(tables.start, columns),
        "body": read_body(tables.body, columns),
        "title": tables.title or title,
        "summary": tables.summary,
        "source": tables.source,
    }


def _run(table: dict[str, Any], overridden: set[str], of_result: bool) -> Run:
    """Return the settings of the table [run]. overridden : keys set from outside the file"""
    settings = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    if of_result and settings.get("integrator", "auto") != "auto":
        # results of version 0.1 store the tolerance for which their integrator was chosen
        settings.pop("tolerance", None)
    known = {k: v for k, v in settings.items() if k not in overridden}
    run = check_table(Run, known, "run", table)
    return with_changes(run, {k: v for k, v in settings.items() if k in overridden})


def _put(components: list[Any], dotted: str, value: Any) -> None:
    """Set the component named by the last word of a key, such as start.omega.3; SceneError."""
    word = dotted.split(".")[-1]
    if not word.isdigit() or not 1 <= int(word) <= len(components):
        rule = f"expected a component from 1 to {len(components)}"
        raise SceneError(rule, at=dotted, table="", value=value)
    components[int(word) - 1] = value


def _value(text: Any) -> Any:
    """Return the value of a text: TOML, with numbers such as .5 and 1. allowed, or a plain word.
    Other Python values are returned unchanged."""
    tried = [text]
    if isinstance(text, str) and not {'"', "'"} & {*text}:
        whole = re.sub(r"(?<![\w.])\.(?=\d)", "0.", text)
        tried.append(re.sub(r"(?<=\d)\.(?!\d)(?=e|\W|$)", ".0", whole))
    for one in tried:
        try:
            return toml(f"value = {one}")["value"]
        except SceneError as error:
            if "not valid" not in error.rule:
                raise
    if isinstance(text, str) and (parts := list_text(text)):
        return {"value": _value(parts[0]), "unit": parts[1]}
    return text


def _set(data: dict[str, Any], dotted: str, value: str) -> None:
    """Set data[a][b] = value for the key a.b, or a component for a.b.3; the value is TOML, or else
    a plain word."""
    *tables, key = dotted.split(".")
    given = _value(value)
    for table in tables:
        data = data.setdefault(table, {})
        if isinstance(data, list) and table == tables[-1]:
            _put(data, dotted, given)
            return
        if not isinstance(data, dict):
            raise SceneError(f"'{table}' is not a table", at=dotted, table="", value=value)
    data[key] = given
    if tables[-1:] == ["body"] and key in (*BODIES, "mass", "centre"):
        # the shape belongs to the original body, and so do the options of its file
        others = (*BODIES, *_OF_FILE) if key in BODIES else ()
        for other in {"shape", *others} - {key, "mass", "about"}:
            data.pop(other, None)


# most tables of effects, and of observables: one kernel contains all of them, and compiling 100
# springs takes a minute
MOST = 100

# bodies given by plain numbers: {key: (keys of its own table, maker)}
SHAPES: dict[str, tuple[tuple[str, ...], Callable[..., Body]]] = {
    **{
        name: (tuple(inspect.signature(make).parameters), partial(Body.solid, name))
        for name, make in SOLIDS.items()
    },
    "particles": (("masses", "positions"), Body.from_particles),
}
BODIES = ("moments", "tensor", "file", *SHAPES)  # a body has exactly one of these keys
# other keys of a body from a file, the arguments of Body.read
_OF_FILE = ("link", "products", "about", "density", "mass", "scale", "solid")


def _one_of(keys: list[str], table: dict[str, Any]) -> SceneError:
    """Return the error of a body that has no key of BODIES, or several."""
    if keys:
        rule = "keep one of these keys; in Python, body.join makes one body of two"
        return SceneError(rule, at=f"body.{', '.join(keys)}")
    drawn = "a shape is only drawn; " if "shape" in table else ""
    return SceneError(f"{drawn}give one of these keys: {', '.join(BODIES)}", at="body.moments")


def read_body(table: dict[str, Any], stored: DataSources) -> Body:
    """Return the body of the table [body]."""
    others = ("about", "mass", "centre", "principal_axes", "axes", "pivot", "shape")
    more_keys = _OF_FILE if "file" in table else ()
    check_keys(table, dict.fromkeys((*BODIES, *others, *more_keys)), "body")
    keys = [key for key in BODIES if key in table]
    if len(keys) != 1:
        raise _one_of(keys, table)
    key = keys[0]
    if isinstance(table.get("axes"), list):
        # until 0.1 this key held the principal axes, and scenes with it were in these
        table = {**table, "principal_axes": table["axes"], "axes": "principal"}
    # results until 0.1 with an uncertain tensor have no such key, and are in the principal axes
    is_old = stored.is_recorded and isinstance(table.get("tensor"), dict)
    frame = table.get("axes", "principal" if is_old else "described")
    if key == "file":
        body = replace(_of_file(table, stored), frame=frame)
    elif key in SHAPES:
        body = replace(_shaped(table, key), frame=frame)
    else:
        body = _of_inertia(table, key, frame, stored)
    if "principal_axes" in table:
        axes = check_plain(table["principal_axes"], "body.principal_axes")
        body = replace(body, axes=tuple(map(tuple, axes)))
    if "shape" in table:
        body = replace(body, shape=read_shape(_shape_in_si(table["shape"])))
    if "pivot" not in table:
        return body
    pivot = read_measured(table["pivot"], "body.pivot", lambda inner: inner)
    if pivot == "centre" and table.get("about") == "centre" and body.inertia_key == "moments":
        return body  # its inertia is about the fixed point as given
    return body.with_pivot_at_centre() if pivot == "centre" else body.with_pivot(pivot)


def _of_inertia(table: dict[str, Any], key: str, frame: str, stored: DataSources) -> Body:
    """Return a body given by its moments or its tensor."""
    more = {
        k: read_quantity(table[k], f"body.{k}", stored) for k in ("mass", "centre") if k in table
    }
    is_whole = isinstance(table[key], dict) and "value" not in table[key]
    if key == "tensor" and not is_whole:
        inertia = read_plain(table[key], BODY[key], f"body.{key}")
    else:
        inertia = read_quantity(table[key], f"body.{key}", stored)
    about = table.get("about", "pivot")
    if is_about_centre(about) and "principal_axes" in table:
        rule = 'has no principal_axes with about = "centre": give the tensor instead'
        raise SceneError(rule, at=f"body.{key}")
    if is_about_centre(about) and table.get("pivot") == "centre":
        # where the centre of mass was does not matter, and moving there and back costs digits
        vector(more.pop("centre", (0.0, 0.0, 0.0)), "body.centre")
        about = "pivot"
    if key == "moments":
        return replace(Body.from_moments(inertia, **more, about=about), frame=frame)
    return Body.from_tensor(inertia, **more, about=about, axes=frame)


def _of_file(table: dict[str, Any], stored: DataSources) -> Body:
    """Return the body of a file, in the folder of the scene unless its path is absolute."""
    for extra in ("centre", "principal_axes", "shape"):
        if extra in table:
            rule = "the file of the body defines this"
            raise SceneError(rule, at=f"body.{extra}", value=table[extra])
    if not isinstance(table["file"], str):
        rule = 'expected the name of a file, such as "arm.urdf"'
        raise SceneError(rule, at="body.file", value=table["file"])
    path = os.path.join(stored.folder or "", table["file"])
    options = {key: table[key] for key in _OF_FILE if key in table}
    try:
        return Body.read(path, **options)
    except FileNotFoundError:
        where = os.path.abspath(stored.folder or os.curdir)
        rule = f"no such file in {where}"
        raise SceneError(rule, at="body.file", value=table["file"]) from None


def _shape_in_si(tables: Any) -> Any:
    """Return the tables [[body.shape]] with the sizes and places that have a unit in SI."""
    if isinstance(tables, list):
        return [_shape_in_si(table) for table in tables]
    if not isinstance(tables, dict):
        return tables
    plain = ("solid", "turned", "hole", "faces")
    return {
        key: value
        if key in plain
        else in_si(
            read_measured(value, at := f"body.shape.{key}", lambda inner: inner),
            size_units(key),
            at,
        )
        for key, value in tables.items()
    }


def _shaped(table: dict[str, Any], key: str) -> Body:
    """Return a solid, or a body of particles, from its own table within [body]."""
    keys, make = SHAPES[key]
    for extra in ("mass", "centre", "about"):
        if extra in table:
            rule = f"the table of a {key} defines its mass and centre: {', '.join(keys)}"
            raise SceneError(rule, at=f"body.{extra}", value=table[extra])
    check_keys(table[key], keys, f"body.{key}", required=keys)
    given = {k: read_plain(table[key][k], size_units(k), f"body.{key}.{k}") for k in keys}
    return make(**given)


def read_start(table: dict[str, Any], stored: DataSources) -> Start:
    """Return the start of the table [start]."""
    check_keys(table, ("omega", "momentum", "attitude"), "start")
    return Start(
        **{key: read_quantity(value, f"start.{key}", stored) for key, value in table.items()}
    )


def read_effects(tables: dict[str, Any], stored: DataSources) -> tuple[Effect, ...]:
    """Return the effects of the tables [effects.NAME]."""
    effects = []
    for name, table in _each(tables, "effects"):
        kind, at = _kind("effects", name, table, EFFECTS, stored.code), f"effects.{name}"
        fields = user_parameters(kind)
        required = [field for field in fields if field not in kind._field_defaults]
        more = () if name in EFFECTS else ("module",)
        check_keys(table, (*fields, *more), at, required)
        values = {
            k: read_quantity(v, f"{at}.{k}", stored) for k, v in table.items() if k not in more
        }
        effects.append(kind(**values))
    return tuple(effects)


def read_observables(tables: dict[str, Any], code: Code) -> tuple[Any, ...]:
    """Return the observables of the tables [observables.NAME]; code : see
    `rigidmc.scene.user_parts.registry`."""
    return tuple(
        _built("observables", name, table, {**WITH_TABLE, **WATCHED}, code)
        for name, table in _each(tables, "observables")
    )


def read_integrators(tables: dict[str, Any], code: Code) -> tuple[Any, ...]:
    """Return the custom integrators of the tables [integrators.NAME]."""
    return tuple(
        _built("integrators", name, table, {}, code) for name, table in _each(tables, "integrators")
    )


def _built(kind: str, name: str, table: Any, shipped: dict[str, Any], code: Code) -> Any:
    """Return the object that a table [kind.NAME] of plain numbers describes."""
    made = _kind(kind, name, table, shipped, code)
    more = () if name in shipped else ("module",)
    required = [field for field in made._fields if field not in made._field_defaults]
    check_keys(table, (*made._fields, *more), f"{kind}.{name}", required)
    # compiled code needs tuples
    given = {key: value for key, value in table.items() if key not in more}
    if kind == "observables":
        given = {
            key: read_measured(value, f"{kind}.{name}.{key}", _tuple)
            for key, value in given.items()
        }
    return made(**{key: _tuple(value) for key, value in given.items()})


def _tuple(value: Any) -> Any:
    """Convert lists to tuples."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _each(tables: dict[str, Any], at: str) -> Iterator[tuple[str, Any]]:
    """Return pairs (name, table) of each [effects.spring] or [[effects.spring]]; SceneError for too
    many."""
    every = [
        (name, one)
        for name, table in tables.items()
        for one in (table if isinstance(table, list) else [table])
    ]
    if len(every) > MOST:
        rule = f"has more than {MOST} tables, the limit of a kernel"
        raise SceneError(rule, at=at)
    return iter(every)


def _kind(kind: str, name: str, table: Any, shipped: dict[str, Any], code: Code) -> Any:
    """Return the class of a table [kind.NAME], by its name or from its Python file."""
    if name in shipped:
        return shipped[name]
    one = {"effects": "effect", "observables": "observable with a table"}.get(kind, "integrator")
    if not isinstance(table, dict) or "module" not in table:
        error = unknown(one, shipped or INTEGRATORS, at=kind, key=name)
        error.rule += f'; a custom {one.split()[0]} needs module = "file.py"'
        raise error
    at = f"{kind}.{name}"
    found = load_user_class(name, table["module"], at, code)
    if found is None:
        return make_stand_in(kind, name, table)
    if not implements(found, "_fields"):
        rule = f"{found.__name__} is not a NamedTuple, as an {one.split()[0]} must be"
        raise PartError(rule, at=f"{at}.module", value=table["module"], source=source_of(found))
    return found


ROWS = 10_000_000  # up to this many indices, a selection is expanded to all of them: 80 MB a column


def scene_text(dataset: xr.Dataset) -> str:
    """Return the TOML text of the scene of a result; FileError if the Dataset is not a result."""
    text = dataset.attrs.get("scene")
    if not isinstance(text, str):
        rule = "not a result of rigidmc: it has no attribute 'scene' with the text of a scene"
        raise FileError(rule, at="scene", file=dataset.encoding.get("source"))
    return text


def stored_rows(dataset: xr.Dataset) -> Callable[[str], NDArray[Any] | None]:
    """Return a function that returns the rows (..., members) of a variable of a result, or None.

    The members may be any selection, in any order: members that are not selected need no rows.
    """

    def stored(name: str) -> NDArray[Any] | None:
        if name not in dataset.variables or dataset[name].dims[-1:] != ("member",):
            return None
        members, rows = _members(dataset), dataset[name].values
        if rows.dtype.kind not in "iuf" or "scale_factor" in dataset[name].attrs:
            rule = "does not contain rows of plain numbers"
            raise FileError(rule, at=name)
        count = int(members.max()) + 1
        if count > max(ROWS, 100 * members.size):
            rule = (
                f"has the rows of only {count_text(members.size, 'member')}, up to member"
                f" {count - 1:,}: open the whole result"
            )
            raise FileError(rule, at="member")
        whole = np.repeat(rows[..., :1], count, axis=-1)
        whole[..., members] = rows
        return whole

    return stored


def _members(dataset: xr.Dataset) -> NDArray[Any]:
    """Return the indices of the members; FileError if a result cannot have them."""
    if "member" not in dataset.variables or dataset.sizes["member"] < 1:
        raise FileError("a result must have at least one member", at="member")
    members = dataset["member"].values
    if members.ndim != 1 or members.dtype.kind not in "iu" or members.min() < 0:
        raise FileError("expected indices of members", at="member")
    refuse_twice(members)
    return np.asarray(members)


def refuse_twice(members: NDArray[Any]) -> None:
    """Raise FileError if a result has a member more than once, as a concatenation of results
    does."""
    known, times = np.unique(members, return_counts=True)
    if (times > 1).any():
        rule = (
            f"has member {known[times > 1][0]} more than once: this is a concatenation of several"
            " runs; use the result of one run"
        )
        raise FileError(rule, at="member")
