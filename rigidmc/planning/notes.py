"""Notes on scenes that run, but perhaps not as intended: settings and effects without effect, slow
effects, and likely errors of units and signs. Each function in LOOKS yields notes.
"""

import inspect
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.inspection import scalar_parts
from rigidmc.engine.machine import is_uncompiled
from rigidmc.inputs.units import degrees_note
from rigidmc.physics.dynamics.methods import arguments, implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.effects.protocol import blank, facts, from_numbers, shape
from rigidmc.physics.observables import KNOWN, label_observables, word_of_observable
from rigidmc.physics.observables.protocol import is_attitude, is_body_vector
from rigidmc.planning.model_notes import (
    CURE,
    FEW,
    angle_notes,
    far_centre,
    idle_effects,
    impossible_bodies,
    is_mapped,
    is_shipped,
    kink_notes,
    motionless,
    quaternion_notes,
    undetermined_axes,
    unlike_matter,
)
from rigidmc.planning.plan import Plan
from rigidmc.planning.units import UnitScale
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import draw
from rigidmc.scene.settings import Run, idle
from rigidmc.scene.vector_distributions import GibbsMomentum

BOLTZMANN = 1.380649e-23  # J/K
# Central bodies: G M [m3/s2], distinguished to 2 %, and radius [m]. Source: Archinal et al.,
# Celest. Mech. Dyn. Astron. 130 (2018) 22; JPL DE440.
CENTRES = {
    "the Sun": (1.32712e20, 6.957e8),
    "Venus": (3.24859e14, 6.0518e6),
    "the Earth": (3.98600e14, 6.371e6),
    "the Moon": (4.90280e12, 1.7374e6),
    "Mars": (4.28284e13, 3.3895e6),
    "Jupiter": (1.26713e17, 6.9911e7),
    "Saturn": (3.79406e16, 5.8232e7),
}
FOREIGN_G = {"cm/s2": 100.0, "mm/s2": 1000.0, "ft/s2": 1.0 / 0.3048}
COLD = 1e6  # K: small bodies that tumble in a bath are colder
UNCOMPILED = (
    "NUMBA_DISABLE_JIT is set: Python makes the steps, thousands of times slower, and the last bits"
    " differ from compiled steps; unset it for reproducible results"
)
Array = NDArray[np.float64]


class PilotFacts(NamedTuple):
    """The model, the settings, the Plan, and the first FEW members: bodies, and [(label, effect)]
    with arrays as fields."""

    model: Model
    run: Run
    plan: Plan
    moments: Array
    mass: Array
    centre: Array
    effects: list[tuple[str, Any]]


def step_notes(run: Run, plan: Plan, units: UnitScale | None = None) -> tuple[str, ...]:
    """Return the plan's notes on steps, or none if a tolerance chose the steps, because then the
    error is measured.

    units : units into which the plan was rescaled, None if it was not
    """
    if run.integrator == "auto":
        return ()
    if units is None:
        return plan.notes
    return tuple(f"{note} (in units of {1.0 / units.time:.6g} s)" for note in plan.notes)


def scene_notes(model: Model, run: Run, plan: Plan) -> tuple[str, ...]:
    """Return the other notes for the user of a scene.

    model, run : as the user gave them;  plan : of this run
    """
    seen = _pilot_facts(model, run, plan)
    uncompiled = plan.scheme is not None and is_uncompiled()
    return (*[UNCOMPILED] * uncompiled, *(note for look in LOOKS for note in look(seen) if note))


def _pilot_facts(model: Model, run: Run, plan: Plan) -> PilotFacts:
    coarse, seed = model.coarse(), run.seed
    effects = []
    for label, effect in label_effects(coarse.effects):
        each = [
            (field, value if shape(effect, field) else (value,))
            for field, value in zip(effect._fields, effect, strict=True)
        ]
        rows = [draw(parts, seed, f"effects.{label}.{field}", 0, FEW) for field, parts in each]
        effects.append((label, from_numbers(type(effect), np.concatenate(rows))))
    moments, mass, centre = coarse.body.sample(seed, 0, FEW)
    return PilotFacts(model, run, plan, moments, mass, centre, effects)


def _idle(seen: PilotFacts) -> Iterator[str]:
    yield from idle_settings(seen.run)
    yield from idle_sums(seen.run, seen.plan)
    yield from idle_limits(seen.run, seen.plan)
    yield from _anti_damping(seen)
    yield from idle_effects(seen.effects, seen.moments, seen.centre)


def _one_at_a_time(seen: PilotFacts) -> Iterator[str]:
    events, running, _ = seen.plan.monitors.compiled
    watches = *seen.plan.recording.recorded.values(), *events, *(one for one, _ in running)
    scheme, effects = seen.plan.scheme, blank(seen.model.effects)
    if scheme is None:
        return
    for name, why in scalar_parts(scheme.integrator, effects, watches):
        slower = "members are not vectorized, and the step is much slower than it could be"
        yield f"{name} {why}: {slower}"


