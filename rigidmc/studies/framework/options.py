"""The options of a study, defined once for the arguments of its function and for its command."""

import inspect
import math
import re
import textwrap
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from numbers import Real
from typing import Any, Self, dataclass_transform, get_args, get_type_hints

from rigidmc.errors import OptionError, SceneError, unknown
from rigidmc.inputs.amounts import read_count, read_seconds, words_of
from rigidmc.inputs.measured import as_measured, in_units, quantity_text
from rigidmc.scene.model import Model
from rigidmc.scene.parameters import parameters_of, settable

REQUIRED: Any = inspect.Parameter.empty  # default of an option that must be given
# types of an option: given several times; a list of names such as rk4,rk8, or of named objects;
# a list of numbers; a time [s], also as text such as 1h30m
Words = tuple[str, ...]
Names = tuple[Any, ...]
Numbers = tuple[float, ...]


class Time(float):
    """Type of an option that is a time."""


@dataclass(frozen=True)
class Option:
    """The record of an option; `option` creates it, `options_of` adds name and type.

    text : a noun phrase without a full stop, for help page and docstring
    more : addition to `text` in the docstring
    unit : of a number
    above, below : open bounds of a number;  least, most : of a count
    rule : allowed values, for errors;  words : allowed ones
    metavar : placeholder of the value on the help page
    is_new : whether it defines members, and is refused for existing members
    missing : error message of a new study without it; a study on disk has it already
    in_command, in_function : whether the command and the function have it
    is_argument : whether the command takes it by its place, after the scene
    reader : (value, name) -> the value to use, if the type alone does not determine it
    kind : type in the docstring, if it differs from `type`
    """

    text: str
    more: str = ""
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    least: int = 1
    most: int | None = None
    rule: str = ""
    words: Collection[str] = ()
    metavar: str = ""
    is_new: bool = False
    missing: str = ""
    in_command: bool = True
    in_function: bool = True
    is_argument: bool = False
    reader: Callable[[Any, str], Any] | None = None
    kind: str = ""
    name: str = ""
    type: Any = None
    default: Any = REQUIRED

    def read(self, value: Any) -> Any:
        """Return the value to use; OptionError for a value that is not allowed."""
        if value is None and self.default is None:
            return None
        if self.reader is not None:
            return self.reader(value, self.name)
        if self.type is int:
            return read_count(value, self.name, self.least, self.most)
        if self.type is float:
            return self._number(value)
        if self.type is Time:
            return read_seconds(value, self.name)
        if self.words and value not in self.words:
            raise unknown(self.name, self.words, at=self.name, value=value, error=OptionError)
        if self.type == Words:
            return (value,) if isinstance(value, str) else tuple(value)
        if self.type == Names:
            return self._names(value)
        if self.type is bool and not isinstance(value, bool):
            raise OptionError("expected true or false", at=self.name, value=value)
        if self.type == Numbers:
            return self._numbers(value)
        return value

    def _number(self, value: Any) -> float:
        try:
            value = in_units(value, self.unit or "1", self.name)
        except SceneError as error:
            raise OptionError(
                error.rule, at=self.name, value=value, nearest=error.nearest
            ) from None
        sound = isinstance(value, Real) and not isinstance(value, bool)
        if not sound or not self.above < float(value) < self.below:
            limits = {"above": self.above, "below": self.below}
            bounds = [f" {word} {end:g}" for word, end in limits.items() if math.isfinite(end)]
            rule = f"expected a number{' and'.join(bounds)} {self.unit}".rstrip()
            raise OptionError(self.rule or rule, at=self.name, value=value)
        return float(value)

    def _names(self, value: Any) -> Names:
        try:
            return words_of(value) if isinstance(value, str) else tuple(value)
        except TypeError:
            rule = "expected names separated by commas, or a list"
            raise OptionError(rule, at=self.name, value=value) from None

    def _numbers(self, value: Any) -> Numbers:
        try:
            return tuple(map(float, value.split(",") if isinstance(value, str) else value))
        except (TypeError, ValueError):
            rule = "expected numbers separated by commas, e.g. 1e-4,1e-8"
            raise OptionError(rule, at=self.name, value=value) from None

    def documented(self) -> str:
        """Return its lines under Parameters of a numpydoc docstring."""
        head = f"{self.name} : {self.kind or _DOCUMENTED[self.type]}"
        unit = f" [{self.unit}]" if self.unit else ""
        more = f"; {self.more}" if self.more else ""
        # --long becomes `long`, another parameter; only the command has options with a hyphen
        text = re.sub(r"--(\w+)(?![\w-])", r"`\1`", self.text)
        return parameter(head + ", optional" * self.is_optional, f"{text}{unit}{more}")

    @property
    def is_optional(self) -> bool:
        """Whether the function of a study can be called without it."""
        return self.default is not REQUIRED and not self.missing


