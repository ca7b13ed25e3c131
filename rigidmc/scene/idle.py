"""Settings of a run that have no effect beside its other settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rigidmc.dynamics.methods import implements
from rigidmc.integrators import INTEGRATORS

if TYPE_CHECKING:
    from rigidmc.scene.settings import Run

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
