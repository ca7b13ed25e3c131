"""What a part of your own is made of: decorators, protocols, and the functions it may call.

- An effect is a NamedTuple with `torque`; `effect` states its facts, `Effect` lists its methods.
- An observable is a NamedTuple with `value` (decorator `observable`), `level` (`event`), or `begin`
  and `update` (`running`); `Observable`, `Event` and `Running` list facts and methods.
- An integrator is a NamedTuple with `step` and its facts, see `Integrator`.
- A law is a frozen dataclass, a subclass of `Law`; `draw`, `number` and `numbers` serve it.

Compiled methods are plain arithmetic, functions of `math`, the functions below, and functions of
your own file that are made of the same. docs/how_to/own_parts.md has one part of each kind.
"""

from rigidmc.physics.dynamics.euler import scaled
from rigidmc.physics.dynamics.so3 import (
    add,
    arctan2,
    axpy,
    axpy4,
    conjugate,
    cross,
    difference,
    dot,
    exponential,
    into_body,
    larger,
    multiply,
    normalised,
    opposite,
    scale,
    select,
    select_each,
    sincos,
    smaller,
    spin,
    up,
)
from rigidmc.physics.effects.protocol import Effect, Number, Vector, effect
from rigidmc.physics.effects.sums import changes
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.integrators.rk8 import combined
from rigidmc.physics.observables.protocol import (
    Event,
    Observable,
    Record,
    Running,
    event,
    observable,
    running,
)
from rigidmc.scene.quantities import draw
from rigidmc.scene.vector_distributions.protocol import Law, number, numbers

__all__ = [
    "Effect",
    "Event",
    "Integrator",
    "Law",
    "Number",
    "Observable",
    "Record",
    "Running",
    "Vector",
    "add",
    "arctan2",
    "axpy",
    "axpy4",
    "changes",
    "combined",
    "conjugate",
    "cross",
    "difference",
    "dot",
    "draw",
    "effect",
    "event",
    "exponential",
    "into_body",
    "larger",
    "multiply",
    "normalised",
    "number",
    "numbers",
    "observable",
    "opposite",
    "running",
    "scale",
    "scaled",
    "select",
    "select_each",
    "sincos",
    "smaller",
    "spin",
    "up",
]
