"""Notes on scenes that run, but perhaps not as intended: settings and effects without effect, slow
effects, and likely errors of units and signs.
"""

import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from rigidmc.engine.inspection import scalar_parts
from rigidmc.engine.machine import is_uncompiled
from rigidmc.inputs.arrays import Array
from rigidmc.inputs.measured import degrees_note
from rigidmc.physics.dynamics.methods import arguments, implements
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.gravity_gradient import GravityGradient
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.effects.protocol import blank, facts, from_numbers, shape
from rigidmc.physics.observables import is_own, label_observables
from rigidmc.physics.observables.compiled import is_attitude, is_body_vector
from rigidmc.planning.model_notes import (
    CURE,
    FEW,
    angle_notes,
    far_centre,
    idle_effects,
    impossible_bodies,
    is_shipped,
    kink_notes,
    motionless,
    quaternion_notes,
    undetermined_axes,
    unlike_matter,
)
from rigidmc.planning.plan import Plan
from rigidmc.planning.unit_scale import UnitScale
from rigidmc.scene.body import Body
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import Grid, draw
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
Effects = Sequence[tuple[str, Any]]  # (label, effect of the first members, with arrays as fields)


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
    uncompiled = plan.scheme is not None and is_uncompiled()
    return (*[UNCOMPILED] * uncompiled, *filter(None, _notes(model, run, plan)))


def _notes(model: Model, run: Run, plan: Plan) -> Iterator[str]:
    """Look at the settings, and at the first FEW members; yield notes, "" for none."""
    coarse, seed = model.coarse(), run.seed
    body, start, effects = coarse.body, coarse.start, _filled(coarse.effects, run.seed)
    moments, mass, centre = body.sample(seed, 0, FEW)
    yield from idle_settings(run)
    if run.compensated and not plan.compensated:
        why = f"the steps of {run.integrator} already compensate their rounding"
        yield f"[run] compensated = True has no effect: {why}"
    yield from idle_limits(run, plan)
    yield from _anti_damping(run, model.effects)
    yield from idle_effects(effects, moments, centre)
    yield from _one_at_a_time(plan, model.effects)
    yield from _gravity(effects)
    yield from _orbit_inside(effects)
    yield from _not_turned(model.body, effects, plan)
    yield from angle_notes(start, seed)
    yield from _degrees(effects)
    yield from quaternion_notes(model.start)
    if not run.varied and all(is_shipped(effect) for _, effect in effects):
        yield motionless(start, [effect for _, effect in effects], moments, centre)
    yield from undetermined_axes(body, run)
    is_mapped = any(isinstance(q, Grid) for q in model.body.quantities())
    yield from impossible_bodies(body, run, is_mapped)
    yield from unlike_matter(model.body, moments, mass, centre)
    yield from far_centre(model.body, moments, mass, centre)
    if not model.body.has_mass and centre.any():
        yield from _no_mass(effects)
    yield from _hot(start.momentum, seed, mass, effects)
    yield from kink_notes(effects, moments, mass * centre, run.t_end)


def _filled(effects: Sequence[Any], seed: int) -> Effects:
    """Return [(label, effect)] of the first members, with arrays as fields."""
    filled = []
    for label, effect in label_effects(effects):
        each = [
            (field, value if shape(effect, field) else (value,))
            for field, value in zip(effect._fields, effect, strict=True)
        ]
        rows = [draw(parts, seed, f"effects.{label}.{field}", 0, FEW) for field, parts in each]
        filled.append((label, from_numbers(type(effect), np.concatenate(rows))))
    return filled


def _one_at_a_time(plan: Plan, effects: Sequence[Any]) -> Iterator[str]:
    events, running, _ = plan.monitors.compiled
    observed = *plan.recording.recorded.values(), *events, *(monitor for monitor, _ in running)
    if plan.scheme is None:
        return
    for name, why in scalar_parts(plan.scheme.integrator, blank(effects), observed):
        slower = "members are not vectorized, and the step is much slower than it could be"
        yield f"{name} {why}: {slower}"


def _anti_damping(run: Run, effects: Sequence[Any]) -> Iterator[str]:
    if not run.anti_damping:
        return
    if any(facts(effect).is_damping or implements(effect, "is_driving") for effect in effects):
        yield "[run] anti_damping = true: damping may be negative, which drives the body"
    else:
        yield "[run] anti_damping = true has no effect: the scene has no damping"


