"""Scene files: TOML in, a checked Scene out, and back. They hold data and execute nothing."""

import inspect
import os
import tomllib
from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from pydantic import ValidationError

from rigidmc.body import IDENTITY, Body
from rigidmc.effects import EFFECTS, labelled, name_of
from rigidmc.effects.own import class_of, source_of
from rigidmc.effects.parameters import given
from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.observables import SUMMARIES, summary_of
from rigidmc.sampling import Distribution, Grid, distribution, grid, is_distribution
from rigidmc.scene import Run, Scene, Table, complaint
from rigidmc.solids import SOLIDS
from rigidmc.start import Start
from rigidmc.tables import column
from rigidmc.vectors import VECTORS, of_table, word_of


class _File(Table):
    """The tables of a scene file; what is inside body, effects and start is checked by Body, Effect and Start themselves."""

    title: str = ""
    summary: str = ""
    source: str = ""
    body: dict[str, Any]
    effects: dict[str, Any] = {}
    observables: dict[str, Any] = {}
    start: dict[str, Any]
    run: dict[str, Any] = {}


_SHAPES: dict[str, Any] = {  # ways to give a body in a scene file: key -> (its own keys, maker)
    "moments": None,
    "tensor": None,
    **{name: (tuple(inspect.signature(make).parameters), partial(Body.solid, name)) for name, make in SOLIDS.items()},
    "particles": (("masses", "positions"), Body.from_particles),
}


def load(source, settings=(), allow_code=False):
    """A scene from a TOML file, the name of a shipped scene, or a result file (.nc); `settings` are (dotted key, value) pairs.

    allow_code : whether to run the Python files that it takes effects from: [effects.Wind] with module = "wind.py", found beside the scene
        file, is the class Wind of that file. Without it such a file is refused: scene files execute nothing.

    Raises SceneError for what is wrong in it, FileNotFoundError where there is no such file or name.
    """
    source = os.fspath(source)
    if os.path.isdir(source):
        if not os.path.isfile(os.path.join(source, "scene.toml")):
            raise SceneError("", "scene", None, "is a folder, and no run directory", file=source)
        source = os.path.join(source, "scene.toml")
    if source.endswith(".nc"):
        from rigidmc.storage import scene_of

        return scene_of(source, settings, allow_code)
    text = read_source(source)
    return loads(text, source, settings, title=os.path.basename(source).removesuffix(".toml"), allow_code=allow_code)


