"""Reading of scene files: effects, observables, start, settings. They execute nothing.

A result contains the text of its scene, and the rows to which the text refers (`stored_rows`).
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import FileError, PartError, SceneError, unknown
from rigidmc.files.opening import is_zarr
from rigidmc.files.reading import toml
from rigidmc.files.user_code import class_named, source_of
from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.measured import list_text
from rigidmc.mechanics.euler_angles import angle_names
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import Effect, user_parameters
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import OBSERVABLES, bare_observables
from rigidmc.scene.settings import Run, Table, check_table, with_changes
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import WORDS, has_convention, is_start_table
from rigidmc.scene.toml.bodies import BODIES, OF_FILE, read_body
from rigidmc.scene.toml.values import DataSources, check_keys, read_measured, read_quantity
from rigidmc.scene.user_parts.registry import Classes, Code, load_user_class, make_stand_in

if TYPE_CHECKING:
    import xarray as xr

# (dotted key, value as TOML or as a plain word)
Settings = Sequence[tuple[str, str]] | Mapping[str, str]


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
    allow_code: bool | Classes | None,
) -> dict[str, Any]:
    """Return the fields of the scene in a TOML text; see `rigidmc.scene.scene.loads`."""
    data = toml(text)
    settings = tuple(settings.items()) if isinstance(settings, Mapping) else settings
    for key, value in settings:
        _set(data, key, value)
    overridden = {key.split(".")[1] for key, _ in settings if key.startswith("run.")}
    folder = os.path.dirname(file)
    is_run = os.path.basename(file) == "scene.toml" and os.path.isfile(
        os.path.join(folder, "run.json")
    )
    code = folder if allow_code is True else allow_code
    columns = DataSources(stored, folder, code, stored is not None or is_run)
    for name in data:
        for inside, words in (("effects", EFFECTS), ("observables", _observables_with_table())):
            if name in words:
                raise SceneError(f"is not a table of a scene: write [{inside}.{name}]", at=name)
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
    of_file = {k: v for k, v in settings.items() if k not in overridden}
    run = check_table(Run, of_file, "run", table)
    return with_changes(run, {k: v for k, v in settings.items() if k in overridden})


def _put(components: list[Any], dotted: str, value: Any) -> None:
    """Set the component named by the last word of a key, such as start.omega.3 or
    start.attitude.theta; SceneError."""
    vector, _, word = dotted.rpartition(".")
    angles = angle_names() if vector == "start.attitude" else ()
    if word in angles:
        word = str(angles.index(word) + 1)
    if not word.isdigit() or not 1 <= int(word) <= len(components):
        rule = f"expected a component from 1 to {len(components)}"
        if angles:
            rule += f", or {', '.join(angles)}"
        raise SceneError(rule, at=dotted, table="", value=value)
    components[int(word) - 1] = value


def _with_own_units(table: Any) -> Any:
    """Return a vector with one unit, { value = [...], unit = "rpm" }, as components that each have
    it, so that one of them can be set; anything else unchanged."""
    if not isinstance(table, dict) or not isinstance(table.get("value"), list):
        return table
    parts = [part if isinstance(part, dict) else {"value": part} for part in table["value"]]
    return [{**part, "unit": table["unit"]} for part in parts] if "unit" in table else table


def _value(text: Any) -> Any:
    """Return the value of a text: TOML, with numbers such as .5 and 1. allowed, or a plain word.
    Other Python values are returned unchanged."""
    tried = [text]
    if isinstance(text, str) and not {'"', "'"} & {*text}:
        with_zero = re.sub(r"(?<![\w.])\.(?=\d)", "0.", text)
        tried.append(re.sub(r"(?<=\d)\.(?!\d)(?=e|\W|$)", ".0", with_zero))
    for toml_text in tried:
        try:
            return toml(f"value = {toml_text}")["value"]
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
    parsed = _value(value)
    for table in tables:
        if table == tables[-1] and key not in ("value", "unit"):
            data[table] = _with_own_units(data.get(table, {}))
        data = data.setdefault(table, {})
        if isinstance(data, list) and table == tables[-1]:
            _put(data, dotted, parsed)
            return
        if isinstance(data, list):
            raise SceneError(_no_table_in(data, table, dotted), at=dotted, table="", value=value)
        if not isinstance(data, dict):
            raise SceneError(f"'{table}' is not a table", at=dotted, table="", value=value)
    data[key] = parsed
    if tables[-1:] == ["body"] and key in (*BODIES, "mass", "centre"):
        # the shape belongs to the original body, and so do the options of its file
        others = (*BODIES, *OF_FILE) if key in BODIES else ()
        for other in {"shape", *others} - {key, "mass", "about"}:
            data.pop(other, None)


def _no_table_in(components: list[Any], name: str, dotted: str) -> str:
    """Return why a key below a component, such as start.omega.1.standard_deviation, cannot be set:
    the component of the list `name` is a number, or a distribution without keys."""
    above, _, rest = dotted.partition(f".{name}.")
    word = rest.split(".")[0]
    place = f"{above}.{name}.{word}"
    if not word.isdigit() or not 1 <= int(word) <= len(components):
        return f"'{name}' is a list, not a table: its components are 1 to {len(components)}"
    part = components[int(word) - 1]
    if isinstance(part, dict):
        return f"a component is set as a whole, as in {place}={{ normal = [0, 0.1] }}"
    return (
        f"{place} is {part!r}, a number without a distribution: for a normal one with this mean and"
        f" the deviation 0.1, set {place}={{ normal = [{part!r}, 0.1] }}"
    )


# most tables of effects, and of observables: one kernel contains all of them, and compiling 100
# springs takes a minute
MOST = 100


def read_start(table: dict[str, Any], stored: DataSources) -> Start:
    """Return the start of the table [start]."""
    check_keys(table, ("omega", "momentum", "attitude"), "start")
    return Start(**{key: _start_value(key, value, stored) for key, value in table.items()})


def _start_value(key: str, value: Any, stored: DataSources) -> Any:
    """Return a value of the table [start] with its quantities, in a table of its own or not."""
    at = f"start.{key}"
    if not is_start_table(key, value):
        return read_quantity(value, at, stored)
    if not has_convention(key, value):  # a distribution, or columns
        other = {name: part for name, part in value.items() if name != "relative_to"}
        frame = {"relative_to": value["relative_to"]}
        return {"value": read_quantity(other, at, stored), **frame} if other else frame
    return {
        name: part if name in WORDS else read_quantity(part, f"{at}.{name}", stored)
        for name, part in value.items()
    }


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
        _built("observables", name, table, _observables_with_table(), code)
        for name, table in _each(tables, "observables")
    )


def _observables_with_table() -> dict[str, Any]:
    bare = bare_observables()
    return {name: kind for name, kind in OBSERVABLES.items() if name not in bare}


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
    fields = {key: value for key, value in table.items() if key not in more}
    if kind == "observables":
        fields = {
            key: read_measured(value, f"{kind}.{name}.{key}", _tuple)
            for key, value in fields.items()
        }
    return made(**{key: _tuple(value) for key, value in fields.items()})


def _tuple(value: Any) -> Any:
    """Convert lists to tuples."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _each(tables: dict[str, Any], at: str) -> Iterator[tuple[str, Any]]:
    """Return pairs (name, table) of each [effects.spring] or [[effects.spring]]; SceneError for too
    many."""
    every = [
        (name, single)
        for name, table in tables.items()
        for single in (table if isinstance(table, list) else [table])
    ]
    if len(every) > MOST:
        rule = f"has more than {MOST} tables, the limit of a kernel"
        raise SceneError(rule, at=at)
    return iter(every)


