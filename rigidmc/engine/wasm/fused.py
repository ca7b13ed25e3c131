"""The fused multiply-add of WebAssembly: x y + z rounded once.

WebAssembly has no instruction that is fused on every machine. Relaxed SIMD has one that a machine
with such an instruction fuses, and another may round twice. So there are two versions of
`llvm.fma`: that instruction, and `fused` below, which consists of plain sums and products.

The compiler fuses a product with a sum in the same function, see `rigidmc.engine.compiler.fma`. So
`times` makes all products here that are added to something.
"""

import math
import sys

import llvmlite.binding as llvm
import numpy as np
from numba.core import types

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.intrinsics import any_of
from rigidmc.engine.compiler.machine_code import llvm_of_function
from rigidmc.engine.compiler.vector_types import VectorType
from rigidmc.engine.linked import join_code
from rigidmc.errors import OptionError
from rigidmc.physics.dynamics.functions import as_float, as_word
from rigidmc.physics.dynamics.so3 import logical_not, maximum, select, two_sum

RELAXED, EXACT = "relaxed", "exact"  # by the instruction; by sums and products
LANES = 2  # float64 in a vector of WebAssembly
_SPLIT = 2.0**27 + 1.0  # Dekker's constant: halves a significand of 53 bits
_LEAST = 2.0**-900  # below it, the error of a product may be too small for a number
_ONE = np.uint64(1)

# LLVM's names of the functions for one number, and for two by version; the code of the latter.
ONE, TWO = "fma.f64", {RELAXED: "llvm.wasm.relaxed.madd.v2f64", EXACT: "fma.v2f64"}
DECLARED = "declare <2 x double> @TWO(<2 x double>, <2 x double>, <2 x double>)"
# Inlined, a step of rk8 has 170 kB, and browsers optimise it less (14 us in place of 5).
CALLED = """
declare i32 @"FUSED"(ptr, ptr, <2 x double>, <2 x double>, <2 x double>)
define <2 x double> @TWO(<2 x double> %x, <2 x double> %y, <2 x double> %z) noinline {
  %result = alloca <2 x double>
  %error = alloca ptr
  call i32 @"FUSED"(ptr %result, ptr %error, <2 x double> %x, <2 x double> %y, <2 x double> %z)
  %r = load <2 x double>, ptr %result
  ret <2 x double> %r
}
"""
SINGLE = """
define double @fma.f64(double %x, double %y, double %z) alwaysinline {
  %a = insertelement <2 x double> zeroinitializer, double %x, i64 0
  %b = insertelement <2 x double> zeroinitializer, double %y, i64 0
  %c = insertelement <2 x double> zeroinitializer, double %z, i64 0
  %both = call <2 x double> @TWO(<2 x double> %a, <2 x double> %b, <2 x double> %c)
  %r = extractelement <2 x double> %both, i64 0
  ret double %r
}
define <1 x double> @fma.v1f64(<1 x double> %x, <1 x double> %y, <1 x double> %z) alwaysinline {
  %a = bitcast <1 x double> %x to double
  %b = bitcast <1 x double> %y to double
  %c = bitcast <1 x double> %z to double
  %r = call double @fma.f64(double %a, double %b, double %c)
  %vector = bitcast double %r to <1 x double>
  ret <1 x double> %vector
}
"""


def join_fused(module: llvm.ModuleRef, version: str) -> llvm.ModuleRef:
    """Return a module with a version, RELAXED or EXACT, in the place of llvm.fma.

    Raises OptionError for numbers in float32.
    """
    code = str(module)
    for kind, name in ("v2f64", TWO[version]), ("f64", ONE), ("v1f64", "fma.v1f64"):
        code = code.replace(f"@llvm.fma.{kind}(", f"@{name}(")
    if "@llvm.fma." in code:
        raise OptionError("live pages compute in float64: set run.dtype", at="dtype")
    codes = [DECLARED + SINGLE]
    if version == EXACT:
        pair = VectorType(types.float64, LANES)
        name, text = llvm_of_function(fused, pair(pair, pair, pair))
        codes = [CALLED.replace("FUSED", name) + SINGLE, text]
    codes[0] = codes[0].replace("@TWO", f"@{TWO[version]}")
    return join_code(code, codes)


