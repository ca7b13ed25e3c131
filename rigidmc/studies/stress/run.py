"""Hard cases: every integrator through the catalogue, in as many processes as there are cores, against a bound for each."""

import contextlib
import csv
import io
import json
import math
import subprocess
import sys
import threading
import time
from importlib import resources
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import FileError, OptionError, SceneError, unknown
from rigidmc.files.outputs import write_bytes
from rigidmc.files.reading import text_of
from rigidmc.integrators import INTEGRATORS
from rigidmc.progress import reporter
from rigidmc.studies.stress.catalogue import GROUPS, catalogue
from rigidmc.version import VERSION

QUICK = ("rk4", "rk8", "srkn11", "exact", "closed")
AMBER = 0.3  # of its bound, from which an error is shown as close to it
VERDICTS = ("not claimed", "good", "close", "not up to it", "above", "crashed")
SHORT = 0.02  # of the steps of long cases that `quick` makes
_COLUMNS = ["group", "case", "integrator", "bound", "measured"]


def stress(groups=None, integrators=None, quick=False, bounds=None, threads=None, progress=False):
    """Run the catalogue of hard cases: a Dataset over `case` and `integrator`.

    groups : of GROUPS, default all;  integrators : names, default all;  quick : the marked cases, QUICK, and a fiftieth of the steps
    bounds : {(case, integrator): bound} in place of those that ship;  threads : processes, default one for each core
    progress : True for a bar, or a function of (done, total)

    Variables: error, bound, measured (on the machine that the bounds come from), seconds, verdict (`flag_meanings` tells: not up to it are
    integrators that claim a case but are known not to manage it), reason (what a crash said); over `case` group, why, truth.
    Raises OptionError for words that are not known and bounds that are not positive.
    """
    names, chosen = list(integrators or (QUICK if quick else INTEGRATORS)), list(groups or GROUPS)
    for name in names:
        if name not in INTEGRATORS:
            raise unknown("", "--integrator", name, "integrator", INTEGRATORS, OptionError)
    for group in chosen:
        if group not in GROUPS:
            raise unknown("", "--group", group, "group of hard cases", GROUPS, OptionError)
    cases, known = catalogue(), shipped_bounds()
    for key, bound in (bounds or {}).items():
        known[key] = (_positive(key, bound), known.get(key, (0.0, math.nan))[1])
    wanted = [
        i for i, case in enumerate(cases) if case.group in chosen and (case.quick or not quick)
    ]
    tasks = {name: [i for i in wanted if name in cases[i].integrators()] for name in names}
    found = _carried_out(tasks, SHORT if quick else 1.0, threads or threads_available(), progress)
    return _dataset(
        [cases[i] for i in wanted],
        [found.get((i, name)) for i in wanted for name in names],
        names,
        known,
        bounds or {},
    )


def bound_of(case, integrator, known, given=()):
    """(bound, measured): what the user gives, what is asked, what ships for the integrator, or the worst that ships for its order."""
    bound, measured = known.get((case.name, integrator), (None, math.nan))
    asked = case.asked_of(integrator)
    if (case.name, integrator) in given or (asked is None and bound is not None):
        return bound, measured
    if asked is not None:
        return asked, measured
    order = INTEGRATORS[integrator].order
    alike = [
        pair
        for (name, other), pair in known.items()
        if name == case.name and INTEGRATORS[other].order == order
    ]
    return max(alike, default=(math.inf, math.nan))


def shipped_bounds():
    """{(case, integrator): (bound, measured)} of `bounds.csv`."""
    return {
        k: v[:2]
        for k, v in _read(
            resources.files("rigidmc.studies").joinpath("bounds.csv").read_text("utf-8"),
            "bounds.csv",
        ).items()
    }


def load_bounds(path):
    """{(case, integrator): bound} of a file like `bounds.csv`; FileError for what is wrong in it."""
    found = _read(text_of(path), path)
    cases = {case.name for case in catalogue()}
    for name, integrator in found:
        if name not in cases:
            raise unknown(path, "case", name, "case", cases, FileError)
        if integrator not in INTEGRATORS:
            raise unknown(path, "integrator", integrator, "integrator", INTEGRATORS, FileError)
    return {key: _positive(key, bound, FileError) for key, (bound, _) in found.items()}


