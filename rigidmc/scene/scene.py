"""Scenes: made in Python or loaded from a file, checked, and written as text."""

import functools
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import numpy as np

from rigidmc.errors import FileError, PartError, RigidmcError, SceneError, in_file, unknown
from rigidmc.files.kinds import another_kind
from rigidmc.files.opening import is_zarr
from rigidmc.inputs.amounts import words_of
from rigidmc.physics.dynamics.methods import word_of
from rigidmc.physics.effects import EFFECTS, canonical
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.observables import bare_observables, is_observable, is_own, word_of_observable
from rigidmc.physics.observables.histogram import Histogram
from rigidmc.physics.observables.saving import check_keep
from rigidmc.scene.body import Body
from rigidmc.scene.library import read_source
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.recording import Recording, make_recording
from rigidmc.scene.sampling import rows_to_run
from rigidmc.scene.settings import Run, with_changes
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import check_orbit
from rigidmc.scene.toml.read import Settings, locate_source, read_parts
from rigidmc.scene.toml.write import dumps
from rigidmc.scene.user_parts.registry import Classes, code_of
from rigidmc.scene.validation import (
    check_effect,
    check_histogram,
    check_observable,
    check_saved_names,
    named_integrators,
    observable_order,
)
from rigidmc.scene.vector_distributions import VECTOR_DISTRIBUTIONS
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

if TYPE_CHECKING:
    import xarray as xr

_CURES = {
    "body": ", such as rm.Body((1.0, 2.0, 2.5)); use rm.Scene.load for files and names",
    "start": ", such as rm.Start(omega=(0.0, 0.0, 1.0))",
    "run": ", such as rm.Run(dt=0.01, t_end=10.0)",
}


