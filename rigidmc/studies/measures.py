"""What an ensemble is asked: "p(flips >= 1)", "mean(flip_wait)", "quantile(megno, 0.9)"."""

import operator
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.observables import WATCHED, WATCHED_STATISTICS, word_of_watched
from rigidmc.scene.scene import Scene
from rigidmc.studies import intervals

_VARIABLE = r"(?P<name>[A-Za-z_][A-Za-z0-9_]*)(\[(?P<axis>[123])\])?"
_NUMBER = r"(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)"
_FORMS = {
    "p": re.compile(rf"p\(\s*{_VARIABLE}\s*(?P<relation>>=|<=|>|<|==)\s*{_NUMBER}\s*\)"),
    "mean": re.compile(rf"mean\(\s*{_VARIABLE}\s*\)"),
    "quantile": re.compile(rf"quantile\(\s*{_VARIABLE}\s*,\s*{_NUMBER}\s*\)"),
    "median": re.compile(rf"median\(\s*{_VARIABLE}\s*\)"),
    "": re.compile(_VARIABLE),
}
_RELATIONS: dict[str, Callable[[Any, float], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}
RULE = (
    "expected p(NAME >= NUMBER), mean(NAME), median(NAME), quantile(NAME, SHARE) or NAME,"
    " of a result with one number per member"
)


class Measure(NamedTuple):
    """A question to the members about the result name[axis].

    kind : "p" (with relation and number), "mean", or "quantile" (with number)
    """

    text: str
    kind: str
    name: str
    axis: int | None = None
    relation: str = ""
    number: float = 0.0

    def values(self, dataset: xr.Dataset) -> NDArray[np.float64]:
        """The numbers of the members (n,).

        For p 1 if the relation holds, else 0; also 0 for nan, an event that did not happen.
        """
        result = dataset[self.name]
        values = (result.sel(axis=self.axis) if self.axis else result).values
        if self.kind != "p":
            return values
        holds: NDArray[np.float64] = _RELATIONS[self.relation](values, self.number).astype(float)
        return holds

    def interval(
        self, values: NDArray[np.float64], good: NDArray[np.bool_], confidence: float = 0.95
    ) -> intervals.Interval:
        """The Interval of the good ones of values (..., n); nan if there is none."""
        if self.kind == "p":
            successes = np.where(good, values, 0.0).sum(-1)
            return intervals.probability(successes, good.sum(-1), confidence)
        values = np.where(good, values, np.nan)
        if self.kind == "mean":
            return intervals.mean(values, confidence=confidence)
        return intervals.quantiles(values, self.number, confidence)


def observing(scene: Scene, texts: Iterable[str]) -> Scene:
    """The scene that also saves the observables over all steps that measures name.

    Only observables without obligatory parameters are added.
    """
    observable = {name: name for name in WATCHED_STATISTICS}
    for name, kind in WATCHED.items():
        if len(kind._field_defaults) == len(kind._fields):
            observable |= dict.fromkeys(kind.outputs, name)
    words = [word for text in texts for word in re.findall(r"[A-Za-z_]\w*", text)]
    present = {word_of_watched(one) for one in scene.observables} | set(scene.run.save)
    named = dict.fromkeys(observable[word] for word in words if word in observable)
    missing = [name for name in named if name not in present]
    if not missing:
        return scene
    more: Scene = scene.with_run(save=(*scene.run.save, *missing))
    return more


def measure(
    text: str, variables: Mapping[str, tuple[str, ...]], may_save_more: bool = True
) -> Measure:
    """The Measure that a text asks for; OptionError if it asks for none.

    variables : {name: dims} of a result;  may_save_more : whether it is still to be computed
    """
    matches = ((kind, form.fullmatch(text.strip())) for kind, form in _FORMS.items())
    kind, match = next(((kind, m) for kind, m in matches if m), ("", None))
    if match is None:
        raise OptionError("", "measure", text, RULE)
    parts = match.groupdict()
    name, axis = parts["name"], parts["axis"]
    dims = _dims(text, name, variables, may_save_more)
    if (dims == ("axis", "member")) != bool(axis):
        rule = f"three components: give one, as in {name}[3]" if not axis else "no components"
        raise OptionError("", "measure", text, f"{name} has {rule}")
    number = float(parts.get("number") or (0.5 if kind == "median" else 0.0))
    if kind == "quantile" and not 0.0 < number < 1.0:
        raise OptionError("", "measure", text, "a quantile has a share between 0 and 1")
    kind = {"median": "quantile", "": "mean"}.get(kind, kind)
    relation = parts.get("relation") or ""
    return Measure(text.strip(), kind, name, int(axis) if axis else None, relation, number)


def _dims(
    text: str, name: str, variables: Mapping[str, tuple[str, ...]], may_save_more: bool
) -> tuple[str, ...]:
    """The dimensions of a result with one number, or three components, per member; OptionError."""
    shapes = (("member",), ("axis", "member"))
    able = {name: dims for name, dims in variables.items() if dims in shapes}
    if name in able:
        return able[name]
    known = [n for n in able if not n.startswith(("start_", "status"))]
    if not may_save_more:
        rule = f"the result has no such number of its members; known: {', '.join(known)}"
        more = f"{rule}; `rigidmc run SCENE --save NAME` saves more"
        raise OptionError("", "measure", text, more, nearest(name, known))
    free = [k for k in WATCHED.values() if not k._fields or k._field_defaults]
    known += [n for kind in free for n in kind.outputs]
    known = list(dict.fromkeys([*known, *WATCHED_STATISTICS]))
    rule = (
        f"no result of that name with one number per member; known: {', '.join(known)};"
        " passages of a scene with [observables.passage]"
    )
    raise OptionError("", "measure", text, rule, nearest(name, known))
