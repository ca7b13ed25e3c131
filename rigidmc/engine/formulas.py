"""Formulas over millions of elements: plain functions of numbers, on vectors and on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a
tuple of numbers. It is written once, runs as it stands in Python, and is compiled by its type as an
effect is.
"""

from typing import Any

import numpy as np
from numba.core import types
from numpy.typing import ArrayLike, NDArray

from rigidmc.dynamics.methods import method
from rigidmc.engine.compile_time import announced
from rigidmc.engine.compose import compile_method, inline
from rigidmc.engine.intrinsics import coded
from rigidmc.engine.kinds import filled, parts_of
from rigidmc.engine.machine import threads_available
from rigidmc.engine.memory import put
from rigidmc.engine.pieces import is_ready, piece, run
from rigidmc.threads import Task, threads_of

# Elements per call on a thread, at most (a few ms) and at least (0.1 ms); elements side by side.
PIECE, LEAST, WIDTH = 16384, 512, 8


@method
def values(formula):
    """The numbers that a formula gives."""
    return ()


def fill(
    kinds, numbers, room, known, table, fields, index, columns, more, count, out, width, begin, end
):
    """out[:, e] = values of the formula with fields table[index[e]] and columns[:, e].

    begin, end : elements, begin <= e < end;  count : columns of `columns` and `out`
    room : rows for the fields and the values;  known : the same memory as plain numbers
    fields, more, width : columns of `table`, rows of `columns`, rows of `out`
    """
    (formula,) = parts_of(kinds, numbers)
    step = side(room)
    for low in range(begin, end, step):
        for k in range(step):
            e = min(low + k, end - 1)
            for i in range(fields):
                known[i * step + k] = table[index[e] * fields + i]
            for i in range(more):
                known[(fields + i) * step + k] = columns[i * count + e]
        first = fields + more
        put(values(filled(formula, room, 0)), room, first)
        for i in range(width):
            for k in range(min(step, end - low)):
                out[i * count + low + k] = known[(first + i) * step + k]
    return 0


def side(rows):
    """How many numbers lie side by side in a row."""
    return 1


@coded(side)
def _side(typing_context, rows):
    count = rows.count
    return types.intp(rows), lambda context, builder, sig, args: context.get_constant(
        types.intp, count
    )


inline(values.default)
compile_method(values)
FILL = "wppinpiipiii"  # the arguments of `fill`, see `piece`


def evaluate(
    kind: Any,
    width: int,
    columns: ArrayLike,
    table: ArrayLike | None = None,
    index: ArrayLike | None = None,
    threads: int | None = None,
    side: int = WIDTH,
) -> NDArray[np.float64]:
    """The values (width, n) of a formula for n elements.

    kind : class of the formula; if its fields are tuples, an instance whose numbers do not count
    columns : the fields (numbers, n); with a table, the fields that come after those of the table
    table, index : (m, fields), and the row of it for each element (n,)
    side : elements side by side, on which no result depends
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    more, count = columns.shape
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = np.zeros(count) if index is None else index
    index = np.ascontiguousarray(index, dtype=np.int64)
    fields, out = table.shape[1], np.empty((width, count))
    formula = kind if isinstance(kind, tuple) else kind(*[0.0] * (fields + more))
    asked = fill, (formula,), "float64", side, FILL
    with announced("formulas", () if is_ready(*asked) else ("formulas",)):
        compiled, _alive = piece(*asked)
    shared = (
        table.ravel(), fields, index, columns.ravel(), more, count, out.ravel(), width,
    )  # fmt: skip

    def part(low: int) -> None:
        room = np.empty((fields + more + width) * side)
        run(compiled, FILL, room, room, *shared, low, min(low + size, count))

    threads = threads or threads_available()
    size = min(PIECE, max(LEAST, WIDTH * -(-count // (threads * WIDTH))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        others = [Task(part, low) for low in starts[1:]]
        threads_of("formulas", threads - 1).run(others, lambda: part(0))
    else:
        for low in starts:
            part(low)
    return out
