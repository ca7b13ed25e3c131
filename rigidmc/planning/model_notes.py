"""Notes on a model: bodies that cannot exist, or with a density unlike any matter; effects that
exert no torque, and jumps and kinks in time of custom torques, across which steps of any integrator
have large errors; angles in degrees, quaternions that are not unit, and bodies that never move."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.arrays import Array
from rigidmc.inputs.measured import degrees_note, euler_degrees_note
from rigidmc.mechanics.impossible import causes_text
from rigidmc.mechanics.inertia import TOO_FAR, TRIANGLE, too_far, violates_triangle
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.pivot import MovingPivot
from rigidmc.physics.effects.protocol import facts, from_numbers, numbers, torque
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.quantities import draw, is_shared, is_variable
from rigidmc.scene.settings import Run
from rigidmc.scene.start import Start
from rigidmc.scene.validation import PILOT

# Density [kg/m3] of the uniform ellipsoid with a body's moments. Single solids
# have 1 to 25,000: foams have 10, and osmium 22,590. Scenes in custom units give moments with
# densities down to 1e-3; osmium gives 2e-5 if lengths in mm are read as m. A body denser than
# osmium cannot exist: of all bodies with these moments, the ellipsoid has the least peak density.
LIGHTEST, LIGHTEST_SOLID, DENSEST = 1e-3, 1.0, 25_000.0
USUAL = 2000.0  # kg/m3, of what people build
# {mistake: factor of the density of a body that is read as SI}
SOLID_UNITS = {
    "lengths in mm": 1e-9, "lengths in cm": 1e-6, "lengths in inches": 0.0254**3,
    "lengths in mm and the mass in g": 1e-6, "the mass in g": 1e3,
}  # fmt: skip
MOMENT_UNITS = {
    "moments in g cm2": 1e-7 ** 1.5, "moments in kg mm2": 1e-9, "moments in kg cm2": 1e-6,
    "moments in g mm2": 1e-9**1.5, "the mass in g": 10.0**7.5, "moments in g m2": 1e-3**1.5,
}  # fmt: skip
FAR = 100.0  # radii of gyration from the fixed point to the centre of mass
SMALLEST, LARGEST = 1e-21, 1e27  # kg: molecules are lighter, stars are heavier


def body_notes(body: Body) -> list[str]:
    """Return the notes on a body of plain numbers, as `scene_notes` has them for its scene."""
    moments, mass, centre = body.sample(0, 0, 1)
    run = Run(members=1)
    return [
        *impossible_bodies(body, run, False),
        *unlike_matter(body, moments, mass, centre),
        *far_centre(body, moments, mass, centre),
    ]


def impossible_bodies(body: Body, run: Run, mapped: bool) -> Iterator[str]:
    """Find bodies that cannot exist: I_i > I_j + I_k, or a centre of mass too far from the pivot.

    The second kind still runs: torques depend on m c alone, and units in which m = 1 and m g c = 1
    may leave no room for the centre.

    body : without grids;  mapped : whether it had some
    """
    count = PILOT if mapped else min(PILOT, run.first + run.members)
    moments, mass, centre = body.sample(run.seed, 0, count)
    impossible = violates_triangle(moments)
    which = f"of the first {count:,} bodies"
    if mapped:
        which = f"of {count:,} bodies spread over the grid"  # maps leave impossible bodies blank
    elif impossible.any():
        yield (
            f"[body] moments: {np.count_nonzero(impossible):,} {which} cannot exist and are flagged"
            f" invalid_input: they violate {TRIANGLE}"
        )
    bad = too_far(moments, mass, centre) & ~impossible
    if bad.any():
        alone = is_shared(body.moments, body.mass, body.centre)
        which = "the body" if alone else f"{np.count_nonzero(bad):,} {which}"
        causes = (
            causes_text(body.tensor, body.mass, body.centre)
            if alone
            else _millimetres(moments, mass, centre)
        )
        yield (
            f"[body] centre: {which} cannot exist: {TOO_FAR}{causes}; computed anyway, because the"
            " motion depends only on the moments and on m c"
        )


# Relative difference of two moments below which errors of 1e-8 in a tensor, as in printed digits,
# turn its principal axes by 0.01 rad or more.
NEARLY_EQUAL = 1e-6


def undetermined_axes(body: Body, run: Run) -> Iterator[str]:
    """Find principal axes that a tensor hardly determines, if the scene asks for components along
    them."""
    asks = body.frame == "principal" or any("principal_" in str(name) for name in run.save)
    if not asks or not (body.is_turned or body.axes != IDENTITY):
        return
    moments = body.sample(run.seed, 0, 1)[0][:, 0]
    for i, j in ((0, 1), (1, 2), (0, 2)):
        apart = abs(moments[i] - moments[j]) / max(moments[i], moments[j])
        if apart < NEARLY_EQUAL:
            yield (
                f"[body] tensor: moments {i + 1} and {j + 1} differ by {apart:.1g} of themselves:"
                f" its last digits determine the principal axes {i + 1} and {j + 1}, and all"
                " components along these; components in the described axes do not depend on them"
            )


def _millimetres(moments: Array, mass: Array, centre: Array) -> str:
    """Return a question if the centres, read as mm, would lie within the bodies; else ""."""
    size = np.sqrt(moments.max(0) / mass)
    ratio = float(np.median(np.sqrt((centre * centre).sum(0)) / size))
    return "; is centre in millimetres instead of m?" if 30.0 < ratio < 3e4 else ""


def unlike_matter(body: Body, moments: Array, mass: Array, centre: Array) -> Iterator[str]:
    """Find bodies of given mass, extended in three directions, with a density unlike any matter.

    The density is that of the uniform ellipsoid with the same moments.

    moments (3, n), mass (n,), centre (3, n) : of the first members
    """
    if is_shared(*body.quantities()):  # one represents all; saves 0.06 of 0.14 ms
        moments, mass, centre = moments[:, :1], mass[:1], centre[:, :1]
    second = _about_centre(moments, mass, centre)
    thick = second.min(0) > 1e-9 * second.max(0)  # plates, rods and points have no density
    # a mass of 1 beside moments means that only these are given
    real = thick & ((mass != 1.0) | bool(body.shape)) & (mass > SMALLEST) & (mass < LARGEST)
    if not real.any():
        return
    extents = np.sqrt(5.0 * second[:, real] / mass[real])
    densities = mass[real] / (4.0 / 3.0 * math.pi * extents.prod(0))
    size, density = 2.0 * float(np.median(extents.max(0))), float(np.median(densities))
    # a solid of 1 kg may have custom units; frames of several parts, particles and meshes have room
    # between their matter
    is_solid = len(body.shape) == 1 and body.shape[0].solid in SOLIDS
    lightest = LIGHTEST_SOLID if is_solid and np.all(mass != 1.0) else LIGHTEST
    if not lightest <= density <= DENSEST:
        what = "far less than air" if density < lightest else "more than osmium"
        units = SOLID_UNITS if body.shape else MOMENT_UNITS
        misfit = {word: abs(math.log10(density / factor / USUAL)) for word, factor in units.items()}
        likely, other, *_ = sorted(misfit, key=lambda word: misfit[word])
        numbers = "these sizes" if body.shape else "these moments"
        yield (
            f"[body] mass: {np.median(mass[real]):g} kg with {numbers} makes a body of "
            f"{size:.3g} m and {density:.2g} kg/m3, {what}: likely {likely}, or {other}"
        )


def far_centre(body: Body, moments: Array, mass: Array, centre: Array) -> Iterator[str]:
    """Find bodies whose centre of mass is many radii of gyration from the fixed point.

    Such a body can exist, and one of moments about the centre of mass is accepted with a centre in
    millimetres.

    moments (3, n), mass (n,), centre (3, n) : of the first members
    """
    distance = np.sqrt((centre * centre).sum(0))
    second = np.maximum(_about_centre(moments, mass, centre).sum(0), 0.0)
    far = distance > FAR * np.sqrt(second / mass)
    if body.has_mass and far.any() and (second > 0.0).all():
        shown = ", ".join(f"{x:g}" for x in 1e-3 * centre[:, far][:, 0])
        times = float(np.median((distance * np.sqrt(mass / second))[far]))
        yield (
            f"[body] centre: {np.median(distance[far]):g} m from the fixed point is {times:.2g}"
            f" radii of gyration: is centre in millimetres? In m, it is ({shown})"
        )


def _about_centre(moments: Array, mass: Array, centre: Array) -> Array:
    """Return ascending eigenvalues (3, n) of the second moments about the centre of mass
    [kg m2]."""
    second = np.eye(3)[:, :, None] * (0.5 * moments.sum(0) - moments)
    matrices = second - mass * centre[:, None] * centre
    return np.asarray(np.linalg.eigvalsh(np.moveaxis(matrices, -1, 0))).T


SAMPLES = 2000  # times: shorter pulses between them stay unseen
FINER = 32  # times that replace two intervals, three times over
SEEN = 1e-4  # least second difference that counts, relative to the largest torque


def kink_notes(
    effects: Sequence[tuple[str, Any]], moments: Array, static_moment: Array, t_end: float
) -> Iterator[str]:
    """Find torques of the first member with a jump or a kink at a time that no class states.

    effects : [(label, effect)] with arrays as fields;  moments, static_moment : (3, members)
    """
    body = MassProperties.of(moments[:, 0], static_moment[:, 0])
    for label, effect in effects:
        if is_shipped(effect) or "t" not in argument_names(effect, "torque"):
            continue
        first = from_numbers(type(effect), [float(x[0]) for _, _, x in numbers(effect)])
        if what := _kink_of(first, body, t_end):
            yield (
                f"[effects.{label}] its torque {what}, and a step across it has a large error with"
                " any integrator: state the parameter that is this time, as in"
                ' @effect(switches=("on", "off")), and steps end there'
            )


def _kink_of(effect: Any, body: MassProperties, t_end: float) -> str:
    """Return "jumps near t = ..." or "has a kink near t = ..." of a body at rest; "" if neither.

    Second differences of a smooth function fall as the square of the interval; at a kink they fall
    as the interval, at a jump not at all.
    """

    def at(t: Array) -> Array:
        state = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        return np.array(np.broadcast_arrays(*torque(effect, body, t, *state), t)[:3])

    stated = [x for name in facts(effect).switches for x in np.ravel(getattr(effect, name))]
    try:
        with np.errstate(all="ignore"):
            return _kink(at, t_end, np.array(stated, float))
    except (TypeError, ValueError, ArithmeticError):  # the method takes no arrays
        return ""


def _kink(at: Callable[[Array], Array], t_end: float, stated: Array) -> str:
    times = np.linspace(0.0, t_end, SAMPLES + 1)
    values = at(times)
    size = float(np.abs(values).max())
    bends, width = _bends(values), t_end / SAMPLES
    for time in stated:
        bends[np.abs(times[1:-1] - time) <= 1.01 * width] = 0.0
    i = int(np.argmax(bends))
    bend, time = float(bends[i]), float(times[i + 1])
    if not SEEN * size < bend < np.inf:
        return ""
    for _ in range(3):
        some = np.linspace(time - width, time + width, 2 * FINER + 1)
        bends, width = _bends(at(some)), width / FINER
        i, last = int(np.argmax(bends)), bend
        bend, time = float(bends[i]), float(some[i + 1])
    # On a grid FINER times as fine, a jump keeps its bend, a kink has 1/FINER of it, and a smooth
    # torque 1/FINER^2.
    if bend > 0.3 * last:
        return f"jumps near t = {time:.4g} s"
    return f"has a kink near t = {time:.4g} s" if bend > 0.3 * last / FINER else ""


def _bends(values: Array) -> Array:
    """Return the size of the second differences of values (3, n)."""
    bends: Array = np.abs(np.diff(values, 2)).max(0)
    return bends


def is_shipped(effect: Any) -> bool:
    """Return whether an effect comes with the package."""
    return type(effect) in EFFECTS.values()


def idle_effects(
    effects: Sequence[tuple[str, Any]], moments: Array, centre: Array
) -> Iterator[str]:
    """Find effects [(label, effect)] of the package that exert no torque on any of the given
    members.

    moments, centre : (3, n) of the members
    """
    few, body = moments.shape[1], scaled_bodies(moments, centre)
    chance = np.random.default_rng(1)
    for label, effect in effects:
        if not is_shipped(effect) or any(_acts(effect, body, i, chance) for i in range(few)):
            continue
        why = "its torque is 0 at any attitude and spin"
        if type(effect) in (Gravity, MovingPivot) and not centre.any():
            why = "the centre of mass is on the fixed point: give [body] centre or pivot"
        yield f"[effects.{label}] has no effect on the first {count_text(few, 'member')}: {why}"


def scaled_bodies(moments: Array, centre: Array) -> MassProperties:
    """Return bodies of size 1, on which no torque underflows to 0; a centre of 0 stays 0."""
    reach = np.abs(centre).max() or 1.0  # a centre of 0 is divided by 1, in any unit
    with np.errstate(all="ignore"):
        bodies: MassProperties = MassProperties.of(
            tuple(moments / moments.max()), tuple(centre / reach)
        )
    return bodies


def of_member(effect: Any, bodies: MassProperties, i: int) -> tuple[Any, MassProperties]:
    """Return the effect and the body of member i."""
    body = MassProperties(*(np.asarray(x)[i] for x in bodies[:BODY_NUMBERS]))
    return from_numbers(type(effect), [x[i] for _, _, x in numbers(effect)]), body


def _acts(effect: Any, bodies: MassProperties, i: int, chance: np.random.Generator) -> bool:
    """Return whether an effect exerts a torque on member i at a random attitude, spin and time; for
    a bath, whether it has friction."""
    effect, body = of_member(effect, bodies, i)
    if isinstance(effect, Bath):
        return bool(effect.gamma != 0.0)
    q, l, t = (
        chance.normal(size=4),
        chance.normal(size=3) / max(body[:3]),
        chance.uniform(0.1, 10.0),
    )
    return any(torque(effect, body, t, tuple(q / np.linalg.norm(q)), tuple(l)))


FEW = 64  # members whose effects and angles are checked
CURE = 'write unit = "deg", or "30 deg"'
STILL = 1e-12  # of the largest torque: rounding of an attitude that is upright


def angle_notes(start: Start, seed: int) -> Iterator[str]:
    """Find angles of a start without grids that look like degrees."""
    if start.has_euler_angles:
        angles = draw(start.attitude, seed, "start.attitude", 0, FEW)
        what = "[start] attitude: an Euler angle of"
        yield euler_degrees_note(angles, what, CURE, is_shared(start.attitude))
    word = start.spin_name
    spin = getattr(start, word)
    for field, most in (("angle", 1), ("azimuth", 2)):
        if hasattr(spin, field):
            angles = draw((getattr(spin, field),), seed, f"start.{word}.{field}", 0, FEW)
            yield degrees_note(angles, f"[start] {word}.{field} =", most, CURE)


def quaternion_notes(start: Start) -> Iterator[str]:
    """Find quaternions whose length is not 1."""
    attitude = start.attitude
    if not isinstance(attitude, tuple) or len(attitude) != 4 or is_variable(*attitude):
        return
    sizes = np.atleast_1d(np.sqrt(sum(np.square(part) for part in attitude)))
    worst = sizes[np.abs(sizes - 1.0).argmax()]
    if abs(worst - 1.0) > 1e-6:
        yield f"[start] attitude: a quaternion of length {worst:.9g} is normalised to 1"


def motionless(start: Start, effects: Sequence[Any], moments: Array, centre: Array) -> str:
    """Return a note if all members start at rest where no torque acts, so that nothing moves;
    else "".

    start : without grids;  effects : of the package, with arrays as fields
    moments, centre : (3, n) of the members
    """
    spin = getattr(start, start.spin_name)
    at_rest = isinstance(spin, tuple) and is_shared(spin) and not any(spin)
    if not at_rest or start.relative_to_orbit:
        return ""
    lean = ", or an attitude that leans, such as (0, 0.1, 0)" if effects else ""
    cure = f"[start] the body is at rest where no torque acts: nothing moves; give omega{lean}"
    few, bodies = moments.shape[1], scaled_bodies(moments, centre)
    chance = np.random.default_rng(1)
    attitudes = start.sample_attitude(0, 0, few)
    for effect in effects:
        if isinstance(effect, Bath):
            return ""
        for i in range(few):
            acting, body = of_member(effect, bodies, i)
            q, anywhere = attitudes[:, i], chance.normal(size=(3, 4))
            times = (0.0, *chance.uniform(0.1, 10.0, 2))
            here = [torque(acting, body, t, tuple(q), (0.0,) * 3) for t in times]
            there = [
                torque(acting, body, t, tuple(p / np.linalg.norm(p)), (0.0,) * 3)
                for t, p in zip(times, anywhere, strict=True)
            ]
            if np.abs(here).max() > STILL * np.abs(there).max():
                return ""
    return cure
