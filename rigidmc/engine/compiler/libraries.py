"""Code of functions as LLVM modules: inlined functions, and kernels that collect and optimise them.

Numba compiles, optimises and links each function by itself, and then the kernel again. Here an
inlined function stops at LLVM code, and a kernel collects the functions it calls, inlines them all
and is optimised once. `fuse` is the last step of lowering, before anything is inlined.
"""

import contextlib
from collections.abc import Iterator
from typing import Any

import llvmlite.binding as llvm
from numba.core.cgutils import normalize_ir_text
from numba.core.codegen import CodeLibrary, JITCodeLibrary

from rigidmc.engine.compiler.fma import fuse
from rigidmc.engine.machine import LINE, vector_registers


class Fusing:
    """The lowering of a function, then `fuse`."""

    module: Any

    def lower_normal_function(self, fndesc: Any) -> None:
        super().lower_normal_function(fndesc)  # type: ignore[misc]
        for function in self.module.functions:
            fuse(function)
            if function.blocks:
                # llvmlite writes alignstack only next to another attribute
                function.attributes.add("nounwind")
                function.attributes.alignstack = LINE


class InlineLibrary(JITCodeLibrary):
    """Code that is inlined wherever it is called.

    By itself it is not linked, optimised or compiled to machine code.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries = []

    def add_ir_module(self, ir_module: Any) -> None:
        # Numba would first link it into an empty module.
        self._final_module = llvm.parse_assembly(normalize_ir_text(str(ir_module)))
        self._final_module.name = ir_module.name
        self._final_module.verify()

    def finalize(self) -> None:
        # Two kernels may contain the same function, and one that is inlined everywhere is dropped.
        for function in self.get_defined_functions():
            function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        return self._final_module


@contextlib.contextmanager
def in_written_order() -> Iterator[None]:
    """Keep machine code in the order in which the physics is written, for 32 vector registers.

    The bits are the same in any order. In the order of LLVM's scheduler numbers wait in memory for
    their use: with 512 bits splittings are slower; on ARM rk8 with gravity has a fifth more
    instructions (tests/tools/arm.py).
    """
    if vector_registers() < 32:
        yield
        return
    llvm.set_option("rigidmc", "-enable-misched=0")
    try:
        yield
    finally:
        llvm.set_option("rigidmc", "-enable-misched=1")


class KernelLibrary(JITCodeLibrary):
    """A kernel: all calls are inlined recursively, then it is optimised once.

    Its machine code is made elsewhere, see `rigidmc.engine.compiler.machine_code`.
    """

    def finalize(self) -> None:
        libraries, left = dict.fromkeys(self._linking_libraries), list(self._linking_libraries)
        while left:
            new = [library for library in left.pop()._linking_libraries if library not in libraries]
            libraries.update(dict.fromkeys(new))
            left += new
        self._linking_libraries = list(libraries)
        super().finalize()

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(opt=0)
        passes.add_always_inliner_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, builder)
        # The vectors are members: LLVM could only build further ones from numbers of one member.
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalized = True
