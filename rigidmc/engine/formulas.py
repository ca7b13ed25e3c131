"""Formulas over millions of elements: plain functions of numbers, several elements side by side, on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a tuple of numbers. It is written
once, runs as it stands in Python, and is compiled by its type as an effect is.
"""

import numpy as np
from numba.core import types

from rigidmc.dynamics.methods import method
from rigidmc.engine.compile_time import announced
from rigidmc.engine.compose import compile_method, inline
from rigidmc.engine.intrinsics import coded
from rigidmc.engine.kinds import filled, parts_of
from rigidmc.engine.machine import threads_available
from rigidmc.engine.memory import put
from rigidmc.engine.pieces import is_ready, piece, run
from rigidmc.engine.threads import threads_of

PIECE, LEAST, WIDTH = (
    16384,
    512,
    8,
)  # elements per call on a thread: at most a few milliseconds, at least 0.1; and side by side


@method
def values(formula):
    """The numbers that a formula gives."""
    return ()


def fill(
    kinds,
    numbers,
    room,
    known,
    table,
    fields,
    index,
    columns,
    more,
    count,
    out,
    values_of,
    begin,
    end,
):
    """out[:, e] = values of the formula whose fields are table[index[e]] and columns[:, e], begin <= e < end.

    room : rows for the fields and the values;  known : the same as plain numbers;  fields, more, values_of : rows of table, columns and out
    """
    (formula,) = parts_of(kinds, numbers)
    width = side(room)
    for low in range(begin, end, width):
        for k in range(width):
            e = min(low + k, end - 1)
            for i in range(fields):
                known[i * width + k] = table[index[e] * fields + i]
            for i in range(more):
                known[(fields + i) * width + k] = columns[i * count + e]
        first = fields + more
        put(values(filled(formula, room, 0)), room, first)
        for i in range(values_of):
            for k in range(min(width, end - low)):
                out[i * count + low + k] = known[(first + i) * width + k]
    return 0


def side(rows):
    """How many numbers lie side by side in a row."""
    return 1


@coded(side)
def _side(typing_context, rows):
    return types.intp(rows), lambda context, builder, sig, args: context.get_constant(
        types.intp, rows.count
    )


inline(values.default)
compile_method(values)
FILL = "wppinpiipiii"


def evaluate(kind, width, columns, table=None, index=None, threads=None, side=WIDTH):
    """The values (width, n) of a formula for n elements.

    kind : class of the formula, or where its fields are tuples one whose numbers do not count; columns : (numbers, n), or, with a table (m, fields)
    and an index (n,) into its rows, the fields that come after those of the table;  side : elements side by side, by which no result changes
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    count = columns.shape[1]
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = (
        np.zeros(count, dtype=np.int64)
        if index is None
        else np.ascontiguousarray(index, dtype=np.int64)
    )
    formula = (
        kind if isinstance(kind, tuple) else kind(*[0.0] * (table.shape[1] + columns.shape[0]))
    )
    out, fields = np.empty((width, count)), table.shape[1]
    asked = fill, (formula,), "float64", side, FILL
    with announced("formulas", () if is_ready(*asked) else ("formulas",)):
        compiled, _alive = piece(*asked)

    def part(low):
        room = np.empty((fields + columns.shape[0] + width) * side)
        given = (
            room,
            room,
            table.ravel(),
            fields,
            index,
            columns.ravel(),
            columns.shape[0],
            count,
            out.ravel(),
            width,
        )
        run(compiled, FILL, *given, low, min(low + size, count))

    threads = threads or threads_available()
    size = min(PIECE, max(LEAST, WIDTH * -(-count // (threads * WIDTH))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        others = [threads_of("formulas", threads - 1).submit(part, low) for low in starts[1:]]
        part(0)
        for other in others:
            other.result()
    else:
        for low in starts:
            part(low)
    return out
