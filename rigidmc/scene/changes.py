"""Changes of run settings, and settings that have no effect beside other settings."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from rigidmc.dynamics.methods import implements
from rigidmc.integrators import INTEGRATORS
from rigidmc.scene.settings import Run, complaint

# turn_rate stays in a run even if an override leaves it without effect, because `auto` tries
# integrators that use it.
STAYS = {"turn_rate"}
_LIMITS = ("energy_limit", "momentum_limit", "turn_limit")


def idle(run: Run) -> dict[str, str]:
    """{setting: why it has no effect}, without settings at their default: a stored scene lists
    all of them."""
    fields = type(run).model_fields
    return {
        key: why for key, why in _without_effect(run) if getattr(run, key) != fields[key].default
    }


def _without_effect(run: Run) -> Iterator[tuple[str, str]]:
    """(setting, why) of all settings that a run does not use."""
    auto, closed = run.integrator == "auto", run.integrator == "closed"
    words = run.keep.values() if isinstance(run.keep, dict) else (run.keep,)
    if not auto:
        rule = f'integrator = "{run.integrator}" keeps no tolerance: leave it out, or take "auto"'
        yield "tolerance", rule
        if not implements(INTEGRATORS.get(run.integrator), "prepared"):
            yield "turn_rate", f'integrator = "{run.integrator}" does not use it'
    if auto:
        yield from ((key, 'integrator = "auto" chooses it') for key in ("dt", "turn", "dtype"))
    if closed:  # dt gets no note: results in closed form are stored with one
        yield from ((key, "closed forms make no steps") for key in ("turn", "dtype", *_LIMITS))
    elif not run.checks:
        rule = "with checks = false only non-finite members are flagged"
        yield from ((key, rule) for key in _LIMITS)
    if run.points != "latin_hypercube":
        yield "strata", 'only points = "latin_hypercube" have strata'
    if "thinned" not in words:
        yield "thin", "nothing is kept thinned"


def changed(run: Run, given: Mapping[str, Any]) -> Run:
    """A Run with the settings `given` in place of its own; SceneError.

    A tolerance replaces integrator and step, and `turn` replaces dt. Settings that lose their
    effect by the change return to their defaults.
    """
    if given.get("tolerance") is not None:
        given = {"integrator": "auto", **given}
    replaced = {"turn"} if "dt" in given else {"dt"} if "turn" in given or run.turn else set()
    kept = run.model_dump(exclude=replaced, exclude_unset=True)
    if "save" in given and isinstance(run.keep, dict):
        kept["keep"] = {name: word for name, word in run.keep.items() if name in given["save"]}
    settings = {**kept, **given}
    try:
        new = Run.model_validate(settings)
        lost = idle(new).keys() - idle(run).keys() - given.keys() - STAYS
        return Run.model_validate({k: v for k, v in settings.items() if k not in lost})
    except ValidationError as error:
        raise complaint(error, "run", Run, given) from None
