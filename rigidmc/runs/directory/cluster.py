"""Compute a run on the workers of a dask cluster. Each shard is one task, a pure function of the
run and the shard number, with the same bits on any type of machine.

Workers that see the run directory write their shards there directly. Other workers send back each
whole shard, and this process writes it. If a worker is lost, another one computes its shard; files
already written stay.

Ten billion (10^10) members on a thousand workers, from the rows of `python -m bench runs` (final
state of free tops with attitude after 1,200 rk4 steps; tests/whole/test_claims.py):

    computing   38,000 s of one thread: less than a minute of a thousand workers
    files       1.22 TB; in shards of 500 MB (--shard-size 500) 2,400 files, each 16 s of one
                worker; 67 MB, the default, would be 18,000 files
    scheduler   4.2 ms of CPU a task: 10 s for 2,400 tasks, besides that minute; 77 s for 18,000,
                which is longer than the work
    messages    some kB a task: scene.toml goes once to each worker; two tasks wait for each thread
    memory      of a worker: a few blocks and up to four shards
    status      6 ms for 1,000 shards, from their names alone; rm.open 0.27 s

A job array needs no scheduler: `rigidmc run SCENE -o part$I/ --shards A:B` and `rigidmc merge`,
which reads and writes every byte once more.
"""

import contextlib
import hashlib
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from rigidmc.engine.cuda.devices import resolve_device
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError
from rigidmc.files.outputs import content_of, write_bytes
from rigidmc.progress import Progress, reporter
from rigidmc.results.run_directory import CHOSEN, RunDirectory
from rigidmc.runs.directory.load import block_of_run, check_versions, load_run
from rigidmc.runs.directory.shards import Numbers, compute_shards

if TYPE_CHECKING:
    from distributed import Client, Future

# tasks waiting for each thread of the workers: the scheduler holds few, however many shards exist
AHEAD = 2
LOST = 20  # how often a shard is restarted because its worker was lost
QUIET = 60.0  # seconds without any worker, or until another computer's file is visible here
FILES = ("run.json", "scene.toml", "columns.nc", CHOSEN)  # files of a directory that workers need

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


# (path, i, allow_code, accept, device) -> {status: members}
Work = Callable[[str, int, bool, bool, str | None], dict[str, int]]


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
    progress: Progress = False,
    stop: float | None = None,
    allow_code: bool = False,
    accept: bool = False,
    work: Work | None = None,
    device: str | None = None,
) -> dict[str, int]:
    """Compute some shards of a run whose lock this process holds; return {status: members}.

    cluster : "tcp://host:8786" of a scheduler, or "local:4" for four processes of one thread each
        on this machine; these need an importable main module (`if __name__ == "__main__":`)
    stop : time limit on the clock of time.monotonic(); no shard starts that would end later
    work : function that computes a shard in a folder, by default its members
    device : where workers move members, as in `simulate`

    Raises OptionError if dask or the cluster is missing, OSError if the cluster is lost, and any
    error of a worker.
    """
    texts = tuple(content_of(directory.path, name) for name in FILES)
    flagged = dict.fromkeys(STATUSES, 0)
    with (
        _connected(cluster, directory) as client,
        reporter(progress, directory.members_of(numbers), 1) as report,
    ):
        options = allow_code, accept, work, device
        tasks = _Tasks(client, cluster, directory, texts, numbers, stop, options)
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

    texts : the contents of FILES;  options : allow_code, accept, work and device of `shard`
    """

    def __init__(
        self,
        client: "Client",
        cluster: str,
        directory: RunDirectory,
        texts: tuple[bytes, ...],
        numbers: Numbers,
        stop: float | None,
        options: tuple[bool, bool, Work | None, str | None],
    ) -> None:
        self._client, self._cluster, self._stop, self._options = client, cluster, stop, options
        self._path = os.path.abspath(directory.path)
        self._texts = client.scatter(texts, broadcast=True, hash=True)
        # fixed keys: a shard of this directory that is requested twice is one task
        self._name = hashlib.sha256(self._path.encode() + texts[0]).hexdigest()
        self._numbers = map(int, numbers)
        self._began, self._done = time.monotonic(), 0
        self._threads = sum(client.nthreads().values()) or 1

    def _submit(self) -> "list[Future[Any]]":
        """Submit the next shard and return [its task]; [] if none is left or none may start."""
        took = (time.monotonic() - self._began) * self._threads / self._done if self._done else 0.0
        late = self._stop is not None and time.monotonic() + AHEAD * took > self._stop
        if late or (i := next(self._numbers, None)) is None:
            return []
        key = f"rigidmc-{self._name}-{i}"
        given = (self._path, self._texts, i, *self._options)
        return [self._client.submit(shard, *given, key=key)]

    def results(self, poll: Callable[[], None]) -> Iterator[ComputedShard]:
        """Yield the shards as they finish. A shard whose worker is lost is restarted; OSError if
        the whole cluster is lost.

        poll : called repeatedly while waiting
        """
        from distributed import CancelledError, KilledWorker, as_completed

        first = [future for _ in range(AHEAD * self._threads) for future in self._submit()]
        futures, lost = as_completed(first), 0
        while not futures.is_empty():
            _wait(self._client, futures, poll)
            future = next(futures)
            killed = future.status == "error" and isinstance(future.exception(), KilledWorker)
            if killed and lost < LOST:
                lost += 1
                future.retry()
                futures.add(future)
                continue
            try:
                computed = future.result()
            except (KilledWorker, CancelledError) as error:
                why = str(error).partition("\n")[0]
                rule = f"the cluster was lost ({why}); `rigidmc resume` continues the run"
                raise OSError(f"{self._cluster}: {rule}") from None
            yield computed
            future.release()
            self._done += 1
            for more in self._submit():
                futures.add(more)


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
    final = os.path.join(directory.path, "shards", computed.name)
    if computed.data is not None:
        write_bytes(final, computed.data, True)
    elif not _appeared(final):
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
    path: str,
    texts: tuple[bytes, ...],
    i: int,
    allow_code: bool = False,
    accept: bool = False,
    work: Work | None = None,
    device: str | None = None,
) -> ComputedShard:
    """Compute shard i of a run, on a worker.

    path, texts : of the run directory, and the contents of its FILES;  work : as in `compute_on`
    device : where members move, as in `simulate`
    """
    compute = work or _compute
    if content_of(path, "run.json") == texts[0]:
        flagged = compute(path, i, allow_code, accept, device)
        return ComputedShard(i, flagged, os.path.basename(RunDirectory(path).shards()[i]), None)
    with tempfile.TemporaryDirectory(prefix="rigidmc-") as folder:
        os.mkdir(os.path.join(folder, "shards"))
        for name, text in zip(FILES, texts, strict=True):
            if text:
                with open(os.path.join(folder, name), "wb") as file:
                    file.write(text)
        flagged = compute(folder, i, allow_code, accept, device)
        (written,) = RunDirectory(folder).shards().values()
        return ComputedShard(
            i, flagged, os.path.basename(written), content_of(*os.path.split(written))
        )


def _compute(
    path: str, i: int, allow_code: bool, accept: bool, device: str | None
) -> dict[str, int]:
    """Compute one shard of a run directory; return {status: members}."""
    directory = RunDirectory(path)
    check_versions(directory, accept)
    run, device = load_run(directory, allow_code), resolve_device(device)
    block = block_of_run(directory, run, device)
    return compute_shards(directory, run, [i], 1, block, device)
