"""Pieces of compiled code, each compiled by itself, and called by its address: another observable or event compiles its piece and no other."""

import ctypes
import functools
import gc
import sys
import threading
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import njit, typeof
from numba.core import types

import rigidmc.engine.compose
import rigidmc.engine.functions  # noqa: F401  (what effects of a user's own may call)
from rigidmc.engine import cache
from rigidmc.engine.intrinsics import coded
from rigidmc.engine.kinds import Kinds, numbers_of
from rigidmc.engine.machine import use_widest_vectors
from rigidmc.engine.memory import Rows
from rigidmc.engine.pipeline import FLAGS

config: Any = numba.config
DEEPEST = 5000  # Python's 1000 frames are too few: each plain function that a piece calls, and each element of a tuple, takes 30 or so
use_widest_vectors()
_INT, _REAL, _PLAIN = types.int64, types.float64, Rows(types.float64, 0)
_IN_C: dict[str, Any] = {
    "i": ctypes.c_int64,
    "k": ctypes.c_uint64,
    "f": ctypes.c_double,
}  # the rest are addresses
_alive: dict[
    tuple, Any
] = {}  # what is compiled, by what it is compiled for: an address is good as long as its code
_addresses: dict[tuple, int] = {}  # where a piece is, found without asking Numba for types
_compiling = threading.Lock()
_dispatchers: dict[Any, Any] = {}


Asked = tuple[Any, Any, str, int, Any]  # the arguments of `piece`


class Piece(NamedTuple):
    """A piece: where its code and its numbers are; uncompiled the function, what it is for, and an array."""

    code: Any
    kinds: Any
    numbers: Any


NOTHING = Piece(0, 0, 0)


def signature_of(parts, dtype, lanes, arguments):
    """The types of a piece for NamedTuples `parts`, see `piece`."""
    real = types.float64 if dtype == "float64" else types.float32
    known = {
        "s": Rows(real, lanes),
        "w": Rows(_REAL, lanes),
        "p": _PLAIN,
        "n": Rows(_INT, 0),
        "u": Rows(types.uint64, 0),
        "i": _INT,
        "f": _REAL,
        "k": types.uint64,
    }
    more = (
        (known[letter] for letter in arguments)
        if isinstance(arguments, str)
        else [numba.from_dtype(arguments)]
    )
    return _INT(typeof(Kinds(*parts)), _PLAIN, *more)


def piece(function, parts, dtype, lanes, arguments):
    """(the Piece of a function(kinds, numbers, *arguments) for NamedTuples `parts`, an array that has to live as long as it is called).

    arguments : the types of the other arguments in letters: s for rows in the precision of the run, w for rows in float64, p for plain numbers in memory,
        n and u for integers and words in memory, i for an integer, k for a word, f for a number; or the dtype of the one other, a record
    """
    numbers = np.array(numbers_of(parts) or [0.0])
    if config.DISABLE_JIT:
        return Piece(function, Kinds(*parts), numbers), numbers
    key = function, dtype, lanes, kind_of(parts), arguments
    if key not in _addresses:
        _addresses[key] = _address(function, signature_of(parts, dtype, lanes, arguments))
    return Piece(_addresses[key], 0, numbers.ctypes.data), numbers


def is_ready(function, parts, dtype, lanes, arguments):
    """Whether nothing has to be compiled for a `piece`: its code is in memory or in the disk cache."""
    if config.DISABLE_JIT or (function, dtype, lanes, kind_of(parts), arguments) in _addresses:
        return True
    signature = signature_of(parts, dtype, lanes, arguments)
    return (function, signature.args) in _alive or cache.is_cached(
        _cached_dispatcher(function), signature
    )


def is_kept(function, parts, dtype, lanes, arguments):
    """Whether the disk cache keeps the code of a `piece`, so that another process may compile it."""
    return not config.DISABLE_JIT and cache.is_kept(
        _cached_dispatcher(function), signature_of(parts, dtype, lanes, arguments)
    )


def kind_of(argument):
    """What tells apart whatever `typeof` tells apart of nested NamedTuples and numbers, ten times as fast: 9 us in place of 90."""
    return (
        (type(argument), *map(kind_of, argument)) if isinstance(argument, tuple) else type(argument)
    )


def run(piece, letters, *arguments):
    """Call a piece from Python, outside its global lock, with memory as arrays; letters: as of `piece`, any but i, k and f for memory."""
    if config.DISABLE_JIT:
        return piece.code(piece.kinds, piece.numbers, *arguments)
    result, error = ctypes.c_int64(), ctypes.c_void_p()
    memory = (a.ctypes.data if isinstance(a, np.ndarray) else a for a in arguments)
    _in_python(piece.code, letters)(
        ctypes.byref(result), ctypes.byref(error), None, piece.numbers, *memory
    )
    return result.value


@functools.cache
def _in_python(address, letters):
    """A piece as a function of Python, by Numba's own way of calling: where the result goes, where an error goes, and the arguments."""
    kinds = (_IN_C.get(letter, ctypes.c_void_p) for letter in letters)
    return ctypes.CFUNCTYPE(
        ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, *kinds
    )(address)


def dispatcher_of(function):
    """Numba's dispatcher of a piece's function, without a cache."""
    options: Any = {**FLAGS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(**options)(function)


def _cached_dispatcher(function):
    if function not in _dispatchers:
        _dispatchers[function] = cache.cached(dispatcher_of(function))
    return _dispatchers[function]


def _address(function, signature):
    key = function, signature.args
    with _compiling:
        if key not in _alive:
            _alive[key] = _compiled(_cached_dispatcher(function), signature)
    return _alive[key]


def _compiled(dispatcher, signature):
    deepest, collects = sys.getrecursionlimit(), gc.isenabled()
    sys.setrecursionlimit(max(deepest, DEEPEST))
    gc.disable()  # a sixth of the time, for 70 MB
    try:
        dispatcher.compile(signature)
    finally:
        sys.setrecursionlimit(deepest)
        if collects:
            gc.enable()
    made = dispatcher.overloads[signature.args]
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


def call(piece, arguments):
    """Call a piece with a tuple of arguments, arrays as `memory`."""
    return piece.code(piece.kinds, piece.numbers, *arguments)


@coded(call)
def _call(typing_context, piece, arguments):
    given = [_PLAIN, _PLAIN, *map(types.unliteral, arguments)]

    def generate(context, builder, sig, args):
        place = builder.bitcast(args[0], ir.IntType(64).as_pointer())
        address, numbers = (
            builder.load(builder.gep(place, [ir.Constant(ir.IntType(32), i)])) for i in range(2)
        )
        code = builder.inttoptr(
            address, context.call_conv.get_function_type(_INT, given).as_pointer()
        )
        values = [builder.extract_value(args[1], i) for i in range(len(given) - 2)]
        first = (
            context.get_constant_null(_PLAIN),
            builder.inttoptr(numbers, context.get_value_type(_PLAIN)),
        )
        status, result = context.call_conv.call_function(
            builder, code, _INT, given, [*first, *values]
        )
        with builder.if_then(status.is_error, likely=False):
            context.call_conv.return_status_propagate(builder, status)
        return result

    return _INT(piece, arguments), generate
