"""Run directories whose shards are tasks of a study: results that depend only on the scene, the
request and the task number. run.json lists tasks instead of members."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import FileError
from rigidmc.files.netcdf import read
from rigidmc.files.outputs import Path
from rigidmc.files.reading import json_of
from rigidmc.processes.progress import reporter
from rigidmc.processes.threads import Late, ending, is_late
from rigidmc.results.writer import write_columns
from rigidmc.runs.directory.cluster import Resume, Work, compute_on
from rigidmc.runs.directory.create import MemberSelection, free_place, refuse_many, write_run_files
from rigidmc.runs.directory.folder import RunDirectory
from rigidmc.runs.directory.load import STUDY
from rigidmc.runs.directory.resume import keep_journal, resumed
from rigidmc.runs.directory.shards import Numbers
from rigidmc.runs.prepare import prepare_scene
from rigidmc.runs.settled import Machine
from rigidmc.scene.scene import Scene

Request = Mapping[str, Any]  # the request of a study, as in JSON
TaskArrays = dict[str, NDArray[Any]]  # the results of a task
Task = Callable[[Sequence[int], int], list[TaskArrays]]  # (task numbers, threads)


def create_tasks(
    scene: Scene, path: Path, name: str, request: Request, tasks: Sequence[int], level: int
) -> RunDirectory:
    """Create a run directory for a study.

    name : of the study;  tasks : the first ones;  level : 0 if there are no more, see
        `MemberSelection`
    Raises OutputExists if the folder contains anything.
    """
    place = free_place(path)
    refuse_many(len(tasks), "tasks")
    chosen = MemberSelection(np.asarray(tasks, np.int64), 1, level)
    about = {STUDY: f"{name} {json.dumps(request, sort_keys=True)}"}
    return write_run_files(place, prepare_scene(scene), 1, 1, about, chosen)


def study_of(directory: RunDirectory) -> tuple[str, dict[str, Any]] | None:
    """Return (name of the study, its request) of a run directory; None if it has members."""
    text = str(directory.facts["attributes"].get(STUDY, ""))
    if not text:
        return None
    name, _, request = text.partition(" ")
    asked: Any = json_of(request)
    return name, asked


def compute_tasks(
    directory: RunDirectory,
    task: Task,
    numbers: Numbers,
    machine: Machine,
    stop: float | None = None,
) -> dict[str, int]:
    """Compute the shards with these numbers and write them; return {status: tasks}.

    machine : its block is the number of tasks computed at once, 0 for as many as keep the threads
        at work
    stop : time limit on the clock of time.monotonic(), at which tasks are stopped
    """
    threads = machine.threads
    done, together = 0, machine.block or tasks_at_once(threads)
    with reporter(machine.progress, len(numbers), 1) as report, ending(stop), suppress(Late):
        for first in range(0, len(numbers), together):
            if is_late():
                break
            group = [int(i) for i in numbers[first : first + together]]
            places = [int(directory.members(i)[0]) for i in group]
            for i, number, arrays in zip(group, places, task(places, threads), strict=True):
                _write(directory, i, number, arrays)
            done += len(group)
            report.step(len(group))
            report.poll()
    return {**dict.fromkeys(STATUSES, 0), "ok": done}


def tasks_at_once(threads: int) -> int:
    """Return how many tasks of one thread each keep the threads at work; a kill loses as many."""
    return 2 * threads


def _write(directory: RunDirectory, i: int, number: int, arrays: TaskArrays) -> None:
    """Write the results of a task as shard i."""

    def named(file: str) -> str:
        return directory.shard_path(i, 0, file)

    columns = {"member": np.array([number]), "status": np.zeros(1, "i1"), **arrays}
    path = write_columns(directory.temporary(i), columns, {"run": directory.mark}, named)
    directory.publish(path)


def resume_tasks(
    directory: RunDirectory, task: Task, work: Work, machine: Machine, how: Resume
) -> dict[str, int]:
    """Compute the missing tasks of a study; return {status: tasks}.

    work : function that a worker of a cluster calls;  machine : as in `compute_tasks`
    """
    with resumed(directory, how) as numbers:

        def compute() -> dict[str, int]:
            if how.cluster is None:
                return compute_tasks(directory, task, numbers, machine, how.stop)
            return compute_on(how.cluster, directory, numbers, how, machine.progress, work)

        begun = {"threads": machine.threads, "cluster": how.cluster}
        return keep_journal(directory, numbers, compute, **begun)


def read_tasks(directory: RunDirectory) -> dict[int, TaskArrays]:
    """Return {number: results} of finished tasks; FileError for shards of another run."""
    directory.refuse_strays()
    done: dict[int, TaskArrays] = {}
    for i, shard in sorted(directory.shards().items()):
        values = read(shard, mark=directory.mark)
        number = int(directory.members(i)[0])
        if values.get("member", np.empty(0)).tolist() != [number]:
            rule = "has another task; see `rigidmc verify`"
            raise FileError(rule, at="shard", value=i, file=shard)
        done[number] = {k: v for k, v in values.items() if k not in ("member", "status")}
    return done


def compare_task(directory: RunDirectory, i: int, task: Task, threads: int) -> str:
    """Describe which results of task i differ when recomputed; "" if none do."""
    path = directory.shards()[i]
    stored, (again,) = read(path), task([int(directory.members(i)[0])], threads)
    wrong = [name for name, x in again.items() if stored[name].tobytes() != x.tobytes()]
    differs = f"differs when recomputed: {', '.join(wrong)}"
    return f"{os.path.basename(path)}: {differs}" if wrong else ""
