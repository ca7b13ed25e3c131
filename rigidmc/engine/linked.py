"""The kernels of a program as one function without Python: for GPUs and for WebAssembly.

The kernels of a program are linked with `run_lanes` of `rigidmc.engine.kernel.block`, which calls
them. The operations are the same as in the CPU's code: a product and a sum are fused only where
`rigidmc.engine.compiler.fma` says so, and divisions and roots follow IEEE 754. So a member has the
same bits.
"""

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compile_time import announce_compiling
from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.disk_cache import Entry, cached_text, has_text, text_entry
from rigidmc.engine.compiler.kernels import CompiledFunction, KernelKey, llvm_of, signature_of
from rigidmc.engine.compiler.trees import tree_flatten
from rigidmc.engine.kernel.arguments import (
    KernelShape,
    KernelTable,
    NoiseKeys,
    Workspace,
    record_type,
)
from rigidmc.engine.kernel.block import run_lanes
from rigidmc.engine.program import Program, fill_record
from rigidmc.errors import OptionError

KERNEL = "members"
# Lines and attributes in a module that depend on the target machine or on the caller's stack.
MACHINE = re.compile(r"^target .*\n|^source_filename.*\n| alignstack=\d+| alignstack\(\d+\)", re.M)
# Where there is one thread, it is number 0.
ONE_THREAD = """
define internal i64 @thread() alwaysinline {
  ret i64 0
}
"""


class LinkedProgram(Program):
    """A Program whose kernels are one code for another processor than this CPU.

    target : words that determine the code together with the kernels
    """

    target: str

    def make_code(self, target: str) -> str:
        """Return the code for a target, from `self.linked()`."""
        raise NotImplementedError

    def code_for(self, target: str) -> str:
        """Return the code for a target, from the cache or newly made."""
        return cached_text(self._entry(target), lambda: self.make_code(target))

    def linked(self, thread: str = ONE_THREAD) -> llvm.ModuleRef:
        """Return the LLVM code of the kernels; see `link_kernel`."""
        return link_kernel(self.kernel_keys, self.shape, self._sizes(), thread)

    def kernel_numbers(self) -> list[NDArray[np.float64]]:
        """Return the numbers of each kernel, in the order of a KernelTable."""
        keys = [key for name, key in self.kernel_keys.items() if name != "advance"]
        return [np.array(tree_flatten(key.parts if key else ()) or [0.0]) for key in keys]

    def frame_for(
        self,
        put: Callable[[NDArray[Any]], int],
        block: NDArray[np.float64],
        noise: NoiseKeys,
        kernels: Iterable[int],
        substeps: int,
    ) -> tuple[Any, int]:
        """Return (the frame of a block in other memory, the address of the block there).

        put : copies an array to that memory and returns its address
        kernels, substeps : addresses there, of the numbers of each kernel and of the substeps
        """
        at, (rows, members) = put(block), block.shape
        rows //= self.copies
        workspace = Workspace(
            substeps=substeps,
            substep_rows=self.substeps.size // 4,
            block=at,
            rows=rows,
            width=members,
            skips_cache=0,
            **dict.fromkeys(self.working_memory(rows), 0),  # each thread has its own
        )
        table = KernelTable(*(CompiledFunction(0, 0, numbers) for numbers in kernels))
        keys = noise._replace(streams=put(noise.streams), members=put(noise.members))
        empty = np.zeros(1, record_type(self.dtype))
        return fill_record(empty, table, self.shape, keys, workspace), at

    def missing(self) -> list[str]:
        """Return ["kernel"] if it is neither in memory nor in the disk cache."""
        return [] if has_text(self._entry(self.target)) else ["kernel"]

    def helper_share(self) -> list[str]:
        """Return an empty list: one process compiles the one kernel."""
        return []

    def _compile(self, meanwhile: Callable[[], None] | None = None) -> None:
        with announce_compiling(self.label, self.missing(), self.effects):
            self.code = self.code_for(self.target)

    def _entry(self, target: str) -> Entry:
        """Return the place of the code in the cache."""
        types = [signature_of(key) for key in self.kernel_keys.values() if key]
        return text_entry(types, f"{self.shape} {self._sizes()} {target}")

    def _sizes(self) -> dict[str, int]:
        """Return {name in Workspace: bytes} of the memory that a thread works in."""
        return {
            name: count * np.dtype(kind).itemsize * self.lanes
            for name, (count, kind) in self.working_memory(self.rows).items()
        }


def run_member(kinds, numbers, frame, low):
    """Take one member of a block through the steps, see `rigidmc.engine.kernel.block.run_lanes`."""
    return run_lanes(frame, low)


inline_all(sys.modules[__name__])


