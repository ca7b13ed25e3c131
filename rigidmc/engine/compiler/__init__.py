"""Compilation of kernels.

A kernel is a plain function, compiled by the types of a StaticTree, and called by its address with
rows and plain numbers, or with one record. Row i holds number i of several members; in compiled
code it is one vector. In full::

    def kernel(tree, numbers, ...):
        integrator, effects = tree_unpack(tree, numbers)

`tree` stands for nested NamedTuples: the integrator, the effects, the events and flags of a scene.
Compiled code knows only their types. It reads the numbers of integrator, limits, events and
observables from the flat memory `numbers`. Body and effects differ from member to member: it reads
their numbers from rows. All kernels with one task, such as all `march`, thus have the same machine
signature, whatever the scene. So the loop over members (`rigidmc.engine.kernel.block`) is compiled
once, for all scenes and all custom classes: it finds each kernel by its address in a record.

Example, RK4 and gravity: `Program` makes KernelKey(march, (RK4, (Gravity,), flags ...), "float64",
8 lanes). Its types are the signature. If neither memory nor disk has code for it, Numba lowers
`march` and all functions it calls, `fuse` fuses products, and the whole is inlined and optimised
once. This LLVM code and the machine code made from it go to two files named by hashes: another
processor needs the second only. The record of the loop gets the address. Gravity on the Moon has
the same types: nothing is compiled.

The files, in reading order; `machine_code` to `numba_extensions` can wait:

kernels            KernelKey, `compile_kernel`, and calls of a kernel from Python and from another
trees              StaticTree: nested NamedTuples as types, their numbers from memory or from rows
compose            plain functions and methods of NamedTuples, called by the types of arguments and
                   inlined; a tuple of effects is unrolled by recursion on its type
vector_types       one number from each of several members as one vector: float64x16, and masks
intrinsics         functions with special code: a choice by a mask, another precision
math_functions     the functions of `math` that custom code may call
memory             rows of vectors as a type; uncompiled they are arrays
lowering           a function of the package from bytecode to LLVM code, by Numba's steps
pipeline           lowers a custom function, by Numba's own pipeline
libraries          when code is inlined and optimised: once, in the kernel
fma                the one rule that decides which products are fused with sums
machine_code       from a kernel to LLVM code, machine code and its address
disk_cache         code on disk, named by a hash of all its inputs
source_stamps      that hash for modules of the package
user_stamps        that hash for a custom class
frozen             copies of custom classes, which are what Numba sees: a user may change a class
contents           what custom classes read, for another process to compare
uncompilable       which construct of a custom class cannot be compiled, and what to write instead
numba_extensions   whether another package has changed how Numba compiles

Invariants:

- No number is a literal in one kernel and computed in another: LLVM might fold the literal with
  another rounding.
- The rule of `fma` holds within one plain function, before anything is inlined. Whether a product
  is written in a helper or next to its sum therefore decides bits.
- The file name of a kernel on disk contains all its inputs; otherwise a result could be stale.
"""
