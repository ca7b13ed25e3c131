"""What physics costs before it is run: floating-point operations, counted in the code that LLVM makes of it."""

import re
from typing import Any

from numba import njit

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank
from rigidmc.effects.verbs import total_torque
from rigidmc.engine.compose import FLAGS
from rigidmc.integrators.verbs import step

_OPERATION = re.compile(
    r"= .*?\b(?:f(?:add|sub|mul|div)|call [^@]*@llvm\.(?:sqrt|fabs|minnum|maxnum)\S*)\b[^<]*?(?:<(\d+) x )?double"
)
_LIBRARY = re.compile(
    r"call [^@\n]*@(?:llvm\.)?(sin|cos|tan|exp|expm1|log|log10|log1p|pow|atan|atan2|asin|acos|sinh|cosh|tanh|fmod|hypot)\b"
)
_BODY, _AT, _SPIN = MassProperties(*[1.0] * 9), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def torque_flops(effect):
    """Operations of one evaluation of an effect's torque."""
    return _counted(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN)


def misdeeds(effect):
    """What keeps the torque of a user's own effect from a kernel, in words: memory that it takes; or ""."""
    return "takes memory" if "NRT_" in _code(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN) else ""


def library_calls(effect):
    """Functions of the library that a torque calls: no lane loop with one of them is packed."""
    return sorted(set(_LIBRARY.findall(_code(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN))))


def step_flops(form, effects, attitude):
    """Operations of one step of a Form with some effects: of its parts together."""
    part, q = (0.0, 0.0, 0.0), _AT if attitude else (1.0, 0.0, 0.0, 0.0)
    counted = _with_attitude if attitude else _momentum_alone
    return (len(form.parts) - 1) * _counted(counted, form.integrator, _BODY, blank(effects), 0.0, 0.1, part, q, _SPIN)


def _torque(effect, body, t, q, l):
    return total_torque((effect,), body, t, q, l)


def _with_attitude(integrator, body, effects, t, h, part, q, l):
    return step(integrator, body, effects, t, h, part, q, l)


def _momentum_alone(integrator, body, effects, t, h, part, q, l):
    return step(integrator, body, effects, t, h, part, q, l)[1]


def _counted(function, *arguments):
    return sum(int(found[1] or 1) for line in _code(function, *arguments).splitlines() if (found := _OPERATION.search(line)))


def _code(function, *arguments):
    flags: Any = FLAGS
    compiled = njit(**flags)(function)
    compiled(*arguments)
    (code,) = compiled.inspect_llvm().values()
    return code
