"""Vectors of numbers as types of the compiler: float64xN, float32xN, uint64xN, and masks.

A function that is written for one number is compiled for N of them by calling it with these; nothing is left to an optimiser's insight. They have + - * /,
comparisons, & | ^ << >>, abs, sqrt, min, max and copysign; plain numbers are broadcast. In Python, and uncompiled, a number is a float, and a mask a bool.
Of a vector of one number a mask is also a bool, and every function of the library takes it: for the code of a user that no vector can run.
"""

import math
import operator
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel import register_default
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import (
    AbstractTemplate,
    infer,
    infer_global,
    make_intrinsic_template,
    signature,
)
from numba.extending import intrinsic

from rigidmc.dynamics.functions import as_float, as_given, as_word, double
from rigidmc.dynamics.so3 import by_precision, opposite, root, select, select_each

ELEMENT = {
    "float64": ir.DoubleType(),
    "float32": ir.FloatType(),
    "uint64": ir.IntType(64),
    "int64": ir.IntType(64),
}
_PLAIN = (types.Float, types.Integer)


class Vec(types.Type):
    """`count` numbers of one dtype side by side."""

    def __init__(self, dtype, count):
        self.dtype, self.count = dtype, count
        super().__init__(name=f"{dtype}x{count}")

    @property
    def real(self):
        """Whether they are floats."""
        return isinstance(self.dtype, types.Float)

    def can_convert_from(self, typingctx, other):
        """Plain numbers are broadcast."""
        return Conversion.safe if isinstance(other, _PLAIN) else None


class Mask(types.Type):
    """`count` truth values, of comparisons of numbers of one dtype."""

    def __init__(self, dtype, count):
        self.dtype, self.count = dtype, count
        super().__init__(name=f"mask of {dtype}x{count}")

    def can_convert_from(self, typingctx, other):
        """Plain truth values are broadcast, and masks of other numbers are as good."""
        same = isinstance(other, Mask) and other.count == self.count
        return Conversion.safe if same or isinstance(other, types.Boolean) else None

    def can_convert_to(self, typingctx, other):
        """One truth value is a plain one."""
        return Conversion.unsafe if self.count == 1 and isinstance(other, types.Boolean) else None


def llvm_type(kind):
    """LLVM's type of a Vec or Mask."""
    return ir.VectorType(
        ELEMENT[kind.dtype.name] if isinstance(kind, Vec) else ir.IntType(1), kind.count
    )


for _kind in (Vec, Mask):

    @register_default(_kind)
    class _Model(PrimitiveModel):
        def __init__(self, manager, kind):
            super().__init__(manager, kind, llvm_type(kind))


def broadcast(builder, kind, x):
    """A vector of LLVM's type `kind` whose numbers all are x."""
    none = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(none, x, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, none, ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    )


@lower_cast(types.Float, Vec)
@lower_cast(types.Integer, Vec)
def _to_vec(context, builder, fromty, toty, value):
    return broadcast(builder, llvm_type(toty), context.cast(builder, value, fromty, toty.dtype))


@lower_cast(types.Boolean, Mask)
def _to_mask(context, builder, fromty, toty, value):
    return broadcast(
        builder,
        llvm_type(toty),
        builder.trunc(value, ir.IntType(1)) if value.type.width > 1 else value,
    )


@lower_cast(Mask, Mask)
def _same_mask(context, builder, fromty, toty, value):
    return value


@lower_cast(Mask, types.Boolean)
def _from_mask(context, builder, fromty, toty, value):
    return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))


def _common(args, kind, plain):
    """The type of two arguments, of which one may be plain."""
    one, two = args
    if isinstance(one, kind) and (one == two or isinstance(two, plain)):
        return one
    if isinstance(two, kind) and isinstance(one, plain):
        return two
    return (
        one
        if kind is Mask
        and isinstance(one, Mask)
        and isinstance(two, Mask)
        and one.count == two.count
        else None
    )


def _define(operation, arity, build, result=None, kind: Any = Vec, plain=_PLAIN, only=None):
    """Give the compiler an operation on Vecs or Masks: build(builder, type, *values); result: the type from that of the arguments."""

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args, kws):
            if len(args) != arity:
                return None
            found = (
                _common(args, kind, plain)
                if arity == 2
                else args[0]
                if isinstance(args[0], kind)
                else None
            )
            if found is None or (only is not None and not only(found)):
                return None
            return signature(found if result is None else result(found), *[found] * arity)

    @lower_builtin(operation, *[kind] * arity)
    def lower(context, builder, sig, args):
        return build(builder, sig.args[0], *args)