def save_bounds(study, path, force=False):
    """Write four times what a study measured as bounds, to one digit, at least 1e-16, for cases whose bound is not asked by mathematics."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for i, case in enumerate(study.case.values):
        for j, name in enumerate(study.integrator.values):
            error = float(study.error.values[i, j])
            if math.isfinite(error):
                bound = f"{_rounded_up(max(4.0 * error, 1e-16)):.0e}"
                writer.writerow([study.group.values[i], case, name, bound, f"{error:.2g}"])
    write_bytes(path, text.getvalue().encode(), force)


def _rounded_up(value):
    size = 10.0 ** math.floor(math.log10(value))
    return math.ceil(value / size * (1.0 - 1e-9)) * size


def _read(text, file):
    found = {}
    try:
        rows = list(csv.DictReader(text.splitlines()))
    except csv.Error as error:
        raise FileError("", "bounds", None, f"is no table: {error}", file=file) from None
    for number, row in enumerate(rows, 2):
        try:
            found[row["case"], row["integrator"]] = (
                float(row["bound"]),
                float(row.get("measured") or math.nan),
            )
        except (KeyError, TypeError, ValueError):
            raise FileError(
                f"line {number}",
                "bound",
                row.get("bound"),
                f"expected the columns {', '.join(_COLUMNS)}, numbers in the last two",
                file=file,
            ) from None
    return found


def _positive(key, bound, error=OptionError):
    if not (bound >= 0.0 and math.isfinite(bound)):
        raise error(
            f"{key[0]}, {key[1]}", "bound", bound, "a bound must be finite and not negative"
        )
    return bound


def _carried_out(tasks, share, processes, progress):
    """{(case, integrator): (error, seconds, reason)}; integrators are shared out among processes, so that no kernel is compiled twice."""
    left, found = (
        sorted(tasks, key=lambda name: -INTEGRATORS[name].evaluations * (len(tasks[name]) > 0)),
        {},
    )
    lock = threading.Lock()

    def work(report):
        helper: Any = None
        while True:
            with lock:
                if not left:
                    break
                name = left.pop(0)
            for i in tasks[name]:
                began = time.perf_counter()
                try:
                    helper = helper or _helper()
                    helper.stdin.write(json.dumps([i, name, share]) + "\n")
                    helper.stdin.flush()
                    found[i, name] = tuple(json.loads(helper.stdout.readline()))
                except (
                    ValueError,
                    OSError,
                ):  # it died: the case is red, and the others go on in a new process
                    helper.kill()
                    code, helper = _ended(helper), None
                    found[i, name] = (
                        math.nan,
                        time.perf_counter() - began,
                        f"the process ended with code {code}",
                    )
                report.step(1)
        if helper:
            _ended(helper)

    with reporter(progress, sum(map(len, tasks.values())), 1) as report:
        workers = [
            threading.Thread(target=work, args=(report,), daemon=True)
            for _ in range(min(processes, len(tasks)))
        ]
        for worker in workers:
            worker.start()
        for worker in workers:
            while worker.is_alive():
                worker.join(0.2)
                report.poll()
    return found


def _helper():
    words = [sys.executable, "-c", "from rigidmc.studies.stress.run import main; main()"]
    return subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def _ended(helper):
    """Its exit code, once it has ended for want of lines."""
    with contextlib.suppress(OSError):
        helper.stdin.close()
    helper.stdout.close()
    return helper.wait()


def main():
    """A process that runs what it is told: lines [case, integrator, share] in, lines [error, seconds, reason] out."""
    cases = catalogue()
    for line in sys.stdin:
        i, name, share = json.loads(line)
        print(json.dumps(carried_out(cases[i], name, share)), flush=True)


def carried_out(case, integrator, share=1.0):
    """(error, seconds, reason) of one case: nan and a reason where it raises, nan and none where the closed form does not cover it."""
    began, reason = time.perf_counter(), ""
    try:
        error = float(case.error(integrator, share))
    except Exception as raised:  # a case that fails is red, and stops no other
        uncovered = (
            integrator == "closed"
            and isinstance(raised, SceneError)
            and "closed form" in str(raised)
        )
        error, reason = math.nan, "" if uncovered else f"{type(raised).__name__}: {raised}"
    return error, time.perf_counter() - began, reason


def _dataset(cases, found, names, known, given):
    shape = (len(cases), len(names))
    bound, measured, error, seconds = (np.full(shape, np.nan) for _ in range(4))
    verdict, reason = np.zeros(shape, "i1"), np.full(shape, "", dtype=object)
    for at, result in enumerate(found):
        i, j = divmod(at, len(names))
        if result is None or (math.isnan(result[0]) and not result[2]):
            continue
        error[i, j], seconds[i, j], reason[i, j] = result
        bound[i, j], measured[i, j] = bound_of(cases[i], names[j], known, given)
        verdict[i, j] = _verdict(cases[i], names[j], error[i, j], bound[i, j])
        if reason[i, j] == "" and verdict[i, j] == 3:
            reason[i, j] = cases[i].weak[names[j]]
    kinds = {
        "error": "error, as `truth` says",
        "bound": "what the error must not exceed",
        "measured": "error on the machine that the bounds come from",
    }
    variables: dict[str, Any] = {
        name: (("case", "integrator"), values, {"units": "1", "long_name": kinds[name]})
        for name, values in (("error", error), ("bound", bound), ("measured", measured))
    }
    flags = {
        "flag_values": np.arange(len(VERDICTS), dtype="i1"),
        "flag_meanings": " ".join(v.replace(" ", "_") for v in VERDICTS),
    }
    about = {
        name: ("case", np.array([getattr(case, name) for case in cases], dtype=object))
        for name in ("group", "why", "truth")
    }
    variables |= {
        "seconds": (("case", "integrator"), seconds, {"units": "s"}),
        "verdict": (("case", "integrator"), verdict, flags),
    }
    variables |= {"reason": (("case", "integrator"), reason), **about}
    coordinates = {
        "case": np.array([case.name for case in cases], dtype=object),
        "integrator": np.array(names, dtype=object),
    }
    return xr.Dataset(
        variables, coordinates, {"title": "hard cases", "source": f"rigidmc {VERSION}"}
    )


def _verdict(case, name, error, bound):
    if math.isnan(error):
        return VERDICTS.index("crashed")
    if name in case.weak and error <= bound:
        return VERDICTS.index("not up to it")
    return VERDICTS.index(
        "good" if error <= AMBER * bound or error == 0.0 else "close" if error <= bound else "above"
    )


def failed(study):
    """Whether anything is above its bound or crashed."""
    return bool((study.verdict.values >= VERDICTS.index("above")).any())
