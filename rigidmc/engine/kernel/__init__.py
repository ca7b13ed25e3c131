"""The life of members, as compiled kernels and the loop that calls them.

Every function here is plain Python on numbers and rows, and runs uncompiled. Compiled, a number is
a vector with one number from each of several members (`rigidmc.engine.compiler`), so there is no
branch on a member's number: both sides are computed and `select` chooses, or `any_of` tests whether
any member needs the next part. Options of a scene are flags, ON or OFF, tested by
`if len(flag) == 0`, which leaves nothing in the code. `0.0 * x` is a zero of the type of x.

A whole run, in reading order:

rigidmc.engine                     the guide: the life of a block in ten lines, and the vocabulary
rigidmc.physics.integrators.rk4    a step, which everything else serves; read it with `protocol`
arguments     the record of arguments of the loop over members
layout        the position of each number in memory
member        gather, initialise, assess, record, scatter
march         the steps, in registers; nearly all time is spent here
block         the loop: the order of all calls
transfer      members copied between the block, the lanes and the saves

Monitoring over all steps, with no trajectory kept (`rigidmc.physics.observables.protocol` defines
events, and when they are armed):

dense_output  the state within a step
events        whether something happened in a step, and when
monitoring    events and running observables, step by step and node by node
extrema       extrema between two nodes
running       states of running observables, and extrema that are searched after the steps
growth        the growth of a tangent: how fast nearby trajectories diverge

and parts that few runs need:

noise           normal deviates as a function of seed, stream, member and step
last_interval   a last interval whose steps have another length

Invariants:

- Steps do not depend on saves or monitors: `march` contains neither.
- Recursion over a tuple ends with the empty one; `inline_all` is the last line of each file.
- Each row has a name in `layout`. A new number of a member is a new row there.
- The order of operations is the order written here: recorded bits depend on it.
"""
