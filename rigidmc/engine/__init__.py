"""From types to machine code, and from machine code to millions of members.

The choices in a scene before its first step decide the code that moves its members: the integrator,
the effects, the saved variables. Each choice is a class of NamedTuples, and code is compiled for
the classes. The mass of a body and its spin are numbers that the code reads from memory; so the
same code serves all scenes of one kind, all members, and the next process.

Four subpackages, each with its own guide:

compiler   from a plain function and a tree of types to machine code in memory and on disk
kernel     the compiled functions: members gathered, stepped, monitored, assessed, saved, scattered
cuda       the same kernels as the code of one thread of a GPU
wasm       the same kernels as a module for a browser

and these files:

program_spec     ProgramSpec: the choices in a scene that decide its code
program          Program: the compiled kernels of a scene and their working memory
linked           the kernels of a program as one function without Python, for GPUs and browsers
formulas         plain functions over arrays of millions of elements, compiled the same way
inspection       LLVM code of a custom class: operations, memory, whether it runs on vectors
compile_helper   some kernels compiled by a second process, so that the first run begins earlier
compile_time     an announcement before compilation, with its expected time
threads          blocks on threads: each call of a kernel is short
streams          random numbers as a function of (seed, name, member)
machine          the widest vectors and the cores of this machine

Vocabulary: a block is a table of members, one column each. A lane is the place of a member in a
vector; a kernel works on one member per lane at the same time. A stop is the next step after which
members are assessed, saved or left. A round is an interval of time that each member divides into
its own number of steps, if members have different steps; a slot is a place for a step in it. A
trace is the states after the last steps, a node a state within a step. The stepping form is the
form of q and L that an integrator keeps between steps. Works are the energies that effects brought.
A flag is ON or OFF, and a type.

The life of a block of some thousand members:

1. `rigidmc.planning` fills its rows with starts, bodies and parameters of effects.
2. `Program` finds or compiles the kernels, each by its KernelKey.
3. `Program.through` calls `advance` repeatedly, for 10 to 60 ms each: between two calls a run can
   be stopped, kept or shown.
4. `advance` takes as many members at a time as fill the vectors of the CPU (`run_lanes`).
5. `gather` copies their rows side by side; at step 0 `initialise` records energy and momentum.
6. `march` makes the steps up to the next stop, in registers. The integrator's `step` is inlined
   there; it is not a separate kernel.
7. `monitor_steps` goes through their trace: events, extrema, means.
8. `assess`, every 64 steps and at each save, measures drifts, and resets a failed member to its
   last good state. That member keeps stepping with the others, and each assessment resets it.
9. `record` writes the saved variables.
10. `refine_events` at the end of the run finds the times of events; `scatter` copies the rows back.

Invariants:

- A member's bits are a function of scene, seed and index. They do not depend on the number of
  lanes, threads, blocks, calls or saves, on the CPU, or on other compiled code.
- So one rule decides which product is fused with a sum (`rigidmc.engine.compiler.fma`), no
  fast-math flag is set, and no function of a mathematical library is called.
- One source serves all: uncompiled Python, every vector width, both precisions, GPUs, browsers.
"""
