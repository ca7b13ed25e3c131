"""Derivatives of every operation and function, against 40 digits; at kinks and at 0."""

import math
import sys

import mpmath as mp
import numpy as np
import pytest

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import KernelKey, Tangents, call_kernel, compile_kernel, config
from rigidmc.engine.compiler.memory import put_rows
from rigidmc.engine.machine import allocate_aligned
from rigidmc.physics.dynamics.functions import hypotenuse
from rigidmc.physics.dynamics.so3 import arctan2, nearest_integer, root, select, sincos

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
LANES, APART = 8, 64
# |x| < 1 and y > 0; the first two lanes are zeros and a kink
X = np.array([0.0, 0.5, -0.9, -0.3, 1e-8, 0.2, 0.7, -0.6])
Y = np.array([0.5, 0.5, 0.1, 2.0, 3.0, 1e-3, 0.4, 1.7])
DX = np.array([[1.0] * 8, [0.3, -1.2, 2.0, 0.7, 1.0, -0.4, 0.1, 0.9]])
DY = np.array([[0.0] * 8, [1.5, 0.2, -0.6, 1.1, -2.0, 0.5, 0.8, -0.3]])


def values(x, y):
    """What steps and custom effects compute, of one number and of a positive one."""
    s, c = sincos(3.0 * x)
    return (
        x + y, x - y, x * y, x / y, 2.0 * x, 2.0 / y, x - 1.0, 1.0 - x, -x, x * x * y - x,
        x * y + x * y * y, y - x * x, root(y), math.sqrt(y), abs(x - 2.0),
        math.copysign(y, x - 2.0),
        math.sin(x), math.cos(x), math.tan(x), math.atan(x), math.asin(x), math.acos(x),
        math.exp(x), math.expm1(x), math.log(y), math.tanh(x), math.sinh(x), math.cosh(x),
        math.atan2(y, x), math.atan2(x, y), math.pow(y, 1.5), y**2, y**x, math.hypot(x, y),
        hypotenuse(y, 3.0), arctan2(x, y), s, c, max(x, y - 2.0), min(x, y + 2.0),
        select(x > y + 5.0, x * x, y * y), nearest_integer(x) * y, math.floor(x - 3.0) * y,
    )  # fmt: skip


def true_values(x, y):
    """The same with mpmath."""
    return (
        x + y, x - y, x * y, x / y, 2 * x, 2 / y, x - 1, 1 - x, -x, x * x * y - x,
        x * y + x * y * y, y - x * x, mp.sqrt(y), mp.sqrt(y), 2 - x, -y, mp.sin(x), mp.cos(x),
        mp.tan(x), mp.atan(x), mp.asin(x), mp.acos(x), mp.exp(x), mp.expm1(x), mp.log(y),
        mp.tanh(x),
        mp.sinh(x), mp.cosh(x), mp.atan2(y, x), mp.atan2(x, y), mp.power(y, 1.5), y * y,
        mp.power(y, x), mp.hypot(x, y), mp.hypot(y, 3), mp.atan2(x, y), mp.sin(3 * x),
        mp.cos(3 * x),
        x if x > y - 2 else y - 2, x if x < y + 2 else y + 2, y * y, mp.nint(x) * y,
        mp.floor(x - 3) * y,
    )  # fmt: skip


def kernel(tree, numbers, state):
    """Replace x and y in the rows of a state by all values."""
    put_rows(values(state[0], state[1]), state, 0)
    return 0


inline_all(sys.modules[__name__])


def differentiated(x, y, dx, dy):
    """(values, derivatives (2, values, lanes)) from compiled code."""
    key = KernelKey(kernel, (), "float64", LANES, "s", tangents=Tangents(2, in_state=APART))
    compiled, _ = compile_kernel(key)
    rows = allocate_aligned(3 * APART * LANES, float).reshape(3, APART, LANES)
    rows[0, :2], rows[1:, 0], rows[1:, 1] = (x, y), dx, dy
    call_kernel(compiled, "s", rows)
    count = len(true_values(mp.mpf(1), mp.mpf(2)))
    return rows[0, :count], rows[1:, :count]


def test_derivatives_are_those_of_40_digits():
    """Errors up to 7e-16 of the largest term."""
    found, tangents = differentiated(X, Y, DX, DY)
    for k, (x, y) in enumerate(zip(X, Y, strict=True)):
        with mp.workdps(60):
            tiny = mp.mpf(10) ** -25
            here = true_values(mp.mpf(x), mp.mpf(y))
            for j in range(2):
                p, q = tiny * mp.mpf(DX[j, k]), tiny * mp.mpf(DY[j, k])
                ahead, back = true_values(x + p, y + q), true_values(x - p, y - q)
                for i, value in enumerate(here):
                    true = float((ahead[i] - back[i]) / (2 * tiny))
                    if abs(true) > 1e10:
                        continue  # an integer jumps
                    size = max(1.0, abs(true), abs(1.0 / y), abs(x / y**2))
                    assert abs(tangents[j, i, k] - true) <= 4e-15 * size, (i, x, y)
                    assert abs(found[i, k] - float(value)) <= 4e-15 * size, (i, x, y)


def test_roots_and_angles_at_zero_have_no_tangents():
    zeros = np.zeros(LANES)
    found, tangents = differentiated(zeros, zeros, DX, DX)
    for i in (12, 13, 28, 29, 33, 35):  # roots of 0, and angles of (0, 0)
        assert not found[i].any()
        assert not tangents[:, i].any(), i
