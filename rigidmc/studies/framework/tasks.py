"""Studies that are made of tasks: computed now, or in a run directory, which loses nothing.

A study of this kind is a module with a `KIND`, and one line in STUDIES.
"""

import importlib
import random
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.machine import threads_available
from rigidmc.errors import FileError, OptionError
from rigidmc.files.outputs import Path
from rigidmc.progress import Progress, announcing, reporter, say
from rigidmc.results.run_directory import RunDirectory
from rigidmc.runs.directory.gather import verify
from rigidmc.runs.directory.load import refuse_others, scene_of_run
from rigidmc.runs.directory.resume import grow, missing_of
from rigidmc.runs.directory.tasks import (
    Found,
    Request,
    compute_tasks,
    create_tasks,
    found_in,
    resume_tasks,
    study_of,
    unlike,
)
from rigidmc.runs.prepare import prepared
from rigidmc.runs.price import cost_per_step
from rigidmc.runs.resources import movers
from rigidmc.scene.amounts import in_two_digits, seconds
from rigidmc.scene.scene import Scene

STUDIES = {
    "rare": "rigidmc.studies.rare.study",
    "multilevel": "rigidmc.studies.multilevel.study",
}


class Kind(NamedTuple):
    """What a study of tasks is made of.

    name : its command
    grows : whether what tasks say decides which are next
    together : how many tasks are computed at once
    tasks : (scene, request, numbers of tasks, threads) -> what each finds, a pure function of all
        but the threads and the other tasks
    more : (scene, request, {number: what was found} of the tasks so far) -> the numbers of the next
        tasks, [] at the end; none is done at the beginning
    cost : (scene, request, numbers of tasks) -> the member-steps that they take
    """

    name: str
    grows: bool
    together: int
    tasks: Callable[[Scene, Request, Sequence[int], int], list[Found]]
    more: Callable[[Scene, Request, dict[int, Found]], Sequence[int]]
    cost: Callable[[Scene, Request, Sequence[int]], float]

    def price(self, scene: Scene, request: Request, numbers: Sequence[int], threads: int) -> str:
        """What tasks will cost, in words, by steps that are measured now."""
        steps, device = self.cost(scene, request, numbers), resolve_device(None)
        took = 1e-9 * steps * cost_per_step(prepared(scene), device) / movers(threads, device)
        return (
            f"{len(numbers):,} tasks x {steps / max(1, len(numbers)):,.0f} member-steps,"
            f" {in_two_digits(steps)} in all: about {took:.2g} s on {threads} threads"
        )


def computed(
    kind: Kind, scene: Scene, request: Request, threads: int | None, progress: Progress = False
) -> dict[int, Found]:
    """{number: what was found} of all tasks of a study, computed now.

    progress : as of `simulate`, with tasks in place of member-steps; True also for what they cost
    """
    found: dict[int, Found] = {}
    many = threads or threads_available()
    with announcing(progress):
        while numbers := kind.more(scene, request, found):
            if progress is True:
                say(kind.price(scene, request, numbers, many))
            with reporter(progress, len(numbers), 1) as report:
                for first in range(0, len(numbers), kind.together):
                    group = numbers[first : first + kind.together]
                    found |= zip(group, kind.tasks(scene, request, group, many), strict=True)
                    report.step(len(group))
                    report.poll()
    return found


def create(kind: Kind, scene: Scene, request: Request, path: Path) -> RunDirectory:
    """Make a run directory for a study; see `rigidmc.runs.directory.tasks.create_tasks`."""
    first = kind.more(scene, request, {})
    return create_tasks(scene, path, kind.name, request, first, int(kind.grows))


def kind_of(directory: RunDirectory) -> tuple[Kind, dict[str, Any]] | None:
    """(Kind, what is asked) of a run directory; None if it has members; FileError."""
    study = study_of(directory)
    if study is None:
        return None
    name, request = study
    if name not in STUDIES:
        rule = f"is no study of this version; known: {', '.join(STUDIES)}"
        raise FileError(rule, at="study", value=name, file=directory.path)
    kind: Kind = importlib.import_module(STUDIES[name]).KIND
    return kind, request


