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
        return function(part, *(values[available.index(argument)] for argument in arguments(function)))

    call.__name__, call.__doc__ = name, default.__doc__
    call.default, call.available = default, available
    METHODS.append(call)
    return call


def names(part, *methods):
    """All the argument names that the given methods of a class or its instance use; methods it lacks use none."""
    kind = part if isinstance(part, type) else type(part)
    return {a for m in methods if hasattr(kind, m) for a in arguments(getattr(kind, m))}
