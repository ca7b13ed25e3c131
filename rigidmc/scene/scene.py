"""Scenes: made in Python or loaded from a file, checked, and written as text."""

import functools
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from rigidmc.errors import FileError, PartError, RigidmcError, SceneError, in_file
from rigidmc.files.kinds import another_kind
from rigidmc.files.opening import is_zarr
from rigidmc.scene.body import Body
from rigidmc.scene.library import read_source
from rigidmc.scene.parts import Parts
from rigidmc.scene.sampling import rows_to_run
from rigidmc.scene.toml.read import Settings, locate_source, read_parts
from rigidmc.scene.toml.write import dumps
from rigidmc.scene.user_parts.registry import CLASSES, Classes, remembered_classes

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Scene(Parts):
    __doc__ = Parts.__doc__

    @staticmethod
    def load(
        source: str | os.PathLike[str], settings: Settings = (), allow_code: bool = False
    ) -> "Scene":
        """Load a scene from a TOML file, the name of a shipped scene, a run directory, or a result.

        Parameters
        ----------
        source : path_like
            the file, name or directory
        settings : dict or sequence of (str, value), optional
            dotted keys and values that override values of the file
        allow_code : bool, optional
            whether to run the Python files with the scene's custom effects and observables. For
            example, [effects.Wind] with module = "wind.py" uses the class Wind of that file, in the
            folder of the scene file. Without allow_code such a scene is refused: scene files
            execute nothing

        Returns
        -------
        Scene
            the scene

        Raises
        ------
        SceneError
            for a mistake in the scene
        FileNotFoundError
            if no such file or name exists

        Examples
        --------
        >>> scene = rm.Scene.load("heavy_top", settings=[("effects.gravity.g", 1.62)])
        >>> scene.effects
        (Gravity(g=1.62),)
        """
        file = locate_source(source)
        if file.lower().endswith(".nc") or is_zarr(file):
            return scene_of(file, settings, allow_code)
        title = os.path.basename(file).removesuffix(".toml")
        text = ""
        try:
            text = read_source(file)
            return loads(text, file, settings, title=title, allow_code=allow_code)
        except RigidmcError as error:
            is_other = error.at in ("TOML", "file") and "[body" not in text
            if is_other and (rule := another_kind(file, "scene")):
                raise FileError(rule, at="scene", value=file) from None
            raise

    @staticmethod
    def loads(text: str, file: str = "scene") -> "Scene":
        r"""Make a scene from TOML text.

        Parameters
        ----------
        text : str
            the scene
        file : str, optional
            name for error messages

        Returns
        -------
        Scene
            the scene

        Raises
        ------
        SceneError
            for a mistake in the text

        Examples
        --------
        >>> text = "body.moments = [1.0, 2.0, 3.0]\nstart.omega = [0.0, 1.0, 0.0]"
        >>> rm.Scene.loads(text).start.omega
        (0.0, 1.0, 0.0)
        """
        return loads(text, file)

    def dumps(self) -> str:
        """Write the scene as TOML text.

        Arrays with one row per member become references to variables of the result.

        Returns
        -------
        str
            the text, which `loads` reads

        Examples
        --------
        >>> print(rm.Scene(rm.Body((1.0, 2.0, 3.0)), title="brick").dumps()[:15])
        title = "brick"
        """
        return dumps(self)


Function = TypeVar("Function", bound=Callable[..., Any])


def takes_scene(function: Function) -> Function:
    """Decorate a function whose first argument is `scene` so that it also accepts the path of a
    scene or the name of a shipped one."""

    @functools.wraps(function)
    def wrapper(*arguments: Any, **keywords: Any) -> Any:
        if arguments:
            arguments = (as_scene(arguments[0]), *arguments[1:])
        elif "scene" in keywords:
            keywords["scene"] = as_scene(keywords["scene"])
        try:
            return function(*arguments, **keywords)
        except PartError as error:  # the 30 lines of frames in between say nothing about the class
            raise error.with_traceback(None) from None

    return cast(Function, wrapper)


def as_scene(scene: Any) -> Scene:
    """Return a scene, or the scene at a path or with a name; SceneError."""
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, (str, os.PathLike)):
        return Scene.load(scene)
    rule = "expected a Scene, the path of a scene, or the name of a shipped scene"
    if isinstance(scene, Body):
        rule = (
            "a body alone has no start: give rm.Scene(body, start=rm.Start(omega=(0.0, 0.0, 1.0)))"
        )
    raise SceneError(f"is a {type(scene).__name__}; {rule}", at="scene")


def loads(
    text: str,
    file: str = "scene",
    settings: Settings = (),
    stored: Callable[[str], np.ndarray | None] | None = None,
    title: str = "scene",
    allow_code: bool | Classes | None = False,
) -> Scene:
    """Make a scene from TOML text; errors name `file`.

    stored : function of a name that returns the rows of a result to which the text refers, or None
        if the result has no rows of that name
    title : title of a scene that gives none
    allow_code : as for `Scene.load`; with None, code is neither run nor refused: placeholder
        classes without physics replace it; or the classes of the scene
    """
    with in_file(file):
        scene = Scene(**read_parts(text, file, settings, stored, title, allow_code))
        return scene.with_run(members=rows_to_run(scene.model, scene.run))


def scene_of(
    source: "str | os.PathLike[str] | xr.Dataset",
    settings: Settings = (),
    allow_code: bool | None = False,
) -> Scene:
    """Return the scene of a result, given as a Dataset or a path, netCDF or zarr.

    A scene with one row per member gets these rows from the result. `settings` and `allow_code` are
    as for `loads`; a Dataset opened with `allow_code` keeps it, and one of this process has its
    classes.
    """
    import xarray as xr  # takes half a second with netCDF4

    from rigidmc.files.netcdf import open_undecoded
    from rigidmc.scene.toml.read import scene_text, stored_rows

    if not isinstance(source, xr.Dataset):
        # through xarray: netCDF4 1.7.5 crashes when it reopens a file that xarray has open
        with open_undecoded(os.fspath(source)) as dataset:
            return scene_of(dataset, settings, allow_code)
    code: bool | Classes | None = allow_code
    if allow_code is False:
        known = remembered_classes(source.encoding.get(CLASSES, ""))
        code = known or bool(source.encoding.get("allow_code"))
    file = source.encoding.get("source", "result")
    rows = stored_rows(source)
    return loads(scene_text(source), file, settings, rows, allow_code=code)
