"""What an ensemble is asked: "p(flips >= 1)", "mean(flip_wait | flips >= 2)", and so on."""

import operator
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, nearest
from rigidmc.observables import WATCHED, WATCHED_STATISTICS, statistics, word_of_observable
from rigidmc.scene.scene import Scene
from rigidmc.studies import intervals

_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


def _variable(of: str = "") -> str:
    return rf"(?P<{of}name>[A-Za-z_][A-Za-z0-9_]*)(\[(?P<{of}axis>[123])\])?"


def _comparison(of: str = "") -> str:
    return rf"{_variable(of)}\s*(?P<{of}relation>>=|<=|>|<|==)\s*(?P<{of}number>{_NUMBER})"


_GIVEN = rf"(\|\s*{_comparison('given_')}\s*)?"
_FORMS = {
    "p": re.compile(rf"p\(\s*{_comparison()}\s*{_GIVEN}\)"),
    "mean": re.compile(rf"mean\(\s*{_variable()}\s*{_GIVEN}\)"),
    "quantile": re.compile(rf"quantile\(\s*{_variable()}\s*,\s*(?P<number>{_NUMBER})\s*{_GIVEN}\)"),
    "median": re.compile(rf"median\(\s*{_variable()}\s*{_GIVEN}\)"),
    "correlation": re.compile(
        rf"correlation\(\s*{_variable()}\s*,\s*{_variable('other_')}\s*{_GIVEN}\)"
    ),
    "": re.compile(_variable()),
}
_RELATIONS: dict[str, Callable[[Any, float], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}
RULE = (
    "expected p(NAME >= NUMBER), mean(NAME), median(NAME), quantile(NAME, SHARE),"
    " correlation(NAME, NAME) or NAME,"
    " of a result with one number per member; with a condition as in mean(NAME | OTHER >= NUMBER)"
)


class Result(NamedTuple):
    """A result name[axis] with one number per member, or one of its three components."""

    name: str
    axis: int | None = None

    def values(self, dataset: xr.Dataset) -> NDArray[np.float64]:
        """The numbers of the members (n,)."""
        result = dataset[self.name]
        values: NDArray[np.float64] = (result.sel(axis=self.axis) if self.axis else result).values
        return values


class Condition(NamedTuple):
    """A relation of a result and a number, such as flips >= 1."""

    result: Result
    relation: str
    number: float

    def holds(self, dataset: xr.Dataset) -> NDArray[np.bool_]:
        """Whether it holds for each member (n,): not for nan, an event that did not happen."""
        values = self.result.values(dataset)
        found: NDArray[np.bool_] = _RELATIONS[self.relation](values, self.number)
        return found


class Measure(NamedTuple):
    """A question to the members about a result.

    kind : "p" (with relation and number), "mean", "quantile" (with number), or "correlation" (with
        other, the second result)
    given : the members that are asked; None for all
    """

    text: str
    kind: str
    result: Result
    relation: str = ""
    number: float = 0.0
    other: Result | None = None
    given: Condition | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The results that are needed."""
        more = self.other, self.given and self.given.result
        return (self.result.name, *(one.name for one in more if one is not None))

    @property
    def dtype(self) -> str:
        """Of `values`; 0, 1 and nan take a quarter of the memory of other numbers."""
        return {"p": "f2", "correlation": "c16"}.get(self.kind, "f8")

    def values(self, dataset: xr.Dataset) -> NDArray[Any]:
        """The numbers of the members (n,), nan for those that are not asked.

        For p 1 if the relation holds, else 0; also 0 for nan, an event that did not happen. For a
        correlation the two results of a member as one complex number.
        """
        values: NDArray[Any] = self.result.values(dataset)
        if self.kind == "p":
            values = Condition(self.result, self.relation, self.number).holds(dataset)
        elif self.other is not None:
            values = values + 1j * self.other.values(dataset)
        if self.given is not None:
            values = np.where(self.given.holds(dataset), values, np.nan)
        return values.astype(self.dtype)

    def interval(
        self, values: NDArray[Any], good: NDArray[np.bool_], confidence: float = 0.95
    ) -> intervals.Interval:
        """The Interval of the good ones of values (..., n); nan if there is none."""
        if self.kind == "p":
            asked = good & ~np.isnan(values)
            successes = (asked & (values == 1.0)).sum(-1)
            return intervals.probability(successes, asked.sum(-1), confidence)
        values = np.where(good, values, np.nan)
        if self.kind == "correlation":
            return intervals.correlation(values.real, values.imag, confidence)
        if self.kind == "mean":
            return intervals.mean(values, confidence=confidence)
        return intervals.quantiles(values, self.number, confidence)


def observing(scene: Scene, texts: Iterable[str]) -> Scene:
    """The scene that also saves the observables over all steps that measures name.

    Only observables without obligatory parameters are added.
    """
    observable = {name: name for name in statistics(scene.observables)}
    for name, kind in WATCHED.items():
        if len(kind._field_defaults) == len(kind._fields):
            observable |= dict.fromkeys(kind.outputs, name)
    words = [word for text in texts for word in re.findall(r"[A-Za-z_]\w*", text)]
    present = {word_of_observable(one) for one in scene.observables} | set(scene.run.save)
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
    number = float(parts.get("number") or (0.5 if kind == "median" else 0.0))
    if kind == "quantile" and not 0.0 < number < 1.0:
        raise OptionError("", "measure", text, "a quantile has a share between 0 and 1")
    results = {}
    for of in ("", "other_", "given_"):
        if name := parts.get(f"{of}name"):
            axis = parts[f"{of}axis"]
            _check_axis(text, name, axis, variables, may_save_more)
            results[of] = Result(name, int(axis) if axis else None)
    given = None
    if "given_" in results:
        than = float(parts["given_number"])
        given = Condition(results["given_"], parts["given_relation"], than)
    kind = {"median": "quantile", "": "mean"}.get(kind, kind)
    relation, other = parts.get("relation") or "", results.get("other_")
    return Measure(text.strip(), kind, results[""], relation, number, other, given)


def _check_axis(
    text: str,
    name: str,
    axis: str | None,
    variables: Mapping[str, tuple[str, ...]],
    may_save_more: bool,
) -> None:
    """OptionError for a result that there is not, and for one without, or with too many axes."""
    dims = _dims(text, name, variables, may_save_more)
    if (dims == ("axis", "member")) != bool(axis):
        rule = f"three components: give one, as in {name}[3]" if not axis else "no components"
        raise OptionError("", "measure", text, f"{name} has {rule}")


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
