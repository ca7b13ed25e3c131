"""Methods that take what they need by name: the one calling convention of effects, integrators and observables.

A class says what it depends on by the arguments its method names: `torque(self, body, q)` depends on body and attitude,
`torque(self, l)` on the angular momentum alone. Nothing is declared twice, so nothing can be declared wrongly.
"""

import inspect

METHODS = []  # every generic function made by `method`, for rigidmc.engine.compose to compile


def arguments(function):
    """Names of a method's arguments after self."""
    return tuple(inspect.signature(function).parameters)[1:]


def method(default):
    """A generic function f(part, a, b, ...) that calls `part.f` with those of a, b, ... that it names.

    A class without such a method gets the body of `default`.
    """
    name, available = default.__name__, arguments(default)

    def call(part, *values):
        function = getattr(type(part), name, None)
        if function is None:
            return default(part, *values)
        return function(
            part, *(values[available.index(argument)] for argument in arguments(function))
        )

    call.__name__, call.__doc__ = name, default.__doc__
    call.default, call.available = default, available
    METHODS.append(call)
    return call


def implements(part: object, name: str) -> bool:
    """Whether a class, or the class of an instance, has a method or property of this name."""
    return hasattr(part if isinstance(part, type) else type(part), name)


def names(part, *methods):
    """All the argument names that the given methods of a class or its instance use; methods it lacks use none."""
    kind = part if isinstance(part, type) else type(part)
    return {a for m in methods if implements(kind, m) for a in arguments(getattr(kind, m))}


class Traced:
    """A stand-in for a number, which shows whether code uses it: what is computed from it is Traced again, and `notes` gets an
    entry as soon as code branches on it or gives it to a library."""

    def __init__(self, notes):
        self.notes = notes

    def _again(self, *_):
        return self

    def _told(self, *_):
        self.notes.append(True)
        return 1.0

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = (
        _again
    )
    __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = _again
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _again
    __and__ = __or__ = __invert__ = __rand__ = __ror__ = _again
    __float__ = _told
    __hash__ = None  # type: ignore[assignment]

    def __bool__(self):
        return bool(self._told())


def depends(call, part, **values):
    """Whether the result of call(part, ...), with a `call` made by `method`, depends on a value that is None.

    values : all that `call` offers, by name; a Traced stands in for each None, and an attitude is four of them

    Code that fails with a Traced is taken to depend on it.
    """
    notes: list[bool] = []

    def traced(value):
        return (
            tuple(map(traced, value))
            if type(value) is tuple
            else Traced(notes)
            if value is None
            else value
        )

    try:
        found = call(part, *(traced(values[name]) for name in call.available))
    except Exception:  # a user's own code: it may do anything with its numbers
        return True
    return bool(notes) or any(
        isinstance(x, Traced) for x in (found if isinstance(found, tuple) else (found,))
    )
