"""The reference for errors: a closed form, or the agreement of two integrators."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import count_text
from rigidmc.inputs.arrays import Array
from rigidmc.physics.integrators import integrators_for
from rigidmc.planning.closed_form import ClosedMotion, closed_form
from rigidmc.planning.tolerance.deviation import errors, upper_quantile
from rigidmc.planning.tolerance.pilot import (
    MOST_STEPS,
    ROUNDING,
    Pilot,
    PilotStates,
    first_steps,
    integrate_pilot,
    part_of,
    perturb,
)

AGREED = 1e-12  # two methods that agree to this are accepted as a reference


class Reference(NamedTuple):
    """The reference states, their source, and their uncertainty: error (n,) of each member."""

    states: PilotStates
    source: str
    error: Array


def make_reference(
    pilot: Pilot, say: Callable[[str], object] | None = None, agreed: float = AGREED
) -> Reference:
    """Compute the Reference of a pilot: its closed form, if rk8 confirms it, else two methods that
    agree; SceneError if none agree.

    say : called with a progress report on the agreement of the two methods
    agreed : as in `integrate_reference`
    """
    try:
        case = closed_form(pilot.scene.model, pilot.sampler, pilot.first, pilot.members)
    except SceneError as error:
        true = integrate_reference(pilot, agreed, say)
        why = str(error).split("covers it: ")[-1].split("; covered")[0]
        return true._replace(source=f"{true.source}; no closed form: {why}")
    return _confirmed(pilot, _closed_truth(pilot, case))


def integrate_reference(
    pilot: Pilot, agreed: float = AGREED, say: Callable[[str], object] | None = None
) -> Reference:
    """Integrate a pilot by rk8 and another method with ever more steps, until they agree to
    `agreed` or stop converging, or exceed the effort of the search.

    cf4 needs 16 times the steps, so where no other method accepts the scene, rk8 is compared with
    itself in half the steps, and cf4 confirms it for some members.
    """
    # if rounding does not matter, kernels without remainders suffice, which are compiled anyway
    compensated = agreed < 10.0 * AGREED
    able = integrators_for(pilot.scene.effects, compensated=compensated)
    other = next(name for name in ("exact", "srkn11", "cf4") if name in able)
    steps, last, fine, is_halved = first_steps(pilot), None, None, other == "cf4"
    while True:
        began = time.perf_counter()
        beside, fine = fine, integrate_pilot(pilot, "rk8", steps, compensated=compensated)
        if not is_halved:
            beside = integrate_pilot(pilot, other, steps, compensated=compensated)
        elif beside is None:
            steps *= 2
            continue
        apart = errors(pilot, fine, beside)["state"]
        worst = upper_quantile(apart)
        # errors as large as the motion do not show whether finer steps converge
        # half the step divides the error of rk8 by 256, of srkn11 by 64, of cf4 by 16: less than 4
        # is rounding or chaos
        is_stuck = last is not None and last[0] < 0.1 and worst > 0.25 * last[0]
        if (
            worst < agreed
            or is_stuck
            # cf4 confirms in 16 times the steps, after another doubling
            or steps > MOST_STEPS / 32
            or not pilot.effort.allows(4.0 * pilot.work("rk8", steps))
        ):
            break
        if say is not None:
            wait = 2.0 * (time.perf_counter() - began)
            rival = "half of them" if is_halved else other
            text = f"rk8 in {steps:,} steps agrees with {rival} to {worst:.1e}"
            say(f"{text}; twice as many steps take about {wait:.0f} s")
        last, steps = (worst, apart, fine, steps), 2 * steps
    if last is not None and last[0] < worst:
        worst, apart, fine, steps = last
    if not np.isfinite(apart).all():
        bad = int(np.count_nonzero(~np.isfinite(apart)))
        rule = (
            f"{bad} of {count_text(pilot.members, 'member')} become non-finite with rk8 and {other}"
            f" in {steps:,} steps: no reference to compare with"
        )
        raise SceneError(rule, at="pilot")
    sums = " (sums compensated)" if compensated else ""
    count = f"{'up to ' if pilot.member_steps else ''}{steps:,} steps"
    true = Reference(fine, f"rk8 in {count}, which {other} confirms{sums}", apart)
    if is_halved:
        _confirm_by_cf4(pilot, true, steps, compensated)
    return true


def _confirm_by_cf4(pilot: Pilot, true: Reference, steps: int, compensated: bool) -> None:
    """Confirm rk8 by cf4 in 8 and 16 times the steps, for some members; SceneError."""
    few = part_of(pilot, 16, min(1.0, pilot.members / 64))
    count = few.base * math.ceil(steps * few.scene.run.t_end / pilot.scene.run.t_end / few.base)
    rk8, coarse, fine = (
        integrate_pilot(few, name, by * count, compensated=compensated)
        for name, by in (("rk8", 1), ("cf4", 8), ("cf4", 16))
    )
    check_agreement(
        errors(few, fine, rk8)["state"],
        errors(few, coarse, fine)["state"],
        true._replace(error=true.error[: few.members]),
        f"cf4 in {16 * count:,} steps",
    )


def _closed_truth(pilot: Pilot, case: ClosedMotion) -> Reference:
    """Compute the Reference of a closed form; its error is estimated by perturbing the start."""
    states = _motion(pilot, case)
    # a million roundings: the difference of the two motions keeps 6 digits, and grows linearly
    size, block = 1e-10, pilot.block[:, : pilot.members].copy()
    perturb(block, size, pilot.has_attitude, np.random.default_rng(0))
    attitude = block[: layout.MOMENTUM].T if pilot.has_attitude else case.attitude
    momentum = block[layout.MOMENTUM : layout.EXTRA].T
    moved = _motion(pilot, case._replace(momentum=momentum, attitude=attitude))
    error = ROUNDING / size * errors(pilot, moved, states)["state"]
    return Reference(states, f"closed form of the {case.name}", error)


def _confirmed(pilot: Pilot, true: Reference) -> Reference:
    """Confirm a closed form by rk8, whose error is estimated by halving the steps."""
    steps = 2 * first_steps(pilot)
    coarse, fine = integrate_pilot(pilot, "rk8", steps), integrate_pilot(pilot, "rk8", 2 * steps)
    check_agreement(
        errors(pilot, fine, true.states)["state"],
        errors(pilot, coarse, fine)["state"],
        true,
        f"rk8 in {2 * steps:,} steps",
    )
    return true._replace(source=f"{true.source}, which rk8 confirms")


def check_agreement(differences: Array, expected: Array, true: Reference, other: str) -> None:
    """Raise SceneError if closed form and integration differ by more than their errors explain.

    differences : distance between the two, for each member;  expected : error of the integration
    true : Reference of the closed form;  other : name of the integration
    """
    # Rounding in every step may grow with time and have up to 4,000 times the effect of rounding
    # the start (dzhanibekov, 1,440 steps). By chance, two such motions may differ by only a
    # thirtieth of their error.
    limit = 10.0 * expected + 1e4 * true.error + 1e-11
    wrong = ~(differences <= limit)
    if wrong.any():
        worst = int(
            np.argmax(np.where(wrong, np.nan_to_num(differences, nan=np.inf, posinf=np.inf), -1.0))
        )
        rule = (
            f"the {true.source.split(',')[0]} and {other} disagree for {int(wrong.sum()):,} of "
            f"{wrong.size:,} members, by {differences[worst]:.1e}, but their errors explain only "
            f"{limit[worst]:.1e}. One of them is wrong, so neither is used; please report this "
            "scene, and give an integrator and a step instead"
        )
        raise SceneError(rule, at="pilot")


def closed_pilot_states(pilot: Pilot) -> PilotStates:
    """Compute the states of a pilot by its closed form."""
    return _motion(pilot, closed_form(pilot.scene.model, pilot.sampler, pilot.first, pilot.members))


def _motion(pilot: Pilot, case: ClosedMotion) -> PilotStates:
    motion = case.motion(pilot.times)
    q, l = np.moveaxis(motion.attitude, -1, 1), np.moveaxis(motion.momentum, -1, 1)
    return PilotStates(q, l, np.zeros(pilot.members))
