"""Scene files: TOML in, a checked Scene out, and back. They hold data and execute nothing."""

import inspect
import os
from collections import namedtuple
from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any

import tomli_w
from pydantic import ValidationError

from rigidmc.effects import EFFECTS, labelled, name_of
from rigidmc.effects.own import class_of, source_of
from rigidmc.effects.parameters import given
from rigidmc.errors import FileError, RigidmcError, SceneError, nearest, unknown
from rigidmc.files.reading import text_of, toml
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.observables import SUMMARIES, summary_of
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run, Table, changed, complaint
from rigidmc.scene.start import Start
from rigidmc.scene.values import Columns, numbers, only, parse, plain

MOST = 100  # effects, and observables over all steps: a kernel is compiled for all of them, 100 springs in a minute


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
    **{
        name: (tuple(inspect.signature(make).parameters), partial(Body.solid, name))
        for name, make in SOLIDS.items()
    },
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
            raise FileError("", "scene", None, "is a folder, and no run directory", file=source)
        source = os.path.join(source, "scene.toml")
    if source.lower().endswith(".nc"):
        return scene_of(source, settings, allow_code)
    text = read_source(source)
    return loads(
        text,
        source,
        settings,
        title=os.path.basename(source).removesuffix(".toml"),
        allow_code=allow_code,
    )


def loads(text, file="scene", settings=(), stored=None, title="scene", allow_code=False):
    """A scene from TOML text; `stored(name)` gives the rows of a result file that the text refers to, None if the file has none of
    that name.

    allow_code : as for `load`; with None code is neither run nor refused: classes without physics stand in for it
    """
    try:
        data = toml(text)
        for key, value in settings:
            _set(data, key, value)
        overridden = {key.split(".")[1] for key, _ in settings if key.startswith("run.")}
        folder = os.path.dirname(file)
        return _from_tables(
            data, Columns(stored, folder), title, folder if allow_code else allow_code, overridden
        )
    except RigidmcError as error:
        error.file = error.file or file
        raise
    except ValidationError as error:
        made = complaint(error, "", _File, data)
        made.file = file
        raise made from None


def scene_of(source, settings=(), allow_code=False):
    """The scene of a result, given as a Dataset or the path of a netCDF file.

    A scene with one row per member gets those rows of the result; `settings` and `allow_code` as for `load`.
    """
    from rigidmc.files.netcdf import open_undecoded  # netCDF4 and xarray, half a second
    from rigidmc.scene.stored import scene_text, stored_rows

    if isinstance(source, str):
        # by xarray: netCDF4 1.7.5 crashes when it opens once more what xarray has open
        with open_undecoded(source) as dataset:
            return scene_of(dataset, settings, allow_code)
    file = source.encoding.get("source", "result")
    rows = stored_rows(source, file)
    return loads(scene_text(source), file, settings, rows, allow_code=allow_code)


def _from_tables(data, stored, title, folder, overridden):
    """The scene of parsed TOML.

    folder : where Python files lie that may be run; False if none may, None if stand-ins take their place (`_stand_in`)
    overridden : keys of [run] whose values do not come from the file itself
    """
    file = _File(**data)
    for kind, tables in (("effects", file.effects), ("observables", file.observables)):
        if sum(len(one) if isinstance(one, list) else 1 for one in tables.values()) > MOST:
            raise SceneError(
                "", kind, None, f"has more than {MOST} tables, the limit for one kernel"
            )
    settings = {k: tuple(v) if isinstance(v, list) else v for k, v in file.run.items()}
    if stored.of_result is not None and settings.get("integrator", "auto") != "auto":
        settings.pop(
            "tolerance", None
        )  # in results of version 0.1: the tolerance for which their integrator was chosen
    try:
        run = Run.model_validate({k: v for k, v in settings.items() if k not in overridden})
    except ValidationError as error:
        raise complaint(error, "run", Run, file.run) from None
    run = changed(run, {k: v for k, v in settings.items() if k in overridden})
    effects = []
    for name, table in file.effects.items():
        for one in (
            table if isinstance(table, list) else [table]
        ):  # [effects.spring], or [[effects.spring]] for several
            kind = _kind(name, one, folder)
            own = () if name in EFFECTS else ("module",)
            only(one, (*given(kind), *own), f"effects.{name}")
            missing = [f for f in given(kind) if f not in one and f not in kind._field_defaults]
            if missing:
                raise SceneError(f"effects.{name}", missing[0], None, "is missing")
            effects.append(
                kind(
                    **{
                        k: parse(v, f"effects.{name}", k, stored)
                        for k, v in one.items()
                        if k not in own
                    }
                )
            )
    observables = []
    for name, table in file.observables.items():
        if name not in SUMMARIES:
            raise unknown("observables", name, None, "observable over all steps", SUMMARIES)
        observed = SUMMARIES[name]
        for one in table if isinstance(table, list) else [table]:
            only(one, observed._fields, f"observables.{name}")
            if missing := [
                f for f in observed._fields if f not in one and f not in observed._field_defaults
            ]:
                raise SceneError(f"observables.{name}", missing[0], None, "is missing")
            observables.append(observed(**one))
    only(file.start, ("omega", "momentum", "attitude"), "start")
    start = Start(**{k: parse(v, "start", k, stored) for k, v in file.start.items()})
    body = _body(file.body, stored)
    scene = Scene(
        body,
        tuple(effects),
        start,
        run,
        file.title or title,
        file.summary,
        file.source,
        tuple(observables),
    )
    return scene.with_run()


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
        return _stand_in(name, table)
    if folder is False:
        rule = "is code, and scene files execute nothing; look at it, then allow it with --allow-code (in Python allow_code=True)"
        raise SceneError(f"effects.{name}", "module", module, rule)
    return class_of(folder, module, name, f"effects.{name}")


