"""What an integrator is: its facts, with their defaults, and what the engine asks of its steps.

What a scene names is not always what is compiled. `scheme_of` makes a StepScheme of an integrator:
the NamedTuple whose type is compiled, one for a whole family of methods, and the substeps of a
step, which are numbers.
"""

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigidmc.physics.dynamics.methods import implements, method


class Integrator(Protocol):
    """What a scene names as its integrator: facts, and how to get the program of a step.

    Facts that each states::

        order : of the error in the step, inf if there is none but rounding
        evaluations : of the torque in a step
        reversible : whether steps of -h undo steps of h
        conserves : what is conserved of a free body, of "|q|", "|L|^2", "T" and "L in space", to
            rounding at any step; a step that normalises q restores |q|, and does not conserve it
        accepts : which torques, in words
        compensated : whether its sums can keep their remainders

    Facts with a default, here::

        splitting : whether it alternates free motion with kicks
        slips : whether it turns the body by the `slip` of effects too
        gradient : coefficient of the force gradient, of h^2
        largest_turn : angle by which a step may turn a body [rad]; None: by less than pi
        least_spin, largest_spin : angles per step [rad] between which `prepared` follows the spin
        text : docstring of one integrator, if its class makes several

    The program of a step is a NamedTuple with the methods below (`step`, ...). It is the integrator
    itself, or comes in a StepScheme from one of these::

        form(self) -> StepScheme
        prepared(self, turns, effects) -> StepScheme    if it depends on the angle of a step

    A program whose sums keep no remainders has `with_sums(self)`, which gives one whose sums do. A
    program with `keeps` compensates its rounding itself, with or without compensated sums.
    """

    order: float
    evaluations: int
    reversible: bool
    conserves: tuple[str, ...]
    accepts: str
    compensated: bool
    splitting: bool = False
    slips: bool = False
    gradient: float = 0.0
    largest_turn: float | None = None
    least_spin: float = 0.0
    largest_spin: float = inf
    text: str = ""


_DEFAULTS = {
    name: vars(Integrator)[name] for name in Integrator.__annotations__ if name in vars(Integrator)
}


def with_defaults(integrator: Any) -> Integrator:
    """An integrator whose class has the default of each fact that it leaves out."""
    for name, value in _DEFAULTS.items():
        if not hasattr(integrator, name):
            # On the class: instances are NamedTuples or frozen dataclasses, which take no
            # attributes.
            setattr(type(integrator), name, value)
    complete: Integrator = integrator
    return complete


@method
def group_count(integrator):
    """In how many groups the members of a vector make their steps, one group after the other.

    A stage waits for the stage before; with 2 groups the CPU works on the other meanwhile.
    """
    return 1


@method
def keeps(integrator):
    """What the state keeps behind L, beside remainders of sums: `static_count` of 7, or of 0."""
    return ()


@method
def constants(integrator, body, part, l):
    """What is the same in all steps of a member; l ends with what `keeps` asks for."""
    return ()


@method
def step(integrator, body, effects, t, h, part, q, l, constants):
    """(q, L) after one part of a step h.

    t : time of the torque of this part [s]
    part : (drift, kick, gradient), the times of the part [s, s, s^2]
    """
    return q, l


@method
def opened(integrator, body, effects, t, part, q, l):
    """(q, L) in the form in which it is kept between steps: for splittings `part` further on."""
    return q, l


@method
def closed(integrator, body, effects, t, part, q, l):
    """(q, L) from the form in which it is kept between steps; undoes `opened`."""
    return q, l


class PlainState(NamedTuple):
    """Stands for every program that keeps (q, L) between steps as they are."""


def has_extra_state(integrator: Any) -> bool:
    """Whether a program keeps more of a state than (q, L), so that compensated sums add nothing."""
    return implements(integrator, "keeps")


def stepping_form(integrator: Any) -> Any:
    """What says in which form a program keeps (q, L) between steps: the program, or PlainState.

    What is compiled for PlainState serves most integrators.
    """
    return integrator if changes_state_form(integrator) else PlainState()


def changes_state_form(integrator: Any) -> bool:
    """Whether a program keeps (q, L) between steps in a form of its own."""
    return any(implements(integrator, verb) for verb in ("keeps", "opened", "closed"))


class TurnBounds(NamedTuple):
    """By how much a step turns the fastest member of a scene [rad].

    free : lambda dt, the angle by which free motion turns L in the body
    spin : |omega| dt
    symmetric : whether all bodies have two equal moments
    """

    free: float = 0.0
    spin: float = 0.0
    symmetric: bool = False


class StepScheme(NamedTuple):
    """An integrator as the engine takes it.

    integrator : the NamedTuple whose type is compiled
    substeps : (1 + n, 4) rows of (drift, kick, gradient, time of the torque) in units of the step;
        row 0 opens the state, the n others are one step
    name : by which a scene asks for it
    """

    integrator: Any
    substeps: NDArray[np.float64]
    name: str = ""


ONE_SUBSTEP = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0))  # a step in one part


def scheme_of(
    kind: Any, turns: TurnBounds | None = None, effects: Sequence[Any] = ()
) -> StepScheme:
    """The StepScheme of an integrator of INTEGRATORS for steps that turn by `turns`."""
    compiled = StepScheme(kind, np.array(ONE_SUBSTEP))
    if implements(kind, "prepared"):
        compiled = kind.prepared(turns or TurnBounds(), effects)
    elif implements(kind, "form"):
        compiled = kind.form()
    return compiled
