"""Blocks of members on threads, in kernel calls of at most 60 ms.

Everything else happens between calls: progress, and stopping the run.
"""

import threading
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from queue import Empty, SimpleQueue
from typing import Any, Protocol

import numpy as np

from rigidmc.engine.kernel.arguments import SaveTarget
from rigidmc.processes.threads import Late, Task, drop, is_late, threads_of

# s that a thread waits at most for another one to build or to end a block: hundreds of short
# operations of NumPy. Side by side, threads would take turns at each operation, which takes three
# times as long (1.4 ms in place of 0.5 ms), and blocks of equal length would stay in step. Only
# workers take this lock.
TURN = 0.002
EVERY = np.empty(0, np.int64)  # members in their original order


class Stopped(Exception):
    """Raised in a worker whose run is stopped."""


class Keeper(Protocol):
    """An object that saves the states of unfinished blocks; the threads of the blocks call it."""

    def is_due(self, job: Any) -> bool:
        """Return whether the state of a block should be saved now."""

    def keep(self, job: Any) -> None:
        """Save the state of a block after `job.steps.first` steps; a failure raises nothing."""


def run_block(
    job: Any,
    stop: threading.Event | None = None,
    progress: Callable[[float], Any] | None = None,
    keeper: Keeper | None = None,
) -> Any:
    """Take one block from its first remaining step to the last, and return its job.

    job : a BlockJob of `rigidmc.runs.blocks`
    progress : called with member-steps as they are made, and with those made earlier
    keeper : saves the state now and then, and when the run is stopped
    """
    block, done, total = job.block, job.steps.first, job.steps.total
    size, slots = max(1, block.shape[1]), job.steps.slots
    if job.program is None:  # a closed form: there are no steps
        if progress is not None:
            progress(size * total / slots)
        return job
    if progress is not None and done:
        progress(size * done / slots)
    order = EVERY if job.order is None else job.order
    saves = SaveTarget(job.out, job.width, job.column, order)
    with closing(job.program.through(block, job.steps, job.noise, saves)) as calls:
        for last in calls:
            if progress is not None:
                progress(size * (last - done) / slots)
            done, stopped = last, stop is not None and stop.is_set()
            if keeper is not None and done < total and (stopped or keeper.is_due(job)):
                calls.send(True)  # copies the state to the block
                keeper.keep(job.after(done))
            if stopped and done < total:
                raise Stopped
    return job


def _unchanged(job: Any) -> Any:
    return job


def run_alone(
    make: Callable[[int], Any],
    indices: Iterable[int],
    finished: Callable[[Any], Any],
    progress: Callable[[float], Any],
    poll: Callable[[], Any],
    end: Callable[[Any], Any] = _unchanged,
) -> None:
    """Run like `run_blocks`, but in this thread: starting another thread would cost time."""

    def between_calls(steps: float) -> None:
        progress(steps)
        poll()
        if is_late():
            raise Late

    for i in indices:
        finished(end(run_block(make(i), None, between_calls)))


def run_blocks(
    make: Callable[[int], Any],
    indices: Iterable[int],
    threads: int,
    finished: Callable[[Any], Any],
    progress: Callable[[float], Any] | None = None,
    poll: Callable[[], Any] | None = None,
    keeper: Keeper | None = None,
    end: Callable[[Any], Any] = _unchanged,
) -> None:
    """Run make(i) -> job for each index on threads, and finished(end(job)) in this thread.

    At most threads + 2 blocks are alive at once. `poll` is called in this thread five times a
    second. Any exception here or in a worker, Ctrl-C included, stops all workers within one kernel
    call and is raised again.

    end : called with a finished job in the thread that moved it
    keeper : saves the states of stopped blocks. If the work is late, see
        `rigidmc.processes.threads.ending`, these blocks stay unfinished and nothing is raised;
        without a keeper, Late is raised
    """
    stop = threading.Event()

    turn = threading.Lock()

    def in_turn(function: Callable[[Any], Any], given: Any) -> Any:
        taken = turn.acquire(timeout=TURN)
        try:
            return function(given)
        finally:
            if taken:
                turn.release()

    def work(i: int) -> Any:
        if stop.is_set():
            raise Stopped
        return in_turn(end, run_block(in_turn(make, i), stop, progress, keeper))

    pool, answers = threads_of("blocks", threads), SimpleQueue[Task]()
    pending: set[Task] = set()
    following = iter(indices)
    try:
        while True:
            if not stop.is_set() and is_late():
                if keeper is None:
                    raise Late
                stop.set()
                following = iter(())
            while len(pending) < threads + 2 and (i := next(following, None)) is not None:
                task = Task(work, i, answers=answers)
                pending.add(task)
                pool.begin(task)
            if not pending:
                return
            with suppress(Empty):
                task = answers.get(timeout=0.2 if poll else None)
                pending.discard(task)
                if not isinstance(task.error, Stopped):
                    finished(task.result())
            if poll:
                poll()
    finally:
        stop.set()
        drop(pending)
