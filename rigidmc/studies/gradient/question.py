"""What a gradient asks, and the way to each derivative: by the path of members, or by a score."""

from collections.abc import Sequence
from typing import NamedTuple

import xarray as xr

from rigidmc.errors import OptionError, nearest
from rigidmc.scene import derivatives
from rigidmc.scene.model import Model
from rigidmc.scene.recording import Recording
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Measure, Variables, measure
from rigidmc.studies.gradient.scores import scores_of_model, scores_of_noise, why_no_noise_score

ENDS = "_final", "_last"  # of names of observables at the end


class Asked(NamedTuple):
    """A measure, and the observable at the end or the result over all steps that it uses and by
    which members have derivatives; "" for other variables."""

    measure: Measure
    observable: str

    @staticmethod
    def of(text: str, variables: Variables, recording: Recording, may_save_more: bool) -> "Asked":
        """Parse a measure; OptionError."""
        asked = measure(text, variables, may_save_more)
        name = asked.result.name
        base, _, end = name.rpartition("_")
        if f"_{end}" in ENDS and base in recording.names:
            return Asked(asked, base)
        # times of events jump
        is_smooth = name in recording.differentiable and not asked.result.timed
        return Asked(asked, name if is_smooth else "")


class Question(NamedTuple):
    """The measures of a gradient, the parameters, vectors by component, and the estimator of each
    measure by each parameter: "path" or "score"."""

    model: Model
    asked: list[Asked]
    names: tuple[str, ...]
    ways: list[list[str]]

    @staticmethod
    def of(
        scene: Scene, texts: Sequence[str], wrt: Sequence[str], method: str, variables: Variables,
        may_save_more: bool,
    ) -> "Question":  # fmt: skip
        """Read measures and parameters; OptionError for a measure without a derivative, SceneError
        for an unknown parameter.

        variables, may_save_more : as in `rigidmc.statistics.measures.measure`
        """
        asked = [Asked.of(text, variables, scene.recording, may_save_more) for text in texts]
        scores, names = scores_of_model(scene.model), dict[str, None]()
        for name in wrt:
            if name in scores:
                names[name] = None
            else:
                names |= dict.fromkeys(derivatives.parameters_of_run(scene.model, (name,)))
        able = set(derivatives.parameter_names_of_derivatives(scene.model))
        ways = [[_way(scene.model, x, name, method, able) for name in names] for x in asked]
        return Question(scene.model, asked, tuple(names), ways)

    def by(self, way: str) -> tuple[str, ...]:
        """Return the parameters by which an estimator differentiates."""
        places = enumerate(self.names)
        return tuple(name for j, name in places if any(row[j] == way for row in self.ways))

    def by_noise(self) -> list[str]:
        """Return the parameters of noise by which a likelihood ratio differentiates."""
        return [name for name in self.by("score") if name in scores_of_noise(self.model.effects)]

    def refuse_lacking(self, part: xr.Dataset) -> None:
        """Raise OptionError for derivatives or scores of noise that a stored result lacks."""
        has = set(map(str, part.parameter.values)) if "parameter" in part.coords else set()
        for (_, observable), row in zip(self.asked, self.ways, strict=True):
            for name, way in zip(self.names, row, strict=True):
                lacks = name not in has or derivatives.derivative_name(observable) not in part
                if way == "path" and lacks:
                    rule = f"the result has no derivatives of {observable} by {name}"
                    raise OptionError(f"{rule}: run it with --wrt {name}", at="wrt", value=name)
        for name in self.by_noise():
            if scores_of_noise(self.model.effects)[name] not in part:
                rule = "the result has no score of its noise: run it with --save noise_score"
                raise OptionError(rule, at="wrt", value=name)


def _way(model: Model, asked: Asked, name: str, method: str, able: set[str]) -> str:
    """Return the estimator of a measure by a parameter; OptionError if there is none.

    able : parameters by which members have derivatives
    """
    no_path = why_no_path(asked)
    if not no_path and name not in able:
        no_path = f"{name} has no derivative at fixed random numbers"
    if not no_path and method != "score":
        return "path"
    no_score = why_no_score(model, asked.measure, name)
    if not no_score and method != "path":
        return "score"
    reasons = {"path": (no_path,), "score": (no_score,), "auto": (no_path, no_score)}[method]
    rule = f"has no derivative by {name}: {'; '.join(reasons)}"
    raise OptionError(rule, at="of", value=asked.measure.text)


def why_no_path(asked: Asked) -> str:
    """Return the reason why a measure has no derivative by the path; "" if it has."""
    kind, name = asked.measure.kind, asked.measure.result.name
    if kind == "p":
        return "members jump from 0 to 1, so that their derivatives are 0 and miss the change of p"
    if kind == "correlation":
        return "a correlation is not a mean of members"
    if asked.measure.given is not None:
        return "members jump across the condition, which their derivatives miss"
    if not asked.observable:
        return (
            f"{name} has no derivative of a member: use an observable at the end, as energy_last,"
            " or over the steps, as energy_mean"
        )
    return ""


def why_no_score(model: Model, asked: Measure, name: str) -> str:
    """Return the reason why a measure has no likelihood ratio by a parameter; "" if it has."""
    if asked.kind not in ("p", "mean"):
        return "the likelihood ratio requires a mean or p(NAME >= NUMBER)"
    scores = scores_of_model(model)
    if name in scores:
        score = scores[name][1]
        return f"{name} {score}" if isinstance(score, str) else ""
    no_noise = why_no_noise_score(model, name)
    if name in scores_of_noise(model.effects):
        return no_noise
    able = [key for key, (_, score) in scores.items() if not isinstance(score, str)]
    way = nearest(name, able) or next((k for k in able if k.startswith(f"{name}.")), "")
    hint = f", such as {way or able[0]}" if able else "; this scene draws no such number"
    rule = f"the likelihood ratio requires a parameter of a distribution of numbers{hint}"
    return f"{rule}; {no_noise}" if no_noise else rule
