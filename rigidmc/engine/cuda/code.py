"""From kernels to the code of a GPU: a thread lives the life of one member.

The kernels of a program are compiled for one member, with `run_lanes` of
`rigidmc.engine.kernel.block`, which calls them, and linked into one. LLVM makes PTX of it, which a
driver takes. The operations are those of the CPU's code: a product and a sum are fused where
`rigidmc.engine.compiler.fma` says so and nowhere else, and divisions and roots are those of
IEEE 754. A member thus has the same bits.
"""

import re
import sys
from collections.abc import Mapping
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from rigidmc.engine.compiler.compose import inline_all
from rigidmc.engine.compiler.kernels import KernelKey, llvm_of
from rigidmc.engine.kernel.arguments import KernelShape, record_type
from rigidmc.engine.kernel.block import run_lanes
from rigidmc.errors import OptionError

TRIPLE = "nvptx64-nvidia-cuda"
KERNEL = "members"
# What a module says of the machine that it is for, and of the caller's stack.
MACHINE = re.compile(r"^target .*\n|^source_filename.*\n| alignstack=\d+| alignstack\(\d+\)", re.M)
# Intrinsic functions that LLVM has for a GPU, or for every target
_HAS = re.compile(
    r"llvm\.(nvvm|fma|fabs|sqrt|copysign|floor|ceil|trunc|rint|round|min|max|mem|lifetime|assume"
    r"|experimental\.noalias|[us](add|sub|mul|min|max)|abs|ct|bswap|fsh|vector|fptosi\.sat)"
)
# The number of a thread among all of a launch, in PTX's words; elsewhere there is one thread.
_THREAD = """
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
define internal i64 @thread() alwaysinline {
  %block = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %size = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %place = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %before = mul i32 %block, %size
  %number = add i32 %before, %place
  %index = zext i32 %number to i64
  ret i64 %index
}
"""
_ALONE = """
define internal i64 @thread() alwaysinline {
  ret i64 0
}
"""


def run_member(kinds, numbers, frame, low):
    """The life of one member of a block, see `rigidmc.engine.kernel.block.run_lanes`."""
    return run_lanes(frame, low)


inline_all(sys.modules[__name__])


def link_kernel(
    keys: Mapping[str, KernelKey | None],
    shape: KernelShape,
    workspace: Mapping[str, int],
    host: bool = False,
) -> llvm.ModuleRef:
    """LLVM's code of members(frame, first, count), in which thread i < count takes the member at
    place first + i.

    keys : the kernels of a program for one member, by their names;  shape : of its members
    workspace : bytes of the memory that a member works in, by the names of
        `rigidmc.engine.kernel.arguments.Workspace`
    host : for one thread of this CPU, which tests run
    """
    dtype = next(key for key in keys.values() if key).dtype
    kernels = {name: llvm_of(key) for name, key in keys.items() if key and name != "advance"}
    entry_code = llvm_of(KernelKey(run_member, (), dtype, 0, "ri", record_type(dtype)))
    names = {name: function for name, (function, _) in kernels.items()}
    entry = _entry(entry_code[0], names, shape, workspace, record_type(dtype))
    module = llvm.parse_assembly(entry + (_ALONE if host else _THREAD))
    for _, text in (entry_code, *kernels.values()):
        module.link_in(llvm.parse_assembly(MACHINE.sub("", text)))
    for variable in module.global_variables:
        variable.linkage = "internal"  # Numba's, which nothing uses
    # The kernels stay functions: inlined, those that monitor leave `march` too few registers, and
    # it would spill within its steps (strang in a bath 316 bytes).
    called = {function: name for name, function in names.items()}
    for function in module.functions:
        if function.is_declaration or function.name == KERNEL:
            continue
        function.linkage = "internal"
        function.add_function_attribute("noinline" if function.name in called else "alwaysinline")
        function.name = called.get(function.name, function.name)
    return module


def _entry(
    run_member_name: str,
    names: Mapping[str, str],
    shape: KernelShape,
    workspace: Mapping[str, int],
    record: np.dtype[Any],
) -> str:
    """The kernel: a thread has memory and a frame of its own, whose kernels and shape the compiler
    knows.
    """
    fields: Any = record.fields
    # The frame of a thread gets addresses and shape as constants: LLVM then calls the kernels
    # directly, and drops what a scene does not use.
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


def optimise(module: llvm.ModuleRef, machine: llvm.TargetMachine) -> llvm.ModuleRef:
    """A module, optimised for a machine."""
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    # A thread has one member: there is nothing to vectorise.
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    first = llvm.create_new_module_pass_manager()
    first.add_always_inliner_pass()  # `run_lanes`, and what it calls
    first.run(module, builder)
    builder.getModulePassManager().run(module, builder)
    return module


def machine_for(capability: tuple[int, int]) -> llvm.TargetMachine:
    """Devices of a compute capability, as LLVM compiles for them."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    return target.create_target_machine(cpu="sm_{}{}".format(*capability), opt=3)


def ptx_of(module: llvm.ModuleRef, capability: tuple[int, int]) -> str:
    """The PTX of a module for devices of a compute capability or a later one."""
    machine = machine_for(capability)
    # llvmlite has no name for the calling convention of kernels: it is written into the text.
    text = str(module).replace(f"define void @{KERNEL}(", f"define ptx_kernel void @{KERNEL}(")
    optimised = optimise(llvm.parse_assembly(text), machine)
    lacking = [f.name for f in optimised.functions if f.is_declaration and not _HAS.match(f.name)]
    if lacking:
        names = ", ".join(_plain(name) for name in lacking)
        rule = f"calls {names}, which no device has: write it with the functions of rigidmc"
        raise OptionError(f"code of your own {rule}", at="device", value="cuda")
    return str(machine.emit_assembly(optimised))


def _plain(name: str) -> str:
    """What a function of LLVM is called in Python."""
    return name.removeprefix("llvm.").partition(".")[0]
