"""The work of a study that consists of tasks: computed now, or in a run directory, where a stop
loses no finished task."""

import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.machine import threads_available
from rigidmc.errors import FileError, OptionError, warn
from rigidmc.files.outputs import Path
from rigidmc.inputs.amounts import read_count, two_digits
from rigidmc.processes.progress import Progress, announce, reporter, say
from rigidmc.results.labels import count_text
from rigidmc.runs.directory import tasks as shards
from rigidmc.runs.directory.cluster import Resume
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.gather import verify
from rigidmc.runs.directory.load import check_versions, scene_of_run
from rigidmc.runs.directory.resume import add_members, missing_of, read_resume
from rigidmc.runs.directory.tasks import Request, Task, TaskArrays
from rigidmc.runs.prepare import PreparedRun, prepare_scene
from rigidmc.runs.price import cost_per_step
from rigidmc.runs.resources import movers
from rigidmc.runs.settled import Machine
from rigidmc.scene.scene import Scene
from rigidmc.studies import STUDIES, load_study
from rigidmc.studies.framework.variables import describe
from rigidmc.studies.framework.work import StudyWork

Design = tuple[Scene, dict[str, Any]]  # scene and request, common to all tasks of a study


@dataclass(frozen=True)
class Tasks(StudyWork):
    """The work of a study that consists of tasks; each task is a shard of its run directory.

    design : (scene with the settings, options, settings) -> (scene of the tasks, request: their
        options as numbers and words); raises for a scene that cannot be studied
    next : (prepared run of the scene of the tasks, request, {number: result} of the finished tasks)
        -> numbers of the next tasks, [] at the end; at the beginning no task is finished
    compute_some : (run, request, numbers of tasks, threads, device) -> result of each task; it
        does not depend on threads, device and the other tasks
    cost : (run, request, numbers of tasks) -> their member-steps
    reduce : (run, request, {number: result}, options, threads) -> the Dataset
    is_growing : whether the results of tasks decide the next tasks
    together : number of tasks computed at once, 0 for as many as keep the threads at work
    notes : run -> warnings before the first task
    doubts : Dataset -> warnings after the last task
    """

    design: Callable[[Scene, Any, Mapping[str, Any]], Design]
    next: Callable[[PreparedRun, Request, dict[int, TaskArrays]], Sequence[int]]
    compute_some: Callable[[PreparedRun, Request, Sequence[int], int, str | None], list[TaskArrays]]
    cost: Callable[[PreparedRun, Request, Sequence[int]], float]
    reduce: Callable[[PreparedRun, Request, dict[int, TaskArrays], Any, int], xr.Dataset]
    is_growing: bool = False
    together: int = 1
    notes: Callable[[PreparedRun], Sequence[str]] = lambda run: ()
    doubts: Callable[[xr.Dataset], Sequence[str]] = lambda dataset: ()

    sources = "SCENE|RUN/"
    counted = "tasks"

    def compute(
        self, design: Design, options: Any, threads: int | None, device: str | None,
        progress: Progress,
    ) -> xr.Dataset:  # fmt: skip
        """Compute the tasks, and the study of them."""
        threads = threads_available() if threads is None else read_count(threads, "threads")
        (scene, request), device = design, resolve_device(device)
        run = prepare_scene(scene)
        for note in self.notes(run):
            warn(note)
        done: dict[int, TaskArrays] = {}
        with announce(progress):
            while numbers := self.next(run, request, done):
                if progress is True:
                    say(self.price(run, request, numbers, threads, device))
                many = self.together or shards.tasks_at_once(threads)
                with reporter(progress, len(numbers), 1) as report:
                    for first in range(0, len(numbers), many):
                        group = numbers[first : first + many]
                        values = self.compute_some(run, request, group, threads, device)
                        done |= zip(group, values, strict=True)
                        report.step(len(group))
                        report.poll()
        dataset = describe(self.reduce(run, request, done, options, threads), scene)
        for note in self.doubts(dataset):
            warn(note)
        return dataset

    def stored(
        self, name: str, path: Path, options: Any, threads: int | None, allow_code: bool
    ) -> xr.Dataset:
        """Return the study of the finished tasks of a run directory; FileError for anything else,
        and if no task is finished."""
        directory = RunDirectory(path)
        study = tasks_of(directory)
        if study is None or study[0] != name:
            rule = f"is not a run of `rigidmc {name} SCENE -o RUN/`"
            raise FileError(rule, at="run", file=directory.path)
        done = shards.read_tasks(directory)
        if not done:
            rule = "no task is finished yet: resume it first"
            raise FileError(rule, at="run", value=directory.path)
        scene = scene_of_run(directory, allow_code)
        given = study[2], done, options, threads or threads_available()
        return describe(self.reduce(prepare_scene(scene), *given), scene)

    def create(
        self, name: str, design: Design, options: Any, path: Path, **ways: Any
    ) -> RunDirectory:
        """Create a run directory; see `rigidmc.runs.directory.tasks.create_tasks`.

        ways : size and longest time of a shard; refused, since they apply to members only
        """
        size, limit = ways.get("size"), ways.get("limit")
        for key, value in (("size", size and size / 1e6), ("time", limit)):
            if value is not None:
                rule = "applies to members; here a shard is a task of the study"
                raise OptionError(rule, at=f"shard_{key}", value=value)
        scene, request = design
        first = self.next(prepare_scene(scene), request, {})
        return shards.create_tasks(scene, path, name, request, first, int(self.is_growing))

    def price(
        self, run: PreparedRun, request: Request, numbers: Sequence[int], threads: int,
        device: str | None = None,
    ) -> str:  # fmt: skip
        """Return the estimated cost of tasks as text, from the time of steps measured now."""
        steps, device = self.cost(run, request, numbers), resolve_device(device)
        took = 1e-9 * steps * cost_per_step(run, device) / movers(threads, device)
        return (
            f"{count_text(len(numbers), 'task')} x"
            f" {steps / max(1, len(numbers)):,.0f} member-steps, {two_digits(steps)} in all:"
            f" about {took:.2g} s on {count_text(threads, 'thread')}"
        )


