"""Formulas over millions of elements: plain functions of numbers, several elements side by side, on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a tuple of numbers. It is written
once, runs as it stands in Python, and is compiled by its type as an effect is.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

import rigidmc.engine.functions  # noqa: F401  (what effects of a user's own may call)
from rigidmc.dynamics.methods import method
from rigidmc.engine.compose import compile_method, filled, inline
from rigidmc.engine.entries import Compiled
from rigidmc.engine.layout import put
from rigidmc.engine.machine import threads_available
from rigidmc.engine.numbers import Lanes, rows

PIECE, LEAST, WIDTH = 16384, 512, 8  # elements per call on a thread: at most a few milliseconds, at least 0.1; and side by side


@method
def values(formula):
    """The numbers that a formula gives."""
    return ()


def _fill(lanes, width, formula, table, index, columns, out, begin, end):
    """out[:, e] = values of the formula whose fields are table[index[e]] and columns[:, e], begin <= e < end."""
    known = table.shape[1]
    memory, found = np.empty((known + columns.shape[0]) * width), np.empty(out.shape[0] * width)
    for low in range(begin, end, width):
        for k in range(width):
            e = min(low + k, end - 1)
            for i in range(known):
                memory[i * width + k] = table[index[e], i]
            for i in range(columns.shape[0]):
                memory[(known + i) * width + k] = columns[i, e]
        put(values(filled(formula, rows(lanes, memory), 0)), rows(lanes, found), 0)
        for i in range(out.shape[0]):
            for k in range(min(width, end - low)):
                out[i, low + k] = found[i * width + k]


inline(values.default)
compile_method(values)
_compiled = Compiled(_fill, "formulas")


def evaluate(kind, width, columns, table=None, index=None, threads=None, side=WIDTH):
    """The values (width, n) of a formula for n elements.

    kind : class of the formula, or where its fields are tuples one whose numbers do not count; columns : (numbers, n), or, with a table (m, fields)
    and an index (n,) into its rows, the fields that come after those of the table;  side : elements side by side, by which no result changes
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    count = columns.shape[1]
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = np.zeros(count, dtype=np.int64) if index is None else np.ascontiguousarray(index, dtype=np.int64)
    formula = kind if isinstance(kind, tuple) else kind(*[0.0] * (table.shape[1] + columns.shape[0]))
    out = np.empty((width, count))
    lanes, side = side_by_side(side)

    def piece(low):
        _compiled(lanes, side, formula, table, index, columns, out, low, min(low + size, count))

    threads = threads or threads_available()
    size = min(PIECE, max(LEAST, WIDTH * -(-count // (threads * WIDTH))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        _compiled.entry(lanes, side, formula, table, index, columns, out, 0, 0)  # compiled once, before the threads ask for it
        others = [_pool(threads - 1).submit(piece, low) for low in starts[1:]]
        piece(0)
        for other in others:
            other.result()
    else:
        for low in starts:
            piece(low)
    return out


@cache
def side_by_side(width):
    """(Lanes, how many they are) of what is worked on side by side: one, where nothing is compiled."""
    width = 1 if _compiled.plain else width
    return Lanes(width), width


@cache
def _pool(threads):
    """Threads that stay: to start two takes as long as a thousand elements."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rigidmc")
