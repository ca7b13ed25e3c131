"""The options of a study, defined once: arguments of its function and options of its command."""

import inspect
import math
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from numbers import Real
from typing import Any, NamedTuple, Self, dataclass_transform, get_args, get_type_hints

from rigidmc.errors import OptionError
from rigidmc.scene.amounts import counted

REQUIRED: Any = inspect.Parameter.empty  # the default of an option that has to be given
Words = tuple[str, ...]  # the type of an option that may be given several times


@dataclass(frozen=True)
class Option:
    """What is known of an option; `option` makes it, `options_of` adds name and type.

    text : a noun phrase without a full stop, for help page and docstring
    more : what the docstring adds to it
    unit : of a number
    above, below : open bounds of a number;  least : lowest value of a count
    rule : what is allowed, for errors
    metavar : what the help page shows for the value
    is_new : whether it is about members, and refused beside members that exist
    missing : what a new study lacks without it: of an option that a study on disk has
    in_command : whether the command has it
    """

    text: str
    more: str = ""
    unit: str = ""
    above: float = -math.inf
    below: float = math.inf
    least: int = 1
    rule: str = ""
    metavar: str = ""
    is_new: bool = False
    missing: str = ""
    in_command: bool = True
    name: str = ""
    type: Any = str
    default: Any = REQUIRED

    def read(self, value: Any) -> Any:
        """The value as it is used; OptionError for one that it cannot have."""
        if value is None and self.default is None:
            return None
        if self.type is int:
            return counted(value, self.name, self.least)
        if self.type is float:
            return self._number(value)
        if self.type == Words:
            return (value,) if isinstance(value, str) else tuple(value)
        return value

    def _number(self, value: Any) -> float:
        sound = isinstance(value, Real) and not isinstance(value, bool)
        if not sound or not self.above < float(value) < self.below:
            limits = {"above": self.above, "below": self.below}
            bounds = [f" {word} {end:g}" for word, end in limits.items() if math.isfinite(end)]
            rule = f"expected a number{' and'.join(bounds)} {self.unit}".rstrip()
            raise OptionError(self.rule or rule, at=self.name, value=value)
        return float(value)

    def documented(self) -> str:
        """Its lines under Parameters of a numpydoc docstring."""
        kind = {int: "int", float: "float", str: "str", bool: "bool"}.get(self.type)
        head = f"{self.name} : {kind or 'str or sequence of str'}"
        unit = f" [{self.unit}]" if self.unit else ""
        more = f"; {self.more}" if self.more else ""
        return parameter(head + ", optional" * self.is_optional, f"{self.text}{unit}{more}")

    @property
    def is_optional(self) -> bool:
        """Whether the function of a study may be called without it."""
        return self.default is not REQUIRED and not self.missing


def parameter(head: str, text: str) -> str:
    """A parameter in a numpydoc docstring: what it is, and its text below."""
    indent = "    "
    return "\n".join([
        head,
        textwrap.fill(text, 96, initial_indent=indent, subsequent_indent=indent,
                      break_long_words=False, break_on_hyphens=False),
    ])  # fmt: skip


def option(default: Any, text: str, **more: Any) -> Any:
    """A field of `Options`: its default and its text, and what else an Option has."""
    of_field = MISSING if default is REQUIRED else default
    return field(default=of_field, metadata={"option": Option(text, default=default, **more)})


@dataclass_transform(frozen_default=True, field_specifiers=(option,))
class Options:
    """The options of a study, checked: a subclass has a field made by `option` for each.

    A field is an int (a count), a float, a str, Words, or one of these or None.
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
        kind = hints[one.name]
        if kind != Words and (kinds := [k for k in get_args(kind) if k is not type(None)]):
            (kind,) = kinds
        found.append(replace(one.metadata["option"], name=one.name, type=kind))
    return found
