"""The settings of a run, defined once: the fields of `Run` define the table [run] of a scene file,
the keywords of `simulate` and the options of the command line.

`with_changes` makes a Run with other settings; `idle` lists settings that others leave without
effect.
"""

import functools
import inspect
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from rigidmc.errors import SceneError, from_pydantic
from rigidmc.inputs.amounts import parse_count, words_of
from rigidmc.inputs.measured import in_units
from rigidmc.inputs.units import rule_with_hint
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import follows_turns
from rigidmc.scene.save_times import SaveTimes, parse_every, seconds_of


def _time(value: Any) -> float:
    return seconds_of(value, positive=False)


def _in_units(units: str, value: Any) -> Any:
    """Return a number in SI units, if the value has a unit, in text or beside it; ValueError."""
    try:
        return in_units(value, units, "run")
    except SceneError as error:
        raise ValueError(rule_with_hint(error)) from None


def _count(value: Any) -> int:
    return parse_count(value, least=None)


Time = Annotated[float, BeforeValidator(_time), Field(gt=0)]
Every = Annotated[SaveTimes, BeforeValidator(parse_every)]
Count = Annotated[int, BeforeValidator(_count), Field(gt=0)]
Index = Annotated[int, BeforeValidator(_count), Field(ge=0)]
Digits = Annotated[int, BeforeValidator(_count), Field(ge=1, le=15)]
Positive = Annotated[float, Field(gt=0)]
Angle = Annotated[float, BeforeValidator(partial(_in_units, "rad")), Field(gt=0)]
Rate = Annotated[float, BeforeValidator(partial(_in_units, "rad s-1")), Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
Points = Literal["independent", "sobol", "latin_hypercube", "antithetic", "saltelli", "neighbours"]
Precision = Literal["float64", "float32"]


def _is(default: Any, description: str) -> Any:
    """Return a field with its default and its description, a noun phrase without a full stop."""
    return Field(default, description=description)


class Table(BaseModel):
    """Table of a scene file: no unknown keys, no conversions, finite numbers."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=Table)


def check_table(
    model: type[Model], settings: Mapping[str, Any], at: str, given: Mapping[str, Any] | None = None
) -> Model:
    """Return a table with checked keys and values; SceneError.

    given : the values that an error shows, by default the settings
    """
    try:
        return model.model_validate(settings)
    except ValidationError as error:
        raise from_pydantic(error, at, model.model_fields, given or settings) from None


class Run(Table):
    """The settings of a run.

    A scene file has them in its table [run]. A keyword of `simulate`, or an option of the command
    line such as `--t-end 1h` for t_end, overrides each of them.

    Times are seconds or text such as "1h30m" and "250 ms". Counts are integers and may be written
    as 1e6. A tolerance without an integrator means integrator = "auto".

    Parameters
    ----------
    {settings}

    Raises
    ------
    pydantic.ValidationError
        for an unknown setting, an invalid value, and for both dt and turn

    Examples
    --------
    >>> run = rm.Run(t_end="1h30m", members=1e6)
    >>> run.t_end, run.members, run.dt
    (5400.0, 1000000, 0.01)
    """

    integrator: str = _is(
        "rk4", "a name that `rigidmc integrators` lists, or auto with a tolerance"
    )
    dt: Time = _is(0.01, "time step [s]; reduced if it divides neither t_end nor every")
    turn: Angle | None = _is(
        None, "instead of dt: each step covers this angle of the member's own motion [rad]"
    )
    t_end: Time = _is(10.0, "end time [s]; like all times also as 90s, 1h30m, 250ms")
    members: Count = _is(1000, "number of members of the ensemble")
    first: Index = _is(0, "index of the first member")
    seed: Index = _is(0, "seed of all random draws")
    points: Points = _is("independent", "source of the numbers that the members draw")
    strata: Count | None = _is(
        None, "number of strata of a Latin hypercube; by default one per member"
    )
    dtype: Precision = _is("float64", "precision of the steps, float64 or float32")
    compensated: bool = _is(False, "compensated summation, for very many steps")
    tolerance: Share | None = _is(
        None,
        "largest error in 99 % of the members, relative for the momentum, in rad for the attitude;"
        " chooses integrator and step",
    )
    turn_rate: Rate | None = _is(
        None, "upper bound on the rate of free motion [rad/s]; by default from the first members"
    )
    checks: bool = _is(True, "flag and freeze members beyond the limits; non-finite members always")
    energy_limit: Positive | None = _is(
        None, "energy drift that flags a member; by default from integrator and step"
    )
    momentum_limit: Positive | None = _is(
        None,
        "drift of `|L|^2`, or of L_z under gravity, that flags a member; by default from integrator"
        " and step",
    )
    turn_limit: Angle | None = _is(
        None, "`|omega| dt` that flags a member [rad]; by default from the integrator"
    )
    anti_damping: bool = _is(False, "allow negative damping, which drives the body")
    every: Every | None = _is(
        None,
        "time between saves [s], or increasing times of saves [s], or saves per turn of the"
        " fastest saved quantity, e.g. 50/turn; the first and the last state are saved, too. By"
        " default, a run of at most 20 members saves enough to plot, and others these two states",
    )
    save: tuple[str, ...] = _is(
        ("omega",),
        "observables to save and to monitor, see `rigidmc observables`, e.g. omega,energy,flips",
    )
    wrt: tuple[str, ...] | None = _is(
        None,
        "parameters by which saved observables are differentiated, e.g. body.moments.2,start.omega;"
        " by default none",
    )
    keep: str | dict[str, str] = _is(
        "full",
        "amount of saved data to keep, for all observables or by name: full, thinned, summary,"
        " final or none; flagged members keep all",
    )
    thin: Count = _is(10, "with keep = thinned: keep one of this many saves")
    compress: bool = _is(False, "compress files, without loss")
    digits: Digits | None = _is(
        None,
        "significant digits of saves over time in files: relative error 10^-digits/2; also"
        " compresses",
    )

    varied: dict[str, float | list[float]] | None = _is(
        None, "nominal values of the parameters that vary between runs; set by `prepare`"
    )

    @model_validator(mode="before")
    @classmethod
    def _settled(cls, data: dict[str, Any]) -> dict[str, Any]:
        data = {
            key: value.item() if isinstance(value, np.generic) else value
            for key, value in data.items()
        }
        for key in ("save", "wrt"):
            if isinstance(names := data.get(key), str):
                data[key] = words_of(names)
            elif isinstance(names, list):
                data[key] = tuple(names)
        if data.get("wrt") == ():
            del data["wrt"]  # no derivatives, as without the setting
        if data.get("dt") is not None and data.get("turn") is not None:
            raise SceneError("give dt or turn, not both", at="run.turn", value=data["turn"])
        if data.get("points") == "tangents":
            rule = (
                "were starts and neighbours of an earlier ftle, which now takes exact derivatives:"
                " run `rigidmc ftle` again"
            )
            raise SceneError(rule, at="run.points", value="tangents")
        if data.get("tolerance") is not None and data.get("integrator") is None:
            data["integrator"] = "auto"
        return data


def types() -> dict[str, Any]:
    """Return {setting: type}, such as Time, Count, bool; without the None of optional settings."""
    hints = get_type_hints(Run, include_extras=True)
    optional = {name for name, hint in hints.items() if NoneType in get_args(hint)}
    plain = {name: get_args(hints[name])[0] for name in optional}
    return {name: plain.get(name, hints[name]) for name in Run.model_fields}


def document_settings(names: Iterable[str]) -> str:
    """Return settings as a numpydoc parameter list."""
    lines = []
    for name in names:
        lines += [f"{name} : {_in_words(types()[name])}, optional"]
        about = Run.model_fields[name].description or ""
        lines += textwrap.wrap(about, 92, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)


def _in_words(kind: Any) -> str:
    """Return the type of a setting, in words."""
    if kind == Time:
        return "float or str"
    if kind == Every:
        return "float, str or array_like"
    if get_origin(kind) is Literal:
        return f"{{{', '.join(repr(word) for word in get_args(kind))}}}"
    if get_origin(kind) is Annotated:
        return _in_words(get_args(kind)[0])
    if get_origin(kind) is tuple:
        return "tuple of str"
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(map(_in_words, get_args(kind)))
    return str((get_origin(kind) or kind).__name__)


Run.__doc__ = inspect.cleandoc(Run.__doc__ or "").replace(
    "{settings}", document_settings(Run.model_fields)
)

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def takes_settings(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a function with `**settings`: its signature and docstring list the settings of
    `Run`, and an unknown keyword raises a TypeError that names the nearest setting.

    The list replaces the line `{settings}` in the docstring. It omits settings that are named
    parameters of the function.
    """
    signature = inspect.signature(function)
    named = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    words = [name for name in Run.model_fields if name not in (*signature.parameters, "varied")]
    allowed = [*words, *(p.name for p in named)]

    @functools.wraps(function)
    def checked(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Result:
        for word in keywords:
            if word not in allowed:
                raise TypeError(no_such_keyword(function.__name__, word, allowed))
        return function(*arguments, **keywords)

    more = [inspect.Parameter(word, inspect.Parameter.KEYWORD_ONLY, default=None) for word in words]
    # `inspect` documents this attribute, but mypy does not know it
    shown = signature.replace(parameters=[*named, *more])
    checked.__signature__ = shown  # type: ignore[attr-defined]
    about = inspect.cleandoc(function.__doc__ or "")  # Python 3.13 does this anyway
    checked.__doc__ = about.replace("{settings}", document_settings(words))
    return checked


def no_such_keyword(function: str, word: str, allowed: list[str]) -> str:
    """Return the message about an unknown keyword."""
    from rigidmc.errors import nearest

    close = nearest(word, allowed)
    hint = f"; did you mean '{close}'?" if close else ""
    return f"{function}() got an unexpected keyword argument '{word}'{hint}"


# turn_rate stays in a run even if an override leaves it without effect: `auto` tries integrators
# that use it
STAYS = {"turn_rate"}
_LIMITS = ("energy_limit", "momentum_limit", "turn_limit")


def idle(run: Run) -> dict[str, str]:
    """Return {setting: why it has no effect} for settings not at their default; a stored scene
    lists all settings."""
    fields = type(run).model_fields
    return {
        key: why for key, why in _without_effect(run) if getattr(run, key) != fields[key].default
    }


def _without_effect(run: Run) -> Iterator[tuple[str, str]]:
    """Yield (setting, why) for all settings that a run does not use."""
    auto, closed = run.integrator == "auto", run.integrator == "closed"
    words = run.keep.values() if isinstance(run.keep, dict) else (run.keep,)
    if not auto:
        rule = f'integrator = "{run.integrator}" ignores a tolerance: omit it, or use "auto"'
        yield "tolerance", rule
        if not follows_turns(INTEGRATORS.get(run.integrator)):
            yield "turn_rate", f'integrator = "{run.integrator}" does not use it'
    if auto:
        yield from ((key, 'integrator = "auto" chooses it') for key in ("dt", "turn", "dtype"))
    if closed:  # no note for dt: results in closed form are stored with one
        yield from ((key, "closed forms make no steps") for key in ("turn", "dtype", *_LIMITS))
    elif not run.checks:
        rule = "with checks = false only non-finite members are flagged"
        yield from ((key, rule) for key in _LIMITS)
    if run.points != "latin_hypercube":
        yield "strata", 'only points = "latin_hypercube" has strata'
    if "thinned" not in words:
        yield "thin", 'no observable has keep = "thinned"'


def with_changes(run: Run, changes: Mapping[str, Any]) -> Run:
    """Return a Run with `changes` in place of its own settings; SceneError.

    A tolerance replaces integrator and step, and `turn` replaces dt. Settings that the change
    leaves without effect return to their defaults.
    """
    if changes.get("tolerance") is not None:
        changes = {"integrator": "auto", **changes}
    replaced = {"turn"} if "dt" in changes else {"dt"} if "turn" in changes or run.turn else set()
    kept = run.model_dump(exclude=replaced, exclude_unset=True)
    if "save" in changes and isinstance(run.keep, dict):
        kept["keep"] = {name: word for name, word in run.keep.items() if name in changes["save"]}
    settings = {**kept, **changes}
    new = check_table(Run, settings, "run", changes)
    lost = idle(new).keys() - idle(run).keys() - changes.keys() - STAYS
    if not lost & settings.keys():
        return new
    return check_table(Run, {k: v for k, v in settings.items() if k not in lost}, "run", changes)
