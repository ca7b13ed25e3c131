"""Blocks of members on threads: no kernel call is longer than a blink.

Everything else happens between calls: progress, and calling the run off.
"""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import numpy as np

from rigidmc.engine.frame import Run, Saves

EVERY = np.empty(0, np.int64)  # the order of members that are in their order
CALL = 3_000_000  # member-steps per call: 10 to 60 ms at 50 to 300 M/s on two threads


class Stopped(Exception):
    """Raised in a worker whose run is called off."""


def run_block(
    job: Any, stop: threading.Event | None = None, progress: Callable[[float], Any] | None = None
) -> Any:
    """Take one block from the first step to the last, and return its job.

    job : a Job of `rigidmc.planning.job`;  progress : called with member-steps as they are made
    """
    block, done = job.block, 0
    size, rounds_a_step = max(1, block.shape[1]), job.rounds / job.total
    if job.program is None:  # a closed form: there are no steps
        if progress is not None:
            progress(size * job.rounds)
        return job
    order = EVERY if job.order is None else job.order
    saves, member_steps = Saves(job.out, job.width, job.column, order), int(job.order is not None)
    # a step in many parts takes as many times as long
    steps = max(1, CALL // (size * (len(job.program.form.parts) - 1)))
    while done < job.total:
        if stop is not None and stop.is_set():
            raise Stopped
        last = min(job.total, done + steps)
        part = Run(job.h, job.slots, job.stride, job.total, member_steps, done, last)
        job.program.advance(block, part, job.noise, saves)
        if progress is not None:
            progress(size * (last - done) * rounds_a_step)
        done = last
    return job


def run_blocks(
    make: Callable[[int], Any],
    indices: Iterable[int],
    threads: int,
    finished: Callable[[Any], Any],
    progress: Callable[[float], Any] | None = None,
    poll: Callable[[], Any] | None = None,
) -> None:
    """Run make(i) -> job for each index on threads, and finished(job) in this thread.

    At most threads + 2 blocks are alive at once. `poll` is called in this thread five times a
    second. Whatever is raised here or in a worker, Ctrl-C included, stops all workers within one
    kernel call and is raised again.
    """
    stop = threading.Event()

    def work(i: int) -> Any:
        return run_block(make(i), stop, progress)

    pool = threads_of("blocks", threads)
    pending: set[Future[Any]] = set()
    following = iter(indices)
    try:
        while True:
            while len(pending) < threads + 2 and (i := next(following, None)) is not None:
                pending.add(pool.submit(work, i))
            if not pending:
                return
            timeout = 0.2 if poll else None
            done, pending = wait(pending, timeout=timeout, return_when=FIRST_COMPLETED)
            for future in done:
                finished(future.result())
            if poll:
                poll()
    finally:
        stop.set()
        for future in pending:
            future.cancel()
        wait(pending)


@cache
def threads_of(work: str, count: int) -> ThreadPoolExecutor:
    """A pool of threads that stay, for work of this name.

    To start and end two threads takes 0.3 ms: a tenth of a run of 64 members.
    """
    return ThreadPoolExecutor(count, thread_name_prefix=f"rigidmc {work}")


if hasattr(os, "register_at_fork"):  # a forked process has none of the threads
    os.register_at_fork(after_in_child=threads_of.cache_clear)