def link_kernel(
    keys: Mapping[str, KernelKey | None],
    shape: KernelShape,
    workspace: Mapping[str, int],
    thread: str = ONE_THREAD,
) -> llvm.ModuleRef:
    """Return the LLVM code of members(frame, first, count).

    In it thread i < count takes the members from place first + i on, one per lane.

    keys : the kernels of a program, by name
    shape : of its members
    workspace : bytes of working memory of a thread, by the names of
        `rigidmc.engine.kernel.arguments.Workspace`
    thread : code of the function that returns the number of a thread
    """
    dtype = next(key for key in keys.values() if key).dtype
    kernels = {name: llvm_of(key) for name, key in keys.items() if key and name != "advance"}
    entry_code = llvm_of(KernelKey(run_member, (), dtype, 0, "ri", record_type(dtype)))
    names = {name: function for name, (function, _) in kernels.items()}
    entry = _entry(entry_code[0], names, shape, workspace, record_type(dtype))
    module = join_code(entry + thread, [text for _, text in (entry_code, *kernels.values())])
    # The kernels stay separate functions. If inlined, monitoring kernels leave `march` too few
    # registers, and it spills within its steps (strang in a bath 316 bytes).
    called = {function: name for name, function in names.items()}
    for function in module.functions:
        if function.is_declaration or function.name == KERNEL:
            continue
        function.linkage = "internal"
        function.add_function_attribute("noinline" if function.name in called else "alwaysinline")
        function.name = called.get(function.name, function.name)
    return module


def join_code(entry: str, codes: Iterable[str] = ()) -> llvm.ModuleRef:
    """Return LLVM code joined with the codes of kernels that it calls."""
    module = llvm.parse_assembly(entry)
    for code in codes:
        module.link_in(llvm.parse_assembly(MACHINE.sub("", code)))
    for variable in module.global_variables:
        variable.linkage = "internal"  # Numba's, unused
    return module


def _entry(
    run_member_name: str,
    names: Mapping[str, str],
    shape: KernelShape,
    workspace: Mapping[str, int],
    record: np.dtype[Any],
) -> str:
    """Return the kernel's code. A thread has its own memory and frame, in which kernels and shape
    are constants.
    """
    fields: Any = record.fields
    # The frame of a thread gets addresses and shape as constants: LLVM then calls the kernels
    # directly, and drops unused ones.
    constants = {name: f'ptrtoint (ptr @"{function}" to i64)' for name, function in names.items()}
    constants |= {name: str(number) for name, number in shape._asdict().items()}
    constants |= {name: f"%address.{name}" for name in workspace}
    memory = [
        f"""  %of.{name} = alloca [{size} x i8], align 16
  %address.{name} = ptrtoint ptr %of.{name} to i64"""
        for name, size in workspace.items()
    ]
    stores = [
        f"""  %at.{name} = getelementptr i8, ptr %frame, i64 {fields[name][1]}
  store i64 {value}, ptr %at.{name}, align 8"""
        for name, value in constants.items()
    ]
    declared = [f'declare i32 @"{function}"(...)' for function in names.values()]
    return "\n".join(
        [
            *declared,
            f"""
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare i32 @"{run_member_name}"(ptr, ptr, ptr, ptr, ptr, i64)
define void @{KERNEL}(ptr %given, i64 %first, i64 %count) {{
  %frame = alloca [{record.itemsize} x i8], align 16
  %result = alloca i64
  %error = alloca ptr""",
            *memory,
            f"""  %number = call i64 @thread()
  %mine = icmp ult i64 %number, %count
  br i1 %mine, label %live, label %end
live:
  call void @llvm.memcpy.p0.p0.i64(
    ptr align 8 %frame, ptr align 8 %given, i64 {record.itemsize}, i1 false)""",
            *stores,
            f"""  %low = add i64 %first, %number
  call i32 @"{run_member_name}"(ptr %result, ptr %error, ptr null, ptr null, ptr %frame, i64 %low)
  br label %end
end:
  ret void
}}
""",
        ]
    )


def target_machine(triple: str, **options: Any) -> llvm.TargetMachine:
    """Return LLVM's target machine for a processor; options : as of `create_target_machine`."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(triple).create_target_machine(opt=3, **options)


def refuse_calls(names: Sequence[str], where: str, device: str) -> None:
    """Raise OptionError if custom code calls functions that a processor lacks; where : its name."""
    if names:
        rule = f"custom code calls {', '.join(names)}, which {where} not have"
        rule += ": use functions of rigidmc instead"
        raise OptionError(rule, at="device", value=device)


def optimise(module: llvm.ModuleRef, machine: llvm.TargetMachine) -> llvm.ModuleRef:
    """Optimise a module for a machine."""
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    # A thread has one member: nothing to vectorise.
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    first = llvm.create_new_module_pass_manager()
    first.add_always_inliner_pass()  # `run_lanes`, and the functions it calls
    first.run(module, builder)
    builder.getModulePassManager().run(module, builder)
    return module
