"""The closed form of a scene, where one covers it, beside its integration."""

from typing import Any, NamedTuple

import numpy as np

from rigidmc.effects import name_of
from rigidmc.engine import kernel
from rigidmc.errors import SceneError
from rigidmc.exact.free_top import Motion, free_motion, free_top
from rigidmc.exact.lagrange_top import lagrange_motion, lagrange_top
from rigidmc.planning import stage
from rigidmc.rotation import attitude_error
from rigidmc.simulation import simulate

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
        """The Motion of the members at t [s]."""
        if self.weight is not None:
            return lagrange_top(self.moments, self.weight, self.momentum, self.attitude, t, axis=self.axis)
        rate = self.damping
        # L' = L x omega - rate L runs through the undamped motion at the time (1 - exp(-rate t))/rate
        shrunk = np.where(rate > 0.0, -np.expm1(-rate * t) / np.where(rate > 0.0, rate, 1.0), t)
        l, omega, q = free_top(self.moments, self.momentum, self.attitude, shrunk)
        left = np.exp(-rate * t)[:, None]
        return Motion(left * l, left * omega, q)

    def what(self):
        """Kind of a free motion, Nutation of a Lagrange top."""
        if self.weight is None:
            return free_motion(self.moments, self.momentum)
        return lagrange_motion(self.moments, self.weight, self.momentum, self.attitude, axis=self.axis)


def closed_form(scene, members=None):
    """The Case of the first members of a scene; SceneError where no closed form covers it, with why."""
    scene.check()
    block, start = stage(scene, scene.run.first, members or scene.run.members, True)
    moments, momentum, attitude = start["moments"].T, block[kernel.MOMENTUM : kernel.START].T, block[: kernel.MOMENTUM].T
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


def compare(scene, at, members):
    """Lines of text: the closed form of a scene at a time, its integration, and how far they are apart over the first members."""
    members = min(members, scene.run.members)
    case = closed_form(scene, members)
    name, motion, what = case.name, case.motion(at), case.what()
    lines = [f"{scene.title}: {name}, closed form at t = {at:g} s, {members:,} member{'s' * (members > 1)}"]
    kinds, counts = np.unique(what.kind, return_counts=True)
    order = np.argsort(-counts)
    lines.append("motion       " + ", ".join(f"{kinds[i]} ({counts[i]:,})" for i in order))
    with np.errstate(invalid="ignore"):
        for label, values, unit in _facts(what):
            good = values[np.isfinite(values)]
            if good.size:
                spread = f", from {good.min():.6g} to {good.max():.6g}" if np.ptp(good) > 1e-12 * np.abs(good).max() else ""
                lines.append(f"{label:12s} {good[0]:.12g} {unit} of member {scene.run.first}{spread}")
    run = scene.with_run(t_end=abs(at), every=None, save=("omega", "attitude"), members=members) if at > 0 else None
    if run is None:
        lines.append("integration  none: it starts at t = 0 and goes forward")
        lines += _state(motion.omega[0], motion.attitude[0])
        return lines
    result = simulate(run)
    last, good = result.isel(time=-1), result.status.values == 0
    omega, attitude = last.omega.transpose("member", "axis").values, last.attitude.transpose("member", "quat").values
    lines.append(f"integration  {run.run.integrator}, dt = {result.attrs['dt']:.6g} s; member {scene.run.first}:")
    lines.append(f"{'':12s} {'closed form':>24s} {'integration':>24s} {'difference':>12s}")
    sign = 1.0 if motion.attitude[0] @ attitude[0] >= 0 else -1.0
    rows = zip(
        ("omega_1", "omega_2", "omega_3", "q_w", "q_x", "q_y", "q_z"),
        (*motion.omega[0], *motion.attitude[0]),
        (*omega[0], *(sign * attitude[0])),
        strict=True,
    )
    lines += [f"{word:12s} {a:24.16g} {b:24.16g} {b - a:12.2e}" for word, a, b in rows]
    apart = np.linalg.norm(omega - motion.omega, axis=-1)[good]
    turned = attitude_error(attitude, motion.attitude)[good]
    for word, values, unit in (("omega", apart, "rad/s"), ("attitude", turned, "rad")):
        lines.append(
            f"{word:12s} apart by {np.median(values):.2e} {unit} (median), {values.max():.2e} {unit} (worst) over {good.sum():,} members"
        )
    return lines


def _facts(what):
    if hasattr(what, "flip_interval"):
        return (("period", what.period, "s"), ("flips every", what.flip_interval, "s"), ("1 - m", what.mc, ""))
    low, high = np.degrees(what.low), np.degrees(what.high)
    return (
        ("nutation", what.period, "s a period"),
        ("precession", np.degrees(what.precession), "deg a period"),
        ("theta from", high, "deg"),
        ("theta to", low, "deg"),
    )


def _state(omega, attitude):
    return ["omega        " + "  ".join(f"{x:.16g}" for x in omega), "attitude     " + "  ".join(f"{x:.16g}" for x in attitude)]
