"""Kernels: functions compiled for the types in a scene, and called by their addresses.

Each kernel is compiled separately, so another observable or event compiles only one kernel. Numba
takes no part in a call: Python calls a kernel by ctypes, outside the global lock, and `advance`
calls one by an address from its record.
"""

import ctypes
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import types
from numpy.typing import NDArray

from rigidmc.engine.compiler import (
    machine_code,
    math_functions,  # noqa: F401  (for custom code)
)
from rigidmc.engine.compiler.frozen import classes_of, is_custom
from rigidmc.engine.compiler.intrinsics import intrinsic
from rigidmc.engine.compiler.memory import DualRows, Rows
from rigidmc.engine.compiler.trees import StaticTree, tree_flatten
from rigidmc.engine.machine import use_widest_vectors

config: Any = numba.config
Function = Callable[..., Any]
WIDTH = 8  # float64 side by side in formulas: one vector of 512 bits, or two or four narrower ones
# Before anything is compiled: LLVM fixes its target at the first compilation of a process.
use_widest_vectors()
_INT, _REAL, _PLAIN = types.int64, types.float64, Rows(types.float64, 0)
# Letters of a KernelKey; the others are addresses.
_IN_C: dict[str, Any] = {"i": ctypes.c_int64, "k": ctypes.c_uint64, "f": ctypes.c_double}
# Addresses of kernels, found without asking Numba for types: see `KernelKey.of_types`
_addresses: dict[tuple[Any, ...], int] = {}


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
    types_key = key.of_types
    if types_key not in _addresses:
        _addresses[types_key] = machine_code.address_of(key.function, signature_of(key))
    return CompiledFunction(_addresses[types_key], 0, numbers.ctypes.data), numbers


def is_compiled(key: KernelKey) -> bool:
    """Return whether a kernel is in memory or in the disk cache, at least as LLVM code."""
    return (
        bool(config.DISABLE_JIT)
        or key.of_types in _addresses
        or machine_code.is_known(key.function, signature_of(key))
    )


def is_cacheable(key: KernelKey) -> bool:
    """Return whether another process can compile a kernel: its classes are all of the package."""
    return not config.DISABLE_JIT and not any(map(is_custom, classes_of(signature_of(key))))


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


def llvm_of(key: KernelKey) -> tuple[str, str]:
    """Return (name of a kernel's LLVM function, its LLVM code)."""
    return machine_code.llvm_of_function(key.function, signature_of(key))


def call_address(kernel, arguments):
    """Call a kernel with a tuple of arguments, arrays as `memory`.

    kernel : a CompiledFunction in a record
    """
    return kernel.address(kernel.tree, kernel.numbers, *arguments)


@intrinsic(call_address)
def _call(typing_context, kernel, arguments):
    argument_types = [_PLAIN, _PLAIN, *map(types.unliteral, arguments)]

    def generate(context, builder, sig, args):
        place = builder.bitcast(args[0], ir.IntType(64).as_pointer())
        # A CompiledFunction lies in the record as two words, see `record_type`.
        address, numbers = (
            builder.load(builder.gep(place, [ir.Constant(ir.IntType(32), i)])) for i in range(2)
        )
        code = builder.inttoptr(
            address, context.call_conv.get_function_type(_INT, argument_types).as_pointer()
        )
        values = [builder.extract_value(args[1], i) for i in range(len(argument_types) - 2)]
        first = (
            context.get_constant_null(_PLAIN),
            builder.inttoptr(numbers, context.get_value_type(_PLAIN)),
        )
        status, result = context.call_conv.call_function(
            builder, code, _INT, argument_types, [*first, *values]
        )
        with builder.if_then(status.is_error, likely=False):
            context.call_conv.return_status_propagate(builder, status)
        return result

    return _INT(kernel, arguments), generate
