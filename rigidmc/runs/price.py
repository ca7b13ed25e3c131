"""What a study of members will cost, told before the first of them."""

import math
import os
import tempfile
import time
from collections.abc import Callable
from typing import NamedTuple

import xarray as xr

from rigidmc.engine.kernel.layout import LANES
from rigidmc.engine.machine import threads_available
from rigidmc.files.outputs import folder_beside
from rigidmc.planning.block_size import WAVE
from rigidmc.planning.plan import prepare
from rigidmc.planning.settle import Settled, settled
from rigidmc.planning.tolerance.costs import cost_per_step
from rigidmc.runs.blocks import run
from rigidmc.runs.capacity import in_words, sizes
from rigidmc.scene.amounts import in_two_digits
from rigidmc.scene.scene import Scene

ENOUGH = 0.1  # seconds of a rehearsal that tells the time of a member
LONG = 0.25  # seconds: a block that takes longer is rehearsed for a part of its time
SAVES = 128  # of that part, at least; a spectrum needs 64


class Price(NamedTuple):
    """What a study will cost.

    members, steps : how many members, and steps of each in the mean; 0 steps in closed form
    seconds : of the run and of the study of it, expected from a rehearsal;  threads : of the run
    disk : bytes of the run directory, 0 if there is none
    """

    members: int
    steps: float
    seconds: float
    threads: int
    disk: int

    def __str__(self) -> str:
        each = "in closed form"
        if self.steps:
            total = in_two_digits(self.members * self.steps)
            each = f"x {self.steps:,.0f} steps, {total} in all"
        disk = f", {in_words(self.disk)} of disk" if self.disk else ""
        return (
            f"{self.members:,} members {each}:"
            f" about {self.seconds:.2g} s on {self.threads} threads{disk}"
        )


def price(
    scene: Scene,
    studied: Callable[[xr.Dataset], object],
    threads: int | None = None,
    folder: str | None = None,
) -> Price:
    """The Price of a study, measured on the first members of its scene.

    studied : what the study does with a result, also with one of few members
    folder : the run directory of its members, in which the rehearsal writes: if it is killed there,
        `resume` deletes what it left
    """
    threads = threads or threads_available()
    ready = settled(scene, threads, folder is not None)
    plan = ready.plan
    return Price(
        plan.members,
        plan.mean_steps if plan.form else 0.0,
        _seconds(ready, studied, threads, folder),
        threads,
        sizes(ready.scene, plan, threads)[2] if folder else 0,
    )


def _seconds(
    ready: Settled, studied: Callable[[xr.Dataset], object], threads: int, folder: str | None
) -> float:
    """How long all members and the study of them will take [s].

    More and more members are run and studied; the last two times tell what a member takes, and
    their difference leaves out what a study costs once.
    """
    scene, members, share = ready.scene, ready.plan.members, 1.0
    block = 0.0 if ready.plan.form is None else LANES * _of_a_member(ready)
    if block > LONG:
        saves = ready.plan.times.size - 1
        kept = max(SAVES, math.ceil(saves * LONG / block))
        if kept >= saves:  # the time of such a study is that of its steps
            return block * max(1.0, members / LANES / threads)
        assert scene.run.every is not None
        scene, share = scene.with_run(t_end=kept * scene.run.every), kept / saves
    # a graphics processor takes as long for a member as for a wave of them
    count = min(LANES if ready.plan.device == "cpu" else WAVE, members)
    before = 0, 0.0
    part = folder and os.path.join(folder, "rehearsal")
    with folder_beside(part) if part else tempfile.TemporaryDirectory() as place:
        file = os.path.join(place, "rehearsal.nc") if folder else None
        _rehearsed(ready, scene, count, studied, threads, file)  # compiles
        while True:
            took = _rehearsed(ready, scene, count, studied, threads, file)
            if took >= ENOUGH or count == members:
                break
            before, count = (count, took), min(4 * count, members)
    each = max(took - before[1], 0.2 * took) / (count - before[0])
    return (took + each * (members - count)) / share


def _of_a_member(ready: Settled) -> float:
    """Seconds of the steps of a member on one thread."""
    return 1e-9 * cost_per_step(ready.scene, ready.plan) * ready.plan.mean_steps


def _rehearsed(
    ready: Settled,
    scene: Scene,
    count: int,
    studied: Callable[[xr.Dataset], object],
    threads: int,
    file: str | None,
) -> float:
    """Seconds of the first `count` members of a scene and of the study of them."""
    few = scene.with_run(members=count)
    began = time.perf_counter()
    plan = prepare(few, threads, file is not None)
    with run(few, plan, threads, False, file, force=True, units=ready.units) as dataset:
        studied(dataset)
    return time.perf_counter() - began
