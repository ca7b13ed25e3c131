"""How a kernel is compiled.

A kernel is a plain function, compiled by the types of a StaticTree, and called by its address with
rows and plain numbers, or with one record. Row i holds number i of several members, and is one
vector in compiled code. In full::

    def kernel(tree, numbers, ...):
        integrator, effects = tree_unpack(tree, numbers)

`tree` stands for nested NamedTuples: the integrator, the effects, the events and flags of a scene.
Compiled code knows their types and nothing else. It reads the numbers of integrator, limits, events
and observables from the flat memory `numbers`; body and effects differ from member to member, and
it reads their numbers from rows. All kernels with one task, such as all `march`, thus have the same
machine signature, whatever the scene, and the loop over members (`rigidmc.engine.kernel.block`) is
compiled once, for all scenes and all users' parts: it finds each kernel by its address in a record.

RK4 and gravity, for example: `Program` makes KernelKey(march, (RK4, (Gravity,), flags ...),
"float64", 8 lanes); its types are the signature; no address and no file is known by it, so Numba
lowers `march` and all that it calls, `fuse` marks the products, the whole is inlined and optimised
once, and the machine code goes to a file named by a hash. The record of the loop gets its address.
Gravity on the Moon has the same types: nothing is compiled.

The files, in the order in which to read them; `disk_cache` to `numba_extensions` can wait:

kernels            KernelKey, `compile_kernel`, and calls of a kernel from Python and from another
trees              StaticTree: nested NamedTuples as types, their numbers from memory or from rows
compose            plain functions and methods of NamedTuples, called by the types of arguments and
                   inlined; a tuple of effects is unrolled by recursion on its type
vector_types       one number of each of several members as one vector: float64x16, and masks
intrinsics         functions with code of their own: a choice by a mask, another precision
memory             rows of vectors as a type; uncompiled they are arrays
pipeline           how Numba's passes are run, and when code is inlined and optimised: once, in the
                   kernel
lean_passes        Numba's passes without what these functions do not need
inlined            an inlined function, compiled for the types of a call
fma                the one rule by which products are fused with sums
disk_cache         kernels kept on disk, named by a hash of everything that they follow from
user_stamps        that hash for a class of a user's own
numba_extensions   whether another package has changed what Numba compiles

What must never change:

- No number is a literal in one kernel and computed in another: LLVM might fold the literal with
  another rounding.
- The rule of `fma` holds within one plain function, before anything is inlined. Where a product is
  written (in a helper, or beside its sum) therefore decides bits.
- What a kernel follows from is in the name of its file on disk; else a result would be stale.
"""
