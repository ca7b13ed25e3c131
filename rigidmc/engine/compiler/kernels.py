"""Kernels: functions compiled for the types in a scene, and called by their addresses.

Each kernel is compiled separately, so another observable or event compiles only one kernel. Numba
takes no part in a call: Python calls a kernel by ctypes, outside the global lock, and `advance`
calls one by an address from its record.

At the end, the functions of `math` that custom effects may call are registered with the compiler.
For vectors most are the straight-line code of `rigidmc.physics.dynamics.functions`, with the same
bits on every machine; the others run on one member at a time.
"""

import ctypes
import functools
import gc
import math
import operator
import sys
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import njit, typeof
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import overload
from numpy.typing import NDArray

from rigidmc.engine.compiler import disk_cache
from rigidmc.engine.compiler.compose import inline, inline_all
from rigidmc.engine.compiler.dual_types import DualType
from rigidmc.engine.compiler.intrinsics import cast_like, first_number, intrinsic
from rigidmc.engine.compiler.memory import DualRows, Rows
from rigidmc.engine.compiler.pipeline import FLAGS, INLINE
from rigidmc.engine.compiler.trees import StaticTree, tree_flatten
from rigidmc.engine.compiler.vector_types import VectorType
from rigidmc.engine.machine import use_widest_vectors
from rigidmc.physics.dynamics import functions
from rigidmc.physics.dynamics.so3 import arctan2, expm1

config: Any = numba.config
Function = Callable[..., Any]
# Python's 1000 frames are too few: each plain function that a kernel calls, and each element of a
# tuple, needs about 30.
DEEPEST_RECURSION = 5000
WIDTH = 8  # float64 side by side in formulas: one vector of 512 bits, or two or four narrower ones
# Before anything is compiled: LLVM fixes its target at the first compilation of a process.
use_widest_vectors()
_INT, _REAL, _PLAIN = types.int64, types.float64, Rows(types.float64, 0)
# Letters of a KernelKey; the others are addresses.
_IN_C: dict[str, Any] = {"i": ctypes.c_int64, "k": ctypes.c_uint64, "f": ctypes.c_double}
_by_types: dict[tuple[Any, ...], int] = {}  # addresses of kernels, by function and types
_addresses: dict[tuple[Any, ...], int] = {}  # the same, found without asking Numba for types
_llvm_code: dict[tuple[Any, ...], tuple[str, str]] = {}
# One kernel at a time: `_result` changes limits of the whole process.
_compiling = threading.Lock()
_dispatchers: dict[Any, Any] = {}


class CompiledFunction(NamedTuple):
    """A kernel in memory: the addresses of its code and of its numbers.

    Uncompiled: the function, its StaticTree, and the array of its numbers.
    """

    address: Any
    tree: Any
    numbers: Any


NO_FUNCTION = CompiledFunction(0, 0, 0)  # for a kernel that a scene does not use


class Tangents(NamedTuple):
    """The derivatives that a kernel computes along with its numbers.

    of_each : derivatives of each number, 0 for none
    in_state, in_work, in_trace, in_kept : vectors from a number to its first derivative in this
        memory, see `DualRows`; 0 for memory without derivatives
    of_body, of_effects : whether derivatives of the body and of the effects' parameters may be
        other than 0
    """

    of_each: int
    in_state: int = 0
    in_work: int = 0
    in_trace: int = 0
    in_kept: int = 0
    of_body: bool = True
    of_effects: bool = True


NO_TANGENTS = Tangents(0, of_body=False, of_effects=False)


class KernelKey(NamedTuple):
    """The inputs of a kernel's compilation: function(tree, numbers, *arguments).

    parts : NamedTuples; their types decide the code, which reads their numbers
    dtype, lanes : precision of the run, and how many members are worked on side by side
    arguments : the types of the other arguments in letters: s for rows in the precision of the run,
        w for rows in float64, t for the trace and d for running states before its steps, p for
        plain numbers in memory, n and u for integers and words in memory, i for an integer, k for a
        word, f for a number, r for a record of the type `record`
    tangents : of the numbers in rows
    """

    function: Function
    parts: Any
    dtype: str
    lanes: int
    arguments: str
    record: Any = None
    tangents: Tangents = NO_TANGENTS

    @property
    def of_types(self) -> Any:
        """The same key for all numbers of `parts`."""
        return (*self[:1], type_key(self.parts), *self[2:])


