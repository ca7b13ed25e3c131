"""Notes on starts: angles in degrees, quaternions that are not unit, and bodies that never move."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.inputs.units import degrees_note, euler_degrees_note
from rigidmc.physics.effects.bath import Bath
from rigidmc.physics.effects.protocol import torque
from rigidmc.planning.effect_notes import of_member, scaled_bodies
from rigidmc.scene.quantities import draw, is_shared, is_variable
from rigidmc.scene.start import Start

FEW = 64  # members whose effects and angles are checked
CURE = 'write unit = "deg", or "30 deg"'
STILL = 1e-12  # of the largest torque: rounding of an attitude that is upright
Array = NDArray[np.float64]


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
    given = getattr(start, start.spin_name)
    at_rest = isinstance(given, tuple) and is_shared(given) and not any(given)
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
