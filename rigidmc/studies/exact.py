"""Compare the closed form of a scene with its integration."""

import warnings
from collections.abc import Iterator

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.mechanics.free_top import FreeMotionType, Motion
from rigidmc.mechanics.lagrange_steady import least_spin, steady_precession, tilt_growth
from rigidmc.mechanics.lagrange_top import NutationRange
from rigidmc.mechanics.rotation import attitude_error, matrix
from rigidmc.planning.closed_form import NONE, ClosedMotion, closed_form
from rigidmc.planning.initial import make_sampler
from rigidmc.results.labels import count_text
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.runs.simulate import simulate
from rigidmc.scene.scene import Scene

_UP = ("sleeping", "unstable")  # kinds of motion of an upright top
_NOT_STEADY = (*_UP, "at rest", "hanging", "pendulum")  # that do not precess
Motions = list[tuple[NDArray[np.int_], FreeMotionType | NutationRange]]  # [(members, their motion)]


def compare(scene: Scene, at: float, members: int) -> list[str]:
    """Return lines of text: closed form and integration of a scene at a time [s], and their
    difference.

    members : number of members compared, from the first on
    """
    members = min(members, scene.run.members)
    case = closed_form(scene.model, make_sampler(scene.model, scene.run), scene.run.first, members)
    motion, good = case.motion(at), case.form != NONE
    if not good.any():
        rule = f"each of the first {members:,} has an impossible body or start: nothing to compare"
        raise OptionError(rule, at="members")
    motions = case.kinds()
    count = count_text(members, "member")
    lines = [
        f"{scene.title}: {case.name}, closed form at t = {at:g} s, {count}",
        _kinds(motions, good),
        *_facts(motions, scene.run.first, members),
        *_steady(case, motions, scene.run.first, members),
        *_sleep(case, motions),
    ]
    if not at > 0:
        lines.append("integration  none: it runs forward from t = 0")
        for word, values in (("omega", motion.omega), ("attitude", motion.attitude)):
            numbers = "  ".join(f"{x:.16g}" for x in values[np.argmax(good)])
            lines.append(f"{word:12s} {numbers}")
        return lines
    # another scene: it ends at this time, and saves what the closed form has
    run = scene.with_run(t_end=at, every=at, save=("omega", "attitude"), members=members)
    if scene.body.is_turned:
        lines.append("states are in the principal axes")
    return lines + _beside(motion, in_principal_axes(simulate(run)))


def _kinds(motions: Motions, good: Bools) -> str:
    """Return a line with the kinds of motion, most frequent first."""
    names = np.concatenate([motion.kind for _, motion in motions])
    names = np.where(names == "monotone precession", "waves (monotone precession)", names)
    kinds, counts = np.unique(names, return_counts=True)
    if good.size == 1:
        return f"motion       {kinds[0]}"
    words = [f"{kinds[i]}: {counts[i]:,}" for i in np.argsort(-counts)]
    if not good.all():
        words.append(f"impossible body or start: {(~good).sum():,}")
    return f"motion       {'; '.join(words)}"


def _whose(member: int, members: int) -> str:
    """Return the words that name one of some members; "" if there is one."""
    return f" of member {member}" if members > 1 else ""


def _facts(motions: Motions, first: int, count: int) -> list[str]:
    """Return lines with periods and angles: of the first member with a value, and their range."""
    lines = []
    for members, motion in motions:
        with np.errstate(invalid="ignore"):
            numbers = list(_numbers(motion))
        for label, values, unit in numbers:
            good = np.isfinite(values)
            if not good.any():
                continue
            member, values = first + members[np.argmax(good)], values[good]
            spread = ""
            if np.ptp(values) > 1e-12 * np.abs(values).max():
                spread = f", from {values.min():.6g} to {values.max():.6g}"
            lines.append(f"{label:12s} {values[0]:.12g} {unit}{_whose(member, count)}{spread}")
    return lines


def _numbers(motion: FreeMotionType | NutationRange) -> Iterator[tuple[str, Array, str]]:
    """Yield (label, values, unit) of a free motion or of a nutation."""
    if isinstance(motion, FreeMotionType):
        yield "period", motion.period, "s, of omega in the body"
        yield "flips every", motion.flip_interval, "s"
        yield "1 - m", np.where(motion.mc == 1.0, np.nan, motion.mc), "of the elliptic functions"
    else:
        # a homoclinic top never returns: its period is that of the rounding
        returns = np.where(motion.kind == "homoclinic", np.nan, 1.0)
        yield "nutation", returns * motion.period, "s per period"
        yield "precession", returns * np.degrees(motion.precession), "deg per period"
        yield "theta from", np.degrees(motion.high), "deg"
        yield "theta to", np.degrees(motion.low), "deg"


def _steady(case: ClosedMotion, motions: Motions, first: int, count: int) -> Iterator[str]:
    """Yield lines for the first Lagrange top: its precessions without nutation, the pushes (the
    spins across the axis) for which it traces waves, and the least spin of a sleeping top;
    Goldstein, Classical Mechanics, section 5.7, and TdC (3.77)."""
    for (form, members, part), (_, motion) in zip(case.parts(), motions, strict=True):
        if isinstance(motion, FreeMotionType) or motion.kind[0] in _NOT_STEADY:
            continue
        moments, weight = np.roll(part.moments[0], 3 - form), part.weight[0]
        spin = part.momentum[0, form - 1] / moments[2]
        theta = float(np.arccos(np.clip(matrix(part.attitude[0])[2, form - 1], -1.0, 1.0)))
        top = f"{_whose(first + members[0], count)} at {np.degrees(theta):.6g} deg"
        yield f"steady       precession{top}: {_rates(moments, weight, spin, theta)}"
        yield from _waves(moments, weight, spin * moments[2], theta, top)
        least, up = least_spin(moments, abs(weight)), "upright" if weight > 0.0 else "upside down"
        words = f"above |omega_{form}| = {least:.6g} rad/s; its omega_{form} is {spin:.6g}"
        yield f"sleep        {up}, it sleeps {words}"