def signature_of(key: KernelKey) -> Any:
    """Return the types of the arguments of a kernel, and of its result."""
    real = types.float64 if key.dtype == "float64" else types.float32
    types_of = {
        "s": _rows(key, real, key.tangents.in_state),
        "w": _rows(key, _REAL, key.tangents.in_work),
        "t": _rows(key, real, key.tangents.in_trace),
        "d": _rows(key, _REAL, key.tangents.in_kept),
        "p": _PLAIN,
        "n": Rows(_INT, 0),
        "u": Rows(types.uint64, 0),
        "i": _INT,
        "f": _REAL,
        "k": types.uint64,
    }
    if key.record is not None:
        types_of["r"] = numba.from_dtype(key.record)
    arguments = (types_of[letter] for letter in key.arguments)
    return _INT(typeof(StaticTree(*key.parts)), _PLAIN, *arguments)


def _rows(key: KernelKey, real: Any, apart: int) -> Rows:
    """Return the type of a workspace of a kernel."""
    count, *_, of_body, of_effects = key.tangents
    if not count or not apart:
        return Rows(real, key.lanes)
    return DualRows(real, key.lanes, count, apart, (of_body, of_effects))


def compile_kernel(key: KernelKey) -> tuple[CompiledFunction, NDArray[np.float64]]:
    """Return (the compiled kernel of a key, its numbers).

    The array of the numbers must live as long as the kernel is called.
    """
    numbers = np.array(tree_flatten(key.parts) or [0.0])
    if config.DISABLE_JIT:
        return CompiledFunction(key.function, StaticTree(*key.parts), numbers), numbers
    known = key.of_types
    if known not in _addresses:
        _addresses[known] = _address(key.function, signature_of(key))
    return CompiledFunction(_addresses[known], 0, numbers.ctypes.data), numbers


def is_compiled(key: KernelKey) -> bool:
    """Return whether the code of a kernel is in memory or in the disk cache."""
    if config.DISABLE_JIT or key.of_types in _addresses:
        return True
    signature = signature_of(key)
    compiled = (key.function, signature.args) in _by_types
    return compiled or disk_cache.is_cached(_cached_dispatcher(key.function), signature)


def is_cacheable(key: KernelKey) -> bool:
    """Return whether the disk cache stores a kernel, so that another process may compile it."""
    return not config.DISABLE_JIT and disk_cache.keeps_kernel(
        _cached_dispatcher(key.function), signature_of(key)
    )


def type_key(argument: Any) -> Any:
    """Return a key of nested NamedTuples and numbers that differs whenever Numba's `typeof` does.

    It costs 9 us; `typeof` costs 90.
    """
    if isinstance(argument, tuple):
        return (type(argument), *map(type_key, argument))
    return type(argument)


def call_kernel(kernel: CompiledFunction, letters: str, *arguments: Any) -> Any:
    """Call a kernel from Python, outside its global lock, with memory as arrays.

    letters : of a KernelKey; all except i, k and f stand for memory
    """
    if config.DISABLE_JIT:
        return kernel.address(kernel.tree, kernel.numbers, *arguments)
    result, error = ctypes.c_int64(), ctypes.c_void_p()
    memory = (a.ctypes.data if isinstance(a, np.ndarray) else a for a in arguments)
    _in_python(kernel.address, letters)(
        ctypes.byref(result), ctypes.byref(error), None, kernel.numbers, *memory
    )
    return result.value


@functools.cache
def _in_python(address: int, letters: str) -> Any:
    """Return a kernel as a Python function.

    By Numba's calling convention it takes an address for the result, one for an error, an unused
    one (`tree` has no memory), and the arguments.
    """
    tree = (_IN_C.get(letter, ctypes.c_void_p) for letter in letters)
    return ctypes.CFUNCTYPE(
        ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, *tree
    )(address)


