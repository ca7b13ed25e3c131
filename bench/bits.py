"""Equal bits everywhere: sha256 of results over vector widths, CPUs and architectures.

Runs that also differentiate (`wrt`) must give the same values, everywhere. A run on one
architecture keeps the rows of the others. On x86-64, `bench/aarch64.sh FOLDER -m
bench bits` makes the rows of ARM. `python -m bench.bits CASE` adds or replaces the row of one case
on this processor, with members one at a time and at its own width: all cases take hours on an
emulated CPU.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile

from bench import harness

WIDTHS = (1, 2, 4, 8, 16)
OWN = (0,)  # the width that suits the CPU
WITH = "with derivatives"  # of the processor of a row
FILE = os.path.join(harness.HERE, "results", "bits.json")
ARCHITECTURE = harness.architecture()


def _code_for(cpu):
    """Return the settings that make Numba compile for a CPU."""
    return {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""}


PLAIN = {"NPY_DISABLE_CPU_FEATURES": "all"}  # NumPy without its code for single CPUs
OLD = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX,-FMA,-FMA4,-AVX512F"}
PROCESSORS = {
    "x86_64": {
        "this processor": {},
        "haswell": _code_for("haswell"),
        "znver2": _code_for("znver2"),
        "nehalem (no fused multiply-add)": _code_for("nehalem"),
        "haswell, plain libraries": {**_code_for("haswell"), **OLD, **PLAIN},
    },
    "aarch64": {
        "this processor": {},
        "neoverse-v1 (SVE)": _code_for("neoverse-v1"),
        "apple-m1": _code_for("apple-m1"),
        "cortex-a53, plain libraries": {**_code_for("cortex-a53"), **PLAIN},
    },
}.get(ARCHITECTURE, {"this processor": {}})
QUICK = ("rk4", "exact", "strang")  # integrators of a quick run; strang covers the bath


def sums(widths, integrators=None, motions=None, names=None, device=None, derivatives=False):
    """Return {case: [sha256 of its values for each width]}, for the cases in `names` if given.

    derivatives : whether the runs also differentiate
    """
    from rigidmc.engine import program
    from rigidmc.studies.bits import cases, digest, with_derivatives

    lanes_for, digests = program.lanes_for, {}
    try:
        for width in widths:
            members = width * (1 + derivatives)  # a program with derivatives takes half as many
            program.lanes_for = (lambda dtype, members=members: members) if width else lanes_for
            for case in cases(integrators, motions):  # new scenes: one keeps its program
                if names is None or case.name in names:
                    scene = with_derivatives(case) if derivatives else case.scene
                    digests.setdefault(case.name, []).append(digest(scene, device=device))
    finally:
        program.lanes_for = lanes_for
    return digests


def environment(processor):
    """Return the environment of a process with code for another CPU."""
    found = {**os.environ, **PROCESSORS[processor]}
    if found.get("NPY_DISABLE_CPU_FEATURES") == "all":
        from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

        found["NPY_DISABLE_CPU_FEATURES"] = " ".join(
            name for name in __cpu_dispatch__ if __cpu_features__.get(name)
        )
    return found


def elsewhere(
    processor, widths, integrators=None, motions=None, names=None, device=None, derivatives=False
):
    """Compute `sums` in a process with code for another CPU and with its own cache.

    Raises NotImplementedError if this CPU lacks an instruction of the other.
    """
    code = (
        "import json, sys, warnings; warnings.simplefilter('ignore'); from bench.bits "
        "import sums; from rigidmc.engine import compile_helper; "
        "compile_helper.threads_available = lambda: 1; "  # no second process compiles
        "print(json.dumps(sums(*json.load(sys.stdin))))"
    )
    with tempfile.TemporaryDirectory(prefix="rigidmc-bench-") as cache:
        done = subprocess.run(
            [sys.executable, "-c", code],
            input=json.dumps([widths, integrators, motions, names, device, derivatives]),
            env={**environment(processor), "RIGIDMC_CACHE_DIR": cache},
            capture_output=True,
            text=True,
        )
    if done.returncode == -signal.SIGILL:
        raise NotImplementedError(f"this CPU lacks instructions of {processor}")
    if done.returncode:
        raise RuntimeError(f"{processor}: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def run(quick):
    """Return all rows of the bench; rows of other architectures are as recorded."""
    some = QUICK if quick else None
    digests = {}
    for processor in PROCESSORS:
        widths = OWN if digests else WIDTHS  # all of them on this processor, the first
        with contextlib.suppress(NotImplementedError):
            digests[processor] = elsewhere(processor, widths, some)
            digests[f"{processor}, {WITH}"] = elsewhere(processor, widths, some, derivatives=True)
    here = {"architecture": ARCHITECTURE}
    rows = [
        {"kind": "machine", **here, **harness.machine_card()},
        *(
            _row(word, case, WIDTHS if len(each) > 1 else OWN, each)
            for word, by_case in digests.items()
            for case, each in by_case.items()
        ),
    ]
    cases = digests["this processor"]
    rows += [
        row
        for row in recorded()
        if row.get("architecture", ARCHITECTURE) != ARCHITECTURE
        and row.get("case") in (None, *cases)
    ]
    return [*rows, equal(rows)]


def add_case(case):
    """Return all recorded rows, the one of a case on this processor new."""
    widths = (1, *OWN)
    new = _row("this processor", case, widths, sums(widths, names=(case,))[case])
    name = ("architecture", "processor", "case")
    others = [row for row in recorded() if row["kind"] != "target"]
    kept = [row for row in others if any(row.get(key) != new[key] for key in name)]
    return [*kept, new, equal([*kept, new])]


def _row(processor, case, widths, each):
    names = {"kind": "bits", "architecture": ARCHITECTURE, "processor": processor}
    return {**names, "case": case, "widths": widths, "sums": each}


def recorded():
    """Return the rows of the committed file."""
    with open(FILE) as file:
        return json.load(file)["rows"]


def equal(rows):
    """Return the target: the cases whose sums are the same in all rows."""
    sums = {}
    for row in rows:
        if row["kind"] == "bits":
            sums.setdefault(row["case"], set()).update(row["sums"])
    same = sum(len(each) == 1 for each in sums.values())
    what = "cases whose results are the same everywhere"
    return harness.target(what, len(sums), same)


def report(rows):
    """Print the results, a table for each architecture."""
    table, heads = {}, {}
    for row in rows:
        if row["kind"] == "bits":
            word, one = row["architecture"], row["processor"]
            named = [f"x{width}" if width else one for width in row["widths"]]
            heads.setdefault(word, {}).update(dict.fromkeys(named))
            table.setdefault(word, {}).setdefault(row["case"], []).extend(row["sums"])
    for word, lines in table.items():
        harness.table(
            f"sha256 of results on {word}, members side by side and processors",
            ["", *heads[word]],
            [[case, *(one[:6] for one in each)] for case, each in lines.items()],
        )
    harness.report_targets(rows)


def main():
    with open(FILE) as file:
        machine = json.load(file)["machine"]
    found = {"machine": machine, "rows": add_case(sys.argv[1])}  # the machine of a whole run
    with open(FILE, "w") as file:
        json.dump(found, file, indent=1)
        file.write("\n")


if __name__ == "__main__":
    main()
