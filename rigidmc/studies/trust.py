"""How far a scene can be trusted: its own members through checks that need no truth, and a verdict in words."""

import contextlib
import math
from typing import NamedTuple

import numpy as np
import xarray as xr

from rigidmc.dynamics.euler import MassProperties
from rigidmc.dynamics.methods import names
from rigidmc.dynamics.so3 import multiply
from rigidmc.engine import layout
from rigidmc.errors import SceneError
from rigidmc.integrators import INTEGRATORS, accepting
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.planning.plan import prepare
from rigidmc.planning.rates import physics
from rigidmc.planning.tolerance.choose import check_quiet, resolved
from rigidmc.planning.tolerance.growth import growth
from rigidmc.planning.tolerance.pilot import States, first_steps, follow, pilot
from rigidmc.planning.units import scaled
from rigidmc.progress import reporter
from rigidmc.studies.stress.case import closed_form
from rigidmc.version import VERSION

TIMES = 32  # at which states are compared
MEMBERS, FEW = 64, 32  # of the scene that are looked at, and with `quick`
LEFT = 1e-2  # error at which two digits are left: what is worse is no result
_CYCLE = (0.5, 0.5, 0.5, 0.5)  # body axes relabelled 1 -> 3 -> 2


class Check(NamedTuple):
    """One check: its name, what it tells ("accuracy", or "rounding" where the two runs are the same motion), error (times, members)."""

    name: str
    tells: str
    error: np.ndarray


def trust(scene, quick=False, progress=False):
    """Put a scene through the generic checks: a Dataset over `check` and `time`.

    scene : Scene, with the integrator and step to be judged;  quick : fewer members;  progress : as of `rigidmc.simulate`

    Checks of accuracy: half the step, another integrator at a short step, the closed form where there is one, there and back. Checks of
    rounding, in which the same motion is computed with other numbers: other units, permuted axes, space turned about the vertical.
    Variables: error (worst member) and error_median, larger of momentum [of its size] and attitude [rad]; `tells` over check. Attributes:
    verdict, digits (that all members keep to t_end), horizon [s] (where fewer than two are left), chaotic_share, flagged.
    Raises SceneError for a scene that cannot be run.
    """
    check_quiet(scene)
    scene, _ = resolved(scene)
    plan = prepare(scene)
    found = _looked_at(scene, FEW if quick else MEMBERS)
    steps = _steps(found, plan)
    status = np.zeros(found.members, bool)
    with reporter(progress, 9, 1) as report:

        def follow_(pilot, name, steps):
            states = follow(pilot, name, steps)
            report.step(1)
            report.poll()
            return states

        name = scene.run.integrator
        own = _closed(found) if name == "closed" else follow_(found, name, steps)
        status |= own.status != 0
        finest = _other(found, name, steps, follow_)
        checks = [Check(f"another integrator ({finest[0]})", "accuracy", _distance(own, finest[1]))]
        if name != "closed":
            order = INTEGRATORS[name].order
            left = 1.0 if order == math.inf else 2.0**order / (2.0**order - 1.0)
            checks.append(
                Check(
                    "half the step",
                    "accuracy",
                    left * _distance(own, follow_(found, name, 2 * steps)),
                )
            )
            checks += [
                Check(word, "rounding", _distance(own, states))
                for word, states in _alike(found, name, steps, follow_)
            ]
            # with L reversed a motion goes back where no torque knows L or the time; a wheel or damping would have to be reversed too
            if not any(names(e, "torque") & {"l", "t"} for e in scene.effects):
                checks.append(
                    Check("there and back", "accuracy", _back(found, own, name, steps, follow_))
                )
            with contextlib.suppress(SceneError):
                checks.append(Check("closed form", "accuracy", _distance(own, _closed(found))))
        factor, rate = growth(_looked_at(scene, min(found.members, FEW)))
    return _dataset(scene, plan, found, checks, status, factor, rate)


def _looked_at(scene, members):
    """The first members at TIMES times, with the attitude: it is part of what is judged."""
    end = scene.run.t_end
    given = scene.with_run(
        every=end / TIMES, save=("momentum", "attitude"), members=min(scene.run.members, members)
    )
    return pilot(given, members)._replace(
        base=TIMES,
        stride=1,
        times=end * np.arange(1, TIMES + 1) / TIMES,
        own=scene.run.turn is not None,
    )


