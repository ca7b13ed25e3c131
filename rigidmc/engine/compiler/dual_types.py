"""Numbers with derivatives as types of the compiler: a vector and its tangents.

A `DualType` is a vector of numbers, its value, with their derivatives by k parameters, its
tangents. A function written for one number is compiled for Duals by calling it with them. The value
makes the operations of a vector in the same order, so it keeps every bit; tangents never flow back
into values. A vector or a plain number next to a Dual has no tangents and costs one product for
each tangent in place of two (forward mode: Griewank & Walther, Evaluating Derivatives, 2nd ed.,
SIAM 2008, chapter 3).
"""

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

from rigidmc.engine.compiler.vector_types import (
    COMPARISONS,
    MaskType,
    VectorType,
    broadcast,
    comparison,
    llvm_type,
    of_llvm,
)

_PLAIN = (types.Float, types.Integer)
# An empty field after value and tangents: no tuple of Numba has this type, so `fuse` recognises the
# parts of a Dual by it.
_MARK = ir.ArrayType(ir.IntType(8), 0)


class DualType(types.Type):
    """Vectors of the type `vector`, each with `tangents` derivatives."""

    def __init__(self, vector: VectorType, tangents: int) -> None:
        self.vector, self.tangents = vector, tangents
        self.dtype, self.count = vector.dtype, vector.count
        super().__init__(name=f"{vector} with {tangents} tangents")

    def can_convert_from(self, typingctx: Any, other: Any) -> Conversion | None:
        """Accept numbers and vectors; their tangents are 0."""
        is_constant = isinstance(other, _PLAIN) or other == self.vector
        return Conversion.safe if is_constant else None


@register_default(DualType)
class _Model(PrimitiveModel):
    def __init__(self, manager: Any, ty: Any) -> None:
        vector = llvm_type(ty.vector)
        fields = [vector, ir.ArrayType(vector, ty.tangents), _MARK]
        super().__init__(manager, ty, ir.LiteralStructType(fields))


def is_dual_llvm(ty: Any) -> bool:
    """Return whether a type of LLVM is that of a Dual."""
    return isinstance(ty, ir.LiteralStructType) and len(ty) == 3 and ty.elements[2] == _MARK


def tangents_of(builder: Any, ty: DualType, x: Any) -> list[Any]:
    """Return LLVM code for the tangents of a Dual."""
    return [builder.extract_value(x, (1, j)) for j in range(ty.tangents)]


def make_dual(builder: Any, ty: DualType, value: Any, tangents: Sequence[Any]) -> Any:
    """Return LLVM code for a Dual of a value and its tangents."""
    vector = llvm_type(ty.vector)
    fields = [vector, ir.ArrayType(vector, ty.tangents), _MARK]
    x = ir.Constant(ir.LiteralStructType(fields), ir.Undefined)
    x = builder.insert_value(x, value, 0)
    for j, tangent in enumerate(tangents):
        x = builder.insert_value(x, tangent, (1, j))
    return x


def zeros(ty: DualType) -> list[Any]:
    """Return the tangents of a constant."""
    return [ir.Constant(llvm_type(ty.vector), None)] * ty.tangents


