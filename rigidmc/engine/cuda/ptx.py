"""GPU code: one thread takes one member through the run.

LLVM turns the linked kernels of a program, see `rigidmc.engine.linked`, into PTX, which the driver
loads.
"""

import re

import llvmlite.binding as llvm

from rigidmc.engine.linked import KERNEL, optimise, refuse_calls, target_machine

TRIPLE = "nvptx64-nvidia-cuda"
# Intrinsic functions that LLVM provides for a GPU, or for every target
_HAS = re.compile(
    r"llvm\.(nvvm|fma|fabs|sqrt|copysign|floor|ceil|trunc|rint|round|min|max|mem|lifetime|assume"
    r"|experimental\.noalias|[us](add|sub|mul|min|max)|abs|ct|bswap|fsh|vector|fptosi\.sat)"
)
# The index of a thread in a launch.
THREAD = """
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


def machine_for(capability: tuple[int, int]) -> llvm.TargetMachine:
    """Return LLVM's target machine for GPUs of a compute capability."""
    return target_machine(TRIPLE, cpu="sm_{}{}".format(*capability))


def ptx_of(module: llvm.ModuleRef, capability: tuple[int, int]) -> str:
    """Return the PTX of a module for GPUs of a compute capability or a later one."""
    machine = machine_for(capability)
    # llvmlite has no name for the calling convention of kernels, so it is written into the text.
    text = str(module).replace(f"define void @{KERNEL}(", f"define ptx_kernel void @{KERNEL}(")
    optimised = optimise(llvm.parse_assembly(text), machine)
    lacking = [f.name for f in optimised.functions if f.is_declaration and not _HAS.match(f.name)]
    refuse_calls([_plain(name) for name in lacking], "GPUs do", "cuda")
    return str(machine.emit_assembly(optimised))


def _plain(name: str) -> str:
    """Return the Python name of an LLVM function."""
    return name.removeprefix("llvm.").partition(".")[0]
