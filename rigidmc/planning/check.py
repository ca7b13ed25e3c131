"""Reject scenes that cannot run: refused torques, impossible bodies, missing members, observables
that conflict with the other settings."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.machine import is_uncompiled
from rigidmc.engine.streams import uniforms
from rigidmc.errors import PartError, SceneError
from rigidmc.inputs.amounts import count_text
from rigidmc.mechanics.inertia import vectors_from, violates_triangle, why_impossible
from rigidmc.physics.dynamics.methods import implements
from rigidmc.physics.effects import label_effects, name_of
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.physics.effects.protocol import Effect, facts, has_memory, has_state, is_random, shape
from rigidmc.physics.integrators import refusal
from rigidmc.physics.observables import OUTCOMES, is_own, outputs
from rigidmc.physics.observables.protocol import DIMENSIONS, EnsembleObservable, Growth, Running
from rigidmc.planning.initial import Source, initial_block, member_facts
from rigidmc.planning.switches import check_switches
from rigidmc.scene.derivatives import derivative_name
from rigidmc.scene.distributions import Common
from rigidmc.scene.model import Model
from rigidmc.scene.parameters import END
from rigidmc.scene.quantities import Grid, count_rows, draw, is_shared
from rigidmc.scene.recording import Recording
from rigidmc.scene.sampling import DESIGNS, is_drawn, refuse_indexed
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run, idle
from rigidmc.scene.user_parts.effects import check_user_effect
from rigidmc.scene.user_parts.effects import trial_effect as plain_numbers
from rigidmc.scene.user_parts.integrators import check_user_integrator
from rigidmc.scene.user_parts.observables import check_user_observable
from rigidmc.scene.validation import ALLOWED, PILOT, named_integrators, outside, parameter_limits
from rigidmc.scene.vector_distributions import Correlated
from rigidmc.scene.vector_distributions.protocol import VectorDistribution
from rigidmc.scene.vector_distributions.vectors import uniform_attitudes

COMPILED = "needs compiled code, but NUMBA_DISABLE_JIT is set"


def check_scene(scene: Scene, recording: Recording) -> None:
    """Raise SceneError if a scene cannot be run."""
    run, model = scene.run, scene.model
    check_parts(scene)
    if run.integrator == "auto" and run.tolerance is None:
        rule = 'is missing: integrator = "auto" chooses integrator and step for a tolerance'
        raise SceneError(rule, at="run.tolerance")
    if run.tolerance is not None and "tolerance" in (why := idle(run)):
        raise SceneError(why["tolerance"], at="run.tolerance", value=run.tolerance)
    works = recording.has_work
    if works and not model.effects:
        raise SceneError("the scene has no effects that could do work", at="run.save", value="work")
    if works and run.dtype == "float32":
        rule = "needs float64: sums in float32 keep their remainders, but sums of work cannot"
        raise SceneError(rule, at="run.save", value="work")
    if recording.has_noise_sums and (rule := _no_noise_sums(model, recording)):
        raise SceneError(rule, at="run.save", value="noise_score")
    growing = [label for label, kind in recording.monitored if isinstance(kind, Growth)]
    check_switches(model, run, growing)
    if run.wrt:
        _check_derivatives(run, model, recording)
    if run.wrt and is_uncompiled():
        raise SceneError(f"derivatives {COMPILED}", at="run.wrt", value=", ".join(run.wrt))
    if run.integrator != "auto":
        refused = refusal(
            run.integrator, model.effects, run.compensated, works, scene.known_integrators()
        )
        if refused:
            raise SceneError(refused, at="run.integrator", value=run.integrator)
    if rule := _not_monitored(run, model.effects, recording):
        labels = ", ".join(label for label, _ in recording.monitored)
        raise SceneError(rule, at="run.save", value=labels)
    _check_points(model, run)
    model = model.coarse()
    _check_variables(run, recording)
    _check_sampled(model, run)


def _no_noise_sums(model: Model, recording: Recording) -> str:
    """Return why the score of the noise cannot be recorded, or "" if it can."""
    if not any(isinstance(effect, Bath) for effect in model.effects):
        return "needs the noise of a bath: add an effect `bath`"
    if recording.has_work:
        return "is not available with work: save one of them"
    if any(monitor.stop for _, monitor in recording.monitored):
        return "is not available with an event that stops members"
    return ""


def _check_derivatives(run: Run, model: Model, recording: Recording) -> None:
    """Raise SceneError for derivatives that a run cannot have; names are known to be right."""
    assert run.wrt is not None
    if run.integrator == "closed":
        rule = "the functions of closed forms have no derivatives here: use integrator = " + (
            '"rk8"' if model.effects else '"exact", which has them to rounding at any dt'
        )
        raise SceneError(rule, at="run.wrt", value=", ".join(run.wrt))
    if END not in run.wrt:
        return
    if noisy := [label for label, part in label_effects(model.effects) if is_random(part)]:
        rule = f"has no derivative: under the noise of {', '.join(noisy)} no state has a rate"
        raise SceneError(rule, at="run.wrt", value=END)
    running = [pair for pair in recording.monitored if isinstance(pair[1], Running)]
    if lost := [label for label, part in running if not implements(part, "lengthened")]:
        rule = f"has no derivative of {', '.join(lost)}: the class needs a method `lengthened`"
        raise SceneError(rule, at="run.wrt", value=END)


def _check_points(model: Model, run: Run) -> None:
    """Raise SceneError for point sets that do not fit the ensemble."""
    last = run.first + run.members
    if run.points != "independent" and not is_drawn(model):
        rule = "nothing in the scene is drawn: all values are given"
        raise SceneError(rule, at="run.points", value=run.points)
    if run.points in DESIGNS:
        refuse_indexed(model, "members of a family differ by their draws")
    if run.points == "sobol" and last > 2**30:
        raise SceneError("only 2^30 Sobol points exist", at="run.members", value=last)
    if run.points == "latin_hypercube" and last > (run.strata or last):
        rule = f"a Latin hypercube of {run.strata:,} strata has only {run.strata:,} members"
        raise SceneError(rule, at="run.members", value=last)


def check_parts(scene: Scene) -> None:
    """Raise SceneError for custom effects, observables or integrators that cannot be compiled or
    that contradict themselves. Whatever evaluates the effects of a scene comes after this check."""
    effects = scene.model.coarse().effects
    for effect in effects:
        check_user_effect(effect)
    for kind in scene.observables:
        check_user_observable(kind, tuple(map(plain_numbers, effects)))
    for word, integrator in named_integrators(scene.integrators).items():
        check_user_integrator(integrator, word)


def _check_sampled(model: Model, run: Run) -> None:
    """Raise SceneError for impossible values among the first members."""
    if sum(is_random(effect) for effect in model.effects) > 1:
        rule = (
            "give one bath: two act as one with gamma = gamma_1 + gamma_2 and"
            " kT = (gamma_1 kT_1 + gamma_2 kT_2)/gamma"
        )
        raise SceneError(rule, at="effects.bath")
    count, last = count_rows(*model.quantities()), run.first + run.members
    if count is not None and count < last:
        rule = f"the scene has arrays with rows for only {count_text(count, 'member')}"
        raise SceneError(rule, at="run.members", value=last)
    _check_bodies(model, run.seed)
    _check_orbit(model, run.seed)
    _check_axes(model)
    for label, effect in label_effects(model.effects):
        _check_parameters(run, label, effect)


def _check_bodies(model: Model, seed: int) -> None:
    """Raise SceneError if some of the first bodies are impossible.

    A map may contain impossible bodies, which stay blank, and so may the tails of a measured
    inertia, up to half of the bodies.
    """
    if any(isinstance(q, Grid) for q in model.body.quantities()):
        return
    is_apart = model.body.inertia_key == "tensor" and model.body.frame == "principal"
    if is_apart and count_rows(*model.start.quantities()) is not None:
        rule = (
            "an uncertain tensor excludes a table, because its axes differ from member to member;"
            " give distributions, or moments and starts of each member"
        )
        raise SceneError(rule, at=f"start.{model.start.spin_name}")
    for label, effect in label_effects(model.effects) if is_apart else ():
        for name in facts(effect).in_body:
            if count_rows(*getattr(effect, name)) is not None:
                # results give it in the principal axes of each member
                rule = "an uncertain tensor excludes body-fixed tables: give distributions"
                raise SceneError(rule, at=f"effects.{label}.{name}")
    moments, mass, _ = model.body.sample(seed, 0, PILOT)
    no_moments = violates_triangle(moments)
    bad = np.flatnonzero(no_moments | ~(mass > 0))
    drawn: Any = model.body.moments
    is_measured = isinstance(drawn, Correlated) or (
        isinstance(drawn, tuple) and any(isinstance(x, Common) for x in drawn)
    )
    if bad.size > (PILOT // 2 if is_measured else 0):
        first, rule = bad[0], f"{bad.size} of the first {PILOT} sampled bodies are impossible"
        if no_moments[first]:
            raise SceneError(f"{rule}: {why_impossible(moments[:, first])}", at="body.moments")
        raise SceneError(f"{rule}: a mass is {mass[first]:.6g} kg", at="body.mass")


def _check_axes(model: Model) -> None:
    """Raise SceneError for a parameter along the principal axes of a body described in others."""
    if model.body.frame == "principal" or not model.body.is_turned:
        return
    for label, effect in label_effects(model.effects):
        for name in facts(effect).along_axes:
            if any(not (isinstance(x, float) and x == 0.0) for x in getattr(effect, name)):
                cure = "use matrix_damping, or " if name_of(effect) == "axial_damping" else ""
                rule = (
                    "has one number for each principal axis, and the body is described in other"
                    f' axes: {cure}set axes = "principal" in [body]'
                )
                raise SceneError(rule, at=f"effects.{label}.{name}")


def _check_orbit(model: Model, seed: int) -> None:
    """Raise SceneError if a body on an orbit turns about a point other than its centre of mass.

    Moments about another point are too large by up to m c^2, and have other principal axes.
    """
    if not any(isinstance(effect, GravityGradient) for effect in model.effects):
        return
    moments, mass, centre, turn = model.body.sample_turned(seed, 0, PILOT)
    off = mass * (centre * centre).sum(0) > 1e-12 * moments.max(0)
    if off.any():
        uncertain = model.body.inertia_key == "tensor"
        rule = (
            "a body on an orbit (gravity_gradient) turns about its centre of mass, which here is"
            " not the fixed point: "
        )
        has_shared_body = is_shared(model.body.moments, model.body.mass, model.body.centre)
        rule += (
            'set pivot = "centre" in [body], or call body.with_pivot_at_centre() in Python, to move'
            " the fixed point and the tensor there"
            + (", separately for each draw" if uncertain else "")
            if uncertain or has_shared_body
            else "give moments about the centre of mass and leave centre out"
        )
        told = centre if turn is None else vectors_from(turn, centre)  # as the scene gives it
        raise SceneError(rule, at="body.centre", value=told[:, off][:, 0].round(12).tolist())


def _check_parameters(run: Run, label: str, effect: Effect) -> None:
    """Raise SceneError if a sampled parameter of an effect is outside its limits, or if a damping
    drives some rotations."""
    at = f"effects.{label}"

    def drawn(name: str, value: Any) -> np.ndarray:
        several = value if shape(effect, name) else (value,)
        return draw(several, run.seed, f"{at}.{name}", 0, PILOT)

    values = {name: drawn(name, value) for name, value in zip(effect._fields, effect, strict=True)}
    for name, sample in values.items():
        low, high = parameter_limits(effect, name, run.anti_damping)
        bad = sample[~((sample >= low) & (sample <= high))]
        if bad.size:
            wrong = float(bad[0])
            raise SceneError(outside(effect, low, high), at=f"{at}.{name}", value=wrong)
    if implements(effect, "is_driving") and not run.anti_damping:
        sampled: Any = type(effect)(*values.values())
        driven = np.flatnonzero(sampled.is_driving())
        if driven.size:
            numbers = np.concatenate(list(values.values()))[:, driven[0]]
            example = ", ".join(f"{x:.4g}" for x in numbers)
            rule = f"({example}) drives some rotations, which {ALLOWED}"
            raise SceneError(rule, at=f"{at}.{effect._fields[0]}")


def _check_variables(run: Run, recording: Recording) -> None:
    """Raise SceneError if a custom observable reuses the name of an existing variable."""
    taken = {*OUTCOMES, *DIMENSIONS, "member", "time", "moments", "tensor", "mass", "centre"}
    if run.wrt:
        results = (name for pair in recording.monitored for name in outputs(*pair))
        differentiated = map(derivative_name, (*recording.names, *results))
        taken |= {"parameter", "parameter_unit", *differentiated}
    every: list[tuple[Any, list[str]]] = [(recording.observable(n), [n]) for n in recording.names]
    every += [(kind, list(outputs(label, kind))) for label, kind in recording.monitored]
    for kind, names in sorted(every, key=lambda pair: is_own(pair[0])):
        for name in names:
            if name in taken:
                rule = f"gives the variable '{name}', which the result already has: rename it"
                raise PartError.of(kind, rule, "observables")
            taken.add(name)


def _not_monitored(run: Run, effects: Sequence[Any], recording: Recording) -> str:
    """Return why observables over all steps conflict with the run settings, or "" if they fit."""
    observables = [kind for _, kind in recording.monitored]
    stops = [kind for kind in observables if kind.stop]
    if run.integrator == "closed":
        if any(not isinstance(kind, EnsembleObservable) for kind in observables):
            return "closed forms make no steps to monitor: use exact"
        if any(map(is_own, recording.recorded.values())):
            return "closed forms do not support custom observables: use exact"
    if len(stops) > 1:
        return "at most one event can stop a member"
    if stops and recording.has_work:
        return (
            "the work of a member is lost when an event stops it: save work without stop, or stop"
            " without saving work"
        )
    if stops and any(has_state(e) or has_memory(e) for e in effects):
        return "an event cannot stop a member whose effects have numbers that move with it"
    if not any(isinstance(kind, Growth) for kind in observables):
        return ""
    if stops:
        return "megno does not support an event that stops members"
    return f"megno {COMPILED}" if is_uncompiled() else ""


def check_starts(model: Model, sampler: Source, seed: int) -> None:
    """Raise SceneError if no member has a valid start, or if an ensemble is too rare to draw."""
    if model.start.attitude == "ensemble":
        _check_ensemble(model, seed)
        return
    spin = model.start.spin_name
    if not isinstance(getattr(model.start, spin), VectorDistribution):
        return
    if initial_block(model, sampler, 0, PILOT)[0][layout.STATUS].all():
        rule = (
            f"none of the first {PILOT} members has a valid start: energy, temperature or size is"
            " out of range"
        )
        raise SceneError(rule, at=f"start.{spin}")


def _check_ensemble(model: Model, seed: int) -> None:
    """Raise SceneError if the attitudes of an ensemble are too rare among uniform attitudes for
    rejection sampling."""
    block, start = initial_block(model, seed, 0, PILOT, False)
    facts = member_facts(model.effects, block, start["moments"])
    ensemble: Any = model.start.momentum
    acceptance = ensemble.acceptance(seed, 0, PILOT, facts)
    u, v, w, _ = uniforms(seed, "start.attitude.ensemble", 0, PILOT, 0)
    tried = uniform_attitudes(u, v, w)
    if (np.abs(facts.potential(tried)) > facts.bound * (1.0 + 1e-9)).any():
        rule = (
            "needs the largest potential energy over all attitudes: a custom effect returns it from"
            " energy_scale(self, body) [J]"
        )
        raise SceneError(rule, at="start.attitude", value="ensemble")
    accepted = float(np.nanmean(acceptance(tried)))
    if not accepted >= 0.01:
        rule = (
            f"the ensemble accepts {accepted:.1g} of uniform attitudes, fewer than 1 in 100: too "
            "cold for rejection sampling; under gravity alone, a body with centre on axis 3 has "
            "exp(-V/kT) by attitude = { pointing = { direction = [0, 0, -1], kappa = m g h/kT } }"
        )
        raise SceneError(rule, at="start.attitude", value="ensemble")
