"""Notes on a scene that runs, but perhaps not as meant: settings without effect, likely mistakes of units and signs. Each of LOOKS
yields notes."""

import math
from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.methods import implements
from rigidmc.effects import EFFECTS, labelled
from rigidmc.effects.bath import Bath
from rigidmc.effects.gravity import Gravity
from rigidmc.effects.gravity_gradient import GravityGradient
from rigidmc.effects.parameters import filled, numbers, shape
from rigidmc.effects.pivot import MovingPivot
from rigidmc.effects.protocol import facts, torque
from rigidmc.scene.body import broken
from rigidmc.scene.checks import PILOT
from rigidmc.scene.conservation import conservation
from rigidmc.scene.idle import idle
from rigidmc.scene.laws import GibbsMomentum
from rigidmc.scene.quantities import Grid, draw, is_open

FEW = 64  # members whose effects and angles are looked at
BOLTZMANN = 1.380649e-23  # J/K
# Central bodies: G M [m3/s2], told apart to 2 %, and radius [m]. Source: Archinal et al., Celest. Mech. Dyn. Astron. 130 (2018) 22; JPL DE440.
CENTRES = {
    "the Sun": (1.32712e20, 6.957e8), "Venus": (3.24859e14, 6.0518e6), "the Earth": (3.98600e14, 6.371e6), "the Moon": (4.90280e12, 1.7374e6),
    "Mars": (4.28284e13, 3.3895e6), "Jupiter": (1.26713e17, 6.9911e7), "Saturn": (3.79406e16, 5.8232e7),
}  # fmt: skip
# Density [kg/m3] of the uniform ellipsoid with a body's moments. Osmium with lengths in mm taken for m has 2e-5; scenes in units of
# their own reach 1e-3. Above osmium the body cannot exist: of all bodies with these moments the ellipsoid has the smallest peak
# density.
LIGHTEST, DENSEST = 1e-4, 22_590.0
SMALLEST, LARGEST = 1e-21, 1e27  # kg: below are molecules, above are stars
COLD = 1e6  # K: small bodies that tumble in a bath are colder


class Seen(NamedTuple):
    """A scene, its Plan, and its first FEW members: their bodies, and [(label, effect)] with arrays for numbers."""

    scene: Any
    plan: Any
    moments: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    effects: list


def notes(scene, plan, units=None):
    """What the user of a scene should know, in words: `rigidmc run`, `show` and `check` print it, `simulate` warns with it.

    units : how the plan was rescaled, None if it was not. If a tolerance chose the steps, notes of the plan are left out: the error
        is measured.
    """
    made = () if scene.run.integrator == "auto" else plan.notes
    told = [
        note if units is None else f"{note} (in units of {1.0 / units.time:.6g} s)" for note in made
    ]
    seen = _seen(scene, plan)
    return (*told, *(note for look in LOOKS for note in look(seen)))


def _seen(scene, plan):
    coarse, seed = scene.coarse(), scene.run.seed
    effects = []
    for label, effect in labelled(coarse.effects):
        each = [
            (field, value if shape(effect, field) else (value,))
            for field, value in zip(effect._fields, effect, strict=True)
        ]
        rows = [draw(parts, seed, f"effects.{label}.{field}", 0, FEW) for field, parts in each]
        effects.append((label, filled(type(effect), np.concatenate(rows))))
    moments, mass, centre = coarse.body.sample(seed, 0, FEW)
    return Seen(scene, plan, moments, mass, centre, effects)


def _idle_settings(seen):
    run = seen.scene.run
    for key, why in idle(run).items():
        yield f"[run] {key} = {getattr(run, key)} has no effect: {why}"
    for name in run.keep if isinstance(run.keep, dict) else ():
        if name not in run.save:
            yield f"[run] keep.{name} = {run.keep[name]} has no effect: {name} is not saved"
    if run.every is not None and run.every > run.t_end:
        yield f"[run] every = {run.every:g} s is longer than t_end = {run.t_end:g} s: only the first and the last state are saved"