def dispatcher_of(function: Function) -> Any:
    """Return Numba's dispatcher of a kernel's function, without a cache."""
    options: Any = {**FLAGS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(**options)(function)


def _cached_dispatcher(function: Function) -> Any:
    """Return Numba's dispatcher of a kernel's function, with the disk cache."""
    if function not in _dispatchers:
        _dispatchers[function] = disk_cache.with_cache(dispatcher_of(function))
    return _dispatchers[function]


def _address(function: Function, signature: Any) -> int:
    """Return the address of a kernel's code, valid until its dispatcher is deleted."""
    key = function, signature.args
    with _compiling:
        if key not in _by_types:
            _by_types[key] = _compile(_cached_dispatcher(function), signature)
    return _by_types[key]


def llvm_of(key: KernelKey) -> tuple[str, str]:
    """Return (name of a kernel's LLVM function, its LLVM code); the disk cache has no such code."""
    return llvm_of_function(key.function, signature_of(key))


def llvm_of_function(function: Function, signature: Any) -> tuple[str, str]:
    """Return (name, LLVM code) of a function for arguments of the types of a signature."""
    known = function, signature.args
    with _compiling:
        if known not in _llvm_code:
            result = _result(dispatcher_of(function), signature)
            _llvm_code[known] = result.fndesc.llvm_func_name, result.library.get_llvm_str()
    return _llvm_code[known]


def _compile(dispatcher: Any, signature: Any) -> int:
    """Compile a kernel, or load it from the disk cache; return the address of its code."""
    result = _result(dispatcher, signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def _result(dispatcher: Any, signature: Any) -> Any:
    """Return Numba's compilation result of a kernel."""
    deepest, collects = sys.getrecursionlimit(), gc.isenabled()
    sys.setrecursionlimit(max(deepest, DEEPEST_RECURSION))
    gc.disable()  # a sixth of the time, for 70 MB
    try:
        with global_compiler_lock:
            return _loaded_or_compiled(dispatcher, signature)
    finally:
        sys.setrecursionlimit(deepest)
        if collects:
            gc.enable()


def _loaded_or_compiled(dispatcher: Any, signature: Any) -> Any:
    """Do the same as `dispatcher.compile`, without its timers around each LLVM call."""
    target, cache = dispatcher.targetctx, dispatcher._cache
    result = cache.load_overload(signature, target)
    if result is not None:
        dispatcher._cache_hits[signature] += 1
        target.insert_user_function(result.entry_point, result.fndesc, [result.library])
    else:
        dispatcher._cache_misses[signature] += 1
        result = dispatcher._compiler.compile(signature.args, signature.return_type)
        cache.save_overload(signature, result)
    dispatcher.overloads[signature.args] = result
    return result


def call_address(kernel, arguments):
    """Call a kernel with a tuple of arguments, arrays as `memory`.

    kernel : a CompiledFunction in a record
    """
    return kernel.address(kernel.tree, kernel.numbers, *arguments)


@intrinsic(call_address)
def _call(typing_context, kernel, arguments):
    given = [_PLAIN, _PLAIN, *map(types.unliteral, arguments)]

    def generate(context, builder, sig, args):
        place = builder.bitcast(args[0], ir.IntType(64).as_pointer())
        # A CompiledFunction lies in the record as two words, see `record_type`.
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

    return _INT(kernel, arguments), generate


_OF_ONE_ARGUMENT: dict[Any, Any] = {
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
_OF_TWO_ARGUMENTS: dict[Any, Any] = {
    math.atan2: arctan2,
    math.pow: functions.power,
    math.hypot: functions.hypotenuse,
}
_NUMBERS = (VectorType, DualType)
_SCALAR_ONLY = (
    math.gamma, math.lgamma, math.erf, math.erfc, math.log10, math.log2, math.log1p, math.asinh,
    math.acosh, math.atanh, math.degrees, math.radians,
)  # fmt: skip


def _overload_scalar(known: Callable[..., Any]) -> None:
    """Register a function of `math` for a vector of one number."""

    @overload(known, jit_options=INLINE)
    def one(x):
        return (
            (lambda x: cast_like(known(first_number(x)), x))
            if isinstance(x, VectorType) and x.count == 1
            else None
        )


def _overload_vector(known: Callable[..., Any], straight: Callable[..., Any], count: int) -> None:
    """Register `straight` for a function of `math` of `count` arguments.

    One of the arguments is a vector.
    """
    inline(straight)
    if count == 1:

        @overload(known, jit_options=INLINE)
        def one(x):
            return (lambda x: straight(x)) if isinstance(x, _NUMBERS) else None

    else:

        @overload(known, jit_options=INLINE)
        def two(x, y):
            vector = isinstance(x, _NUMBERS) or isinstance(y, _NUMBERS)
            return (lambda x, y: straight(x, y)) if vector else None


inline_all(functions)
for _known, _straight in _OF_ONE_ARGUMENT.items():
    _overload_vector(_known, _straight, 1)
for _known, _straight in _OF_TWO_ARGUMENTS.items():
    _overload_vector(_known, _straight, 2)
for _known in _SCALAR_ONLY:
    _overload_scalar(_known)


@overload(operator.pow, jit_options=INLINE)
def _compiled_power(x, y):
    if isinstance(x, _NUMBERS) and isinstance(y, types.Integer):
        return lambda x, y: functions.whole_power(x, y)
    if isinstance(x, _NUMBERS) and isinstance(y, (*_NUMBERS, types.Float)):
        return lambda x, y: functions.power(x, y)
    return None
