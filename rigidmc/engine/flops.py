"""What physics costs before it is run: floating-point operations, counted in the code that LLVM makes of it."""

import re
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects.parameters import blank
from rigidmc.effects.verbs import total_torque
from rigidmc.engine.compose import FLAGS, read, read_all, rows_of
from rigidmc.engine.layout import put
from rigidmc.integrators.verbs import step

_OPERATION = re.compile(
    r"= .*?\b(?:f(add|sub|mul|div)|call [^@]*@(?:llvm\.)?(sqrt|fabs|minnum|maxnum|fma)\b\S*)\b[^<]*?(?:<(\d+) x )?double"
)
_CHOICE = re.compile(r"= (?:fcmp|select)\b[^<]*?(?:<(\d+) x )?double")
_MANY = 1024  # lanes of a loop that is looked at: one of 32 with little in it would be unrolled whole
DIVISION, ROOT = 10, 18  # what they take in place of a product in packed arithmetic (Zen 4, 512 bits)
_LIBRARY = re.compile(
    r"call [^@\n]*@(?:llvm\.)?(sin|cos|tan|exp|expm1|log|log10|log1p|pow|atan|atan2|asin|acos|sinh|cosh|tanh|fmod|hypot)\b"
)
_BODY, _AT, _SPIN = MassProperties(*[1.0] * 9), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


class Operations(NamedTuple):
    """Floating-point operations, and how many of them are divisions and square roots; beside them comparisons and selections."""

    all: int
    divisions: int
    roots: int
    choices: int

    @property
    def slots(self):
        """In times of a product."""
        return self.all + self.choices + (DIVISION - 1) * self.divisions + (ROOT - 1) * self.roots

    def less(self, other):
        """What is left without others."""
        return Operations(*(a - b for a, b in zip(self, other, strict=True)))

    def times(self, count):
        """As often as `count` says."""
        return Operations(*(count * a for a in self))

    def __str__(self):
        parts = [
            f"{count} {word}{'s' * (count != 1)}" for count, word in ((self.divisions, "division"), (self.roots, "root")) if count
        ]
        return f"{self.all} operations" + (f" ({', '.join(parts)})" if parts else "")


def torque_operations(effect):
    """Operations of one evaluation of an effect's torque."""
    return _counted(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN)


def misdeeds(effect):
    """What keeps the torque of a user's own effect from a kernel, in words: memory that it takes; or ""."""
    return "takes memory" if "NRT_" in _torque_code(effect) else ""


def library_calls(effect):
    """Functions of the library that a torque calls: no lane loop with one of them is packed."""
    return sorted(set(_LIBRARY.findall(_torque_code(effect))))


def unpacked(effect):
    """Why lanes cannot work on the torque of a user's own effect side by side, in words; "" where they do."""
    if called := library_calls(effect):
        return f"calls {', '.join(called)} of the library (rigidmc.dynamics.so3 has sincos, expm1 and exponential that are none)"
    rows = 17 + rows_of(effect)
    found = [
        line for line in _code(_lanes, *blank((effect,)), np.zeros((rows + 3) * _MANY)).splitlines() if _OPERATION.search(line)
    ]
    if all("x double>" in line for line in found):
        return ""
    return "branches, or loops as often as numbers say, where both sides and a fixed number of turns would do"


def step_operations(form, effects, attitude):
    """Operations of one step of a Form with some effects: of its parts together."""
    part, q = (0.0, 0.0, 0.0), _AT if attitude else (1.0, 0.0, 0.0, 0.0)
    counted = _with_attitude if attitude else _momentum_alone
    return _counted(counted, form.integrator, _BODY, blank(effects), 0.0, 0.1, part, q, _SPIN).times(len(form.parts) - 1)


_codes: dict[type, str] = {}


def _torque_code(effect):
    """LLVM's code of an effect's torque, made once for each class."""
    if type(effect) not in _codes:
        _codes[type(effect)] = _code(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN)
    return _codes[type(effect)]


def _torque(effect, body, t, q, l):
    return total_torque((effect,), body, t, q, l)


def _lanes(effect, work):
    for k in range(_MANY):
        body, present = read(_BODY, work, 8, k, _MANY), read_all((effect,), work, 17, k, _MANY)
        q = work[k], work[_MANY + k], work[2 * _MANY + k], work[3 * _MANY + k]
        l = work[4 * _MANY + k], work[5 * _MANY + k], work[6 * _MANY + k]
        put(total_torque(present, body, work[7 * _MANY + k], q, l), work, (17 + rows_of(effect)) * _MANY + k, _MANY)


def _with_attitude(integrator, body, effects, t, h, part, q, l):
    return step(integrator, body, effects, t, h, part, q, l)


def _momentum_alone(integrator, body, effects, t, h, part, q, l):
    return step(integrator, body, effects, t, h, part, q, l)[1]


def _counted(function, *arguments):
    code = _code(function, *arguments).splitlines()
    found = [m for line in code if (m := _OPERATION.search(line))]
    counts = [(m[1] or m[2], (2 if m[2] == "fma" else 1) * int(m[3] or 1)) for m in found]
    choices = sum(int(m[1] or 1) for line in code if (m := _CHOICE.search(line)))
    divisions, roots = (sum(n for kind, n in counts if kind == word) for word in ("div", "sqrt"))
    return Operations(sum(n for _, n in counts), divisions, roots, choices)


def _code(function, *arguments):
    flags: Any = FLAGS
    compiled = njit(**flags)(function)
    compiled(*arguments)
    (code,) = compiled.inspect_llvm().values()
    return code
