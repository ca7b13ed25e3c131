"""The work of a study that is computed at once: it has no members or tasks that a run directory
could hold."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.progress import announce
from rigidmc.scene.scene import Scene


class Direct(NamedTuple):
    """The work of a study that measures this machine or this code, and has no run directory.

    run : (scene with the settings, options, threads, progress) -> the Dataset
    progress : what True and a function are for, for the docstring
    needs_scene : whether there is no study without a scene; else `run` takes None
    """

    run: Callable[[Any, Any, int | None, Any], xr.Dataset]
    progress: str
    needs_scene: bool = True

    @property
    def sources(self) -> str:
        """What its command takes."""
        return "SCENE" if self.needs_scene else "[SCENE]"

    @property
    def keywords(self) -> dict[str, tuple[str, str]]:
        """{keyword of its function: (type, text)}."""
        threads = "how many; by default one for each core"
        return {"threads": ("int", threads), "progress": ("bool or callable", self.progress)}

    def design(self, scene: Scene, options: Any, settings: Mapping[str, Any]) -> Scene:
        """The scene as it is."""
        return scene

    def compute(
        self, scene: Scene | None, options: Any, threads: int | None, device: str | None,
        progress: Any,
    ) -> xr.Dataset:  # fmt: skip
        """The study, computed now on the processor."""
        with announce(progress):
            return self.run(scene, options, threads, progress)

    def stored(
        self, name: str, result: Any, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """OptionError: nothing of such a study is stored."""
        raise OptionError(f"{name} is a study of a scene alone", at="result", value=result)
