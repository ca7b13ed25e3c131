"""Integrators. A new integrator is one file in this folder and one name in `_FILES` below.

`rigidmc.physics.integrators.protocol` defines the facts and methods of an integrator;
docs/contributing.md explains how to add one.
"""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from math import inf
from typing import Any

from rigidmc.physics.dynamics.methods import argument_names, implements
from rigidmc.physics.effects import name_of
from rigidmc.physics.effects.protocol import depends_on_momentum, has_state, is_random
from rigidmc.physics.integrators.closed_form import ClosedForm
from rigidmc.physics.integrators.protocol import (
    Integrator,
    StepScheme,
    TurnBounds,
    scheme_of,
    with_defaults,
)

__all__ = [
    "INTEGRATORS", "StepScheme", "TurnBounds", "integrators_for", "keeps_remainders", "refusal",
    "scheme_of",
]  # fmt: skip

# Each file has a dict INTEGRATORS of its integrators. Lists and legends use this order.
_FILES = (
    "rk4", "rk8", "gbs12", "lie", "midpoint", "compositions", "free_motion", "closed_form",
)  # fmt: skip
INTEGRATORS: dict[str, Integrator] = {
    name: with_defaults(integrator)
    for file in _FILES
    for name, integrator in import_module(f"rigidmc.physics.integrators.{file}").INTEGRATORS.items()
}


def description(integrator: Integrator) -> str:
    """Return the description of an integrator: what it is for, and its source."""
    return integrator.text or integrator.__doc__ or ""


def refusal(
    name: str,
    effects: Sequence[Any],
    compensated: bool = False,
    works: bool = False,
    known: Mapping[str, Integrator] = INTEGRATORS,
) -> str | None:
    """Return why an integrator does not accept these effects, and the nearest that do; else None.

    compensated : whether sums should keep their remainders
    works : whether the works of the effects should be saved
    known : the integrators of the scene by name

    Whether `closed` covers a body also depends on its moments, see `rigidmc.planning.closed_form`.
    """
    why = _refusal(known[name], effects, compensated, works)
    if why is None:
        return None
    able = [
        other
        for other in integrators_for(effects, compensated, works, known)
        if not isinstance(known[other], ClosedForm)
    ]
    # The nearest first, by order and then family: two names are enough.
    able.sort(key=lambda other: _distance(known[name], known[other]))
    return f"{why}; use {' or '.join(able[:2])}" if able else why


def _distance(integrator: Integrator, other: Integrator) -> tuple[float, bool]:
    """Return the distance between two integrators: by order, then by family."""
    if integrator.order == other.order:
        distance = 0.0
    else:
        distance = abs(integrator.order - other.order) if integrator.order < inf else -other.order
    return distance, integrator.is_splitting != other.is_splitting


def integrators_for(
    effects: Sequence[Any],
    compensated: bool = False,
    works: bool = False,
    integrators: Mapping[str, Integrator] = INTEGRATORS,
) -> list[str]:
    """Return the names of the integrators that accept these effects; options as in `refusal`."""
    return [
        name
        for name, integrator in integrators.items()
        if _refusal(integrator, effects, compensated, works) is None
    ]


def keeps_remainders(
    integrator: Integrator, effects: Sequence[Any], dtype: str, compensated: bool = False
) -> bool:
    """Return whether sums keep their remainders: on request, and in float32 whenever possible.

    A short step changes a state by few units in the last place, and many successive steps round the
    same way. Without remainders an error in float32 grows about as fast as the number of steps or
    faster (rk4: 2e-4 after 10 s in 32,000 steps, 0.01 in 512,000). With them it does not grow
    (6e-7; tests/physics/integrators/test_precision.py).
    """
    return compensated or (
        dtype == "float32" and _refusal(integrator, effects, True, False) is None
    )


def _refusal(
    integrator: Integrator, effects: Sequence[Any], compensated: bool, works: bool
) -> str | None:
    makes_steps = implements(integrator, "scheme") or implements(integrator, "step")
    if works and (compensated or integrator.gradient or not makes_steps):
        by = "with compensated sums" if compensated else "with it"
        return f"the work of effects cannot be saved {by}"
    if compensated and not integrator.compensated:
        return "it has no sums to compensate"
    moving = [e for e in effects if has_state(e)]
    if moving and (compensated or not makes_steps):
        by = "with compensated sums" if compensated else "by it"
        return f"the state of {_names(moving)} cannot be followed {by}"
    noisy = [e for e in effects if is_random(e)]
    if moving and noisy:
        return f"the state of {_names(moving)} cannot be followed beside {_names(noisy)}"
    if noisy and not (integrator.is_splitting and integrator.order == 2):
        return f"{_names(noisy)} is random and needs a splitting of order 2"
    if noisy and compensated:
        return f"its sums cannot be compensated with {_names(noisy)}, which acts on L as a whole"
    slipping = [e for e in effects if implements(e, "slip")]
    if slipping and not integrator.slips:
        return f"it turns the body by I^-1 L only, but {_names(slipping)} has moving parts"
    if not effects or integrator.accepts == "any torque":
        return None
    if integrator.accepts == "no torque":
        what = "it is the motion of a free body and takes no torque"
        return f"{what}, but the scene has {_names(effects)}"
    if isinstance(integrator, ClosedForm):
        unknown = [e for e in effects if name_of(e) not in ("gravity", "viscous_damping")]
        return f"no closed form covers {_names(unknown)}" if unknown else None
    return _unsplit(integrator, effects, compensated)


def _unsplit(integrator: Integrator, effects: Sequence[Any], compensated: bool) -> str | None:
    """Return why a splitting does not accept these effects, else None."""
    moving = [e for e in effects if depends_on_momentum(e)]
    flows = [e for e in moving if "l" in argument_names(e, "torque", "state_rate")]
    if unable := [e for e in flows if not implements(e, "kick")]:
        why = f"the torque of {_names(unable)} depends on L and has no flow of its own (kick)"
        return f"it alternates free motion with kicks, but {why}"
    if moving and integrator.order > 2:
        steps = "force gradients" if integrator.gradient else "its backward steps and its order"
        return f"{steps} are for torques of attitude and time, but {_names(moving)} depends on L"
    if moving and compensated:
        flow = f"{_names(moving)}, whose flow acts on L as a whole"
        return f"its sums cannot be compensated with {flow}"
    flat = [e for e in effects if not implements(e, "torque_rate")]
    if integrator.gradient and flat:
        return f"it needs the rate of change of torques (torque_rate), which {_names(flat)} lacks"
    return None


def _names(effects: Iterable[Any]) -> str:
    return ", ".join(name_of(e) for e in effects)
