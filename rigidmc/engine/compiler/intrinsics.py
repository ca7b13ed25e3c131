"""Plain functions of the package with special code when compiled.

They serve where vectors have no operator: a choice between two numbers by a mask, another
precision, the bits of a number as a word. In Python the function itself runs.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template
from numba.extending import intrinsic as numba_intrinsic

from rigidmc.engine.compiler.dual_types import (
    DualType,
    Operand,
    choose,
    dual_among,
    dual_root,
    make_dual,
    tangents_of,
)
from rigidmc.engine.compiler.vector_types import (
    MaskType,
    VectorType,
    first_of,
    invert,
    llvm_type,
    of_llvm,
)
from rigidmc.physics.dynamics.functions import as_float, as_given, as_word, double
from rigidmc.physics.dynamics.so3 import by_precision, logical_not, root, select, select_all

Define = Callable[..., Any]
INTRINSICS: set[Callable[..., Any]] = set()  # functions with special code


def intrinsic(function: Callable[..., Any]) -> Callable[[Define], Define]:
    """Return a decorator that registers compiler code for a plain function.

    It decorates define(typing_context, *types) -> (signature, generate), or None if the types do
    not fit. An `overload` would work, but adds a function to compile, 10 to 20 ms each, wherever it
    is called.
    """

    def register(define: Define) -> Define:
        INTRINSICS.add(function)
        register_template(make_intrinsic_template(function, define, function.__name__))
        return define

    return register


def register_template(template: Any) -> None:
    """Register a function with the compiler by a template of its types."""
    infer(template)
    infer_global(template.key, types.Function(template))


def _first_argument(context, builder, sig, args):
    return args[0]


def _select_parts(context, builder, condition, dual, kinds, values):
    """Return LLVM code that selects the value and the tangents of one of two numbers."""
    operands = (
        Operand(context, builder, dual, kind, x) for kind, x in zip(kinds, values, strict=True)
    )
    return make_dual(builder, dual, *choose(builder, dual, condition, *operands))


@intrinsic(select)
def _select(typing_context, condition, one, other):
    if isinstance(condition, types.Boolean):
        ty = typing_context.unify_types(one, other)
        return ty and (
            ty(condition, ty, ty),
            lambda context, builder, sig, args: builder.select(*args),
        )
    if not isinstance(condition, MaskType):
        return None
    # before the vectors: a plain vector beside a Dual is one with tangents of 0
    if (dual := dual_among((one, other))) is not None:
        return dual(condition, one, other), lambda context, builder, sig, args: _select_parts(
            context, builder, args[0], dual, sig.args[1:], args[1:]
        )
    vectors = [t for t in (one, other) if isinstance(t, (VectorType, MaskType))]
    if any(t != vectors[0] for t in vectors):
        return None
    # Plain numbers on both sides get their width from the mask.
    truths = isinstance(one, types.Boolean) and isinstance(other, types.Boolean)
    ty = (
        vectors[0]
        if vectors
        else (MaskType if truths else VectorType)(condition.dtype, condition.count)
    )
    return ty(condition, ty, ty), lambda context, builder, sig, args: builder.select(*args)


@intrinsic(select_all)
def _select_each(typing_context, condition, one, other):
    pairs = zip(one, other, strict=True)
    definitions = [_select(typing_context, condition, a, b) for a, b in pairs]
    if None in definitions:
        return None
    kinds = types.Tuple([signature.return_type for signature, _ in definitions])

    def generate(context, builder, sig, args):
        chosen = []
        for i, ty in enumerate(kinds):
            both = [builder.extract_value(x, i) for x in args[1:]]
            pair = [tuple_ty[i] for tuple_ty in sig.args[1:]]
            if isinstance(ty, DualType) and isinstance(condition, MaskType):
                chosen.append(_select_parts(context, builder, args[0], ty, pair, both))
            else:
                cast = [context.cast(builder, *each, ty) for each in zip(both, pair, strict=True)]
                chosen.append(builder.select(args[0], *cast))
        return context.make_tuple(builder, kinds, chosen)

    return kinds(condition, one, other), generate


@intrinsic(logical_not)
def _opposite(typing_context, condition):
    if isinstance(condition, types.Boolean):
        return condition(condition), lambda context, builder, sig, args: builder.not_(args[0])
    if isinstance(condition, MaskType):
        return condition(condition), lambda context, builder, sig, args: invert(
            builder, condition, args[0]
        )
    return None


@intrinsic(root)
def _root(typing_context, x):
    if isinstance(x, VectorType):
        return x(x), lambda context, builder, sig, args: of_llvm("sqrt")(builder, x, *args)
    if isinstance(x, DualType):
        return x(x), lambda context, builder, sig, args: make_dual(
            builder, x, *dual_root(builder, x, Operand(context, builder, x, x, args[0]))
        )
    ty = x if isinstance(x, types.Float) else types.float64
    return ty(ty), lambda context, builder, sig, args: builder.call(
        builder.module.declare_intrinsic("llvm.sqrt", [args[0].type]), args
    )


@intrinsic(by_precision)
def _by_precision(typing_context, x, double, single):
    is_single = isinstance(x, (VectorType, DualType)) and x.dtype == types.float32
    place = 2 if is_single else 1
    ty = types.unliteral((double, single)[place - 1])
    return ty(x, double, single), lambda context, builder, sig, args: args[place]


def any_of(mask):
    """Return whether a condition holds for any of the current members: the one branch in
    kernels."""
    return bool(mask)


@intrinsic(any_of)
def _any_of(typing_context, mask):
    def generate(context, builder, sig, args):
        bits = builder.bitcast(args[0], ir.IntType(mask.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


def _reinterpret(ty: Any) -> Define:
    """Return the definition of a function that reinterprets the bits of numbers as another type."""

    def define(typing_context, x):
        if isinstance(x, DualType):  # bits have no derivatives
            other = VectorType(ty, x.count)
            return other(x), lambda context, builder, sig, args: builder.bitcast(
                builder.extract_value(args[0], 0), llvm_type(other)
            )
        other = VectorType(ty, x.count) if isinstance(x, VectorType) else ty
        return other(x), lambda context, builder, sig, args: builder.bitcast(
            args[0], context.get_value_type(other)
        )

    return define


intrinsic(as_float)(_reinterpret(types.float64))
intrinsic(as_word)(_reinterpret(types.uint64))


def _convert(context: Any, builder: Any, x: Any, ty: VectorType, value: Any) -> Any:
    """Convert a number of type x to type `ty`, with its tangents."""
    if isinstance(x, DualType):
        parts = [builder.extract_value(value, 0), *tangents_of(builder, x, value)]
        first, *rest = (_convert(context, builder, x.vector, ty, part) for part in parts)
        return make_dual(builder, DualType(ty, x.tangents), first, rest)
    if not isinstance(x, VectorType):
        return context.cast(builder, value, x, ty)
    if x.dtype == ty.dtype:
        return value
    convert = builder.fptrunc if ty.dtype == types.float32 else builder.fpext
    return convert(value, llvm_type(ty))


def _like(x: Any, ty: VectorType) -> Any:
    """Return the type of a number of type x as `ty`: the tangents of x stay."""
    return DualType(ty, x.tangents) if isinstance(x, DualType) else ty


def cast_like(x, other):
    """Return x as a number; compiled, as a vector with the width and precision of `other`."""
    return x


@intrinsic(cast_like)
def _cast_like(typing_context, x, other):
    if not getattr(other, "count", 0):  # Vecs and Rows of vectors have one
        return x(x, other), _first_argument
    ty = VectorType(other.dtype, other.count)
    return _like(x, ty)(x, other), lambda context, builder, sig, args: _convert(
        context, builder, x, ty, args[0]
    )


@intrinsic(as_given)
def _as_given(typing_context, x, other):
    return _cast_like(typing_context, x, other)


def in_precision(values, other):
    """Apply `cast_like` to each number of a tuple."""
    return tuple(values)


@intrinsic(in_precision)
def _in_precision(typing_context, values, other):
    if not getattr(other, "count", 0) or not len(values):
        return values(values, other), _first_argument
    ty = VectorType(other.dtype, other.count)

    def generate(context, builder, sig, args):
        each = (
            _convert(context, builder, x, ty, builder.extract_value(args[0], i))
            for i, x in enumerate(values)
        )
        return context.make_tuple(builder, sig.return_type, list(each))

    return types.Tuple([_like(x, ty) for x in values])(values, other), generate


@intrinsic(double)
def _double(typing_context, x):
    if not (isinstance(x, (VectorType, DualType)) and x.dtype == types.float32):
        return x(x), _first_argument
    ty = VectorType(types.float64, x.count)
    return _like(x, ty)(x), lambda context, builder, sig, args: _convert(
        context, builder, x, ty, args[0]
    )


@numba_intrinsic
def first_number(typing_context, x):
    """Return the number of a vector of one number."""
    return x.dtype(x), lambda context, builder, sig, args: first_of(builder, x, args[0])
