"""One body in plain floats: the effects on it, the steps, the observables.

All of it is functions that take floats and small tuples and return the same, with no side effects.
They run in Python as they stand, on floats or on arrays, and `rigidmc.engine` compiles the same
source for vectors of members and for GPUs. An effect, an integrator or an observable is a
NamedTuple: its fields are its parameters, its class decides the code. Its methods name the
arguments they depend on and receive no others, so the engine knows the dependencies, too:
`torque(self, body, q)` depends on body and attitude; a scene in which nothing names `q` can skip
the attitude.

dynamics      mechanics and conventions
  methods           how methods name their dependencies; the flags ON and OFF
  vectors, quaternions, functions   algebra and analysis in straight-line code; `so3` has all names
  euler             Euler's equations
  free_flow, arc    the exact motion of a free body over a step
  rotation_flows    the same by rotations, if two moments are equal, or to order 2
  principal_axes    axes of a tensor
  body_axes         from the principal axes to the axes in which the body is described
effects       torques, damping, noise; begin with `gravity`, then `protocol` and `sums`
integrators   methods of stepping; begin with `rk8` and `protocol`, then `rk4`, `splitting`,
              `compositions`
observables   saved or monitored quantities; begin with `state` and `flips`, then `protocol`

Vectors of the body are in its principal axes; `body_axes` transforms what users see. L is the
angular momentum in the principal axes [kg m^2/s], q the
attitude, a unit quaternion from body to space, scalar first; units are SI.

Invariants of this code:

- No branch on a number, no loop whose length depends on one, no allocation, no exception: members
  share one instruction stream. `select` computes both sides.
- No library function except the square root: others differ from machine to machine.
- The order of operations is fixed: recorded bits depend on it.
- A layer imports only from the layers after it: integrators | observables, effects, dynamics.
"""