def resume(
    directory: RunDirectory,
    max_wall: float | str | None = None,
    only: range | None = None,
    allow_code: bool = False,
    **options: Any,
) -> tuple[RunDirectory, dict[str, int]]:
    """Compute the tasks of a study until what is there asks for no more; (RunDirectory, {status:
    tasks} of what was computed). Options as of `rigidmc.runs.directory.resume.resume`.

    Raises OptionError for a range of tasks of which more are to come.
    """
    kind, request = _known(directory)
    scene = scene_of_run(directory, allow_code)
    stop = None if max_wall is None else time.monotonic() + seconds(max_wall, "max_wall")
    flagged: dict[str, int] = {}
    left: float | None = None if stop is None else max(1e-9, stop - time.monotonic())
    while True:
        if options.get("progress") is True:
            _tell(kind, scene, request, directory, only, options.get("threads"))
        now = resume_tasks(
            directory,
            lambda numbers, threads: kind.tasks(scene, request, numbers, threads),
            work,
            max_wall=left,
            only=only,
            allow_code=allow_code,
            together=kind.together,
            **options,
        )
        flagged = {word: flagged.get(word, 0) + count for word, count in now.items()}
        left = None if stop is None else stop - time.monotonic()
        if directory.missing().size or not directory.facts["growing"]:
            return directory, flagged
        more = np.asarray(kind.more(scene, request, found_in(directory)), np.int64)
        if more.size and only is not None:
            rule = "all tasks must be there before the next are known: leave it out"
            raise OptionError(rule, at="shards", value=f"{only.start}:{only.stop}")
        directory = grow(directory, more, int(more.size > 0))
        if not more.size or (left is not None and left <= 0.0):
            return directory, flagged


def _tell(
    kind: Kind, scene: Scene, request: Request, directory: RunDirectory, only: range | None,
    threads: int | None,
) -> None:  # fmt: skip
    """Say what the missing tasks will cost."""
    numbers = [int(directory.members(int(i))[0]) for i in missing_of(directory, only)]
    if numbers:
        say(kind.price(scene, request, numbers, threads or threads_available()))


def found(path: Path, name: str, allow_code: bool = False) -> tuple[Scene, Any, dict[int, Found]]:
    """(scene, request, {number: numbers}) of the tasks of a study in a run directory that are done.

    name : which study it has to be;  raises FileError for anything else, and if none is done
    """
    directory = RunDirectory(path)
    study = kind_of(directory)
    if study is None or study[0].name != name:
        rule = f"is no run of `rigidmc {name} SCENE -o RUN/`"
        raise FileError(rule, at="run", file=directory.path)
    done = found_in(directory)
    if not done:
        raise FileError("no task is done yet: resume it first", at="run", value=directory.path)
    return scene_of_run(directory, allow_code), study[1], done


def work(path: str, i: int, allow_code: bool, accept: bool) -> dict[str, int]:
    """Compute one task of a run directory: what a worker of a cluster does."""
    directory = RunDirectory(path)
    refuse_others(directory, accept)
    kind, request = _known(directory)
    scene = scene_of_run(directory, allow_code)
    return compute_tasks(
        directory, lambda numbers, threads: kind.tasks(scene, request, numbers, threads), [i], 1
    )


def verified(
    path: Path, spot: int = 3, allow_code: bool = False, threads: int | None = None
) -> list[str]:
    """As `rigidmc.runs.directory.gather.verify`, also of a study, of which tasks are computed
    again."""
    directory = RunDirectory(path)
    study = kind_of(directory)
    if study is None:
        return verify(path, spot, allow_code, threads)
    kind, request = study
    faults = verify(path, 0, allow_code)
    if faults or not spot:
        return faults
    scene, many = scene_of_run(directory, allow_code), threads or threads_available()
    done = sorted(directory.shards())
    again = (
        unlike(directory, i, lambda numbers, n: kind.tasks(scene, request, numbers, n), many)
        for i in sorted(random.sample(done, min(spot, len(done))))
    )
    return [fault for fault in again if fault]


def _known(directory: RunDirectory) -> tuple[Kind, dict[str, Any]]:
    """As `kind_of`, of a run directory that has a study."""
    study = kind_of(directory)
    assert study is not None
    return study
