"""Vectors of numbers as types of the compiler: float64xN, float32xN, uint64xN, and masks.

A function that is written for one number is compiled for N of them by calling it with these; nothing is left to an optimiser's insight. They have + - * /,
comparisons, & | ^ << >>, abs, sqrt, min, max and copysign; plain numbers are broadcast. In Python, and uncompiled, a number is a float, and a mask a bool.
Of a vector of one number a mask is also a bool, and every function of the library takes it: for the code of a user that no vector can run.
"""

import math
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel import register_default
from numba.core.datamodel.models import OpaqueModel, PrimitiveModel
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import NativeValue, intrinsic, overload, typeof_impl, unbox

from rigidmc.dynamics.functions import as_float, as_word, double
from rigidmc.engine.fused import INLINE

ELEMENT = {"float64": ir.DoubleType(), "float32": ir.FloatType(), "uint64": ir.IntType(64), "int64": ir.IntType(64)}
_PLAIN = (types.Float, types.Integer)
_WORD, _NO_WORD = ir.IntType(64), np.uint64(0)


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


class Rows(types.Type):
    """Memory as vectors one after the other: rows[i] is a Vec; of count 0, as plain numbers. In Python an array.

    pitch : numbers from one row to the next, of rows that are part of longer ones
    """

    def __init__(self, dtype, count, pitch=None):
        self.dtype, self.count, self.pitch = dtype, count, pitch or count
        super().__init__(name=f"rows of {dtype}x{count}" + (f" in {pitch}" if pitch else ""))

    @property
    def item(self):
        """The type of rows[i]."""
        return Vec(self.dtype, self.count) if self.count else self.dtype


class Lanes:
    """How many members are worked on at once: a value whose type tells it, so that it is in the key of whatever is compiled."""

    def __init__(self, count):
        self.count = count


class LanesType(types.Type):
    """The type of Lanes."""

    def __init__(self, count):
        self.count = count
        super().__init__(name=f"lanes x{count}")


def llvm_type(kind):
    """LLVM's type of a Vec or Mask."""
    return ir.VectorType(ELEMENT[kind.dtype.name] if isinstance(kind, Vec) else ir.IntType(1), kind.count)


for _kind in (Vec, Mask):

    @register_default(_kind)
    class _Model(PrimitiveModel):
        def __init__(self, manager, kind):
            super().__init__(manager, kind, llvm_type(kind))


for _kind in (Rows, LanesType):
    register_default(_kind)(OpaqueModel)


@typeof_impl.register(Lanes)
def _typeof_lanes(value, context):
    return LanesType(value.count)


@unbox(LanesType)
def _unbox_lanes(kind, value, context):
    return NativeValue(context.context.get_dummy_value())


def broadcast(builder, kind, x):
    """A vector of LLVM's type `kind` whose numbers all are x."""
    none = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(none, x, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, none, ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count))


@lower_cast(types.Float, Vec)
@lower_cast(types.Integer, Vec)
def _to_vec(context, builder, fromty, toty, value):
    return broadcast(builder, llvm_type(toty), context.cast(builder, value, fromty, toty.dtype))


@lower_cast(types.Boolean, Mask)
def _to_mask(context, builder, fromty, toty, value):
    return broadcast(builder, llvm_type(toty), builder.trunc(value, ir.IntType(1)) if value.type.width > 1 else value)


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
    return one if kind is Mask and isinstance(one, Mask) and isinstance(two, Mask) and one.count == two.count else None


def _define(operation, arity, build, result=None, kind: Any = Vec, plain=_PLAIN, only=None):
    """Give the compiler an operation on Vecs or Masks: build(builder, type, *values); result: the type from that of the arguments."""

    @infer_global(operation)
    class Template(AbstractTemplate):
        def generic(self, args, kws):
            if len(args) != arity:
                return None
            found = _common(args, kind, plain) if arity == 2 else args[0] if isinstance(args[0], kind) else None
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
        return b.call(b.module.declare_intrinsic(word, (), ir.FunctionType(kind, [kind] * len(values))), values)

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
    _define(_operation, 2, lambda b, t, x, y, name=_name: getattr(b, name)(x, y), kind=Mask, plain=(types.Boolean,))
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
        lambda b, t, x, y, sign="==" if _operation is operator.eq else "!=": b.icmp_unsigned(sign, x, y),
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


