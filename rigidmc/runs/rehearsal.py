"""The wall time of a run, predicted from its first members."""

import os
import tempfile
import time

import numpy as np

from rigidmc.files.outputs import folder_beside
from rigidmc.planning.block_size import WAVE
from rigidmc.planning.plan import Plan, prepare
from rigidmc.planning.tolerance.choose import Chosen
from rigidmc.planning.tolerance.costs import cost_per_step
from rigidmc.runs.blocks import run
from rigidmc.scene.scene import Scene

REHEARSED = 8192  # members: two blocks for each of two threads
ROUNDS = 10
ENOUGH = 0.5  # seconds after which no further round begins, from the fourth on


def predicted_seconds(
    scene: Scene, plan: Plan, threads: int, output: str | os.PathLike[str] | None, chosen: Chosen
) -> float:
    """How long a plan will take [s].

    Runs of 8192 and of three times as many members tell the cost of a member. Their results go to
    memory or to a file of the same kind, which the measured time of a kernel leaves out.
    """
    size = REHEARSED if plan.device == "cpu" else WAVE
    if plan.members < 8 * size:
        if plan.device == "cpu":
            return plan.members / chosen.members_per_second
        each = 1e-9 * cost_per_step(scene, plan) * plan.mean_steps
        return each * plan.moved_at_once(threads)
    seconds = _rehearsed(scene, plan, threads, output, size)
    small = float(np.median(seconds[size][1:]))  # the first run warms up
    large = float(np.median(seconds[3 * size]))
    # the difference leaves out what a run costs once
    each = max(large - small, 0.2 * large) / (2 * size)
    return large + each * (plan.members - 3 * size)


def _rehearsed(
    scene: Scene, plan: Plan, threads: int, output: str | os.PathLike[str] | None, size: int
) -> dict[int, list[float]]:
    """{members: [seconds of each run]} for `size` members and three times as many."""
    began, datasets = time.perf_counter(), []
    taken: dict[int, list[float]] = {size: [], 3 * size: []}
    with folder_beside(output) if output else tempfile.TemporaryDirectory() as folder:
        for i in range(ROUNDS):
            count = size * (1 + 2 * (i % 2))
            few = scene.with_run(members=count)
            file = os.path.join(folder, f"{i}.nc") if output else None
            plan_of_few = prepare(few, threads, output is not None, plan.block)
            datasets.append(run(few, plan_of_few, threads, False, file))
            taken[count].append(datasets[-1].encoding["rigidmc"]["run_seconds"])
            if i >= 3 and time.perf_counter() - began > ENOUGH:
                break
        for dataset in datasets:  # closed only now, or the next run would reuse warm memory
            dataset.close()
    return taken
