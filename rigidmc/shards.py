"""Where the blocks of a run directory go: shard by shard, in the order of their members, written by a thread of its own."""

import contextlib
import queue
import threading

from rigidmc.sinks import File, buffer

WAITING = 4  # blocks on their way to the disk; more make `take` wait: memory does not grow where disks are slow


class Shards:
    """Writes blocks to the shards of a run directory; what is written depends on no order, thread or block that came first.

    directory : RunDirectory, whose lock this process holds;  plan : of the whole run
    """

    def __init__(self, directory, scene, plan):
        self.directory, self.scene, self.plan = directory, scene, plan
        self._queue: queue.Queue = queue.Queue(WAITING)
        self._open: dict = {}  # shard -> [file, its members so far, blocks that came before their turn]
        self._error: BaseException | None = None
        self._dropped = False
        self._thread = threading.Thread(target=self._work, name="rigidmc-writer", daemon=True)
        self._thread.start()

    def room(self, low, count):
        return buffer(self.scene, self.plan, count)

    def take(self, job, results):
        self._put((job, results))

    def _put(self, item):
        """Hand something to the thread that writes; what went wrong there is raised here, where else one might wait for it forever."""
        while self._error is None:
            with contextlib.suppress(queue.Full):
                return self._queue.put(item, timeout=0.2)
        raise self._error

    def finish(self):
        self._put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def discard(self):
        """Drop what is not whole; shards that are stay."""
        self._dropped = True
        while self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put_nowait(None)
            self._thread.join(0.05)
        for file, *_ in self._open.values():
            file.discard()

    def _work(self):
        try:
            while (item := self._queue.get()) is not None and not self._dropped:
                self._write(*item)
        except BaseException as error:  # told by the thread that computes
            self._error = error

    def _write(self, job, results):
        facts = self.directory.facts
        i, at = divmod(job.first - facts["first"], facts["shard"])
        members = self.directory.members(i)
        if i not in self._open:
            part = self.plan._replace(first=members.start, members=len(members), block=facts["block"])
            self._open[i] = [
                File(self.directory.temporary(i), self.scene, part, force=True, attrs={}, named=self.directory.named(i)),
                0,
                {},
            ]
        file, following, early = self._open[i]
        early[at] = job, results
        while following in early:  # in order: the bytes of a file depend on that of its chunks
            job, results = early.pop(following)
            file.take(job, results)
            following += job.size
        self._open[i][1] = following
        if following == len(members):
            file.close()
            del self._open[i]
