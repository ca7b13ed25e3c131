"""Notes on bodies: those that cannot exist, and those with a density unlike any matter."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics.impossible import causes_text
from rigidmc.mechanics.inertia import TOO_FAR, TRIANGLE, too_far, violates_triangle
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.scene.body import IDENTITY, Body
from rigidmc.scene.quantities import Grid, is_shared
from rigidmc.scene.settings import Run
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
Array = NDArray[np.float64]


def body_notes(body: Body) -> list[str]:
    """Return the notes on a body of plain numbers, as `scene_notes` has them for its scene."""
    moments, mass, centre = body.sample(0, 0, 1)
    one = Run(members=1)
    return [
        *impossible_bodies(body, one, False),
        *unlike_matter(body, moments, mass, centre),
        *far_centre(body, moments, mass, centre),
    ]


def is_mapped(body: Body) -> bool:
    """Return whether a quantity of a body is a grid."""
    return any(isinstance(q, Grid) for q in body.quantities())


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
