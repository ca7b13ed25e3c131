"""The closed form of a scene, where one covers it."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.dynamics.euler import kinetic_energy
from rigidmc.dynamics.so3 import dot
from rigidmc.effects import name_of
from rigidmc.effects.verbs import total_energy, total_energy_scale
from rigidmc.engine import layout
from rigidmc.errors import SceneError
from rigidmc.exact.free_top import Motion, free_motion, free_top
from rigidmc.exact.lagrange_top import lagrange_motion, lagrange_top
from rigidmc.observables import OBSERVABLES
from rigidmc.observables.verbs import value
from rigidmc.staging import physics, stage

COVERED = (
    "the free top (no effects), the free top with viscous_damping, and the Lagrange top (gravity on a body with two equal moments "
    "and its centre of mass on the third axis)"
)


class Case(NamedTuple):
    """What a closed form needs of the first members of a scene: moments, momentum (n, 3) and attitude (n, 4) at the start.

    weight : m g l (n,) about the symmetry axis of a Lagrange top, None of a free one;  axis : that axis;  damping : rate (n,) [1/s]
    """

    name: str
    moments: np.ndarray
    momentum: np.ndarray
    attitude: np.ndarray
    weight: Any
    axis: int
    damping: np.ndarray

    def motion(self, t):
        """The Motion of the members at t [s]: (n, 3); at times (m,) it is (m, n, 3)."""
        t = np.asarray(t, dtype=float)[..., None]
        if self.weight is not None:
            return lagrange_top(self.moments, self.weight, self.momentum, self.attitude, t, axis=self.axis)
        rate = self.damping
        # L' = L x omega - rate L runs through the undamped motion at the time (1 - exp(-rate t))/rate
        shrunk = np.where(rate > 0.0, -np.expm1(-rate * t) / np.where(rate > 0.0, rate, 1.0), t)
        l, omega, q = free_top(self.moments, self.momentum, self.attitude, shrunk)
        left = np.exp(-rate * t)[..., None]
        return Motion(left * l, left * omega, q)

    def what(self):
        """Kind of a free motion, Nutation of a Lagrange top."""
        if self.weight is None:
            return free_motion(self.moments, self.momentum)
        return lagrange_motion(self.moments, self.weight, self.momentum, self.attitude, axis=self.axis)


def closed_form(scene, members=None, first=None):
    """The Case of `members` members of a scene from index `first` on; SceneError where no closed form covers it, with why."""
    block, start = stage(scene, scene.run.first if first is None else first, members or scene.run.members, True)
    return case_of(scene, block, start)


def case_of(scene, block, start):
    """The Case of staged members, see `rigidmc.staging.stage`."""
    moments, momentum, attitude = start["moments"].T, block[layout.MOMENTUM : layout.REST].T, block[: layout.MOMENTUM].T
    effects = {name_of(effect) for effect in scene.effects}
    if unknown := sorted(effects - {"gravity", "viscous_damping"}):
        raise _uncovered(f"the scene has {', '.join(unknown)}")
    weight = (start["gravity_g"] * start["mass"] * start["centre"]).T if "gravity" in effects else np.zeros(moments.shape)
    rate = start.get("viscous_damping_rate", np.zeros(len(moments)))
    if not np.any(weight):
        name = "free top" + (" with viscous damping" if np.any(rate) else "")
        return Case(name, moments, momentum, attitude, None, 0, rate)
    if np.any(rate):
        raise _uncovered("a damped heavy top has none")
    heavy = np.flatnonzero(np.any(np.abs(weight) > 1e-12 * np.abs(weight).max(), axis=0))
    if heavy.size > 1:
        centre = ", ".join(f"{x:.4g}" for x in start["centre"][:, 0])
        raise _uncovered(f"its centre of mass ({centre}) m in principal axes lies on none of them")
    axis = int(heavy[0]) + 1
    i, j = (k for k in range(3) if k != axis - 1)
    apart = np.abs(moments[:, i] - moments[:, j])
    if np.any(apart > 1e-12 * moments[:, i]):
        at = int(np.argmax(apart))
        rule = f"its centre of mass lies on axis {axis}, but I{i + 1} = {moments[at, i]:.6g} and I{j + 1} = {moments[at, j]:.6g} differ"
        raise _uncovered(rule)
    return Case("Lagrange top", moments, momentum, attitude, weight[:, axis - 1], axis, rate)


def _uncovered(why):
    return SceneError("", "scene", None, f"no closed form covers it: {why}; covered are {COVERED}")


def closed_values(scene, block, start, times):
    """The values that a scene saves at `times`, (times, rows, n), from the closed form; the block gets its end, drifts and status."""
    sick = (block[layout.STATUS] > 0.0) | ~np.isfinite(block[: layout.REST]).all(0)
    block[layout.STATUS, sick & (block[layout.STATUS] == 0.0)] = layout.STATUSES["non_finite"]
    well = {name: np.where(sick, 1.0, values) for name, values in start.items()}  # some motion: nothing of it is kept
    staged = np.where(sick, 0.0, block)
    staged[0, sick] = 1.0
    motion = case_of(scene, staged, well).motion(times)
    q, l = np.moveaxis(motion.attitude, -1, 1), np.moveaxis(motion.momentum, -1, 1)
    # at t = 0 the start itself, and the sick stay there
    q, l = (np.where(sick | (times == 0.0)[:, None, None], x[None], y) for x, y in ((block[:4], q), (block[4:7], l)))
    body, effects = physics(scene.effects, block)
    observables = [OBSERVABLES[name]() for name in scene.recorded()]
    with np.errstate(all="ignore"):
        kinetic, squared = kinetic_energy(body, l[0]), dot(l[0], l[0])
        energy = kinetic + total_energy(effects, body, q[0])
        scale = np.maximum(np.abs(energy), 1e-3 * (kinetic + total_energy_scale(effects, body)))
        first = energy, 1.0 / np.where(scale > 0.0, scale, 1.0), squared, 1.0 / np.where(squared > 0.0, squared, 1.0)
        values = np.array(
            [
                [v for o in observables for v in value(o, body, effects, t, a, b, first, ())]
                for t, a, b in zip(times, q, l, strict=True)
            ]
        )
        drifts = [
            (
                abs((kinetic_energy(body, b) + total_energy(effects, body, a) - first[0]) * first[1]),
                abs((dot(b, b) - squared) * first[3]),
            )
            for a, b in zip(q, l, strict=True)
        ]
    block[layout.DRIFT : layout.STATUS] = np.where(sick, np.nan, np.max(drifts, axis=0))
    block[: layout.MOMENTUM], block[layout.MOMENTUM : layout.REST] = q[-1], l[-1]
    return values
