"""What is worked out of a scene once: it stays with the scene."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
KEPT = "_kept"  # where a scene has {function: (arguments, last result)}


def once(function: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """Keep the last result of a function of a scene with the scene, and return it as long as the
    other arguments stay the same.

    Scenes do not change, and a loop over settings holds one result. A result that has the scene
    itself would keep it in memory until the garbage is collected.
    Words and numbers are the same if they are equal and of one type; a NamedTuple, such as a Plan
    or an observable, is the same only if it is the same object; with lists and other arguments that
    may change the function works at each call. No caller may change a result.
    """

    @wraps(function)
    def wrapper(scene: S, /, *args: P.args, **named: P.kwargs) -> R:
        try:
            asked = _key(args), _key(tuple(named.items()))
        except TypeError:
            return function(scene, *args, **named)
        kept: dict[Any, Any] = scene.__dict__.setdefault(KEPT, {})
        known = kept.get(function)
        if known is None or known[0] != asked:
            known = kept[function] = asked, function(scene, *args, **named)
        result: R = known[1]
        return result

    return wrapper


class _Itself:
    """A key that is equal only for the same object, which it keeps alive."""

    def __init__(self, value: object) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and self.value is other.value

    __hash__ = None  # type: ignore[assignment]  # keys are compared, never looked up


def _key(value: Any) -> Any:
    """A key that is equal only for the same argument; TypeError if there is none."""
    if type(value) is tuple:
        return tuple(map(_key, value))
    if isinstance(value, tuple):
        return _Itself(value)
    if value is None or type(value) in (str, int, float, bool):
        return type(value), repr(value)  # 1, 1.0 and True are equal, and so are 0.0 and -0.0
    raise TypeError
