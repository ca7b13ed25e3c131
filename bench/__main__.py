"""python -m bench [names...] [--output DIR] [--quick]: run benches, print tables, write rows."""

import argparse
import importlib
import os
import sys
import tempfile
import time

# modules with run(quick) -> rows and report(rows); imported on demand, after the environment below
# is set
BENCHES = (
    "throughput", "startup", "calls", "accuracy", "bits", "memory", "checks", "effects", "sets",
    "watching", "axes", "bath", "rare", "exact", "tolerance", "maps", "runs", "workers", "reading",
    "billion", "orders", "derivatives", "peers", "loop", "coming_from", "coverage",
    "fits", "gpu", "device",
)  # fmt: skip
HERE = os.path.dirname(os.path.abspath(__file__))


def main():
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Benchmarks of rigidmc; by default all of them."
    )
    parser.add_argument("names", nargs="*", metavar="name", help=f"any of {', '.join(BENCHES)}")
    parser.add_argument(
        "--output",
        default=os.path.join(HERE, "results"),
        metavar="DIR",
        help="folder for NAME.json",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="fewer rounds and smaller runs, as a check that it works; not for figures",
    )
    parser.add_argument(
        "--python",
        default=sys.executable,
        metavar="PATH",
        help="an interpreter that has the other programs of coming_from and fits",
    )
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in BENCHES]:
        parser.error(f"no bench {', '.join(unknown)}; available: {', '.join(BENCHES)}")
    # sleep, do not spin: idle OpenMP threads of one candidate would occupy the cores of the next
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    os.environ.setdefault("OMP_NUM_THREADS", str(_cores()))
    os.environ.setdefault("NUMBA_NUM_THREADS", str(_cores()))
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as cache:
        os.environ["RIGIDMC_CACHE_DIR"] = cache  # empty, so that a first call compiles
        from bench import harness

        print(harness.card_text(harness.machine_card()))
        for name in options.names or BENCHES:
            began = time.perf_counter()
            bench = importlib.import_module(f"bench.{name}")
            print(f"\n== {name}")
            more = {"python": options.python} if name in ("coming_from", "fits") else {}
            rows = bench.run(options.quick, **more)
            if not rows:  # for a device that is missing here: keep the rows of another machine
                print(f"{name}: nothing was measured")
                continue
            bench.report(rows)
            path = harness.write(options.output, name, rows)
            print(f"{name}: {time.perf_counter() - began:.0f} s, rows in {os.path.relpath(path)}")


def _cores():
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


if __name__ == "__main__":
    main()
