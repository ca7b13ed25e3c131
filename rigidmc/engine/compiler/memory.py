"""Memory as a type of the compiler: rows of vectors. In Python, and uncompiled, rows are arrays.

Numba's own arrays would carry shapes, strides and reference counts into each kernel. Rows are an
address: the contents of each row are known when a kernel is compiled
(`rigidmc.engine.kernel.layout`).
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import OpaqueModel
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

from rigidmc.engine.compiler.dual_types import DualType, make_dual, tangents_of
from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.engine.compiler.vector_types import ELEMENT, VectorType, llvm_type
from rigidmc.engine.machine import LINE

_WORD = ir.IntType(64)


class Rows(types.Type):
    """Memory as consecutive vectors: rows[i] is a vector, or a plain number if count is 0.

    pitch : numbers from one row to the next, if rows are parts of longer rows
    """

    def __init__(self, dtype: Any, count: int, pitch: int | None = None) -> None:
        self.dtype, self.count, self.pitch = dtype, count, pitch or count
        # Numba identifies types by name: before the width was part of it, a loop over 16 members
        # took cached steps of 8 and gave wrong numbers without a message.
        super().__init__(name=f"rows of {dtype}x{count}" + (f" in {pitch}" if pitch else ""))

    @property
    def item(self) -> Any:
        """The type of rows[i]."""
        return VectorType(self.dtype, self.count) if self.count else self.dtype


register_default(Rows)(OpaqueModel)


class DualRows(Rows):
    """Memory as consecutive vectors with tangents: rows[i] is a Dual.

    Its value is vector i, as in Rows, and tangent j is vector i + (1 + j) apart. So code for values
    alone takes the same memory as Rows.

    apart : vectors from a value to its first tangent, and from one tangent to the next
    active : whether the body, and whether effects have tangents other than 0
    """

    def __init__(
        self,
        dtype: Any,
        count: int,
        tangents: int,
        apart: int,
        active: tuple[bool, bool],
        pitch: int | None = None,
    ) -> None:
        super().__init__(dtype, count, pitch)
        self.tangents, self.apart, self.active = tangents, apart, active
        words = "".join(
            word for word, is_active in zip(("b", "e"), active, strict=True) if is_active
        )
        self.name += f" with {tangents} tangents {apart} apart, {words or 'state'}"

    @property
    def item(self) -> Any:
        """The type of rows[i]."""
        return DualType(VectorType(self.dtype, self.count), self.tangents)


register_default(DualRows)(OpaqueModel)


def _load(builder: Any, rows: Rows, memory: Any, index: Any) -> Any:
    """Return LLVM code for rows[index]."""

    def vector(i: Any) -> Any:
        return builder.load(_row(builder, rows, memory, i), align=_align(rows))

    if not isinstance(rows, DualRows):
        return vector(index)
    apart = (_WORD((1 + j) * rows.apart) for j in range(rows.tangents))
    tangents = [vector(builder.add(index, each)) for each in apart]
    return make_dual(builder, rows.item, vector(index), tangents)


def _store(
    context: Any, builder: Any, rows: Rows, memory: Any, index: Any, kind: Any, x: Any
) -> None:
    """Write LLVM code for rows[index] = x, x of type `kind`; of a Dual, its value to plain rows."""
    if isinstance(kind, DualType) and not isinstance(rows, DualRows):
        kind, x = kind.vector, builder.extract_value(x, 0)
    x, parts = context.cast(builder, x, kind, rows.item), [index]
    values = [x]
    if isinstance(rows, DualRows):
        parts += [builder.add(index, _WORD((1 + j) * rows.apart)) for j in range(rows.tangents)]
        values = [builder.extract_value(x, 0), *tangents_of(builder, rows.item, x)]
    for place, value in zip(parts, values, strict=True):
        builder.store(value, _row(builder, rows, memory, place), align=_align(rows))


def _place(builder: Any, ty: Any, array: Any, index: Any, item: Any) -> Any:
    """Return the address of array[index] in plain memory, as a pointer to LLVM's type `item`."""
    numbers = builder.bitcast(array, ELEMENT[ty.dtype.name].as_pointer())
    return builder.bitcast(builder.gep(numbers, [index]), item.as_pointer())


def _align(ty: Any) -> int:
    """Return the alignment of numbers of this type [bytes]."""
    # Of a number, not of a vector: parts of rows, and rows of a block, may begin anywhere.
    return 4 if ty.dtype == types.float32 else 8


def load_lanes(rows, array, index):
    """Return array[index], array[index + 1], ... of a flat array, one number per lane of a row."""
    return array[index]


@intrinsic(load_lanes)
def _load_lanes(typing_context, rows, array, index):
    ty = VectorType(array.dtype, rows.count)

    def generate(context, builder, sig, args):
        return builder.load(
            _place(builder, array, args[1], args[2], llvm_type(ty)), align=_align(ty)
        )

    return ty(rows, array, types.intp), generate


def store_lanes(array, index, value):
    """Write numbers to array[index], array[index + 1], ..."""
    array[index] = value


