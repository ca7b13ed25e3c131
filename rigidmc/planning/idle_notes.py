"""Notes on settings and effects of a scene that change nothing."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects import EFFECTS
from rigidmc.effects.bath import Bath
from rigidmc.effects.gravity import Gravity
from rigidmc.effects.parameters import filled, numbers
from rigidmc.effects.pivot import MovingPivot
from rigidmc.effects.protocol import torque
from rigidmc.planning.plan import Plan
from rigidmc.scene.changes import idle
from rigidmc.scene.conservation import conservation
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run

Array = NDArray[np.float64]


def idle_settings(run: Run) -> Iterator[str]:
    """Settings of [run] without effect."""
    for key, why in idle(run).items():
        yield f"[run] {key} = {getattr(run, key)} has no effect: {why}"
    for name, word in run.keep.items() if isinstance(run.keep, dict) else ():
        if name not in run.save:
            yield f"[run] keep.{name} = {word} has no effect: {name} is not saved"
    if run.every is not None and run.every > run.t_end:
        yield (
            f"[run] every = {run.every:g} s is longer than t_end = {run.t_end:g} s: only the "
            "first and the last state are saved"
        )


def idle_sums(run: Run, plan: Plan) -> Iterator[str]:
    """Sums that are to keep remainders, of steps that look after their rounding themselves."""
    if run.compensated and not plan.compensated:
        why = f"the steps of {run.integrator} look after their rounding themselves"
        yield f"[run] compensated = True has no effect: {why}"


def idle_limits(scene: Scene, plan: Plan) -> Iterator[str]:
    """Limits on drifts of quantities that a scene does not conserve."""
    run, conserved = scene.run, conservation(scene)
    if not run.checks or run.integrator == "closed":
        return
    why = {name: reason.removeprefix("no: ") for name, reason in conserved.items()}
    if run.energy_limit is not None and conserved["energy_drift"] != "yes":
        rule = f"has no effect: {why['energy_drift']}"
        yield f"[run] energy_limit = {run.energy_limit:g} {rule}"
    bounded = conserved["l2"] == "yes" or (conserved["lz"] == "yes" and plan.carried)
    if run.momentum_limit is not None and not bounded:
        reason = why["lz"] if plan.carried else f"{why['l2']}, and L_z is not followed"
        yield f"[run] momentum_limit = {run.momentum_limit:g} has no effect: {reason}"


def is_shipped(effect: Any) -> bool:
    """Whether an effect comes with the package."""
    return type(effect) in EFFECTS.values()


def idle_effects(effects: list[tuple[str, Any]], moments: Array, centre: Array) -> Iterator[str]:
    """Effects [(label, effect)] of the package that exert no torque on any of the members looked
    at.

    moments, centre : (3, n) of the members
    """
    size, few = np.abs(centre).max(), moments.shape[1]
    with np.errstate(all="ignore"):
        # scaled to size 1, so that no torque underflows to 0; a centre of 0 is 0 by anything
        scaled = tuple(moments / moments.max()), tuple(centre / (size or 1.0))
        body = MassProperties.of(*scaled)
    chance = np.random.default_rng(1)
    for label, effect in effects:
        if not is_shipped(effect) or any(_acts(effect, body, i, chance) for i in range(few)):
            continue
        why = "its torque is 0 at any attitude and spin"
        if type(effect) in (Gravity, MovingPivot) and not centre.any():
            why = "the centre of mass is on the fixed point: give [body] centre or pivot"
        yield f"[effects.{label}] has no effect on the first {few} members: {why}"


def _acts(effect: Any, bodies: MassProperties, i: int, chance: np.random.Generator) -> bool:
    """Whether an effect exerts a torque on member i at a random attitude, spin and time; for a
    bath, whether it has friction."""
    body = MassProperties(*(np.asarray(x)[i] for x in bodies))
    of_member = filled(type(effect), [x[i] for _, _, x in numbers(effect)])
    if isinstance(of_member, Bath):
        return bool(of_member.gamma != 0.0)
    q, l, t = (
        chance.normal(size=4),
        chance.normal(size=3) / max(body[:3]),
        chance.uniform(0.1, 10.0),
    )
    return any(torque(of_member, body, t, tuple(q / np.linalg.norm(q)), tuple(l)))
