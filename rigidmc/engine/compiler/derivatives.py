"""Derivatives of functions that have a better rule than their code.

The code of a function, compiled for Duals, differentiates its operations one by one. Some functions
need another way: rounding to an integer would count as the identity, and the derivative of a
polynomial that approximates a sine costs more than the cosine. A rule is a function of the same
arguments; `chained` gives a value with the tangents of its argument times a derivative.
"""

import math
from collections.abc import Callable
from typing import Any

from numba.core import types

from rigidmc.engine.compiler.dual_types import DualType, make_dual, tangents_of
from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.physics.dynamics import vectors
from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.free_flow import (
    flow_about_momentum,
    free_flow,
    is_moving,
    momentum_size,
)
from rigidmc.physics.dynamics.functions import (
    arctan2,
    expm1,
    exponential_of,
    hypotenuse,
    logarithm_of,
    sincos,
)
from rigidmc.physics.dynamics.quaternions import spin
from rigidmc.physics.dynamics.rotation_flows import (
    rotate_about_axis,
    symmetric_flow,
    turn_by_asymmetry,
)
from rigidmc.physics.dynamics.vectors import (
    add,
    cross,
    dot,
    logical_not,
    nearest_integer,
    scale,
    select,
    select_all,
)
from rigidmc.physics.integrators.free_motion import turn_and_momentum, unit_momentum_after

_TUPLE: Any = types.BaseTuple  # as Any: Numba's stubs lack the items of tuples


def without_derivatives(x):
    """Return the value of a number, without its tangents."""
    return x


@intrinsic(without_derivatives)
def _without_derivatives(typing_context, x):
    if not isinstance(x, DualType):
        return x(x), lambda context, builder, sig, args: args[0]
    return x.vector(x), lambda context, builder, sig, args: builder.extract_value(args[0], 0)


def chained(x, value, derivative):
    """Return a number with this value, and with the tangents of x times the derivative."""
    return value


@intrinsic(chained)
def _chained(typing_context, x, value, derivative):
    if not isinstance(x, DualType):
        return value(x, value, derivative), lambda context, builder, sig, args: args[1]

    def generate(context, builder, sig, args):
        tangents = [builder.fmul(p, args[2]) for p in tangents_of(builder, x, args[0])]
        return make_dual(builder, x, args[1], tangents)

    return x(x, x.vector, x.vector), generate


def moving(x, change):
    """Return a number whose only derivative is `change`; compiled only."""
    raise NotImplementedError


@intrinsic(moving)
def _moving(typing_context, x, change):
    ty = DualType(x, 1)
    return ty(x, x), lambda context, builder, sig, args: make_dual(builder, ty, args[0], args[1:])


def change_of(x):
    """Return the only derivative of a number; compiled only."""
    raise NotImplementedError


@intrinsic(change_of)
def _change_of(typing_context, x):
    if not isinstance(x, DualType):  # a level that does not move
        return x(x), lambda context, builder, sig, args: context.get_constant_null(x)
    return x.vector(x), lambda context, builder, sig, args: tangents_of(builder, x, args[0])[0]


def first_values(numbers):
    """Return a tuple of numbers without their derivatives."""
    if len(numbers) == 0:
        return ()
    return (without_derivatives(numbers[0]),) + first_values(numbers[1:])


def moving_each(numbers, changes):
    """Return a tuple of numbers, each with its change as its only derivative."""
    if len(numbers) == 0:
        return ()
    return (moving(numbers[0], changes[0]),) + moving_each(numbers[1:], changes[1:])


def changes_of(numbers):
    """Return the changes of numbers."""
    if len(numbers) == 0:
        return ()
    return (change_of(numbers[0]),) + changes_of(numbers[1:])


def _nearest_integer(x):
    return nearest_integer(without_derivatives(x))


def _sincos(x):
    s, c = sincos(without_derivatives(x))
    return chained(x, s, c), chained(x, c, -s)


def _exponential_of(x):
    e = exponential_of(without_derivatives(x))
    return chained(x, e, e)


def _expm1(x):
    e = expm1(without_derivatives(x))
    return chained(x, e, e + 1.0)


def _logarithm_of(x):
    wide = without_derivatives(x)
    return chained(x, logarithm_of(wide), 1.0 / wide)


def _arctan2(y, x):
    a, b = without_derivatives(y), without_derivatives(x)
    # d atan2 = (x dy - y dx) / (x^2 + y^2), by halves so that no square overflows; (0, 0) has none
    largest = vectors.maximum(abs(a), abs(b))
    scale = 1.0 / select(largest > 0.0, largest, math.inf)
    p, q = a * scale, b * scale
    over = scale / select(largest > 0.0, p * p + q * q, 1.0)
    angle = arctan2(a, b)
    return chained(y, angle, q * over) + chained(x, 0.0 * angle, -p * over)


