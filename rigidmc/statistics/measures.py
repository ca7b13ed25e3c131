"""Measures of an ensemble: "p(flips >= 1)", "mean(flip_wait | flips >= 2)", and so on."""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, SceneError, nearest
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.physics.observables import monitors, statistics, word_of_observable
from rigidmc.physics.observables.saving import FOLLOWED, is_event_time, owners_of_variables
from rigidmc.scene.scene import Scene
from rigidmc.scene.units import in_si
from rigidmc.statistics import censored, intervals
from rigidmc.statistics.censored import RELATIONS, Columns
from rigidmc.statistics.intervals import Estimate, Interval

_NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


def _variable(of: str = "") -> str:
    return rf"(?P<{of}name>[A-Za-z_][A-Za-z0-9_]*)(\[(?P<{of}axis>[123])\])?"


def _comparison(of: str = "") -> str:
    number = rf"(?P<{of}number>{_NUMBER})(\s*(?P<{of}unit>[A-Za-zµμ°][^|()]*))?"
    return rf"{_variable(of)}\s*(?P<{of}relation>>=|<=|>|<|==)\s*{number}"


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
RULE = (
    "expected p(NAME >= NUMBER), mean(NAME), median(NAME), quantile(NAME, NUMBER),"
    " correlation(NAME, NAME) or NAME, where NAME is a variable with one value per member; a"
    " condition is written mean(NAME | OTHER >= NUMBER)"
)


class Result(NamedTuple):
    """A variable with one value per member, or one component, name[axis], of a vector.

    timed : whether it is the time of an event, which may be later than the end of a member
    """

    name: str
    axis: int | None = None
    timed: bool = False

    def values(self, dataset: Columns) -> Array:
        """Return the values of the members (n,); signed times for events, see `censored`."""
        result = dataset[self.name]
        values: Array = (result.sel(axis=self.axis) if self.axis else result).values
        return censored.signed_times(dataset, self.name, values) if self.timed else values


class Condition(NamedTuple):
    """A relation between a variable and a number, such as flips >= 1."""

    result: Result
    relation: str
    number: float

    def answers(self, values: Array) -> Array:
        """Evaluate the condition for values of the variable: 1 where it holds, 0 where not, nan for
        members that have no value, or whose event is later than their end."""
        if self.result.timed:
            return censored.answers(values, self.relation, self.number)
        holds: Array = RELATIONS[self.relation](values, self.number).astype(float)
        if (unknown := np.isnan(values)).any():
            holds[unknown] = np.nan
        return holds


