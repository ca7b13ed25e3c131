"""What is worked out of a scene once: it stays with the scene."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
KEPT = "_kept"  # where a scene has {function: (arguments, last result)}


def once(function: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """`function` of a scene and of plain arguments, which works once as long as they stay the same.

    The scene keeps the last result: scenes never change, and a loop over settings holds one result.
    Arguments that are not plain, such as a user's observables, are worked on at each call.
    """

    @wraps(function)
    def wrapper(scene: S, /, *args: P.args, **named: P.kwargs) -> R:
        try:
            asked = _plain(args), _plain(tuple(named.items()))
        except TypeError:
            return function(scene, *args, **named)
        kept: dict[Any, Any] = scene.__dict__.setdefault(KEPT, {})
        known = kept.get(function)
        if known is None or known[0] != asked:
            known = kept[function] = asked, function(scene, *args, **named)
        result: R = known[1]
        return result

    return wrapper


def _plain(value: Any) -> Any:
    """A key that is equal only for equal values of the same type; TypeError if there is none."""
    if isinstance(value, tuple) and type(value) is tuple:
        return tuple(map(_plain, value))
    if value is None or type(value) in (str, int, float, bool):
        return type(value), repr(value)  # 1, 1.0 and True are equal, and so are 0.0 and -0.0
    raise TypeError
