"""Check of a custom integrator before compilation.

It checks the properties, the arguments and return values of the methods, and the order of a step.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import PartError
from rigidmc.physics.dynamics.euler import MassProperties, kinetic_energy
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.dynamics.so3 import conjugate, dot, into_body
from rigidmc.physics.dynamics.trials import State, Trial, states
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.integrators.protocol import (
    OLD_WORDS,
    Integrator,
    extra_state,
    from_stepping,
    interleaving,
    precompute,
    step,
    to_stepping,
    with_defaults,
)

_BODY = MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3))
_STEP = 0.2  # [s], in which a body turns by about 0.4 rad
_SLACK = 0.6  # allowed error of the measured order; at most 0.3 for the shipped integrators
OLD_MAKERS = "form", "prepared"  # `scheme` in earlier versions: refused later, with the new name
_SMALL = 1e-9  # far above the rounding of a step of 0.2 s: 1e-15
_KEPT: dict[str, Callable[[Any, Any], Any]] = {  # names allowed in `conserves`, for a free body
    "|q|": lambda q, l: sum(x * x for x in q),
    "|L|^2": lambda q, l: dot(l, l),
    "T": lambda q, l: kinetic_energy(_BODY, l),
    "L in space": lambda q, l: into_body(conjugate(q), l),
}
_FACTS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "order": (lambda x: _is_real(x) and x >= 1, "a number of 1 or more"),
    "evaluations": (lambda x: isinstance(x, int) and x >= 0, "torques per step, an integer"),
    "is_reversible": (lambda x: isinstance(x, bool), "True or False"),
    "conserves": (
        lambda x: isinstance(x, tuple) and set(x) <= _KEPT.keys(),
        f"a tuple of some of {', '.join(_KEPT)}",
    ),
    "accepts": (lambda x: x in ("any torque", "no torque"), "'any torque' or 'no torque'"),
    "compensated": (lambda x: isinstance(x, bool), "True or False"),
}


class _Counted(NamedTuple):
    """An effect that counts the evaluations of its torque."""

    times: Any

    def torque(self, q: Any) -> tuple[float, float, float]:
        self.times.append(1)
        return 0.0, 0.0, 0.0


def is_integrator(value: Any) -> bool:
    """Return whether a value is an integrator: an instance of a NamedTuple that makes steps."""
    ways = any(implements(value, way) for way in ("step", "scheme", *OLD_MAKERS))
    return ways and isinstance(value, tuple)


def known_facts(value: Any, word: str) -> Integrator:
    """Return a custom integrator with defaults for the properties that it omits; SceneError.

    word : its name in a scene
    """
    at = f"integrators.{word}"
    if not is_integrator(value):
        rule = "expected a name, or an integrator such as Kutta38(): a NamedTuple with `step`"
        raise PartError.of(value, rule, at)
    if word in (*INTEGRATORS, "auto"):
        rule = f"'{word}' is an integrator of the package: give the class another name"
        raise PartError.of(value, rule, at)
    Trial(at, value).refuse_old(OLD_WORDS)
    for fact, (right, expected) in _FACTS.items():
        if not implements(value, fact):
            raise PartError.of(value, f"is missing: {expected}", at, fact)
        free = fact == "accepts" and implements(value, "is_splitting")  # an equivalent property
        if not free and not right(getattr(value, fact)):
            rule = f"is {getattr(value, fact)!r}, expected {expected}"
            raise PartError.of(value, rule, at, fact)
    return with_defaults(value)


def check_user_integrator(integrator: Any, word: str) -> None:
    """Raise SceneError, with class, line and rule, for a custom integrator that no kernel can use,
    or that contradicts its properties."""
    if not implements(integrator, "step"):  # a scheme makes its steps
        return
    trial = Trial(f"integrators.{word}", integrator)
    trial.read(interleaving, extra_state, precompute, to_stepping, step, from_stepping)
    some = list(states())
    for state in some:
        _step(trial, (), state, _STEP)
    _check_kept(trial, some)
    if integrator.accepts == "any torque":
        asked: list[int] = []
        _step(trial, (_Counted(asked),), some[0], _STEP)
        if len(asked) != integrator.evaluations:
            rule = f"is {integrator.evaluations}, but a step evaluates {len(asked)} torques"
            raise trial.complaint("evaluations", rule)
    _check_order(trial, some)


def _check_kept(trial: Trial, some: list[State]) -> None:
    """Check that a step of a free body has the stated properties."""
    for state in some:
        after = _step(trial, (), state, _STEP)
        for name in trial.part.conserves:
            before, now = (np.array(_KEPT[name](s.q, s.l)) for s in (state, after))
            if (change := float(np.abs(now - before).max())) > _SMALL:
                rule = f"names {name}, which a step of a free body changes by {change:.1e}"
                raise trial.complaint("conserves", rule)
        back = _apart(state, _step(trial, (), after, -_STEP))
        if trial.part.is_reversible and back > _SMALL:
            rule = f"is True, but a step of -h after one of h ends {back:.1e} from the start"
            raise trial.complaint("is_reversible", rule)


def _check_order(trial: Trial, some: list[State]) -> None:
    """Check that the error of a step falls as h^(order + 1)."""
    effects = (Gravity(1.0),) if trial.part.accepts == "any torque" else ()
    truth = trial._replace(part=INTEGRATORS["rk8"])
    errors = []
    for h in (_STEP, 0.5 * _STEP):
        error = 0.0
        for state in some:
            true = state
            for _ in range(8):
                true = _step(truth, effects, true, h / 8.0)
            error += _apart(true, _step(trial, effects, state, h))
        errors.append(error)
    if errors[1] < 1e-12 or not errors[0] > 0.0:  # as exact as the reference
        return
    order = math.log2(errors[0] / errors[1]) - 1.0
    if order < trial.part.order - _SLACK:
        rule = f"is {trial.part.order:g}, but the error of a step falls as for order {order:.1f}"
        raise trial.complaint("order", rule)


def _step(trial: Trial, effects: tuple[Any, ...], state: State, h: float) -> State:
    """Return the state after a step; SceneError unless it is a quaternion and a vector."""
    integrator, substep, t = trial.part, (h, h, 0.0), state.t
    values: dict[str, Any] = {"body": _BODY, "effects": effects, "t": t, "h": h, "substep": substep}
    q, l = state.q, state.l + tuple(extra_state(integrator))
    q, l = to_stepping(integrator, _BODY, effects, t, (0.0, 0.0, 0.0), q, l)
    values |= {"q": q, "l": l, "constants": precompute(integrator, _BODY, substep, l)}
    after = trial.called(step, values)
    pair = isinstance(after, tuple) and [len(x) for x in after if isinstance(x, tuple)]
    if pair != [len(q), len(l)]:
        rule = f"returns {after!r}, expected (q, L): tuples of {len(q)} and {len(l)} numbers"
        raise trial.complaint("step", rule)
    q, l = from_stepping(integrator, _BODY, effects, t + h, (0.0, 0.0, 0.0), *after)
    if not np.isfinite(np.array(q + l[:3], dtype=float)).all():
        raise trial.complaint("step", f"returns {after!r}, which is not finite")
    return State(t + h, q, l[:3])


def _apart(state: State, other: State) -> float:
    """Return the largest difference of two states."""
    return float(np.abs(np.subtract(state.q + state.l, other.q + other.l)).max())


def _is_real(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
