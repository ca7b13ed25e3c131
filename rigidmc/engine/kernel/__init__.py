"""What is compiled: the life of members, as kernels and the loop that calls them.

Every function here is plain Python on numbers and rows, and runs uncompiled. Compiled, a number is
a vector with one number of each of several members (`rigidmc.engine.compiler`), so there is no
branch on a member's number: both sides are computed and `select` chooses, or `any_of` asks whether
any member needs what follows. What a scene has or has not is a flag, ON or OFF, and is asked for by
`if len(flag) == 0`, which leaves nothing behind in the code. `0.0 * x` is a zero with the type of
x.

A whole run, in the order in which to read it:

rigidmc.engine                     the guide: the life of a block in ten lines, and the words
rigidmc.physics.integrators.rk4    a step: what all the rest is there for, with `protocol` beside it
arguments     the record with which the loop over members is called
layout        which row of memory holds which number
member        gather, initialise, assess, record, scatter
march         the steps, in registers; here nearly all time is spent
block         the loop: when what is called

What is monitored over all steps, with no trajectory kept (`rigidmc.physics.observables.protocol`
tells what an event is, and when it is armed):

dense_output  the state within a step
events        whether something happened in a step, and when
monitoring    events and running observables, step by step and node by node
extrema       extrema between two nodes
shadow        a shadow trajectory: how fast neighbours part

and what few runs need:

noise           normal deviates as a function of seed, stream, member and step
last_interval   a last interval whose steps have another length

What must never change:

- Steps do not depend on what is saved or monitored: `march` knows of neither.
- Recursion over a tuple ends with the empty one; `inline_all` is the last line of each file.
- Each row has a name in `layout`. A new number of a member is a new row there.
- The order of operations is the order written here: it is in the recorded bits.
"""
