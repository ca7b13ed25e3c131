"""Formulas over millions of elements: plain functions of floats, in lanes, on all cores.

A formula is a NamedTuple whose fields are its arguments and whose method `values(self)` returns a tuple of numbers. It is written
once, runs as it stands in Python, and is compiled by its type as an effect is.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from rigidmc.dynamics.methods import method
from rigidmc.engine.compose import compile_method, read
from rigidmc.engine.entries import Compiled
from rigidmc.engine.layout import LANES, put
from rigidmc.engine.machine import threads_available

PIECE, LEAST = 16384, 512  # elements per call on a thread: at most a few milliseconds, at least 0.1


@method
def values(formula):
    """The numbers that a formula gives."""
    return ()


def _fill(formula, table, index, columns, out, begin, end):
    """out[:, e] = values of the formula whose fields are table[index[e]] and columns[:, e], begin <= e < end."""
    rows = table.shape[1]
    first = len(formula)  # a constant of the type: with a number of run time LLVM cannot tell reads from writes
    work = np.empty((first + out.shape[0]) * LANES)
    for low in range(begin, end, LANES):
        for k in range(LANES):
            e = min(low + k, end - 1)
            for i in range(rows):
                work[i * LANES + k] = table[index[e], i]
            for i in range(columns.shape[0]):
                work[(rows + i) * LANES + k] = columns[i, e]
        for k in range(LANES):  # the loop that must vectorise
            put(values(read(formula, work, 0, k, LANES)), work, first * LANES + k, LANES)
        for i in range(out.shape[0]):
            for k in range(min(LANES, end - low)):
                out[i, low + k] = work[(first + i) * LANES + k]


compile_method(values)
_compiled = Compiled(_fill)


def evaluate(kind, width, columns, table=None, index=None, threads=None):
    """The values (width, n) of a formula for n elements.

    kind : class of the formula; columns : (fields, n), or, with a table (m, fields) and an index (n,) into its rows, the fields that
    come after those of the table
    """
    columns = np.ascontiguousarray(columns, dtype=float)
    count = columns.shape[1]
    table = np.empty((1, 0)) if table is None else np.ascontiguousarray(table, dtype=float)
    index = np.zeros(count, dtype=np.int64) if index is None else np.ascontiguousarray(index, dtype=np.int64)
    formula = kind(*[0.0] * (table.shape[1] + columns.shape[0]))
    out = np.empty((width, count))

    def piece(low):
        _compiled(formula, table, index, columns, out, low, min(low + size, count))

    threads = threads or threads_available()
    size = min(PIECE, max(LEAST, LANES * -(-count // (threads * LANES))))
    starts = range(0, count, size)
    if threads > 1 and len(starts) > 1:
        _compiled.entry(formula, table, index, columns, out, 0, 0)  # compiled once, before the threads ask for it
        others = [_pool(threads - 1).submit(piece, low) for low in starts[1:]]
        piece(0)
        for other in others:
            other.result()
    else:
        for low in starts:
            piece(low)
    return out


@cache
def _pool(threads):
    """Threads that stay: to start two takes as long as a thousand elements."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rigidmc")
