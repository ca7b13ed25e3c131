"""Many workers of a cluster on one machine: a scheduler, a client that resumes a run, and one
process with all workers as objects in one event loop. Shards are stubs of a few bytes, written as
shards are: temporary file, fsync, rename.

The clock of one machine says little about a thousand, so rows have the CPU time of a task in each
process: scheduler and client are one process each in a real cluster too, and bound its tasks a
second. The CPU time of the workers is spread over as many machines as there are.
"""

import asyncio
import hashlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
import threading
import time

import psutil

from bench import harness

SETTINGS = {  # the simulation shares few cores, so nobody answers as fast as alone
    "distributed.scheduler.allowed-failures": 20,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.limit": "1h",
    # Each worker measures the delay of its loop 50 times a second, and counts the open files of its
    # process twice: a thousand in one process do nothing else.
    "distributed.admin.tick.interval": "1h",
    "distributed.admin.tick.cycle": "1h",
    "distributed.admin.system-monitor.interval": "1h",
    "distributed.comm.timeouts.connect": "60s",
    "distributed.comm.timeouts.tcp": "300s",
    "distributed.scheduler.worker-ttl": None,
    "logging.distributed": "critical",
}
ASKED = 500.0  # tasks a second: a thousand workers with shards of 2 s


def stub_name(i):
    """Return the name of the stub of shard i."""
    return f"{i:08d}-0-{hashlib.sha256(b'%d' % i).hexdigest()[:16]}.nc"


def stub(directory, i, how):
    """Write a shard of a few bytes."""
    from rigidmc.files.outputs import write_bytes

    name = directory.final(stub_name(i))
    write_bytes(name, b"%d" % i, True)
    directory.publish(name)
    return {"ok": 1}


def slow(directory, *arguments):
    """Write such a shard after three seconds."""
    time.sleep(3.0)
    return stub(directory, *arguments)


async def schedule(port):
    """Be the scheduler."""
    from distributed import Scheduler

    scheduler = await Scheduler(host="127.0.0.1", port=int(port), dashboard_address=":0")
    await scheduler.finished()


async def serve(port, count, way):
    """Be `count` workers of one thread each.

    way : "lose" ends one every second without a word and starts another; "adapt" starts with none
        and asks the scheduler every second how many it wants
    """
    from distributed import Worker
    from distributed.core import rpc

    address, count = f"tcp://127.0.0.1:{port}", int(count)
    options = {"nthreads": 1, "memory_limit": 0, "dashboard": False, "host": "127.0.0.1"}

    async def start(many):
        return await asyncio.gather(*(Worker(address, **options) for _ in range(many)))

    workers = await start(0 if way == "adapt" else count)
    print("up", flush=True)
    for _ in itertools.count():
        await asyncio.sleep(1.0)
        if way == "lose":
            workers.pop(0).batched_stream.comm.abort()
            workers += await start(1)
        if way == "adapt":
            async with rpc(address) as scheduler:
                want = await scheduler.adaptive_target()
            workers += await start(max(0, min(want, count) - len(workers)))