def loads(text, file="scene", settings=(), stored=None, title="scene", allow_code=False):
    """A scene from TOML text; `stored(name, axis)` gives the columns of a result file that the text refers to."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError("", "TOML", None, f"not valid TOML: {error}", file=file) from None
    try:
        for key, value in settings:
            _set(data, key, value)
        _refuse_long(data)
        return _from_tables(data, _Columns(stored, os.path.dirname(file)), title, os.path.dirname(file) if allow_code else None)
    except SceneError as error:
        error.file = error.file or file
        raise
    except ValidationError as error:
        made = complaint(error, "", _File, data)
        made.file = file
        raise made from None


def _refuse_long(data, table="", key=""):
    """SceneError for a whole number of more than 64 bits, which TOML has not."""
    if isinstance(data, dict):
        for name, value in data.items():
            _refuse_long(value, f"{table}.{key}".strip("."), name)
    elif isinstance(data, list):
        for value in data:
            _refuse_long(value, table, key)
    elif isinstance(data, int) and not -(2**63) <= data < 2**63:
        raise SceneError(table, key, float("inf") if data > 0 else float("-inf"), "whole numbers have 64 bits")


def _from_tables(data, stored, title, folder):
    """The scene of parsed TOML; `folder` is where Python files lie that may be run, None where none may."""
    file = _File(**data)
    try:
        run = Run.model_validate({k: tuple(v) if isinstance(v, list) else v for k, v in file.run.items()})
    except ValidationError as error:
        raise complaint(error, "run", Run, file.run) from None
    if {"dt", "turn"} <= file.run.keys():
        raise SceneError("run", "turn", run.turn, "give dt or turn, not both")
    effects = []
    for name, table in file.effects.items():
        for one in table if isinstance(table, list) else [table]:  # [effects.spring], or [[effects.spring]] for several
            kind = _kind(name, one, folder)
            own = () if name in EFFECTS else ("module",)
            _only(one, (*given(kind), *own), f"effects.{name}")
            missing = [f for f in given(kind) if f not in one and f not in kind._field_defaults]
            if missing:
                raise SceneError(f"effects.{name}", missing[0], None, "is missing")
            effects.append(kind(**{k: _parse(v, f"effects.{name}", k, stored) for k, v in one.items() if k not in own}))
    observables = []
    for name, table in file.observables.items():
        if name not in SUMMARIES:
            raise unknown("observables", name, None, "observable over all steps", SUMMARIES)
        observed = SUMMARIES[name]
        for one in table if isinstance(table, list) else [table]:
            _only(one, observed._fields, f"observables.{name}")
            if missing := [f for f in observed._fields if f not in one and f not in observed._field_defaults]:
                raise SceneError(f"observables.{name}", missing[0], None, "is missing")
            observables.append(observed(**one))
    _only(file.start, ("omega", "momentum", "attitude"), "start")
    start = Start(**{k: _parse(v, "start", k, stored) for k, v in file.start.items()})
    body = _body(file.body, stored)
    scene = Scene(body, tuple(effects), start, run, file.title or title, file.summary, file.source, tuple(observables))
    return scene.with_run()


class _Columns(NamedTuple):
    """Where columns come from that a file refers to: those of a result, and tables beside the scene file."""

    of_result: Any
    folder: str


def _kind(name, table, folder):
    """The class of an effect by its word, or by the Python file that has it."""
    if name in EFFECTS:
        return EFFECTS[name]
    module = table.get("module") if isinstance(table, dict) else None
    if not isinstance(module, str):
        error = unknown("effects", name, None, "effect", EFFECTS)
        error.rule += '; one of your own needs module = "file.py"'
        raise error
    if folder is None:
        rule = "is code, and scene files execute nothing; look at it, then allow it with --allow-code (in Python allow_code=True)"
        raise SceneError(f"effects.{name}", "module", module, rule)
    return class_of(folder, module, name, f"effects.{name}")


def dumps(scene):
    """The scene as TOML; arrays with one row per member become references to the variables of the result."""
    body = {"moments": _plain(scene.body.moments, "moments"), "mass": _plain(scene.body.mass, "mass")}
    body["centre"] = _plain(scene.body.centre, "centre")
    if scene.body.axes != IDENTITY:
        body["axes"] = [list(row) for row in scene.body.axes]
    which = "omega" if scene.start.momentum is None else "momentum"
    attitude = scene.start.attitude
    angles = "start_euler" if len(attitude) == 3 else "start_attitude"
    start = {which: _plain(getattr(scene.start, which), f"start_{which}")}
    start["attitude"] = _plain(attitude, angles)
    effects: dict[str, Any] = {}
    for label, effect in labelled(scene.effects):
        own = {} if type(effect) in EFFECTS.values() or (file := source_of(type(effect))) is None else {"module": file}
        parameters = {k: _plain(getattr(effect, k), f"{label}_{k}") for k in given(effect)}
        effects.setdefault(name_of(effect), []).append({**own, **parameters})
    effects = {name: tables if len(tables) > 1 else tables[0] for name, tables in effects.items()}
    observables: dict[str, Any] = {}
    for one in scene.observables:
        observables.setdefault(summary_of(one), []).append(one._asdict())
    observables = {name: tables if len(tables) > 1 else tables[0] for name, tables in observables.items()}
    tables = {
        "title": scene.title,
        "summary": scene.summary,
        "source": scene.source,
        "body": body,
        "effects": effects,
        **({"observables": observables} if observables else {}),
        "start": start,
    }
    run = {
        k: list(v) if isinstance(v, tuple) else v
        for k, v in scene.run.model_dump(exclude={"dt"} if scene.run.turn else None).items()
        if v is not None
    }
    return tomli_w.dumps({**{k: v for k, v in tables.items() if v != ""}, "run": run})


def shipped():
    """Names of the scenes that come with the package."""
    return sorted(p.name[:-5] for p in resources.files("rigidmc.scenes").iterdir() if p.name.endswith(".toml"))


def read_source(source):
    """The TOML text of a scene file or of a shipped scene; FileNotFoundError with the nearest name where there is neither."""
    if source in shipped():
        return resources.files("rigidmc.scenes").joinpath(f"{source}.toml").read_text("utf-8")
    if os.path.exists(source):
        with open(source, encoding="utf-8") as file:
            try:
                return file.read()
            except UnicodeDecodeError:
                raise SceneError("", "scene", None, "is no text in UTF-8, and so no scene file", file=source) from None
    close = nearest(os.path.basename(source).removesuffix(".toml"), shipped())
    hint = f" (did you mean '{close}'?)" if close else ""
    raise FileNotFoundError(f"{source}: no such file, and no shipped scene of that name{hint}; shipped: {', '.join(shipped())}")


def _body(table, stored):
    """The body of a scene file."""
    _only(table, (*_SHAPES, "mass", "centre", "axes", "pivot"), "body")
    given = [k for k in _SHAPES if k in table]
    if len(given) != 1:
        raise SceneError("body", " | ".join(_SHAPES), None, f"give exactly one of these, not {len(given)}")
    shape = given[0]
    parts = {k: _parse(table[k], "body", k, stored) for k in ("mass", "centre") if k in table}
    if _SHAPES[shape] is None:
        value = _parse(table[shape], "body", shape, stored) if shape == "moments" else table[shape]
        body = (
            Body.from_moments(value, **parts) if shape == "moments" else Body.from_tensor(_numbers(value, "body", shape), **parts)
        )
    else:
        keys, make = _SHAPES[shape]
        extra = [k for k in ("mass", "centre") if k in table]
        if extra:
            raise SceneError(
                "body", extra[0], table[extra[0]], f"a {shape} has its mass and centre inside its own table: {', '.join(keys)}"
            )
        _only(table[shape], keys, f"body.{shape}")
        missing = [k for k in keys if k not in table[shape]]
        if missing:
            raise SceneError(f"body.{shape}", missing[0], None, "is missing")
        body = make(**{k: _numbers(table[shape][k], f"body.{shape}", k) for k in keys})
    if "axes" in table:
        body = replace(body, axes=tuple(map(tuple, _numbers(table["axes"], "body", "axes"))))
    return body.pivoted_at(table["pivot"]) if "pivot" in table else body


def _numbers(value, table, key):
    """Numbers, or lists of numbers, as they stand."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(table, key, value, "expected numbers") from None
    if isinstance(value, str) or not np.isfinite(array).all():
        raise SceneError(table, key, value, "expected finite numbers")
    return value


