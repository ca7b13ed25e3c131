"""A scene: made in Python or from a file, checked, and written as text."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rigidmc.errors import RigidmcError
from rigidmc.scene.checks import check
from rigidmc.scene.file import Settings, located, parts_of
from rigidmc.scene.parts import Parts
from rigidmc.scene.shipped import read_source
from rigidmc.scene.text import dumps

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Scene(Parts):
    __doc__ = Parts.__doc__

    def check(self) -> "Scene":
        """The scene itself; raises SceneError if it cannot be run, see `rigidmc.scene.checks`."""
        self.with_run()
        check(self)
        return self

    @staticmethod
    def load(
        source: str | os.PathLike[str], settings: Settings = (), allow_code: bool = False
    ) -> "Scene":
        """A scene from a TOML file, the name of a shipped scene, a run directory, or a result.

        settings : (dotted key, value) pairs that override values of the file
        allow_code : whether to run the Python files from which it takes effects. [effects.Wind]
            with module = "wind.py", beside the scene file, is the class Wind of that file. Without
            allow_code such a scene is refused: scene files execute nothing.

        Raises SceneError for a mistake in the scene, FileNotFoundError if there is no such file or
        name.
        """
        file = located(source)
        if file.lower().endswith(".nc"):
            return scene_of(file, settings, allow_code)
        title = os.path.basename(file).removesuffix(".toml")
        return loads(read_source(file), file, settings, title=title, allow_code=allow_code)

    @staticmethod
    def loads(text: str, file: str = "scene") -> "Scene":
        """A scene from TOML text; errors name `file`."""
        return loads(text, file)

    def dumps(self) -> str:
        """The scene as TOML text; arrays with one row per member become references to the variables
        of the result."""
        return dumps(self)


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
    allow_code : as for `Scene.load`; with None code is neither run nor refused: classes without
        physics stand in for it
    """
    try:
        scene = Scene(**parts_of(text, file, settings, stored, title, allow_code))
        return scene.with_run(members=scene.rows_to_run())
    except RigidmcError as error:
        error.file = error.file or file
        raise


def scene_of(
    source: "str | os.PathLike[str] | xr.Dataset",
    settings: Settings = (),
    allow_code: bool | None = False,
) -> Scene:
    """The scene of a result, which is a Dataset or the path of a netCDF file.

    A scene with one row per member gets these rows from the result. `settings` and `allow_code` are
    as for `loads`.
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
