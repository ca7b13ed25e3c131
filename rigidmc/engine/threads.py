"""Blocks of members on threads: no kernel call is longer than a blink, and everything else happens between calls."""

import os
import threading
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import cache

import numpy as np

from rigidmc.engine.frame import Run, Saves

EVERY = np.empty(0, np.int64)  # the order of members that are in their order
CALL = 3_000_000  # member-steps per call: 10 to 60 ms at 50 to 300 M/s on two threads


class Stopped(Exception):
    """Raised in a worker whose run was called off."""


def run_block(job, stop=None, progress=None):
    """Take one block from the first step to the last. job: see `Job`."""
    block, done = job.block, 0
    size, each = max(1, block.shape[1]), job.rounds / job.total
    if job.program is None:  # made without steps
        if progress is not None:
            progress(size * job.rounds)
        return job
    order = EVERY if job.order is None else job.order
    saves, own = Saves(job.out, job.width, job.column, order), int(job.order is not None)
    piece = max(
        1, CALL // (size * (len(job.program.form.parts) - 1))
    )  # a step in many parts takes as many times as long
    while done < job.total:
        if stop is not None and stop.is_set():
            raise Stopped
        last = min(job.total, done + piece)
        job.program.advance(
            block, Run(job.h, job.slots, job.stride, job.total, own, done, last), job.noise, saves
        )
        if progress is not None:
            progress(size * (last - done) * each)
        done = last
    return job


def run_blocks(make, which, threads, finished, progress=None, poll=None):
    """Run make(i) -> job for each i of `which` on threads, and finished(job) in this thread as each is done.

    At most threads + 2 blocks are alive at once. `poll` is called in this thread five times a second. Whatever is raised here or in a
    worker, Ctrl-C included, stops all workers within one kernel call and is raised again.
    """
    stop = threading.Event()

    def work(i):
        return run_block(make(i), stop, progress)

    pool = threads_of("blocks", threads)
    pending: set[Future] = set()
    following = iter(which)
    try:
        while True:
            while len(pending) < threads + 2 and (i := next(following, None)) is not None:
                pending.add(pool.submit(work, i))
            if not pending:
                return
            done, pending = wait(
                pending, timeout=0.2 if poll else None, return_when=FIRST_COMPLETED
            )
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
def threads_of(work, count):
    """So many threads that stay, of a name: to start two and end them takes 0.3 ms, of a run of 64 members a tenth."""
    return ThreadPoolExecutor(count, thread_name_prefix=f"rigidmc {work}")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=threads_of.cache_clear)  # a forked process has none of them
