"""The protocol of integrators: facts with defaults, and the methods that the engine calls.

The integrator that a scene names is not always the one that is compiled. `scheme_of` makes a
StepScheme of an integrator: the NamedTuple whose type is compiled, one for a whole family of
methods, and the substeps of a step, which are numbers.
"""

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigidmc.physics.dynamics.methods import argument_names, arguments, implements, method


class Integrator(Protocol):
    """An integrator as a scene names it: facts, and a method that returns the program of a step.

    Facts that each integrator states::

        order : of the error in the step, inf if rounding is the only error
        evaluations : of the torque in a step
        is_reversible : whether steps of -h undo steps of h
        conserves : quantities of a free body, of "|q|", "|L|^2", "T" and "L in space", conserved to
            rounding at any step; a step that normalises q restores |q| but does not conserve it
        accepts : which torques, in words
        compensated : whether its sums can keep their remainders

    Facts with a default here::

        is_splitting : whether it alternates free motion with kicks
        slips : whether it also turns the body by the `slip` of effects
        gradient : coefficient of the force gradient, of h^2
        max_turn : angle by which a step may turn a body [rad]; None: by less than pi
        has_many_stages : whether a GPU has registers for one derivative at a time only
        min_spin, max_spin : angles per step [rad] between which `scheme` follows the spin
        is_contender : whether it may be the cheapest; if not, `tolerance` does not try it
        max_tolerance : tolerance above which others are always cheaper
        drifts_like : integrator of the same kind that drifts alike over many steps, "" for none
        text : docstring of one integrator, if its class makes several

    The program of a step is a NamedTuple with the methods below (`step`, ...). It is the integrator
    itself, or comes from a method that names the arguments it depends on::

        scheme(self, [turns, effects]) -> StepScheme
            turns : TurnBounds, bounds on the turn in a step;  effects : of the scene

    A program whose sums keep no remainders has `with_compensation(self)`, which returns one whose
    sums do. A program with `extra_state` compensates its rounding by itself, with or without
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
    has_many_stages: bool = False
    min_spin: float = 0.0
    max_spin: float = inf
    is_contender: bool = True
    max_tolerance: float = inf
    drifts_like: str = ""
    text: str = ""


# Former names of methods and facts, and their present names; until 1.0.
OLD_WORDS = {
    "opened": "to_stepping", "closed": "from_stepping", "keeps": "extra_state",
    "constants": "precompute", "prepared": "scheme", "form": "scheme",
    "with_sums": "with_compensation", "group_count": "interleaving",
    "reversible": "is_reversible", "splitting": "is_splitting", "largest_turn": "max_turn",
    "least_spin": "min_spin", "largest_spin": "max_spin",
}  # fmt: skip
_DEFAULTS = {
    name: vars(Integrator)[name] for name in Integrator.__annotations__ if name in vars(Integrator)
}


def with_defaults(integrator: Any) -> Integrator:
    """Add the default of each missing fact to the class of an integrator, and return it."""
    for name, value in _DEFAULTS.items():
        if not hasattr(integrator, name):
            # Set on the class: instances are NamedTuples or frozen dataclasses, which accept no
            # attributes.
            setattr(type(integrator), name, value)
    complete: Integrator = integrator
    return complete


@method
def interleaving(integrator):
    """Return the number of groups in which members of a vector make their steps, group by group.

    A stage waits for the stage before it; with 2 groups the CPU works on the other one meanwhile.
    """
    return 1


@method
def extra_state(integrator):
    """Return the size of the state after L, besides remainders: `static_count` of 7, or of 0."""
    return ()


@method
def precompute(integrator, body, substep, l):
    """Return constants of all steps of a member; l ends with the numbers of `extra_state`."""
    return ()


@method
def step(integrator, body, effects, t, h, substep, q, l, constants):
    """Return (q, L) after one part of a step h.

    t : time of the torque of this part [s]
    substep : (drift, kick, gradient), the times of the part [s, s, s^2]
    """
    return q, l


@method
def to_stepping(integrator, body, effects, t, substep, q, l):
    """Return (q, L) in the form kept between steps: for splittings, `substep` further on."""
    return q, l


@method
def from_stepping(integrator, body, effects, t, substep, q, l):
    """Return (q, L) from the form kept between steps; undoes `to_stepping`."""
    return q, l


class PlainState(NamedTuple):
    """A stand-in for every program that keeps (q, L) unchanged between steps."""


def has_extra_state(integrator: Any) -> bool:
    """Return whether a program keeps more state than (q, L), so compensated sums add nothing."""
    return implements(integrator, "extra_state")


def stepping_form(integrator: Any) -> Any:
    """Return the type that defines the form of (q, L) between steps: the program, or PlainState.

    Code compiled for PlainState serves most integrators.
    """
    return integrator if changes_state_form(integrator) else PlainState()


def changes_state_form(integrator: Any) -> bool:
    """Return whether a program changes the form of (q, L) between steps."""
    return any(
        implements(integrator, verb) for verb in ("extra_state", "to_stepping", "from_stepping")
    )


class TurnBounds(NamedTuple):
    """Bounds on how far a step turns the fastest member of a scene [rad].

    free : lambda dt, the angle by which free motion turns L in the body
    spin : |omega| dt
    symmetric : whether all bodies have two equal moments
    """

    free: float = 0.0
    spin: float = 0.0
    symmetric: bool = False


class StepScheme(NamedTuple):
    """An integrator in the form that the engine uses.

    integrator : the NamedTuple whose type is compiled
    substeps : (1 + n, 4) rows of (drift, kick, gradient, time of the torque) in units of the step;
        row 0 opens the state, the n others are one step
    name : its name in a scene
    """

    integrator: Any
    substeps: NDArray[np.float64]
    name: str = ""


ONE_SUBSTEP = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0))  # a step in one part


def scheme_of(
    integrator: Any, turns: TurnBounds | None = None, effects: Sequence[Any] = ()
) -> StepScheme:
    """Return the StepScheme of an integrator of INTEGRATORS for steps that turn by `turns`."""
    if not implements(integrator, "scheme"):
        return StepScheme(integrator, np.array(ONE_SUBSTEP))
    known = {"turns": turns or TurnBounds(), "effects": effects}
    scheme: StepScheme = integrator.scheme(
        *(known[name] for name in arguments(type(integrator).scheme))
    )
    return scheme


def follows_turns(integrator: Any) -> bool:
    """Return whether the scheme of an integrator depends on the turn of a body in a step."""
    return "turns" in argument_names(integrator, "scheme")
