"""Pieces of compiled code, each compiled by itself and called by its address.

Another observable or event thus compiles one piece and no other.

The functions of `math` that a user's effects may call.

For vectors most are the straight code of `rigidmc.physics.dynamics.functions`, with the same bits
on every machine; the rest take one member at a time.
"""

import ctypes
import functools
import gc
import math
import operator
import sys
import threading
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import njit, typeof
from numba.core import types
from numba.extending import overload
from numpy.typing import NDArray

from rigidmc.engine.compiler import disk_cache
from rigidmc.engine.compiler.compose import inline, inline_all
from rigidmc.engine.compiler.intrinsics import coded, like, plain
from rigidmc.engine.compiler.memory import Rows
from rigidmc.engine.compiler.pipeline import FLAGS, INLINE
from rigidmc.engine.compiler.trees import Kinds, numbers_of
from rigidmc.engine.compiler.vector_types import Vec
from rigidmc.engine.kernel.arguments import Piece, frame_type
from rigidmc.engine.machine import use_widest_vectors
from rigidmc.physics.dynamics import functions
from rigidmc.physics.dynamics.so3 import arctan2, expm1

config: Any = numba.config
Function = Callable[..., Any]
# Python's 1000 frames are too few: each plain function that a piece calls, and each element of a
# tuple, takes about 30.
DEEPEST = 5000
WIDTH = 8  # float64 side by side in formulas: one vector of 512 bits, or two or four narrower ones
use_widest_vectors()
_INT, _REAL, _PLAIN = types.int64, types.float64, Rows(types.float64, 0)
# Letters as of `piece`; the rest are addresses.
_IN_C: dict[str, Any] = {"i": ctypes.c_int64, "k": ctypes.c_uint64, "f": ctypes.c_double}
_by_types: dict[tuple[Any, ...], int] = {}  # addresses of pieces, by what they are compiled for
_addresses: dict[tuple[Any, ...], int] = {}  # the same, found without asking Numba for types
_codes: dict[tuple[Any, ...], tuple[str, str]] = {}
_compiling = threading.Lock()
_dispatchers: dict[Any, Any] = {}


Asked = tuple[Any, Any, str, int, str]  # the arguments of `piece`


def signature_of(parts: Any, dtype: str, lanes: int, arguments: str) -> Any:
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
        "r": numba.from_dtype(frame_type(dtype)),
    }
    return _INT(typeof(Kinds(*parts)), _PLAIN, *(known[letter] for letter in arguments))


def piece(
    function: Function, parts: Any, dtype: str, lanes: int, arguments: str
) -> tuple[Piece, NDArray[np.float64]]:
    """(the Piece of function(kinds, numbers, *arguments) for NamedTuples `parts`, its numbers).

    The array of the numbers has to live as long as the piece is called.
    arguments : the types of the other arguments in letters: s for rows in the precision of the run,
        w for rows in float64, p for plain numbers in memory, n and u for integers and words in
        memory, i for an integer, k for a word, f for a number, r for a record of `frame_type`
    """
    numbers = np.array(numbers_of(parts) or [0.0])
    if config.DISABLE_JIT:
        return Piece(function, Kinds(*parts), numbers), numbers
    key = function, dtype, lanes, kind_of(parts), arguments
    if key not in _addresses:
        _addresses[key] = _address(function, signature_of(parts, dtype, lanes, arguments))
    return Piece(_addresses[key], 0, numbers.ctypes.data), numbers


def is_ready(function: Function, parts: Any, dtype: str, lanes: int, arguments: str) -> bool:
    """Whether the code of a `piece` is in memory or in the disk cache."""
    if config.DISABLE_JIT or (function, dtype, lanes, kind_of(parts), arguments) in _addresses:
        return True
    signature = signature_of(parts, dtype, lanes, arguments)
    compiled = (function, signature.args) in _by_types
    return compiled or disk_cache.is_cached(_cached_dispatcher(function), signature)


def is_kept(function: Function, parts: Any, dtype: str, lanes: int, arguments: str) -> bool:
    """Whether the disk cache keeps the code of a `piece`: another process may compile it then."""
    return not config.DISABLE_JIT and disk_cache.is_kept(
        _cached_dispatcher(function), signature_of(parts, dtype, lanes, arguments)
    )


def kind_of(argument: Any) -> Any:
    """A key that differs for nested NamedTuples and numbers whenever Numba's `typeof` differs.

    It takes 9 us where `typeof` takes 90.
    """
    if isinstance(argument, tuple):
        return (type(argument), *map(kind_of, argument))
    return type(argument)


def run(piece: Piece, letters: str, *arguments: Any) -> Any:
    """Call a piece from Python, outside its global lock, with memory as arrays.

    letters : as of `piece`; any but i, k and f stand for memory
    """
    if config.DISABLE_JIT:
        return piece.code(piece.kinds, piece.numbers, *arguments)
    result, error = ctypes.c_int64(), ctypes.c_void_p()
    memory = (a.ctypes.data if isinstance(a, np.ndarray) else a for a in arguments)
    _in_python(piece.code, letters)(
        ctypes.byref(result), ctypes.byref(error), None, piece.numbers, *memory
    )
    return result.value