def _only(table, allowed, name):
    if not isinstance(table, dict):
        raise SceneError("", name, table, f"expected a table with the keys {', '.join(allowed)}")
    for key in table:
        if key not in allowed:
            raise unknown(name, key, None, "key", allowed)


def _parse(value, table, key, stored):
    """Numbers, lists, {distribution = parameters} and {stored = name, axis = i} of a scene file as quantities."""
    if isinstance(value, list):
        return [_parse(v, table, key, stored) for v in value]
    if not isinstance(value, dict):
        return value
    if "stored" in value:
        if stored.of_result is None:
            raise SceneError(table, key, value, "refers to the rows of a result file; load that file instead")
        return stored.of_result(value["stored"], value.get("axis"))
    if "table" in value:
        one = "column" in value
        _only(value, ("table", "column" if one else "columns"), f"{table}.{key}")
        names = [value["column"]] if one else value.get("columns")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in (*names, value["table"])):
            raise SceneError(table, key, value, 'expected { table = "file.csv", columns = ["w1", "w2", "w3"] }, or column = "w1"')
        found = [column(stored.folder, value["table"], name, table, key) for name in names]
        if not one and len(found) not in (3, 4):
            raise SceneError(table, key, value, f"{len(found)} columns: a vector has 3 components, a quaternion 4")
        return found[0] if one else found
    if "grid" in value:
        _only(value, ("grid", "stride", "log"), f"{table}.{key}")
        if not isinstance(value["grid"], list) or len(value["grid"]) != 3:
            raise SceneError(table, key, value, "expected grid = [low, high, count]")
        return _named(table, key, value, grid, *value["grid"], **{k: v for k, v in value.items() if k != "grid"})
    if len(value) != 1:
        raise SceneError(table, key, value, "expected a number or one distribution, e.g. { normal = [0.0, 0.001] }")
    ((name, parameters),) = value.items()
    whole = of_table(name, parameters, key, lambda part: _parse(part, table, key, stored))
    if whole is not None:
        return whole
    if key in VECTORS and not is_distribution(name):
        elsewhere = [other for other, kinds in VECTORS.items() if name in kinds]
        rule = f"'{name}' is of {' and '.join(elsewhere)}" if elsewhere else f"no vector or distribution '{name}'"
        rule += (
            f"; vectors of {key}: {', '.join(VECTORS[key])}; distributions: normal, uniform and the continuous ones of scipy.stats"
        )
        raise SceneError(table, key, value, rule, nearest(name, [*VECTORS[key], "normal", "uniform"]))
    if isinstance(parameters, dict):
        return _named(table, key, value, distribution, name, **parameters)
    return _named(table, key, value, distribution, name, *(parameters if isinstance(parameters, list) else [parameters]))


def _named(table, key, value, make, *arguments, **words):
    """make(...), its error told of a key of a table."""
    try:
        return make(*arguments, **words)
    except SceneError as error:
        raise SceneError(table, key, value, error.rule, error.nearest) from None


def _plain(value, name, axis=None):
    """A quantity or a tuple of them as it stands in TOML."""
    if hasattr(value, "_fields"):
        return {word_of(value): {k: _plain(v, name) for k, v in value._asdict().items() if v is not None}}
    if isinstance(value, tuple):
        return [_plain(v, name, i + 1) for i, v in enumerate(value)]
    if isinstance(value, (Distribution, Grid)):
        return value.as_table()
    if isinstance(value, np.ndarray):
        return {"stored": name} if axis is None else {"stored": name, "axis": axis}
    return value


def _set(data, dotted, value):
    """data[a][b] = value for the key a.b; the value is TOML, or else a plain word."""
    *tables, key = dotted.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise SceneError("", dotted, value, f"'{table}' is not a table")
    try:
        data[key] = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        data[key] = value
    if tables[-1:] == ["run"] and key in ("dt", "turn"):
        data.pop({"dt": "turn", "turn": "dt"}[key], None)
    if key in _SHAPES and tables[-1:] == ["body"]:
        for other in set(_SHAPES) - {key}:
            data.pop(other, None)
