"""The closed form of a scene beside its integration."""

import numpy as np

from rigidmc.engine.layout import STATUSES
from rigidmc.errors import SceneError
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.planning.closed_form import NONE, closed_form
from rigidmc.runs.simulate import simulate


def compare(scene, at, members):
    """Lines of text: the closed form of a scene at a time, its integration, and how far they are apart over the first members."""
    members = min(members, scene.run.members)
    case = closed_form(scene, members)
    motion, well = case.motion(at), case.form != NONE
    if not well.any():
        raise SceneError(
            "",
            "members",
            None,
            f"none of the first {members:,} is a body with a start: no motion to compare",
        )
    lines = [
        f"{scene.title}: {case.name}, closed form at t = {at:g} s, {members:,} member{'s' * (members > 1)}"
    ]
    found = case.what()
    kinds, counts = np.unique(np.concatenate([what.kind for _, what in found]), return_counts=True)
    order = np.argsort(-counts)
    words = [f"{kinds[i]} ({counts[i]:,})" for i in order] + [
        f"none: no body or no start ({(~well).sum():,})"
    ] * (not well.all())
    lines.append("motion       " + ", ".join(words))
    with np.errstate(invalid="ignore"):
        for which, what in found:
            for label, values, unit in _facts(what):
                good = np.isfinite(values)
                if good.any():
                    first, values = scene.run.first + which[np.argmax(good)], values[good]
                    spread = (
                        f", from {values.min():.6g} to {values.max():.6g}"
                        if np.ptp(values) > 1e-12 * np.abs(values).max()
                        else ""
                    )
                    lines.append(f"{label:12s} {values[0]:.12g} {unit} of member {first}{spread}")
    if not at > 0:
        lines.append("integration  none: it starts at t = 0 and goes forward")
        return lines + _state(motion.omega[np.argmax(well)], motion.attitude[np.argmax(well)])
    return lines + _beside(
        motion,
        simulate(scene.with_run(t_end=at, every=None, save=("omega", "attitude"), members=members)),
    )


def _beside(motion, result):
    """Lines of text: a Motion at the end of a result, and the result."""
    members, integrator, last, status = (
        result.sizes["member"],
        result.attrs["integrator"],
        result.isel(time=-1),
        result.status.values,
    )
    if integrator == "closed":
        raise SceneError(
            "run",
            "integrator",
            integrator,
            "the closed form is not compared with itself; use exact, rk8 or srkn11",
        )
    good = status == 0
    if not good.any():
        words = ", ".join(
            f"{int((status == code).sum()):,} {word}"
            for word, code in STATUSES.items()
            if (status == code).any()
        )
        rule = f"all {members:,} members are flagged ({words}): there is no integration to compare with; perhaps dt is too long"
        raise SceneError("run", "integrator", integrator, rule)
    shown = int(np.argmax(good))
    omega, attitude = (
        last.omega.transpose("member", "axis").values,
        last.attitude.transpose("member", "quat").values,
    )
    lines = [
        f"integration  {integrator}, dt = {result.attrs['dt']:.6g} s; member {int(result.member[shown])}:"
    ]
    lines.append(f"{'':12s} {'closed form':>24s} {'integration':>24s} {'difference':>12s}")
    sign = 1.0 if motion.attitude[shown] @ attitude[shown] >= 0 else -1.0
    rows = zip(
        ("omega_1", "omega_2", "omega_3", "q_w", "q_x", "q_y", "q_z"),
        (*motion.omega[shown], *motion.attitude[shown]),
        (*omega[shown], *(sign * attitude[shown])),
        strict=True,
    )
    lines += [f"{word:12s} {a:24.16g} {b:24.16g} {b - a:12.2e}" for word, a, b in rows]
    apart = np.linalg.norm(omega - motion.omega, axis=-1)[good]
    turned = attitude_error(attitude[good], motion.attitude[good])
    for word, values, unit in (("omega", apart, "rad/s"), ("attitude", turned, "rad")):
        lines.append(
            f"{word:12s} apart by {np.median(values):.2e} {unit} (median), {values.max():.2e} {unit} (worst) over {good.sum():,} member{'s' * bool(good.sum() > 1)}"
        )
    return lines


def _facts(what):
    if hasattr(what, "flip_interval"):
        return (
            ("period", what.period, "s"),
            ("flips every", what.flip_interval, "s"),
            ("1 - m", what.mc, ""),
        )
    low, high = np.degrees(what.low), np.degrees(what.high)
    return (
        ("nutation", what.period, "s a period"),
        ("precession", np.degrees(what.precession), "deg a period"),
        ("theta from", high, "deg"),
        ("theta to", low, "deg"),
    )


def _state(omega, attitude):
    return [
        "omega        " + "  ".join(f"{x:.16g}" for x in omega),
        "attitude     " + "  ".join(f"{x:.16g}" for x in attitude),
    ]
