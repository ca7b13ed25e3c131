"""The options of a study, defined once: arguments of its function and options of its command."""

import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from numbers import Real
from typing import Any, NamedTuple, Self, dataclass_transform, get_args, get_type_hints

from rigidmc.errors import OptionError
from rigidmc.scene.amounts import read_count, read_seconds, words_of

REQUIRED: Any = inspect.Parameter.empty  # the default of an option that has to be given
# types of an option: given several times; one list such as rk4,rk8 of names, or of what they name;
# a list of numbers; a time [s], also as a text such as 1h30m
Words = tuple[str, ...]
Names = tuple[Any, ...]
Numbers = tuple[float, ...]


class Time(float):
    """The type of an option that is a time."""


@dataclass(frozen=True)
class Option:
    """What is known of an option; `option` makes it, `options_of` adds name and type.

    text : a noun phrase without a full stop, for help page and docstring
    more : what the docstring adds to it
    unit : of a number
    above, below : open bounds of a number;  least, most : of a count
    rule : what is allowed, for errors
    metavar : what the help page shows for the value
    is_new : whether it is about members, and refused beside members that exist
    missing : what a new study lacks without it: of an option that a study on disk has
    in_command, in_function : whether the command and the function have it
    reader : (value, name) -> the value as it is used, if its type does not tell
    kind : what it is in the docstring, if its type does not tell
    """

    text: str
    more: str = ""
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    least: int = 1
    most: int | None = None
    rule: str = ""
    metavar: str = ""
    is_new: bool = False
    missing: str = ""
    in_command: bool = True
    in_function: bool = True
    reader: Callable[[Any, str], Any] | None = None
    kind: str = ""
    name: str = ""
    type: Any = None
    default: Any = REQUIRED

    def read(self, value: Any) -> Any:
        """The value as it is used; OptionError for one that it cannot have."""
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
        """Its lines under Parameters of a numpydoc docstring."""
        head = f"{self.name} : {self.kind or _DOCUMENTED[self.type]}"
        unit = f" [{self.unit}]" if self.unit else ""
        more = f"; {self.more}" if self.more else ""
        # --long is its neighbour `long`; options with a hyphen are of the command alone
        text = re.sub(r"--(\w+)(?![\w-])", r"`\1`", self.text)
        text = re.sub(r"(\|\w+\|\S*)", r"``\1``", text)  # |L|^2 would be a substitution
        return parameter(head + ", optional" * self.is_optional, f"{text}{unit}{more}")

    @property
    def is_optional(self) -> bool:
        """Whether the function of a study may be called without it."""
        return self.default is not REQUIRED and not self.missing


_DOCUMENTED = {  # {type: what it is in a docstring}
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
    """A parameter in a numpydoc docstring: what it is, and its text below."""
    indent = "    "
    return "\n".join([
        head,
        textwrap.fill(text, 96, initial_indent=indent, subsequent_indent=indent,
                      break_long_words=False, break_on_hyphens=False),
    ])  # fmt: skip


def option(default: Any, text: str, like: Option = Option(""), **more: Any) -> Any:
    """A field of `Options`: its default and its text, and what else an Option has.

    like : an option that has the rest
    """
    of_field = MISSING if default is REQUIRED else default
    made = replace(like, text=text, default=default, **more)
    return field(default=of_field, metadata={"option": made})


def confidence_option(text: str, **more: Any) -> Any:
    """The field of the confidence of intervals, refused before anything is computed."""
    rule = "expected a number between 0 and 1"
    return option(0.95, text, above=0.0, below=1.0, rule=rule, in_command=False, **more)


@dataclass_transform(frozen_default=True, field_specifiers=(option, confidence_option))
class Options:
    """The options of a study, checked: a subclass has a field made by `option` for each.

    A field is an int (a count), a float, a bool, a str, Time, Words, Names, Numbers, or one of
    these or None; or something else, with a `type` on the command line and a `reader`.
    """

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Self:
        """The options of some values by name, the others at their defaults; OptionError."""
        given = {one.name: one.read(values.get(one.name, one.default)) for one in options_of(cls)}
        return cls(**given)


class NoOptions(Options):
    """No option at all."""


def keywords_of(counted: str) -> dict[str, tuple[str, str]]:
    """{keyword: (type, text)} of the function of a study of what is counted: members or tasks."""
    return {
        "threads": ("int", "as of `simulate`; no bit depends on it"),
        "device": ("str", "where members move, as of `simulate`"),
        "progress": (
            "bool or callable",
            "True for what the study will cost, told before the first step, and a bar; or a"
            f" function of ({counted} done, all)",
        ),
    }


class Example(NamedTuple):
    """A study that takes a second, for the tests over all of them.

    scene : the name of a shipped one
    options : of the study
    settings : of the run
    """

    scene: str
    options: Mapping[str, Any]
    settings: Mapping[str, Any]


def options_of(cls: type[Options]) -> list[Option]:
    """The options of a class, in the order of its fields, with their names and types."""
    hints = get_type_hints(cls)
    found = []
    for one in fields(cls):  # type: ignore[arg-type]  # a subclass is a dataclass
        kind, known = hints[one.name], one.metadata["option"]
        if known.type is None and type(None) in get_args(kind):
            (kind,) = (one for one in get_args(kind) if one is not type(None))
        found.append(replace(known, name=one.name, type=known.type or kind))
    return found
