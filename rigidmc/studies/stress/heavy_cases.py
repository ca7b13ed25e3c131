"""Hard cases of a heavy top: groups H7, H10 and H11.

A group is a function with `@group` that yields its `HardCase`s.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.euler_rates import omega_from_euler_rates
from rigidmc.mechanics.integrable_tops import grioli
from rigidmc.mechanics.rotation import from_euler, matrix
from rigidmc.physics.dynamics.so3 import vertical
from rigidmc.studies.stress.case import Comparison, HardCase, group, makes_steps
from rigidmc.studies.stress.motions import (
    HANGING,
    UPRIGHT,
    direction,
    invariants,
    largest_change,
    lean_by,
    random_tops,
    rotation_about,
    run,
    tops,
    worst,
)
from rigidmc.studies.stress.truths import distance_to_closed_form, same_bits

A, C, K = 1.0, 0.7, 1.3  # moments A, A, C [kg m2] and weight times height K [N m]
MOMENTS, WEIGHT = (A, A, C), (0.0, 0.0, K)

TopStart = tuple[tuple[float, ...], tuple[float, ...], str]  # attitude, momentum, why


def top_starts() -> dict[str, TopStart]:
    """Return {name: (attitude, momentum, why it is hard)}."""
    rate, critical = math.sqrt(K / A), 2.0 * math.sqrt(A * K)
    homoclinic = np.array(MOMENTS) * omega_from_euler_rates(
        (0.0, math.pi / 3, 0.0),
        (2 * rate / math.sqrt(3), 0.0, (3 * A - C) * rate / (C * math.sqrt(3))),
    )
    return {
        "inverted, at rest": (
            UPRIGHT, (0.0, 0.0, 0.0),
            "an unstable equilibrium: any rounding error makes it fall",
        ),
        "hanging, at rest": (
            HANGING, (0.0, 0.0, 0.0),
            "an equilibrium with |L| = 0: formulas must not divide by |L|",
        ),
        "sleeping, just stable": (
            lean_by(1e-3), (0.0, 0.0, critical * math.sqrt(1.001)),
            "C^2 n^2 = 4 A k (1 + 1e-3), leaning by 1e-3: it nutates slowly and far",
        ),
        "sleeping, just unstable": (
            lean_by(1e-3), (0.0, 0.0, critical * math.sqrt(0.999)),
            "C^2 n^2 = 4 A k (1 - 1e-3), leaning by 1e-3",
        ),
        "homoclinic": (
            tuple(from_euler((0.0, math.pi / 3, 0.0))), tuple(homoclinic),
            "it never reaches the vertical; errors grow as the inverse of the distance to it",
        ),
        "cusps": (lean_by(0.9), (0.0, 0.0, 3.0), "the axis stops at every upper turning point"),
        "loops": (lean_by(0.9), (0.0, -0.35, 3.0), "the precession reverses"),
        "through the vertical": (
            lean_by(1.0), (5.0, 0.0, 0.0), "Euler angles are singular at the vertical",
        ),
        "close by the vertical": (
            lean_by(1.0), (5.0, 1e-9, 1e-9), "Euler angles change by pi within 1e-9 s",
        ),
        "pendulum from inverted": (
            lean_by(1e-6), (0.0, 0.0, 0.0),
            "it falls from 1e-6 next to the unstable equilibrium, and returns to it",
        ),
        "fast": (lean_by(1.0), (0.0, 0.0, 100.0), "a thousand turns in one nutation"),
    }  # fmt: skip


@group("H7", "heavy symmetric tops")
def heavy_tops() -> Iterator[HardCase]:
    """Yield heavy symmetric tops: equilibria, sleeping tops, cusps, loops, passages of the
    vertical."""
    for word, (attitude, momentum, why) in top_starts().items():
        scene = tops(MOMENTS, momentum, attitude, WEIGHT)
        yield HardCase(word, why, distance_to_closed_form(scene, 4.0 if word == "fast" else 12.0))
    rest = tops(np.tile(MOMENTS, (2, 1)), np.zeros((2, 3)), np.array([UPRIGHT, HANGING]), WEIGHT)
    yield HardCase(
        "equilibria stay, 1e5 steps",
        "torques of 1e-17 N m would make the upright top fall within 30 s",
        largest_change(rest, 1e3, direction, steps=100_000),
        truth="L = 0 to the bit",
        asked=1e-15,
    )
    mixed = tops((1.0, 1.0, 0.7), (0.4, 0.3, 2.0), lean_by(0.8), WEIGHT)
    yield HardCase(
        "energy and L_z, 1e5 steps",
        "a thousand nutations: the energy error of a splitting must stay bounded, and L_z"
        " must be conserved to rounding",
        largest_change(mixed, 5e3, invariants, saves=50, steps=100_000),
    )


@group("H10", "integrable and steady heavy tops")
def integrable_tops() -> Iterator[HardCase]:
    """Yield integrable (Kovalevskaya, Goryachev-Chaplygin) and steady tops (Staude, Grioli)."""
    attitude = tuple(from_euler((0.3, 1.1, 0.4)))
    kovalevskaya = tops((2.0, 2.0, 1.0), (0.5, 1.3, 0.7), attitude, (1.0, 0.0, 0.0))
    yield HardCase(
        "Kovalevskaya's constant",
        "|(w1 + i w2)^2 - (k/C)(u1 + i u2)|^2, of degree 4: no integrator conserves it by"
        " construction",
        largest_change(kovalevskaya, 40.0, kovalevskaya_constant),
        truth="invariant (Kovalevskaya 1889)",
        quick=True,
    )
    attitude = tuple(from_euler((0.2, 1.0, 0.6)))
    u = np.array(vertical(attitude))
    momentum = np.array((1.6, 0.9, 0.5))
    momentum = momentum - np.dot(momentum, u) * u  # L_z = 0
    goryachev = tops((4.0, 4.0, 1.0), tuple(momentum), attitude, (1.0, 0.0, 0.0))
    yield HardCase(
        "Goryachev-Chaplygin's constant",
        "conserved only while L_z = 0: a drift of L_z destroys it",
        largest_change(goryachev, 40.0, goryachev_constant),
        truth="invariant (Goryachev 1900)",
    )
    yield HardCase(
        "Staude's permanent rotation",
        "an asymmetric top spins steadily about the vertical, which is not a principal axis:"
        " two large torques cancel",
        staude_rotation(),
        truth="L and the vertical are constant in the body (Staude 1894)",
    )
    yield HardCase(
        "Grioli's regular precession",
        "an asymmetric top precesses at a constant rate about an inclined axis",
        grioli_precession(),
        quick=True,
    )


def kovalevskaya_constant(body: Any, effects: Any, q: Array, l: Array) -> list[tuple[Array, Array]]:
    """Return energy, L_z and |(w1 + i w2)^2 - (k/C)(u1 + i u2)|^2, for A = B = 2 C."""
    u, w1, w2 = vertical(q), l[0] * body.i1, l[1] * body.i2
    real = w1 * w1 - w2 * w2 - body.p1 * body.i3 * u[0]
    imaginary = 2 * w1 * w2 - body.p1 * body.i3 * u[1]
    value = real * real + imaginary * imaginary
    return [*invariants(body, effects, q, l), (value, np.abs(value[0]))]


def goryachev_constant(body: Any, effects: Any, q: Array, l: Array) -> list[tuple[Array, Array]]:
    """Return energy, L_z and L3 (L1^2 + L2^2) - 4 k C L1 u3, for A = B = 4 C and L_z = 0."""
    u = vertical(q)
    value = l[2] * (l[0] * l[0] + l[1] * l[1]) - 4.0 * body.p1 / body.i3 * l[0] * u[2]
    # the constant may be 0: its terms are of the size |L|^3 = 1 kg3 m6 s-3 of these tops
    return [*invariants(body, effects, q, l), (value, np.maximum(np.abs(value[0]), 1.0))]


def staude_rotation() -> Comparison:
    """Compare L and the vertical in the body with their starts, in a permanent rotation at
    2 rad/s."""
    i, vertical, spin = np.array((1.0, 1.4, 2.0)), np.array((0.2, 0.3, 1.0)), 2.0
    vertical /= np.linalg.norm(vertical)
    weight = spin**2 * i * vertical - 2.0 * vertical
    q = rotation_about(np.cross(vertical, (0.0, 0.0, 1.0)), math.acos(vertical[2]))
    scene = tops(tuple(i), tuple(spin * i * vertical), tuple(q), tuple(weight))
    return largest_change(scene, 3.0, direction)


def grioli_precession() -> Comparison:
    """Compare L and the vertical in the body with Grioli's precession, for moments 1, 1.4, 2."""
    moments = np.array((1.0, 1.4, 2.0))
    start = grioli(moments, 1.0, 0.0)
    axis = np.cross(start.up, (0.0, 0.0, 1.0))
    q = rotation_about(axis, math.atan2(np.linalg.norm(axis), start.up[2]))
    l = moments * start.omega
    scene = tops(tuple(moments), tuple(l), tuple(q), tuple(start.centre))

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, 20.0)
        true = grioli(moments, 1.0, ds.time.values)
        true_l, up = moments * true.omega, matrix(ds.attitude.values[..., 0])[:, 2]
        off = np.linalg.norm(ds.momentum.values[..., 0] - true_l, axis=1)
        off /= np.linalg.norm(true_l, axis=1)
        lean = np.linalg.norm(up - true.up, axis=1)
        return worst(ds, np.array([np.maximum(off, lean).max()]))

    return Comparison(error, "closed form (Grioli 1947)", scene.effects, makes_steps)


@group("H11", "chaos")
def chaos() -> Iterator[HardCase]:
    """Yield chaotic tops: bits must not depend on the blocks, and invariants must be conserved."""
    moments, momentum = random_tops(64, 2)
    random = np.random.default_rng(3)
    q = random.normal(size=(64, 4))
    attitude = q / np.linalg.norm(q, axis=1, keepdims=True)
    heavy = tops(moments, momentum, attitude, random.normal(0.0, 0.3, (64, 3)))
    yield HardCase(
        "same bits in any blocks, heavy",
        "errors grow exponentially: a single wrong bit would show",
        same_bits(heavy, 20.0),
        asked=0.0,
        quick=True,
    )
    near = np.array([(1e-9, 2.0, 1e-9 * i) for i in range(64)])
    yield HardCase(
        "same bits in any blocks, by the separatrix",
        "errors grow exponentially: a single wrong bit would show",
        same_bits(tops(np.tile((1.0, 2.0, 3.0), (64, 1)), near), 40.0),
        asked=0.0,
    )
    yield HardCase(
        "energy and L_z of 64 chaotic tops",
        "positions are unpredictable, but invariants must be conserved",
        largest_change(heavy, 100.0, invariants),
    )