def _by(real, whole):
    """An operation of one name for floats and another for words."""
    return lambda b, t, *values: getattr(b, real if t.real else whole)(*values)


def _of_llvm(name):
    """An intrinsic function of LLVM, as an operation."""

    def build(b, t, *values):
        word = f"llvm.{name}.v{t.count}{'f64' if t.dtype.name == 'float64' else 'f32'}"
        kind = llvm_type(t)
        return b.call(
            b.module.declare_intrinsic(word, (), ir.FunctionType(kind, [kind] * len(values))),
            values,
        )

    return build


def _compared(sign):
    def build(b, t, x, y):
        if not t.real:
            return b.icmp_unsigned(sign, x, y)
        return (b.fcmp_unordered if sign == "!=" else b.fcmp_ordered)(sign, x, y)

    return build


def _mask_of(kind):
    return Mask(types.float64 if kind.dtype == types.uint64 else kind.dtype, kind.count)


def _opposite(b, t, x):
    return b.xor(x, ir.Constant(llvm_type(t), [1] * t.count))


def _words(kind):
    return not kind.real


def _floats(kind):
    return kind.real


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
        kind=Mask,
        plain=(types.Boolean,),
    )
for _operation, _name in ((operator.lshift, "shl"), (operator.rshift, "lshr")):
    _define(_operation, 2, _by("", _name), only=_words)
for _operation, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _define(_operation, 2, _compared(_sign), result=_mask_of)
for _operation in (operator.eq, operator.ne):
    _define(
        _operation,
        2,
        lambda b, t, x, y, sign="==" if _operation is operator.eq else "!=": b.icmp_unsigned(
            sign, x, y
        ),
        kind=Mask,
        plain=(types.Boolean,),
    )
_define(operator.neg, 1, lambda b, t, x: b.fneg(x), only=_floats)
_define(operator.pos, 1, lambda b, t, x: x)
_define(abs, 1, _of_llvm("fabs"), only=_floats)
_define(math.fabs, 1, _of_llvm("fabs"), only=_floats)
for _operation in (math.floor, math.ceil, math.trunc):
    _define(_operation, 1, _of_llvm(_operation.__name__), only=_floats)
_define(math.isnan, 1, lambda b, t, x: b.fcmp_unordered("uno", x, x), result=_mask_of, only=_floats)
_define(math.sqrt, 1, _of_llvm("sqrt"), only=_floats)
_define(math.copysign, 2, _of_llvm("copysign"), only=_floats)
# as Python's own: max(a, b) is b if b > a else a
_define(max, 2, lambda b, t, x, y: b.select(b.fcmp_ordered(">", y, x), y, x), only=_floats)
_define(min, 2, lambda b, t, x, y: b.select(b.fcmp_ordered("<", y, x), y, x), only=_floats)
_define(
    bool,
    1,
    lambda b, t, x: b.extract_element(x, ir.Constant(ir.IntType(32), 0)),
    lambda t: types.boolean,
    Mask,
    only=lambda t: t.count == 1,
)


def coded(function):
    """Give the compiler code of its own for a plain function, from define(typing_context, *types) -> (signature, generate), or None for types that it does not take.

    An `overload` would do, but is a function more to compile, 10 to 20 ms each, wherever it is called.
    """

    def register(define):
        known_by(make_intrinsic_template(function, define, function.__name__))
        return define

    return register


def known_by(template):
    """Let the compiler know a function by a template of its types."""
    infer(template)
    infer_global(template.key, types.Function(template))


def _first(context, builder, sig, args):
    return args[0]


@coded(select)
def _select(typing_context, condition, one, other):
    if isinstance(condition, types.Boolean):
        kind = typing_context.unify_types(one, other)
        return kind and (
            kind(condition, kind, kind),
            lambda context, builder, sig, args: builder.select(*args),
        )
    if not isinstance(condition, Mask):
        return None
    found = [t for t in (one, other) if isinstance(t, (Vec, Mask))]
    if any(t != found[0] for t in found):
        return None
    boolean = isinstance(one, types.Boolean) and isinstance(other, types.Boolean)
    kind = found[0] if found else (Mask if boolean else Vec)(condition.dtype, condition.count)
    return kind(condition, kind, kind), lambda context, builder, sig, args: builder.select(*args)


