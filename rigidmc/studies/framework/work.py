"""The work of a study, and the simplest kind of it: one call, without members or tasks."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.processes.progress import announce
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.variables import describe


class StudyWork:
    """The computation of a study: `Direct`, `Members`, `Tasks`, or a custom one.

    sources : argument of its command
    counted : what it counts for a function given as `progress`
    needs_scene : whether it requires a scene
    design : (scene with the settings, options, settings) -> the argument of `compute`; raises for a
        scene that cannot be studied
    """

    design: Callable[[Scene, Any, Mapping[str, Any]], Any]
    sources = "SCENE"
    counted = "members"
    needs_scene: bool = True

    @property
    def keywords(self) -> dict[str, tuple[str, str]]:
        """{keyword of its function: (type, text)}."""
        return {
            "threads": ("int", "as in `simulate`; the result does not depend on it, to the bit"),
            "device": ("str", "CPU or GPU that computes the members, as in `simulate`"),
            "progress": (
                "bool or callable",
                "True to report the cost of the study before the first step, and show a bar; or a"
                f" function of ({self.counted} done, all)",
            ),
        }

    def compute(
        self, design: Any, options: Any, threads: int | None, device: str | None, progress: Any
    ) -> xr.Dataset:
        """Compute the study now."""
        raise NotImplementedError

    def stored(
        self, name: str, result: Any, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """Return the study of a stored result, by the name of the study; OptionError or FileError
        if it cannot be studied."""
        raise OptionError(f"{name} studies scenes, not results", at="result", value=result)


@dataclass(frozen=True)
class Direct(StudyWork):
    """The work of a study that one call computes, and that has no run directory.

    run : (scene with the settings, options, threads, progress) -> the Dataset
    progress : docstring text of the keyword `progress`: the meanings of True and of a function
    needs_scene : whether the study requires a scene; if not, `run` may get None
    """

    run: Callable[[Any, Any, int | None, Any], xr.Dataset]
    progress: str
    needs_scene: bool = True

    @property
    def sources(self) -> str:  # type: ignore[override]  # it depends on the study
        """Argument of its command."""
        return "SCENE" if self.needs_scene else "[SCENE]"

    @property
    def keywords(self) -> dict[str, tuple[str, str]]:
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