def _anti_damping(seen: PilotFacts) -> Iterator[str]:
    if not seen.run.anti_damping:
        return
    if any(
        facts(effect).is_damping or implements(effect, "is_driving")
        for effect in seen.model.effects
    ):
        yield "[run] anti_damping = true: damping may be negative, which drives the body"
    else:
        yield "[run] anti_damping = true has no effect: the scene has no damping"


def _gravity(seen: PilotFacts) -> Iterator[str]:
    for label, effect in seen.effects:
        if not isinstance(effect, Gravity):
            continue
        if (least := np.min(effect.g)) < 0.0:
            yield f"[effects.{label}] g = {least:g} pulls upwards: g > 0 pulls along -z"
        for unit, size in FOREIGN_G.items():
            if abs(float(np.median(effect.g)) / (9.81 * size) - 1.0) < 0.005:
                shown = f"[effects.{label}] g = {np.median(effect.g):g}"
                yield f"{shown} is that of the Earth in {unit}: g is in m/s2"


def _orbit_inside(seen: PilotFacts) -> Iterator[str]:
    for label, effect in seen.effects:
        if not isinstance(effect, GravityGradient):
            continue
        mu = float(np.median(effect.mu))
        nearest = float(np.min(effect.distance * (1.0 - effect.eccentricity)))
        for name, (known, radius) in CENTRES.items():
            if abs(mu / known - 1.0) < 0.02 and nearest < radius:
                yield (
                    f"[effects.{label}] distance: {nearest:g} m from the centre is inside {name}, "
                    f"whose radius is {radius:g} m; distances are in m, from the centre"
                )


def _not_turned(seen: PilotFacts) -> Iterator[str]:
    """Find custom effects, observables and events that do not declare what is fixed in the body,
    where the axes of the scene are not the principal axes of each member."""
    if not seen.model.body.is_turned:
        return
    for label, effect in seen.effects:
        if is_shipped(effect) or hasattr(effect, "in_body"):
            continue
        vectors = [name for name in effect._fields if shape(effect, name) == 3]
        for name in vectors:
            yield (
                f"[effects.{label}] {name} is used along the principal axes of each member,"
                f' which are not the axes of the scene: @effect(in_body=("{name}",)) turns a'
                " vector that is fixed in the body, and in_body=() declares that no vector is"
            )
        used = _states_used(type(effect))
        if not vectors and used:
            yield (
                f"[effects.{label}] takes {used} in the principal axes of each member, and the"
                " scene is in other axes: directions of the body in its code belong in a"
                " field that @effect(in_body=...) names; in_body=() declares that it has none"
            )
    if seen.model.body.frame == "principal":
        return
    for label, one in label_observables(seen.plan.recording.observables):
        if word_of_observable(one) in KNOWN or hasattr(one, "in_body") or _turns_itself(type(one)):
            continue
        turns = bool(is_body_vector(one) or is_attitude(one))
        if (used := _states_used(type(one))) and turns:
            yield (
                f"[observables.{label}] its values, with dims {one.dims}, are taken along the"
                " principal axes of each member and turned into the axes of the scene:"
                ' in_body=("value",) declares that they are; in_body=() turns no value'
            )
        elif used:
            yield (
                f"[observables.{label}] takes {used} in the principal axes of each member, and"
                " the scene is in other axes: described(body, v) and described_attitude(body, q) of"
                " rigidmc.protocols turn them into these; in_body=() declares that nothing depends"
                " on the axes of the body"
            )


# methods in compiled code, by which a class of a user may depend on axes
_COMPILED = (
    "torque", "energy", "kick", "slip", "value", "begin", "update", "extrema", "level", "armed",
)  # fmt: skip


def _compiled(cls: type) -> list[Callable[..., Any]]:
    """Return the functions of a class that run in compiled code."""
    found = (getattr(cls, name, None) for name in _COMPILED)
    return [one for one in found if inspect.isfunction(one)]


def _states_used(cls: type) -> str:
    """Return which of q and l the compiled methods of a class take, as words; "" if none."""
    taken = {name for one in _compiled(cls) for name in arguments(one)}
    return " and ".join(name for name in ("q", "l") if name in taken)


def _turns_itself(cls: type) -> bool:
    """Return whether a compiled method of a class turns states into the described axes."""
    known = {"described", "described_attitude"}
    return any(known & {*one.__code__.co_names} for one in _compiled(cls))