def _idle_limits(seen):
    run, kept = seen.scene.run, conservation(seen.scene)
    if not run.checks or run.integrator == "closed":
        return
    if run.energy_limit is not None and kept["energy_drift"] != "yes":
        yield f"[run] energy_limit = {run.energy_limit:g} has no effect: {kept['energy_drift'].removeprefix('no: ')}"
    if (
        run.momentum_limit is not None
        and kept["l2"] != "yes"
        and (kept["lz"] != "yes" or not seen.plan.carried)
    ):
        why = (
            kept["lz"].removeprefix("no: ")
            if seen.plan.carried
            else f"{kept['l2'].removeprefix('no: ')}, and L_z is not followed"
        )
        yield f"[run] momentum_limit = {run.momentum_limit:g} has no effect: {why}"


def _anti_damping(seen):
    if not seen.scene.run.anti_damping:
        return
    if any(facts(effect).damps or implements(effect, "drives") for effect in seen.scene.effects):
        yield "[run] anti_damping = true: damping may be negative, which drives the body"
    else:
        yield "[run] anti_damping = true has no effect: the scene has no damping"


def _idle_effects(seen):
    size = np.abs(seen.centre).max()
    with np.errstate(all="ignore"):  # scaled to size 1, so that no torque underflows to 0
        body = MassProperties.of(
            tuple(seen.moments / seen.moments.max()), tuple(seen.centre / (size or 1.0))
        )
    chance = np.random.default_rng(1)
    for label, effect in seen.effects:
        if type(effect) not in EFFECTS.values() or any(
            _acts(effect, body, i, chance) for i in range(FEW)
        ):
            continue
        why = "its torque is 0 at any attitude and spin"
        if type(effect) in (Gravity, MovingPivot) and not seen.centre.any():
            why = "the centre of mass is on the fixed point: give [body] centre or pivot"
        yield f"[effects.{label}] has no effect on the first {FEW} members: {why}"


def _acts(effect, body, i, chance):
    """Whether an effect exerts a torque on member i at a random attitude, spin and time; for a bath, whether it has friction."""
    one, mine = (
        MassProperties(*(x[i] for x in body)),
        filled(type(effect), [x[i] for _, _, x in numbers(effect)]),
    )
    if isinstance(mine, Bath):
        return mine.gamma != 0.0
    q, l, t = chance.normal(size=4), chance.normal(size=3) / max(one[:3]), chance.uniform(0.1, 10.0)
    return any(torque(mine, one, t, tuple(q / np.linalg.norm(q)), tuple(l)))


def _gravity_upwards(seen):
    for label, effect in seen.effects:
        if isinstance(effect, Gravity) and (least := np.min(effect.g)) < 0.0:
            yield f"[effects.{label}] g = {least:g} pulls upwards: g > 0 pulls along -z"


def _orbit_inside(seen):
    for label, effect in seen.effects:
        if not isinstance(effect, GravityGradient):
            continue
        mu, nearest = (
            float(np.median(effect.mu)),
            float(np.min(effect.distance * (1.0 - effect.eccentricity))),
        )
        for name, (known, radius) in CENTRES.items():
            if abs(mu / known - 1.0) < 0.02 and nearest < radius:
                yield f"[effects.{label}] distance: {nearest:g} m from the centre is inside {name}, whose radius is {radius:g} m; distances are in m, from the centre"


def _angles(seen):
    start, seed, turn = seen.scene.coarse().start, seen.scene.run.seed, 2.0 * math.pi * (1.0 + 1e-9)
    rule = "is more than {} pi: angles are in rad, 30 degrees are 0.5236"
    if start.by_euler_angles:
        worst = np.abs(draw(start.attitude, seed, "start.attitude", 0, FEW)).max()
        if worst > turn:
            yield f"[start] attitude: an Euler angle of {worst:g} {rule.format(2)}"
    which = "omega" if start.momentum is None else "momentum"
    spin = getattr(start, which)
    for field, most in (("angle", ""), ("azimuth", "2")):
        if hasattr(spin, field):
            worst = np.abs(
                draw((getattr(spin, field),), seed, f"start.{which}.{field}", 0, FEW)
            ).max()
            if worst > turn * (1.0 if most else 0.5):
                yield f"[start] {which}.{field} = {worst:g} {rule.format(most)}".replace("  ", " ")
    for label, effect in seen.effects:
        for field, unit in facts(effect).units.items():
            if (
                unit == "rad"
                and type(effect) in EFFECTS.values()
                and (worst := np.abs(getattr(effect, field)).max()) > turn
            ):
                yield f"[effects.{label}] {field} = {worst:g} {rule.format(2)}"


