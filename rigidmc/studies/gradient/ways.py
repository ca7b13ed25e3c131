"""What a gradient asks, and the way to each derivative: by the path of members, or by a score."""

from collections.abc import Sequence
from typing import NamedTuple

from rigidmc.errors import OptionError, nearest
from rigidmc.scene.derivatives import parameter_names_of_derivatives
from rigidmc.scene.recording import make_recording
from rigidmc.scene.scene import Scene
from rigidmc.statistics.measures import Measure, Variables, measure
from rigidmc.studies.gradient.scores import (
    scores_of_noise,
    scores_of_scene,
    why_no_noise_score,
)

ENDS = "_final", "_last"  # of names of observables at the end


class Asked(NamedTuple):
    """A measure, and the observable at the end or the result over all steps that it uses and by
    which members have derivatives; "" for other variables."""

    measure: Measure
    observable: str


def asked_of(text: str, variables: Variables, scene: Scene, may_save_more: bool) -> Asked:
    """Parse a measure; OptionError."""
    found = measure(text, variables, may_save_more)
    name = found.result.name
    base, _, end = name.rpartition("_")
    if f"_{end}" in ENDS and base in make_recording(scene).names:
        return Asked(found, base)
    is_smooth = name in make_recording(scene).differentiable
    return Asked(
        found, name if is_smooth and not found.result.timed else ""
    )  # times of events jump


def ways(
    scene: Scene, asked: Sequence[Asked], names: Sequence[str], method: str
) -> list[list[str]]:
    """Return the estimator of each measure by each parameter; OptionError where there is none."""
    able = set(parameter_names_of_derivatives(scene.model))
    return [[_way(scene, one, name, method, able) for name in names] for one in asked]


def _way(scene: Scene, one: Asked, name: str, method: str, able: set[str]) -> str:
    no_path = why_no_path(one)
    if not no_path and name not in able:
        no_path = f"{name} has no derivative at fixed random numbers"
    if not no_path and method != "score":
        return "path"
    no_score = why_no_score(scene, one.measure, name)
    if not no_score and method != "path":
        return "score"
    reasons = {"path": (no_path,), "score": (no_score,), "auto": (no_path, no_score)}[method]
    raise OptionError(
        f"has no derivative by {name}: {'; '.join(reasons)}", at="of", value=one.measure.text
    )


def why_no_path(one: Asked) -> str:
    """Return the reason why a measure has no derivative by the path; "" if it has."""
    kind, name = one.measure.kind, one.measure.result.name
    if kind == "p":
        return "members jump from 0 to 1, so that their derivatives are 0 and miss the change of p"
    if kind == "correlation":
        return "a correlation is not a mean of members"
    if one.measure.given is not None:
        return "members jump across the condition, which their derivatives miss"
    if not one.observable:
        return (
            f"{name} has no derivative of a member: use an observable at the end, as energy_last,"
            " or over the steps, as energy_mean"
        )
    return ""


def why_no_score(scene: Scene, asked: Measure, name: str) -> str:
    """Return the reason why a measure has no likelihood ratio by a parameter; "" if it has."""
    if asked.kind not in ("p", "mean"):
        return "the likelihood ratio requires a mean or p(NAME >= NUMBER)"
    scores = scores_of_scene(scene)
    if name in scores:
        score = scores[name][1]
        return f"{name} {score}" if isinstance(score, str) else ""
    no_noise = why_no_noise_score(scene, name)
    if name in scores_of_noise(scene):
        return no_noise
    known = [key for key, (_, one) in scores.items() if not isinstance(one, str)]
    way = nearest(name, known) or next((k for k in known if k.startswith(f"{name}.")), "")
    hint = f", such as {way or known[0]}" if known else "; this scene draws no such number"
    rule = f"the likelihood ratio requires a parameter of a distribution of numbers{hint}"
    return f"{rule}; {no_noise}" if no_noise else rule
