"""How a step is made. An integrator has a method `step` and its facts; a new one is one class and one line below.

    step(self, [body, effects, t, h, part, q, l]) -> (q, l)

q and l may be pairs (value, remainder): `whole` gives the value, `gain`, `gain4` and `moved` add to either.
Facts: order, evaluations of the torque per step, reversible, conserves (free body), accepts (which torques), compensated, and
largest_turn where a step may turn by less than pi [rad], or by more with the number; least_spin and largest_spin, between which what is
compiled follows the turn of a step; see `rigidmc.planning.limits`.
Where what is compiled depends on the size of the step: prepared(self, turns, effects) -> Form; see `forms`.
"""

from typing import Any

from rigidmc.effects import name_of
from rigidmc.effects.protocol import depends_on_momentum, is_random
from rigidmc.integrators.closed_form import ClosedForm
from rigidmc.integrators.form import Form, Turns, form
from rigidmc.integrators.free_motion import FreeMotion
from rigidmc.integrators.lie import CF4, CK45, RKMK4
from rigidmc.integrators.midpoint import Midpoint
from rigidmc.integrators.rk4 import RK4
from rigidmc.integrators.rk8 import RK8
from rigidmc.integrators.splitting import (
    ABA864,
    ABA1064,
    CHIN4,
    ROTATIONS,
    SRKN6,
    SRKN11,
    STRANG,
    SUZUKI4,
)

__all__ = ["INTEGRATORS", "Form", "Turns", "accepting", "form", "keeps_remainders", "refusal"]

INTEGRATORS: dict[str, Any] = {
    "rk4": RK4(),
    "rk8": RK8(),
    "rkmk4": RKMK4(),
    "cf4": CF4(),
    "ck45": CK45(),
    "midpoint": Midpoint(),
    "strang": STRANG,
    "rotations": ROTATIONS,
    "chin4": CHIN4,
    "suzuki4": SUZUKI4,
    "srkn6": SRKN6,
    "srkn11": SRKN11,
    "aba864": ABA864,
    "aba1064": ABA1064,
    "exact": FreeMotion(),
    "closed": ClosedForm(),
}


def description(name):
    """What an integrator is and what it is for, with its source."""
    kind = INTEGRATORS[name]
    return getattr(kind, "text", None) or kind.__doc__


def refusal(name, effects, compensated=False, works=False):
    """Why an integrator does not take these effects, and the nearest ones that do; None where it takes them.

    Whether `closed` covers a body is known only from its moments, see `rigidmc.planning.closed_form`.
    """
    why = _refusal(INTEGRATORS[name], effects, compensated, works)
    if why is None:
        return None
    order = INTEGRATORS[name].order
    able = [
        other
        for other in accepting(effects, compensated, works)
        if not isinstance(INTEGRATORS[other], ClosedForm)
    ]
    able.sort(
        key=lambda other: (_distance(order, INTEGRATORS[other].order), -_kinship(name, other))
    )
    return f"{why}; use {' or '.join(able[:2])}" if able else why


def _distance(order, other):
    return 0.0 if order == other else abs(order - other) if order < float("inf") else -other


def _kinship(name, other):
    return hasattr(INTEGRATORS[name], "drifts") == hasattr(INTEGRATORS[other], "drifts")


def accepting(effects, compensated=False, works=False):
    """The names of the integrators that take these effects, and keep their works."""
    return [
        name
        for name, kind in INTEGRATORS.items()
        if _refusal(kind, effects, compensated, works) is None
    ]


def keeps_remainders(name, effects, dtype, compensated=False):
    """Whether sums keep their remainders: if that is asked for, and in float32 whenever the integrator can.

    A short step changes a state by few units in its last place, which many steps in a row round alike. In float32 the error then
    grows as fast as the number of steps or faster (rk4: 2e-3 after 10 s in 1.3e5 steps); with remainders it does not grow (6e-7),
    and rk4 costs 1.3 times as much.
    """
    return compensated or (
        dtype == "float32" and _refusal(INTEGRATORS[name], effects, True, False) is None
    )


def _refusal(kind, effects, compensated, works):
    if works and (
        compensated
        or getattr(kind, "gradient", 0.0)
        or (not hasattr(kind, "prepared") and not hasattr(kind, "step"))
    ):
        return (
            f"the work of effects is not kept {'with compensated sums' if compensated else 'by it'}"
        )
    if compensated and not kind.compensated:
        return "it has no sums that could be compensated"
    noisy = [e for e in effects if is_random(e)]
    if noisy and (not hasattr(kind, "drifts") or kind.order != 2):
        return f"{_names(noisy)} is random, which splittings of order 2 take"
    if noisy and compensated:
        return f"its sums cannot be compensated with {_names(noisy)}, which acts on L as a whole"
    if not effects or kind.accepts == "any torque":
        return None
    if kind.accepts == "no torque":
        return f"it is the motion of a free body and takes no torque, but the scene has {_names(effects)}"
    if isinstance(kind, ClosedForm):
        unknown = [e for e in effects if name_of(e) not in ("gravity", "viscous_damping")]
        return f"no closed form knows {_names(unknown)}" if unknown else None
    moving = [e for e in effects if depends_on_momentum(e)]
    unsplit = [e for e in moving if not hasattr(e, "kick")]
    if unsplit:
        return f"it alternates free motion with kicks, but the torque of {_names(unsplit)} depends on L and has no flow of its own (kick)"
    if moving and kind.order > 2:
        steps = (
            "force gradients are for"
            if getattr(kind, "gradient", 0.0)
            else "its steps backwards and its order are for"
        )
        return f"{steps} torques of attitude and time, but {_names(moving)} depends on L"
    if moving and compensated:
        return (
            f"its sums cannot be compensated with {_names(moving)}, whose flow acts on L as a whole"
        )
    flat = [e for e in effects if not hasattr(e, "torque_rate")]
    if getattr(kind, "gradient", 0.0) and flat:
        return f"it needs the rate of change of torques (torque_rate), which {_names(flat)} has not"
    return None


def _names(effects):
    return ", ".join(name_of(e) for e in effects)
