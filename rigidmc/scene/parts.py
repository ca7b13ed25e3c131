"""The parts of a scene: a body, what acts on it, how its members start, and how it is run."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import Any, Self

from rigidmc.errors import SceneError, unknown
from rigidmc.physics.dynamics.methods import word_of
from rigidmc.physics.effects import canonical
from rigidmc.physics.effects.protocol import is_effect, numbers
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.observables import (
    OBSERVABLES,
    is_observable,
    named,
    recorded,
    saved,
    under,
    watched,
    word_of_observable,
)
from rigidmc.physics.observables.histogram import Histogram
from rigidmc.physics.observables.keep import check_keep, kept, summaries
from rigidmc.physics.observables.protocol import Ensemble
from rigidmc.scene.body import Body
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.once import KEPT
from rigidmc.scene.quantities import Grid, rows
from rigidmc.scene.settings import Run, changed
from rigidmc.scene.start import Start
from rigidmc.scene.validation import (
    PILOT,
    check_histogram,
    check_saved,
    checked_effect,
    checked_observable,
    named_integrators,
    place,
)
from rigidmc.scene.vector_distributions.protocol import Law

Change = Callable[[Any], Any]
_CURES = {
    "body": ", such as rm.Body((1.0, 2.0, 2.5)); rm.Scene.load takes files and names",
    "start": ", such as rm.Start(omega=(0.0, 0.0, 1.0))",
    "run": ", such as rm.Run(dt=0.01, t_end=10.0)",
}


@dataclass(frozen=True, eq=False)
class Parts:
    """A body, what acts on it, how its members start, and how it is run.

    Parameters
    ----------
    body : Body
        the rigid body
    effects : tuple of effects, optional
        such as Gravity(9.81); their parameters are numbers, distributions, grids, or arrays with
        one row per member
    start : Start, optional
        by default at rest
    run : Run, optional
        the defaults of `simulate`
    title : str, optional
        text for people
    summary : str, optional
        text for people
    source : str, optional
        text for people
    observables : tuple of observables, optional
        those over all steps that have parameters, such as Passage(axis=3, angle=0.5), and those of
        your own
    integrators : tuple of integrators, optional
        of your own, which `run.integrator` and studies may name

    Raises
    ------
    SceneError
        for a value that is no effect, and for arrays of different lengths

    Examples
    --------
    >>> body = rm.Body.cylinder(1.0, 0.1, 0.4).pivoted_at((0.0, 0.0, -0.2))
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
                raise SceneError("", key, value, f"expected a {kind.__name__}{_CURES[key]}")
        several = isinstance(self.effects, (list, tuple)) and not is_effect(self.effects)
        effects: Iterable[Any] = self.effects if several else (self.effects,)
        effects = canonical(tuple(checked_effect(e, self.run.anti_damping) for e in effects))
        alone = not isinstance(self.observables, (list, tuple)) or is_observable(self.observables)
        given: Iterable[Any] = (self.observables,) if alone else self.observables
        observables = sorted(map(checked_observable, given), key=place)
        for one in observables:
            if isinstance(one, Histogram):
                check_histogram(one, observables)
        object.__setattr__(self, "effects", effects)
        object.__setattr__(self, "observables", tuple(observables))
        own = named_integrators(self.integrators)
        object.__setattr__(self, "integrators", tuple(own.values()))
        rows(*self.quantities())

    def __getstate__(self) -> dict[str, Any]:
        """What a pickle or a copy has: without what `once` keeps."""
        return {key: value for key, value in vars(self).items() if key != KEPT}

    def quantities(self) -> tuple[Any, ...]:
        """All quantities that may differ from member to member.

        Returns
        -------
        tuple
            numbers, distributions, grids, arrays and laws of body, start and effects

        Examples
        --------
        >>> rm.Scene(rm.Body((1.0, 2.0, 3.0)), rm.Gravity(9.81)).quantities()[-1]
        9.81
        """
        parameters = (value for effect in self.effects for _, _, value in numbers(effect))
        return (*self.body.quantities(), *self.start.quantities(), *parameters)

    def rows_to_run(self) -> int | None:
        """The number of members that arrays with one row per member leave to run.

        Returns
        -------
        int or None
            None without such arrays, or if the scene has a number of members of its own

        Examples
        --------
        >>> body = rm.Body(np.array([[1.0, 2.0, 2.5], [1.0, 1.5, 2.0]]))
        >>> rm.Scene(body).rows_to_run()
        2
        """
        count = rows(*self.quantities())
        if count is None or "members" in self.run.model_fields_set:
            return None
        return count - self.run.first

    def drawn_through(self) -> str:
        """The library that draws numbers of the scene whose bits may change with its version.

        Returns
        -------
        str
            in words; "" if rigidmc alone draws them

        Examples
        --------
        >>> rm.Scene.load("dzhanibekov").drawn_through()
        ''
        """
        laws = any(isinstance(q, (Distribution, Law)) and q.by_scipy for q in self.quantities())
        if not laws and self.run.points not in ("sobol", "latin_hypercube"):
            return ""
        return f"through scipy {version('scipy')}: the bits are those of this version"

    def mapped(self, change: Change) -> Self:
        """Make the same scene with other quantities of body, start and effects.

        Parameters
        ----------
        change : callable
            function of a quantity that returns the one to put in its place

        Returns
        -------
        Scene
            the changed scene

        Examples
        --------
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), rm.Gravity(9.81))
        >>> scene.mapped(lambda q: 2.0 * q if q == 9.81 else q).effects
        (Gravity(g=19.62),)
        """
        parts = {
            key: _mapped(getattr(self.body, key), change) for key in ("moments", "mass", "centre")
        }
        start, which = self.start, self.start.which
        words = isinstance(start.attitude, str)
        starts = {
            which: _mapped(getattr(start, which), change),
            "attitude": start.attitude if words else _mapped(start.attitude, change),
        }
        return replace(
            self,
            body=replace(self.body, **parts),
            start=replace(start, **starts),
            effects=tuple(_mapped(effect, change) for effect in self.effects),
        )

    def coarse(self) -> Self:
        """Make the same scene with coarser grids.

        Its first PILOT members are spread over all members.

        Returns
        -------
        Scene
            the scene with coarser grids; the scene itself if it has no grids

        Examples
        --------
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)))
        >>> scene.coarse() is scene
        True
        """
        strides = sorted({q.stride for q in self.quantities() if isinstance(q, Grid)})
        if not strides:
            return self
        share = max(1, int(PILOT ** (1.0 / len(strides)) + 1e-9))
        coarser = {stride: share**i for i, stride in enumerate(strides)}

        def change(q: Any) -> Any:
            return replace(q, count=share, stride=coarser[q.stride]) if isinstance(q, Grid) else q

        return self.mapped(change)

    def with_run(self, **settings: Any) -> Self:
        """Make the same scene with other run settings.

        Parameters
        ----------
        **settings : object
            of `Run`; those that are None stay as they are. `save` may name observables, or contain
            them: Passage(axis=3, angle=0.5), or one of your own, and so may `integrator`

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
            alone = isinstance(given["save"], str) or is_observable(given["save"])
            save = (given["save"],) if alone else tuple(given["save"])
            for one in save:
                # tuples of two classes are equal if their numbers are
                same = any(type(one) is type(other) and one == other for other in observables)
                named_alone = isinstance(one, str) or type(one) in OBSERVABLES.values()
                observables += () if named_alone or same else (one,)
            words = (one if isinstance(one, str) else word_of_observable(one) for one in save)
            given["save"] = tuple(dict.fromkeys(words))
        scene = self
        if not isinstance(given.get("integrator", ""), str):
            scene, (given["integrator"],) = self.with_integrators([given["integrator"]])
        run, integrators = changed(self.run, given), (*scene.known_integrators(), "auto")
        if run.integrator not in integrators:
            raise unknown("run", "integrator", run.integrator, "integrator", integrators)
        check_saved(run.save, observables)
        check_keep(run.keep, observables)
        return replace(scene, run=run, observables=observables)

    def with_integrators(self, given: Iterable[Any]) -> tuple[Self, list[str]]:
        """Make the same scene with integrators of your own beside those that it has.

        Parameters
        ----------
        given : iterable of str or integrators
            names stay as they are; an integrator takes the place of another one of its name

        Returns
        -------
        Scene
            the scene
        list of str
            the names of all that are given

        Raises
        ------
        SceneError
            for what is no integrator

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
        """The integrators that the scene may name.

        Returns
        -------
        dict
            {name: integrator}, those of your own last

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

    def saved(self) -> tuple[str, ...]:
        """The names of the observables that are recorded at save times.

        Returns
        -------
        tuple of str
            names

        Examples
        --------
        >>> rm.Scene(rm.Body((1.0, 2.0, 2.5))).with_run(save=("energy", "flips")).saved()
        ('energy',)
        """
        return saved(self.run.save, self.observables)

    def observable(self, name: str) -> Any:
        """The observable at save times of a name, shipped or of your own.

        Parameters
        ----------
        name : str
            as `saved` has it

        Returns
        -------
        observable
            with its numbers

        Examples
        --------
        >>> rm.Scene(rm.Body((1.0, 2.0, 2.5))).observable("omega").units
        'rad s-1'
        """
        return named(self.observables, name)

    def recorded(self) -> dict[str, Any]:
        """The saved observables, and those that histograms need, as they are compiled.

        Returns
        -------
        dict of str
            {name: observable}

        Examples
        --------
        >>> spins = rm.Histogram("omega[3]", low=-1.0, high=1.0)
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), observables=(spins,))
        >>> list(scene.with_run(save=("energy", "histogram")).recorded())
        ['energy', 'omega']
        """
        found = recorded(self.run.save, self.observables)
        return {name: under(one, self.effects) for name, one in found.items()}

    def kept(self) -> dict[str, str]:
        """How much is kept of each saved observable, see `rigidmc.physics.observables.keep`.

        Returns
        -------
        dict of str
            {name: how much}

        Examples
        --------
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5))).with_run(save=("energy",), keep="final")
        >>> scene.kept()
        {'energy': 'final'}
        """
        return kept(self.run.keep, self.saved(), self.observables)

    def histograms(self) -> list[tuple[str, Any]]:
        """The counts over all members that the scene takes.

        Returns
        -------
        list of (str, observable)
            labels and observables

        Examples
        --------
        >>> spins = rm.Histogram("omega[3]", low=-1.0, high=1.0)
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), observables=(spins,))
        >>> [label for label, _ in scene.with_run(save=("histogram",)).histograms()]
        ['histogram']
        """
        return [(label, one) for label, one in self.watched() if isinstance(one, Ensemble)]

    def watched(self) -> list[tuple[str, Any]]:
        """The observables over all steps.

        Returns
        -------
        list of (str, observable)
            labels and observables

        Examples
        --------
        >>> scene = rm.Scene(rm.Body((1.0, 2.0, 2.5))).with_run(save=("energy", "flips"))
        >>> [label for label, _ in scene.watched()]
        ['flips']
        """
        return watched((*self.run.save, *summaries(self.kept())), self.observables)


def _mapped(value: Any, change: Change) -> Any:
    """A quantity changed, or a law, an effect or a tuple with each of its quantities changed."""
    if isinstance(value, Law):
        return replace(value, **{k: _mapped(v, change) for k, v in value.as_dict().items()})
    if isinstance(value, tuple):
        parts = [_mapped(x, change) for x in value]
        return type(value)(*parts) if is_effect(value) else tuple(parts)
    return change(value)