def _gravity(effects: Effects) -> Iterator[str]:
    for label, effect in effects:
        if not isinstance(effect, Gravity):
            continue
        if (least := np.min(effect.g)) < 0.0:
            yield f"[effects.{label}] g = {least:g} pulls upwards: g > 0 pulls along -z"
        for unit, size in FOREIGN_G.items():
            if abs(float(np.median(effect.g)) / (9.81 * size) - 1.0) < 0.005:
                shown = f"[effects.{label}] g = {np.median(effect.g):g}"
                yield f"{shown} is that of the Earth in {unit}: g is in m/s2"


def _orbit_inside(effects: Effects) -> Iterator[str]:
    for label, effect in effects:
        if not isinstance(effect, GravityGradient):
            continue
        mu = float(np.median(effect.mu))
        nearest = float(np.min(effect.distance * (1.0 - effect.eccentricity)))
        for name, (its_mu, radius) in CENTRES.items():
            if abs(mu / its_mu - 1.0) < 0.02 and nearest < radius:
                yield (
                    f"[effects.{label}] distance: {nearest:g} m from the centre is inside {name}, "
                    f"whose radius is {radius:g} m; distances are in m, from the centre"
                )


def _not_turned(body: Body, effects: Effects, plan: Plan) -> Iterator[str]:
    """Find custom effects, observables and events that do not declare what is fixed in the body,
    where the axes of the scene are not the principal axes of each member."""
    if not body.is_turned:
        return
    for label, effect in effects:
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
    if body.frame == "principal":
        return
    for label, kind in label_observables(plan.recording.observables):
        if not is_own(kind) or hasattr(kind, "in_body") or _turns_itself(type(kind)):
            continue
        turns = bool(is_body_vector(kind) or is_attitude(kind))
        if (used := _states_used(type(kind))) and turns:
            yield (
                f"[observables.{label}] its values, with dims {kind.dims}, are taken along the"
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
    methods = (getattr(cls, name, None) for name in _COMPILED)
    return [method for method in methods if inspect.isfunction(method)]


def _states_used(cls: type) -> str:
    """Return which of q and l the compiled methods of a class take, as words; "" if none."""
    taken = {name for method in _compiled(cls) for name in arguments(method)}
    return " and ".join(name for name in ("q", "l") if name in taken)


def _turns_itself(cls: type) -> bool:
    """Return whether a compiled method of a class turns states into the described axes."""
    turning = {"described", "described_attitude"}
    return any(turning & {*method.__code__.co_names} for method in _compiled(cls))


def _degrees(effects: Effects) -> Iterator[str]:
    """Find angles of shipped effects that look like degrees."""
    for label, effect in effects:
        for field, unit in facts(effect).units.items():
            if unit == "rad" and is_shipped(effect):
                yield degrees_note(getattr(effect, field), f"[effects.{label}] {field} =", 2, CURE)


def _no_mass(effects: Effects) -> Iterator[str]:
    """Find effects whose torque has the factor m, for a body without a given mass."""
    for label, effect in effects:
        if isinstance(effect, (Gravity, MovingPivot)):
            yield (
                f"[effects.{label}] acts on an assumed mass of 1 kg, because no mass is given: its"
                " torque is in proportion to [body] mass"
            )


def _hot(momentum: Any, seed: int, mass: Array, effects: Effects) -> Iterator[str]:
    """Find a kT given in K instead of J, for bodies small enough to respond to heat."""
    heats = [(f"effects.{label}", bath.kT) for label, bath in effects if isinstance(bath, Bath)]
    if isinstance(momentum, GibbsMomentum):
        heats.append(("start", draw((momentum.kT,), seed, "start.momentum.kT", 0, FEW)))
    for table, heat in heats:
        kelvin = float(np.median(heat)) / BOLTZMANN
        if np.median(mass) < 1e-9 and kelvin > COLD:
            yield (
                f"[{table}] kT = {np.median(heat):g} J is {kelvin:.2g} K: kT is in J, and 300 K "
                f"are {300 * BOLTZMANN:.4g} J"
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