def _steps(found, plan):
    """Steps of the scene as the pilot counts them."""
    wanted = plan.steps
    if found.own:
        wanted = found.scene.run.t_end * float(found.rates.max()) / found.scene.run.turn
    return TIMES * max(1, math.ceil(wanted / TIMES * (1.0 - 1e-9)))


def _other(found, name, steps, follow_):
    """(name, States) of the best other integrator, at a step that is short for it."""
    able = accepting(found.scene.effects)
    other = "rk8" if name != "rk8" else "srkn11" if "srkn11" in able else "cf4"
    finer = {"rk8": 2, "srkn11": 4}.get(other, 8)
    return other, follow_(
        found,
        other,
        TIMES * math.ceil(max(finer * first_steps(found), steps if other == "rk8" else 0) / TIMES),
    )


def _alike(found, name, steps, follow_):
    """(what was changed, States brought back) of the same motion in other numbers."""
    block, effects = found.block, found.scene.effects
    q, l = block[: layout.MOMENTUM], block[layout.MOMENTUM : layout.REST]
    try:  # other units: by factors that are no powers of 2
        mass, length, time = 1e-3, 10.0, 0.1
        other = scaled(found.scene, mass, length, time)
        states = follow_(_looked_at(other, found.members), name, steps)
        yield "other units", states._replace(l=states.l * (time / (mass * length**2)))
    except SceneError:
        pass
    if all(getattr(effect, "isotropic", False) for effect in effects):
        body, _ = physics(effects, block)
        moments, static = (
            1.0 / np.array([body.i1, body.i2, body.i3]),
            np.array([body.p1, body.p2, body.p3]),
        )
        turned = block.copy()
        turned[layout.MOMENTUM : layout.REST] = np.roll(l, 1, 0)  # axis 1 becomes axis 2, and so on
        turned[: layout.MOMENTUM] = multiply(tuple(q), (0.5, -0.5, -0.5, -0.5))
        turned[layout.BODY : layout.EFFECTS] = MassProperties.of(
            tuple(np.roll(moments, 1, 0)), tuple(np.roll(static, 1, 0))
        )
        states = follow_(found._replace(block=turned), name, steps)
        back = np.stack(multiply(tuple(np.moveaxis(states.q, 1, 0)), _CYCLE), 1)
        yield "permuted axes", States(back, np.roll(states.l, -1, 1), states.status)
        turn = (math.cos(0.7), 0.0, 0.0, math.sin(0.7))
        turned = block.copy()
        turned[: layout.MOMENTUM] = multiply(turn, tuple(q))
        states = follow_(found._replace(block=turned), name, steps)
        back = np.stack(
            multiply((turn[0], 0.0, 0.0, -turn[3]), tuple(np.moveaxis(states.q, 1, 0))), 1
        )
        yield "turned space", states._replace(q=back)


def _back(found, own, name, steps, follow_):
    """Error (times, members) at the start of a motion run back from each... from the end: at time t it is that of the way back from t_end."""
    block = found.block.copy()
    block[: layout.MOMENTUM, : found.members] = own.q[-1]
    block[layout.MOMENTUM : layout.REST, : found.members] = -own.l[-1]
    again = follow_(found._replace(block=block), name, steps)
    start = found.block[:, : found.members]
    q = np.concatenate([start[None, : layout.MOMENTUM], own.q[:-1]])[::-1]
    l = np.concatenate([start[None, layout.MOMENTUM : layout.REST], own.l[:-1]])[::-1]
    return np.maximum.accumulate(
        _distance(States(again.q, -again.l, again.status), States(q, l, own.status))
    )


def _closed(found):
    motion = closed_form(found.scene, found.members, found.first).motion(found.times)
    return States(
        np.moveaxis(motion.attitude, -1, 1),
        np.moveaxis(motion.momentum, -1, 1),
        np.zeros(found.members),
    )


def _distance(one, two):
    """Larger of the errors of momentum [of its largest size so far] and attitude [rad], largest so far: (times, members)."""
    with np.errstate(all="ignore"):
        size = np.maximum.accumulate(np.sqrt((two.l**2).sum(1)))
        off = np.sqrt(((one.l - two.l) ** 2).sum(1)) / np.where(size > 0.0, size, 1.0)
        turned = attitude_error(np.moveaxis(one.q, 1, -1), np.moveaxis(two.q, 1, -1))
    return np.maximum.accumulate(np.nan_to_num(np.maximum(off, turned), nan=math.inf))


