"""What of a scene cannot be run: refused torques, bodies that cannot be, members that are not there, observables that cannot be had."""

import numpy as np

from rigidmc.dynamics.methods import implements
from rigidmc.effects import labelled
from rigidmc.effects.own_checks import check_own
from rigidmc.effects.parameters import shape
from rigidmc.effects.protocol import facts, is_random
from rigidmc.errors import SceneError, unknown
from rigidmc.integrators import refusal
from rigidmc.observables import OBSERVABLES
from rigidmc.observables.protocol import Ensemble, Neighbour, size
from rigidmc.scene.body import broken
from rigidmc.scene.idle import idle
from rigidmc.scene.laws import Correlated
from rigidmc.scene.laws.protocol import Law
from rigidmc.scene.quantities import Distribution, Grid, draw, rows

PILOT = 4096  # members whose sampled values are looked at before a run; always the same ones, so that bits do not depend on `members`


def check(scene):
    """Raise SceneError for what cannot be run: refused torques, sampled bodies that cannot be, too few rows."""
    if scene.run.integrator == "auto" and scene.run.tolerance is None:
        raise SceneError(
            "run",
            "tolerance",
            None,
            'is missing: integrator = "auto" chooses integrator and step for a tolerance',
        )
    if scene.run.tolerance is not None and "tolerance" in (why := idle(scene.run)):
        raise SceneError("run", "tolerance", scene.run.tolerance, why["tolerance"])
    works = "work" in scene.run.save
    if works and not scene.effects:
        raise SceneError("run", "save", "work", "the scene has no effects that could do work")
    if works and scene.run.dtype == "float32":
        raise SceneError(
            "run",
            "save",
            "work",
            "needs float64: sums in float32 keep their remainders, and sums of work cannot",
        )
    if scene.run.integrator != "auto":
        refused = refusal(scene.run.integrator, scene.effects, scene.run.compensated, works)
        if refused:
            raise SceneError("run", "integrator", scene.run.integrator, refused)
    _check_watched(scene)
    _check_points(scene)
    _check_drawn(scene.coarse())


def _check_points(scene):
    """Raise SceneError for points that the members have not."""
    run = scene.run
    vectors = any(
        isinstance(v, Law)
        for v in (scene.body.moments, scene.start.omega, scene.start.momentum, scene.start.attitude)
    )
    drawn = (
        vectors
        or scene.start.attitude == "uniform"
        or any(isinstance(q, Distribution) for q in scene.quantities())
    )
    if run.points != "independent" and not drawn:
        raise SceneError(
            "run", "points", run.points, "nothing of the scene is drawn: all numbers are given"
        )
    if run.points == "sobol" and run.first + run.members > 2**30:
        raise SceneError("run", "members", run.first + run.members, "there are 2^30 Sobol points")
    if run.points == "latin_hypercube" and run.first + run.members > (
        run.strata or run.first + run.members
    ):
        rule = f"a Latin hypercube of {run.strata:,} strata has as many members"
        raise SceneError("run", "members", run.first + run.members, rule)


