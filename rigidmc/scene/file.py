"""Scene files as the parts of scenes. They hold data and execute nothing."""

import os
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from rigidmc.errors import FileError, SceneError
from rigidmc.files.kinds import is_zarr
from rigidmc.files.reading import toml
from rigidmc.scene.changes import changed
from rigidmc.scene.settings import Run, Table, complaint
from rigidmc.scene.tables import (
    BODIES,
    body_of,
    effects_of,
    integrators_of,
    observables_of,
    start_of,
)
from rigidmc.scene.values import Columns

Settings = Sequence[tuple[str, str]]  # (dotted key, value as TOML or as a plain word)


class _File(Table):
    """The tables of a scene file. Body, effects and start check what is inside their tables."""

    title: str = ""
    summary: str = ""
    source: str = ""
    body: dict[str, Any]
    effects: dict[str, Any] = {}
    observables: dict[str, Any] = {}
    integrators: dict[str, Any] = {}
    start: dict[str, Any]
    run: dict[str, Any] = {}


def located(source: str | os.PathLike[str]) -> str:
    """The path of a scene file, the name of a shipped scene, or the path of a result (.nc, .zarr),
    of the source that a user names; FileError for a folder that is no run directory."""
    source = os.fspath(source)
    if not os.path.isdir(source) or is_zarr(source):
        return source
    if not os.path.isfile(os.path.join(source, "scene.toml")):
        raise FileError("", "scene", None, "is a folder, and no run directory", file=source)
    return os.path.join(source, "scene.toml")


def parts_of(
    text: str,
    file: str,
    settings: Settings,
    stored: Callable[[str], np.ndarray | None] | None,
    title: str,
    allow_code: bool | None,
) -> dict[str, Any]:
    """The fields of the scene in a TOML text, for the arguments see `rigidmc.scene.scene.loads`."""
    data = toml(text)
    for key, value in settings:
        _set(data, key, value)
    overridden = {key.split(".")[1] for key, _ in settings if key.startswith("run.")}
    folder = os.path.dirname(file)
    columns = Columns(stored, folder, folder if allow_code else allow_code)
    try:
        tables = _File(**data)
    except ValidationError as error:
        raise complaint(error, "", _File, data) from None
    return {
        "effects": effects_of(tables.effects, columns),
        "observables": observables_of(tables.observables, columns.code),
        "integrators": integrators_of(tables.integrators, columns.code),
        "run": _run(tables.run, overridden, stored is not None),
        "start": start_of(tables.start, columns),
        "body": body_of(tables.body, columns),
        "title": tables.title or title,
        "summary": tables.summary,
        "source": tables.source,
    }


def _run(table: dict[str, Any], overridden: set[str], of_result: bool) -> Run:
    """The settings of the table [run]. overridden : keys whose values do not come from the file"""
    settings = {k: tuple(v) if isinstance(v, list) else v for k, v in table.items()}
    if of_result and settings.get("integrator", "auto") != "auto":
        # results of version 0.1 have the tolerance for which their integrator was chosen
        settings.pop("tolerance", None)
    try:
        run = Run.model_validate({k: v for k, v in settings.items() if k not in overridden})
    except ValidationError as error:
        raise complaint(error, "run", Run, table) from None
    return changed(run, {k: v for k, v in settings.items() if k in overridden})


def _put(components: list[Any], dotted: str, value: Any) -> None:
    """The component that the last word of a key names, as start.omega.3; SceneError."""
    word = dotted.split(".")[-1]
    if not word.isdigit() or not 1 <= int(word) <= len(components):
        rule = f"expected a component from 1 to {len(components)}"
        raise SceneError("", dotted, value, rule)
    components[int(word) - 1] = value


def _value(text: Any) -> Any:
    """The value that a text stands for: TOML, also with numbers as .5 and 1., or a plain word; in
    Python other values stand for themselves."""
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
    return text


def _set(data: dict[str, Any], dotted: str, value: str) -> None:
    """data[a][b] = value for the key a.b, or a component for a.b.3; the value is TOML, or else a
    plain word."""
    *tables, key = dotted.split(".")
    given = _value(value)
    for table in tables:
        data = data.setdefault(table, {})
        if isinstance(data, list) and table == tables[-1]:
            _put(data, dotted, given)
            return
        if not isinstance(data, dict):
            raise SceneError("", dotted, value, f"'{table}' is not a table")
    data[key] = given
    if tables[-1:] == ["body"] and key in (*BODIES, "mass", "centre"):
        # another body than the one that has this shape
        for other in {"shape", *(BODIES if key in BODIES else ())} - {key}:
            data.pop(other, None)