def _quaternions(seen):
    attitude = seen.scene.start.attitude
    if not isinstance(attitude, tuple) or len(attitude) != 4 or is_open(*attitude):
        return
    sizes = np.atleast_1d(np.sqrt(sum(np.square(part) for part in attitude)))
    worst = sizes[np.abs(sizes - 1.0).argmax()]
    if abs(worst - 1.0) > 1e-6:
        yield f"[start] attitude: a quaternion of length {worst:.9g} is normalised to 1"


def _bodies(seen):
    """Bodies that cannot exist: those with I_i > I_j + I_k, and those whose centre of mass c lies too far from the fixed point.

    With S_i = (I_j + I_k - I_i)/2 the second moments about the centre of mass are diag(S) - m c c^T. This matrix has no negative
    eigenvalue if m sum c_i^2/S_i <= 1.
    """
    if any(
        isinstance(q, Grid) for q in seen.scene.body.quantities()
    ):  # they are the blank parts of a map
        return
    moments, mass, centre = seen.scene.body.sample(seen.scene.run.seed, 0, PILOT)
    none = int(np.count_nonzero(broken(moments)))
    if none:
        yield f"[body] moments: {none:,} of the first {PILOT:,} bodies cannot exist (I_i > I_j + I_k) and are flagged invalid_input"
    second = 0.5 * moments.sum(0) - moments
    with np.errstate(all="ignore"):
        bad = (
            mass * np.where(centre == 0.0, 0.0, centre**2 / second).sum(0) > 1.0 + 1e-9
        ) & ~broken(moments)
    if bad.any():
        rule = "with these moments the centre of mass cannot lie that far from the fixed point"
        yield f"[body] centre: {int(bad.sum()):,} of the first {PILOT:,} bodies cannot exist: {rule}"


def _density(seen):
    """A density unlike any matter, for bodies of given mass that extend in three directions: that of the uniform ellipsoid with
    their moments."""
    mass = seen.mass
    second = _about_centre(seen.moments, mass, seen.centre)
    thick = second.min(0) > 1e-9 * second.max(
        0
    )  # plates, rods and points without thickness have no density
    real = (
        thick & (mass != 1.0) & (mass > SMALLEST) & (mass < LARGEST)
    )  # a mass of 1 stands for none: only the moments are meant
    if not real.any():
        return
    extents = np.sqrt(5.0 * second[:, real] / mass[real])
    densities = mass[real] / (4.0 / 3.0 * math.pi * extents.prod(0))
    size, density = 2.0 * float(np.median(extents.max(0))), float(np.median(densities))
    if not LIGHTEST <= density <= DENSEST:
        what = "far less than air" if density < LIGHTEST else "more than osmium"
        made = f"{np.median(mass[real]):g} kg with these moments makes a body of {size:.3g} m and {density:.2g} kg/m3"
        yield f"[body] mass: {made}, {what}: are lengths in m and masses in kg?"


def _about_centre(moments, mass, centre):
    """Eigenvalues (3, n) of the matrices of second moments about the centre of mass [kg m2], ascending."""
    matrices = (
        np.eye(3)[:, :, None] * (0.5 * moments.sum(0) - moments) - mass * centre[:, None] * centre
    )
    return np.linalg.eigvalsh(np.moveaxis(matrices, -1, 0)).T


def _hot(seen):
    """A kT given in K instead of J, for bodies small enough to feel heat at all."""
    momentum = seen.scene.coarse().start.momentum
    found: list[tuple[str, Any]] = [
        (f"effects.{label}", effect.kT)
        for label, effect in seen.effects
        if isinstance(effect, Bath)
    ]
    if isinstance(momentum, GibbsMomentum):
        found.append(
            ("start", draw((momentum.kT,), seen.scene.run.seed, "start.momentum.kT", 0, FEW))
        )
    for table, heat in found:
        kelvin = float(np.median(heat)) / BOLTZMANN
        if np.median(seen.mass) < 1e-9 and kelvin > COLD:
            yield f"[{table}] kT = {np.median(heat):g} J is {kelvin:.2g} K: kT is in J, and 300 K are {300 * BOLTZMANN:.4g} J"


LOOKS = (
    _idle_settings, _idle_limits, _anti_damping, _idle_effects, _gravity_upwards, _orbit_inside, _angles, _quaternions, _bodies, _density, _hot,
)  # fmt: skip
