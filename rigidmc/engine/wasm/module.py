"""WebAssembly modules: linked kernels compiled by LLVM, with an export section and no linker.

An object of LLVM that has one unit is a module that only exports nothing: its calls and addresses
are already filled in. Memory and stack pointer are imported.
"""

import io
from collections.abc import Iterator

import llvmlite.binding as llvm

from rigidmc.engine.linked import KERNEL, optimise, refuse_calls, target_machine
from rigidmc.engine.wasm.fused import ONE, RELAXED, join_fused

TRIPLE = "wasm32-unknown-unknown"
# Every browser since 2021 has these; since 2023 most have relaxed SIMD too.
FEATURES = "+simd128,+bulk-memory,+sign-ext,+mutable-globals,+nontrapping-fptoint"
# What a module exports: the kernel, and a multiply-add that shows whether a machine fuses it
EXPORTED = KERNEL, ONE
IMPORTED = "__linear_memory", "__stack_pointer"
# Sections by their numbers, in the order in which a module has them, see the WebAssembly
# specification, section 5.5. The others, which linkers read, are left out.
SECTIONS = 1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 10, 11
IMPORT, EXPORT = 2, 7
# How many numbers describe an import: the type of a function; type and limits of a table; limits
# of a memory; type and mutability of a global
DESCRIBED = 1, 3, 2, 2


def wasm_of(module: llvm.ModuleRef, fused: str) -> bytes:
    """Return the WebAssembly module of linked kernels, which exports EXPORTED.

    fused : the version of fused multiply-adds, see `rigidmc.engine.wasm.fused`
    Raises OptionError for numbers in float32, and for custom code that calls functions that
    WebAssembly does not have.
    """
    joined = join_fused(module, fused)
    for function in joined.functions:
        if not function.is_declaration and function.name not in EXPORTED:
            function.linkage = "internal"
    machine = target_machine(TRIPLE, features=FEATURES + ",+relaxed-simd" * (fused == RELAXED))
    optimised = optimise(joined, machine)
    sections = dict(_sections(machine.emit_object(optimised)))
    lacking = [name for name in _imports(sections[IMPORT]) if name not in IMPORTED]
    refuse_calls(lacking, "WebAssembly does", "wasm")
    # No function is imported: their numbers count the functions that are defined.
    defined = [function.name for function in optimised.functions if not function.is_declaration]
    entries = [_sized(name.encode()) + b"\0" + _leb(defined.index(name)) for name in EXPORTED]
    sections[EXPORT] = _leb(len(entries)) + b"".join(entries)
    listed = (bytes([kind]) + _sized(sections[kind]) for kind in SECTIONS if kind in sections)
    return b"\0asm\1\0\0\0" + b"".join(listed)


def _sections(made: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (number, content) of the sections of an object."""
    read = io.BytesIO(made[8:])  # after the magic number and the version
    while kind := read.read(1):
        yield kind[0], read.read(_number(read))


def _imports(content: bytes) -> Iterator[str]:
    """Yield the names in an import section."""
    read = io.BytesIO(content)
    for _ in range(_number(read)):
        _, name = (read.read(_number(read)).decode() for _ in range(2))  # after its module
        yield name
        for _ in range(DESCRIBED[_number(read)]):
            _number(read)


def _number(read: io.BytesIO) -> int:
    """Read an unsigned LEB128 number: seven bits a byte, the lowest first."""
    byte = read.read(1)[0]
    return byte if byte < 0x80 else byte - 0x80 + (_number(read) << 7)


def _leb(number: int) -> bytes:
    """Encode a number as unsigned LEB128."""
    return bytes([number]) if number < 0x80 else bytes([number % 0x80 + 0x80]) + _leb(number >> 7)


def _sized(content: bytes) -> bytes:
    """Return bytes after their number."""
    return _leb(len(content)) + content
