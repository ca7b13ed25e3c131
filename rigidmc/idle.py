"""Settings of a run that have no effect beside its other settings."""

from rigidmc.integrators import INTEGRATORS

# A turn_rate stays where an override leaves it without effect: the integrators that `auto` tries ask for it.
STAYS = {"turn_rate"}
_LIMITS = ("energy_limit", "momentum_limit", "turn_limit")


def idle(run):
    """{key: why it has no effect} of the settings that differ from their defaults. What is at its default is not meant: a stored scene has all keys."""
    fields = type(run).model_fields
    return {key: why for key, why in _without_effect(run) if getattr(run, key) != fields[key].default}


def _without_effect(run):
    """(key, why) of settings that are not looked at."""
    auto, closed = run.integrator == "auto", run.integrator == "closed"
    words = run.keep.values() if isinstance(run.keep, dict) else (run.keep,)
    if not auto:
        yield "tolerance", f'integrator = "{run.integrator}" keeps no tolerance: leave it out, or take "auto"'
        if not hasattr(INTEGRATORS.get(run.integrator), "prepared"):
            yield "turn_rate", f'integrator = "{run.integrator}" does not ask for it'
    if auto:
        yield from ((key, 'integrator = "auto" chooses it') for key in ("dt", "turn", "dtype"))
    if closed:  # a dt stays without a word: results in closed form are stored with one
        yield from ((key, "closed forms make no steps") for key in ("turn", "dtype", *_LIMITS))
    elif not run.checks:
        yield from ((key, "with checks = false only non-finite members are flagged") for key in _LIMITS)
    if run.points != "latin_hypercube":
        yield "strata", 'only points = "latin_hypercube" have strata'
    if "thinned" not in words:
        yield "thin", "nothing is kept thinned"
