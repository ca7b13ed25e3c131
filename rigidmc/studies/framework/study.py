"""The record of a study, and what is made of it: a function with its signature and docstring."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path
from rigidmc.scene.scene import Scene, as_scene
from rigidmc.scene.settings import Run, no_such_keyword
from rigidmc.studies.framework.direct import Direct
from rigidmc.studies.framework.options import (
    Example,
    NoOptions,
    Option,
    Options,
    options_of,
    parameter,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


KEYWORDS = "threads", "device", "progress"  # of a function, if its work has them


class StudyWork(Protocol):
    """What computes a study: `Members`, `Tasks`, `Direct`, or one of its own.

    sources : what its command takes
    keywords : {keyword of its function: (type, text)}
    """

    @property
    def sources(self) -> str: ...

    @property
    def keywords(self) -> dict[str, tuple[str, str]]: ...

    def design(self, scene: Scene, options: Any, settings: Mapping[str, Any]) -> Any:
        """What `compute` takes, of a scene with its settings; raises for what cannot be studied."""

    def compute(
        self, design: Any, options: Any, threads: int | None, device: str | None, progress: Any, /
    ) -> xr.Dataset:
        """The study, computed now."""

    def stored(
        self, name: str, result: Any, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """The study of what was computed before."""


class OutputFile(NamedTuple):
    """A file that the command of a study writes beside its Dataset and its picture.

    kind : what such files are called, in the plural
    text : of the option, a phrase without a full stop
    write : (dataset, path, force) -> whether the study has such a file
    """

    kind: str
    text: str
    write: Callable[[xr.Dataset, Path, bool], bool]


@dataclass(frozen=True)
class Study:
    """A question about a scene: a value that is called, as the function of its name.

    name : of function and folder, and of the command without `command`
    text : the docstring of the function, with a line `{parameters}` in place of its parameters
    options : what may be asked
    work : what computes: members of one scene, tasks, or a function at once
    table : Dataset -> lines of text, or what else rich prints
    picture : the function in `picture.py` of the folder, of a Dataset and `picture_options`
    example : a small one, for the tests over all studies
    settings : of a run, that the command has; None for all
    settings_help : {setting: what it means for this study}, where that is not its meaning for a run
    scene_text, settings_text : what the docstring says of these parameters
    source : what beside a scene the command takes
    outcome : Dataset -> "done", "flagged" or "incomplete", of which the command makes exit codes
    files : {option of the command: what else it writes}
    """

    name: str
    text: str
    options: type[Options]
    work: StudyWork
    table: Callable[[xr.Dataset], list[Any]]
    picture: str
    example: Example
    command: str = ""
    picture_options: type[Options] = NoOptions
    settings: tuple[str, ...] | None = None
    settings_help: Mapping[str, str] = field(default_factory=dict)
    scene_text: str = "what is run; also its file, or the name of a shipped one"
    settings_text: str = "of `simulate`"
    source: str = "the result of a study that exists"
    outcome: Callable[[xr.Dataset], str] = lambda dataset: "done"
    files: Mapping[str, OutputFile] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "command", self.command or self.name)
        facts = {
            "__name__": self.name,
            "__qualname__": self.name,
            "__module__": f"rigidmc.studies.{self.name}.study",
            "__doc__": inspect.cleandoc(self.text).replace("{parameters}", self._parameters()),
            "__signature__": self._signature(),
        }
        for name, value in facts.items():  # what `help`, `inspect` and Sphinx read of a function
            object.__setattr__(self, name, value)

    def __call__(self, *arguments: Any, **keywords: Any) -> xr.Dataset:
        """The study of a scene, as its own docstring has it."""
        given = self._bound(arguments, keywords)
        threads, device, progress = (given.pop(name, None) for name in KEYWORDS)
        design, options = self._designed(given)
        return self.work.compute(design, options, threads, device, progress)

    @property
    def needs_scene(self) -> bool:
        """Whether there is no such study without a scene."""
        return not isinstance(self.work, Direct) or self.work.needs_scene

    def design(self, *arguments: Any, **keywords: Any) -> Any:
        """The scene with the members of the study; of tasks (scene, request). Arguments as
        of the study itself."""
        return self._designed(self._bound(arguments, keywords))[0]

    def of(
        self,
        result: Any,
        *arguments: Any,
        allow_code: bool = False,
        threads: int | None = None,
        **options: Any,
    ) -> xr.Dataset:
        """The study of a result of members that exist, also of a run that has not ended; of tasks
        that of the path of a run directory.

        arguments, options : as of the study, without what new members need
        allow_code : whether to run the Python files of a user's own parts

        Raises OptionError for a result that cannot be studied, SceneError for code that is not
        allowed, and as the study.
        """
        known = [one.name for one in self._arguments() if not one.is_new]
        self._refuse_unknown(options, known)
        asked = self.options.read({**dict(zip(known, arguments, strict=False)), **options})
        return self.work.stored(self.name, result, asked, threads, allow_code)

    def draw(self, dataset: xr.Dataset, **options: Any) -> "Figure":
        """The picture of a study."""
        module = import_module(f"rigidmc.studies.{self.name}.picture")
        figure: Figure = getattr(module, self.picture)(dataset, **options)
        return figure

    def _designed(self, given: dict[str, Any]) -> tuple[Any, Options]:
        """(what `design` returns, the options) of bound arguments."""
        names = {one.name for one in self._arguments()}
        asked = {k: v for k, v in given.items() if k in names}
        scene = given.get("scene")
        if self.needs_scene or scene is not None:
            scene = as_scene(scene)
        settings = {k: v for k, v in given.items() if k not in (*names, "scene")}
        return self.designed(scene, asked, settings)

    def designed(
        self, scene: Scene | None, options: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> tuple[Any, Options]:
        """(what `design` returns, the options) of values by name."""
        for one in options_of(self.options):
            if one.missing and options.get(one.name) is None:
                raise OptionError(one.missing, at=one.name)
        read = self.options.read(options)
        if scene is None:
            for key, value in settings.items():
                raise OptionError("is for a scene, and none is given", at=key, value=value)
            return None, read
        return self.work.design(scene.with_run(**settings), read, settings), read

    def _arguments(self) -> list[Option]:
        """The options that the function has."""
        return [one for one in options_of(self.options) if one.in_function]

    def _bound(self, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> dict[str, Any]:
        """The arguments of a call by name; TypeError for those that there are not."""
        signature = inspect.signature(self)
        given: dict[str, Any] = dict(signature.bind(*arguments, **keywords).arguments)
        settings: dict[str, Any] = given.pop("settings", {})
        known = [name for name in signature.parameters if name != "settings"]
        self._refuse_unknown(settings, [*known, *Run.model_fields])
        return {**given, **settings}

    def _refuse_unknown(self, keywords: Mapping[str, Any], known: list[str]) -> None:
        for word in keywords:
            if word not in known:
                raise TypeError(no_such_keyword(self.name, word, known))

    def _signature(self) -> inspect.Signature:
        """(scene, options, *, threads, device, progress, **settings)"""
        kinds = inspect.Parameter
        default = kinds.empty if self.needs_scene else None
        made = [kinds("scene", kinds.POSITIONAL_OR_KEYWORD, default=default)]
        for one in self._arguments():
            default = one.default if one.is_optional else kinds.empty
            made.append(kinds(one.name, kinds.POSITIONAL_OR_KEYWORD, default=default))
        made += [kinds(name, kinds.KEYWORD_ONLY, default=None) for name in self.work.keywords]
        made.append(kinds("settings", kinds.VAR_KEYWORD))
        return inspect.Signature(made, return_annotation=xr.Dataset)

    def _parameters(self) -> str:
        """The section Parameters of the docstring."""
        optional = "" if self.needs_scene else ", optional"
        return "\n".join([
            "Parameters",
            "----------",
            parameter(f"scene : Scene or path_like{optional}", self.scene_text),
            *(one.documented() for one in self._arguments()),
            *(
                parameter(f"{name} : {kind}, optional", text)
                for name, (kind, text) in self.work.keywords.items()
            ),
            parameter("**settings : object", self.settings_text),
        ])  # fmt: skip
