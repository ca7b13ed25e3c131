"""Inspection of the LLVM code of custom classes before anything runs.

It counts the floating-point operations of a torque or a step. It detects code that allocates
memory, which is rejected with the name of its class. It finds out whether code runs on vectors, or
on one number at a time, so that the members of its scene go one at a time.
"""

import linecache
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from numba import typeof

from rigidmc.engine.compiler.compose import NumbaError, inline_all, innermost_cause
from rigidmc.engine.compiler.disk_cache import cached_text, text_entry
from rigidmc.engine.compiler.frozen import frozen
from rigidmc.engine.compiler.kernels import WIDTH, KernelKey, config, signature_of, type_key
from rigidmc.engine.compiler.machine_code import lower
from rigidmc.engine.compiler.memory import four_at, put_rows, three_at
from rigidmc.engine.compiler.trees import tree_unflatten, tree_unpack
from rigidmc.engine.compiler.uncompilable import cause_of
from rigidmc.errors import PartError
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.dynamics.so3 import first_three, select
from rigidmc.physics.dynamics.trials import RULE
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.protocol import (
    add_noise,
    add_torque,
    blank,
    energy,
    energy_scale,
    kick,
    noise_score,
    slip,
    torque,
    torque_rate,
)
from rigidmc.physics.effects.sums import total_torque
from rigidmc.physics.integrators.protocol import from_stepping, precompute, step, to_stepping
from rigidmc.physics.observables import is_own
from rigidmc.physics.observables.compiled import (
    armed,
    begin,
    counts_at_start,
    extrema,
    extremum_limits,
    is_conserved,
    is_terminal,
    is_time_average,
    level,
    merged,
    reweighed,
    update,
    value,
)

# A packed operation counts once for each number in its vector: "<8 x double>".
_OPERATION = re.compile(
    r"= .*?\b(?:f(add|sub|mul|div)|call [^@]*@(?:llvm\.)?(sqrt|fabs|minnum|maxnum|fma)\b\S*)\b"
    r"[^<]*?(?:<(\d+) x )?double"
)
_CHOICE = re.compile(r"= (?:fcmp|select)\b[^<]*?(?:<(\d+) x )?double")
DIVISION, ROOT = 10, 18  # in units of a product's time, in packed arithmetic (Zen 4, 512 bits)
SCALAR_REASON = "branches, or calls a function that takes one number at a time"
_BODY, _AT, _SPIN = MassProperties(*[1.0] * 9), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


class Operations(NamedTuple):
    """Numbers of floating-point operations, and of divisions and square roots among them.

    choices : comparisons and selections, not included in `all`
    """

    all: int
    divisions: int
    roots: int
    choices: int

    @property
    def slots(self) -> int:
        """The time of all operations, in units of a product's time."""
        return self.all + self.choices + (DIVISION - 1) * self.divisions + (ROOT - 1) * self.roots

    def less(self, other: "Operations") -> "Operations":
        """Subtract other operations."""
        return Operations(*(a - b for a, b in zip(self, other, strict=True)))

    def times(self, count: int) -> "Operations":
        """Multiply all numbers by `count`."""
        return Operations(*(count * a for a in self))

    def __str__(self) -> str:
        parts = [
            f"{count} {word}{'s' * (count != 1)}"
            for count, word in ((self.divisions, "division"), (self.roots, "root"))
            if count
        ]
        return f"{self.all} operations" + (f" ({', '.join(parts)})" if parts else "")


def torque_operations(effect: Any) -> Operations:
    """Count the operations of one evaluation of an effect's torque."""
    return _count(_torque, *blank((effect,)), _BODY, 0.0, _AT, _SPIN)


def refuse_uncompilable(effects: Iterable[Any]) -> None:
    """Raise SceneError for a custom effect that allocates memory or cannot be compiled."""
    for effect in effects if not config.DISABLE_JIT else ():
        if type(effect) not in EFFECTS.values():
            why_scalar(effect)


def compilation_error(
    error: NumbaError, effects: Iterable[Any], observables: Iterable[Any] = ()
) -> Exception:
    """Return the PartError that names the custom classes of code that cannot be compiled; the error
    itself if there are none."""
    custom = {
        "effects": [e for e in effects if type(e) not in EFFECTS.values()],
        "observables": list(filter(is_own, observables)),
    }
    names = {key: ", ".join(type(part).__name__ for part in parts) for key, parts in custom.items()}
    table = ", ".join(table for table, words in names.items() if words)
    for at, parts in (("effects", effects), ("observables", observables)):
        if culprit := next((part for part in parts if cause_of(type(part), error)), None):
            return refused(culprit, at, error)
    if not table:
        return error
    rule = f"cannot be compiled: {innermost_cause(error)}; {RULE}"
    return PartError(rule, at=f"{table}.{', '.join(filter(None, names.values()))}", table=table)


