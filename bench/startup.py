"""Seconds of wall clock from the shell: --help, the first run ever, the second."""

import os
import subprocess
import sys
import tempfile
import time

from bench import harness

ASKED = {"--help": 0.5, "first run ever of 1,000 tops": 12.0, "second run": 2.5}
RUN = ["run", "dzhanibekov", "--members", "1000", "-o"]


def command():
    """The words that start rigidmc: the script beside this Python, or its entry point where it is not installed."""
    script = os.path.join(os.path.dirname(sys.executable), "rigidmc")
    return [script] if os.path.exists(script) else [sys.executable, "-c", "from rigidmc.cli import main; main()"]


def seconds(arguments, folder, cache):
    """Wall seconds of one command in a folder, with kernels cached in `cache`; RuntimeError with its last words if it fails."""
    # the package is found from here even where it is not installed, the folder of the run being another one
    path = os.pathsep.join(filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "RIGIDMC_CACHE_DIR": cache, "PYTHONPATH": path}
    began = time.perf_counter()
    done = subprocess.run([*command(), *arguments], cwd=folder, env=environment, capture_output=True, text=True)
    took = time.perf_counter() - began
    if done.returncode != 0:
        raise RuntimeError(f"rigidmc {' '.join(arguments)} ended with {done.returncode}: {(done.stderr or done.stdout)[-2000:]}")
    return took


def run(quick):
    """All rows of the bench."""
    times: dict[str, list[float]] = {what: [] for what in ASKED}
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as folder:
        for i in range(1 if quick else 3):
            cache = os.path.join(folder, f"cache{i}")  # new and empty: every kernel is compiled
            times["first run ever of 1,000 tops"].append(seconds([*RUN, f"first{i}.nc"], folder, cache))
        for i in range(2 if quick else 5):
            times["--help"].append(seconds(["--help"], folder, cache))
            times["second run"].append(seconds([*RUN, f"second{i}.nc"], folder, cache))
    rows = [{"kind": "seconds", "name": what, "seconds": taken} for what, taken in times.items()]
    return rows + [
        harness.target(
            what,
            ASKED[what],
            harness.median(taken),
            "s",
            at_most=True,
            note=f"{len(taken)} times, {min(taken):.2f} to {max(taken):.2f} s",
        )
        for what, taken in times.items()
    ]


def report(rows):
    """Print what was measured."""
    harness.report_targets(rows)
