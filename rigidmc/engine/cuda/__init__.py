"""Members on GPUs: one thread takes a member through the same code as a CPU.

The kernels of a program are compiled for one member (one lane) and linked with `run_lanes`, which
calls them, into one kernel; LLVM turns it into PTX. All physics has one source, and no CUDA toolkit
is needed: only the driver and its Python bindings.

code      from kernels to PTX
devices   the driver's functions, devices, streams; the words cpu, cuda, auto
program   CudaProgram: a Program whose blocks are on GPUs

Invariant: a member has the same bits as on a CPU. PTX therefore gets the fused operations chosen by
the rule of `rigidmc.engine.compiler.fma`, divisions and roots rounded as IEEE 754 requires, and no
library function; `ptx_of` rejects code that calls one.
"""
