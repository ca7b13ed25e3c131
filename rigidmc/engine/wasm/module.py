"""WebAssembly modules: linked kernels compiled by LLVM, with an export section and no linker.

An object of LLVM that has one unit is a module that only exports nothing: its calls and addresses
are already filled in. Memory and stack pointer are imported.
"""

import re
from collections.abc import Iterator

import llvmlite.binding as llvm

from rigidmc.engine.linked import KERNEL, optimise
from rigidmc.engine.wasm.fused import RELAXED, fused_functions
from rigidmc.errors import OptionError

TRIPLE = "wasm32-unknown-unknown"
# Every browser since 2021 has these; since 2023 most have relaxed SIMD too.
FEATURES = "+simd128,+bulk-memory,+sign-ext,+mutable-globals,+nontrapping-fptoint"
IMPORTS = ("__linear_memory", "__stack_pointer")
# Code that fuses n pairs of (x, y, z) from an address on, and puts x y + z behind them: it shows
# whether a machine fuses relaxed multiply-adds.
PROBE = """
define void @members(ptr %a, i64 %n, i64 %unused) {
start:
  br label %loop
loop:
  %i = phi i64 [0, %start], [%next, %loop]
  %at = getelementptr [4 x <2 x double>], ptr %a, i64 %i
  %py = getelementptr <2 x double>, ptr %at, i64 1
  %pz = getelementptr <2 x double>, ptr %at, i64 2
  %po = getelementptr <2 x double>, ptr %at, i64 3
  %x = load <2 x double>, ptr %at
  %y = load <2 x double>, ptr %py
  %z = load <2 x double>, ptr %pz
  %r = call <2 x double> @llvm.fma.v2f64(<2 x double> %x, <2 x double> %y, <2 x double> %z)
  store <2 x double> %r, ptr %po
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %n
  br i1 %more, label %loop, label %end
end:
  ret void
}
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>)
"""
# Numbers of sections and kinds, see the WebAssembly specification, section 5.5, and the linking
# convention of its tools
CUSTOM, IMPORT, FUNCTION_INDEX, EXPORT = 0, 2, 0, 7
SYMBOL_TABLE, UNDEFINED, EXPLICIT_NAME = 8, 0x10, 0x40


def wasm_of(module: llvm.ModuleRef, fused: str) -> bytes:
    """Return the WebAssembly module of linked kernels, which exports `members`.

    fused : the version of fused multiply-adds, see `rigidmc.engine.wasm.fused`
    Raises OptionError for custom code that calls functions that WebAssembly does not have.
    """
    text = str(module).replace("@llvm.fma.", "@fma.")
    if re.search(r"@fma\.(?!v?[12]?f64)", text):
        raise OptionError("live pages compute in float64: set run.dtype", at="dtype")
    whole = llvm.parse_assembly(text)
    whole.link_in(llvm.parse_assembly(fused_functions(fused)))
    for function in whole.functions:
        if not function.is_declaration and function.name != KERNEL:
            function.linkage = "internal"
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    features = FEATURES + ",+relaxed-simd" * (fused == RELAXED)
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(opt=3, features=features)
    optimised = optimise(whole, machine)
    made = machine.emit_object(optimised)
    imports, functions = _functions(made)
    lacking = [name for name in imports if name not in IMPORTS]
    if lacking:
        rule = f"custom code calls {', '.join(lacking)}, which WebAssembly does not have: use"
        raise OptionError(f"{rule} functions of rigidmc instead", at="device", value="wasm")
    return _exporting(made, {KERNEL: functions[KERNEL]})


def _exporting(made: bytes, functions: dict[str, int]) -> bytes:
    """Return an object with an export section, and without the sections that linkers read."""
    entries = b"".join(_text(name) + b"\0" + _leb(number) for name, number in functions.items())
    body = _leb(len(functions)) + entries
    exports = bytes([EXPORT]) + _leb(len(body)) + body
    parts, done = [made[:8]], False
    for kind, content in _sections(made):
        if kind == CUSTOM:
            continue
        if kind > EXPORT and not done:
            parts.append(exports)
            done = True
        parts.append(bytes([kind]) + _leb(len(content)) + content)
    return b"".join(parts)


def _functions(made: bytes) -> tuple[list[str], dict[str, int]]:
    """Return (names of imports other than types of calls, {name of a function: its number})."""
    imports, functions = list[str](), dict[str, int]()
    for kind, content in _sections(made):
        read = _Reader(content)
        if kind == IMPORT:
            imports += [name for name in _import_names(read)]
        elif kind == CUSTOM and read.text() == "linking":
            read.number()  # version
            while read.at < len(content):
                part, size = read.byte(), read.number()
                end = read.at + size
                if part == SYMBOL_TABLE:
                    functions = dict(_symbols(read))
                read.at = end
    return imports, functions


def _import_names(read: "_Reader") -> Iterator[str]:
    for _ in range(read.number()):
        read.text()
        yield read.text()
        kind = read.byte()
        if kind == 0:  # a function, by its type
            read.number()
        elif kind in (1, 2):  # a table, which begins with its type; a memory: limits
            read.at += kind == 1
            bounded = read.byte()
            read.number()
            if bounded & 1:
                read.number()
        else:  # a global: type and mutability
            read.at += 2


def _symbols(read: "_Reader") -> Iterator[tuple[str, int]]:
    """Yield (name, number) of the functions in a symbol table that are defined here."""
    for _ in range(read.number()):
        kind, flags = read.byte(), read.number()
        if kind == 1:  # data
            read.text()
            if not flags & UNDEFINED:
                for _ in range(3):
                    read.number()
            continue
        number = read.number()
        if kind == 3:  # a section has no name
            continue
        if not flags & UNDEFINED or flags & EXPLICIT_NAME:
            name = read.text()
            if kind == FUNCTION_INDEX and not flags & UNDEFINED:
                yield name, number


def _sections(made: bytes) -> Iterator[tuple[int, bytes]]:
    read = _Reader(made)
    read.at = 8  # after the magic number and the version
    while read.at < len(made):
        kind, size = read.byte(), read.number()
        yield kind, made[read.at : read.at + size]
        read.at += size


class _Reader:
    """A place in bytes, from which numbers and texts are read."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def byte(self) -> int:
        self.at += 1
        return self.content[self.at - 1]

    def number(self) -> int:
        """Read an unsigned LEB128 number."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if not byte & 0x80:
                return value

    def text(self) -> str:
        size = self.number()
        self.at += size
        return self.content[self.at - size : self.at].decode()


def _leb(number: int) -> bytes:
    """Encode a number as unsigned LEB128."""
    out = bytearray()
    while True:
        number, low = number >> 7, number & 0x7F
        out.append(low | (0x80 if number else 0))
        if not number:
            return bytes(out)


def _text(name: str) -> bytes:
    return _leb(len(name)) + name.encode()
