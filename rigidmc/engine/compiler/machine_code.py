"""From a kernel to the address of its machine code, by two levels of the disk cache.

The first level is LLVM code: typed, inlined and optimised. It depends on the width of the vectors,
and on nothing else of a processor; GPUs and browsers begin with it, too. The second level is
machine code of one processor. Another one with vectors of this width needs the second level only,
which takes a tenth of the time.
"""

import gc
import hashlib
import math
import re
import sys
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from rigidmc.engine.compiler.disk_cache import Entry, entry_of, is_stored, log_once, read, store
from rigidmc.engine.compiler.libraries import in_written_order
from rigidmc.engine.compiler.lowering import LoweredFunction, lower_kernel
from rigidmc.engine.compiler.source_stamps import source_stamp
from rigidmc.engine.machine import vector_bits

Function = Callable[..., Any]
# Python's 1000 frames are too few: each plain function that a kernel calls, and each element of a
# tuple, needs about 30.
DEEPEST_RECURSION = 5000
# Functions that kernels may call and stay on disk: of LLVM, and of C if Python's math has them,
# too. Others are addresses in this process.
_CALLED = re.compile(rf"llvm\.|(numba_)?({'|'.join(dir(math))})f?$")
_PRIVATE = 8, 9  # LLVM linkages that no other code sees: internal, private
_addresses: dict[str, int] = {}  # {name of an entry: address of its machine code}
_llvm_code: dict[str, bytes] = {}  # {name of an entry: LLVM code that the disk does not have}
# One kernel at a time: `lower` changes limits of the whole process.
_compiling = threading.Lock()


def kernel_entry(function: Function, signature: Any) -> Entry:
    """Return what decides the LLVM code of a kernel, for arguments of the types of a signature."""
    home = f"{function.__module__} {function.__qualname__} {source_stamp(function.__module__)}"
    entry = entry_of([signature], home, llvm.get_process_triple(), vector_bits())
    return entry._replace(name=f"{entry.name}.bc")


def is_known(function: Function, signature: Any) -> bool:
    """Return whether a kernel needs no typing and lowering: it is in memory or on disk."""
    entry = kernel_entry(function, signature)
    is_in_memory = entry.name in _addresses or entry.name in _llvm_code
    return is_in_memory or is_stored(entry) or is_stored(_of_processor(entry))


def address_of(function: Function, signature: Any) -> int:
    """Return the address of a kernel's machine code."""
    entry = kernel_entry(function, signature)
    with _compiling:
        if entry.name not in _addresses:
            code = read(_of_processor(entry)) or _compiled(entry, function, signature)
            _addresses[entry.name] = _load(entry, code)
    return _addresses[entry.name]


def llvm_of_function(function: Function, signature: Any) -> tuple[str, str]:
    """Return (name, LLVM code) of a function for arguments of the types of a signature."""
    entry = kernel_entry(function, signature)
    with _compiling:
        module = _lowered(entry, function, signature)
        # which prepares addresses in the LLVM code: without that, rk4 of free bodies takes 160
        # registers of a GPU, not 134
        _machine_code(module)
    return _symbol(entry), str(module)


def lower(function: Function, arguments: Any, result: Any = None) -> LoweredFunction:
    """Compile a kernel to optimised LLVM code.

    arguments, result : types
    """
    deepest, collects = sys.getrecursionlimit(), gc.isenabled()
    sys.setrecursionlimit(max(deepest, DEEPEST_RECURSION))
    gc.disable()  # a sixth of the time, for 70 MB
    try:
        # of 9.7 s of rk4, typing and lowering take 6.9, LLVM's optimisation 1.7, machine code 1.0
        with global_compiler_lock:
            return lower_kernel(function, arguments, result)
    finally:
        sys.setrecursionlimit(deepest)
        if collects:
            gc.enable()


def _symbol(entry: Entry) -> str:
    """Return the name of a kernel's function: no other code of this process may have it."""
    return f"kernel_{entry.name[:32]}"


def _of_processor(entry: Entry) -> Entry:
    """Return the entry of the machine code of a kernel."""
    processor = hashlib.sha256(repr(_codegen().magic_tuple()).encode()).hexdigest()[:16]
    return entry._replace(name=f"{entry.name.removesuffix('.bc')}-{processor}.o")


def _codegen() -> Any:
    return cpu_target.target_context.codegen()


def _lowered(entry: Entry, function: Function, signature: Any) -> llvm.ModuleRef:
    """Return the LLVM code of a kernel, from the disk or newly made."""
    if (code := _llvm_code.get(entry.name) or read(entry)) is not None:
        try:
            return llvm.parse_bitcode(code)
        except RuntimeError as error:  # of another LLVM
            log_once(error)
    lowered = lower(function, signature.args, signature.return_type)
    module = lowered.library._final_module
    module.get_function(lowered.symbol).name = _symbol(entry)
    code = module.as_bitcode()
    if lowered.library._reload_init or not is_closed(module) or not store(entry, code):
        _llvm_code[entry.name] = code
    # as from the disk: the machine code is the same
    return llvm.parse_bitcode(code)


def _compiled(entry: Entry, function: Function, signature: Any) -> bytes:
    """Make the machine code of a kernel, and store it."""
    code = _machine_code(_lowered(entry, function, signature))
    if entry.name not in _llvm_code:
        store(_of_processor(entry), code)
    return code


def _machine_code(module: llvm.ModuleRef) -> bytes:
    """Return the machine code of LLVM code, which LLVM changes for it."""
    with global_compiler_lock, in_written_order():
        return bytes(_codegen()._tm.emit_object(module))


def _load(entry: Entry, code: bytes) -> int:
    """Return the address of machine code, which stays in memory."""
    engine = _codegen()._engine._ee
    with global_compiler_lock:
        engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
        engine.finalize_object()
    return int(engine.get_function_address(_symbol(entry)))


def is_closed(module: llvm.ModuleRef) -> bool:
    """Return whether code stands by itself.

    It must be one function that calls known functions by name and contains no address of this
    process. Numba names other functions, and the environments of functions, by a count in the
    process. In the next process the same name is another function and would be called instead.
    """
    text = str(module)
    if "inttoptr (" in text:  # a constant address; a computed one has no bracket
        return False
    # All calls are inlined: a second function would be one of Numba's, linked by its name.
    called = [entry.name for entry in module.functions if entry.is_declaration]
    if len(called) + 1 < len(list(module.functions)) or not all(map(_CALLED.match, called)):
        return False
    named = Counter(re.findall(r"@([-\w$.]+)", text))
    return all(
        named[entry.name] == 1  # where it is defined
        if entry.name.startswith("_ZN08NumbaEnv")
        else entry.linkage.value in _PRIVATE
        for entry in module.global_variables
    )
