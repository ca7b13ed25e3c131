"""What an ensemble is asked: "p(flips >= 1)", "mean(flip_wait)", "quantile(megno, 0.9)", or the name of a result, which is its mean."""

import operator
import re
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import OptionError, nearest
from rigidmc.observables import RUNNING, SUMMARIES, summary_of
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
_RELATIONS: dict[str, Any] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
}
RULE = "expected p(NAME >= NUMBER), mean(NAME), median(NAME), quantile(NAME, SHARE) or NAME, of a result with one number per member"


class Measure(NamedTuple):
    """A question to the members: kind is "p", "mean" or "quantile"; name[axis] the result that it is about."""

    text: str
    kind: str
    name: str
    axis: int | None = None
    relation: str = ""
    number: float = 0.0

    def values(self, dataset):
        """The numbers of the members (n,); for p 1 where the relation holds and 0 where not, of what is nan too: it never happened."""
        found = dataset[self.name]
        values = (found.sel(axis=self.axis) if self.axis else found).values
        return (
            _RELATIONS[self.relation](values, self.number).astype(float)
            if self.kind == "p"
            else values
        )

    def interval(self, values, good, confidence=0.95):
        """The Interval of (..., n) values of which the good ones count; where there is none it is nan."""
        if self.kind == "p":
            return intervals.probability(
                np.where(good, values, 0.0).sum(-1), good.sum(-1), confidence
            )
        kept = np.where(good, values, np.nan)
        if self.kind == "mean":
            return intervals.mean(kept, confidence=confidence)
        return intervals.quantiles(kept, self.number, confidence)


def observing(scene, texts):
    """The scene with the observables over all steps in its `save` that measures name and that need no numbers."""
    able = {name: name for name in RUNNING}
    for name, kind in SUMMARIES.items():
        if len(kind._field_defaults) == len(kind._fields):
            able |= dict.fromkeys(kind.outputs, name)
    named = [
        able[word] for text in texts for word in re.findall(r"[A-Za-z_]\w*", text) if word in able
    ]
    have = {summary_of(one) for one in scene.observables}
    more = [
        name for name in dict.fromkeys(named) if name not in have and name not in scene.run.save
    ]
    return scene.with_run(save=(*scene.run.save, *more)) if more else scene


def measure(text, variables):
    """The Measure that a text asks for; `variables` {name: dims} are those of a result. OptionError for what is none."""
    kind, found = next(
        ((kind, m) for kind, form in _FORMS.items() if (m := form.fullmatch(text.strip()))),
        ("", None),
    )
    if found is None:
        raise OptionError("", "measure", text, RULE)
    parts = found.groupdict()
    name, axis = parts["name"], parts["axis"]
    able = {
        name: dims for name, dims in variables.items() if dims in (("member",), ("axis", "member"))
    }
    if name not in able:
        known = [n for n in able if not n.startswith(("start_", "status"))]
        known += [
            n
            for kind in SUMMARIES.values()
            if not kind._fields or kind._field_defaults
            for n in kind.outputs
            if n not in known
        ]
        known += [n for n in RUNNING if n not in known]
        rule = f"no result of that name with one number per member; known: {', '.join(known)}; passages of a scene with [observables.passage]"
        raise OptionError("", "measure", text, rule, nearest(name, known))
    if (able[name] == ("axis", "member")) != bool(axis):
        raise OptionError(
            "",
            "measure",
            text,
            f"{name} has {'three components: give one, as in ' + name + '[3]' if not axis else 'no components'}",
        )
    number = float(parts.get("number") or (0.5 if kind == "median" else 0.0))
    if kind == "quantile" and not 0.0 < number < 1.0:
        raise OptionError("", "measure", text, "a quantile has a share between 0 and 1")
    kind = {"median": "quantile", "": "mean"}.get(kind, kind)
    return Measure(
        text.strip(), kind, name, int(axis) if axis else None, parts.get("relation") or "", number
    )
