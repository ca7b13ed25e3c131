"""Validation of the parts of a scene: effects, observables and integrators, limits of their
parameters, and the variables of histograms.
"""

from collections.abc import Iterable, Sequence
from numbers import Real
from typing import Any

import numpy as np

from rigidmc.errors import PartError, SceneError, unknown
from rigidmc.inputs.arrays import as_plain_arrays
from rigidmc.inputs.units import units_text
from rigidmc.physics.dynamics.methods import implements, word_of
from rigidmc.physics.effects import EFFECTS, name_of
from rigidmc.physics.effects.protocol import Effect, facts, shape
from rigidmc.physics.integrators.protocol import Integrator
from rigidmc.physics.observables import (
    OBSERVABLES,
    bare_observables,
    find_observable,
    is_observable,
    is_opaque,
    is_own,
    own,
    saveable_names,
    word_of_observable,
)
from rigidmc.physics.observables.histogram import Histogram
from rigidmc.physics.observables.protocol import Monitored, Observable, size
from rigidmc.physics.observables.saving import why_not_saved
from rigidmc.scene.quantities import is_shared, is_variable, quantity, vector
from rigidmc.scene.units import effect_in_si, observable_in_si
from rigidmc.scene.user_parts.effects import check_effect_class
from rigidmc.scene.user_parts.integrators import known_facts
from rigidmc.scene.vector_distributions import check_distribution
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import Correlated, parts_of


def named_integrators(integrators: Iterable[Any]) -> dict[str, Integrator]:
    """Return {name: integrator} of custom integrators; SceneError."""
    pairs = ((word_of(x if isinstance(x, type) else type(x)), x) for x in integrators)
    return {word: known_facts(x, word) for word, x in pairs}


def check_effect(effect: Any, driven: bool) -> Effect:
    """Return an effect with checked parameters; SceneError. driven : whether damping may be
    negative"""
    check_effect_class(effect)
    values = []
    effect = effect_in_si(effect, name_of(effect))
    for name, value in zip(effect._fields, effect, strict=True):
        at = f"effects.{name_of(effect)}.{name}"
        size, (low, high) = shape(effect, name), parameter_limits(effect, name, driven)
        value = as_plain_arrays(value, at) if size is None else value
        if isinstance(value, str) or (size is None and isinstance(value, (tuple, list))):
            raise SceneError(_one_number(effect, name, value), at=at, value=value)
        if isinstance(value, VectorDistribution):
            quantities: Any = _components(value, at, size)
        else:
            quantities = quantity(value, at) if size is None else vector(value, at, size)
        for part in (quantities,) if size is None else quantities:
            if not is_variable(part) and not (low <= np.min(part) and np.max(part) <= high):
                wrong = float(np.min(part) if np.min(part) < low else np.max(part))
                raise SceneError(outside(effect, low, high), at=at, value=wrong)
        values.append(quantities)
    checked: Effect = type(effect)(*values)
    return checked


def _components(value: VectorDistribution, at: str, size: int | None) -> tuple[Any, ...]:
    """Return the components of a Correlated vector; SceneError for anything else."""
    checked = check_distribution(value, at) if size == 3 else None
    if not isinstance(checked, Correlated) or not is_shared(*checked.mean):
        rule = "expected numbers or distributions of numbers; a vector may be Correlated"
        raise SceneError(rule, at=at, value=value)
    return parts_of(checked)


def _one_number(effect: Any, name: str, value: Any) -> str:
    """Return the rule broken by text, or by several numbers in place of one."""
    kind, unit = type(effect), facts(effect).units.get(name, "1")
    if kind not in EFFECTS.values() and not isinstance(value, str):
        how = f'@effect(shapes={{"{name}": {len(value)}}})'
        return f"a field that is a tuple needs its length: {how}"
    size, hint = shape(effect, name), f' in {unit}, or text such as "1.5 {units_text(unit)}"'
    what = "one number" if size is None else f"{size} numbers"
    summary = (kind.__doc__ or "").splitlines()[0].rstrip(".")
    return f"expected {what}{hint * (unit != '1')}; {kind.__name__}: {summary}"


