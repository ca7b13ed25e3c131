"""A scene: body, effects, start and run settings; one TOML file. Scene files hold data and execute nothing."""

import os
import tomllib
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rigidmc.body import IDENTITY, Body, broken
from rigidmc.effects import EFFECTS, canonical, name_of
from rigidmc.errors import SceneError, nearest, unknown
from rigidmc.integrators import INTEGRATORS
from rigidmc.observables import OBSERVABLES
from rigidmc.sampling import Distribution, Start, distribution, draw, quantity, rows

PILOT = (
    4096  # members whose sampled values are looked at before a run; always the same ones, so that bits do not depend on `members`
)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Run(_Table):
    """How a scene is run; every setting can be overridden by `simulate` and on the command line."""

    integrator: str = "rk4"
    dt: Annotated[float, Field(gt=0, description="step [s]")] = 0.01
    t_end: Annotated[float, Field(gt=0, description="end time [s]")] = 10.0
    members: Annotated[int, Field(gt=0, description="members of the ensemble")] = 1000
    first: Annotated[int, Field(ge=0, description="index of the first member")] = 0
    seed: Annotated[int, Field(ge=0, description="seed of all random draws")] = 0
    every: Annotated[float, Field(gt=0, description="time between saves [s]; without it first and last")] | None = None
    save: tuple[str, ...] = ("omega",)


class _File(_Table):
    """The tables of a scene file; what is inside body, effects and start is checked by Body, Effect and Start themselves."""

    title: str = ""
    summary: str = ""
    source: str = ""
    body: dict[str, Any]
    effects: dict[str, Any] = {}
    start: dict[str, Any]
    run: dict[str, Any] = {}