@lower_cast(VectorType, DualType)
def _from_vector(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return make_dual(builder, toty, value, zeros(toty))


@lower_cast(types.Float, DualType)
@lower_cast(types.Integer, DualType)
def _from_plain(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    number = context.cast(builder, value, fromty, toty.dtype)
    return make_dual(builder, toty, broadcast(builder, llvm_type(toty.vector), number), zeros(toty))


def dual_among(kinds: Sequence[Any]) -> DualType | None:
    """Return the Dual among types that may meet in one operation; None if there is none."""
    # a kernel has one number of tangents: two Duals of different numbers are a mistake, not a sum
    dual = next((ty for ty in kinds if isinstance(ty, DualType)), None)
    if dual is None or not all(ty in (dual, dual.vector) or isinstance(ty, _PLAIN) for ty in kinds):
        return None
    return dual


class Operand:
    """An argument of an operation: its value, and its tangents; None for a constant."""

    def __init__(self, context: Any, builder: Any, ty: DualType, kind: Any, x: Any) -> None:
        self.tangents: list[Any] | None = None
        if isinstance(kind, DualType):
            self.value, self.tangents = builder.extract_value(x, 0), tangents_of(builder, kind, x)
        elif isinstance(kind, VectorType):
            self.value = x
        else:
            number = context.cast(builder, x, kind, ty.dtype)
            self.value = broadcast(builder, llvm_type(ty.vector), number)


Build = Callable[..., tuple[Any, list[Any]]]  # build(builder, type, *operands): value and tangents


def _define(operation: Any, arity: int, build: Callable[..., Any]) -> None:
    """Register an operation on Duals with the compiler; one of several operands must be a Dual.

    build : a Build, or for conditions a function that returns the mask alone
    """
    is_condition = operation in COMPARISONS or operation is math.isnan

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            dual = dual_among(args) if len(args) == arity else None
            if dual is None:
                return None
            return signature(MaskType(dual.dtype, dual.count) if is_condition else dual, *args)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        ty: Any = dual_among(sig.args)
        operands = [
            Operand(context, builder, ty, kind, x) for kind, x in zip(sig.args, args, strict=True)
        ]
        made = build(builder, ty, *operands)
        return made if is_condition else make_dual(builder, ty, *made)

    for kinds in _kinds(arity):
        lower_builtin(operation, *kinds)(lower)


def _kinds(arity: int) -> list[tuple[type, ...]]:
    """Return the classes of operands of which one is a Dual."""
    if arity == 1:
        return [(DualType,)]
    others = (VectorType, *_PLAIN)
    mixed = [pair for other in others for pair in ((DualType, other), (other, DualType))]
    return [(DualType, DualType), *mixed]


def part_of_dual(value: Any) -> Any:
    """Return the value or tangent that was put into a Dual and is taken from it; others unchanged.

    Vectors are put into nothing: code that looks for a product then sees the same one as for them.
    """
    while getattr(value, "opname", None) == "extractvalue" and is_dual_llvm(value.operands[0].type):
        dual, place = value.operands[0], tuple(value.indices)
        while getattr(dual, "opname", None) == "insertvalue" and tuple(dual.indices) != place:
            dual = dual.operands[0]
        if getattr(dual, "opname", None) != "insertvalue":
            return value
        value = dual.operands[1]
    return value


def _products(b: Any, ty: DualType, factors: Sequence[tuple[Any, Any]]) -> Any:
    """Return LLVM code for a sum of products, which remembers its factors."""
    (left, right), *rest = factors
    total = b.fmul(left, right)
    for left, right in rest:
        total = of_llvm("fma")(b, ty.vector, left, right, total)
    total.factors = factors
    return total


def _factors_of(tangent: Any) -> list[tuple[Any, Any]]:
    """Return the factors of a sum of products that is made in this function, else []."""
    return getattr(part_of_dual(tangent), "factors", [])


def _plus(b: Any, ty: DualType, p: Any, q: Any) -> Any:
    """Return LLVM code for the sum of two tangents."""
    # The order of sums in tangents is free, in values it is not: products become part of fused
    # multiply-adds from the last to the first, 2 operations for (x y)' + z' in place of 3.
    if not _factors_of(p):
        p, q = q, p
    factors = _factors_of(p)
    for left, right in factors:
        q = of_llvm("fma")(b, ty.vector, left, right, q)
    return q if factors else b.fadd(p, q)


def _minus(b: Any, ty: DualType, p: Any, q: Any) -> Any:
    """Return LLVM code for the difference of two tangents."""
    if _factors_of(p):
        return _plus(b, ty, p, b.fneg(q))
    factors = _factors_of(q)
    for left, right in factors:
        p = of_llvm("fma")(b, ty.vector, b.fneg(left), right, p)
    return p if factors else b.fsub(p, q)


def _add(b: Any, ty: DualType, x: Operand, y: Operand) -> tuple[Any, list[Any]]:
    value = b.fadd(x.value, y.value)
    if x.tangents is None or y.tangents is None:
        return value, x.tangents or y.tangents or []
    return value, [_plus(b, ty, p, q) for p, q in zip(x.tangents, y.tangents, strict=True)]


def _subtract(b: Any, ty: DualType, x: Operand, y: Operand) -> tuple[Any, list[Any]]:
    value = b.fsub(x.value, y.value)
    if y.tangents is None:
        return value, x.tangents or []
    if x.tangents is None:
        return value, [b.fneg(q) for q in y.tangents]
    return value, [_minus(b, ty, p, q) for p, q in zip(x.tangents, y.tangents, strict=True)]


def _multiply(b: Any, ty: DualType, x: Operand, y: Operand) -> tuple[Any, list[Any]]:
    value = b.fmul(x.value, y.value)
    if y.tangents is None:
        return value, [_products(b, ty, [(p, y.value)]) for p in x.tangents or []]
    if x.tangents is None:
        return value, [_products(b, ty, [(x.value, q)]) for q in y.tangents]
    pairs = zip(x.tangents, y.tangents, strict=True)
    return value, [_products(b, ty, [(p, y.value), (x.value, q)]) for p, q in pairs]


def _divide(b: Any, ty: DualType, x: Operand, y: Operand) -> tuple[Any, list[Any]]:
    # (x/y)' = (x' - (x/y) y') / y, with one division for all tangents
    value = b.fdiv(x.value, y.value)
    over = b.fdiv(constant(ty, 1.0), y.value)
    if y.tangents is None:
        return value, [_products(b, ty, [(p, over)]) for p in x.tangents or []]
    away = b.fneg(value)
    if x.tangents is None:
        return value, [b.fmul(b.fmul(away, q), over) for q in y.tangents]
    pairs = zip(x.tangents, y.tangents, strict=True)
    return value, [b.fmul(of_llvm("fma")(b, ty.vector, away, q, p), over) for p, q in pairs]


def constant(ty: DualType, number: float) -> Any:
    """Return LLVM code for a vector with one number in every lane."""
    return ir.Constant(llvm_type(ty.vector), [number] * ty.count)


def choose(b: Any, ty: DualType, mask: Any, one: Operand, other: Operand) -> Any:
    """Return (value, tangents) of one operand where a mask holds, else of the other."""
    tangents = zip(one.tangents or zeros(ty), other.tangents or zeros(ty), strict=True)
    # A select, not a weighted sum: the tangent of the other side may be 0/0, and is dropped.
    value = b.select(mask, one.value, other.value)
    return value, [b.select(mask, p, q) for p, q in tangents]


def _extreme(sign: str) -> Build:
    """Return `max` or `min` as in Python: max(a, b) is b if b > a else a."""
    return lambda b, ty, x, y: choose(b, ty, b.fcmp_ordered(sign, y.value, x.value), y, x)


def dual_root(b: Any, ty: DualType, x: Operand) -> tuple[Any, list[Any]]:
    """Return (value, tangents) of a square root; tangents of 0 at 0, where there are none."""
    value = of_llvm("sqrt")(b, ty.vector, x.value)
    # the divisor is guarded: 0 * inf would be nan, and a later product with 0 would keep it
    divisor = b.select(b.fcmp_ordered(">", value, constant(ty, 0.0)), value, constant(ty, math.inf))
    half = b.fdiv(constant(ty, 0.5), divisor)
    return value, [b.fmul(p, half) for p in x.tangents or []]


def _absolute(b: Any, ty: DualType, x: Operand) -> tuple[Any, list[Any]]:
    negative = b.fcmp_ordered("<", x.value, constant(ty, 0.0))
    tangents = [b.select(negative, b.fneg(p), p) for p in x.tangents or []]
    return of_llvm("fabs")(b, ty.vector, x.value), tangents


def _copy_sign(b: Any, ty: DualType, x: Operand, y: Operand) -> tuple[Any, list[Any]]:
    value = of_llvm("copysign")(b, ty.vector, x.value, y.value)
    # copysign(1, x y) without the product: whether the sign of x changes
    unit = constant(ty, 1.0)
    by = b.fmul(
        of_llvm("copysign")(b, ty.vector, unit, x.value),
        of_llvm("copysign")(b, ty.vector, unit, y.value),
    )
    return value, [b.fmul(p, by) for p in x.tangents or zeros(ty)]


def _step_function(name: str) -> Build:
    """Return a function whose derivative is 0 wherever it has one."""
    return lambda b, ty, x: (of_llvm(name)(b, ty.vector, x.value), zeros(ty))


for _operation, _build in (
    (operator.add, _add),
    (operator.iadd, _add),
    (operator.sub, _subtract),
    (operator.isub, _subtract),
    (operator.mul, _multiply),
    (operator.imul, _multiply),
    (operator.truediv, _divide),
    (operator.itruediv, _divide),
    (max, _extreme(">")),
    (min, _extreme("<")),
    (math.copysign, _copy_sign),
):
    _define(_operation, 2, _build)
_define(operator.neg, 1, lambda b, ty, x: (b.fneg(x.value), [b.fneg(p) for p in x.tangents]))
_define(operator.pos, 1, lambda b, ty, x: (x.value, x.tangents))
_define(abs, 1, _absolute)
_define(math.fabs, 1, _absolute)
_define(math.sqrt, 1, dual_root)
for _rounding in (math.floor, math.ceil, math.trunc):
    _define(_rounding, 1, _step_function(_rounding.__name__))
for _operation, _sign in COMPARISONS.items():
    _define(
        _operation,
        2,
        lambda b, ty, x, y, sign=_sign: comparison(sign)(b, ty.vector, x.value, y.value),
    )
_define(math.isnan, 1, lambda b, ty, x: b.fcmp_unordered("uno", x.value, x.value))