@intrinsic(store_lanes)
def _store_lanes(typing_context, array, index, value):
    def generate(context, builder, sig, args):
        builder.store(
            args[2], _place(builder, array, args[0], args[1], llvm_type(value)), align=_align(value)
        )
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


def memory(array, number):
    """Return an array, in compiled code its address, as plain numbers of the type of `number`.

    References are not counted: counting would cost more than the use of the numbers.
    """
    return array


@intrinsic(memory)
def _memory(typing_context, address, number):
    ty = Rows(types.unliteral(number), 0)
    return ty(address, number), lambda context, builder, sig, args: builder.inttoptr(
        args[0], context.get_value_type(ty)
    )


def group_of(rows, marks, number):
    """Return part `number` of rows that are divided into len(marks) parts."""
    return rows


@intrinsic(group_of)
def _group_of(typing_context, rows, marks, number):
    ty: Rows = Rows(rows.dtype, rows.count // len(marks), rows.count)
    if isinstance(rows, DualRows):
        dual_facts = rows.tangents, rows.apart, rows.active
        ty = DualRows(rows.dtype, ty.count, *dual_facts, pitch=rows.count)

    def generate(context, builder, sig, args):
        at = builder.mul(args[2], ir.Constant(_WORD, ty.count))
        place = _place(builder, rows, args[0], at, ELEMENT[rows.dtype.name])
        return builder.bitcast(place, context.get_value_type(ty))

    return ty(rows, marks, types.intp), generate


def without_tangents(rows):
    """Return rows as rows of their values alone."""
    return rows


def of_body(rows):
    """Return rows for the numbers of bodies: without tangents if all these tangents are 0."""
    return rows


def of_effects(rows):
    """Return rows for the parameters of effects: without tangents if all these tangents are 0."""
    return rows


def _with_tangents_if(has_any: Callable[[Any], bool]) -> Callable[..., Any]:
    """Return the definition of a function that leaves tangents out unless there are any."""

    def define(typing_context, rows):
        keeps = not isinstance(rows, DualRows) or has_any(rows)
        ty = rows if keeps else Rows(rows.dtype, rows.count, rows.pitch)
        return ty(rows), lambda context, builder, sig, args: args[0]

    return define


intrinsic(without_tangents)(_with_tangents_if(lambda rows: False))
intrinsic(of_body)(_with_tangents_if(lambda rows: rows.active[0]))
intrinsic(of_effects)(_with_tangents_if(lambda rows: rows.active[1]))


def shifted(rows, count):
    """Return memory from row `count` on, plain memory from number `count` on."""
    return rows[count:]


@intrinsic(shifted)
def _shifted(typing_context, rows, count):
    def generate(context, builder, sig, args):
        return builder.bitcast(_row(builder, rows, *args), context.get_value_type(rows))

    return rows(rows, types.intp), generate


def _row(builder: Any, ty: Any, rows: Any, index: Any) -> Any:
    """Return the address of rows[index]."""
    if not ty.count:
        return _place(builder, ty, rows, index, ELEMENT[ty.dtype.name])
    first = builder.mul(index, ir.Constant(_WORD, ty.pitch))
    return _place(builder, ty, rows, first, llvm_type(VectorType(ty.dtype, ty.count)))


@infer_global(operator.getitem)
class _GetRow(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and isinstance(args[1], types.Integer):
            return signature(args[0].item, args[0], types.intp)
        return None


@lower_builtin(operator.getitem, Rows, types.Integer)
def get_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return LLVM code for rows[index]."""
    return _load(builder, sig.args[0], *args)


@infer_global(operator.setitem)
class _SetRow(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and isinstance(args[1], types.Integer):
            return signature(types.none, args[0], types.intp, args[0].item)
        return None


@lower_builtin(operator.setitem, Rows, types.Integer, types.Any)
def _set_row(context, builder, sig, args):
    _store(context, builder, sig.args[0], *args[:2], sig.args[2], args[2])
    return context.get_dummy_value()


def three_at(rows, row):
    """Return three numbers from three rows."""
    return rows[row], rows[row + 1], rows[row + 2]


def four_at(rows, row):
    """Return four numbers from four rows."""
    return rows[row], rows[row + 1], rows[row + 2], rows[row + 3]


def tuple_at(marks, rows, row):
    """Return len(marks) numbers from as many rows."""
    return tuple(rows[row + i] for i in range(len(marks)))


def _following(count: int, *arguments: Any) -> tuple[Any, Callable[..., Any]]:
    """Return (signature, code) of a function that reads `count` rows from row `arguments[-1]` on.

    arguments : types; the last but one is the type of the rows
    """
    rows = arguments[-2]

    def generate(context, builder, sig, args):
        at = [builder.add(args[-1], ir.Constant(_WORD, i)) for i in range(count)]
        each = [_load(builder, rows, args[-2], i) for i in at]
        return context.make_tuple(builder, sig.return_type, each)

    return types.UniTuple(rows.item, count)(*arguments[:-1], types.intp), generate


intrinsic(three_at)(lambda typing_context, rows, row: _following(3, rows, row))
intrinsic(four_at)(lambda typing_context, rows, row: _following(4, rows, row))
intrinsic(tuple_at)(
    lambda typing_context, marks, rows, row: _following(len(marks), marks, rows, row)
)


def picked_rows(marks, rows, index, row):
    """Return len(marks) numbers from as many rows, for each member from its own row on.

    index : that row less `row`, a whole number as a float
    """
    at = int(index) + row
    return tuple(rows[at + i] for i in range(len(marks)))


@intrinsic(picked_rows)
def _picked_rows(typing_context, marks, rows, index, row):
    numbers = types.UniTuple(rows.item, len(marks))
    tangents = rows.tangents if isinstance(rows, DualRows) else 0
    vector = llvm_type(VectorType(rows.dtype, rows.count))

    def generate(context, builder, sig, args):
        pitch = _WORD(rows.pitch)
        places = [
            i + (j * rows.apart if j else 0) for i in range(len(marks)) for j in range(1 + tangents)
        ]
        is_dual = isinstance(index, DualType)
        own_rows = builder.extract_value(args[2], 0) if is_dual else args[2]
        each: list[Any] = [None] * len(places)
        for k in range(rows.count):
            lane = ir.Constant(ir.IntType(32), k)
            lane_row = builder.fptosi(builder.extract_element(own_rows, lane), _WORD)
            first = builder.mul(builder.add(lane_row, args[3]), pitch)
            # A whole row, of which one number is used: a load that merges by a mask is one
            # instruction, an insertion two or more.
            this = ir.Constant(
                ir.VectorType(ir.IntType(1), rows.count), [i == k for i in range(rows.count)]
            )
            for i, place in enumerate(places):
                at = builder.add(first, _WORD(place * rows.pitch))
                row = builder.load(_place(builder, rows, args[1], at, vector), align=_align(rows))
                each[i] = builder.select(this, row, each[i]) if k else row
        if tangents:
            parts = (each[i : i + 1 + tangents] for i in range(0, len(each), 1 + tangents))
            each = [make_dual(builder, rows.item, value, rest) for value, *rest in parts]
        return context.make_tuple(builder, numbers, each)

    return numbers(marks, rows, index, types.intp), generate


def put_rows(values, rows, row):
    """Write a tuple to rows, and return the row after it."""
    for i, value in enumerate(values):
        rows[row + i] = value
    return row + len(values)


@intrinsic(put_rows)
def _put_rows(typing_context, values, rows, row):
    def generate(context, builder, sig, args):
        for i, ty in enumerate(values):
            at, x = builder.add(args[2], ir.Constant(_WORD, i)), builder.extract_value(args[0], i)
            _store(context, builder, rows, args[1], at, ty, x)
        return builder.add(args[2], ir.Constant(_WORD, len(values)))

    return types.intp(values, rows, types.intp), generate


def store_rows(values, rows, array, at, pitch, past, tangent, apart):
    """Write a tuple to a flat array, at `at`, at + pitch, ..., and return the index after it.

    past : whether the stores bypass the cache, which requires whole cache lines
    tangent, apart : the first tangent of a number is `tangent` after it, others follow `apart`
    """
    for i, value in enumerate(values):
        store_lanes(array, at + i * pitch, value)
    return at + len(values) * pitch


@intrinsic(store_rows)
def _store_rows(typing_context, values, rows, array, at, pitch, past, tangent, apart):
    ty = rows.item

    def generate(context, builder, sig, args):
        at, pitch, _, tangent, apart = args[3:]
        places, numbers = [], []
        for i, given_ty in enumerate(values):
            number = context.cast(builder, builder.extract_value(args[0], i), given_ty, ty)
            places.append(at)
            if isinstance(ty, DualType):
                places.append(builder.add(at, tangent))
                for _ in range(ty.tangents - 1):
                    places.append(builder.add(places[-1], apart))
                numbers += [builder.extract_value(number, 0), *tangents_of(builder, ty, number)]
            else:
                numbers.append(number)
            at = builder.add(at, pitch)

        def write(align):
            vector = llvm_type(VectorType(rows.dtype, rows.count))
            to = (_place(builder, array, args[2], place, vector) for place in places)
            return [builder.store(x, p, align=align) for x, p in zip(numbers, to, strict=True)]

        # Rows of a result are 2^15 bytes or more apart and map to the same cache set: through the
        # cache each value would evict others. LLVM requires a metadata node with the number 1.
        flag = builder.module.add_metadata([ir.Constant(ir.IntType(32), 1)])
        skips_cache = builder.icmp_signed("!=", args[5], ir.Constant(_WORD, 0))
        with builder.if_else(skips_cache) as (then, otherwise):
            with then:
                for written in write(LINE):
                    written.set_metadata("nontemporal", flag)
            with otherwise:
                write(_align(array))
        return at

    return types.intp(values, rows, array, *[types.intp] * 5), generate
