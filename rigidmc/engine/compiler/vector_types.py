"""Vectors of numbers as types of the compiler: float64xN, float32xN, uint64xN, and masks.

A function written for one number is compiled for N numbers by calling it with these types: nothing
depends on an optimiser. They have + - * /, comparisons, & | ^ << >>, abs, sqrt, min, max and
copysign; plain numbers are broadcast. Functions with special code for them are in
`rigidmc.engine.compiler.intrinsics`. In Python, and uncompiled, a number is a float and a mask is a
bool. For custom code that cannot run on vectors, a mask of one number is also a bool, and every
library function accepts a vector of one number.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

ELEMENT = {
    "float64": ir.DoubleType(),
    "float32": ir.FloatType(),
    "uint64": ir.IntType(64),
    "int64": ir.IntType(64),
}
COMPARISONS = {
    operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "==",
    operator.ne: "!=",
}  # fmt: skip
_PLAIN = (types.Float, types.Integer)
_INDEX = ir.IntType(32)


class VectorType(types.Type):
    """`count` numbers of one dtype side by side."""

    def __init__(self, dtype: Any, count: int) -> None:
        self.dtype, self.count = dtype, count
        super().__init__(name=f"{dtype}x{count}")

    @property
    def real(self) -> bool:
        """Whether the numbers are floats."""
        return isinstance(self.dtype, types.Float)

    def can_convert_from(self, typingctx: Any, other: Any) -> Conversion | None:
        """Accept plain numbers, which are broadcast."""
        return Conversion.safe if isinstance(other, _PLAIN) else None


class MaskType(types.Type):
    """`count` truth values, from comparisons of numbers of one dtype."""

    def __init__(self, dtype: Any, count: int) -> None:
        self.dtype, self.count = dtype, count
        super().__init__(name=f"mask of {dtype}x{count}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Conversion | None:
        """Accept plain truth values, which are broadcast, and masks of other numbers."""
        same = isinstance(other, MaskType) and other.count == self.count
        return Conversion.safe if same or isinstance(other, types.Boolean) else None

    def can_convert_to(self, typingctx: Any, other: Any) -> Conversion | None:
        """Convert a mask of one to a plain truth value."""
        return Conversion.unsafe if self.count == 1 and isinstance(other, types.Boolean) else None


def llvm_type(ty: "VectorType | MaskType") -> ir.VectorType:
    """Return LLVM's type of a VectorType or MaskType."""
    element = ELEMENT[ty.dtype.name] if isinstance(ty, VectorType) else ir.IntType(1)
    return ir.VectorType(element, ty.count)


for _kind in (VectorType, MaskType):

    @register_default(_kind)
    class _Model(PrimitiveModel):
        def __init__(self, manager: Any, ty: Any) -> None:
            super().__init__(manager, ty, llvm_type(ty))


def broadcast(builder: Any, ty: ir.VectorType, x: Any) -> Any:
    """Return a vector of LLVM's type `ty` whose numbers are all x."""
    # LLVM's idiom for a broadcast: an undefined vector, its first element, and a shuffle with all
    # 0. `fma` recognises it.
    undefined = ir.Constant(ty, ir.Undefined)
    first = builder.insert_element(undefined, x, ir.Constant(_INDEX, 0))
    zeros = ir.Constant(ir.VectorType(_INDEX, ty.count), [0] * ty.count)
    return builder.shuffle_vector(first, undefined, zeros)