def _check_drawn(scene):
    """Raise SceneError for values of the first members that cannot be."""
    for effect in scene.effects:
        check_own(effect)
    if len([e for e in scene.effects if is_random(e)]) > 1:
        rule = "give one: two are a bath with gamma = gamma_1 + gamma_2 and kT = (gamma_1 kT_1 + gamma_2 kT_2)/gamma"
        raise SceneError("effects", "bath", None, rule)
    count = rows(*scene.quantities())
    if count is not None and count < scene.run.first + scene.run.members:
        rule = f"the scene has arrays with rows for {count} members only"
        raise SceneError("run", "members", scene.run.first + scene.run.members, rule)
    moments, mass, _ = scene.body.sample(scene.run.seed, 0, PILOT)
    bad = np.flatnonzero(broken(moments) | ~(mass > 0))
    most = (
        PILOT // 2 if isinstance(scene.body.moments, Correlated) else 0
    )  # of measured inertia they are its tails
    if bad.size > most and not any(
        isinstance(q, Grid) for q in scene.body.quantities()
    ):  # of a map they are its blank parts
        example = ", ".join(f"{m:.4g}" for m in moments[:, bad[0]])
        rule = f"{bad.size} of the first {PILOT} sampled bodies are none (e.g. {example}): moments must be positive and obey I_i <= I_j + I_k"
        raise SceneError("body", "moments", None, rule)
    for label, effect in labelled(scene.effects):
        for name, value in zip(effect._fields, effect, strict=True):
            low, high = limits(effect, name, scene.run.anti_damping)
            drawn = draw(
                value if shape(effect, name) else (value,),
                scene.run.seed,
                f"effects.{label}.{name}",
                0,
                PILOT,
            )
            bad = drawn[~((drawn >= low) & (drawn <= high))]
            if bad.size:
                raise SceneError(
                    f"effects.{label}", name, float(bad[0]), outside(effect, low, high)
                )
        if implements(effect, "drives") and not scene.run.anti_damping:
            columns = [
                draw(value, scene.run.seed, f"effects.{label}.{name}", 0, PILOT)
                for name, value in zip(effect._fields, effect, strict=True)
            ]
            driven = np.flatnonzero(type(effect)(*columns).drives())
            if driven.size:
                example = ", ".join(f"{x:.4g}" for x in np.concatenate(columns)[:, driven[0]])
                raise SceneError(
                    f"effects.{label}",
                    effect._fields[0],
                    None,
                    f"({example}) drives some spins, which {_ALLOWED}",
                )


def _check_watched(scene):
    """Raise SceneError where observables over all steps cannot be had."""
    every = [one for _, one in scene.watched()]
    stops = [one for one in every if one.stop]
    rule = ""
    if any(not isinstance(one, Ensemble) for one in every) and scene.run.integrator == "closed":
        rule = "closed forms make no steps that could be watched: use exact"
    elif len(stops) > 1:
        rule = "one event at most can stop a member"
    elif stops and "work" in scene.run.save:
        rule = "the work of a member that an event stops is not kept: save it without stop, or stop without it"
    elif any(isinstance(one, Neighbour) for one in every):
        if scene.run.dtype == "float32":
            rule = "megno needs float64: a neighbour at 1e-8 is none in float32"
        elif scene.run.compensated:
            rule = "megno does not go with compensated sums"
        elif stops:
            rule = "megno does not go with an event that stops members"
        elif scene.run.turn is not None:
            rule = "megno needs the same steps for all members: dt, not turn"
    if rule:
        raise SceneError("run", "save", ", ".join(label for label, _ in scene.watched()), rule)


def check_histogram(one):
    """Raise SceneError for a histogram of nothing."""
    if one.name not in OBSERVABLES or one.name == "work":
        raise unknown(
            "observables.histogram",
            "of",
            one.name,
            "observable",
            [name for name in OBSERVABLES if name != "work"],
        )
    count = size(OBSERVABLES[one.name].dims)
    if (count > 1) != one.of.endswith("]") or one.component >= count:
        rule = (
            f"{one.name} has {count} components: give one, as in {one.name}[{count}]"
            if count > 1
            else f"{one.name} has no components"
        )
        raise SceneError("observables.histogram", "of", one.of, rule)


def limits(effect, name, driven):
    low, high = facts(effect).limits.get(name, (-np.inf, np.inf))
    return (0.0 if low == -np.inf and facts(effect).damps and not driven else low), high


_ALLOWED = "needs anti_damping = true under [run]"


def outside(effect, low, high):
    more = (
        f"; below 0 it drives the body, which {_ALLOWED}"
        if low == 0.0 and facts(effect).damps
        else ""
    )
    return f"must lie between {low:g} and {high:g}{more}"
