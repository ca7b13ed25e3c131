"""A run on the workers of a dask cluster: each shard is one task, a pure function of the run and its number, to the bits of one machine of any type.

Where workers see the run directory they write its shards there themselves; else they send each back whole, and this process writes it. A worker
that is lost loses the shard that it was computing, which another then computes; what was written stays.

Ten thousand million members on a thousand workers, planned with what `python -m bench runs` measured (final state of free tops with attitude after
1,200 rk4 steps, 5.4 us of computing and 122 bytes of file a member):

    computing   54,000 s of one thread: a minute of a thousand workers
    files       1.22 TB; in shards of 500 MB (--shard-size 500) 2,440 files, each 22 s of one worker; 64 MB, the default, would be 18,200
    scheduler   4.3 ms of CPU a task: 10 s for 2,440 tasks beside that minute, 78 s for 18,200, which would take longer than the work
    messages    some kB a task: scene.toml goes once to each worker; two tasks wait for each thread
    memory      of a worker 0.25 GB, a few blocks and up to four shards: 2.3 GB of those of 500 MB
    status      5 ms for 1,000 shards by their names alone; rm.open 0.15 s

Where no scheduler is wanted, a job array needs none: `rigidmc run SCENE -o part$I/ --shards A:B` and `rigidmc merge`, whose copying reads and writes
every byte once more.
"""

import contextlib
import hashlib
import logging
import os
import tempfile
import time

from rigidmc.engine.layout import STATUSES
from rigidmc.errors import OptionError
from rigidmc.files.outputs import content_of, write_bytes
from rigidmc.planning.job import program_of
from rigidmc.progress import reporter
from rigidmc.runs.shards import compute_shards, planned, refuse_others
from rigidmc.storage.run_directory import RunDirectory

AHEAD = 2  # tasks that wait for each thread of the workers: the scheduler holds few, however many shards there are
LOST = 20  # times that a shard is begun anew because its worker was lost
QUIET = 60.0  # seconds without any worker, or until a file that another computer wrote is seen here

SETTINGS = {  # of a cluster here
    "distributed.scheduler.allowed-failures": LOST,  # dask gives up at the third, as if the task were to blame
    "distributed.worker.profile.enabled": False,  # looks at the stack 100 times a second, holding what Python threads wait for
    # 2^16 there: the memory of each block would be given back and asked for anew; where the one is set, the other no longer adapts
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 2**30,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 2**25,
}


def checked(cluster):
    """("local", N) or (protocol, address) of a cluster; OptionError for what is none."""
    kind, _, rest = cluster.partition(":")
    if not (
        kind == "local" and rest.isascii() and rest.isdigit() and 0 < int(rest) <= 1024
    ) and not (kind in ("tcp", "tls", "ucx") and rest.startswith("//")):
        raise OptionError(
            "",
            "--cluster",
            cluster,
            "expected tcp://host:port of a scheduler, or local:N for N processes here",
        )
    return kind, rest


