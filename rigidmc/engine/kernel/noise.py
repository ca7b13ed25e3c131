"""Normal deviates without branches or library calls, so that they run on vectors.

A member's noise in a step is a function of (seed, stream, member, step) and of nothing else:
Philox4x64-10 of a counter, as in numpy, then the Box-Muller transform. The counter is
[member + 1, step, stream, 1]; its last word separates it from the draws of starts and parameters,
where it is 0.
Source: Salmon, Moraes, Dror & Shaw, SC11 (2011); Box & Muller, Ann. Math. Stat. 29 (1958) 610.
"""

import math
import sys

import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.physics.dynamics.functions import as_float, as_word, logarithm
from rigidmc.physics.dynamics.so3 import select, sincos_small

# Multipliers and Weyl constants of Philox4x64, see the source above.
_M0, _M1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_W0, _W1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_LOW, _HALF, _ONE = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(1)
_EXPONENT, _TWELVE = np.uint64(0x3FF0000000000000), np.uint64(12)
_SIGN = np.uint64(0x8000000000000000)
_ROOT_HALF = 0.70710678118654752440


def wide_product(a, b):
    """Return the (high, low) words of a b, by products of half words, which vectors support."""
    a0, a1, b0, b1 = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    low = a0 * b0
    one = a1 * b0 + (low >> _HALF)  # no sum exceeds 64 bits
    two = a0 * b1 + (one & _LOW)
    # The low word is assembled, not written as a b: LLVM would turn that into a scalar 128-bit
    # product, 3 ns slower per member.
    return a1 * b1 + (one >> _HALF) + (two >> _HALF), (two << _HALF) | (low & _LOW)


def philox_rounds(left, c, key):
    """Return the four words after len(left) rounds of Philox."""
    if len(left) == 0:
        return c
    high0, low0 = wide_product(_M0, c[0])
    high1, low1 = wide_product(_M1, c[2])
    return philox_rounds(
        left[1:],
        (high1 ^ c[1] ^ key[0], low1, high0 ^ c[3] ^ key[1], low0),
        (key[0] + _W0, key[1] + _W1),
    )


def philox(key, counter):
    """Return four random words of 64 bits: Philox4x64-10."""
    # A tuple of ten: the recursion unrolls the ten rounds, with no loop left in the kernel.
    return philox_rounds((0, 0, 0, 0, 0, 0, 0, 0, 0, 0), counter, key)


def uniform_number(word):
    """Return a number in (0, 1): the middle of one of 2^52 equal parts."""
    # 2^-53 more than the lower end: 0 has no logarithm
    return (as_float((word >> _TWELVE) | _EXPONENT) - 1.0) + 1.1102230246251565e-16


def with_sign(x, word):
    """Return x with the sign of the top bit of a word."""
    return as_float(as_word(x) | (word & _SIGN))


def unit_circle(word):
    """Return (x, y) uniform on the unit circle, from one word.

    The upper 52 bits are an angle in (0, pi/4), the lowest 3 an octant.
    """
    # The angle needs no reduction: it lies in one octant, and bits of the word choose among eight.
    s, c = sincos_small(0.78539816339744830962 * uniform_number(word))
    swapped = (word & _ONE) == _ONE
    x = with_sign(select(swapped, s, c), word << np.uint64(62))
    return x, with_sign(select(swapped, c, s), word << np.uint64(61))


def normals(words):
    """Return three independent normal deviates from four words, after Box and Muller."""
    # The smallest uniform number is 2^-53, so no deviate exceeds 8.6.
    a = math.sqrt(-2.0 * logarithm(uniform_number(words[0])))
    b = math.sqrt(-2.0 * logarithm(uniform_number(words[2])))
    x, y = unit_circle(words[1])
    return a * x, a * y, b * unit_circle(words[3])[0]


def normal_deviates(paired, key, member, number, stream):
    """Return three normal deviates of a member for the step `number`, which is less than 2^63.

    paired : ON for a step that has the noise of two steps of half its length: the sums of the
        deviates of those steps, 2 number and 2 number + 1, over sqrt(2)
    """
    if len(paired) == 0:
        return normals(philox(key, (member, number, stream, _ONE)))
    first = number << _ONE
    a, b, c = normals(philox(key, (member, first, stream, _ONE)))
    x, y, z = normals(philox(key, (member, first | _ONE, stream, _ONE)))
    return _ROOT_HALF * (a + x), _ROOT_HALF * (b + y), _ROOT_HALF * (c + z)


inline_all(sys.modules[__name__])
