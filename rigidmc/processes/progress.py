"""Progress of a run: on a terminal a bar with members/s and time left, elsewhere an occasional
line, or a user's function."""

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar

Show = Callable[[int, int], object]  # called with completed and total member-steps
Progress = bool | Show | None  # a bar, a function, or nothing

log = logging.getLogger("rigidmc")
_LINE_SECONDS = 10.0  # between plain lines
_announced: ContextVar[bool] = ContextVar("announced", default=False)


@contextmanager
def announce(progress: object) -> Iterator[None]:
    """Let `say` print within this context if `progress` is True."""
    token = _announced.set(_announced.get() or progress is True)
    try:
        yield
    finally:
        _announced.reset(token)


def say(text: str) -> None:
    """Log a line about the start of a slow operation, and print it if the user asked for
    progress."""
    log.info(text)
    if _announced.get():
        _print(text)


def _print(text: str) -> None:
    with suppress(OSError):  # if the reader has closed the pipe, the run continues
        print(text, file=sys.stderr, flush=True)


class Report:
    """Counter of member-steps from any thread. The main thread calls `poll`, which shows them."""

    def __init__(self, total: int, show: Show) -> None:
        self.total, self.show = total, show
        self.done: float = 0
        self._lock = threading.Lock()

    def step(self, count: float) -> None:
        """Add completed member-steps."""
        with self._lock:
            self.done = min(self.total, self.done + count)

    def poll(self) -> None:
        """Show the completed member-steps."""
        self.show(round(self.done), self.total)


@contextmanager
def reporter(
    progress: Progress, members: int, steps: int, things: str = "members"
) -> Iterator[Report]:
    """Yield a report with step(count) and poll().

    progress : True for a bar or lines, or a function of (done, total) member-steps
    things : what the rate on the bar counts
    """
    total = members * steps
    if callable(progress):
        report = Report(total, progress)
        yield report
        report.poll()
    elif not progress:
        yield Report(total, lambda done, total: None)
    elif in_notebook():
        report = Report(total, _notebook(steps))
        yield report
        report.poll()
    elif sys.stderr.isatty():
        with _bar(total, steps, things) as report:
            yield report
            report.poll()
    else:
        yield Report(total, _lines())


@contextmanager
def _bar(total: int, steps: int, things: str) -> Iterator[Report]:
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

        def show(done: int, total: int) -> None:
            rate = done / max(1e-9, time.perf_counter() - began)
            bar.update(task, completed=done, rate=f"{rate / steps:,.0f} {things}/s")

        yield Report(total, show)


def in_notebook() -> bool:
    """Return whether this runs in a Jupyter kernel."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and hasattr(shell, "kernel")


def _notebook(steps: int) -> Show:
    """Return a function that shows a bar below the cell, redrawn up to five times a second."""
    from IPython.display import HTML, display

    began = last = time.perf_counter()
    place = display(HTML(""), display_id=True)

    def show(done: int, total: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last > 0.2 or done >= total:
            last = now
            rate = done / max(1e-9, now - began)
            left = (total - done) / max(1e-9, rate)
            words = f"{100 * done / total:.0f} %, {rate / steps:,.0f} members/s, {left:.0f} s left"
            place.update(HTML(f'<progress value="{done}" max="{total}"></progress> {words}'))

    return show


def _lines() -> Show:
    began = last = time.perf_counter()

    def show(done: int, total: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last > _LINE_SECONDS:
            last = now
            left = f", {(now - began) * (total - done) / done:.0f} s left" if done else ""
            _print(f"{100 * done / total:.0f} % done{left}")

    return show
