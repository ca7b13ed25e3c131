"""Hard cases in worker processes: a case that crashes its process does not stop other cases."""

import contextlib
import json
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from rigidmc.errors import RigidmcError
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.processes.helpers import start_helper
from rigidmc.processes.progress import reporter
from rigidmc.studies.stress import catalogue
from rigidmc.studies.stress.case import HardCase

Outcome = tuple[float, float, str]  # error, seconds, reason; see `run_case`
Worker = subprocess.Popen[str]


def carry_out(
    tasks: dict[str, list[int]],
    share: float,
    processes: int,
    progress: bool | Callable[[int, int], object],
) -> dict[tuple[int, str], Outcome]:
    """Run cases, given for each integrator as indices in the catalogue; return {(case, integrator):
    outcome}.

    Each process runs all cases of an integrator, so that no kernel is compiled twice.
    """
    waiting = sorted(tasks, key=lambda name: -INTEGRATORS[name].evaluations * bool(tasks[name]))
    outcomes: dict[tuple[int, str], Outcome] = {}
    lock, stopped, workers = threading.Lock(), threading.Event(), list[Worker]()

    def work(report: Any) -> None:
        worker: Worker | None = None
        while True:
            with lock:
                if not waiting or stopped.is_set():
                    break
                name = waiting.pop(0)
            for i in tasks[name]:
                if stopped.is_set():
                    break
                if worker is None:
                    worker = _started()
                    workers.append(worker)
                worker, outcomes[i, name] = _asked(worker, i, name, share)
                report.step(1)
        if worker:
            _ended(worker)

    with reporter(progress, sum(map(len, tasks.values())), 1) as report:
        threads = [
            threading.Thread(target=work, args=(report,), daemon=True)
            for _ in range(min(processes, len(tasks)))
        ]
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                while thread.is_alive():
                    thread.join(0.2)
                    report.poll()
        finally:  # after Ctrl-C, neither threads nor workers continue
            stopped.set()
            for worker in workers:
                worker.kill()
    return outcomes


def _asked(
    worker: Worker, case: int, integrator: str, share: float
) -> tuple[Worker | None, Outcome]:
    """Return (worker, outcome); the worker is None if the case killed it, and the next case then
    starts a new one."""
    began = time.perf_counter()
    assert worker.stdin and worker.stdout
    try:
        worker.stdin.write(json.dumps([case, integrator, share]) + "\n")
        worker.stdin.flush()
        error, seconds, reason = json.loads(worker.stdout.readline())
        return worker, (error, seconds, reason)
    except (ValueError, OSError):
        worker.kill()
        code = _ended(worker)
        lost = time.perf_counter() - began
        return None, (math.nan, lost, f"the process ended with code {code}")


def _started() -> Worker:
    return start_helper(__name__)


def _ended(worker: Worker) -> int:
    """Close the input of a worker and wait for its exit code."""
    assert worker.stdin and worker.stdout
    with contextlib.suppress(OSError):
        worker.stdin.close()
    worker.stdout.close()
    return worker.wait()


def main() -> None:
    """Run a worker: read lines [case, integrator, share], write lines [error, seconds, reason]."""
    cases = catalogue()
    for line in sys.stdin:
        i, name, share = json.loads(line)
        print(json.dumps(run_case(cases[i], name, share)), flush=True)


def run_case(case: HardCase, integrator: str, share: float = 1.0) -> Outcome:
    """Run one case with one integrator; return (error, seconds, reason).

    If the case raises, error is nan and reason has the message. If the closed form does not cover
    the case, error is nan and reason is empty.
    """
    began, reason = time.perf_counter(), ""
    try:
        error = float(case.comparison.error(integrator, share))
    except Exception as raised:  # reported as a crash; the other cases continue
        uncovered = (
            integrator == "closed"
            and isinstance(raised, RigidmcError)
            and "closed form" in str(raised)
        )
        error, reason = math.nan, "" if uncovered else f"{type(raised).__name__}: {raised}"
    return error, time.perf_counter() - began, reason
