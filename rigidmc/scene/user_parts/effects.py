"""Check of a custom effect: of its class when a scene takes it, of its methods before compilation.

The second checks the arguments and return values of its methods, and that the torque follows from
the energy.
"""

from typing import Any

import numpy as np

from rigidmc.engine.compiler.uncompilable import cause_of
from rigidmc.errors import PartError, SceneError, hint_of, nearest
from rigidmc.inputs.units import rule_with_hint, unit_of
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import Method, implements
from rigidmc.physics.dynamics.so3 import exponential, multiply
from rigidmc.physics.dynamics.trials import State, Trial, states
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.present import memories_of, states_of
from rigidmc.physics.effects.protocol import (
    ACTING,
    OLD_WORDS,
    add_noise,
    energy,
    energy_scale,
    facts,
    from_numbers,
    is_effect,
    is_random,
    kick,
    numbers,
    sample,
    shape,
    slip,
    state_rate,
    takes_noise,
    torque,
    torque_rate,
)

_VECTORS, _SCALARS = (torque, kick, add_noise, slip, torque_rate), (energy, energy_scale)
BODY = MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3))


def check_effect_class(effect: Any) -> None:
    """Raise SceneError for a value that is not an effect, and for a custom effect whose facts name
    a parameter or a unit that does not exist."""
    kind: Any = effect if isinstance(effect, type) else type(effect)
    if kind in EFFECTS.values() and not isinstance(effect, type):
        return
    if not is_effect(effect):
        raise _not_an_effect(effect, kind)
    stated = facts(kind)
    names = (
        "switches", "units", "shapes", "limits", "in_body", "along_axes", "hidden", "shared",
        "state", "memory", "commands", "every", "after",
    )  # fmt: skip
    for name in names:
        fields = getattr(stated, name)
        for field in filter(None, (fields,) if isinstance(fields, str) else fields):
            if field not in kind._fields:
                known = ", ".join(kind._fields) or "none"
                known += hint_of(nearest(field, kind._fields))
                rule = f"names '{field}', which is not a parameter; its parameters: {known}"
                raise PartError.of(kind, rule, "effects", name)
    for field, unit in stated.units.items():
        try:
            unit_of(unit)
        except SceneError as error:
            rule = f"states the unit {unit!r} of {field}: {rule_with_hint(error)}"
            raise PartError.of(kind, rule, "effects", "units") from None


def _not_an_effect(effect: Any, kind: type[Any]) -> SceneError:
    """Return the error about a value that is not an effect: what its class lacks."""
    fields = getattr(kind, "_fields", None)
    acts = [verb for verb in ACTING if implements(kind, verb)]
    methods = [x for x in vars(kind) if x[0] != "_" and x not in (fields or ())]
    close = [(word, right) for word in methods if (right := nearest(word, ACTING))]
    if (acts or close) and fields is None:
        rule = f"is not a NamedTuple, as an effect must be: write class {kind.__name__}(NamedTuple)"
    elif acts and isinstance(effect, type):
        rule = f"is a class: give its parameters, as in {kind.__name__}({', '.join(fields or ())})"
    elif fields is not None and not acts:
        rule = "has no method `torque`, which an effect needs (or `kick`, or `add_noise`)"
        if close:
            word, right = close[0]
            rule += f"; it has `{word}`: did you mean `{right}`?"
    else:
        shipped = ", ".join(effect_class.__name__ for effect_class in EFFECTS.values())
        rule = f"expected an effect with its parameters, one of {shipped}"
        return SceneError(rule, at="effects.effect", value=effect)
    return PartError.of(kind, rule, "effects")


def check_user_effect(effect: Any) -> None:
    """Raise SceneError, with class, line and rule, for a custom effect that no kernel can use."""
    kind = type(effect)
    if kind in EFFECTS.values():
        return
    trial = Trial("effects", trial_effect(effect))
    trial.refuse_old(OLD_WORDS)
    trial.read(*_VECTORS, *_SCALARS, state_rate, sample)
    _check_facts(trial, kind)
    sizes = {state_rate: len(states_of((trial.part,))), sample: len(memories_of((trial.part,)))}
    sizes |= dict.fromkeys(_VECTORS, 3)
    if implements(kind, "add_noise") and not takes_noise(kind) and shape(kind, "noise") == 3:
        rule = "only random effects can have the field `noise`: use @effect(is_random=True)"
        raise trial.complaint("noise", rule)
    if is_random(kind) and not (takes_noise(kind) and shape(kind, "noise") == 3):
        rule = (
            "is random, and so needs a field for the normal deviates of a step: noise: Vector ="
            ' (0.0, 0.0, 0.0), with shapes={"noise": 3} and hidden=("noise",) in @effect(...)'
        )
        raise trial.complaint("add_noise", rule)
    for state in states():
        values = _values(state)
        for method, size in sizes.items():
            if implements(kind, method.__name__):
                is_whole = method is kick and len(trial.called(kick, values)) > 3
                trial.numbers(method, values, size + sizes[state_rate] * is_whole)
        for method in _given(kind, _SCALARS):
            trial.number(method, values)
        if implements(kind, "energy") and implements(kind, "torque"):
            _check_gradient(trial, state)
    if implements(kind, "energy_scale"):
        _check_arrays(trial)