@lower_cast(types.Float, VectorType)
@lower_cast(types.Integer, VectorType)
def _to_vec(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return broadcast(builder, llvm_type(toty), context.cast(builder, value, fromty, toty.dtype))


@lower_cast(types.Boolean, MaskType)
def _to_mask(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    # Numba keeps a bool in memory as a byte, and as a bit in registers.
    bit = builder.trunc(value, ir.IntType(1)) if value.type.width > 1 else value
    return broadcast(builder, llvm_type(toty), bit)


@lower_cast(MaskType, MaskType)
def _same_mask(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return value


@lower_cast(MaskType, types.Boolean)
def _from_mask(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return builder.extract_element(value, ir.Constant(_INDEX, 0))


Build = Callable[..., Any]  # build(builder, type, *values): LLVM code of an operation


def _common(args: Any, ty: type, plain_types: tuple[type, ...]) -> Any:
    """Return the type of two arguments, one of which may be plain; None if there is none."""
    left, right = args
    if isinstance(left, ty) and (left == right or isinstance(right, plain_types)):
        return left
    if isinstance(right, ty) and isinstance(left, plain_types):
        return right
    return None


def _define(
    operation: Any,
    arity: int,
    build: Build,
    result: Callable[[Any], Any] | None = None,
    ty: type = VectorType,
    plain_types: tuple[type, ...] = _PLAIN,
    only: Callable[[Any], bool] | None = None,
) -> None:
    """Register an operation on vectors or masks with the compiler.

    result : function from the type of the arguments to the type of the result, by default the same
    only : condition on the types for which it is defined, by default all
    """

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) != arity:
                return None
            operand = args[0] if isinstance(args[0], ty) else None
            if arity == 2:
                operand = _common(args, ty, plain_types)
            if operand is None or (only is not None and not only(operand)):
                return None
            return signature(operand if result is None else result(operand), *[operand] * arity)

    @lower_builtin(operation, *[ty] * arity)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return build(builder, sig.args[0], *args)


def _by(real: str, word: str) -> Build:
    """Return an operation that LLVM's builder calls `real` for floats and `word` for words."""
    return lambda b, t, *values: getattr(b, real if t.real else word)(*values)


def of_llvm(name: str) -> Build:
    """Return an operation that is an LLVM intrinsic."""

    def build(b: Any, t: Any, *values: Any) -> Any:
        intrinsic_name = f"llvm.{name}.v{t.count}{'f64' if t.dtype.name == 'float64' else 'f32'}"
        ty = llvm_type(t)
        function = ir.FunctionType(ty, [ty] * len(values))
        return b.call(b.module.declare_intrinsic(intrinsic_name, (), function), values)

    return build


def comparison(sign: str) -> Build:
    """Return a comparison of floats, words or masks."""

    def build(b: Any, t: Any, x: Any, y: Any) -> Any:
        if isinstance(t, MaskType) or not t.real:
            return b.icmp_unsigned(sign, x, y)
        # != is true for nan and all others are false, as in Python; so `x != x` detects nan.
        return (b.fcmp_unordered if sign == "!=" else b.fcmp_ordered)(sign, x, y)

    return build


def _mask_of(ty: VectorType) -> MaskType:
    """Return the type of a comparison."""
    # Words choose between floats, so their masks count as masks of float64.
    return MaskType(types.float64 if ty.dtype == types.uint64 else ty.dtype, ty.count)


def invert(b: Any, t: MaskType, x: Any) -> Any:
    """Invert every truth value of a mask."""
    return b.xor(x, ir.Constant(llvm_type(t), [1] * t.count))


def first_of(b: Any, t: Any, x: Any) -> Any:
    """Return the first number of a vector, or the first truth value of a mask."""
    return b.extract_element(x, ir.Constant(_INDEX, 0))


def _words(ty: Any) -> bool:
    return not ty.real


def _floats(ty: Any) -> bool:
    return bool(ty.real)


_TRUTH = (types.Boolean,)
for _operations, _real, _whole in (
    ((operator.add, operator.iadd), "fadd", "add"),
    ((operator.sub, operator.isub), "fsub", "sub"),
    ((operator.mul, operator.imul), "fmul", "mul"),
):
    for _operation in _operations:
        _define(_operation, 2, _by(_real, _whole))
for _operation in (operator.truediv, operator.itruediv):
    _define(_operation, 2, _by("fdiv", ""), only=_floats)
for _operation, _name in ((operator.and_, "and_"), (operator.or_, "or_"), (operator.xor, "xor")):
    _define(_operation, 2, _by("", _name), only=_words)
    _define(
        _operation,
        2,
        lambda b, t, x, y, name=_name: getattr(b, name)(x, y),
        ty=MaskType,
        plain_types=_TRUTH,
    )
for _operation, _name in ((operator.lshift, "shl"), (operator.rshift, "lshr")):
    _define(_operation, 2, _by("", _name), only=_words)
for _operation, _sign in COMPARISONS.items():
    _define(_operation, 2, comparison(_sign), result=_mask_of)
for _operation in (operator.eq, operator.ne):
    _define(_operation, 2, comparison(COMPARISONS[_operation]), ty=MaskType, plain_types=_TRUTH)
_define(operator.neg, 1, lambda b, t, x: b.fneg(x), only=_floats)
_define(operator.pos, 1, lambda b, t, x: x)
_define(abs, 1, of_llvm("fabs"), only=_floats)
_define(math.fabs, 1, of_llvm("fabs"), only=_floats)
for _rounding in (math.floor, math.ceil, math.trunc):
    _define(_rounding, 1, of_llvm(_rounding.__name__), only=_floats)
_define(math.isnan, 1, lambda b, t, x: b.fcmp_unordered("uno", x, x), result=_mask_of, only=_floats)
_define(math.sqrt, 1, of_llvm("sqrt"), only=_floats)
_define(math.copysign, 2, of_llvm("copysign"), only=_floats)
# as Python's own: max(a, b) is b if b > a else a
_define(max, 2, lambda b, t, x, y: b.select(b.fcmp_ordered(">", y, x), y, x), only=_floats)
_define(min, 2, lambda b, t, x, y: b.select(b.fcmp_ordered("<", y, x), y, x), only=_floats)
_define(bool, 1, first_of, lambda t: types.boolean, MaskType, only=lambda t: t.count == 1)
