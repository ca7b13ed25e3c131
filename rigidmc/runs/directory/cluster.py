"""Compute a run on the workers of a dask cluster. Each shard is one task, a pure function of the
run and the shard number, with the same bits on any type of machine.

Workers that see the run directory write their shards there directly. Other workers send back each
whole shard, and this process writes it. If a worker is lost, another one computes its shard; files
already written stay.

Ten billion (10^10) members on a thousand workers, from the rows of `python -m bench runs workers`
(final state of free tops with attitude after 1,200 rk4 steps; tests/whole/test_claims.py):

    computing   38,000 s of one thread: less than a minute of a thousand workers
    files       1.22 TB; in shards of 500 MB (--shard-size 500) 2,400 files, each 16 s of one
                worker; 67 MB, the default, would be 18,000 files
    scheduler   1.1 ms of CPU a task: 3 s for 2,400 tasks, 20 s for 18,000
    messages    some kB a task: scene.toml goes once to each worker; two tasks wait for each thread
    memory      of a worker: a few blocks and up to four shards
    status      6 ms for 1,000 shards, from their names alone; rm.open 0.27 s

A job array needs no scheduler: `rigidmc run SCENE -o part$I/ --shards A:B` and `rigidmc merge`,
which reads and writes every byte once more.
"""

import contextlib
import hashlib
import itertools
import logging
import math
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, RigidmcError
from rigidmc.files.outputs import content_of, write_bytes
from rigidmc.files.stores import Store, absolute, is_url
from rigidmc.processes.progress import Progress, reporter
from rigidmc.runs.directory.folder import FILES, RunDirectory
from rigidmc.runs.directory.load import block_of_run, check_versions, load_run
from rigidmc.runs.directory.shards import Numbers, compute_shards
from rigidmc.runs.settled import Machine

if TYPE_CHECKING:
    from distributed import Client, Future

# tasks waiting for each thread of the workers: the scheduler holds few, however many shards exist
AHEAD = 2
RECOUNT = 1.0  # seconds between two counts of the threads, because workers come and go
LOST = 20  # how often a shard is restarted because its worker was lost
QUIET = 60.0  # seconds without any worker, or until another computer's file is visible here

SETTINGS = {  # of a cluster on this machine
    # by default dask gives up at the third loss, as if the task were the cause
    "distributed.scheduler.allowed-failures": LOST,
    # samples the stack 100 times a second and holds the lock that Python threads wait for
    "distributed.worker.profile.enabled": False,
    # With dask's 2^16, the memory of each block would be released and requested repeatedly. Setting
    # one of the two stops the other from adapting.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 2**30,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 2**25,
}


class Resume(NamedTuple):
    """How a run goes on.

    only : a range of shards, None for all that are missing
    stop : time limit on the clock of time.monotonic(), None for none
    cluster : "tcp://host:8786" of a scheduler, or "local:4" for four processes of one thread each
        on this machine; these need an importable main module (`if __name__ == "__main__":`)
    accept : continue even if versions differ from those at the start
    allow_code, device : as in `Scene.load` and `simulate`
    """

    only: range | None = None
    stop: float | None = None
    cluster: str | None = None
    accept: bool = False
    allow_code: bool = False
    device: str | None = None


Work = Callable[[RunDirectory, int, Resume], dict[str, int]]  # returns {status: members}


class ComputedShard(NamedTuple):
    """A shard that a worker has computed.

    i : its number;  flagged : {status: members};  name : of its file
    data : its bytes; None if the worker wrote it to the run directory
    """

    i: int
    flagged: dict[str, int]
    name: str
    data: bytes | None


def parse_cluster(cluster: str) -> tuple[str, str]:
    """Parse a cluster as ("local", N) or (protocol, address); OptionError for any other text."""
    kind, _, rest = cluster.partition(":")
    local = kind == "local" and rest.isascii() and rest.isdigit() and 0 < int(rest) <= 1024
    if not local and not (kind in ("tcp", "tls", "ucx") and rest.startswith("//")):
        rule = "expected tcp://host:port of a scheduler, or local:N for N processes here"
        raise OptionError(rule, at="cluster", value=cluster)
    return kind, rest


