"""A scene: body, effects, start and run settings, and what of them cannot be run."""

from dataclasses import dataclass, field, replace
from importlib.metadata import version
from numbers import Real
from typing import Any

import numpy as np

from rigidmc.effects import EFFECTS, canonical, name_of
from rigidmc.effects.parameters import numbers, shape
from rigidmc.effects.protocol import is_effect
from rigidmc.errors import SceneError, unknown
from rigidmc.integrators import INTEGRATORS
from rigidmc.observables import KNOWN, SUMMARIES, recorded, saved, summary_of, watched
from rigidmc.observables.keep import check_keep, kept, summaries
from rigidmc.observables.protocol import Ensemble
from rigidmc.scene.body import Body
from rigidmc.scene.checks import PILOT, check, check_histogram, limits, outside
from rigidmc.scene.laws.protocol import Law
from rigidmc.scene.quantities import Distribution, Grid, is_open, quantity, rows, vector
from rigidmc.scene.settings import Run, changed
from rigidmc.scene.start import Start


@dataclass(frozen=True, eq=False)
class Scene:
    """A body, what acts on it, how its members start, and how it is run.

    body : Body
    effects : effects such as Gravity(9.81); their parameters are numbers, distributions, or arrays with one row per member
    start : Start
    run : Run, the defaults of `simulate`
    title, summary, source : for people
    observables : those over all steps that have numbers of their own, such as Passage(axis=3, angle=0.5)

    Raises SceneError for effects that are none, or arrays of different lengths.
    """

    body: Body
    effects: tuple = ()
    start: Start = field(default_factory=lambda: Start(omega=(0.0, 0.0, 0.0)))
    run: Run = field(default_factory=Run)
    title: str = "scene"
    summary: str = ""
    source: str = ""
    observables: tuple = ()

    def __post_init__(self):
        for value, kind, key in (
            (self.body, Body, "body"),
            (self.start, Start, "start"),
            (self.run, Run, "run"),
        ):
            if not isinstance(value, kind):
                raise SceneError("", key, value, f"expected a {kind.__name__}")
        effects = (
            tuple(self.effects)
            if isinstance(self.effects, (list, tuple)) and not hasattr(self.effects, "_fields")
            else (self.effects,)
        )
        object.__setattr__(
            self, "effects", canonical(tuple(_effect(e, self.run.anti_damping) for e in effects))
        )
        object.__setattr__(self, "observables", _in_order(self.observables))
        rows(*self.quantities())

    def quantities(self):
        """All quantities that may differ from member to member."""
        return (
            self.body.quantities()
            + self.start.quantities()
            + tuple(value for e in self.effects for _, _, value in numbers(e))
        )

    def drawn_through(self):
        """Which library draws numbers of the scene whose bits may change with its version, in words; "" if it is rigidmc alone."""
        laws = any(isinstance(q, (Distribution, Law)) and q.by_scipy for q in self.quantities())
        if not laws and self.run.points not in ("sobol", "latin_hypercube"):
            return ""
        return f"through scipy {version('scipy')}: the bits are those of this version"

    def mapped(self, change):
        """The same scene with change(quantity) in the place of each number, distribution, grid and array of body, start and effects."""
        body = replace(
            self.body,
            **{k: _mapped(getattr(self.body, k), change) for k in ("moments", "mass", "centre")},
        )
        which = "omega" if self.start.momentum is None else "momentum"
        attitude = (
            self.start.attitude
            if isinstance(self.start.attitude, str)
            else _mapped(self.start.attitude, change)
        )
        start = replace(
            self.start, attitude=attitude, **{which: _mapped(getattr(self.start, which), change)}
        )
        return replace(
            self, body=body, start=start, effects=tuple(_mapped(e, change) for e in self.effects)
        )

    def coarse(self):
        """The same scene with coarser grids, such that its first PILOT members are spread over all of them; itself where it has none."""
        every = [q for q in self.quantities() if isinstance(q, Grid)]
        if not every:
            return self
        strides, made = sorted({g.stride for g in every}), {}
        share = max(1, int(PILOT ** (1.0 / len(strides)) + 1e-9))
        each = 1
        for stride in strides:
            made[stride] = (share, each)
            each *= share
        return self.mapped(
            lambda q: (
                replace(q, count=made[q.stride][0], stride=made[q.stride][1])
                if isinstance(q, Grid)
                else q
            )
        )

    def with_run(self, **settings):
        """The same scene with other run settings, see `changed`; those that are None stay as they are."""
        given = {k: v for k, v in settings.items() if v is not None}
        more = self.observables
        if "save" in given:
            save = (given["save"],) if isinstance(given["save"], str) else tuple(given["save"])
            built = tuple(one for one in save if hasattr(one, "_fields"))
            more += tuple(one for one in built if one not in more)
            words = (summary_of(one) if one in built else one for one in save)
            given["save"] = tuple(dict.fromkeys(words))
        run = changed(self.run, given)
        if run.integrator not in (*INTEGRATORS, "auto"):
            raise unknown("run", "integrator", run.integrator, "integrator", (*INTEGRATORS, "auto"))
        for name in run.save:
            if name not in KNOWN:
                raise unknown("run", "save", name, "observable", KNOWN)
            if (
                name in SUMMARIES
                and SUMMARIES[name]._fields
                and not any(summary_of(one) == name for one in more)
            ):
                missing = [
                    f for f in SUMMARIES[name]._fields if f not in SUMMARIES[name]._field_defaults
                ]
                if missing:
                    rule = f"needs a table [observables.{name}] with {', '.join(missing)}"
                    raise SceneError("run", "save", name, rule)
        check_keep(run.keep)
        return replace(self, run=run, observables=more)

    def saved(self):
        """Names of the observables that are recorded at save times."""
        return saved(self.run.save)

    def recorded(self):
        """Names of those, and of the observables that histograms need."""
        return recorded(self.run.save, self.observables)

    def kept(self):
        """{name: how much of it is kept} of the observables that are recorded at save times, see `rigidmc.observables.keep`."""
        return kept(self.run.keep, self.saved())

    def histograms(self):
        """[(label, Histogram)] of the scene."""
        return [(label, one) for label, one in self.watched() if isinstance(one, Ensemble)]

    def watched(self):
        """[(label, observable)] of those over all steps."""
        return watched((*self.run.save, *summaries(self.kept())), self.observables)

    def check(self):
        """The scene itself; raises SceneError for what of it cannot be run, see `rigidmc.scene.checks`."""
        self.with_run()
        check(self)
        return self

    @staticmethod
    def load(source, settings=(), allow_code=False):
        """A scene from a TOML file, the name of a shipped scene, or a result file (.nc); see `rigidmc.scene.file.load`."""
        from rigidmc.scene.file import load

        return load(source, settings, allow_code)

    @staticmethod
    def loads(text, file="scene"):
        """A scene from TOML text; `file` is named in errors."""
        from rigidmc.scene.file import loads

        return loads(text, file)

    def dumps(self):
        """The scene as TOML; arrays with one row per member become references to the variables of the result."""
        from rigidmc.scene.file import dumps

        return dumps(self)


