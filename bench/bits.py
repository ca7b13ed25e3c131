"""Equal bits everywhere: sha256 of results over vector widths and over CPUs."""

import json
import os
import subprocess
import sys
import tempfile

from bench import harness

WIDTHS = (1, 2, 4, 8, 16)
PROCESSORS = {
    "this processor": {},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
    "znver2": {"NUMBA_CPU_NAME": "znver2", "NUMBA_CPU_FEATURES": ""},
    "nehalem (no fused multiply-add)": {"NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""},
    "haswell, plain libraries": {
        "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX,-FMA,-FMA4,-AVX512F",
        "NPY_DISABLE_CPU_FEATURES": "all",
    },
}  # fmt: skip
QUICK = ("rk4", "exact", "strang")  # integrators of a quick run; strang covers the bath


def sums(widths, integrators=None, motions=None, names=None, device=None):
    """Return {case: [sha256 of its result for each width]}, for the cases in `names` if given."""
    from rigidmc.engine import program
    from rigidmc.studies.bits import cases, digest

    lanes_for, digests = program.lanes_for, {}
    try:
        for width in widths:
            program.lanes_for = (lambda dtype, width=width: width) if width else lanes_for
            for case in cases(integrators, motions):  # new scenes: one keeps its program
                if names is None or case.name in names:
                    digests.setdefault(case.name, []).append(digest(case.scene, device=device))
    finally:
        program.lanes_for = lanes_for
    return digests


def elsewhere(processor, widths, integrators=None, motions=None, names=None):
    """Compute `sums` in a process with code for another CPU and with its own cache."""
    environment = {**os.environ, **PROCESSORS[processor]}
    if environment.get("NPY_DISABLE_CPU_FEATURES") == "all":
        from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(
            name for name in __cpu_dispatch__ if __cpu_features__.get(name)
        )
    code = (
        "import json, sys, warnings; warnings.simplefilter('ignore'); from bench.bits "
        "import sums; from rigidmc.engine import compile_helper; "
        "compile_helper.threads_available = lambda: 1; "  # no second process compiles
        "print(json.dumps(sums(*json.load(sys.stdin))))"
    )
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as cache:
        done = subprocess.run(
            [sys.executable, "-c", code],
            input=json.dumps([widths, integrators, motions, names]),
            env={**environment, "RIGIDMC_CACHE_DIR": cache},
            capture_output=True,
            text=True,
        )
    if done.returncode:
        raise RuntimeError(f"{processor}: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def run(quick):
    """Return all rows of the bench."""
    some = QUICK if quick else None
    digests = {"this processor": elsewhere("this processor", WIDTHS, some)}
    for processor in list(PROCESSORS)[1:]:
        digests[processor] = elsewhere(processor, (0,), some)  # the width that suits the CPU
    rows = [
        {"kind": "bits", "processor": word, "case": case, "sums": each}
        for word, by_case in digests.items()
        for case, each in by_case.items()
    ]
    same = sum(
        len({one for by_case in digests.values() for one in by_case[case]}) == 1
        for case in digests["this processor"]
    )
    return [
        *rows,
        harness.target(
            "cases whose results are the same everywhere", len(digests["this processor"]), same, ""
        ),
    ]


def report(rows):
    """Print the results."""
    table = {}
    for row in rows:
        if row["kind"] == "bits":
            table.setdefault(row["case"], []).extend(row["sums"])
    head = ["", *(f"x{width}" for width in WIDTHS), *list(PROCESSORS)[1:]]
    harness.table(
        "sha256 of results, members side by side and processors",
        head,
        [[case, *(one[:6] for one in each)] for case, each in table.items()],
    )
    harness.report_targets(rows)