def tasks_of(directory: RunDirectory) -> tuple[str, Tasks, dict[str, Any]] | None:
    """Return (name, work, request) of the study of a run directory; None if it stores members;
    FileError."""
    study = shards.study_of(directory)
    if study is None:
        return None
    name, request = study
    if name not in STUDIES or not isinstance(work := load_study(name).work, Tasks):
        rule = f"is not a study of this version; known: {', '.join(STUDIES)}"
        raise FileError(rule, at="study", value=name, file=directory.path)
    return name, work, request


def resume_study(
    directory: RunDirectory,
    max_wall: float | str | None = None,
    only: range | None = None,
    allow_code: bool = False,
    device: str | None = None,
    **options: Any,
) -> tuple[RunDirectory, dict[str, int]]:
    """Compute the tasks of a study until no more are needed; return (RunDirectory, {status:
    number of tasks} of the computed tasks). Options as in `rigidmc.runs.directory.resume.resume`.

    Raises OptionError for a range of tasks if further tasks are still unknown.
    """
    tasks, run, request, task = _prepared(directory, allow_code, device)
    accept, cluster = options.get("accept", False), options.get("cluster")
    how = read_resume(only, max_wall, cluster, accept, allow_code, device)
    threads, progress = options.get("threads"), options.get("progress", False)
    many = threads_available() if threads is None else read_count(threads, "threads")
    machine = Machine(many, "cpu", tasks.together, progress)
    flagged: dict[str, int] = {}
    while True:
        if progress is True:
            numbers = [int(directory.members(int(i))[0]) for i in missing_of(directory, only)]
            if numbers:
                say(tasks.price(run, request, numbers, many, device))
        now = shards.resume_tasks(directory, task, work, machine, how)
        flagged = {word: flagged.get(word, 0) + count for word, count in now.items()}
        if directory.missing().size or not directory.facts["growing"]:
            return directory, flagged
        more = np.asarray(tasks.next(run, request, shards.read_tasks(directory)), np.int64)
        if more.size and only is not None:
            rule = "the next tasks depend on all of these: resume without a range of shards"
            raise OptionError(rule, at="shards", value=f"{only.start}:{only.stop}")
        directory = add_members(directory, more, int(more.size > 0))
        if not more.size or (how.stop is not None and time.monotonic() >= how.stop):
            return directory, flagged


def work(directory: RunDirectory, i: int, how: Resume) -> dict[str, int]:
    """Compute one task of a run directory, as a worker on a cluster."""
    check_versions(directory, how.accept)
    *_, task = _prepared(directory, how.allow_code, how.device)
    return shards.compute_tasks(directory, task, [i], Machine(1, "cpu", 1))


def verify_study(
    path: Path, spot: int = 3, allow_code: bool = False, threads: int | None = None
) -> list[str]:
    """Verify a run directory, as `rigidmc.runs.directory.gather.verify`; for a study, recompute
    `spot` random tasks and compare them."""
    directory = RunDirectory(path)
    if tasks_of(directory) is None:
        return verify(path, spot, allow_code, threads)
    faults = verify(path, 0, allow_code)
    if faults or not spot:
        return faults
    *_, task = _prepared(directory, allow_code)
    many, done = threads or threads_available(), sorted(directory.shards())
    chosen = sorted(random.sample(done, min(spot, len(done))))
    again = (shards.compare_task(directory, i, task, many) for i in chosen)
    return [fault for fault in again if fault]


def _prepared(
    directory: RunDirectory, allow_code: bool, device: str | None = None
) -> tuple[Tasks, PreparedRun, dict[str, Any], Task]:
    """Return (work, run of its tasks, request, function that computes tasks) of a run directory of
    a study."""
    study = tasks_of(directory)
    assert study is not None
    _, tasks, request = study
    run = prepare_scene(scene_of_run(directory, allow_code))

    def task(numbers: Sequence[int], threads: int) -> list[TaskArrays]:
        return tasks.compute_some(run, request, numbers, threads, device)

    return tasks, run, request, task