def compute_on(
    cluster: str,
    directory: RunDirectory,
    numbers: Numbers,
    how: Resume,
    progress: Progress = False,
    work: Work | None = None,
) -> dict[str, int]:
    """Compute some shards of a run whose lock this process holds; return {status: members}. No
    shard starts that would end after the time limit.

    work : function that computes a shard of a directory, by default its members

    Raises OptionError if dask or the cluster is missing, OSError if the cluster is lost, and any
    error of a worker.
    """
    texts = tuple(content_of(directory.folder, name) for name in FILES)
    flagged = dict.fromkeys(STATUSES, 0)
    with (
        _connected(cluster, directory) as client,
        reporter(progress, directory.members_of(numbers), 1) as report,
    ):
        arguments = {"texts": texts, "how": how, "work": work}
        tasks = _Tasks(client, cluster, directory, numbers, arguments)
        for computed in tasks.results(report.poll):
            _store(computed, cluster, directory)
            for word, count in computed.flagged.items():
                flagged[word] += count
            report.step(len(directory.places(computed.i)))
            report.poll()
    return flagged


@contextlib.contextmanager
def _connected(cluster: str, directory: RunDirectory) -> "Iterator[Client]":
    """Connect to a dask cluster; one on this machine starts here and stops at the end."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        rule = f"needs dask.distributed: pip install 'rigidmc[cluster]' ({error})"
        raise OptionError(rule, at="cluster", value=cluster) from None
    kind, rest = parse_cluster(cluster)
    # the log would repeat the errors that are raised here
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with dask.config.set(SETTINGS), contextlib.ExitStack() as stack:
        try:
            address: Any = cluster
            if kind == "local":
                size = {"n_workers": int(rest), "threads_per_worker": 1, "memory_limit": 0}
                stack.callback(directory.clear)  # finally remove files of lost workers
                address = stack.enter_context(LocalCluster(**size, dashboard_address=None))
            client = stack.enter_context(Client(address, timeout=10))
        except (OSError, ValueError, RuntimeError) as error:
            # RuntimeError: a process on this machine ended before it started
            raise OptionError(f"does not answer: {error}", at="cluster", value=cluster) from None
        yield client


class _Tasks:
    """The shards of a run as tasks of a cluster, submitted a few at a time.

    arguments : of `shard`
    """

    def __init__(
        self,
        client: "Client",
        cluster: str,
        directory: RunDirectory,
        numbers: Numbers,
        arguments: dict[str, Any],
    ) -> None:
        self._client, self._cluster, self._stop = client, cluster, arguments["how"].stop
        path, texts = absolute(directory.path), arguments["texts"]
        # fixed keys: a shard of this directory that is requested twice is one task
        self._name = f"rigidmc-{hashlib.sha256(path.encode() + texts[0]).hexdigest()}"
        # A task, not scattered data: the scheduler gives it to workers that join later, and repeats
        # it if every worker that holds the texts is lost.
        files = client.submit(_texts, texts, key=f"{self._name}-files")
        self._given: dict[str, Any] = {**arguments, "path": path, "texts": files}
        self._numbers, self._waiting = map(int, numbers), 0
        self._began, self._done = time.monotonic(), 0
        self._threads, self._counted = 1, -math.inf

    def _submit(self) -> "list[Future[Any]]":
        """Submit shards until AHEAD wait for each thread; return [their tasks], [] if none is left
        or none may start."""
        now = time.monotonic()
        if now > self._counted + RECOUNT:
            # adaptive clusters grow only while tasks wait
            self._threads = sum(self._client.nthreads().values()) or 1
            self._counted = now
        took = (now - self._began) * self._threads / self._done if self._done else 0.0
        if self._stop is not None and now + AHEAD * took > self._stop:
            return []
        more = list(itertools.islice(self._numbers, max(0, AHEAD * self._threads - self._waiting)))
        self._waiting += len(more)
        keys = [f"{self._name}-{i}" for i in more]
        return self._client.map(shard, more, key=keys, **self._given) if more else []

    def results(self, poll: Callable[[], None]) -> Iterator[ComputedShard]:
        """Yield the shards as they finish. A shard whose worker is lost is restarted; OSError if
        the whole cluster is lost.

        poll : called repeatedly while waiting
        """
        from distributed import CancelledError, KilledWorker, as_completed
        from distributed.comm.core import CommClosedError

        futures, lost = as_completed(self._submit()), Counter[str]()
        try:
            while not futures.is_empty():
                _wait(self._client, futures, poll)
                good = list["Future[Any]"]()
                for future in futures.next_batch(block=False):
                    killed = future.status == "error" and isinstance(
                        future.exception(), KilledWorker
                    )
                    if killed and lost[future.key] < LOST:
                        lost[future.key] += 1
                        future.retry()
                        futures.add(future)
                    else:
                        good.append(future)
                # one message for a batch: a third of the CPU time of one for each
                yield from self._client.gather(good)
                self._done += len(good)
                self._waiting -= len(good)
                futures.update(self._submit())
        except (KilledWorker, CancelledError, CommClosedError) as error:
            why = str(error).partition("\n")[0]
            rule = f"the cluster was lost ({why}); `rigidmc resume` continues the run"
            raise OSError(f"{self._cluster}: {rule}") from None


def _texts(texts: tuple[bytes, ...]) -> tuple[bytes, ...]:
    """Return the contents of FILES, on a worker."""
    return texts


def _wait(client: "Client", futures: Any, poll: Callable[[], None]) -> None:
    """Wait for a finished task; OSError if no workers are left."""
    seen = time.monotonic()
    while not futures.has_ready():
        time.sleep(0.01)
        poll()
        if time.monotonic() - seen > QUIET:
            if client.status != "running" or not client.nthreads():
                raise OSError("the cluster has no workers left; `rigidmc resume` continues the run")
            seen = time.monotonic()


def _store(computed: ComputedShard, cluster: str, directory: RunDirectory) -> None:
    """Write a shard that a worker sent; OptionError if a worker wrote it to another directory."""
    if computed.data is not None:
        final = os.path.join(directory.folder, "shards", computed.name)
        write_bytes(final, computed.data, True)
        directory.publish(final)
    elif directory.store is None and not _appeared(final := directory.final(computed.name)):
        rule = (
            f"a worker has its own directory at {directory.path}, and {computed.name} is not in"
            " this one: give a path that is the same directory on all machines, or that exists only"
            " here"
        )
        raise OptionError(rule, at="cluster", value=cluster)


def _appeared(path: str) -> bool:
    """Return whether a file exists or appears soon; shared file systems show new files late."""
    end = time.monotonic() + QUIET
    while not os.path.isfile(path) and time.monotonic() < end:
        time.sleep(0.1)
    return os.path.isfile(path)


def shard(
    i: int, path: str, texts: tuple[bytes, ...], how: Resume, work: Work | None = None
) -> ComputedShard:
    """Compute shard i of a run, on a worker.

    path, texts : of the run directory, and the contents of its FILES;  work : as in `compute_on`
    """
    compute = work or _compute
    if _reaches(path, texts[0]):
        directory = RunDirectory(path)
        flagged = compute(directory, i, how)
        return ComputedShard(i, flagged, os.path.basename(directory.written), None)
    with tempfile.TemporaryDirectory(prefix="rigidmc-") as folder:
        os.mkdir(os.path.join(folder, "shards"))
        for name, text in zip(FILES, texts, strict=True):
            if text:
                with open(os.path.join(folder, name), "wb") as file:
                    file.write(text)
        directory = RunDirectory(folder)
        flagged = compute(directory, i, how)
        written = os.path.split(directory.written)
        return ComputedShard(i, flagged, written[1], content_of(*written))


def _reaches(path: str, text: bytes) -> bool:
    """Return whether a worker reads this run.json in a folder or store."""
    if not is_url(path):
        return content_of(path, "run.json") == text
    with contextlib.suppress(RigidmcError):  # no package or no permission, or no network
        return Store(path).get("run.json") == text
    return False


def _compute(directory: RunDirectory, i: int, how: Resume) -> dict[str, int]:
    """Compute one shard of a run directory; return {status: members}."""
    check_versions(directory, how.accept)
    run, device = load_run(directory, how.allow_code), resolve_device(how.device)
    block = block_of_run(directory, run, device)
    return compute_shards(directory, run, [i], Machine(1, device, block))