def why_scalar(effect: Any) -> str:
    """Return why members cannot be worked on side by side with an effect, or ""."""
    return _why_scalar_part("effects", effect, blank((effect,)), (), _all_methods)


def step_operations(scheme: Any, effects: Any, attitude: bool) -> Operations:
    """Count the operations of one step of a StepScheme with these effects, in all substeps."""
    substep, q = (0.0, 0.0, 0.0), _AT if attitude else (1.0, 0.0, 0.0, 0.0)
    first = tuple(_STEP * x for x in scheme.substeps[1, :3].tolist())
    q, l = to_stepping(scheme.integrator, _STILL, blank(effects), 0.0, first, q, _SPIN)
    constants_of_step = precompute(scheme.integrator, _STILL, first, l)

    # Two functions, because Numba would compile a branch on `attitude` with both results.
    def whole_state(integrator, effects, t, part, q, l):
        return step(integrator, _STILL, effects, t, _STEP, part, q, l, constants_of_step)

    def momentum_alone(integrator, effects, t, part, q, l):
        return step(integrator, _STILL, effects, t, _STEP, part, q, l, constants_of_step)[1]

    function = whole_state if attitude else momentum_alone
    one_substep = _count(function, scheme.integrator, blank(effects), 0.0, substep, q, l)
    return one_substep.times(len(scheme.substeps) - 1)


def _torque(effect, body, t, q, l):
    """Compiled to count the operations of an effect."""
    return total_torque((effect,), body, t, q, l)


def state_at(at):
    """Return (body, q, L, t, h) in the rows of a probe."""
    return tree_unflatten(_BODY, at, 8), four_at(at, 0), three_at(at, 4), at[7], at[29]


def _all_methods(tree, numbers, at):
    """Compiled to find out whether all methods of an effect run on vectors."""
    (effect,), _ = tree_unpack(tree, numbers)
    effect = tree_unflatten(effect, at, 30)
    body, q, l, t, h = state_at(at)
    put_rows(
        torque(effect, body, t, q, l)
        + kick(effect, body, t, h, q, l)
        + torque_rate(effect, body, t, q, l)
        + add_noise(effect, body, h, l)
        + add_torque(effect, body, t, q, l, (h, h, h), l)
        + slip(effect, body, t, q, l)
        + noise_score(effect, body, h, l),
        at,
        0,
    )
    put_rows((energy(effect, body, q), energy_scale(effect, body)), at, 0)
    return 0


# Body and step are the same in every step. They are constants here, so computations from them alone
# do not count: LLVM moves these out of the loop over steps.
_STILL, _STEP = MassProperties.of((0.61, 0.83, 1.07), (0.053, -0.022, 0.31)), 0.013


def _count(function: Callable[..., Any], *arguments: Any) -> Operations:
    """Count the operations of a function, compiled for the types of these arguments."""
    code = _code(function, *arguments).splitlines()
    matches = [m for line in code if (m := _OPERATION.search(line))]
    counts = [(m[1] or m[2], (2 if m[2] == "fma" else 1) * int(m[3] or 1)) for m in matches]
    choices = sum(int(m[1] or 1) for line in code if (m := _CHOICE.search(line)))
    divisions, roots = (
        sum(n for operation, n in counts if operation == name) for name in ("div", "sqrt")
    )
    return Operations(sum(n for _, n in counts), divisions, roots, choices)


def _code(function: Callable[..., Any], *arguments: Any) -> str:
    """Return the LLVM code of a function, compiled for the types of these arguments."""
    kinds = tuple(map(typeof, frozen(arguments)))
    return str(lower(function, kinds).library.get_llvm_str())


_why_scalar_parts: dict[Any, str] = {}  # by the types of the part and of the effects


def scalar_parts(
    integrator: Any, effects: Sequence[Any], monitored: Iterable[Any]
) -> list[tuple[str, str]]:
    """Return [(class, why)] of custom classes that prevent work on members side by side.

    monitored : observables, compiled events, running observables

    Raises SceneError for an integrator or an observable that cannot be compiled.
    """
    if config.DISABLE_JIT:
        return []
    custom = [effect for effect in effects if type(effect) not in EFFECTS.values()]
    reasons = [(type(effect).__name__, why_scalar(effect)) for effect in custom]
    parts = [
        ("run", integrator, _probe_integrator),
        *(("observables", observable, _probe_observable) for observable in monitored),
    ]
    for at, part, probe in parts:
        for user_part in _user_parts(part):
            why = _why_scalar_part(at, user_part, part, effects, probe)
            reasons.append((type(user_part).__name__, why))
    return [(name, why) for name, why in reasons if why]