@intrinsic(prefer_literal=False)
def blend(typing_context, mask, one, other):
    """Where the mask holds numbers of one, elsewhere of the other; of plain numbers those of the mask's type."""
    found = [t for t in (one, other) if isinstance(t, (Vec, Mask))]
    if found and any(t != found[0] for t in found):
        return None
    boolean = isinstance(one, types.Boolean) and isinstance(other, types.Boolean)
    kind = found[0] if found else Mask(mask.dtype, mask.count) if boolean else Vec(mask.dtype, mask.count)
    return kind(mask, kind, kind), lambda context, builder, sig, args: builder.select(*args)


@intrinsic
def opposite_of(typing_context, mask):
    """The mask that holds where this does not."""
    return mask(mask), lambda context, builder, sig, args: _opposite(builder, mask, args[0])


def any_of(mask):
    """Whether a condition holds for any of the members that are worked on."""
    return bool(mask)


@intrinsic
def _any_of(typing_context, mask):
    def generate(context, builder, sig, args):
        bits = builder.bitcast(args[0], ir.IntType(mask.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


@overload(any_of, jit_options=INLINE)
def _compiled_any_of(mask):
    if isinstance(mask, Mask):
        return lambda mask: _any_of(mask)
    return lambda mask: bool(mask)


@intrinsic
def _as(typing_context, value, sample):
    kind = Vec(sample, value.count) if isinstance(value, Vec) else sample
    return kind(value, sample), lambda context, builder, sig, args: builder.bitcast(args[0], context.get_value_type(kind))


@overload(as_float, jit_options=INLINE)
def _compiled_as_float(word):
    return lambda word: _as(word, 0.0)


@overload(as_word, jit_options=INLINE)
def _compiled_as_word(number):
    return lambda number: _as(number, _NO_WORD)


@intrinsic
def _like(typing_context, x, other):
    kind = Vec(other.dtype, other.count)

    def generate(context, builder, sig, args):
        if not isinstance(x, Vec):
            return context.cast(builder, args[0], x, kind)
        if x.dtype == kind.dtype:
            return args[0]
        return (builder.fptrunc if kind.dtype == types.float32 else builder.fpext)(args[0], llvm_type(kind))

    return kind(x, other), generate


@intrinsic
def plain(typing_context, x):
    """The number that a vector of one number has."""
    return x.dtype(x), lambda context, builder, sig, args: builder.extract_element(args[0], ir.Constant(ir.IntType(32), 0))


def like(x, other):
    """x as a number, or as rows have them: as many at once, in that precision."""
    return x


@overload(like, jit_options=INLINE)
def _compiled_like(x, other):
    if isinstance(other, Vec) or (isinstance(other, Rows) and other.count):
        return lambda x, other: _like(x, other)
    return lambda x, other: x


@intrinsic
def _widened(typing_context, x):
    kind = Vec(types.float64, x.count)
    return kind(x), lambda context, builder, sig, args: builder.fpext(args[0], llvm_type(kind))


@overload(double, jit_options=INLINE)
def _compiled_double(x):
    if isinstance(x, Vec) and x.dtype == types.float32:
        return lambda x: _widened(x)
    return lambda x: x


def _address(context, builder, kind, array, index, item):
    """Of array[index], the array plain memory, as LLVM's type `item`."""
    data = array if isinstance(kind, Rows) else context.make_array(kind)(context, builder, array).data
    numbers = builder.bitcast(data, ELEMENT[kind.dtype.name].as_pointer())
    return builder.bitcast(builder.gep(numbers, [index]), item.as_pointer())


@intrinsic
def _load(typing_context, rows, array, index):
    kind = Vec(array.dtype, rows.count)

    def generate(context, builder, sig, args):
        size = ELEMENT[array.dtype.name]
        return builder.load(
            _address(context, builder, array, args[1], args[2], llvm_type(kind)), align=4 if size == ir.FloatType() else 8
        )

    return kind(rows, array, types.intp), generate


@intrinsic
def _store(typing_context, array, index, value):
    def generate(context, builder, sig, args):
        place = _address(context, builder, array, args[0], args[1], llvm_type(sig.args[2]))
        builder.store(args[2], place, align=4 if value.dtype == types.float32 else 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


def load(rows, array, index):
    """array[index], array[index + 1], ... of a flat array, for as many members as a row has."""
    return array[index]


def store(array, index, value):
    """Write numbers to array[index], array[index + 1], ..."""
    array[index] = value


@overload(load, jit_options=INLINE)
def _compiled_load(rows, array, index):
    return lambda rows, array, index: _load(rows, array, index)


@overload(store, jit_options=INLINE)
def _compiled_store(array, index, value):
    if isinstance(value, Vec):
        return lambda array, index, value: _store(array, index, value)
    return None


@intrinsic
def _rows(typing_context, lanes, array):
    kind = Rows(array.dtype, lanes.count)

    def generate(context, builder, sig, args):
        return builder.bitcast(context.make_array(array)(context, builder, args[1]).data, context.get_value_type(kind))

    return kind(lanes, array), generate


def rows(lanes, array):
    """A flat array as Rows."""
    return array


@overload(rows, jit_options=INLINE)
def _compiled_rows(lanes, array):
    return lambda lanes, array: _rows(lanes, array)


@intrinsic
def _memory(typing_context, array):
    kind = Rows(array.dtype, 0)

    def generate(context, builder, sig, args):
        return builder.bitcast(context.make_array(array)(context, builder, args[0]).data, context.get_value_type(kind))

    return kind(array), generate


def memory(array):
    """An array as the plain numbers that it has in memory: nobody counts who uses them, which costs more than to use them."""
    return array.ravel()


@overload(memory, jit_options=INLINE)
def _compiled_memory(array):
    return lambda array: _memory(array)


@intrinsic(prefer_literal=False)
def _stream(typing_context, rows, marks, number):
    kind = Rows(rows.dtype, rows.count // len(marks), rows.count)

    def generate(context, builder, sig, args):
        at = builder.mul(args[2], ir.Constant(_WORD, kind.count))
        place = _address(context, builder, rows, args[0], at, ELEMENT[rows.dtype.name])
        return builder.bitcast(place, context.get_value_type(kind))

    return kind(rows, marks, types.intp), generate


def stream(rows, marks, number):
    """Of rows the part that is the stream of a number, of as many as there are marks."""
    return rows


@overload(stream, jit_options=INLINE)
def _compiled_stream(rows, marks, number):
    if len(marks) == 1:
        return lambda rows, marks, number: rows
    return lambda rows, marks, number: _stream(rows, marks, number)


@infer_global(operator.getitem)
class _GetRow(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and isinstance(args[1], types.Integer):
            return signature(args[0].item, args[0], types.intp)
        return None


@lower_builtin(operator.getitem, Rows, types.Integer)
def _get_row(context, builder, sig, args):
    kind = sig.args[0]
    if not kind.count:
        return builder.load(_address(context, builder, kind, args[0], args[1], ELEMENT[kind.dtype.name]))
    at = builder.mul(args[1], ir.Constant(_WORD, kind.pitch))
    return builder.load(
        _address(context, builder, kind, args[0], at, llvm_type(kind.item)), align=4 if kind.dtype == types.float32 else 8
    )


@infer_global(operator.setitem)
class _SetRow(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and isinstance(args[1], types.Integer):
            return signature(types.none, args[0], types.intp, args[0].item)
        return None


@lower_builtin(operator.setitem, Rows, types.Integer, types.Any)
def _set_row(context, builder, sig, args):
    kind = sig.args[0]
    if not kind.count:
        builder.store(args[2], _address(context, builder, kind, args[0], args[1], ELEMENT[kind.dtype.name]))
        return context.get_dummy_value()
    at = builder.mul(args[1], ir.Constant(_WORD, kind.pitch))
    builder.store(
        args[2], _address(context, builder, kind, args[0], at, llvm_type(kind.item)), align=4 if kind.dtype == types.float32 else 8
    )
    return context.get_dummy_value()