def _kind(kind: str, name: str, table: Any, shipped: dict[str, Any], code: Code) -> Any:
    """Return the class of a table [kind.NAME], by its name or from its Python file."""
    if name in shipped:
        return shipped[name]
    word = {"effects": "effect", "observables": "observable with a table"}.get(kind, "integrator")
    is_known = isinstance(code, tuple) and class_named(name, code) is not None
    if not isinstance(table, dict) or not ("module" in table or is_known):
        error = unknown(word, shipped or INTEGRATORS, at=kind, key=name)
        error.rule += f'; a custom {word.split()[0]} needs module = "file.py"'
        raise error
    at = f"{kind}.{name}"
    loaded = load_user_class(name, table.get("module"), at, code)
    if loaded is None:
        return make_stand_in(kind, name, table)
    if not implements(loaded, "_fields"):
        rule = f"{loaded.__name__} is not a NamedTuple, as an {word.split()[0]} must be"
        raise PartError(rule, at=f"{at}.module", value=table["module"], source=source_of(loaded))
    return loaded


ROWS = 10_000_000  # up to this many indices, a selection is expanded to all of them: 80 MB a column


def scene_text(dataset: "xr.Dataset") -> str:
    """Return the TOML text of the scene of a result; FileError if the Dataset is not a result."""
    text = dataset.attrs.get("scene")
    if not isinstance(text, str):
        rule = "not a result of rigidmc: it has no attribute 'scene' with the text of a scene"
        raise FileError(rule, at="scene", file=dataset.encoding.get("source"))
    return text


def stored_rows(dataset: "xr.Dataset") -> Callable[[str], NDArray[Any] | None]:
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
        all_rows = np.repeat(rows[..., :1], count, axis=-1)
        all_rows[..., members] = rows
        return all_rows

    return stored


def _members(dataset: "xr.Dataset") -> NDArray[Any]:
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
    indices, times = np.unique(members, return_counts=True)
    if (times > 1).any():
        rule = (
            f"has member {indices[times > 1][0]} more than once: this is a concatenation of several"
            " runs; use the result of one run"
        )
        raise FileError(rule, at="member")