def _stand_in(name, table):
    """A class in the place of code that is not run: with the parameters of its table, and without physics."""
    words = [key for key in table if key != "module"]
    try:
        made = namedtuple(name, words)  # type: ignore[misc]
    except ValueError as error:
        raise SceneError(
            "effects", name, None, f"cannot be a class with these parameters: {error}"
        ) from None
    kind: Any = made
    kind.shapes = {key: len(value) for key, value in table.items() if isinstance(value, list)}
    kind.torque = kind.energy = kind.stand_in = lambda self: 0.0
    return kind


def dumps(scene):
    """The scene as TOML; arrays with one row per member become references to the variables of the result."""
    body = {"moments": plain(scene.body.moments, "moments"), "mass": plain(scene.body.mass, "mass")}
    body["centre"] = plain(scene.body.centre, "centre")
    if scene.body.axes != IDENTITY:
        body["axes"] = [list(row) for row in scene.body.axes]
    which = "omega" if scene.start.momentum is None else "momentum"
    attitude = scene.start.attitude
    angles = "start_euler" if scene.start.by_euler_angles else "start_attitude"
    start = {which: plain(getattr(scene.start, which), f"start_{which}")}
    start["attitude"] = plain(attitude, angles)
    effects: dict[str, Any] = {}
    for label, effect in labelled(scene.effects):
        own = (
            {}
            if type(effect) in EFFECTS.values() or (file := source_of(type(effect))) is None
            else {"module": file}
        )
        parameters = {k: plain(getattr(effect, k), f"{label}_{k}") for k in given(effect)}
        effects.setdefault(name_of(effect), []).append({**own, **parameters})
    effects = {name: tables if len(tables) > 1 else tables[0] for name, tables in effects.items()}
    observables: dict[str, Any] = {}
    for one in scene.observables:
        observables.setdefault(summary_of(one), []).append(one._asdict())
    observables = {
        name: tables if len(tables) > 1 else tables[0] for name, tables in observables.items()
    }
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
    return sorted(
        p.name[:-5]
        for p in resources.files("rigidmc.scene.library").iterdir()
        if p.name.endswith(".toml")
    )


def read_source(source):
    """The TOML text of a scene file or of a shipped scene; FileNotFoundError with the nearest name where there is neither."""
    if source in shipped():
        return (
            resources.files("rigidmc.scene.library").joinpath(f"{source}.toml").read_text("utf-8")
        )
    if os.path.exists(source):
        return text_of(source)
    close = nearest(os.path.basename(source).removesuffix(".toml"), shipped())
    hint = f" (did you mean '{close}'?)" if close else ""
    raise FileNotFoundError(
        f"{source}: no such file, and no shipped scene of that name{hint}; shipped: {', '.join(shipped())}"
    )


def _body(table, stored):
    """The body of a scene file."""
    only(table, (*_SHAPES, "mass", "centre", "axes", "pivot"), "body")
    given = [k for k in _SHAPES if k in table]
    if len(given) != 1:
        raise SceneError(
            "body", " | ".join(_SHAPES), None, f"give exactly one of these, not {len(given)}"
        )
    shape = given[0]
    parts = {k: parse(table[k], "body", k, stored) for k in ("mass", "centre") if k in table}
    if _SHAPES[shape] is None:
        value = parse(table[shape], "body", shape, stored) if shape == "moments" else table[shape]
        body = (
            Body.from_moments(value, **parts)
            if shape == "moments"
            else Body.from_tensor(numbers(value, "body", shape), **parts)
        )
    else:
        keys, make = _SHAPES[shape]
        extra = [k for k in ("mass", "centre") if k in table]
        if extra:
            raise SceneError(
                "body",
                extra[0],
                table[extra[0]],
                f"a {shape} has its mass and centre inside its own table: {', '.join(keys)}",
            )
        only(table[shape], keys, f"body.{shape}")
        missing = [k for k in keys if k not in table[shape]]
        if missing:
            raise SceneError(f"body.{shape}", missing[0], None, "is missing")
        body = make(**{k: numbers(table[shape][k], f"body.{shape}", k) for k in keys})
    if "axes" in table:
        body = replace(body, axes=tuple(map(tuple, numbers(table["axes"], "body", "axes"))))
    return body.pivoted_at(table["pivot"]) if "pivot" in table else body


def _set(data, dotted, value):
    """data[a][b] = value for the key a.b; the value is TOML, or else a plain word."""
    *tables, key = dotted.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise SceneError("", dotted, value, f"'{table}' is not a table")
    try:
        data[key] = toml(f"value = {value}")["value"]
    except SceneError as error:
        if "not valid" not in error.rule:
            raise
        data[key] = value
    if key in _SHAPES and tables[-1:] == ["body"]:
        for other in set(_SHAPES) - {key}:
            data.pop(other, None)
