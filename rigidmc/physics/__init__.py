"""One body in plain floats: what acts on it, how a step is made, what is observed.

All of it is functions of floats and small tuples, which return such and do nothing else. They run
in Python as they stand, on floats or on arrays, and `rigidmc.engine` compiles the same source for
vectors of members and for GPUs. A part (an effect, an integrator, an observable) is a NamedTuple:
its fields are its numbers, its class decides the code. Its methods name what they depend on, and
are given nothing else, so that the engine knows it too: `torque(self, body, q)` depends on body and
attitude; with no `q` in sight the attitude need not be followed.

dynamics      the mechanics, and the conventions
  methods           how methods say what they depend on; the flags ON and OFF
  vectors, quaternions, functions   algebra and analysis in straight code; `so3` has all their names
  euler             Euler's equations
  free_flow, arc    the exact motion of a free body over a step
  principal_axes    axes of a tensor
effects       what acts on a body; begin with `gravity`, then `protocol` and `sums`
integrators   how a step is made; begin with `rk8` and `protocol`, then `rk4`, `splitting`,
              `compositions`
observables   what is saved or monitored; begin with `state` and `flips`, then `protocol`

Bodies are seen in their principal axes. L is the angular momentum there [kg m^2/s], q the attitude,
a unit quaternion from body to space, scalar first; units are SI.

What must never change:

- No branch on a number, no loop whose length depends on one, no allocation, no exception: members
  share one instruction stream. `select` has both sides computed.
- No function of a library but the square root: others differ from machine to machine.
- The order of operations, which is in the recorded bits.
- A layer imports only those below: integrators | observables, effects, dynamics.
"""
