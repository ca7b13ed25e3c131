"""How far a scene can be trusted: checks of its own members, and a verdict.

The checks do not need a truth: they recompute members with other steps, in other units and with
permuted axes; the difference is the error.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.dynamics.euler import BODY_NUMBERS, MassProperties
from rigidmc.physics.dynamics.methods import argument_names
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.physics.effects.protocol import facts
from rigidmc.physics.integrators import integrators_for
from rigidmc.planning.plan import Plan
from rigidmc.planning.steps import physics
from rigidmc.planning.tolerance.choose import check_quiet, choose_integrator
from rigidmc.planning.tolerance.deviation import measure_growth, relative
from rigidmc.planning.tolerance.pilot import Pilot, PilotStates, first_steps, integrate_pilot, pilot
from rigidmc.planning.tolerance.truth import closed_pilot_states
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.processes.progress import reporter
from rigidmc.results.labels import count_text
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.scene import Scene

TIMES = 32  # number of times at which states are compared
_CYCLE = (0.5, 0.5, 0.5, 0.5)  # body axes relabelled 1 -> 3 -> 2
_BACK = (0.5, -0.5, -0.5, -0.5)  # and back
_ABOUT_VERTICAL = (math.cos(0.7), 0.0, 0.0, math.sin(0.7))  # a rotation of space by 1.4 rad

Errors = Array  # (times, members)


class Check(NamedTuple):
    """One check.

    tells : "accuracy", or "rounding" if both runs compute the same motion with different numbers
    error : (times, members)
    """

    name: str
    tells: str
    error: Errors


def pilot_of(scene: Scene, count: int) -> Pilot:
    """Return the first members at TIMES times, with the attitude, which is part of the error."""
    end = scene.run.t_end
    shown = scene.with_run(
        every=end / TIMES, save=("momentum", "attitude"), members=min(scene.run.members, count)
    )
    times, has_steps = end * np.arange(1, TIMES + 1) / TIMES, scene.run.turn is not None
    return pilot(shown, count)._replace(base=TIMES, stride=1, times=times, member_steps=has_steps)


def steps_of(pilot: Pilot, plan: Plan) -> int:
    """Return the number of steps of the scene for the pilot: a multiple of TIMES."""
    steps, run = float(plan.grid.steps), pilot.scene.run
    if run.turn is not None:
        steps = run.t_end * float(pilot.rates.max()) / run.turn
    return TIMES * max(1, math.ceil(steps / TIMES * (1.0 - 1e-9)))


class Runs:
    """The judged run, with the states `states`, and the runs of all checks."""

    def __init__(self, pilot: Pilot, integrator: str, steps: int, report: Any) -> None:
        self.pilot, self.integrator, self.steps, self.report = pilot, integrator, steps, report
        is_closed = integrator == "closed"
        self.states = (
            closed_pilot_states(pilot) if is_closed else self.follow(pilot, integrator, steps)
        )

    def follow(self, pilot: Pilot, integrator: str, steps: int) -> PilotStates:
        """Integrate a pilot, report progress, and return its PilotStates."""
        states = integrate_pilot(pilot, integrator, steps)
        self.report.step(1)
        self.report.poll()
        return states

    def checks(self) -> Iterator[Check]:
        """Yield all checks that apply to the scene."""
        name, states = self.other()
        yield Check(f"another integrator ({name})", "accuracy", self.error(states))
        if self.integrator == "closed":
            return
        order = self.pilot.scene.known_integrators()[self.integrator].order
        left = 1.0 if order == math.inf else 2.0**order / (2.0**order - 1.0)
        half = self.follow(self.pilot, self.integrator, 2 * self.steps)
        yield Check("half the step", "accuracy", left * self.error(half))
        for name, states in (*self.other_units(), *self.other_axes()):
            yield Check(name, "rounding", self.error(states))
        # with a torque that depends on L or on time, reversing L does not reverse the motion
        if not any(argument_names(e, "torque") & {"l", "t"} for e in self.pilot.scene.effects):
            yield Check("there and back", "accuracy", self.there_and_back())
        with contextlib.suppress(SceneError):
            yield Check("closed form", "accuracy", self.error(closed_pilot_states(self.pilot)))

    def error(self, states: PilotStates) -> Errors:
        """Return the distance of the judged run from other states."""
        return _distance(self.states, states)

    def other(self) -> tuple[str, PilotStates]:
        """Return (name, PilotStates) of the best other integrator, with a short step."""
        able = integrators_for(self.pilot.scene.effects)
        name = "rk8" if self.integrator != "rk8" else "srkn11" if "srkn11" in able else "cf4"
        finer = {"rk8": 2, "srkn11": 4}.get(name, 8)
        steps = max(finer * first_steps(self.pilot), self.steps if name == "rk8" else 0)
        return name, self.follow(self.pilot, name, TIMES * math.ceil(steps / TIMES))

    def other_units(self) -> Iterator[tuple[str, PilotStates]]:
        """Yield the same motion in other units, by factors that are not powers of 2."""
        mass, length, time = 1e-3, 10.0, 0.1
        with contextlib.suppress(SceneError):
            other = pilot_of(scale_scene(self.pilot.scene, mass, length, time), self.pilot.members)
            states = self.follow(other, self.integrator, self.steps)
            yield "other units", states._replace(l=states.l * (time / (mass * length**2)))

    def other_axes(self) -> Iterator[tuple[str, PilotStates]]:
        """Yield the same motion with permuted body axes, and in space rotated about the
        vertical."""
        block, effects = self.pilot.block, self.pilot.scene.effects
        if not all(facts(effect).isotropic for effect in effects):
            return
        q, l = block[: layout.MOMENTUM], block[layout.MOMENTUM : layout.EXTRA]
        body, _ = physics(effects, block)
        moments, static = 1.0 / np.array(body[:3]), np.array([body.p1, body.p2, body.p3])
        permuted = block.copy()
        permuted[layout.MOMENTUM : layout.EXTRA] = np.roll(l, 1, 0)  # axis 1 becomes axis 2, ...
        permuted[: layout.MOMENTUM] = multiply(tuple(q), _BACK)
        numbers = MassProperties.of(*(tuple(np.roll(x, 1, 0)) for x in (moments, static)))
        permuted[layout.BODY : layout.EFFECTS] = numbers[:BODY_NUMBERS]
        states = self.from_block(permuted)
        back = np.stack(multiply(tuple(np.moveaxis(states.q, 1, 0)), _CYCLE), 1)
        yield "permuted axes", PilotStates(back, np.roll(states.l, -1, 1), states.status)
        rotated = block.copy()
        rotated[: layout.MOMENTUM] = multiply(_ABOUT_VERTICAL, tuple(q))
        states = self.from_block(rotated)
        inverse = (_ABOUT_VERTICAL[0], 0.0, 0.0, -_ABOUT_VERTICAL[3])
        back = np.stack(multiply(inverse, tuple(np.moveaxis(states.q, 1, 0))), 1)
        yield "turned space", states._replace(q=back)

    def from_block(self, block: Array) -> PilotStates:
        """Return the PilotStates of the pilot from the start in a block."""
        return self.follow(self.pilot._replace(block=block), self.integrator, self.steps)

    def there_and_back(self) -> Errors:
        """Return the error after integrating back from t_end to each time."""
        states, count = self.states, self.pilot.members
        block = self.pilot.block.copy()
        block[: layout.MOMENTUM, :count] = states.q[-1]
        block[layout.MOMENTUM : layout.EXTRA, :count] = -states.l[-1]
        back = self.from_block(block)
        start = self.pilot.block[:, :count]
        q = np.concatenate([start[None, : layout.MOMENTUM], states.q[:-1]])[::-1]
        l = np.concatenate([start[None, layout.MOMENTUM : layout.EXTRA], states.l[:-1]])[::-1]
        return _distance(back._replace(l=-back.l), PilotStates(q, l, states.status))


def _distance(states: PilotStates, true: PilotStates) -> Errors:
    """Return the larger error of momentum [relative to its largest size so far] and attitude [rad],
    as the largest so far at each time."""
    with np.errstate(all="ignore"):
        size = np.maximum.accumulate(np.sqrt((true.l**2).sum(1)))
        off = relative(np.sqrt(((states.l - true.l) ** 2).sum(1)), size)
        angle = attitude_error(np.moveaxis(states.q, 1, -1), np.moveaxis(true.q, 1, -1))
    largest = np.nan_to_num(np.maximum(off, angle), nan=math.inf, posinf=math.inf)
    return np.asarray(np.maximum.accumulate(largest))


MEMBERS, FEW = 64, 32  # members checked, and with `quick`
LEFT = 1e-2  # error at which two digits are left: results with a larger error are worthless


def trust(
    scene: Scene, quick: bool = False, progress: bool | Callable[[int, int], object] = False
) -> xr.Dataset:
    """Run the generic checks on a scene; return a Dataset over `check` and `time`, which
    `rigidmc.stress` describes.

    scene : with the integrator and step to judge;  quick : fewer members
    progress : as in `rigidmc.simulate`

    Checks of accuracy: half the step, another integrator with a short step, the closed form if
    there is one, there and back. Checks of rounding compute the same motion with different numbers:
    other units, permuted axes, space rotated about the vertical.
    Raises SceneError for a scene that cannot run.
    """
    check_quiet(scene.effects)
    scene, _ = choose_integrator(scene)
    plan = prepare_scene(scene).plan
    first = pilot_of(scene, FEW if quick else MEMBERS)
    with reporter(progress, 9, 1) as report:
        runs = Runs(first, scene.run.integrator, steps_of(first, plan), report)
        checks = list(runs.checks())
    factor, rate = measure_growth(pilot_of(scene, min(first.members, FEW)))
    flagged = runs.states.status != 0
    shown = flagged if flagged.all() else ~flagged
    worst = np.array([check.error[:, shown].max(1) for check in checks])
    median = np.array([np.median(check.error[:, shown], axis=1) for check in checks])
    over = ("check", "time")
    variables = {
        "error": (over, worst, {"units": "1", "long_name": "error of the worst member"}),
        "error_median": (over, median, {"units": "1"}),
        "tells": ("check", np.array([check.tells for check in checks], dtype=object)),
    }
    coordinates = {
        "check": np.array([check.name for check in checks], dtype=object),
        "time": ("time", first.times, {"units": "s"}),
    }
    attrs = {
        "title": scene.title,
        "scene": scene.dumps(),
        "integrator": scene.run.integrator,
        "step": f"turn = {scene.run.turn:g} rad"
        if plan.has_member_steps
        else f"dt = {plan.grid.dt:.6g} s",
        "members": first.members,
        "flagged": int(flagged.sum()),
        "chaotic_share": float(np.mean(rate > 0.0)),
        "growth": float(np.median(factor)),
    }
    study = xr.Dataset(variables, coordinates, attrs)
    return study.assign_attrs(_verdict(study))


def _verdict(study: xr.Dataset) -> dict[str, Any]:
    """Return {verdict, digits, horizon}, as text and numbers."""
    tells, t = study.tells.values, study.time.values
    rounding = np.zeros(len(t))
    if (tells == "rounding").any():
        rounding = study.error.values[tells == "rounding"].max(0)
    error = np.maximum(study.error.values[tells == "accuracy"].max(0), rounding)
    beyond = np.flatnonzero(error > LEFT)
    if not beyond.size:
        digits = _digits(error[-1])
        words = f"trust {digits} digits to t = {t[-1]:.4g} s"
        return {"verdict": words, "digits": digits, "horizon": float(t[-1])}
    chaos = study.attrs["chaotic_share"] > 0.0 and rounding[-1] > 1e-3 * min(error[-1], 1.0)
    why = "chaos" if chaos else "the step is too long: use a shorter one, or --tolerance"
    if beyond[0] == 0:
        words = f"trust nothing: fewer than two digits are left at t = {t[0]:.4g} s; {why}"
        return {"verdict": words, "digits": 0, "horizon": 0.0}
    horizon = float(t[beyond[0] - 1])
    # the most digits that last for at least 40 % of the horizon
    lasting = [
        (digits, t[np.flatnonzero(error > 10.0**-digits)[0] - 1])
        for digits in (9, 6, 4, 3, 2)
        if error[0] <= 10.0**-digits
    ]
    digits, end = next((d, end) for d, end in lasting if end >= 0.4 * horizon or d == 2)
    more = "" if digits == 2 else f", 2 digits to t = {horizon:.4g} s"
    words = f"trust {digits} digits to t = {end:.4g} s{more}; beyond, {why}"
    return {"verdict": words, "digits": 0, "horizon": horizon}


def _digits(error: float) -> int:
    """Return the correct digits for an error, at most 15."""
    if not math.isfinite(error):
        return 0
    return 15 if error < 1e-15 else max(0, math.floor(-math.log10(error) + 1e-9))


def table(study: xr.Dataset) -> list[str]:
    """Return lines of text: each check at a quarter, half and all of the time, and the verdict."""
    a, t = study.attrs, study.time.values
    at = [len(t) // 4 - 1, len(t) // 2 - 1, len(t) - 1]
    members = count_text(a["members"], "member")
    lines = [
        f"{a['title']}: {a['integrator']}, {a['step']}, {members}; worst of them (median) at t =",
        f"{'':32s}" + "".join(f"{f'{t[i]:.4g} s':>22s}" for i in at),
    ]
    for name, worst, median in zip(
        study.check.values, study.error.values, study.error_median.values, strict=True
    ):
        cells = [f"{worst[i]:.1e} ({median[i]:.1e})" for i in at]
        lines.append(f"{name:32s}" + "".join(f"{cell:>22s}" for cell in cells))
    if a["flagged"]:
        lines.append(f"{a['flagged']} of {members} become non-finite and are left out")
    if a["chaotic_share"] > 0.0:
        share = f"{100 * a['chaotic_share']:.0f} % of the members"
        words = "errors grow faster than a power of time (chaos, or a separatrix nearby)"
        lines.append(f"in {share} {words}")
    return [*lines, f"verdict: {a['verdict']}"]


def has_failed(study: xr.Dataset) -> bool:
    """Return whether members fail, or no digit is left although the motion is not chaotic."""
    a = study.attrs
    return bool(a["flagged"]) or (a["digits"] == 0 and "chaos" not in a["verdict"])