def _hypotenuse(x, y):
    # the code sorts |x| and |y|, and takes the same one twice where they are equal
    a, b = without_derivatives(x), without_derivatives(y)
    h = hypotenuse(a, b)
    over = 1.0 / select(h > 0.0, h, math.inf)
    return chained(x, h, a * over) + chained(y, 0.0 * h, b * over)


def _momentum_size(moves, square):
    # of a body at rest nan: |L| has no derivative there, and nothing may take it for 0
    size = momentum_size(moves, without_derivatives(square))
    # at rest the quotient is unused
    return chained(square, size, select(moves, 0.5 / select(moves, size, 1.0), math.nan))


def _with_tangents_of(v, values, by):
    """Return three numbers with their values, and with the tangents of v times `by`."""
    return (
        chained(v[0], without_derivatives(values[0]), by),
        chained(v[1], without_derivatives(values[1]), by),
        chained(v[2], without_derivatives(values[2]), by),
    )


def _unit_momentum_after(body, h, l, u, end):
    # a small L turns a body at rest by h omega in each step, and stays
    rests, v = logical_not(is_moving(dot(l, l))), scale(h, angular_velocity(body, l))
    return select_all(rests, _with_tangents_of(add(u, v), end, 1.0 + 0.0 * h), end)


def _turn_and_momentum(l, u, turn, momentum):
    square = without_derivatives(dot(l, l))
    rests, half = logical_not(is_moving(square)), 0.5 + 0.0 * square
    still = (without_derivatives(turn[0]),) + _with_tangents_of(u, turn[1:], half)
    momentum = select_all(rests, _with_tangents_of(l, momentum, half + half), momentum)
    return select_all(rests, still, turn), momentum


def _free_flow(body, halvings, panels, h, l):
    turn, change = flow_about_momentum(body, halvings, panels, h, l)
    # At rest L has no axis, but a small L turns the body by h omega, in any direction, and stays.
    rests, v = logical_not(is_moving(dot(l, l))), scale(0.5 * h, angular_velocity(body, l))
    by_v = _with_tangents_of(v, turn[1:], 1.0 + 0.0 * h)
    turn = select_all(rests, (without_derivatives(turn[0]),) + by_v, turn)
    return turn, select_all(rests, _plain(change), change)


def _symmetric_flow(body, h, l):
    # Moments that are equal for the values may change apart.
    turn, change = rotate_about_axis(body, h, l)
    apart, eta = turn_by_asymmetry(body, h, l)
    eta = _plain(eta)
    plain = without_derivatives(turn[0]), *_plain(turn[1:])
    turned, moved = spin(plain, scale(0.5, eta)), cross(_plain(add(l, change)), eta)
    return (
        (
            turn[0] + _by_another(apart, turn[0], turned[0]),
            turn[1] + _by_another(apart, turn[1], turned[1]),
            turn[2] + _by_another(apart, turn[2], turned[2]),
            turn[3] + _by_another(apart, turn[3], turned[3]),
        ),
        (
            change[0] + _by_another(apart, change[0], moved[0]),
            change[1] + _by_another(apart, change[1], moved[1]),
            change[2] + _by_another(apart, change[2], moved[2]),
        ),
    )


def _plain(v):
    """Return the values of a 3-vector."""
    return without_derivatives(v[0]), without_derivatives(v[1]), without_derivatives(v[2])


def _by_another(x, y, derivative):
    """Return a number that adds the derivative dy/dx to y, and nothing to its value."""
    return chained(x, 0.0 * without_derivatives(y), derivative)


RULES: dict[Callable[..., Any], Callable[..., Any]] = {
    free_flow: _free_flow,
    unit_momentum_after: _unit_momentum_after,
    turn_and_momentum: _turn_and_momentum,
    momentum_size: _momentum_size,
    nearest_integer: _nearest_integer,
    sincos: _sincos,
    symmetric_flow: _symmetric_flow,
    exponential_of: _exponential_of,
    expm1: _expm1,
    logarithm_of: _logarithm_of,
    arctan2: _arctan2,
    hypotenuse: _hypotenuse,
}


def rule_for(function: Any, kinds: Any) -> Any:
    """Return the rule of a function if a Dual is among its arguments, else the function."""
    rule = RULES.get(function, function)
    return rule if rule is not function and any(_has_dual(kind) for kind in kinds) else function


def _has_dual(kind: Any) -> bool:
    """Return whether a type is a Dual, or a tuple with one."""
    if isinstance(kind, _TUPLE):
        return any(_has_dual(part) for part in kind)
    return isinstance(kind, DualType)
