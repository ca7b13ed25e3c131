"""The record of a study, which is also its function, with signature and docstring."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path
from rigidmc.planning.check import check_parts
from rigidmc.planning.saves import settle_saves
from rigidmc.scene.scene import Scene, as_scene
from rigidmc.scene.settings import Run, no_such_keyword
from rigidmc.studies.framework.options import NoOptions, Option, Options, options_of, parameter
from rigidmc.studies.framework.variables import StudyVariable, returned
from rigidmc.studies.framework.work import StudyWork

if TYPE_CHECKING:
    from matplotlib.figure import Figure


KEYWORDS = "threads", "device", "progress"  # keywords of the function, if its work has them


class Example(NamedTuple):
    """A study that takes a second, for the tests over all studies.

    scene : the name of a shipped scene
    options : of the study
    settings : of the run
    """

    scene: str
    options: Mapping[str, Any]
    settings: Mapping[str, Any]


class OutputFile(NamedTuple):
    """A file that the command of a study writes in addition to its Dataset and its picture.

    kind : name of these files, in the plural
    text : help of the option, a phrase without a full stop
    write : (dataset, path, force) -> whether the study has this file
    """

    kind: str
    text: str
    write: Callable[[xr.Dataset, Path, bool], bool]


@dataclass(frozen=True)
class Study:
    """A question about a scene; callable, as the function of its name.

    name : of the function and the folder; also of the command, unless `command` is given
    text : docstring of the function, with the lines `{parameters}` and `{returns}` in place of
        these sections
    options : the class of its options
    work : its computation: members of one scene, tasks, or a single function
    table : Dataset -> lines of text, or other objects that rich prints
    picture : name of the function in the folder's `picture.py`; it takes a Dataset and
        `picture_options`
    example : a small study, for the tests over all studies
    variables : of its Dataset
    settings : run settings of the command; None for all, or for none if the work is `Direct`
    settings_help : {setting: its meaning in this study}, where it differs from that in a run
    scene_text, settings_text : docstring texts of these parameters
    source : argument of the command other than a scene
    outcome : Dataset -> "done", "flagged" or "incomplete"; the command turns it into an exit code
    files : {option of the command: the additional file it writes}
    """

    name: str
    text: str
    options: type[Options]
    work: StudyWork
    table: Callable[[xr.Dataset], list[Any]]
    picture: str
    example: Example
    variables: tuple[StudyVariable, ...] = ()
    command: str = ""
    picture_options: type[Options] = NoOptions
    settings: tuple[str, ...] | None = None
    settings_help: Mapping[str, str] = field(default_factory=dict)
    scene_text: str = "a scene, its file, or the name of a shipped scene"
    settings_text: str = "run settings, as in `simulate`"
    source: str = "the result of an existing study"
    outcome: Callable[[xr.Dataset], str] = lambda dataset: "done"
    files: Mapping[str, OutputFile] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "command", self.command or self.name)
        text = inspect.cleandoc(self.text).replace("{parameters}", self._parameters())
        facts = {
            "__name__": self.name,
            "__qualname__": self.name,
            "__module__": f"rigidmc.studies.{self.name}.study",
            "__doc__": text.replace("{returns}", returned(self.variables)),
            "__signature__": self._signature(),
        }
        for name, value in facts.items():  # attributes that `help`, `inspect` and Sphinx read
            object.__setattr__(self, name, value)

    def __call__(self, *arguments: Any, **keywords: Any) -> xr.Dataset:
        """Compute the study of a scene, as described in the docstring of the study."""
        values = self._bound(arguments, keywords)
        threads, device, progress = (values.pop(name, None) for name in KEYWORDS)
        design, options = self._designed(values)
        return self.work.compute(design, options, threads, device, progress)

    def design(self, *arguments: Any, **keywords: Any) -> Any:
        """Return the scene with the members of the study; for tasks, (scene, request). It
        takes the arguments of the study."""
        return self._designed(self._bound(arguments, keywords))[0]

    def of(
        self,
        result: Any,
        *arguments: Any,
        allow_code: bool = False,
        threads: int | None = None,
        **options: Any,
    ) -> xr.Dataset:
        """Return the study of an existing result, even of an unfinished run; for tasks, `result`
        is the path of a run directory.

        arguments, options : as in the study, without the options that define new members
        allow_code : whether to run the Python files of custom effects, observables, ...

        Raises OptionError for a result that cannot be studied, SceneError for code that is not
        allowed, and the errors of the study.
        """
        names = [option.name for option in self._arguments() if not option.is_new]
        self._refuse_unknown(options, names)
        asked = self.options.read({**dict(zip(names, arguments, strict=False)), **options})
        return self.work.stored(self.name, result, asked, threads, allow_code)

    def draw(self, dataset: xr.Dataset, **options: Any) -> "Figure":
        """Draw the picture of a study."""
        module = import_module(f"rigidmc.studies.{self.name}.picture")
        figure: Figure = getattr(module, self.picture)(dataset, **options)
        return figure

    def _designed(self, values: dict[str, Any]) -> tuple[Any, Options]:
        """Return (result of `design`, options) for bound arguments."""
        names, scene = {option.name for option in self._arguments()}, values.pop("scene", None)
        if self.work.needs_scene or scene is not None:
            scene = as_scene(scene)
        asked = {key: values.pop(key) for key in names & set(values)}
        return self.designed(scene, asked, values)

    def designed(
        self, scene: Scene | None, options: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> tuple[Any, Options]:
        """Return (result of `design`, options) for values by name."""
        for option in options_of(self.options):
            if option.missing and options.get(option.name) is None:
                raise OptionError(option.missing, at=option.name)
        read = self.options.read(options)
        if scene is None:
            for key, value in settings.items():
                raise OptionError("requires a scene, and none is given", at=key, value=value)
            return None, read
        check_parts(scene)  # saves per turn evaluate custom effects, and so does linearise
        changed = settle_saves(scene.with_run(**settings, wrt=()))  # a study reads values alone
        if settings.get("every") is not None:
            settings = {**settings, "every": changed.run.every}
        return self.work.design(changed, read, settings), read

    def _arguments(self) -> list[Option]:
        """Return the options that the function has."""
        return [option for option in options_of(self.options) if option.in_function]

    def _bound(self, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> dict[str, Any]:
        """Return the arguments of a call by name; TypeError for unknown ones."""
        signature = inspect.signature(self)
        values: dict[str, Any] = dict(signature.bind(*arguments, **keywords).arguments)
        settings: dict[str, Any] = values.pop("settings", {})
        # a study evaluates values: it has no place for derivatives
        of_run = [name for name in Run.model_fields if name != "wrt"]
        self._refuse_unknown(settings, [*list(signature.parameters)[:-1], *of_run])
        return {**values, **settings}

    def _refuse_unknown(self, keywords: Mapping[str, Any], names: list[str]) -> None:
        for word in keywords:
            if word not in names:
                raise TypeError(no_such_keyword(self.name, word, names))

    def _signature(self) -> inspect.Signature:
        """(scene, options, *, threads, device, progress, **settings)"""
        kinds = inspect.Parameter
        default = kinds.empty if self.work.needs_scene else None
        made = [kinds("scene", kinds.POSITIONAL_OR_KEYWORD, default=default)]
        for option in self._arguments():
            default = option.default if option.is_optional else kinds.empty
            made.append(kinds(option.name, kinds.POSITIONAL_OR_KEYWORD, default=default))
        made += [kinds(name, kinds.KEYWORD_ONLY, default=None) for name in self.work.keywords]
        made.append(kinds("settings", kinds.VAR_KEYWORD))
        return inspect.Signature(made, return_annotation=xr.Dataset)

    def _parameters(self) -> str:
        """Return the section Parameters of the docstring."""
        optional = "" if self.work.needs_scene else ", optional"
        return "\n".join([
            "Parameters",
            "----------",
            parameter(f"scene : Scene or path_like{optional}", self.scene_text),
            *(option.documented() for option in self._arguments()),
            *(
                parameter(f"{name} : {kind}, optional", text)
                for name, (kind, text) in self.work.keywords.items()
            ),
            parameter("**settings : object", self.settings_text),
        ])  # fmt: skip