def _angles(seen: PilotFacts) -> Iterator[str]:
    yield from angle_notes(seen.model.coarse().start, seen.run.seed)
    for label, effect in seen.effects:
        for field, unit in facts(effect).units.items():
            if unit == "rad" and is_shipped(effect):
                yield degrees_note(getattr(effect, field), f"[effects.{label}] {field} =", 2, CURE)


def _rest(seen: PilotFacts) -> Iterator[str]:
    effects = [effect for _, effect in seen.effects]
    if not seen.run.varied and all(map(is_shipped, effects)):
        yield motionless(seen.model.coarse().start, effects, seen.moments, seen.centre)


def _axes(seen: PilotFacts) -> Iterator[str]:
    yield from undetermined_axes(seen.model.coarse().body, seen.run)


def _quaternions(seen: PilotFacts) -> Iterator[str]:
    yield from quaternion_notes(seen.model.start)


def _bodies(seen: PilotFacts) -> Iterator[str]:
    yield from impossible_bodies(seen.model.coarse().body, seen.run, is_mapped(seen.model.body))


def _density(seen: PilotFacts) -> Iterator[str]:
    body = seen.model.body, seen.moments, seen.mass, seen.centre
    yield from unlike_matter(*body)
    yield from far_centre(*body)


def _no_mass(seen: PilotFacts) -> Iterator[str]:
    """Find effects whose torque has the factor m, on a body without a given mass."""
    if seen.model.body.has_mass or not seen.centre.any():
        return
    for label, effect in seen.effects:
        if isinstance(effect, (Gravity, MovingPivot)):
            yield (
                f"[effects.{label}] acts on an assumed mass of 1 kg, because no mass is given: its"
                " torque is in proportion to [body] mass"
            )


def _hot(seen: PilotFacts) -> Iterator[str]:
    """Find a kT given in K instead of J, for bodies small enough to respond to heat."""
    momentum, seed = seen.model.coarse().start.momentum, seen.run.seed
    heats: list[tuple[str, Any]] = [
        (f"effects.{label}", one.kT) for label, one in seen.effects if isinstance(one, Bath)
    ]
    if isinstance(momentum, GibbsMomentum):
        heats.append(("start", draw((momentum.kT,), seed, "start.momentum.kT", 0, FEW)))
    for table, heat in heats:
        kelvin = float(np.median(heat)) / BOLTZMANN
        if np.median(seen.mass) < 1e-9 and kelvin > COLD:
            yield (
                f"[{table}] kT = {np.median(heat):g} J is {kelvin:.2g} K: kT is in J, and 300 K "
                f"are {300 * BOLTZMANN:.4g} J"
            )


def _kinks(seen: PilotFacts) -> Iterator[str]:
    yield from kink_notes(seen.effects, seen.moments, seen.mass * seen.centre, seen.run.t_end)


LOOKS: tuple[Callable[[PilotFacts], Iterator[str]], ...] = (
    _idle,
    _one_at_a_time,
    _gravity,
    _orbit_inside,
    _not_turned,
    _angles,
    _quaternions,
    _rest,
    _axes,
    _bodies,
    _density,
    _no_mass,
    _hot,
    _kinks,
)


def idle_settings(run: Run) -> Iterator[str]:
    """Find settings of [run] that have no effect."""
    for key, why in idle(run).items():
        yield f"[run] {key} = {getattr(run, key)} has no effect: {why}"
    for name, word in run.keep.items() if isinstance(run.keep, dict) else ():
        if name not in run.save:
            yield f"[run] keep.{name} = {word} has no effect: {name} is not saved"
    if isinstance(run.every, float) and run.every > run.t_end:
        yield (
            f"[run] every = {run.every:g} s is longer than t_end = {run.t_end:g} s: only the "
            "first and the last state are saved"
        )


def idle_sums(run: Run, plan: Plan) -> Iterator[str]:
    """Find compensated sums requested for steps that already compensate their rounding."""
    if run.compensated and not plan.compensated:
        why = f"the steps of {run.integrator} already compensate their rounding"
        yield f"[run] compensated = True has no effect: {why}"


def idle_limits(run: Run, plan: Plan) -> Iterator[str]:
    """Find limits on drifts of quantities that are not conserved."""
    conserved = plan.conserved
    if not run.checks or run.integrator == "closed":
        return
    why = {name: reason.removeprefix("no: ") for name, reason in conserved.items()}
    if run.energy_limit is not None and conserved["energy_drift"] != "yes":
        rule = f"has no effect: {why['energy_drift']}"
        yield f"[run] energy_limit = {run.energy_limit:g} {rule}"
    bounded = conserved["l2"] == "yes" or (conserved["lz"] == "yes" and plan.has_attitude)
    if run.momentum_limit is not None and not bounded:
        reason = why["lz"] if plan.has_attitude else f"{why['l2']}, and L_z is not followed"
        yield f"[run] momentum_limit = {run.momentum_limit:g} has no effect: {reason}"
