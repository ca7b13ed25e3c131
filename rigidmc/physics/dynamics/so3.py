"""Vectors, rotations and elementary functions for kernels and custom effects, in one module.

Attitudes are unit quaternions, scalar first. A = R(q) maps body components to space components; the
columns of A are the body axes (TdC (3.1)-(3.5)). q and -q are the same attitude. The product
`multiply(p, q)` rotates by q first, then by p.
"""

from rigidmc.physics.dynamics.functions import arctan2, expm1, sincos, sincos_small
from rigidmc.physics.dynamics.quaternions import (
    add4,
    add_compensated,
    add_compensated4,
    advance_attitude,
    apply_rotation,
    axpy4,
    conjugate,
    difference4,
    divide_by_three,
    exponential,
    into_body,
    inverse_near_three,
    multiply,
    normalised,
    renormalise,
    rotated,
    scale4,
    spin,
    touch_up,
    two_sum,
    value_of,
    vertical,
)
from rigidmc.physics.dynamics.vectors import (
    add,
    axpy,
    by_precision,
    concat,
    cross,
    difference,
    dot,
    first_three,
    inverse,
    left_after,
    logical_not,
    maximum,
    minimum,
    nearest_integer,
    rest_axpy,
    root,
    scale,
    scale_rest,
    select,
    select_all,
    symmetric_times,
    taken,
)

__all__ = [
    "add", "add4", "add_compensated", "add_compensated4", "advance_attitude", "apply_rotation",
    "arctan2", "axpy", "axpy4", "by_precision", "concat", "conjugate", "cross", "difference",
    "difference4", "divide_by_three", "dot", "expm1", "exponential", "first_three", "into_body",
    "inverse", "inverse_near_three", "left_after", "logical_not", "maximum", "minimum", "multiply",
    "nearest_integer", "normalised", "renormalise", "rest_axpy", "root", "rotated", "scale",
    "scale4", "scale_rest", "select", "select_all", "sincos", "sincos_small", "spin",
    "symmetric_times", "taken", "touch_up", "two_sum", "value_of", "vertical",
]  # fmt: skip