@functools.cache
def _in_python(address: int, letters: str) -> Any:
    """A piece as a function of Python.

    By Numba's way of calling it takes an address for the result, one for an error, one that is not
    used, and the arguments.
    """
    kinds = (_IN_C.get(letter, ctypes.c_void_p) for letter in letters)
    return ctypes.CFUNCTYPE(
        ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, *kinds
    )(address)


def dispatcher_of(function: Function) -> Any:
    """Numba's dispatcher of a piece's function, without a cache."""
    options: Any = {**FLAGS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(**options)(function)


def _cached_dispatcher(function: Function) -> Any:
    """Numba's dispatcher of a piece's function, with the disk cache."""
    if function not in _dispatchers:
        _dispatchers[function] = disk_cache.cached(dispatcher_of(function))
    return _dispatchers[function]


def _address(function: Function, signature: Any) -> int:
    """The address of a piece's code, which lives as long as the dispatcher in `_dispatchers`."""
    key = function, signature.args
    with _compiling:
        if key not in _by_types:
            _by_types[key] = _compiled(_cached_dispatcher(function), signature)
    return _by_types[key]


def code_of(
    function: Function, parts: Any, dtype: str, lanes: int, arguments: str
) -> tuple[str, str]:
    """(the name of a `piece`'s function in LLVM's code, this code); the disk cache has none."""
    key = function, dtype, lanes, kind_of(parts), arguments
    with _compiling:
        if key not in _codes:
            signature = signature_of(parts, dtype, lanes, arguments)
            result = _result(dispatcher_of(function), signature)
            _codes[key] = result.fndesc.llvm_func_name, result.library.get_llvm_str()
    return _codes[key]


def _compiled(dispatcher: Any, signature: Any) -> int:
    """Compile a piece, or load it from the disk cache; the address of its code."""
    result = _result(dispatcher, signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def _result(dispatcher: Any, signature: Any) -> Any:
    """What Numba makes of a piece."""
    deepest, collects = sys.getrecursionlimit(), gc.isenabled()
    sys.setrecursionlimit(max(deepest, DEEPEST))
    gc.disable()  # saves a sixth of the time, for 70 MB
    try:
        dispatcher.compile(signature)
    finally:
        sys.setrecursionlimit(deepest)
        if collects:
            gc.enable()
    return dispatcher.overloads[signature.args]


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


_OF_ONE: dict[Any, Any] = {
    math.sin: functions.sine,
    math.cos: functions.cosine,
    math.tan: functions.tangent,
    math.atan: functions.arctangent,
    math.asin: functions.arcsine,
    math.acos: functions.arccosine,
    math.exp: functions.exponential_of,
    math.expm1: expm1,
    math.log: functions.logarithm_of,
    math.tanh: functions.hyperbolic_tangent,
    math.sinh: functions.hyperbolic_sine,
    math.cosh: functions.hyperbolic_cosine,
}
_OF_TWO: dict[Any, Any] = {
    math.atan2: arctan2,
    math.pow: functions.power,
    math.hypot: functions.hypotenuse,
}
_ONE_AT_A_TIME = (
    math.gamma, math.lgamma, math.erf, math.erfc, math.log10, math.log2, math.log1p, math.asinh,
    math.acosh, math.atanh, math.degrees, math.radians,
)  # fmt: skip


def _for_one(known: Callable[..., Any]) -> None:
    """Let compiled code call a function of `math` for a vector of one number."""

    @overload(known, jit_options=INLINE)
    def one(x):
        return (lambda x: like(known(plain(x)), x)) if isinstance(x, Vec) and x.count == 1 else None


def _for_vectors(known: Callable[..., Any], straight: Callable[..., Any], count: int) -> None:
    """Let compiled code call `straight` for a function of `math` of so many arguments.

    One of the arguments is a vector.
    """
    inline(straight)
    if count == 1:

        @overload(known, jit_options=INLINE)
        def one(x):
            return (lambda x: straight(x)) if isinstance(x, Vec) else None

    else:

        @overload(known, jit_options=INLINE)
        def two(x, y):
            vector = isinstance(x, Vec) or isinstance(y, Vec)
            return (lambda x, y: straight(x, y)) if vector else None


inline_all(functions)
for _known, _straight in _OF_ONE.items():
    _for_vectors(_known, _straight, 1)
for _known, _straight in _OF_TWO.items():
    _for_vectors(_known, _straight, 2)
for _known in _ONE_AT_A_TIME:
    _for_one(_known)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, Vec) and isinstance(y, types.Integer):
        return lambda x, y: functions.whole_power(x, y)
    if isinstance(x, Vec) and isinstance(y, (Vec, types.Float)):
        return lambda x, y: functions.power(x, y)
    return None
