"""The parts of a scene: body, effects, start, and run settings."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Self

from rigidmc.errors import SceneError, unknown
from rigidmc.inputs.amounts import words_of
from rigidmc.physics.dynamics.methods import word_of
from rigidmc.physics.effects import canonical
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.observables import (
    OBSERVABLES,
    is_observable,
    word_of_observable,
)
from rigidmc.physics.observables.histogram import Histogram
from rigidmc.physics.observables.saving import check_keep
from rigidmc.scene.body import Body
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import count_rows
from rigidmc.scene.settings import Run, with_changes
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import check_orbit
from rigidmc.scene.validation import (
    check_effect,
    check_histogram,
    check_observable,
    check_saved_names,
    named_integrators,
    observable_order,
)

_CURES = {
    "body": ", such as rm.Body((1.0, 2.0, 2.5)); use rm.Scene.load for files and names",
    "start": ", such as rm.Start(omega=(0.0, 0.0, 1.0))",
    "run": ", such as rm.Run(dt=0.01, t_end=10.0)",
}


# {attribute of a scene before 1.0: its replacement}
_RECORDING = "rm.prepare(scene).layout.recording has it"
_GONE = {
    "check": "rm.prepare(scene) checks it",
    "coarse": "scene.model.coarse() has it",
    "mapped": "scene.model.mapped(change) has it",
    "saved": "rm.prepare(scene).layout.recording.names has it",
    "kept": "rm.prepare(scene).layout.recording.retained has it",
    "recorded": _RECORDING,
    "watched": "rm.prepare(scene).layout.recording.monitored has it",
    "histograms": _RECORDING,
    "observable": _RECORDING,
    "quantities": "scene.model.quantities() has them",
    "rows_to_run": "rm.prepare(scene).members.size is the number of members",
    "drawn_through": 'results have it as the attribute "drawn"',
}


@dataclass(frozen=True, eq=False)
class Parts:
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
        given: Iterable[Any] = (self.observables,) if alone else self.observables
        observables = sorted(map(check_observable, given), key=observable_order)
        for one in observables:
            if isinstance(one, Histogram):
                check_histogram(one, observables)
        object.__setattr__(self, "effects", effects)
        object.__setattr__(self, "observables", tuple(observables))
        own = named_integrators(self.integrators)
        object.__setattr__(self, "integrators", tuple(own.values()))
        check_orbit(self.start.relative_to_orbit, effects)
        count_rows(*self.model.quantities())

    def __getattr__(self, name: str) -> Any:
        """Raise AttributeError; for a removed attribute it names the replacement."""
        if name in _GONE:
            raise AttributeError(f"Scene.{name} was removed: {_GONE[name]}")
        raise AttributeError(f"'Scene' object has no attribute '{name}'")

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
        given = {k: v for k, v in settings.items() if v is not None}
        observables = self.observables
        if "save" in given:
            save: Any = given["save"]
            save = words_of(save) if isinstance(save, str) else save
            for one in (save := (save,) if is_observable(save) else tuple(save)):
                # tuples of different classes are equal if their numbers are
                same = any(type(one) is type(other) and one == other for other in observables)
                named_alone = isinstance(one, str) or type(one) in OBSERVABLES.values()
                observables += () if named_alone or same else (one,)
            words = (one if isinstance(one, str) else word_of_observable(one) for one in save)
            given["save"] = tuple(dict.fromkeys(words))
        scene = self
        if not isinstance(given.get("integrator", ""), str):
            scene, (given["integrator"],) = self.with_integrators([given["integrator"]])
        run, integrators = with_changes(self.run, given), (*scene.known_integrators(), "auto")
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
        own = named_integrators(one for one in given if not isinstance(one, str))
        names = [one if isinstance(one, str) else word_of(type(one)) for one in given]
        if not own:
            return self, names
        more = {**named_integrators(self.integrators), **own}
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
