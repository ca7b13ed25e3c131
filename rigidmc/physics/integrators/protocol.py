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

from rigidmc.physics.dynamics.methods import argument_names, arguments, implements, method


class Integrator(Protocol):
    """What a scene names as its integrator: facts, and how to get the program of a step.

    Facts that each states::

        order : of the error in the step, inf if there is none but rounding
        evaluations : of the torque in a step
        is_reversible : whether steps of -h undo steps of h
        conserves : what is conserved of a free body, of "|q|", "|L|^2", "T" and "L in space", to
            rounding at any step; a step that normalises q restores |q|, and does not conserve it
        accepts : which torques, in words
        compensated : whether its sums can keep their remainders

    Facts with a default, here::

        is_splitting : whether it alternates free motion with kicks
        slips : whether it turns the body by the `slip` of effects too
        gradient : coefficient of the force gradient, of h^2
        max_turn : angle by which a step may turn a body [rad]; None: by less than pi
        min_spin, max_spin : angles per step [rad] between which `scheme` follows the spin
        text : docstring of one integrator, if its class makes several

    The program of a step is a NamedTuple with the methods below (`step`, ...). It is the integrator
    itself, or comes from a method that names what it depends on::

        scheme(self, [turns, effects]) -> StepScheme
            turns : TurnBounds, by how much a step turns;  effects : of the scene

    A program whose sums keep no remainders has `with_compensation(self)`, which gives one whose
    sums do. A program with `extra_state` compensates its rounding itself, with or without
    compensated sums.
    """

    order: float
    evaluations: int
    is_reversible: bool
    conserves: tuple[str, ...]
    accepts: str
    compensated: bool
    is_splitting: bool = False
    slips: bool = False
    gradient: float = 0.0
    max_turn: float | None = None
    min_spin: float = 0.0
    max_spin: float = inf
    text: str = ""


# Methods and facts of earlier versions, and what they are called now; until 1.0.
OLD_WORDS = {
    "opened": "to_stepping",
    "closed": "from_stepping",
    "keeps": "extra_state",
    "constants": "precompute",
    "prepared": "scheme",
    "form": "scheme",
    "with_sums": "with_compensation",
    "group_count": "interleaving",
    "reversible": "is_reversible",
    "splitting": "is_splitting",
    "largest_turn": "max_turn",
    "least_spin": "min_spin",
    "largest_spin": "max_spin",
}
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
def interleaving(integrator):
    """In how many groups the members of a vector make their steps, one group after the other.

    A stage waits for the stage before; with 2 groups the CPU works on the other meanwhile.
    """
    return 1


@method
def extra_state(integrator):
    """What the state keeps behind L, beside remainders of sums: `static_count` of 7, or of 0."""
    return ()


@method
def precompute(integrator, body, substep, l):
    """What is the same in all steps of a member; l ends with what `extra_state` asks for."""
    return ()


@method
def step(integrator, body, effects, t, h, substep, q, l, constants):
    """(q, L) after one part of a step h.

    t : time of the torque of this part [s]
    substep : (drift, kick, gradient), the times of the part [s, s, s^2]
    """
    return q, l


@method
def to_stepping(integrator, body, effects, t, substep, q, l):
    """(q, L) in the form in which it is kept between steps: for splittings `substep` further on."""
    return q, l


@method
def from_stepping(integrator, body, effects, t, substep, q, l):
    """(q, L) from the form in which it is kept between steps; undoes `to_stepping`."""
    return q, l


class PlainState(NamedTuple):
    """Stands for every program that keeps (q, L) between steps as they are."""


def has_extra_state(integrator: Any) -> bool:
    """Whether a program keeps more of a state than (q, L), so that compensated sums add nothing."""
    return implements(integrator, "extra_state")


def stepping_form(integrator: Any) -> Any:
    """What says in which form a program keeps (q, L) between steps: the program, or PlainState.

    What is compiled for PlainState serves most integrators.
    """
    return integrator if changes_state_form(integrator) else PlainState()


def changes_state_form(integrator: Any) -> bool:
    """Whether a program keeps (q, L) between steps in a form of its own."""
    return any(
        implements(integrator, verb) for verb in ("extra_state", "to_stepping", "from_stepping")
    )


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
    integrator: Any, turns: TurnBounds | None = None, effects: Sequence[Any] = ()
) -> StepScheme:
    """The StepScheme of an integrator of INTEGRATORS for steps that turn by `turns`."""
    if not implements(integrator, "scheme"):
        return StepScheme(integrator, np.array(ONE_SUBSTEP))
    known = {"turns": turns or TurnBounds(), "effects": effects}
    scheme: StepScheme = integrator.scheme(
        *(known[name] for name in arguments(type(integrator).scheme))
    )
    return scheme


def follows_turns(integrator: Any) -> bool:
    """Whether the scheme of an integrator depends on the angle by which a step turns a body."""
    return "turns" in argument_names(integrator, "scheme")