def resume(port, path, work, pids):
    """Be the client: resume the run in a directory by stubs; print a row as JSON."""
    from rigidmc.runs.directory.cluster import Resume, compute_on
    from rigidmc.runs.directory.folder import RunDirectory, status
    from rigidmc.runs.directory.resume import keep_journal

    processes = {"client": psutil.Process()}
    for word in pids.split(","):
        name, _, pid = word.partition("=")
        processes[name] = psutil.Process(int(pid))
    directory = RunDirectory(path)
    numbers = directory.missing()

    def used():
        return {
            name: (sum(one.cpu_times()[:2]), one.memory_info().rss)
            for name, one in processes.items()
        }

    samples, begin, began = [], used(), time.perf_counter()

    def watch():
        while True:
            time.sleep(5.0)
            busy = time.thread_time()
            done = status(path)["done"]
            took = time.perf_counter() - began
            memory = {name: rss for name, (_, rss) in used().items()}
            samples.append([took, done, time.thread_time() - busy, memory])

    threading.Thread(target=watch, daemon=True).start()
    row = {"shards": len(numbers), "error": ""}
    try:
        with directory.locked():
            address = f"tcp://127.0.0.1:{port}"
            keep_journal(
                directory, numbers,
                lambda: compute_on(address, directory, numbers, Resume(), work=globals()[work]),
            )  # fmt: skip
    except OSError as error:
        row["error"] = str(error)
    row["seconds"], end = time.perf_counter() - began, used()
    row["done"] = int(len(numbers) - directory.missing().size)
    for name, (busy, rss) in end.items():
        row[name] = {
            "ms": 1e3 * (busy - begin[name][0]) / max(1, row["done"]),
            "megabytes": [begin[name][1] / 1e6, rss / 1e6],
        }
    watching = sum(sample[2] for sample in samples)  # its own part is not the client's
    row["client"]["ms"] -= 1e3 * watching / max(1, row["done"])
    busy = time.process_time()
    status(path)
    row["status"] = time.process_time() - busy
    for name in ("journal.jsonl", "run.json"):
        row[name] = os.path.getsize(os.path.join(path, name))
    row["samples"] = samples[:: max(1, len(samples) // 10)]
    print(json.dumps(row))


def start(*words, **options):
    """Start this module as a process with a role."""
    return subprocess.Popen([sys.executable, "-m", "bench.workers", *map(str, words)], **options)


def make(path, shards):
    """Create the directory of a run with so many shards, by the facts of a small one."""
    import rigidmc as rm
    from rigidmc.runs.directory.create import create
    from rigidmc.runs.directory.facts import facts_text

    scene = rm.Scene.load("dzhanibekov").with_run(members=32, t_end=0.1, every=0.1)
    facts = create(scene, path, 1.0).facts
    with open(os.path.join(path, "run.json"), "w") as file:
        file.write(facts_text({**facts, "members": shards * facts["shard"]}))


def simulate(folder, kind, shards, workers, way="", work="stub", restart=0):
    """Return a row: a run of stubs on a simulated cluster.

    restart : shards after which the scheduler is killed; another starts at the same address, then
        the run is resumed, by new workers
    """
    port = 18800 + os.getpid() % 1000
    path = os.path.join(folder, f"{kind}-{shards}-{workers}")
    make(path, shards)
    row = {"kind": kind, "count": workers}
    first = once(port, path, workers, way, work, restart)
    if restart:
        row["before"] = first
        first = once(port, path, workers, way, work, 0)
    row |= first
    names = os.listdir(os.path.join(path, "shards"))
    assert len(names) == shards and row["done"] == row["shards"], row
    return row


def once(port, path, workers, way, work, restart):
    """Return what the client says about one run on one cluster."""
    pipes = {"stdout": subprocess.PIPE, "text": True}
    processes = [start("schedule", port)]
    time.sleep(4.0)
    try:
        processes.append(start("serve", port, workers, way, **pipes))
        processes[1].stdout.readline()
        pids = ",".join(
            f"{name}={process.pid}"
            for name, process in zip(("scheduler", "workers"), processes, strict=True)
        )
        if restart:  # its process ends before the client
            pids = f"workers={processes[1].pid}"
        client = start("resume", port, path, work, pids, **pipes)
        while restart and client.poll() is None:
            time.sleep(0.2)
            if len(os.listdir(os.path.join(path, "shards"))) > restart:
                processes[0].kill()
                processes[0].wait()
                processes[0] = start("schedule", port)
                restart = 0
        return json.loads(client.communicate()[0])
    finally:
        for process in processes:
            process.kill()
            process.wait()


def targets(rows):
    """Return the rows of the closing table."""
    most = max((row for row in rows if row["kind"] == "many"), key=lambda row: row["shards"])
    slowest = max(most[name]["ms"] for name in ("scheduler", "client"))
    of = f"{most['shards']:,} shards"
    what = f"tasks a second that the scheduler can give, of {of}"
    found = [harness.target(what, ASKED, 1e3 / slowest)]
    for name in ("scheduler", "client"):
        what = f"memory of the {name} after {of}"
        megabytes = most[name]["megabytes"][1]
        found.append(harness.at_most(what, 1000.0, megabytes, "MB"))
    what = f"status of {of}"
    return [*found, harness.at_most(what, 2.0, most["status"], "s")]


def run(quick):
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        few = 200 if quick else 10_000
        rows = [simulate(folder, "many", few, 10 if quick else 100)]
        if not quick:
            rows.append(simulate(folder, "wide", 3000, 1000))
            rows.append(simulate(folder, "many", 100_000, 100))
        few = 100 if quick else 3000
        rows.append(simulate(folder, "lost", few, 10 if quick else 100, "lose"))
        rows.append(simulate(folder, "adaptive", 4 if quick else 400, 50, "adapt", "slow"))
        rows.append(simulate(folder, "restart", few, 10 if quick else 100, restart=few // 3))
    return [*rows, *targets(rows)]


def report(rows):
    harness.show(
        "stubs on a simulated cluster; ms of CPU a task",
        [row for row in rows if row["kind"] != "target"],
        " {kind} | shards {shards:,} | workers {count} | s {seconds:.0f}"
        " | ms scheduler {scheduler[ms]:.2f} | client {client[ms]:.2f} | workers {workers[ms]:.2f}"
        " | MB scheduler {scheduler[megabytes][0]:.0f} to {scheduler[megabytes][1]:.0f}"
        " | client {client[megabytes][0]:.0f} to {client[megabytes][1]:.0f}"
        " | s status {status:.2f} | {lost}",
        lost=lambda row: row.get("before", row)["error"].partition(": ")[2][:60],
    )
    harness.report_targets(rows)


def main():
    """Be a process of the simulation."""
    import dask

    dask.config.set(SETTINGS)
    role, *words = sys.argv[1:]
    if role == "resume":
        resume(*words)
    else:
        asyncio.run({"schedule": schedule, "serve": serve}[role](*words))


if __name__ == "__main__":
    main()