def compute_on(
    cluster, directory, which, progress=False, stop=None, allow_code=False, accept=False
):
    """Compute some shards of a run whose lock this process holds, none begun after `stop`; {status: members}.

    cluster : "tcp://host:8786" of a scheduler, or "local:4" for so many processes of one thread each on this machine, which need a main module
        that may be imported (`if __name__ == "__main__":`)
    Raises OptionError where there is no dask or no such cluster, OSError where that is lost, and what workers raise.
    """
    try:
        import dask
        from distributed import CancelledError, Client, KilledWorker, LocalCluster, as_completed
    except ImportError as error:
        raise OptionError(
            "",
            "--cluster",
            cluster,
            f"needs dask.distributed: pip install 'rigidmc[cluster]' ({error})",
        ) from None
    kind, rest = checked(cluster)
    logging.getLogger("distributed.client").setLevel(
        logging.CRITICAL
    )  # what goes wrong is told once, here
    texts = tuple(
        content_of(directory.path, name) for name in ("run.json", "scene.toml", "columns.nc")
    )
    flagged = dict.fromkeys(STATUSES, 0)
    with dask.config.set(SETTINGS), contextlib.ExitStack() as held:
        try:
            here = cluster
            if kind == "local":
                size = {"n_workers": int(rest), "threads_per_worker": 1, "memory_limit": 0}
                held.callback(directory.clear)  # at the end: what workers left that were lost
                here = held.enter_context(LocalCluster(**size, dashboard_address=None))
            client = held.enter_context(Client(here, timeout=10))
        except (
            OSError,
            ValueError,
            RuntimeError,
        ) as error:  # RuntimeError of a process here that ended before it began
            raise OptionError("", "--cluster", cluster, f"does not answer: {error}") from None
        report = held.enter_context(reporter(progress, directory.members_of(which), 1))
        there = client.scatter(texts, broadcast=True, hash=True)
        began, made, waiting = time.monotonic(), 0, map(int, which)
        # fixed keys: whoever asks for the same shard of the same directory once more gets the task that is on its way
        name = hashlib.sha256(os.path.abspath(directory.path).encode() + texts[0]).hexdigest()
        running = sum(client.nthreads().values()) or 1

        def submit():
            took = (time.monotonic() - began) * running / made if made else 0.0
            late = stop is not None and time.monotonic() + AHEAD * took > stop
            if late or (i := next(waiting, None)) is None:
                return []
            key = f"rigidmc-{name}-{i}"
            return [
                client.submit(
                    shard, os.path.abspath(directory.path), there, i, allow_code, accept, key=key
                )
            ]

        futures, lost = (
            as_completed([future for _ in range(AHEAD * running) for future in submit()]),
            0,
        )
        while not futures.is_empty():
            _wait(client, futures, report)
            future = next(futures)
            if (
                future.status == "error"
                and isinstance(future.exception(), KilledWorker)
                and lost < LOST
            ):
                lost += 1
                future.retry()
                futures.add(future)
                continue
            try:
                i, found, file, data = future.result()
            except (KilledWorker, CancelledError) as error:
                why = str(error).partition("\n")[0]
                raise OSError(
                    f"{cluster}: the cluster was lost ({why}); `rigidmc resume` goes on"
                ) from None
            final = os.path.join(directory.path, "shards", file)
            if data is not None:
                write_bytes(final, data, True)
            elif not _appeared(final):
                rule = f"a worker has a directory of its own at {directory.path}, and {file} is not in this one: give paths that only one has"
                raise OptionError("", "--cluster", cluster, rule)
            for word, count in found.items():
                flagged[word] += count
            future.release()
            made += 1
            report.step(len(directory.members(i)))
            report.poll()
            for more in submit():
                futures.add(more)
    return flagged


def _wait(client, futures, report):
    """Wait for a task that is done; OSError where there are no workers any more."""
    seen = time.monotonic()
    while not futures.has_ready():
        time.sleep(0.01)
        report.poll()
        if time.monotonic() - seen > QUIET:
            if client.status != "running" or not client.nthreads():
                raise OSError("the cluster has no workers any more; `rigidmc resume` goes on")
            seen = time.monotonic()


def _appeared(path):
    """Whether a file is there, or comes to be: file systems of several computers tell late."""
    end = time.monotonic() + QUIET
    while not os.path.isfile(path) and time.monotonic() < end:
        time.sleep(0.1)
    return os.path.isfile(path)


def shard(path, texts, i, allow_code=False, accept=False):
    """(i, {status: members}, the shard's name, its bytes or None where they were written to the run directory): what a worker does.

    path, texts : of the run directory, and its run.json, scene.toml and columns.nc
    """
    if content_of(path, "run.json") == texts[0]:
        found = _compute(path, i, allow_code, accept)
        return i, found, os.path.basename(RunDirectory(path).shards()[i]), None
    with tempfile.TemporaryDirectory(prefix="rigidmc-") as folder:
        os.mkdir(os.path.join(folder, "shards"))
        for name, text in zip(("run.json", "scene.toml", "columns.nc"), texts, strict=True):
            if text:
                with open(os.path.join(folder, name), "wb") as file:
                    file.write(text)
        found = _compute(folder, i, allow_code, accept)
        ((_, made),) = RunDirectory(folder).shards().items()
        return i, found, os.path.basename(made), content_of(*os.path.split(made))


def _compute(path, i, allow_code, accept):
    directory = RunDirectory(path)
    refuse_others(directory, accept)
    parts = planned(directory, allow_code)
    return compute_shards(directory, parts, program_of(*parts[:2]), [i], 1)