def _mapped(value, change):
    """A quantity changed, or a tuple with each of its quantities changed."""
    if isinstance(value, tuple):
        made = [_mapped(x, change) for x in value]
        return type(value)(*made) if hasattr(value, "_fields") else tuple(made)
    if isinstance(value, Law):
        return replace(value, **{k: _mapped(v, change) for k, v in value.as_dict().items()})
    return change(value)


def _effect(effect: Any, driven: bool) -> Any:
    """An effect with its parameters checked."""
    if not is_effect(effect):
        raise SceneError(
            "effects",
            "effect",
            effect,
            f"expected an effect with its parameters, one of {', '.join(k.__name__ for k in EFFECTS.values())}",
        )
    table, made = f"effects.{name_of(effect)}", []
    for name, value in zip(effect._fields, effect, strict=True):
        size, (low, high) = shape(effect, name), limits(effect, name, driven)
        made.append(
            quantity(value, table, name) if size is None else vector(value, table, name, size)
        )
        for part in made[-1:] if size is None else made[-1]:
            if not is_open(part) and not (low <= np.min(part) and np.max(part) <= high):
                raise SceneError(
                    table,
                    name,
                    float(np.min(part) if np.min(part) < low else np.max(part)),
                    outside(effect, low, high),
                )
    return type(effect)(*made)


def _in_order(observables):
    """Observables over all steps with their numbers checked, in the order of SUMMARIES."""
    return tuple(
        sorted(
            map(_observable, observables), key=lambda one: list(SUMMARIES).index(summary_of(one))
        )
    )


def _observable(one):
    """An observable over all steps with its numbers checked."""
    if type(one) not in SUMMARIES.values():
        known = ", ".join(kind.__name__ for kind in SUMMARIES.values())
        raise SceneError(
            "observables", "observable", one, f"expected one of {known}, with its numbers"
        )
    counts = [
        k
        for k, kind in type(one).__annotations__.items()
        if kind is int and isinstance(getattr(one, k), Real)
    ]
    one = one._replace(
        **{k: int(v) for k in counts if not isinstance(v := getattr(one, k), bool) and v == v // 1}
    )  # 1e2 bins too
    one.check()
    if isinstance(one, Ensemble):
        check_histogram(one)
    return one
