"""The fused multiply-add of WebAssembly: a b + c rounded once.

WebAssembly has no instruction that is fused on every machine. Relaxed SIMD has one that a machine
with such an instruction fuses, and another may round twice. So there are two versions of
`llvm.fma`: by that instruction, and by plain sums and products.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir

RELAXED, EXACT = "relaxed", "exact"  # by the instruction; by sums and products
_DOUBLE, _LONG, _BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
_SPLIT = 2.0**27 + 1.0  # Dekker's constant: halves a significand of 53 bits
# Below it, the error of a product may be too small for a number.
_LEAST = 2.0**-900
_BIAS, _TOP = 1023, 0x7FF  # of the exponent's field
# Exponents below and above which `_scaled` moves a product, and by how much: it then lies between
# 2^-200 and 2^900, with all bits of the exact sum.
_LOW, _HIGH, _UP, _DOWN = -700, 900, 1400, -1100


def fused_functions(version: str) -> str:
    """Return LLVM code that defines llvm.fma for numbers and for vectors of one and two numbers,
    as @fma.f64, @fma.v1f64 and @fma.v2f64.

    version : RELAXED or EXACT
    """
    module = ir.Module()
    if version == RELAXED:
        pair = ir.VectorType(_DOUBLE, 2)
        kind = ir.FunctionType(pair, [pair] * 3)
        two: Any = ir.Function(module, kind, "llvm.wasm.relaxed.madd.v2f64")
    else:
        two = _exact(module, _scaled(module))
    _define(module, "fma.v2f64", 2, lambda b, *given: b.call(two, given))
    _define(module, "fma.v1f64", 1, lambda b, *given: _of_first(b, two, given))
    _define(module, "fma.f64", 0, lambda b, *given: _of_first(b, two, given))
    return str(module)


def _define(module: Any, name: str, width: int, body: Callable[..., Any]) -> Any:
    """Define an inlined function of three numbers, or vectors of `width` numbers."""
    kind = ir.VectorType(_DOUBLE, width) if width else _DOUBLE
    function = ir.Function(module, ir.FunctionType(kind, [kind] * 3), name)
    function.attributes.add("alwaysinline")
    b = ir.IRBuilder(function.append_basic_block())
    b.ret(body(b, *function.args))
    return function


def _of_first(b: Any, two: Any, given: Any) -> Any:
    """Call a function of vectors of two for one number, or a vector of one."""
    pair, first = ir.VectorType(_DOUBLE, 2), ir.Constant(ir.IntType(32), 0)
    single = isinstance(given[0].type, ir.VectorType)
    numbers = [b.extract_element(x, first) if single else x for x in given]
    vectors = [b.insert_element(ir.Constant(pair, [0.0, 0.0]), x, first) for x in numbers]
    found = b.extract_element(b.call(two, vectors), first)
    if single:
        return b.insert_element(ir.Constant(given[0].type, ir.Undefined), found, first)
    return found


def _exact(module: Any, scaled: Any) -> Any:
    """Define a b + c for two numbers by Dekker's product and Knuth's sum: s + (e + f), where s is
    a b + c rounded twice, and e and f are the errors of the sum and of the product.

    It is right unless e + f, rounded, takes s to the middle between two numbers, which seldom
    happens; then `scaled` is called, and for products below _LEAST and whatever overflows. The CPU
    predicts that branch, so a result does not wait for it.
    """
    pair, flags = ir.VectorType(_DOUBLE, 2), ir.VectorType(_BIT, 2)
    function = ir.Function(module, ir.FunctionType(pair, [pair] * 3), "fma.two")
    # inlined, a step of rk8 has 170 kB, and browsers optimise it less (14 us in place of 5)
    function.attributes.add("noinline")
    b = ir.IRBuilder(function.append_basic_block())
    x, y, z = function.args
    zero, least, infinity = (_filled(pair, v) for v in (0.0, _LEAST, float("inf")))
    product, lost = _two_product(b, x, y)
    near, error = _two_sum(b, product, z)
    rest = b.fadd(error, lost)
    # A product with 0 is exact, and its sum has the right sign.
    naught = b.or_(b.fcmp_ordered("==", x, zero), b.fcmp_ordered("==", y, zero))
    total = b.select(naught, near, b.fadd(near, rest))
    # what rounding took from near + rest: half the distance to a neighbour of the total?
    left = b.fsub(rest, b.fsub(total, near))
    twice = b.fadd(left, left)
    beyond = b.fsub(b.fadd(total, twice), total)
    clear = b.or_(b.fcmp_unordered("!=", beyond, twice), b.fcmp_ordered("==", left, zero))
    absolute = ir.Function(module, ir.FunctionType(pair, [pair]), "llvm.fabs.v2f64")
    fine = b.and_(clear, b.fcmp_ordered("<", b.call(absolute, [total]), infinity))
    fine = b.and_(fine, b.fcmp_ordered(">=", b.call(absolute, [product]), least))
    open_ = b.not_(b.or_(fine, naught))
    kind = ir.FunctionType(_BIT, [flags])
    reduce = ir.Function(module, kind, "llvm.vector.reduce.or.v2i1")
    with b.if_then(b.call(reduce, [open_])):
        again = total
        for k in range(2):
            at = ir.Constant(ir.IntType(32), k)
            one = b.call(scaled, [b.extract_element(v, at) for v in (x, y, z)])
            again = b.insert_element(again, one, at)
        b.ret(again)
    b.ret(total)
    return function


def _sum_of_parts(b: Any, x: Any, y: Any, z: Any) -> tuple[Any, Any]:
    """Return (top, rest): top + rest, rounded, is x y + z, if nothing over- or underflows; see
    Boldo & Melquiond, IEEE Trans. Comput. 57 (2008) 462."""
    product, error = _two_product(b, x, y)
    high, low = _two_sum(b, z, error)
    top, middle = _two_sum(b, product, high)
    return top, _odd_sum(b, low, middle)


def _odd_sum(b: Any, x: Any, y: Any) -> Any:
    """Return x + y rounded to odd: an inexact sum gets an odd last bit, so that rounding again
    rounds the exact sum."""
    near, error = _two_sum(b, x, y)
    bits, nought = b.bitcast(near, _LONG), _filled(_DOUBLE, 0.0)
    is_even = b.icmp_signed("==", b.and_(bits, _LONG(1)), _LONG(0))
    is_inexact = b.fcmp_ordered("!=", error, nought)
    grows = b.xor(b.fcmp_ordered(">", error, nought), b.icmp_signed("<", bits, _LONG(0)))
    moved = b.add(bits, b.select(grows, _LONG(1), _LONG(-1)))
    return b.bitcast(b.select(b.and_(is_even, is_inexact), moved, bits), _DOUBLE)


def _two_sum(b: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Return (sum rounded, its error), by Knuth."""
    total = b.fadd(x, y)
    late = b.fsub(total, x)
    return total, b.fadd(b.fsub(x, b.fsub(total, late)), b.fsub(y, late))


