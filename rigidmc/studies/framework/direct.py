"""The work of a study that is computed at once, without members or tasks for a run directory."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.processes.progress import announce
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.variables import describe


class Direct(NamedTuple):
    """The work of a study that one call computes, and that has no run directory.

    run : (scene with the settings, options, threads, progress) -> the Dataset
    progress : docstring text of the keyword `progress`: the meanings of True and of a function
    needs_scene : whether the study requires a scene; if not, `run` may get None
    """

    run: Callable[[Any, Any, int | None, Any], xr.Dataset]
    progress: str
    needs_scene: bool = True

    @property
    def sources(self) -> str:
        """Argument of its command."""
        return "SCENE" if self.needs_scene else "[SCENE]"

    @property
    def keywords(self) -> dict[str, tuple[str, str]]:
        """{keyword of its function: (type, text)}."""
        threads = "number of threads; by default one for each core"
        return {"threads": ("int", threads), "progress": ("bool or callable", self.progress)}

    def design(self, scene: Scene, options: Any, settings: Mapping[str, Any]) -> Scene:
        """Return the scene unchanged."""
        return scene

    def compute(
        self, scene: Scene | None, options: Any, threads: int | None, device: str | None,
        progress: Any,
    ) -> xr.Dataset:  # fmt: skip
        """Compute the study now, on the CPU."""
        with announce(progress):
            dataset = self.run(scene, options, threads, progress)
        return dataset if scene is None else describe(dataset, scene)

    def stored(
        self, name: str, result: Any, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """Raise OptionError: nothing of this study is stored."""
        raise OptionError(f"{name} studies scenes, not results", at="result", value=result)
