"""From kernels to GPU code: one thread takes one member through the run.

The kernels of a program are compiled for one member and linked with `run_lanes` of
`rigidmc.engine.kernel.block`, which calls them, into one. LLVM turns it into PTX, which the driver
loads. The operations are the same as in the CPU's code: a product and a sum are fused only where
`rigidmc.engine.compiler.fma` says so, and divisions and roots follow IEEE 754. So a member has the
same bits.
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
# Lines and attributes in a module that depend on the target machine or on the caller's stack.
MACHINE = re.compile(r"^target .*\n|^source_filename.*\n| alignstack=\d+| alignstack\(\d+\)", re.M)
# Intrinsic functions that LLVM provides for a GPU, or for every target
_HAS = re.compile(
    r"llvm\.(nvvm|fma|fabs|sqrt|copysign|floor|ceil|trunc|rint|round|min|max|mem|lifetime|assume"
    r"|experimental\.noalias|[us](add|sub|mul|min|max)|abs|ct|bswap|fsh|vector|fptosi\.sat)"
)
# The index of a thread in a launch, in PTX; on the host there is one thread.
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
    """Take one member of a block through the steps, see `rigidmc.engine.kernel.block.run_lanes`."""
    return run_lanes(frame, low)


inline_all(sys.modules[__name__])


def link_kernel(
    keys: Mapping[str, KernelKey | None],
    shape: KernelShape,
    workspace: Mapping[str, int],
    host: bool = False,
) -> llvm.ModuleRef:
    """Return the LLVM code of members(frame, first, count).

    In it thread i < count takes the member at place first + i.

    keys : the kernels of a program for one member, by name
    shape : of its members
    workspace : bytes of working memory per member, by the names of
        `rigidmc.engine.kernel.arguments.Workspace`
    host : for one thread of this CPU, as tests run it
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
        variable.linkage = "internal"  # Numba's, unused
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


def machine_for(capability: tuple[int, int]) -> llvm.TargetMachine:
    """Return LLVM's target machine for GPUs of a compute capability."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    return target.create_target_machine(cpu="sm_{}{}".format(*capability), opt=3)


def ptx_of(module: llvm.ModuleRef, capability: tuple[int, int]) -> str:
    """Return the PTX of a module for GPUs of a compute capability or a later one."""
    machine = machine_for(capability)
    # llvmlite has no name for the calling convention of kernels, so it is written into the text.
    text = str(module).replace(f"define void @{KERNEL}(", f"define ptx_kernel void @{KERNEL}(")
    optimised = optimise(llvm.parse_assembly(text), machine)
    lacking = [f.name for f in optimised.functions if f.is_declaration and not _HAS.match(f.name)]
    if lacking:
        names = ", ".join(_plain(name) for name in lacking)
        rule = f"calls {names}, which GPUs do not have: use functions of rigidmc instead"
        raise OptionError(f"custom code {rule}", at="device", value="cuda")
    return str(machine.emit_assembly(optimised))


def _plain(name: str) -> str:
    """Return the Python name of an LLVM function."""
    return name.removeprefix("llvm.").partition(".")[0]
