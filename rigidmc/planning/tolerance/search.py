"""The effort of a search: at most as many evaluations of the torque as the run that it plans.

The pilot of an expensive search has fewer members, and integrates only the beginning of the run. A
few members then check the chosen step over the whole time.

A search uses up to twenty kernels. Each takes 3 s to compile, and Numba compiles one at a time: a
second process compiles half of them.
"""

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import count_text
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.tolerance.deviation import errors
from rigidmc.planning.tolerance.pilot import Pilot, first_steps, integrate_pilot, part_of, pilot
from rigidmc.processes.helpers import start_helper
from rigidmc.scene.scene import Scene

FREE = 4e8  # evaluations of any search: 1 to 3 s on two cores
# Evaluations of a search and of its check, for each member of their pilots, in runs by rk8 with the
# necessary steps. Upper estimates: the searches of 24 scenes took up to .76 of their limit.
SEARCH, CHECK = 100, 10
SOME = 64  # members of a pilot that is to show how errors differ between members
AGREEMENT = 0.1  # of the reference, as a fraction of the tolerance


class Extent(NamedTuple):
    """Members and fraction of the time of the two pilots.

    members, share : of the pilot that all candidates integrate
    checked, checked_share : of the pilot that the chosen candidate integrates
    """

    members: int
    share: float
    checked: int
    checked_share: float

    def words(self, t_end: float) -> str:
        """Describe the pilots of a run to `t_end` [s]; "" if they cover its whole time."""
        if self.share == 1.0:
            return ""
        count = count_text(self.members, "member"), count_text(self.checked, "member")
        ends = self.share * t_end, self.checked_share * t_end
        return f"{count[0]} to {ends[0]:.3g} s, checked on {count[1]} to {ends[1]:.3g} s"


def growth_power(pilot: Pilot, integrator: str) -> int:
    """Return the power of time by which errors grow in regular motion: 1 for reversible methods, 2
    for others, whose energy drifts."""
    return 1 if pilot.scene.known_integrators()[integrator].is_reversible else 2


def plan_search(pilot: Pilot, tolerance: float) -> Extent:
    """Return the Extent of a search for a tolerance, and limit the pilot's effort to the cost of
    its run, or to FREE."""
    run, most = pilot.scene.run, pilot.members
    work = INTEGRATORS["rk8"].evaluations * necessary_steps(pilot, tolerance)
    # half of the run by rk8, because the chosen integrator may cost less
    limit = max(FREE, 0.5 * run.members * work)
    pilot.effort.limit = 0.8 * limit  # the rest is for the reason, if the tolerance is out of reach
    members = limit / (SEARCH * work)  # over the whole time
    if members >= min(SOME, most):
        count = min(most, int(members))
        return Extent(count, 1.0, count, 1.0)
    count = min(most, SOME)
    # 100 steps of 0.25 rad are four revolutions: the first alone would not show how errors grow
    shortest = min(1.0, 100.0 / first_steps(pilot))
    share = 0.5 * members / count
    if share < shortest:
        share, count = shortest, max(1, int(0.5 * members / shortest))
    elif share > 0.5:
        share, count = 1.0, max(1, int(0.5 * members))
    checked = 0.5 * limit / (CHECK * work)
    return Extent(count, share, min(count, max(1, int(checked))), min(1.0, checked))


def necessary_steps(pilot: Pilot, tolerance: float) -> float:
    """Estimate the steps to the end in which rk8 keeps a tolerance, from some members over the
    beginning."""
    share = min(1.0, 100.0 / first_steps(pilot))
    few = part_of(pilot, 16, share)
    share = few.scene.run.t_end / pilot.scene.run.t_end
    steps = first_steps(few)
    coarse = integrate_pilot(few, "rk8", steps)
    for _ in range(8):
        fine = integrate_pilot(few, "rk8", 2 * steps)
        apart = errors(few, coarse, fine)["state"]
        if np.median(apart) < tolerance * share:
            break
        coarse, steps = fine, 2 * steps
    return steps / share


Precision = tuple[str, str]  # integrator and dtype


def compile_ahead(pilot: Pilot, candidates: Sequence[Precision]) -> None:
    """Compile the kernels of some candidates for a pilot.

    If a kernel is not in the cache, a second process compiles from the end of the list and stores
    its kernels in the cache.
    """
    helper = None
    try:
        for place, candidate in enumerate(candidates):
            began = time.perf_counter()
            _compile(pilot, *candidate)
            slow = time.perf_counter() - began > 0.7
            if helper is None and slow and len(candidates) - place > 3:
                helper = _helper(pilot, candidates[place + 1 :])
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()


def _compile(pilot: Pilot, integrator: str, dtype: str) -> None:
    """Compile the kernel of one candidate, at a step in the middle of its ladder."""
    if integrator == "closed":
        return
    few = part_of(pilot, 32, min(1.0, 100.0 / first_steps(pilot)))
    for finer in (1, 8):
        try:
            integrate_pilot(few, integrator, finer * first_steps(few), dtype)
            return
        except SceneError:  # the step is too long for it
            continue


def _helper(pilot: Pilot, candidates: Sequence[Precision]) -> subprocess.Popen[str] | None:
    """Start the second process; return None if the scene cannot be written as text."""
    try:
        text = pilot.scene.dumps()
        Scene.loads(text)
    except (SceneError, ValueError, TypeError):  # arrays, custom effects, varied parameters
        return None
    task = json.dumps({"scene": text, "own": pilot.member_steps, "candidates": candidates})
    helper = start_helper(__name__, answers=False)
    assert helper.stdin is not None
    helper.stdin.write(task)
    helper.stdin.close()
    return helper


def main() -> None:
    """Compile, as the second process, the candidates listed on standard input, last one first."""
    task = json.load(sys.stdin)
    members = pilot(Scene.loads(task["scene"]), 32)._replace(member_steps=task["own"])
    for candidate in reversed(task["candidates"]):
        _compile(members, *candidate)
