"""What members of a scene are measured against: its closed form, or what two integrators agree on."""

from typing import NamedTuple

import numpy as np

from rigidmc.engine import layout
from rigidmc.errors import SceneError
from rigidmc.integrators import accepting
from rigidmc.planning.closed_form import closed_form
from rigidmc.planning.tolerance.pilot import (
    MOST_STEPS,
    ROUNDING,
    States,
    errors,
    first_steps,
    follow,
    push,
)

AGREED = 1e-12  # two methods that agree to this are taken for the truth


class Truth(NamedTuple):
    """The states that others are measured against, what they are, and how well they are known: error (n,) of each member."""

    states: States
    source: str
    error: np.ndarray


def truth(pilot):
    """The Truth of a pilot: its closed form, which rk8 confirms, else two methods that agree; SceneError where nothing agrees."""
    try:
        case = closed_form(pilot.scene, pilot.members, pilot.first)
    except SceneError as error:
        found = integrated(pilot)
        why = str(error).split("covers it: ")[-1].split("; covered")[0]
        return found._replace(source=f"{found.source}; no closed form: {why}")
    return _confirmed(pilot, _closed_truth(pilot, case))


def integrated(pilot, agreed=AGREED):
    """The Truth of a pilot by rk8 and another method in more and more steps, until they agree to `agreed` or come no nearer."""
    kept = (
        agreed < 10.0 * AGREED
    )  # otherwise rounding does not matter, and kernels without remainders are compiled anyway
    able = accepting(pilot.scene.effects, compensated=kept)
    other = next(name for name in ("exact", "srkn11", "cf4") if name in able)
    steps, last = first_steps(pilot), None
    while True:
        ends = [
            follow(pilot, name, m, compensated=kept)
            for name, m in (("rk8", steps), (other, 16 * steps if other == "cf4" else steps))
        ]
        apart = errors(pilot, ends[0], ends[1])["state"]
        worst = float(np.max(apart))
        if (
            worst < agreed
            or (last is not None and worst > 0.25 * last[0])
            or steps > MOST_STEPS / 32
        ):
            break
        last, steps = (worst, apart, ends, steps), 2 * steps
    if last is not None and last[0] < worst:
        worst, apart, ends, steps = last
    if not np.isfinite(worst):
        bad = int(np.count_nonzero(~np.isfinite(apart)))
        raise SceneError(
            "",
            "pilot",
            None,
            f"{bad} of {pilot.members} members end non-finite with rk8 and {other} at {steps:,} steps: no truth to compare with",
        )
    sums = " (sums compensated)" if kept else ""
    return Truth(
        ends[0],
        f"rk8 in {'up to ' if pilot.own else ''}{steps:,} steps, which {other} confirms{sums}",
        apart,
    )


def _closed_truth(pilot, case):
    found = _motion(pilot, case)
    size, block = (
        1e-10,
        pilot.block[:, : pilot.members].copy(),
    )  # its error is taken from the effect of rounding the start
    push(block, size, pilot.carried, np.random.default_rng(0))
    attitude = block[: layout.MOMENTUM].T if pilot.carried else case.attitude
    moved = _motion(
        pilot, case._replace(momentum=block[layout.MOMENTUM : layout.REST].T, attitude=attitude)
    )
    return Truth(
        found,
        f"closed form of the {case.name}",
        ROUNDING / size * errors(pilot, moved, found)["state"],
    )


def _confirmed(pilot, true):
    """The Truth of a closed form if rk8 does not contradict it. The error of rk8 is seen by halving its steps."""
    steps = 2 * first_steps(pilot)
    coarse, fine = follow(pilot, "rk8", steps), follow(pilot, "rk8", 2 * steps)
    check_agreement(
        errors(pilot, fine, true.states)["state"],
        errors(pilot, coarse, fine)["state"],
        true,
        f"rk8 in {2 * steps:,} steps",
    )
    return true._replace(source=f"{true.source}, which rk8 confirms")


def check_agreement(apart, known, true, other):
    """Raise SceneError if a closed form and an integration differ by more than their errors explain.

    apart : how far they differ, for each member;  known : error of the integration;  true : Truth of the closed form;  other : name
        of the integration
    """
    # Rounding in every step, which may grow on the way, has up to 4,000 times the effect of rounding the start (dzhanibekov, 1,440
    # steps). Two such motions may by chance differ by only a thirtieth of their error.
    limit = 10.0 * known + 1e4 * true.error + 1e-11
    wrong = ~(apart <= limit)
    if wrong.any():
        at = int(np.argmax(np.where(wrong, np.nan_to_num(apart, nan=np.inf), -1.0)))
        rule = (
            f"the {true.source.split(',')[0]} and {other} disagree for {int(wrong.sum()):,} of {wrong.size:,} members, by "
            f"{apart[at]:.1e}, but their errors explain only {limit[at]:.1e}. One of them is wrong, so neither is used; "
            "please report this scene, and give an integrator and a step instead"
        )
        raise SceneError("", "pilot", None, rule)


def closed_states(pilot):
    """The States of a pilot by its closed form."""
    return _motion(pilot, closed_form(pilot.scene, pilot.members, pilot.first))


def _motion(pilot, case):
    motion = case.motion(pilot.times)
    return States(
        np.moveaxis(motion.attitude, -1, 1),
        np.moveaxis(motion.momentum, -1, 1),
        np.zeros(pilot.members),
    )
