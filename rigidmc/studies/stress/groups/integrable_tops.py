"""Integrable tops (Kovalevskaya, Goryachev-Chaplygin) and steady ones (Staude, Grioli)."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.mechanics.rotation import from_euler, matrix
from rigidmc.physics.dynamics.so3 import up
from rigidmc.studies.stress.case import Case, ErrorOf, makes_steps
from rigidmc.studies.stress.motions import (
    GRAVITY,
    Values,
    conserved,
    constant,
    direction,
    rotated,
    run,
    tops,
    worst,
)

TITLE = "integrable and steady heavy tops"


def cases() -> Iterator[Case]:
    attitude = tuple(from_euler((0.3, 1.1, 0.4)))
    kovalevskaya = tops((2.0, 2.0, 1.0), (0.5, 1.3, 0.7), attitude, (1.0, 0.0, 0.0))
    yield Case(
        "Kovalevskaya's constant",
        "|(w1 + i w2)^2 - (k/C)(u1 + i u2)|^2, of degree 4: no integrator conserves it by"
        " construction",
        "invariant (Kovalevskaya 1889)",
        constant(kovalevskaya, 40.0, kovalevskaya_constant),
        effects=GRAVITY,
        claims=makes_steps,
        quick=True,
    )
    attitude = tuple(from_euler((0.2, 1.0, 0.6)))
    u = np.array(up(attitude))
    momentum = np.array((1.6, 0.9, 0.5))
    momentum = momentum - np.dot(momentum, u) * u  # L_z = 0
    goryachev = tops((4.0, 4.0, 1.0), tuple(momentum), attitude, (1.0, 0.0, 0.0))
    yield Case(
        "Goryachev-Chaplygin's constant",
        "conserved only while L_z = 0: a drift of L_z destroys it",
        "invariant (Goryachev 1900)",
        constant(goryachev, 40.0, goryachev_constant),
        effects=GRAVITY,
        claims=makes_steps,
    )
    yield Case(
        "Staude's permanent rotation",
        "an asymmetric top spins steadily about the vertical, which is no principal axis:"
        " two large torques cancel",
        "L and the vertical are constant in the body (Staude 1894)",
        staude(),
        effects=GRAVITY,
        claims=makes_steps,
    )
    yield Case(
        "Grioli's regular precession",
        "an asymmetric top precesses at a constant rate about an inclined axis",
        "closed form (Grioli 1947)",
        grioli(),
        effects=GRAVITY,
        claims=makes_steps,
        quick=True,
    )


def kovalevskaya_constant(
    body: Any, effects: Any, q: Values, l: Values
) -> list[tuple[Values, Values]]:
    """|(w1 + i w2)^2 - (k/C)(u1 + i u2)|^2 beside energy and L_z, for A = B = 2 C."""
    u, w1, w2 = up(q), l[0] * body.i1, l[1] * body.i2
    real = w1 * w1 - w2 * w2 - body.p1 * body.i3 * u[0]
    imaginary = 2 * w1 * w2 - body.p1 * body.i3 * u[1]
    value = real * real + imaginary * imaginary
    return [*conserved(body, effects, q, l), (value, np.abs(value[0]))]


def goryachev_constant(
    body: Any, effects: Any, q: Values, l: Values
) -> list[tuple[Values, Values]]:
    """L3 (L1^2 + L2^2) - 4 k C L1 u3 beside energy and L_z, for A = B = 4 C and L_z = 0."""
    u = up(q)
    value = l[2] * (l[0] * l[0] + l[1] * l[1]) - 4.0 * body.p1 / body.i3 * l[0] * u[2]
    # the constant may be 0: 1 kg3 m6 s-3 is |L|^3 of these tops, as large as its terms
    return [*conserved(body, effects, q, l), (value, np.maximum(np.abs(value[0]), 1.0))]


def staude() -> ErrorOf:
    """Change of L and of the vertical in the body, in a permanent rotation at 2 rad/s."""
    i, vertical, spin = np.array((1.0, 1.4, 2.0)), np.array((0.2, 0.3, 1.0)), 2.0
    vertical /= np.linalg.norm(vertical)
    weight = spin**2 * i * vertical - 2.0 * vertical
    q = rotated(np.cross(vertical, (0.0, 0.0, 1.0)), math.acos(vertical[2]))
    scene = tops(tuple(i), tuple(spin * i * vertical), tuple(q), tuple(weight))
    return constant(scene, 3.0, direction)


def grioli() -> ErrorOf:
    """Error of L and of the vertical in the body, in Grioli's precession of moments 1, 1.4, 2."""
    a, b, c, k = 1.0, 1.4, 2.0, 1.0
    e = np.array((math.sqrt((b - a) / (c - a)), 0.0, math.sqrt((c - b) / (c - a))))
    j, d = a + c - b, e[0] * e[2] * (a - c)
    nu = math.sqrt(k / math.hypot(j, d))
    alpha, beta = nu**2 * j / k, -(nu**2) * d / k
    x1, x2 = np.array((e[2], 0.0, -e[0])), np.array((0.0, 1.0, 0.0))

    def motion(
        t: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(L, vertical) in body axes at times t, each (3, times)."""
        p = -nu * t
        omega = nu * (np.cos(p) * x1[:, None] + np.sin(p) * x2[:, None] + e[:, None])
        first = alpha * np.cos(p) + beta * np.sin(p) ** 2
        second = alpha * np.sin(p) - beta * np.sin(p) * np.cos(p)
        vertical = first * x1[:, None] + second * x2[:, None]
        return np.array((a, b, c))[:, None] * omega, vertical + beta * np.cos(p) * e[:, None]

    l, u = (x[:, 0] for x in motion(np.zeros(1)))
    axis = np.cross(u, (0.0, 0.0, 1.0))
    q = rotated(axis, math.atan2(np.linalg.norm(axis), u[2]))
    scene = tops((a, b, c), tuple(l), tuple(q), tuple(k * e))

    def error(integrator: str, share: float) -> float:
        ds = run(scene, integrator, 20.0)
        true_l, true_u = motion(ds.time.values)
        l = ds.momentum.values[..., 0].T
        off = np.linalg.norm(l - true_l, axis=0) / np.linalg.norm(true_l, axis=0)
        lean = np.linalg.norm(matrix(ds.attitude.values[..., 0])[:, 2].T - true_u, axis=0)
        return worst(ds, np.array([np.maximum(off, lean).max()]))

    return error
