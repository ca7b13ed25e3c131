"""Errors of hard cases that need no truth: how far constants of the motion drift."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.euler import kinetic_energy
from rigidmc.dynamics.so3 import dot, up
from rigidmc.effects.sums import total_energy_scale
from rigidmc.engine.forces import energies
from rigidmc.planning.tolerance.deviation import relative
from rigidmc.scene.scene import Scene
from rigidmc.studies.stress.case import ErrorOf
from rigidmc.studies.stress.integrate import fastest_rate, run, staged_physics, worst

Values = NDArray[np.float64]
# quantities(body, effects, q, l) -> [(values (..., times, members), scale (members))]
Quantities = Callable[[Any, Any, Values, Values], list[tuple[Values, Values]]]


def constant(
    scene: Scene,
    t_end: float,
    quantities: Quantities,
    saves: int = 8,
    steps: int | None = None,
    **options: Any,
) -> ErrorOf:
    """Largest change of some quantities, each relative to its scale; inf if that alone is 0."""

    def error(integrator: str, share: float) -> float:
        n = max(saves, round(steps * share / saves) * saves) if steps else None
        end = t_end * (n / steps if n and steps else 1.0)
        ds = run(scene, integrator, end, saves, steps=n, **options)
        body, effects = staged_physics(scene, ds.sizes["member"])
        q, l = np.moveaxis(ds.attitude.values, 1, 0), np.moveaxis(ds.momentum.values, 1, 0)
        largest = np.zeros(ds.sizes["member"])
        for values, scale in quantities(body, effects, q, l):
            values = np.reshape(values, (-1, *np.shape(values)[-2:]))
            change = np.abs(values - values[:, :1]).max((0, 1))
            off = np.nan_to_num(relative(change, scale), nan=math.inf, posinf=math.inf)
            largest = np.maximum(largest, off)
        return worst(ds, largest)

    return error


def conserved(body: Any, effects: Any, q: Values, l: Values) -> list[tuple[Values, Values]]:
    """Energy and |L|^2 of a free body; energy and L_z under gravity."""
    play = kinetic_energy(body, l[:, 0]) + total_energy_scale(effects, body)
    energy = kinetic_energy(body, l) + energies(effects, body, q)
    if not effects:
        return [(energy, play), (dot(l, l), dot(l[:, 0], l[:, 0]))]
    largest = np.sqrt(2.0 * play / np.min([body.i1, body.i2, body.i3], axis=0))
    return [(energy, play), (dot(l, up(q)), largest)]


def direction(body: Any, effects: Any, q: Values, l: Values) -> list[tuple[Values, Values]]:
    """L in body axes, and under gravity the vertical: constant in a permanent rotation."""
    momentum = np.array(l), np.sqrt(dot(l[:, 0], l[:, 0]))
    return [momentum, (np.array(up(q)), np.ones(l.shape[-1]))] if effects else [momentum]


def walk(scene: Scene, turn: float, steps: int) -> ErrorOf:
    """How much faster than sqrt(n) the drift of energy and |L|^2 grows with the steps n.

    The largest of rms(n)/rms(n0) / sqrt(n/n0) over n = 2^k n0;  turn : rotation in a step [rad]
    """

    def error(integrator: str, share: float) -> float:
        saves = 64
        n = saves * round(steps * share / saves)
        ds = run(scene, integrator, n * turn / fastest_rate(scene), saves, steps=n)
        body, effects = staged_physics(scene, ds.sizes["member"])
        q, l = np.moveaxis(ds.attitude.values, 1, 0), np.moveaxis(ds.momentum.values, 1, 0)
        ratios = []
        for values, scale in conserved(body, effects, q, l):
            rms = np.sqrt((((values - values[:1]) / scale) ** 2).mean(1))[[1, 4, 16, 64]]
            rms = np.maximum(rms, 1.1e-16)
            ratios.append(np.max(rms[1:] / rms[0] / np.sqrt([4, 16, 64])))
        return max(worst(ds, 0.0), float(np.max(ratios)))

    return error