@coded(select_each)
def _select_each(typing_context, condition, one, other):
    definitions = [
        _select(typing_context, condition, a, b) for a, b in zip(one, other, strict=True)
    ]
    if None in definitions:
        return None
    kinds = types.Tuple([signature.return_type for signature, _ in definitions])

    def generate(context, builder, sig, args):
        both = [
            context.cast(builder, value, kind, kinds)
            for value, kind in zip(args[1:], sig.args[1:], strict=True)
        ]
        each = [[builder.extract_value(x, i) for x in both] for i in range(len(kinds))]
        return context.make_tuple(builder, kinds, [builder.select(args[0], a, b) for a, b in each])

    return kinds(condition, one, other), generate


@coded(opposite)
def _opposite_of(typing_context, condition):
    if isinstance(condition, types.Boolean):
        return condition(condition), lambda context, builder, sig, args: builder.not_(args[0])
    if isinstance(condition, Mask):
        return condition(condition), lambda context, builder, sig, args: _opposite(
            builder, condition, args[0]
        )
    return None


@coded(root)
def _root(typing_context, x):
    if isinstance(x, Vec):
        return x(x), lambda context, builder, sig, args: _of_llvm("sqrt")(builder, x, *args)
    kind = x if isinstance(x, types.Float) else types.float64
    return kind(kind), lambda context, builder, sig, args: builder.call(
        builder.module.declare_intrinsic("llvm.sqrt", [args[0].type]), args
    )


@coded(by_precision)
def _by_precision(typing_context, x, double, single):
    place = 2 if isinstance(x, Vec) and x.dtype == types.float32 else 1
    return types.unliteral((double, single)[place - 1])(
        x, double, single
    ), lambda context, builder, sig, args: args[place]


def any_of(mask):
    """Whether a condition holds for any of the members that are worked on."""
    return bool(mask)


@coded(any_of)
def _any_of(typing_context, mask):
    def generate(context, builder, sig, args):
        if isinstance(mask, types.Boolean):
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(mask.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


def _reinterpreted(kind):
    """The definition of a function that takes the bits of numbers for those of another kind."""

    def define(typing_context, x):
        found = Vec(kind, x.count) if isinstance(x, Vec) else kind
        return found(x), lambda context, builder, sig, args: builder.bitcast(
            args[0], context.get_value_type(found)
        )

    return define


coded(as_float)(_reinterpreted(types.float64))
coded(as_word)(_reinterpreted(types.uint64))


def _brought(context, builder, x, kind, value):
    """A number of type x as one of the type `kind`, a Vec."""
    if not isinstance(x, Vec):
        return context.cast(builder, value, x, kind)
    if x.dtype == kind.dtype:
        return value
    return (builder.fptrunc if kind.dtype == types.float32 else builder.fpext)(
        value, llvm_type(kind)
    )


def like(x, other):
    """x as a number, or as rows have them: as many at once, in that precision."""
    return x


@coded(like)
def _like(typing_context, x, other):
    if not getattr(other, "count", 0):
        return x(x, other), _first
    kind = Vec(other.dtype, other.count)
    return kind(x, other), lambda context, builder, sig, args: _brought(
        context, builder, x, kind, args[0]
    )


@coded(as_given)
def _as_given(typing_context, found, x):
    return _like(typing_context, found, x)


def in_precision(values, other):
    """Numbers in the precision of others."""
    return tuple(values)


@coded(in_precision)
def _in_precision(typing_context, values, other):
    if not getattr(other, "count", 0) or not len(values):
        return values(values, other), _first
    kind = Vec(other.dtype, other.count)

    def generate(context, builder, sig, args):
        each = (
            _brought(context, builder, x, kind, builder.extract_value(args[0], i))
            for i, x in enumerate(values)
        )
        return context.make_tuple(builder, sig.return_type, list(each))

    return types.UniTuple(kind, len(values))(values, other), generate


@coded(double)
def _double(typing_context, x):
    if not (isinstance(x, Vec) and x.dtype == types.float32):
        return x(x), _first
    kind = Vec(types.float64, x.count)
    return kind(x), lambda context, builder, sig, args: builder.fpext(args[0], llvm_type(kind))


@intrinsic
def plain(typing_context, x):
    """The number that a vector of one number has."""
    return x.dtype(x), lambda context, builder, sig, args: builder.extract_element(
        args[0], ir.Constant(ir.IntType(32), 0)
    )
