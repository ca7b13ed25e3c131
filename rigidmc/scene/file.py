"""Scene files: TOML in, a checked Scene out. They hold data and execute nothing."""

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from rigidmc.errors import FileError, RigidmcError, SceneError
from rigidmc.files.reading import toml
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run, Table, changed, complaint
from rigidmc.scene.shipped import read_source
from rigidmc.scene.tables import BODIES, body_of, effects_of, observables_of, start_of
from rigidmc.scene.values import Columns

if TYPE_CHECKING:
    import xarray as xr

Settings = Sequence[tuple[str, str]]  # (dotted key, value as TOML or as a plain word)


class _File(Table):
    """The tables of a scene file. Body, effects and start check what is inside their tables."""

    title: str = ""
    summary: str = ""
    source: str = ""
    body: dict[str, Any]
    effects: dict[str, Any] = {}
    observables: dict[str, Any] = {}
    start: dict[str, Any]
    run: dict[str, Any] = {}


def load(
    source: str | os.PathLike[str], settings: Settings = (), allow_code: bool = False
) -> Scene:
    """A scene from a TOML file, the name of a shipped scene, a run directory, or a result (.nc).

    settings : (dotted key, value) pairs that override values of the file
    allow_code : whether to run the Python files from which it takes effects. [effects.Wind] with
        module = "wind.py", beside the scene file, is the class Wind of that file. Without
        allow_code such a scene is refused: scene files execute nothing.

    Raises SceneError for a mistake in the scene, FileNotFoundError if there is no such file or
    name.
    """
    source = os.fspath(source)
    if os.path.isdir(source):
        if not os.path.isfile(os.path.join(source, "scene.toml")):
            raise FileError("", "scene", None, "is a folder, and no run directory", file=source)
        source = os.path.join(source, "scene.toml")
    if source.lower().endswith(".nc"):
        return scene_of(source, settings, allow_code)
    text, title = read_source(source), os.path.basename(source).removesuffix(".toml")
    return loads(text, source, settings, title=title, allow_code=allow_code)


def loads(
    text: str,
    file: str = "scene",
    settings: Settings = (),
    stored: Callable[[str], np.ndarray | None] | None = None,
    title: str = "scene",
    allow_code: bool | None = False,
) -> Scene:
    """A scene from TOML text; errors name `file`.

    stored : function of a name that gives the rows of a result to which the text refers, or None if
        the result has none of that name
    title : of a scene without a title
    allow_code : as for `load`; with None code is neither run nor refused: classes without physics
        stand in for it
    """
    try:
        data = toml(text)
        for key, value in settings:
            _set(data, key, value)
        overridden = {key.split(".")[1] for key, _ in settings if key.startswith("run.")}
        columns = Columns(stored, os.path.dirname(file))
        tables = _File(**data)
        scene = Scene(
            effects=effects_of(
                tables.effects, columns, columns.folder if allow_code else allow_code
            ),
            observables=observables_of(tables.observables),
            run=_run(tables.run, overridden, stored is not None),
            start=start_of(tables.start, columns),
            body=body_of(tables.body, columns),
            title=tables.title or title,
            summary=tables.summary,
            source=tables.source,
        )
        return scene.with_run(members=scene.rows_to_run())
    except RigidmcError as error:
        error.file = error.file or file
        raise
    except ValidationError as error:
        wrong = complaint(error, "", _File, data)
        wrong.file = file
        raise wrong from None


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


def scene_of(
    source: "str | os.PathLike[str] | xr.Dataset",
    settings: Settings = (),
    allow_code: bool | None = False,
) -> Scene:
    """The scene of a result, which is a Dataset or the path of a netCDF file.

    A scene with one row per member gets these rows from the result. `settings` and `allow_code` are
    as for `load`.
    """
    import xarray as xr  # with netCDF4 half a second

    from rigidmc.files.netcdf import open_undecoded
    from rigidmc.scene.stored import scene_text, stored_rows

    if not isinstance(source, xr.Dataset):
        # by xarray: netCDF4 1.7.5 crashes when it opens once more what xarray has open
        with open_undecoded(os.fspath(source)) as dataset:
            return scene_of(dataset, settings, allow_code)
    file = source.encoding.get("source", "result")
    rows = stored_rows(source, file)
    return loads(scene_text(source), file, settings, rows, allow_code=allow_code)


def _set(data: dict[str, Any], dotted: str, value: str) -> None:
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
    if key in BODIES and tables[-1:] == ["body"]:
        for other in set(BODIES) - {key}:
            data.pop(other, None)
