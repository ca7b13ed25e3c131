"""Threads that stay, and tasks for them. No signal makes anything wait for ever.

A signal raises its exception in the main thread between any two instructions: also in the Python
code of `threading.Condition`, `queue.Queue` and `concurrent.futures`, between taking a lock and
noting that it has the lock. The lock then stays locked. With them a run that two signals stopped
sometimes waited for itself for ever. Here the main thread takes no
lock that a worker needs: tasks and answers go through `SimpleQueue`, which is written in C.
"""

import atexit
import math
import os
import time
from _thread import start_new_thread
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from queue import Empty, SimpleQueue
from typing import Any

MOMENT = 0.002  # s between two looks at a task that was dropped

_end: ContextVar[float] = ContextVar("end", default=math.inf)


class Late(Exception):
    """Raised in work that has to end now, see `ending`."""


@contextmanager
def ending(at: float | None) -> Iterator[None]:
    """Within this context `is_late` says whether a time has come.

    at : on the clock of time.monotonic(); None for never
    """
    token = _end.set(min(_end.get(), math.inf if at is None else at))
    try:
        yield
    finally:
        _end.reset(token)


def is_late() -> bool:
    """Whether the work of this thread has to end now."""
    return time.monotonic() >= end_of_work()


def end_of_work() -> float:
    """When the work of this thread has to end, on the clock of time.monotonic(); inf for never."""
    return _end.get()


class Task:
    """A call function(*arguments) that a thread makes.

    answers : where the task goes when it is done; by default a queue of its own
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        answers: "SimpleQueue[Task] | None" = None,
    ) -> None:
        self.function, self.arguments = function, arguments
        self.answers: SimpleQueue[Task] = SimpleQueue() if answers is None else answers
        self.value: Any = None
        self.error: BaseException | None = None
        self.begun = self.done = self.dropped = False

    def run(self) -> None:
        """Make the call, in a thread."""
        self.begun = True  # before the look at `dropped`: `drop` looks in the other order
        try:
            if not self.dropped:
                self.value = self.function(*self.arguments)
        except BaseException as error:  # raised again by `result`
            self.error = error
        self.done = True
        self.answers.put(self)

    def result(self) -> Any:
        """The value of a task that is done; its error is raised."""
        if self.error is not None:
            raise self.error
        return self.value

    def wait(self) -> Any:
        """Wait until a task with a queue of its own is done; its result."""
        self.answers.get()
        return self.result()


def drop(tasks: Collection[Task]) -> None:
    """Begin none of some tasks, and wait for the end of those that have begun."""
    for task in tasks:
        task.dropped = True
    while any(task.begun and not task.done for task in tasks):
        time.sleep(MOMENT)


class Threads:
    """At most a number of threads that take tasks in turn; each begins when a task needs it."""

    def __init__(self, count: int) -> None:
        self.count, self._begun, self._process = count, 0, os.getpid()
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self._idle: SimpleQueue[None] = SimpleQueue()  # an entry for each thread that waits
        self._ended: list[int] = []

    def begin(self, task: Task) -> None:
        """Hand a task over."""
        try:
            self._idle.get_nowait()
        except Empty:
            if self._begun < self.count:
                if self._begun == 0:
                    atexit.register(self.end)
                # threading.Thread waits for a Condition as it starts
                start_new_thread(self._work, ())
                self._begun += 1
        self._tasks.put(task)

    def run(self, tasks: Sequence[Task], here: Callable[[], Any] | None = None) -> None:
        """Run tasks, each with a queue of its own, and `here` in this thread; wait for all."""
        try:
            for task in tasks:
                self.begin(task)
            if here is not None:
                here()
            for task in tasks:
                task.wait()
        finally:  # after an error or a signal none goes on
            drop(tasks)

    def end(self) -> None:
        """End the threads, after the tasks that they have."""
        atexit.unregister(self.end)
        if os.getpid() != self._process:
            return  # a forked process has none of them
        for _ in range(self._begun):
            self._tasks.put(None)
        while len(self._ended) < self._begun:
            time.sleep(MOMENT)
        self._begun, self._ended, self._idle = 0, [], SimpleQueue()

    def _work(self) -> None:
        while True:
            try:
                task = self._tasks.get_nowait()
            except Empty:
                self._idle.put(None)
                task = self._tasks.get()
            if task is None:
                break
            task.run()
            del task  # frees its memory before the wait for the next
        self._ended.append(1)


@cache
def threads_of(work: str, count: int) -> Threads:
    """The threads for one kind of work, which stay.

    To start and end threads anew would take a good part of a short run.
    """
    return Threads(count)


if hasattr(os, "register_at_fork"):  # a forked process has none of the threads
    os.register_at_fork(after_in_child=threads_of.cache_clear)