def _two_product(b: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Return (product rounded, its error), by Dekker."""

    def halves(v: Any) -> tuple[Any, Any]:
        wide = b.fmul(v, _filled(v.type, _SPLIT))
        high = b.fsub(wide, b.fsub(wide, v))
        return high, b.fsub(v, high)

    product = b.fmul(x, y)
    (xh, xl), (yh, yl) = halves(x), halves(y)
    rest = b.fadd(b.fsub(b.fmul(xh, yh), product), b.fmul(xh, yl))
    return product, b.fadd(b.fadd(rest, b.fmul(xl, yh)), b.fmul(xl, yl))


def _filled(kind: Any, value: float) -> Any:
    return ir.Constant(kind, [value] * kind.count if isinstance(kind, ir.VectorType) else value)


def _scaled(module: Any) -> Any:
    """Define a b + c for any number: the product and c are moved by a power of two to where nothing
    over- or underflows, and the sum is moved back."""
    function = ir.Function(module, ir.FunctionType(_DOUBLE, [_DOUBLE] * 3), "fma.scaled")
    function.attributes.add("noinline")
    b = ir.IRBuilder(function.append_basic_block())
    x, y, z = function.args
    # 0, infinities and NaN: nothing is rounded
    with b.if_then(b.or_(_is_end(b, x), _is_end(b, y))):
        b.ret(b.fadd(b.fmul(x, y), z))
    with b.if_then(_is_infinite(b, z)):
        b.ret(z)
    (p, e), (q, f), (r, g) = (_parts(b, v) for v in (x, y, z))
    e = b.add(e, f)
    far, none = b.sub(g, e), b.fcmp_ordered("==", z, _filled(_DOUBLE, 0.0))
    # A product below an ulp of an ulp of c moves it across no tie.
    with b.if_then(b.and_(b.icmp_signed(">", far, _LONG(120)), b.not_(none))):
        b.ret(z)
    low = b.icmp_signed("<", e, _LONG(_LOW))
    high = b.or_(b.icmp_signed(">", e, _LONG(_HIGH)), b.icmp_signed(">", g, _LONG(1018)))
    shift = b.select(low, _LONG(_UP), b.select(high, _LONG(_DOWN), _LONG(0)))
    q = _times_power(b, q, b.add(e, shift))
    # c far below all bits of the product matters by its sign only
    g = b.select(b.icmp_signed("<", far, _LONG(-300)), b.sub(e, _LONG(300)), g)
    r = b.select(none, z, _times_power(b, r, b.add(g, shift)))
    top, rest = _sum_of_parts(b, p, q, r)
    total = b.fadd(top, rest)
    fabs = module.declare_intrinsic("llvm.fabs", [_DOUBLE])
    kind = ir.FunctionType(_DOUBLE, [_DOUBLE, _DOUBLE])
    copysign = module.declare_intrinsic("llvm.copysign", [_DOUBLE], kind)
    # A sum below the least normal number is rounded at 2^-1074, the ulp of this number beside it.
    least = _filled(_DOUBLE, 2.0 ** (_UP - 1022))
    beside = b.call(copysign, [least, total])
    far_up, error = _two_sum(b, beside, top)
    coarse = b.fsub(b.fadd(far_up, _odd_sum(b, error, rest)), beside)
    coarse = b.call(copysign, [coarse, total])
    small = b.fcmp_ordered("<", b.call(fabs, [total]), least)
    found = b.select(b.and_(low, small), coarse, total)
    half = b.sdiv(b.sub(_LONG(0), shift), _LONG(2))  # 2^1400 would overflow
    power = _times_power(b, _filled(_DOUBLE, 1.0), half)
    b.ret(b.fmul(b.fmul(found, power), power))
    return function


def _field(b: Any, v: Any) -> Any:
    """Return the exponent's field of a number."""
    return b.and_(b.lshr(b.bitcast(v, _LONG), _LONG(52)), _LONG(_TOP))


def _is_infinite(b: Any, v: Any) -> Any:
    """Whether a number is infinite or NaN."""
    return b.icmp_signed("==", _field(b, v), _LONG(_TOP))


def _is_end(b: Any, v: Any) -> Any:
    """Whether a number is 0, infinite or NaN."""
    return b.or_(_is_infinite(b, v), b.fcmp_ordered("==", v, _filled(_DOUBLE, 0.0)))


def _parts(b: Any, v: Any) -> tuple[Any, Any]:
    """Return (m, e), v = m 2^e with 1 <= |m| < 2; v is finite and not 0."""
    tiny = b.icmp_signed("==", _field(b, v), _LONG(0))
    v = b.select(tiny, b.fmul(v, _filled(_DOUBLE, 2.0**64)), v)
    e = b.sub(_field(b, v), b.select(tiny, _LONG(_BIAS + 64), _LONG(_BIAS)))
    kept = b.and_(b.bitcast(v, _LONG), _LONG(~(_TOP << 52)))
    return b.bitcast(b.or_(kept, _LONG(_BIAS << 52)), _DOUBLE), e


def _times_power(b: Any, v: Any, e: Any) -> Any:
    """Return v 2^e for -1022 <= e <= 1023."""
    power = b.shl(b.add(e, _LONG(_BIAS)), _LONG(52))
    return b.fmul(v, b.bitcast(power, _DOUBLE))
