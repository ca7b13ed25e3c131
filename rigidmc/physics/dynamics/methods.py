"""Methods that receive arguments by name: the convention of effects, integrators, observables.

The arguments of a class's methods are its dependencies: `torque(self, body, q)` depends on body and
attitude, `torque(self, l)` on the angular momentum alone. No separate declaration can disagree.

Options of a kernel are types, so its code holds nothing for absent ones. A yes or no is a flag, ON
or OFF; a number that unrolls code is the length of a tuple, `static_count`. Compiled code tests
both by a literal `if len(x) == 0`, where x is an argument or a field of one: such a branch is
pruned before the rest is typed, but not a branch on a helper such as `is_off(x)`, whose untaken
side would then have to type-check, too. The argument must not be assigned again.
"""

import inspect
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, TypeAlias, cast


class Method(Protocol):
    """A generic function made by `method`.

    default : the function for a class without such a method
    available : names of the arguments after `part`
    """

    __name__: str
    default: Callable[..., Any]
    available: tuple[str, ...]

    def __call__(self, part: Any, /, *values: Any) -> Any: ...


class On(NamedTuple):
    """A set flag of compiled code. It holds one number because a record of numbers needs rows."""

    on: float = 0.0


class Off(NamedTuple):
    """A cleared flag of compiled code."""


Flag: TypeAlias = On | Off
Count: TypeAlias = tuple[float, ...]  # of `static_count`
ON, OFF = On(), Off()


def flag(condition: object) -> Flag:
    """Return ON if a condition holds, else OFF."""
    return ON if condition else OFF


def static_count(count: int) -> Count:
    """Return a number known to compiled code by its type: a tuple of this length."""
    return (0.0,) * count


METHODS: list[Method] = []  # all of them, for `rigidmc.engine.compiler.compose` to compile


def arguments(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return the names of a method's arguments after self."""
    return _arguments(function, getattr(function, "__code__", None))


# `inspect.signature` takes 6 us, and a scene asks hundreds of times.
@lru_cache(maxsize=1024)
def _arguments(function: Callable[..., Any], code: Any) -> tuple[str, ...]:
    """Return the names of the arguments of a function whose code may be replaced."""
    return tuple(inspect.signature(function).parameters)[1:]


def method(default: Callable[..., Any]) -> Method:
    """Return a generic function f(part, a, b, ...) that calls `part.f` with the arguments it names.

    If the class of the part has no such method, the body of `default` runs.
    """
    name, available = default.__name__, arguments(default)

    def call(part: Any, *values: Any) -> Any:
        function = getattr(type(part), name, None)
        if function is None:
            return default(part, *values)
        return function(
            part, *(values[available.index(argument)] for argument in arguments(function))
        )

    call.__name__, call.__doc__ = name, default.__doc__
    generic = cast(Method, call)
    generic.default, generic.available = default, available
    METHODS.append(generic)
    return generic


def word_of(cls: type) -> str:
    """Return the word for a class in scene files: its name in snake_case, as in l2_drift."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()


def number_words(words: Iterable[str]) -> list[str]:
    """Number repeated words from their second use on: ["rotor", "gravity", "rotor_2"]."""
    count: Counter[str] = Counter()
    labels = []
    for word in words:
        count[word] += 1
        labels.append(word if count[word] == 1 else f"{word}_{count[word]}")
    return labels


def implements(part: object, name: str) -> bool:
    """Return whether a class, or an instance's class, has a method or property of this name."""
    return hasattr(part if isinstance(part, type) else type(part), name)


def old_word(part: Any, words: Mapping[str, str]) -> tuple[str, str] | None:
    """Return (old, new) for the first method or fact with a former name in a class or instance.

    words : {old: new}; a field of that name is a parameter, not a method
    """
    fields = getattr(part, "_fields", ())
    had = (old for old in words if old not in fields and implements(part, old))
    return next(((old, words[old]) for old in had), None)


def argument_names(part: Any, *methods: str) -> set[str]:
    """Return all argument names of these methods of a class or instance, if it has them."""
    cls = part if isinstance(part, type) else type(part)
    return {a for m in methods if implements(cls, m) for a in arguments(getattr(cls, m))}


class Traced:
    """A stand-in for a number that records whether code uses its value.

    Arithmetic on it returns a Traced. `notes` gets an entry as soon as code branches on it or
    passes it to a library.
    """

    def __init__(self, notes: list[bool]) -> None:
        self.notes = notes

    def _computed(self, *_: object) -> "Traced":
        return self

    def _used(self, *_: object) -> float:
        self.notes.append(True)
        return 1.0

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _computed
    __truediv__ = __rtruediv__ = __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = _computed
    __lt__ = __le__ = __gt__ = __ge__ = _computed
    __eq__ = __ne__ = _computed  # type: ignore[assignment]  # comparisons return a Traced
    __and__ = __or__ = __invert__ = __rand__ = __ror__ = _computed
    __float__ = _used
    __hash__ = None  # type: ignore[assignment]  # not hashable, as it equals nothing

    def __bool__(self) -> bool:
        return bool(self._used())


def depends(call: Method, part: Any, **values: Any) -> bool:
    """Return whether the result of call(part, ...) depends on a value that is None.

    call : made by `method`
    values : all its arguments, by name; a Traced stands in for each None, also inside tuples

    Code that fails with a Traced counts as dependent.
    """
    notes: list[bool] = []

    def traced(value: Any) -> Any:
        if type(value) is tuple:
            return tuple(map(traced, value))
        return Traced(notes) if value is None else value

    given = [traced(values[name]) for name in call.available]  # KeyError for one that is left out
    try:
        result = call(part, *given)
    except Exception:  # custom code may do anything with its numbers
        return True
    # A value that went through arithmetic alone is still a Traced.
    numbers = result if isinstance(result, tuple) else (result,)
    return bool(notes) or any(isinstance(x, Traced) for x in numbers)