_SHAPES: dict[str, Any] = {  # ways to give a body in a scene file: key -> (its own keys, maker)
    "moments": None,
    "tensor": None,
    "cylinder": (("mass", "radius", "height"), Body.cylinder),
    "box": (("mass", "size"), Body.box),
    "particles": (("masses", "positions"), Body.from_particles),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A body, what acts on it, how its members start, and how it is run.

    body : Body
    effects : effects such as Gravity(9.81); their parameters are numbers, distributions, or arrays with one row per member
    start : Start
    run : Run, the defaults of `simulate`
    title, summary, source : for people

    Raises SceneError for effects that are none, or arrays of different lengths.
    """

    body: Body
    effects: tuple = ()
    start: Start = field(default_factory=lambda: Start(omega=(0.0, 0.0, 0.0)))
    run: Run = field(default_factory=Run)
    title: str = "scene"
    summary: str = ""
    source: str = ""

    def __post_init__(self):
        for value, kind, key in ((self.body, Body, "body"), (self.start, Start, "start"), (self.run, Run, "run")):
            if not isinstance(value, kind):
                raise SceneError("", key, value, f"expected a {kind.__name__}")
        effects = (
            tuple(self.effects)
            if isinstance(self.effects, (list, tuple)) and not hasattr(self.effects, "_fields")
            else (self.effects,)
        )
        object.__setattr__(self, "effects", canonical(tuple(_effect(e) for e in effects)))
        rows(*self.quantities())

    def quantities(self):
        """All quantities that may differ from member to member."""
        return self.body.quantities() + self.start.quantities() + tuple(v for e in self.effects for v in e)

    def with_run(self, **settings):
        """The same scene with other run settings; those that are None stay as they are."""
        given = {k: v for k, v in settings.items() if v is not None}
        try:
            run = Run.model_validate({**self.run.model_dump(), **given})
        except ValidationError as error:
            raise _from_pydantic(error, "run", Run, given) from None
        if run.integrator not in INTEGRATORS:
            raise unknown("run", "integrator", run.integrator, "integrator", INTEGRATORS)
        for name in run.save:
            if name not in OBSERVABLES:
                raise unknown("run", "save", name, "observable", OBSERVABLES)
        return replace(self, run=run)

    def check(self):
        """Raise SceneError for what cannot be run: refused torques, sampled bodies that cannot be, too few rows."""
        self.with_run()
        integrator = INTEGRATORS[self.run.integrator]
        if integrator.accepts == "no torque" and self.effects:
            names = ", ".join(name_of(e) for e in self.effects)
            rule = f"it is the motion of a free body and takes no torque, but the scene has {names}; use strang or rk4"
            raise SceneError("run", "integrator", self.run.integrator, rule)
        count = rows(*self.quantities())
        if count is not None and count < self.run.first + self.run.members:
            rule = f"the scene has arrays with rows for {count} members only"
            raise SceneError("run", "members", self.run.first + self.run.members, rule)
        moments, mass, _ = self.body.sample(self.run.seed, 0, PILOT)
        bad = np.flatnonzero(broken(moments) | ~(mass > 0))
        if bad.size:
            example = ", ".join(f"{m:.4g}" for m in moments[:, bad[0]])
            rule = f"{bad.size} of the first {PILOT} sampled bodies are none (e.g. {example}): moments must be positive and obey I_i <= I_j + I_k"
            raise SceneError("body", "moments", None, rule)
        for effect in self.effects:
            for name, value, limits in zip(effect._fields, effect, _limits(effect), strict=True):
                drawn = draw((value,), self.run.seed, f"effects.{name_of(effect)}.{name}", 0, PILOT)[0]
                if not ((drawn >= limits[0]) & (drawn <= limits[1])).all():
                    rule = f"must lie between {limits[0]:g} and {limits[1]:g}"
                    raise SceneError(f"effects.{name_of(effect)}", name, float(drawn.min()), rule)
        return self

    @classmethod
    def load(cls, source, settings=()):
        """A scene from a TOML file, the name of a shipped scene, or a result file (.nc); `settings` are (dotted key, value) pairs.

        Raises SceneError for what is wrong in it, FileNotFoundError where there is no such file or name.
        """
        source = os.fspath(source)
        if source.endswith(".nc"):
            from rigidmc.storage import scene_of

            return scene_of(source, settings)
        text = read_source(source)
        return cls.loads(text, source, settings)

    @classmethod
    def loads(cls, text, file="scene", settings=(), stored=None):
        """A scene from TOML text; `stored(name, axis)` gives the columns of a result file that the text refers to."""
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise SceneError("", "TOML", None, f"not valid TOML: {error}", file=file) from None
        try:
            for key, value in settings:
                _set(data, key, value)
            return cls._from_tables(data, stored)
        except SceneError as error:
            error.file = error.file or file
            raise
        except ValidationError as error:
            made = _from_pydantic(error, "", _File, data)
            made.file = file
            raise made from None

    @classmethod
    def _from_tables(cls, data, stored):
        file = _File(**data)
        try:
            run = Run.model_validate({k: tuple(v) if isinstance(v, list) else v for k, v in file.run.items()})
        except ValidationError as error:
            raise _from_pydantic(error, "run", Run, file.run) from None
        effects = []
        for name, table in file.effects.items():
            if name not in EFFECTS:
                raise unknown("effects", name, None, "effect", EFFECTS)
            fields = EFFECTS[name]._fields
            _only(table, fields, f"effects.{name}")
            missing = [f for f in fields if f not in table and f not in EFFECTS[name]._field_defaults]
            if missing:
                raise SceneError(f"effects.{name}", missing[0], None, "is missing")
            effects.append(EFFECTS[name](**{k: _parse(v, f"effects.{name}", k, stored) for k, v in table.items()}))
        _only(file.start, ("omega", "momentum", "attitude"), "start")
        start = Start(**{k: _parse(v, "start", k, stored) for k, v in file.start.items()})
        body = _body(file.body, stored)
        scene = cls(body, tuple(effects), start, run, file.title or "scene", file.summary, file.source)
        return scene.with_run()

    def dumps(self):
        """The scene as TOML; arrays with one row per member become references to the variables of the result."""
        body = {"moments": _plain(self.body.moments, "moments"), "mass": _plain(self.body.mass, "mass")}
        body["centre"] = _plain(self.body.centre, "centre")
        if self.body.axes != IDENTITY:
            body["axes"] = [list(row) for row in self.body.axes]
        which = "omega" if self.start.momentum is None else "momentum"
        attitude = self.start.attitude
        angles = "start_attitude" if attitude == "uniform" or len(attitude) == 4 else "start_euler"
        start = {which: _plain(getattr(self.start, which), f"start_{which}")}
        start["attitude"] = attitude if attitude == "uniform" else _plain(attitude, angles)
        effects = {}
        for effect in self.effects:
            effects[name_of(effect)] = {k: _plain(v, f"{name_of(effect)}_{k}") for k, v in zip(effect._fields, effect, strict=True)}
        tables = {
            "title": self.title,
            "summary": self.summary,
            "source": self.source,
            "body": body,
            "effects": effects,
            "start": start,
        }
        run = {k: list(v) if isinstance(v, tuple) else v for k, v in self.run.model_dump().items() if v is not None}
        return tomli_w.dumps({**{k: v for k, v in tables.items() if v != ""}, "run": run})


def shipped():
    """Names of the scenes that come with the package."""
    return sorted(p.name[:-5] for p in resources.files("rigidmc.scenes").iterdir() if p.name.endswith(".toml"))


def read_source(source):
    """The TOML text of a scene file or of a shipped scene; FileNotFoundError with the nearest name where there is neither."""
    if source in shipped():
        return resources.files("rigidmc.scenes").joinpath(f"{source}.toml").read_text("utf-8")
    if os.path.exists(source):
        with open(source, encoding="utf-8") as file:
            return file.read()
    close = nearest(os.path.basename(source).removesuffix(".toml"), shipped())
    hint = f" (did you mean '{close}'?)" if close else ""
    raise FileNotFoundError(f"{source}: no such file, and no shipped scene of that name{hint}; shipped: {', '.join(shipped())}")


def _effect(effect: Any) -> Any:
    """An effect with its parameters checked."""
    fields = getattr(effect, "_fields", None)
    if fields is None or isinstance(effect, type) or not (hasattr(effect, "torque") or hasattr(effect, "kick")):
        raise SceneError(
            "effects",
            "effect",
            effect,
            f"expected an effect with its parameters, one of {', '.join(k.__name__ for k in EFFECTS.values())}",
        )
    table = f"effects.{name_of(effect)}"
    for name, value, (low, high) in zip(fields, effect, _limits(effect), strict=True):
        if not isinstance(quantity(value, table, name), Distribution) and not (low <= np.min(value) and np.max(value) <= high):
            raise SceneError(table, name, float(np.min(value)), f"must lie between {low:g} and {high:g}")
    return type(effect)(*(quantity(v, table, k) for k, v in zip(fields, effect, strict=True)))


def _limits(effect):
    return [getattr(effect, "limits", {}).get(name, (-np.inf, np.inf)) for name in effect._fields]


def _body(table, stored):
    """The body of a scene file."""
    _only(table, (*_SHAPES, "mass", "centre", "axes", "pivot"), "body")
    given = [k for k in _SHAPES if k in table]
    if len(given) != 1:
        raise SceneError("body", " | ".join(_SHAPES), None, f"give exactly one of these, not {len(given)}")
    shape = given[0]
    parts = {k: _parse(table[k], "body", k, stored) for k in ("mass", "centre") if k in table}
    if _SHAPES[shape] is None:
        value = _parse(table[shape], "body", shape, stored) if shape == "moments" else table[shape]
        body = (
            Body.from_moments(value, **parts) if shape == "moments" else Body.from_tensor(_numbers(value, "body", shape), **parts)
        )
    else:
        keys, make = _SHAPES[shape]
        extra = [k for k in ("mass", "centre") if k in table]
        if extra:
            raise SceneError(
                "body", extra[0], table[extra[0]], f"a {shape} has its mass and centre inside its own table: {', '.join(keys)}"
            )
        _only(table[shape], keys, f"body.{shape}")
        missing = [k for k in keys if k not in table[shape]]
        if missing:
            raise SceneError(f"body.{shape}", missing[0], None, "is missing")
        body = make(*(_numbers(table[shape][k], f"body.{shape}", k) for k in keys))
    if "axes" in table:
        body = replace(body, axes=tuple(map(tuple, _numbers(table["axes"], "body", "axes"))))
    return body.pivoted_at(table["pivot"]) if "pivot" in table else body


def _numbers(value, table, key):
    """Numbers, or lists of numbers, as they stand."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise SceneError(table, key, value, "expected numbers") from None
    if isinstance(value, str) or not np.isfinite(array).all():
        raise SceneError(table, key, value, "expected finite numbers")
    return value


def _only(table, allowed, name):
    if not isinstance(table, dict):
        raise SceneError("", name, table, f"expected a table with the keys {', '.join(allowed)}")
    for key in table:
        if key not in allowed:
            raise unknown(name, key, None, "key", allowed)


def _parse(value, table, key, stored):
    """Numbers, lists, {distribution = parameters} and {stored = name, axis = i} of a scene file as quantities."""
    if isinstance(value, list):
        return [_parse(v, table, key, stored) for v in value]
    if not isinstance(value, dict):
        return value
    if "stored" in value:
        if stored is None:
            raise SceneError(table, key, value, "refers to the rows of a result file; load that file instead")
        return stored(value["stored"], value.get("axis"))
    if len(value) != 1:
        raise SceneError(table, key, value, "expected a number or one distribution, e.g. { normal = [0.0, 0.001] }")
    ((name, parameters),) = value.items()
    try:
        if isinstance(parameters, dict):
            return distribution(name, **parameters)
        return distribution(name, *(parameters if isinstance(parameters, list) else [parameters]))
    except SceneError as error:
        raise SceneError(table, key, value, error.rule, error.nearest) from None


def _plain(value, name, axis=None):
    """A quantity or a tuple of them as it stands in TOML."""
    if isinstance(value, tuple):
        return [_plain(v, name, i + 1) for i, v in enumerate(value)]
    if isinstance(value, Distribution):
        return value.as_table()
    if isinstance(value, np.ndarray):
        return {"stored": name} if axis is None else {"stored": name, "axis": axis}
    return value


def _set(data, dotted, value):
    """data[a][b] = value for the key a.b; the value is TOML, or else a plain word."""
    *tables, key = dotted.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise SceneError("", dotted, value, f"'{table}' is not a table")
    try:
        data[key] = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        data[key] = value
    if key in _SHAPES and tables[-1:] == ["body"]:
        for other in set(_SHAPES) - {key}:
            data.pop(other, None)


def _from_pydantic(error, table, model, data):
    """The first complaint of pydantic as a SceneError."""
    # a misspelt key comes before the right one that it leaves missing
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    place = [
        str(p)
        for p in first["loc"]
        if not (isinstance(p, str) and p not in model.model_fields and p in ("float", "constrained-float"))
    ]
    key = place[0] if place else "scene"
    if first["type"] == "extra_forbidden":
        return unknown(table, key, None, "table or key" if not table else "key", list(model.model_fields))
    if first["type"] == "missing":
        return SceneError(table, key, None, "is missing")
    return SceneError(table, key, data.get(key), first["msg"][0].lower() + first["msg"][1:])
