"""Persistent threads and their tasks. No signal causes a deadlock.

A signal raises its exception in the main thread between any two instructions: even in the Python
code of `threading.Condition`, `queue.Queue` and `concurrent.futures`, after they acquire a lock and
before they record it. The lock then stays locked. With these classes, a run stopped by two signals
sometimes deadlocked. Here the main thread acquires no lock that a worker needs: tasks and answers
go through `SimpleQueue`, which is written in C.
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

MOMENT = 0.002  # s between two checks of a dropped task

_end: ContextVar[float] = ContextVar("end", default=math.inf)


class Late(Exception):
    """Raised in work that has reached its deadline, see `ending`."""


@contextmanager
def ending(at: float | None) -> Iterator[None]:
    """Set the deadline that `is_late` checks within this context.

    at : on the clock of time.monotonic(); None for no deadline
    """
    token = _end.set(min(_end.get(), math.inf if at is None else at))
    try:
        yield
    finally:
        _end.reset(token)


def is_late() -> bool:
    """Return whether the work of this thread has reached its deadline."""
    return time.monotonic() >= end_of_work()


def end_of_work() -> float:
    """Return the deadline of this thread's work, on the clock of time.monotonic(); inf for none."""
    return _end.get()


class Task:
    """A call function(*arguments) made in a thread.

    answers : queue that receives the completed task; by default its own
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
        self.begun = True  # before reading `dropped`: `drop` uses the reverse order
        try:
            if not self.dropped:
                self.value = self.function(*self.arguments)
        except BaseException as error:  # `result` reraises it
            self.error = error
        self.done = True
        self.answers.put(self)

    def result(self) -> Any:
        """Return the value of a completed task, or raise its error."""
        if self.error is not None:
            raise self.error
        return self.value

    def wait(self) -> Any:
        """Wait until a task with its own queue completes; return its result."""
        self.answers.get()
        return self.result()


def drop(tasks: Collection[Task]) -> None:
    """Cancel the tasks that have not begun, and wait until the others end."""
    for task in tasks:
        task.dropped = True
    while any(task.begun and not task.done for task in tasks):
        time.sleep(MOMENT)


class Threads:
    """A pool of at most `count` threads; each starts when a task needs it."""

    def __init__(self, count: int) -> None:
        self.count, self._begun, self._process = count, 0, os.getpid()
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self._idle: SimpleQueue[None] = SimpleQueue()  # one entry per waiting thread
        self._ended: list[int] = []

    def begin(self, task: Task) -> None:
        """Queue a task."""
        try:
            self._idle.get_nowait()
        except Empty:
            if self._begun < self.count:
                if self._begun == 0:
                    atexit.register(self.end)
                # threading.Thread would wait for a Condition at its start
                start_new_thread(self._work, ())
                self._begun += 1
        self._tasks.put(task)

    def run(self, tasks: Sequence[Task], here: Callable[[], Any] | None = None) -> None:
        """Run tasks, each with its own queue, and `here` in this thread; wait for all."""
        try:
            for task in tasks:
                self.begin(task)
            if here is not None:
                here()
            for task in tasks:
                task.wait()
        finally:  # after an error or a signal no task continues
            drop(tasks)

    def end(self) -> None:
        """End the threads after their queued tasks."""
        atexit.unregister(self.end)
        if os.getpid() != self._process:
            return  # a forked process has none of the threads
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
            del task  # free its memory before waiting for the next one
        self._ended.append(1)


@cache
def threads_of(work: str, count: int) -> Threads:
    """Return the persistent threads for one kind of work.

    Starting and ending threads each time would take a large fraction of a short run.
    """
    return Threads(count)


if hasattr(os, "register_at_fork"):  # a forked process has none of the threads
    os.register_at_fork(after_in_child=threads_of.cache_clear)