def _waves(moments: Array, weight: float, momentum: float, theta: float, top: str) -> Iterator[str]:
    """Yield the pushes of waves and of loops, of a top that leans and spins fast enough for both.

    Loops end where L_z is L_3 or -L_3: the axis passes through the vertical, and waves beyond.
    """
    sine, rises = np.sin(theta), 1.0 + np.copysign(np.cos(theta), weight)
    if sine < 1e-9 or weight == 0.0 or momentum**2 <= 2.0 * moments[0] * abs(weight) * rises:
        return
    most = 2.0 * weight / momentum * sine
    rate, slope = momentum / moments[0], np.tan(0.5 * theta)
    ends = f"{-rate / slope:.6g} and {rate * slope:.6g}"
    waves = f"waves       {top} for a push phi' sin(theta) of 0 to {most:.6g} rad/s"
    yield f"{waves}; loops beyond, until the axis passes the vertical at {ends} rad/s"


def _rates(moments: Array, weight: float, spin: float, theta: float) -> str:
    """Describe the two rates of steady precession, or why there is none."""
    with warnings.catch_warnings(action="ignore", category=SceneWarning):  # the line says it
        slow, fast = steady_precession(moments, weight, spin, theta)
    if np.isfinite(fast):
        return f"slow {slow:.6g}, fast {fast:.6g} rad/s"
    if np.isfinite(slow):
        return f"slow {slow:.6g} rad/s, fast none"
    least = least_spin(moments, weight, theta)
    return f"none below a spin of {least:.6g} rad/s" if least else "none without spin"


def _sleep(case: ClosedMotion, motions: Motions) -> Iterator[str]:
    """Yield a line for upright Lagrange tops: the spin above which they sleep, and their number."""
    counts, spins, fastest = {"stable": 0, "unstable": 0}, [], 0.0
    for (form, _, part), (_, motion) in zip(case.parts(), motions, strict=True):
        if isinstance(motion, FreeMotionType):
            continue
        moments = np.roll(part.moments, 3 - form, -1)
        spin, weight = part.momentum[:, form - 1] / moments[:, 2], part.weight
        up = np.isin(motion.kind, _UP) & (weight != 0.0)
        growth = tilt_growth(moments, np.abs(weight), spin)[up]
        counts["stable"] += int((motion.kind[up] == "sleeping").sum())
        counts["unstable"] += int((motion.kind[up] == "unstable").sum())
        spins += list(least_spin(moments[up], np.abs(weight[up])))
        fastest = max(fastest, growth.max(initial=0.0))
    if spins:
        words = ", ".join(f"{word} ({count:,})" for word, count in counts.items() if count)
        grows = f"; a tilt grows at up to {fastest:.6g} 1/s" if fastest else ""
        above = " to ".join(dict.fromkeys(f"{spin:.6g}" for spin in (min(spins), max(spins))))
        yield f"upright      {words}; stable above a spin of {above} rad/s{grows}"


def _beside(motion: Motion, result: xr.Dataset) -> list[str]:
    """Return lines of text that compare a Motion with the last state of a result."""
    members, integrator = result.sizes["member"], result.attrs["integrator"]
    last, status = result.isel(time=-1), result.status.values
    if integrator == "closed":
        rule = "cannot compare the closed form with itself; use exact, rk8 or srkn11"
        raise SceneError(rule, at="run.integrator", value=integrator)
    good = status == 0
    if not good.any():
        counts = {word: int((status == code).sum()) for word, code in STATUSES.items()}
        words = ", ".join(f"{count:,} {word}" for word, count in counts.items() if count)
        flagged = count_text(members, "member is", "members are")
        rule = f"all {flagged} flagged ({words}): no integration to compare"
        raise SceneError(f"{rule}; perhaps dt is too long", at="run.integrator", value=integrator)
    shown = int(np.argmax(good))
    omega = last.omega.transpose("member", "axis").values
    attitude = last.attitude.transpose("member", "quat").values
    step, member = f"dt = {result.attrs['dt']:.6g} s", _whose(int(result.member[shown]), members)
    lines = [
        f"integration  {integrator}, {step}{member}:",
        f"{'':12s} {'closed form':>24s} {'integration':>24s} {'difference':>12s}",
    ]
    sign = 1.0 if motion.attitude[shown] @ attitude[shown] >= 0 else -1.0
    rows = zip(
        ("omega_1", "omega_2", "omega_3", "q_w", "q_x", "q_y", "q_z"),
        (*motion.omega[shown], *motion.attitude[shown]),
        (*omega[shown], *(sign * attitude[shown])),
        strict=True,
    )
    lines += [f"{word:12s} {a:24.16g} {b:24.16g} {b - a:12.2e}" for word, a, b in rows]
    apart = np.linalg.norm(omega - motion.omega, axis=-1)[good]
    angle = attitude_error(attitude[good], motion.attitude[good])
    over = f"over {count_text(int(good.sum()), 'member')}"
    for word, off, unit in (("omega", apart, "rad/s"), ("attitude", angle, "rad")):
        median, worst = f"{np.median(off):.2e} {unit}", f"{off.max():.2e} {unit}"
        words = f"{median} (median), {worst} (worst) {over}" if members > 1 else worst
        lines.append(f"{word:12s} difference {words}")
    return lines
