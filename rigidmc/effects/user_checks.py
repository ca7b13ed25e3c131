"""A user's effect, checked before it is compiled.

What its methods ask for, what they return, and whether the torque is that of the energy.
"""

import ast
import inspect
import linecache
import textwrap
import traceback
from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.methods import arguments, implements
from rigidmc.dynamics.so3 import exponential, multiply
from rigidmc.effects import EFFECTS, protocol
from rigidmc.effects.parameters import filled, numbers
from rigidmc.effects.protocol import Effect
from rigidmc.effects.user import RESULT_SIZES, RULE
from rigidmc.errors import SceneError, nearest

_BODY = MassProperties.of((0.6, 0.8, 1.0), (0.05, -0.02, 0.3))
_STATES = 8  # random states at which the methods are tried


class State(NamedTuple):
    """Where the methods are tried."""

    t: float
    q: tuple[float, ...]
    l: tuple[float, ...]


def check_user_effect(effect: Any) -> None:
    """Raise SceneError, with class, line and rule, for a user's effect that no kernel could use."""
    kind = type(effect)
    if kind in EFFECTS.values():
        return
    methods = {name: size for name, size in RESULT_SIZES.items() if implements(kind, name)}
    for name in methods:
        _check_arguments(kind, name)
        _check_loops(kind, name)
    sample = filled(kind, [_number(value) for _, _, value in numbers(effect)])
    some = np.random.default_rng(1)
    for _ in range(_STATES):
        q, l = some.normal(size=4), some.normal(size=3)
        state = State(
            float(some.uniform(0.0, 2.0)),
            tuple((q / np.linalg.norm(q)).tolist()),
            tuple(l.tolist()),
        )
        for name, size in methods.items():
            _check_value(kind, name, size, _called(sample, name, state))
        if {"energy", "torque"} <= methods.keys():
            _check_gradient(sample, state)


def _number(value: Any) -> float:
    """A number that stands for a parameter: its first value, or 0.1 for a law."""
    return float(np.ravel(value)[0]) if isinstance(value, (float, np.ndarray)) else 0.1


def _complaint(kind: type[Effect], name: str, rule: str, line: int | None = None) -> SceneError:
    file = getattr(kind, name).__code__.co_filename  # a class of a notebook has no file itself
    place = f"{file}, line {line}: {linecache.getline(file, line).strip()}: " if line else ""
    return SceneError("effects", f"{kind.__name__}.{name}", None, place + rule)


def _check_arguments(kind: type[Effect], name: str) -> None:
    known = getattr(protocol, name).available
    for argument in arguments(getattr(kind, name)):
        if argument not in known:
            close = nearest(argument, known)
            hint = f" (did you mean '{close}'?)" if close else ""
            rule = f"asks for '{argument}'; it may name {', '.join(known)}{hint}"
            raise _complaint(kind, name, rule)


def _check_loops(kind: type[Effect], name: str) -> None:
    """The length of a loop must not depend on numbers: the members of a vector take it together."""
    method = getattr(kind, name)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(method)))
    except (OSError, TypeError, SyntaxError):  # typed into a shell
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.For):
            call = node.iter if isinstance(node.iter, ast.Call) else None
            counted = call is None or all(isinstance(a, ast.Constant) for a in call.args)
        elif isinstance(node, ast.While):
            counted = False
        else:
            continue
        if not counted:
            line = method.__code__.co_firstlineno + node.lineno - 1
            raise _complaint(kind, name, f"a loop whose length depends on numbers; {RULE}", line)


def _called(effect: Any, name: str, state: State) -> Any:
    values = {"body": _BODY, "t": state.t, "h": 0.1, "q": state.q, "l": state.l, "w": state.l}
    method = getattr(type(effect), name)
    try:
        return method(effect, *(values[argument] for argument in arguments(method)))
    except Exception as error:  # the user's code may raise anything
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f.lineno for f in frames if f.filename == method.__code__.co_filename]
        rule = f"raises {type(error).__name__}: {error}"
        raise _complaint(type(effect), name, rule, lines[-1] if lines else None) from None


def _check_value(kind: type[Effect], name: str, size: int, value: Any) -> None:
    expected = "a number" if size == 1 else "a tuple of 3 numbers"
    if isinstance(value, (np.ndarray, list)):
        rule = f"gives {type(value).__name__}, expected {expected}; {RULE}"
        raise _complaint(kind, name, rule)
    parts = value if isinstance(value, tuple) else (value,)
    if (
        len(parts) != size
        or (size == 3) != isinstance(value, tuple)
        or not all(np.isscalar(x) and np.isreal(x) for x in parts)
    ):
        raise _complaint(kind, name, f"gives {value!r}, expected {expected}")
    if not np.isfinite(np.array(parts, dtype=float)).all():
        raise _complaint(kind, name, f"gives {value!r}, which is not finite")


def _check_gradient(effect: Any, state: State, step: float = 1e-5) -> None:
    """The torque has to be minus the change of the energy as the body turns."""
    torque, slopes = np.array(_called(effect, "torque", state)), []
    for axis in np.eye(3):
        ahead, behind = (
            _called(
                effect,
                "energy",
                state._replace(q=multiply(state.q, exponential(tuple(sign * step * axis)))),
            )
            for sign in (1.0, -1.0)
        )
        slopes.append((ahead - behind) / (2.0 * step))
    size = max(np.abs(torque).max(), np.abs(slopes).max())
    if not np.abs(torque + slopes).max() > 1e-6 * size:
        return
    opposite = np.abs(torque - slopes).max() <= 1e-6 * size
    hint = ", but the opposite of it" if opposite else ""
    given, wanted = (", ".join(f"{x:.6g}" for x in v) for v in (torque, [-s for s in slopes]))
    at = ", ".join(f"{x:.4g}" for x in state.q)
    raise _complaint(
        type(effect),
        "torque",
        f"({given}) is not that of its energy, ({wanted}){hint}, "
        f"at the attitude {at}; it has to be minus the change of energy as the body turns about "
        "its axes",
    )