def observable_order(observable: Any) -> int:
    """Return the position of an observable among the shipped ones; custom observables come last."""
    names = [*OBSERVABLES, word_of_observable(observable)]
    return names.index(names[-1])


def check_observable(observable: Any) -> Monitored | Observable:
    """Return an observable with checked parameters; SceneError."""
    bare = bare_observables().values()
    if not is_observable(observable) or type(observable) in bare:
        shipped = ", ".join(kind.__name__ for kind in OBSERVABLES.values() if kind not in bare)
        rule = f"expected one of {shipped}, or a custom observable, with its parameters"
        raise SceneError(rule, at="observables.observable", value=observable)
    word = word_of_observable(observable)
    if is_own(observable) and word in saveable_names():
        rule = f"'{word}' is an observable of the package: give the class another name"
        raise PartError.of(observable, rule, "observables")
    observable = observable_in_si(observable, word)
    integers = {}  # 1e2 bins are 100 bins
    for name, kind in type(observable).__annotations__.items():
        value = as_plain_arrays(getattr(observable, name), f"observables.{word}.{name}")
        real = isinstance(value, Real) and not isinstance(value, bool)
        if kind is int and real and float(value) == float(value) // 1:
            integers[name] = int(value)
    checked: Monitored | Observable = observable._replace(**integers)
    if not isinstance(checked, Observable) or implements(checked, "check"):
        checked.check()  # type: ignore[union-attr]
    return checked


def check_saved_names(names: Iterable[str], observables: Sequence[Any]) -> None:
    """Raise SceneError for unknown names, for observables without required parameters, and for two
    classes with one name."""
    kinds: dict[str, type] = {}
    for observable in observables:
        word, kind = word_of_observable(observable), type(observable)
        if kinds.setdefault(word, kind) is not kind:
            rule = f"two classes have the name '{word}': rename one of them"
            raise PartError.of(kind, rule, "observables")
    for name in names:
        if name not in (names_known := saveable_names(observables)):
            if reason := why_not_saved(name, observables):
                raise SceneError(reason, at="run.save", value=name)
            raise unknown("observable", names_known, at="run.save", value=name)
        shipped = OBSERVABLES.get(name)
        if shipped is not None and name not in kinds:
            missing = [f for f in shipped._fields if f not in shipped._field_defaults]
            if missing:
                rule = f"needs a table [observables.{name}] with {', '.join(missing)}"
                raise SceneError(rule, at="run.save", value=name)


# number of members whose sampled values are checked before a run; always the first ones, so that no
# result depends on the number of members
PILOT = 4096
ALLOWED = "needs anti_damping = true under [run]"


def check_histogram(wanted: Histogram, observables: Sequence[Any]) -> None:
    """Raise SceneError if a histogram names an unknown observable or component.

    observables : of the scene, with their parameters
    """
    at = "observables.histogram.of"
    if any(is_opaque(x) and word_of_observable(x) == wanted.name for x in observables):
        return
    words = [name for name in (*bare_observables(), *own(observables)) if name != "work"]
    if wanted.name not in words:
        raise unknown("observable", words, at=at, value=wanted.name)
    count = size(find_observable(observables, wanted.name).dims)
    if (count > 1) != wanted.of.endswith("]") or wanted.component >= count:
        rule = f"{wanted.name} has no components"
        if count > 1:
            rule = f"{wanted.name} has {count} components: choose one, as in {wanted.name}[{count}]"
        raise SceneError(rule, at=at, value=wanted.of)


def parameter_limits(effect: Effect | type[Effect], name: str, driven: bool) -> tuple[float, float]:
    """Return (least, largest) value of a parameter. driven : whether damping may be negative"""
    low, high = facts(effect).limits.get(name, (-np.inf, np.inf))
    return (0.0 if low == -np.inf and facts(effect).is_damping and not driven else low), high


def outside(effect: Effect, low: float, high: float) -> str:
    """Return the rule broken by a parameter outside its limits."""
    if low == high:  # a hidden parameter
        return "is set internally, not by the user"
    more = ""
    if low == 0.0 and facts(effect).is_damping:
        more = f"; below 0 it drives the body, which {ALLOWED}"
    return f"must lie between {low:g} and {high:g}{more}"
