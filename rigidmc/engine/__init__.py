"""From types to machine code, and from machine code to millions of members.

What is known of a scene before its first step decides what code moves it: which integrator, which
effects, what is saved. Each choice is a class of NamedTuples, and code is compiled for the classes.
How heavy a body is and how fast it spins are numbers, which the code reads from memory; so the same
code serves all scenes of one kind, all members, and the next process.

Three sub-rooms, each with a guide of its own:

compiler   from a plain function and a tree of types to machine code in memory and on disk
kernel     what is compiled: members gathered, stepped, monitored, assessed, saved, scattered
cuda       the same kernels as the code of one thread of a GPU

and the files beside them:

program          Program: the kernels of a scene, compiled, and the memory that they work in
formulas         plain functions over arrays of millions of elements, compiled the same way
inspection       what LLVM's code of a part shows: operations, memory, whether it runs on vectors
compile_helper   some kernels compiled by a second process, so that the first run begins earlier
compile_time     what is compiled is said before it begins, with how long it takes
threads          blocks on threads: no call of a kernel is longer than a blink
streams          random numbers as a function of (seed, name, member)
machine          the widest vectors and the cores of this machine

The words: a block is a table of members, a column for each. A lane is the place of a member in a
vector, and as many members as there are lanes are worked on side by side. A stop is the next step
after which members are assessed, saved or left. A round is a stretch of time that each member
divides into a number of steps of its own, if they have such, and a slot a place for a step in it. A
trace is the states after the last steps, and a node a state within a step. The stepping form is the
form in which an integrator has q and L between steps. Works are the energies that effects brought.
A flag is ON or OFF, and a type.

The life of a block of some thousand members:

1. `rigidmc.planning` fills its rows with starts, bodies and parameters of effects.
2. `Program` finds or compiles the kernels, each by its KernelKey.
3. `Program.through` calls `advance` again and again, for 10 to 60 ms each: between two calls a run
   can be stopped, kept, or shown.
4. `advance` takes as many members at a time as fill the vectors of the CPU (`run_lanes`).
5. `gather` copies their rows side by side; at step 0 `initialise` notes energy and momentum.
6. `march` makes the steps up to the next stop, in registers. The integrator's `step` is no kernel
   of its own: it is inlined there.
7. `monitor_steps` goes through their trace: events, extrema, means.
8. `assess`, every 64 steps and at each save, measures drifts, and puts a member that has gone wrong
   back to its last good state. It steps on beside the others, and each assessment puts it back.
9. `record` writes what is saved.
10. `refine_events` at the end of the run finds the times of events; `scatter` copies the rows back.

What must never change:

- A member's bits are a function of scene, seed and index. They depend on no number of lanes,
  threads, blocks, calls or saves, on no processor, and on nothing else that is compiled.
- So one rule says which product is fused with a sum (`rigidmc.engine.compiler.fma`), no flag of
  fast arithmetic is set, and no function of a mathematical library is called.
- One source serves all: uncompiled Python, every width, both precisions, and the GPU.
"""