def fused(x, y, z):
    """Compute x y + z for float64 numbers, rounded once.

    The sum s + (e + f) is right, where s is x y + z rounded twice, and e and f are the errors of
    its sum and of its product, unless e + f, rounded, takes s to the middle between two numbers.
    That seldom happens; then `fused_in_range` serves, and where something over- or underflows. The
    CPU predicts that branch, so a result does not wait for it.
    """
    product, lost = two_product(x, y)
    near, error = two_sum(product, z)
    rest = error + lost
    # A product with 0 is exact, and its sum has the right sign.
    is_exact = (x == 0.0) | (y == 0.0)
    total = select(is_exact, near, near + rest)
    # what rounding took from near + rest: half the distance to a neighbour of the total?
    left = rest - (total - near)
    twice = left + left
    is_clear = ((total + twice) - total != twice) | (left == 0.0)
    is_clear = is_clear & (abs(total) < math.inf) & (abs(product) >= _LEAST)
    is_open = logical_not(is_exact | is_clear)
    if any_of(is_open):
        total = select(is_open, fused_in_range(x, y, z), total)
    return total


def fused_in_range(x, y, z):
    """Compute x y + z, rounded once, for any x and y but 0.

    Powers of two move the numbers to where nothing over- or underflows, and the sum back. The sum
    is by Boldo & Melquiond, IEEE Trans. Comput. 57 (2008) 462.
    """
    a, b = power_towards_one(x), power_towards_one(y)
    c = a * b
    p, q, r = x * a * a, y * b * b, z * c * c
    # Below all bits of the product, z matters by its sign only.
    r = select(z == 0.0, z, math.copysign(maximum(abs(r), 2.0**-1000), z))
    product, error = two_product(p, q)
    high, low = two_sum(r, error)
    top, middle = two_sum(product, high)
    rest = sum_to_odd(low, middle)
    total = top + rest
    # A sum below the least normal number is rounded at 2^-1074, the ulp of this number beside it.
    least = 2.0**-1022 * c * c
    beside = math.copysign(least, total)
    up, left = two_sum(beside, top)
    coarse = math.copysign((up + sum_to_odd(left, rest)) - beside, total)
    total = select(abs(total) < least, coarse, total) / c / c
    # infinities and NaN
    near = times(p, q) + r
    total = select(abs(near) < math.inf, total, near)
    # A product below an ulp of an ulp of z moves it across no tie; r may have overflowed.
    return select(abs(times(x, y)) < 2.0**-120 * abs(z), z, total)


def power_towards_one(x):
    """Return the power of two whose square takes x to between 2^-474 and 2^424."""
    return select(abs(x) < 2.0**-300, 2.0**300, select(abs(x) > 2.0**300, 2.0**-300, 1.0))


def sum_to_odd(x, y):
    """Return x + y rounded to odd: an inexact sum gets an odd last bit, so that rounding again
    rounds the exact sum."""
    near, error = two_sum(x, y)
    bits = as_word(near)
    grows = (error > 0.0) == (near > 0.0)
    odd = as_float(select(grows, bits + _ONE, bits - _ONE))
    return select((error == 0.0) | ((bits & _ONE) == _ONE), near, odd)


def two_product(x, y):
    """Return (p, e): p is the rounded product, and p + e = x y exactly.

    Source: Dekker, Numer. Math. 18 (1971) 224.
    """
    product = times(x, y)
    (a, b), (c, d) = halves(x), halves(y)
    return product, times(b, d) + (times(b, c) + (times(a, d) + (times(a, c) - product)))


def halves(x):
    """Return (h, l) with h + l = x, each of at most 26 bits."""
    wide = times(_SPLIT, x)
    high = wide - (wide - x)
    return high, x - high


def times(x, y):
    """Return the rounded product."""
    return x * y


inline_all(sys.modules[__name__])