_DOCUMENTED = {  # {type: its name in a docstring}
    int: "int",
    float: "float",
    Time: "float",
    str: "str",
    bool: "bool",
    Words: "str or sequence of str",
    Names: "str or sequence",
    Numbers: "sequence of float",
}


def parameter(head: str, text: str) -> str:
    """Return a parameter of a numpydoc docstring: `head`, and its text below."""
    return f"{head}\n{wrapped(text)}"


def wrapped(text: str, more: str = "") -> str:
    """Return indented lines of a docstring; more : indent of all lines but the first."""
    indent, text = "    ", re.sub(r"(\|\w+\|[\w^]*)", r"``\1``", text)  # |L|^2 is a substitution
    return textwrap.fill(text, 96, initial_indent=indent, subsequent_indent=indent + more,
                         break_long_words=False, break_on_hyphens=False)  # fmt: skip


def option(default: Any, text: str, like: Option = Option(""), **more: Any) -> Any:
    """Return a field of `Options`, from its default, its text, and other fields of an Option.

    like : an option from which the other fields are copied
    """
    of_field = MISSING if default is REQUIRED else default
    made = replace(like, text=text, default=default, **more)
    return field(default=of_field, metadata={"option": made})


def confidence_option(text: str, **more: Any) -> Any:
    """Return the field of the confidence of intervals; bad values are refused before computing."""
    rule = "expected a number between 0 and 1"
    return option(0.95, text, above=0.0, below=1.0, rule=rule, in_command=False, **more)


@dataclass_transform(frozen_default=True, field_specifiers=(option, confidence_option))
class Options:
    """The checked options of a study: a subclass has one field for each, made by `option`.

    A field is an int (a count), a float, a bool, a str, Time, Words, Names or Numbers, or one of
    these or None. Other types need a `type` on the command line and a `reader`.
    """

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Self:
        """Return the options from values by name, with defaults for the others; OptionError."""
        return cls(**{x.name: x.read(values.get(x.name, x.default)) for x in options_of(cls)})


class NoOptions(Options):
    """A study without options."""


def options_of(cls: type[Options]) -> list[Option]:
    """Return the options of a class with names and types, in the order of its fields."""
    hints, options = get_type_hints(cls), []
    for of_class in fields(cls):  # type: ignore[arg-type]  # a subclass is a dataclass
        kind, record = hints[of_class.name], of_class.metadata["option"]
        if record.type is None and type(None) in get_args(kind):
            (kind,) = (x for x in get_args(kind) if x is not type(None))
        options.append(replace(record, name=of_class.name, type=record.type or kind))
    return options


# ranges of scene parameters, such as the sides of a map: KEY=LOW:HIGH
Side = tuple[str, float, float] | tuple[str, float, float, bool]  # parameter, low, high[, log]
Whole = tuple[str, float, float, bool]  # a side with all entries


def read_side(value: Any, at: str) -> Any:
    """Parse KEY=LOW:HIGH[:log] into (parameter, low, high, whether log-spaced); OptionError.

    A unit beside HIGH alone is the unit of both. `whole_side` converts ends with units, and
    checks values that are not text.
    """
    if not isinstance(value, str):
        return value
    name, equals, ends = value.partition("=")
    parts = ends.split(":")
    try:
        low, high = (end if quantity_text(end) else float(end) for end in parts[:2])
    except ValueError:
        low = high = float("nan")
    if isinstance(high, str) and isinstance(low, float):
        low = f"{low!r} {as_measured(high).unit}"
    if not equals or len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]) or low != low:
        rule = "expected KEY=LOW:HIGH or KEY=LOW:HIGH:log, e.g. body.moments.1=0.1:0.9"
        raise OptionError(rule, at=at, value=value)
    return name.strip(), low, high, len(parts) == 3


def whole_side(key: str, side: Side, model: Model | None) -> Whole:
    """Return a side with all entries, its ends in SI units; OptionError."""
    if isinstance(side, str) or len(side) not in (3, 4) or not isinstance(side[0], str):
        rule = "expected (parameter, low, high) or (parameter, low, high, True)"
        example = 'such as ("body.moments.1", 0.1, 0.9)'
        raise OptionError(f"{rule}, {example}", at=key, value=side)
    name, low, high, *log = side
    known = {} if model is None else settable(parameters_of(model))
    if name in known:
        try:
            low, high = (in_units(end, known[name].unit, key) for end in (low, high))
        except SceneError as error:
            raise OptionError(
                error.rule, at=key, value=error.value, nearest=error.nearest
            ) from None
    return name, low, high, bool(log and log[0])


# option for a parameter and its range
SIDE = Option(
    "", metavar="KEY=LOW:HIGH", type=str, kind="tuple or str", reader=read_side, is_new=True
)