def _dataset(scene, plan, found, checks, status, factor, rate):
    ok = ~status if not status.all() else status
    error = np.array([c.error[:, ok].max(1) for c in checks])
    variables = {
        "error": (
            ("check", "time"),
            error,
            {"units": "1", "long_name": "error of the worst member"},
        ),
        "error_median": (
            ("check", "time"),
            np.array([np.median(c.error[:, ok], axis=1) for c in checks]),
            {"units": "1"},
        ),
        "tells": ("check", np.array([c.tells for c in checks], dtype=object)),
    }
    attrs = {
        "title": scene.title, "source": f"rigidmc {VERSION}", "scene": scene.dumps(), "integrator": scene.run.integrator,
        "step": f"turn = {scene.run.turn:g} rad" if plan.own else f"dt = {plan.dt:.6g} s", "members": found.members,
        "flagged": int(status.sum()), "chaotic_share": float(np.mean(rate > 0.0)), "growth": float(np.median(factor)),
    }  # fmt: skip
    made = xr.Dataset(
        variables,
        {"check": np.array([c.name for c in checks], dtype=object), "time": found.times},
        attrs,
    )
    made.attrs |= _verdict(made)
    return made


def _verdict(study):
    """{verdict, digits, horizon} in words and numbers."""
    tells, t = study.tells.values, study.time.values
    accuracy = study.error.values[tells == "accuracy"].max(0)
    rounding = (
        study.error.values[tells == "rounding"].max(0)
        if (tells == "rounding").any()
        else np.zeros(len(t))
    )
    error = np.maximum(accuracy, rounding)
    within = np.flatnonzero(error > LEFT)
    horizon = float(t[-1]) if not within.size else float(t[within[0] - 1]) if within[0] else 0.0
    digits = _digits(error[-1])
    if not within.size:
        words = f"trust {digits} digits to t = {t[-1]:.4g} s"
        return {"verdict": words, "digits": digits, "horizon": horizon}
    chaos = study.attrs["chaotic_share"] > 0.0 and rounding[-1] > 1e-3 * min(error[-1], 1.0)
    why = "chaos" if chaos else "the step is too long for this: take a shorter one, or --tolerance"
    if horizon == 0.0:
        return {
            "verdict": f"trust nothing: fewer than two digits are left at t = {t[0]:.4g} s; {why}",
            "digits": 0,
            "horizon": 0.0,
        }
    good = [
        (d, t[np.flatnonzero(error > 10.0**-d)[0] - 1])
        for d in (9, 6, 4, 3, 2)
        if error[0] <= 10.0**-d
    ]
    best = next((d, at) for d, at in good if at >= 0.4 * horizon or d == 2)
    more = "" if best[0] == 2 else f", 2 digits to t = {horizon:.4g} s"
    return {
        "verdict": f"trust {best[0]} digits to t = {best[1]:.4g} s{more}; beyond, {why}",
        "digits": 0,
        "horizon": horizon,
    }


def _digits(error):
    return (
        15
        if error < 1e-15
        else max(0, math.floor(-math.log10(error) + 1e-9))
        if math.isfinite(error)
        else 0
    )


def table(study):
    """Lines of text: each check at a quarter, half and the whole of the time, and the verdict."""
    a, t = study.attrs, study.time.values
    at = [len(t) // 4 - 1, len(t) // 2 - 1, len(t) - 1]
    lines = [
        f"{a['title']}: {a['integrator']}, {a['step']}, {a['members']} member{'s' * (a['members'] > 1)}; worst of them (median) at t ="
    ]
    lines.append(f"{'':32s}" + "".join(f"{f'{t[i]:.4g} s':>22s}" for i in at))
    for i, name in enumerate(study.check.values):
        cells = [
            f"{study.error.values[i, k]:.1e} ({study.error_median.values[i, k]:.1e})" for k in at
        ]
        lines.append(f"{name:32s}" + "".join(f"{cell:>22s}" for cell in cells))
    if a["flagged"]:
        lines.append(f"{a['flagged']} of {a['members']} members turn non-finite and are left out")
    if a["chaotic_share"] > 0.0:
        lines.append(
            f"errors grow exponentially in {100 * a['chaotic_share']:.0f} % of the members"
        )
    return [*lines, f"verdict: {a['verdict']}"]


def failed(study):
    """Whether members fail, or the scene's own step leaves no result where chaos is not to blame."""
    return bool(study.attrs["flagged"]) or (
        study.attrs["digits"] == 0 and "chaos" not in study.attrs["verdict"]
    )
