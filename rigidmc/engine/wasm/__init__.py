"""Members in WebAssembly, for pages and for tests.

fused    the fused multiply-add, which WebAssembly lacks
module   from kernels to a module
program  WasmProgram: the memory of a block, moved in a page or in a runtime in Python

Invariant: a member has the same bits as on a CPU.
"""