# {attribute of a scene before 1.0: its replacement}
_RECORDING = "scene.recording has it"
_GONE = {
    "check": "rm.prepare(scene) checks it",
    "coarse": "scene.model.coarse() has it",
    "mapped": "scene.model.mapped(change) has it",
    "saved": "scene.recording.names has it",
    "kept": "scene.recording.retained has it",
    "recorded": _RECORDING,
    "watched": "scene.recording.monitored has it",
    "histograms": _RECORDING,
    "observable": _RECORDING,
    "quantities": "scene.model.quantities() has them",
    "rows_to_run": "rm.prepare(scene).members.size is the number of members",
    "drawn_through": 'results have it as the attribute "drawn"',
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A body, the effects that act on it, the start of its members, and the run settings.

    Parameters
    ----------
    body : Body
        the rigid body
    effects : tuple of effects, optional
        such as Gravity(9.81); their parameters are numbers, distributions, grids, or arrays with
        one row per member
    start : Start, optional
        start of the members; by default at rest
    run : Run, optional
        run settings, the defaults of `simulate`
    title : str, optional
        title, for readers
    summary : str, optional
        summary, for readers
    source : str, optional
        literature source, for readers
    observables : tuple of observables, optional
        running observables with parameters, such as Passage(axis=3, angle=0.5), and custom
        observables
    integrators : tuple of integrators, optional
        custom integrators, which `run.integrator` and studies may name

    Raises
    ------
    SceneError
        for a value that is not an effect, and for arrays of different lengths

    Examples
    --------
    >>> body = rm.Body.cylinder(1.0, 0.1, 0.4).with_pivot((0.0, 0.0, -0.2))
    >>> start = rm.Start(omega=(0.0, 0.0, rm.normal(200.0, 1.0)), attitude=(0.0, 0.3, 0.0))
    >>> scene = rm.Scene(body, rm.Gravity(9.81), start, rm.Run(t_end=2.0, dt=1e-3))
    """

    body: Body
    effects: tuple[Any, ...] = ()
    start: Start = field(default_factory=lambda: Start(omega=(0.0, 0.0, 0.0)))
    run: Run = field(default_factory=Run)
    title: str = "scene"
    summary: str = ""
    source: str = ""
    observables: tuple[Any, ...] = ()
    integrators: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        for key, kind in (("body", Body), ("start", Start), ("run", Run)):
            value = getattr(self, key)
            if not isinstance(value, kind):
                raise SceneError(f"expected a {kind.__name__}{_CURES[key]}", at=key, value=value)
        several = isinstance(self.effects, (list, tuple)) and not hasattr(self.effects, "_fields")
        effects: Iterable[Any] = self.effects if several else (self.effects,)
        effects = canonical(tuple(check_effect(e, self.run.anti_damping) for e in effects))
        alone = not isinstance(self.observables, (list, tuple)) or is_observable(self.observables)
        parts: Iterable[Any] = (self.observables,) if alone else self.observables
        observables = sorted(map(check_observable, parts), key=observable_order)
        for observable in observables:
            if isinstance(observable, Histogram):
                check_histogram(observable, observables)
        object.__setattr__(self, "effects", effects)
        object.__setattr__(self, "observables", tuple(observables))
        integrators = named_integrators(self.integrators)
        object.__setattr__(self, "integrators", tuple(integrators.values()))
        check_orbit(self.start.relative_to_orbit, effects)
        count_rows(*self.model.quantities())

    def __getattr__(self, name: str) -> Any:
        """Raise AttributeError; for a removed attribute it names the replacement."""
        if name in _GONE:
            raise AttributeError(f"Scene.{name} was removed: {_GONE[name]}")
        raise AttributeError(f"'Scene' object has no attribute '{name}'")

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

    def dumps(self, run: Run | None = None) -> str:
        """Write the scene as TOML text.

        Arrays with one row per member become references to variables of the result.

        Parameters
        ----------
        run : Run, optional
            settings that replace the scene's

        Returns
        -------
        str
            the text, which `loads` reads

        Examples
        --------
        >>> print(rm.Scene(rm.Body((1.0, 2.0, 3.0)), title="brick").dumps()[:15])
        title = "brick"
        """
        texts = {"title": self.title, "summary": self.summary, "source": self.source}
        return dumps(texts, self.model, self.observables, self.integrators, run or self.run)

    @property
    def recording(self) -> Recording:
        """The saved, retained and monitored variables of a run.

        Examples
        --------
        >>> rm.Scene.load("heavy_top").recording.names
        ('omega', 'attitude', 'energy')
        """
        return make_recording(self.run, self.observables, self.effects)

    @property
    def user_parts(self) -> tuple[Any, ...]:
        """The custom effects, observables, integrators and distributions.

        Examples
        --------
        >>> rm.Scene.load("heavy_top").user_parts
        ()
        """
        effects = (e for e in self.effects if type(e) not in EFFECTS.values())
        laws = (q for q in self.model.quantities() if isinstance(q, VectorDistribution))
        others = (law for law in laws if type(law) not in VECTOR_DISTRIBUTIONS)
        return (*effects, *filter(is_own, self.observables), *self.integrators, *others)

    @property
    def model(self) -> Model:
        """Body, effects and start, without the run settings.

        Examples
        --------
        >>> rm.Scene.load("heavy_top").model.effects
        (Gravity(g=9.81),)
        """
        return Model(self.body, self.effects, self.start)

    def with_model(self, model: Model) -> Self:
        """Make the same scene with another body, other effects and another start.

        Parameters
        ----------
        model : Model
            body, effects and start

        Returns
        -------
        Scene
            the scene

        Examples
        --------
        >>> scene = rm.Scene.load("heavy_top")
        >>> moon = scene.model._replace(effects=(rm.Gravity(1.62),))
        >>> scene.with_model(moon).effects
        (Gravity(g=1.62),)
        """
        return replace(self, **model._asdict())

    def with_run(self, **settings: Any) -> Self:
        """Make the same scene with other run settings.

        Parameters
        ----------
        **settings : object
            settings of `Run`; None leaves a setting unchanged. `save` may contain names of
            observables or observables, such as Passage(axis=3, angle=0.5) or a custom one;
            `integrator` may also be a name or a custom integrator

        Returns
        -------
        Scene
            the scene

        Raises
        ------
        SceneError
            for an unknown setting or a value that it cannot have

        See Also
        --------
        Run : the settings.

        Examples
        --------
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5))).with_run(dt=1e-3, t_end="1h")
        >>> scene.run.t_end
        3600.0
        """
        changes = {k: v for k, v in settings.items() if v is not None}
        observables = self.observables
        if "save" in changes:
            save: Any = changes["save"]
            save = words_of(save) if isinstance(save, str) else save
            for part in (save := (save,) if is_observable(save) else tuple(save)):
                # tuples of different classes are equal if their numbers are
                same = any(type(part) is type(other) and part == other for other in observables)
                bare = type(part) in bare_observables().values()
                observables += () if isinstance(part, str) or bare or same else (part,)
            words = (part if isinstance(part, str) else word_of_observable(part) for part in save)
            changes["save"] = tuple(dict.fromkeys(words))
        scene = self
        if not isinstance(changes.get("integrator", ""), str):
            scene, (changes["integrator"],) = self.with_integrators([changes["integrator"]])
        run, integrators = with_changes(self.run, changes), (*scene.known_integrators(), "auto")
        if run.integrator not in integrators:
            raise unknown("integrator", integrators, at="run.integrator", value=run.integrator)
        check_saved_names(run.save, observables)
        check_keep(run.keep, observables)
        return replace(scene, run=run, observables=observables)

    def with_integrators(self, given: Iterable[Any]) -> tuple[Self, list[str]]:
        """Add custom integrators to the scene.

        Parameters
        ----------
        given : iterable of str or integrators
            names are returned unchanged; an integrator replaces another one with its name

        Returns
        -------
        Scene
            the scene
        list of str
            the names of all given integrators

        Raises
        ------
        SceneError
            for an object that is not an integrator

        Examples
        --------
        >>> rm.Scene(rm.Body((1.0, 2.0, 2.5))).with_integrators(["rk4"])[1]
        ['rk4']
        """
        given = list(given)
        integrators = named_integrators(part for part in given if not isinstance(part, str))
        names = [part if isinstance(part, str) else word_of(type(part)) for part in given]
        if not integrators:
            return self, names
        more = {**named_integrators(self.integrators), **integrators}
        return replace(self, integrators=tuple(more.values())), names

    def known_integrators(self) -> dict[str, Integrator]:
        """Return the integrators that the scene may name.

        Returns
        -------
        dict
            {name: integrator}, custom integrators last

        Examples
        --------
        >>> list(rm.Scene(rm.Body((1.0, 2.0, 2.5))).known_integrators())[0]
        'rk4'
        """
        return {**INTEGRATORS, **named_integrators(self.integrators)}

    @property
    def integrator(self) -> Integrator:
        """The integrator that the scene names.

        Examples
        --------
        >>> rm.Scene(rm.Body((1.0, 2.0, 2.5))).integrator.order
        4
        """
        return self.known_integrators()[self.run.integrator]


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
    code = code_of(source) if allow_code is False else allow_code
    file = source.encoding.get("source", "result")
    return loads(scene_text(source), file, settings, stored_rows(source), allow_code=code)
