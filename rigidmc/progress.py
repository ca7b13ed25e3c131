"""Progress of a run: a bar with members/s and time left on a terminal, a line now and then elsewhere, or a user's function."""

import logging
import sys
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager, suppress
from contextvars import ContextVar

Progress = bool | Callable[[int, int], object] | None  # a bar, a function of (done, total), nothing

log = logging.getLogger("rigidmc")
_LINE_SECONDS = 10.0  # between plain lines
_announced: ContextVar[bool] = ContextVar("announced", default=False)


@contextmanager
def announcing(progress):
    """Within this, what begins is printed by `say` if `progress` is True."""
    token = _announced.set(_announced.get() or progress is True)
    try:
        yield
    finally:
        _announced.reset(token)


def say(text):
    """A line about something that begins and takes long: for the log, and for people who asked for progress."""
    log.info(text)
    if _announced.get():
        with suppress(OSError):  # who reads it may have gone
            print(text, file=sys.stderr, flush=True)


class _Report:
    """Counts member-steps from any thread; `poll` is called by the main thread and shows them."""

    def __init__(self, total, show):
        self.total, self.done, self.show = total, 0, show
        self._lock = threading.Lock()

    def step(self, count):
        with self._lock:
            self.done = min(self.total, self.done + count)

    def poll(self):
        self.show(round(self.done), self.total)


@contextmanager
def reporter(progress, members, steps):
    """A report with step(count) and poll(); progress: False, True, or a function of (done, total) member-steps."""
    total = members * steps
    if callable(progress):
        report = _Report(total, progress)
        yield report
        report.poll()
    elif not progress:
        yield _Report(total, lambda done, total: None)
    elif sys.stderr.isatty():
        with _bar(total, steps) as report:
            yield report
            report.poll()
    else:
        report = _Report(total, _lines())
        yield report


@contextmanager
def _bar(total, steps):
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.percentage:5.1f} %"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    began = time.perf_counter()
    with Progress(*columns, console=Console(stderr=True), transient=False) as bar:
        task = bar.add_task("", total=total, rate="")

        def show(done, total):
            rate = done / max(1e-9, time.perf_counter() - began)
            bar.update(task, completed=done, rate=f"{rate / steps:,.0f} members/s")

        yield _Report(total, show)


def _lines():
    began = last = time.perf_counter()

    def show(done, total):
        nonlocal last
        now = time.perf_counter()
        if now - last > _LINE_SECONDS:
            last = now
            left = (now - began) * (total - done) / max(1, done)
            with suppress(OSError):  # who reads it may have gone; the run goes on
                print(
                    f"{100 * done / total:.0f} % done, {left:.0f} s left",
                    file=sys.stderr,
                    flush=True,
                )

    return show
