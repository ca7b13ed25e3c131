"""Members on GPUs: a thread takes a member through the code that a CPU runs.

The kernels of a program are compiled for one member (one lane), linked with `run_lanes`, which
calls them, into one kernel, and turned into PTX by LLVM. There is no second source of any physics,
and no toolkit of CUDA is needed: only the driver and
its Python bindings.

code      from kernels to PTX
devices   the driver's functions, devices, streams; the words cpu, cuda, auto
program   CudaProgram: a Program whose blocks lie on devices

What must never change: a member has the bits that it has on a CPU. PTX therefore gets the fused
operations that the rule of `rigidmc.engine.compiler.fma` makes, divisions and roots rounded as
IEEE 754 asks, and no function of a library; `ptx_of` refuses code that calls any.
"""
