"""Starts relative to the local frame of an orbit, turned into space.

The frame is that of `OrbitAngles`: x along the track, y opposite to the orbit normal, z from the
body to the central body. It turns about the orbit normal at the rate of the true anomaly f:

    A = A_orbit A_relative,   omega = omega_relative + A^T (0, 0, df/dt)
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.physics.dynamics.so3 import arctan2, into_body, multiply, sincos
from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.gravity_gradient import GravityGradient, anomaly_rate, place
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import draw
from rigidmc.scene.start import Start
from rigidmc.scene.start_tables import relative_components

_AT_ZERO = (0.5, -0.5, -0.5, 0.5)  # attitude of the frame at the true anomaly 0


def relative_to_orbit(model: Model) -> tuple[str, ...]:
    """Return what of the start is relative to the orbit; () without an orbit, as in a model that
    only measures the cost of a step without effects."""
    has_orbit = any(isinstance(effect, GravityGradient) for effect in model.effects)
    return model.start.relative_to_orbit if has_orbit else ()


def from_orbit(effects: Sequence[Any], drawn: Mapping[str, Array], relative: Array) -> Array:
    """Return the attitudes in space (4, n) of attitudes in the frame of the orbit at t = 0.

    effects : with one GravityGradient;  drawn : its values for the members, (1, n) each
    """
    cosine, sine = place(_orbit(effects, drawn), 0.0)
    half_sine, half_cosine = sincos(0.5 * arctan2(sine, cosine))
    zero = np.zeros_like(half_sine)
    frame = multiply((half_cosine, zero, zero, half_sine), _AT_ZERO)
    return np.stack(multiply(frame, tuple(relative)))


def with_orbit_rate(
    effects: Sequence[Any], drawn: Mapping[str, Array], q: Array, relative: Array
) -> Array:
    """Return omega (3, n) [rad/s] of angular velocities relative to the frame at t = 0.

    q : attitudes in space (4, n) of the axes of `relative`
    """
    orbit = _orbit(effects, drawn)
    rate = anomaly_rate(orbit, place(orbit, 0.0)[0])
    zero = np.zeros_like(rate)
    turning: Array = np.stack(into_body(tuple(q), (zero, zero, rate)))
    return relative + turning


def relative_inputs(start: Start, sampler: Any, first: int, count: int) -> dict[str, Array]:
    """Draw the values relative to the orbit that a result stores beside those in space."""
    return {
        f"start_relative_{key}": draw(getattr(start, key), sampler, f"start.{key}", first, count)
        for key in relative_components(start)
    }


def _orbit(effects: Sequence[Any], drawn: Mapping[str, Array]) -> GravityGradient:
    """Return the GravityGradient of the members, with arrays (n,) in place of numbers."""
    label = next(label for label, e in label_effects(effects) if isinstance(e, GravityGradient))
    return GravityGradient(*(drawn[f"{label}_{name}"][0] for name in GravityGradient._fields))
