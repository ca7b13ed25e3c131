"""The closed form of a scene beside its integration."""

import numpy as np

from rigidmc.closed_form import closed_form
from rigidmc.rotation import attitude_error
from rigidmc.simulation import simulate


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
