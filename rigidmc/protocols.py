"""Building blocks of custom effects, observables, integrators and distributions.

- An effect is a NamedTuple with `torque`; `effect` sets its properties, `Effect` lists its methods.
- An observable is a NamedTuple with `value` (decorator `observable`), `level` (`event`), or `begin`
  and `update` (`running`); `Observable`, `Event` and `Running` list properties and methods.
- An integrator is a NamedTuple with `step` and its properties, see `Integrator`.
- A vector distribution is a frozen dataclass, a subclass of `VectorDistribution`; `sample`,
  `number` and `numbers` help to write it.
- Flags are ON or OFF; `flag(condition)` makes one.

Compiled methods may use plain arithmetic, functions of `math`, the functions below, and functions
in your own file that use only these. docs/how_to/own_parts.md has an example of each kind.
"""

from typing import TYPE_CHECKING

from rigidmc.physics.dynamics.body_axes import described, described_attitude
from rigidmc.physics.dynamics.euler import angular_velocity, scaled
from rigidmc.physics.dynamics.methods import OFF, ON, flag
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
    logical_not,
    maximum,
    minimum,
    multiply,
    normalised,
    root,
    scale,
    select,
    select_all,
    sincos,
    spin,
    symmetric_times,
    vertical,
)
from rigidmc.physics.effects.protocol import Effect, Number, Vector, effect
from rigidmc.physics.effects.sums import state_rates
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.integrators.rk8 import linear_combination
from rigidmc.physics.observables.protocol import (
    Event,
    EventRecord,
    Observable,
    Running,
    event,
    observable,
    running,
)
from rigidmc.scene.quantities import draw as sample
from rigidmc.scene.vector_distributions.protocol import VectorDistribution, number, numbers

__all__ = [
    "OFF", "ON", "Effect", "Event", "EventRecord", "Integrator", "Number", "Observable", "Running",
    "Vector", "VectorDistribution", "add", "angular_velocity", "arctan2", "axpy", "axpy4",
    "conjugate", "cross", "described", "described_attitude", "difference", "dot", "effect", "event",
    "exponential", "flag", "into_body", "linear_combination", "logical_not", "maximum", "minimum",
    "multiply", "normalised", "number", "numbers", "observable", "root", "running", "sample",
    "scale", "scaled", "select", "select_all", "sincos", "spin", "state_rates", "symmetric_times",
    "vertical",
]  # fmt: skip

# {earlier name: current name}, until 1.0
_OLD = {
    "Law": "VectorDistribution",
    "Record": "EventRecord",
    "changes": "state_rates",
    "combined": "linear_combination",
    "draw": "sample",
    "larger": "maximum",
    "opposite": "logical_not",
    "select_each": "select_all",
    "smaller": "minimum",
    "up": "vertical",
}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> None:
        if name in _OLD:
            # with an AttributeError, `from rigidmc.protocols import up` would lose the message
            raise ImportError(f"rigidmc.protocols.{name} is now called {_OLD[name]}")
        raise AttributeError(f"module 'rigidmc.protocols' has no attribute '{name}'")