def _check_facts(trial: Trial, kind: type[Any]) -> None:
    """Check that what moves or samples has a method that does it, and that this is all it needs."""
    stated = facts(kind)
    for fact, method, is_stated in (
        ("state", "state_rate", bool(stated.state)),
        ("memory", "sample", bool(stated.memory)),
        ("every", "sample", bool(stated.every)),
    ):
        if is_stated and not implements(kind, method):
            raise trial.complaint(fact, f"is stated, so the class needs a method `{method}`")
        if implements(kind, method) and not is_stated:
            rule = f"needs the fact `{fact}`: @effect({fact}=...)"
            raise trial.complaint(method, rule)
    for field in stated.commands:
        if field not in stated.memory:
            raise trial.complaint("commands", f"names '{field}', which is not in `memory`")


def _check_arrays(trial: Trial) -> None:
    """Check that `energy_scale` also takes the parameters of all members at once."""
    many = from_numbers(type(trial.part), [np.full(2, x) for _, _, x in numbers(trial.part)])
    arrays: list[Any] = [np.full(2, x) for x in BODY[:BODY_NUMBERS]]
    body = MassProperties(*arrays)
    try:
        np.broadcast_to(energy_scale(many, body), 2)
    except Exception as error:  # custom code may raise anything
        rule = (
            f"raises {type(error).__name__} for arrays of members: use arithmetic, abs, `maximum`"
        )
        if cause := cause_of(type(many), method="energy_scale"):
            raise trial.complaint("energy_scale", cause.rule, cause.line) from None
        raise trial.complaint("energy_scale", f"{rule} and `select`") from None


def trial_effect(effect: Any) -> Any:
    """Return an effect with plain numbers, for trying its methods."""
    return from_numbers(type(effect), [_number(value) for _, _, value in numbers(effect)])


def _given(kind: type, methods: tuple[Method, ...]) -> list[Method]:
    return [method for method in methods if implements(kind, method.__name__)]


def _number(value: Any) -> float:
    """Return a trial value of a parameter: its first value, or 0.1 for a distribution."""
    return float(np.ravel(value)[0]) if isinstance(value, (float, np.ndarray)) else 0.1


def _values(state: State) -> dict[str, Any]:
    known = {"body": BODY, "t": state.t, "h": 0.1, "q": state.q, "l": state.l, "w": state.l}
    return {**known, "noise": (0.3, -1.2, 0.7, 0.1, 2.0, -0.4)}


def _check_gradient(trial: Trial, state: State) -> None:
    """Check that the torque is minus the change of the energy as the body turns."""
    step = 1e-5  # rad
    torques, slopes = np.array(trial.called(torque, _values(state))), []
    for axis in np.eye(3):
        turned = (
            state._replace(q=multiply(state.q, exponential(tuple(sign * step * axis))))
            for sign in (1.0, -1.0)
        )
        ahead, behind = (trial.called(energy, _values(there)) for there in turned)
        slopes.append((ahead - behind) / (2.0 * step))
    size = max(np.abs(torques).max(), np.abs(slopes).max())
    if not np.abs(torques + slopes).max() > 1e-6 * size:
        return
    opposite = np.abs(torques - slopes).max() <= 1e-6 * size
    hint = ", but its opposite" if opposite else ""
    shown, wanted = (", ".join(f"{x:.6g}" for x in v) for v in (torques, [-s for s in slopes]))
    at = ", ".join(f"{x:.4g}" for x in state.q)
    raise trial.complaint(
        "torque",
        f"({shown}) does not follow from its energy, which gives ({wanted}){hint}, "
        f"at the attitude {at}; it must be minus the change of energy as the body turns about "
        "its axes",
    )