class Measure(NamedTuple):
    """A statistic of a variable of the members.

    kind : "p" (with relation and number), "mean", "quantile" (with number), or "correlation" (with
        other, the second variable)
    given : condition that selects members; None for all
    """

    text: str
    kind: str
    result: Result
    relation: str = ""
    number: float = 0.0
    other: Result | None = None
    given: Condition | None = None

    def units(self, variables: "Variables") -> str:
        """Return the units of the measure, from the variables of the members."""
        pure = self.kind in ("p", "correlation")
        return "1" if pure else str(variables[self.result.name].attrs.get("units", "1"))

    @property
    def results(self) -> tuple[Result, ...]:
        """The variables or components that the measure uses."""
        more = self.other, self.given and self.given.result
        return (self.result, *(variable for variable in more if variable is not None))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the variables that the measure uses."""
        ends = (FOLLOWED,) if any(variable.timed for variable in self.results) else ()
        return (*(variable.name for variable in self.results), *ends)

    @property
    def dtype(self) -> str:
        """The type of `values`; 0, 1 and nan take a quarter of the memory of other numbers."""
        if self.kind == "p" and not self.result.timed:
            return "f2"
        return "c16" if self.kind == "correlation" else "f8"

    def values(self, dataset: Columns) -> NDArray[Any]:
        """Return the numbers of the members (n,) from which `interval` estimates the measure.

        For p, the number is 1 if the relation holds, else 0, and nan for members without a value.
        For the time of an event, it is the signed time, see `rigidmc.statistics.censored`. For a
        correlation, it is one complex number with the two values of a member.

        Raises OptionError for a probability beyond the time until which members were followed.
        """
        values: NDArray[Any] = self.result.values(dataset)
        if self.kind == "p" and self.result.timed:
            censored.refuse_later_times(self.text, values, self.number)
        elif self.kind == "p":
            values = Condition(self.result, self.relation, self.number).answers(values)
        elif self.other is not None:
            first, other = self._plain(values), self.other.values(dataset)
            values = first + 1j * (censored.times_that_came(other) if self.other.timed else other)
        return values.astype(self.dtype)

    def outcomes(self, dataset: Columns) -> Array:
        """Return the numbers of the members (n,) whose mean is the measure, a p or a mean: for p, 1
        if the relation holds, else 0; nan for members whose number is unknown.

        Raises OptionError as `values`.
        """
        values = self.result.values(dataset)
        if self.kind == "p" and self.result.timed:
            censored.refuse_later_times(self.text, values, self.number)
            return censored.answers(values, self.relation, self.number)
        if self.kind == "p":
            return Condition(self.result, self.relation, self.number).answers(values)
        return np.asarray(self._plain(values), float)  # counts are integers

    def asks(self, dataset: Columns) -> Bools:
        """Return which members (n,) the measure selects: good members for which the condition
        holds; for the time of an event also flagged members, until the flag."""
        is_asked: Bools = dataset["status"].values == 0
        if self.result.timed and self.kind in ("p", "quantile"):
            is_asked = ~np.isnan(censored.ends_of(dataset))
        if self.given is not None:
            is_asked &= self.given.answers(self.given.result.values(dataset)) == 1.0
        return is_asked

    def numbers(self, dataset: xr.Dataset) -> Array:
        """Return the number of each single member (n,), nan for members that are flagged, not
        selected, or without a value. For p, it is 1 or 0: whether the relation holds.

        Raises OptionError as `values`, and for the mean time of an event that has not occurred in
        all members.
        """
        asked = self.asks(dataset) & (dataset.status.values == 0)
        if self.kind == "p":
            return np.where(asked, self.outcomes(dataset), np.nan)
        values = self.values(dataset)
        if self.result.timed:
            share = float(censored.share(np.where(asked, values, np.nan)))
            self._refuse(share, float(np.nanmax(np.abs(values), initial=0.0)))
        return np.where(asked, values, np.nan).astype(float)

    def interval(self, values: NDArray[Any], asked: Bools, confidence: float = 0.95) -> Estimate:
        """Return the Estimate from the values (..., n) of the selected members.

        The estimate is nan without selected members. A mean or correlation of event times is also
        nan if the event has not occurred in all of them, because the missing times are unknown.
        """
        if self.result.timed and self.kind in ("p", "mean", "quantile"):
            return self._timed(np.where(asked, values, np.nan), confidence)
        there = asked & ~np.isnan(values)
        with np.errstate(all="ignore"):
            without = 1.0 - there.sum(-1) / asked.sum(-1)
        if self.kind == "p":
            successes = (there & (values == 1.0)).sum(-1)
            interval = intervals.probability(successes, there.sum(-1), confidence)
        elif self.kind == "correlation":
            values = np.where(there, values, np.nan)
            interval = intervals.correlation(values.real, values.imag, confidence)
            if any(variable.timed for variable in self.results[:2]):
                is_known = without == 0.0
                interval = Interval(*(np.where(is_known, x, np.nan) for x in interval))
        elif self.kind == "mean":
            interval = intervals.mean(np.where(there, values, np.nan), confidence=confidence)
        else:
            values = np.where(there, values, np.nan)
            interval = intervals.quantiles(values, self.number, confidence)
        return Estimate(*interval, without)

    def _timed(self, times: Array, confidence: float) -> Estimate:
        """Return the Estimate of an event time, from signed times (..., n)."""
        if self.kind == "p":
            return censored.censored_probability(times, self.relation, self.number, confidence)
        if self.kind == "quantile":
            return censored.censored_quantile(times, self.number, confidence)
        interval = intervals.mean(times, confidence=confidence)
        none = censored.is_censored(times).any(-1)
        return censored.as_estimate(times, *(np.where(none, np.nan, x) for x in interval))

    def refuse_unknown(self, estimate: Estimate) -> None:
        """Raise OptionError for the mean or correlation of the time of an event that has not
        occurred in all members: the mean over the members with the event is a different number."""
        if self.kind in ("mean", "correlation") and any(v.timed for v in self.results[:2]):
            self._refuse(float(estimate.without), float(estimate.until))

    def _refuse(self, without: float, until: float) -> None:
        """Raise the error of `refuse_unknown`."""
        if not without > 0.0:
            return
        name = next(variable.name for variable in self.results if variable.timed)
        end, some = ("by the end", "T_END") if until != until else (f"by {until:g} s", f"{until:g}")
        rule = (
            f"{100.0 * without:.3g} % of the members have no {name} {end}, so the value is unknown:"
            f" use median({name}), quantile({name}, NUMBER) or p({name} <= NUMBER), or select the"
            f" members that have one with the condition `| {name} <= {some}`"
        )
        raise OptionError(rule, at="measure", value=self.text)

    def _plain(self, values: Array) -> Array:
        """Return the values, with nan for censored times."""
        return censored.times_that_came(values) if self.result.timed else values


def save_for_measures(scene: Scene, texts: Iterable[str]) -> Scene:
    """Return the scene with the monitored observables that measures name added to its saves.

    Only observables without required parameters are added.
    """
    observable = {name: name for name in statistics(scene.observables)}
    for name, kind in monitors().items():
        if len(kind._field_defaults) == len(kind._fields):
            observable |= dict.fromkeys(kind.outputs, name)
    words = [word for text in texts for word in re.findall(r"[A-Za-z_]\w*", text)]
    present = {*map(word_of_observable, scene.observables), *scene.run.save}
    named = dict.fromkeys(observable[word] for word in words if word in observable)
    missing = [name for name in named if name not in present]
    if not missing:
        return scene
    more: Scene = scene.with_run(save=(*scene.run.save, *missing))
    return more


class Known(Protocol):
    """A variable with dimensions and attributes."""

    @property
    def dims(self) -> tuple[Any, ...]: ...

    @property
    def attrs(self) -> dict[str, Any]: ...


Variables = Mapping[Any, Known]  # {name: variable} of a scene or an existing result


def measure(text: str, variables: Variables, may_save_more: bool = True) -> Measure:
    """Parse the text of a measure; OptionError if it is not a measure.

    variables : of a result;  may_save_more : whether the result is yet to be computed
    """
    matches = ((kind, form.fullmatch(text.strip())) for kind, form in _FORMS.items())
    kind, match = next(((kind, m) for kind, m in matches if m), ("", None))
    if match is None:
        raise OptionError(RULE, at="measure", value=text)
    parts = match.groupdict()
    if any(math.isinf(float(x)) for key, x in parts.items() if x and key.endswith("number")):
        raise OptionError("expected numbers below 1.8e308", at="measure", value=text)
    number = float(parts.get("number") or (0.5 if kind == "median" else 0.0))
    if kind == "quantile" and not 0.0 < number < 1.0:
        raise OptionError("a quantile needs a number between 0 and 1", at="measure", value=text)
    results = {}
    for of in ("", "other_", "given_"):
        if name := parts.get(f"{of}name"):
            axis = parts[f"{of}axis"]
            _check_axis(text, name, axis, variables, may_save_more)
            timed = is_event_time(name, variables[name].attrs)
            results[of] = Result(name, int(axis) if axis else None, timed)
    if unit := parts.get("unit"):
        number = _in_si(text, number, unit, variables[results[""].name])
    condition = None
    if "given_" in results:
        than = float(parts["given_number"])
        if unit := parts.get("given_unit"):
            than = _in_si(text, than, unit, variables[results["given_"].name])
        condition = Condition(results["given_"], parts["given_relation"], than)
    kind = {"median": "quantile", "": "mean"}.get(kind, kind)
    relation, other = parts.get("relation") or "", results.get("other_")
    return Measure(text.strip(), kind, results[""], relation, number, other, condition)


def _in_si(text: str, number: float, unit: str, variable: Any) -> float:
    """Return the number of a comparison in the units of its variable; OptionError."""
    try:
        units = str(variable.attrs.get("units", "1"))
        return float(in_si(f"{number!r} {unit}", units, "measure"))
    except SceneError as error:
        raise OptionError(error.rule, at="measure", value=text, nearest=error.nearest) from None


def _check_axis(
    text: str, name: str, axis: str | None, variables: Variables, may_save_more: bool
) -> None:
    """Raise OptionError for an unknown variable, and for a missing or superfluous component."""
    dims = _dims(text, name, variables, may_save_more)
    if (dims == ("axis", "member")) != bool(axis):
        rule = f"three components: choose one, as in {name}[3]" if not axis else "no components"
        raise OptionError(f"{name} has {rule}", at="measure", value=text)


def _dims(text: str, name: str, variables: Variables, may_save_more: bool) -> tuple[str, ...]:
    """Return the dimensions of a variable with one value, or three components, per member;
    OptionError."""
    shapes = (("member",), ("axis", "member"))
    able = {str(name): tuple(map(str, variable.dims)) for name, variable in variables.items()}
    able = {name: dims for name, dims in able.items() if dims in shapes}
    if name in able:
        return able[name]
    names = [n for n in able if not n.startswith(("start_", "status"))]
    owned = [variable for variable, owner in owners_of_variables().items() if owner == name]
    owned = owned or [n for n in statistics() if n.rpartition("_")[0] == name]
    if owned and name not in owned:
        rule = f"{name} is an observable: use one of its variables, {', '.join(owned)}"
        raise OptionError(rule, at="measure", value=text)
    if not may_save_more:
        rule = f"no such variable with one value per member; known: {', '.join(names)}"
        more = f"{rule}; `rigidmc run SCENE --save NAME` saves more"
        raise OptionError(more, at="measure", value=text, nearest=nearest(name, names))
    free = [k for k in monitors().values() if not k._fields or k._field_defaults]
    names += [n for kind in free for n in kind.outputs]
    names = list(dict.fromkeys([*names, *statistics()]))
    rule = (
        f"no such variable with one value per member; known: {', '.join(names)};"
        " passages in a scene with [observables.passage]"
    )
    raise OptionError(rule, at="measure", value=text, nearest=nearest(name, names))