def _user_parts(part: Any) -> Iterator[Any]:
    """Yield the custom NamedTuples among nested tuples."""
    if isinstance(part, tuple):
        if implements(part, "_fields") and not type(part).__module__.startswith("rigidmc."):
            yield part
        for item in part:
            yield from _user_parts(item)


def _why_scalar_part(
    at: str, user_part: Any, part: Any, effects: Sequence[Any], probe: Callable[..., int]
) -> str:
    """Return why members cannot be worked on side by side with a part, or ""; raise SceneError."""
    parts = frozen((part, tuple(effects)))
    key = probe, type_key(parts)

    def probed() -> str:
        reason = ""
        try:
            # On vectors first, then on one number: code that compiles for neither is rejected.
            code = _llvm_of_probe(probe, parts, WIDTH)
        except Exception:  # Numba may fail in any way
            reason = SCALAR_REASON
            try:
                code = _llvm_of_probe(probe, parts, 1)
            except Exception as error:
                raise refused(user_part, at, error) from None
        if "NRT_" in code:
            raise refused(user_part, at)
        return reason

    if key not in _why_scalar_parts:
        signature = signature_of(KernelKey(probe, parts, "float64", WIDTH, "s"))
        _why_scalar_parts[key] = cached_text(
            text_entry([signature], f"own_parts {probe.__name__}"), probed
        )
    return _why_scalar_parts[key]


def refused(part: Any, at: str, error: Exception | None = None) -> PartError:
    """Return the error about a class that the compiler refuses, or that allocates memory."""
    cls = type(part)
    why = f"cannot be compiled: {innermost_cause(error)}" if error else "allocates memory"
    cause = cause_of(cls, error or "")
    if cause is None:
        return PartError.of(cls, f"{why}; {RULE}", at)
    place = f"{cause.file}, line {cause.line}: " if cause.line else ""
    if place:
        place += f"{linecache.getline(cause.file, cause.line).strip()}: "
    rule = f"{place}{'cannot be compiled' if error else why}: {cause.rule}; {RULE}"
    return PartError.of(cls, rule, at, cause.method, cause.line or None)


def _llvm_of_probe(probe: Callable[..., int], parts: Any, lanes: int) -> str:
    """Return the LLVM code of a probe for this number of members side by side."""
    signature = signature_of(KernelKey(probe, parts, "float64", lanes, "s"))
    return str(lower(probe, signature.args, signature.return_type).library.get_llvm_str())


def _probe_observable(tree, numbers, at):
    """Compiled to find out whether all methods of an observable run on vectors."""
    observable, effects = tree_unpack(tree, numbers)
    effects_here = tree_unflatten(effects, at, 30)
    body, q, l, t, _ = state_at(at)
    put_rows(value(observable, body, effects_here, t, q, l, four_at(at, 8), ()), at, 0)
    height = level(observable, body, effects_here, t, q, l)
    waits = armed(observable, body, q, l, height, height < 0.0)
    put_rows(
        (select(waits, 1.0, 0.0), select(counts_at_start(observable, height), 1.0, 0.0)), at, 0
    )
    totals = begin(observable, body, effects_here, t, q, l)
    put_rows(update(observable, totals, body, effects_here, t, q, l), at, 0)
    put_rows(extrema(observable, body, effects_here, t, q, l), at, 0)
    put_pairs(extremum_limits(observable, totals), at)
    put_rows(merged(observable, totals, totals, totals), at, 0)
    put_rows(reweighed(observable, totals, t), at, 0)
    return (
        len(is_time_average(observable))
        + len(is_conserved(observable))
        + len(is_terminal(observable))
    )


def put_pairs(pairs, at):
    """Write pairs of numbers."""
    if len(pairs) == 0:
        return 0
    put_rows(pairs[0], at, 0)
    return put_pairs(pairs[1:], at)


def _probe_integrator(tree, numbers, at):
    """Compiled to find out whether a step runs on vectors."""
    integrator, effects = tree_unpack(tree, numbers)
    present = tree_unflatten(effects, at, 30)
    body, q, l, t, h = state_at(at)
    substep = h, h, h
    q, l = to_stepping(integrator, body, present, t, substep, q, l)
    constants_of_step = precompute(integrator, body, substep, l)
    q, l = step(integrator, body, present, t, h, substep, q, l, constants_of_step)
    q, l = from_stepping(integrator, body, present, t, substep, q, l)
    put_rows(q + first_three(l), at, 0)
    return 0


inline_all(sys.modules[__name__])
