"""Run the hard cases: every integrator through the catalogue, each error against its bound."""

import csv
import io
import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from importlib import resources
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.engine.machine import threads_available
from rigidmc.errors import FileError, OptionError, RigidmcError, unknown
from rigidmc.files.outputs import write_bytes
from rigidmc.files.reading import harmless, text_of
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.studies.stress import catalogue
from rigidmc.studies.stress import groups as all_groups
from rigidmc.studies.stress.case import HardCase
from rigidmc.studies.stress.processes import Outcome, carry_out
from rigidmc.version import VERSION

QUICK = ("rk4", "rk8", "srkn11", "exact", "closed")  # the integrators of `--quick`
AMBER = 0.3  # an error above this fraction of its bound is "close"
VERDICTS = ("not claimed", "good", "close", "not up to it", "not judged", "above", "crashed")
SHORT = 0.02  # fraction of the steps of long cases with `--quick`
_COLUMNS = ["group", "case", "integrator", "bound", "measured"]

Key = tuple[str, str]  # names of a case and of an integrator


def run_cases(
    groups: Sequence[str] | None = None,
    integrators: Sequence[str] | None = None,
    quick: bool = False,
    bounds: Mapping[Key, float] | None = None,
    threads: int | None = None,
    progress: bool | Callable[[int, int], object] = False,
) -> xr.Dataset:
    """Run the catalogue of hard cases; return a Dataset over `case` and `integrator`.

    groups : names of groups, by default all;  integrators : names, by default all
    quick : only cases marked `quick`, the integrators QUICK, and a fiftieth of the steps
    bounds : {(case, integrator): bound}, in place of the shipped ones
    threads : number of processes, by default one per core
    progress : True for a bar, or a function of (done, total)

    `rigidmc.stress` describes the variables.
    Raises OptionError for unknown names and for bounds that are negative or not finite.
    """
    names, titles = list(integrators or (QUICK if quick else INTEGRATORS)), all_groups()
    chosen = list(groups or titles)
    _refuse_unknown("integrator", names, INTEGRATORS, at="integrator", error=OptionError)
    _refuse_unknown("group of hard cases", chosen, titles, at="group", error=OptionError)
    cases, limits = catalogue(), shipped_bounds()
    for key, bound in (bounds or {}).items():
        limits[key] = (_checked(key, bound), limits.get(key, (0.0, math.nan))[1])
    wanted = [
        i for i, case in enumerate(cases) if case.group in chosen and (case.quick or not quick)
    ]
    tasks = {name: [i for i in wanted if name in cases[i].integrators()] for name in names}
    outcomes = carry_out(tasks, SHORT if quick else 1.0, threads or threads_available(), progress)
    table = [[outcomes.get((i, name)) for name in names] for i in wanted]
    return _dataset([cases[i] for i in wanted], table, names, limits, bounds or {})


def _refuse_unknown(kind: str, names: Iterable[str], words: Collection[str], **where: Any) -> None:
    for name in names:
        if name not in words:
            raise unknown(kind, words, value=name, **where)


def any_failed(study: xr.Dataset) -> bool:
    """Return whether any error is above its bound, or any case crashed."""
    return bool((study.verdict.values >= VERDICTS.index("above")).any())


def bound_of(
    case: HardCase,
    integrator: str,
    limits: Mapping[Key, tuple[float, float]],
    asked_for: Collection[Key] = (),
) -> tuple[float, float]:
    """Return (bound, measured) for a case and an integrator.

    The bound is the first available of: the user's bound, a bound set by mathematics, the shipped
    bound, the worst shipped bound of an integrator of the same kind and order. inf and nan if there
    is none. A splitting moves a free body exactly, with bounds that no other kind can keep.
    """
    bound, measured = limits.get((case.name, integrator), (None, math.nan))
    asked = case.asked_of(integrator)
    if bound is not None and ((case.name, integrator) in asked_for or asked is None):
        return bound, measured
    if asked is not None:
        return asked, measured

    def kind(name: str) -> tuple[float, bool]:
        return INTEGRATORS[name].order, INTEGRATORS[name].is_splitting

    alike = [
        pair
        for (name, other), pair in limits.items()
        if name == case.name and kind(other) == kind(integrator)
    ]
    return max(alike, default=(math.inf, math.nan))


def shipped_bounds() -> dict[Key, tuple[float, float]]:
    """Return {(case, integrator): (bound, measured)} of `bounds.csv`."""
    text = resources.files("rigidmc.studies.stress").joinpath("bounds.csv").read_text("utf-8")
    return _read(text, "bounds.csv")


def load_bounds(path: str | PathLike[str]) -> dict[Key, float]:
    """Return {(case, integrator): bound} of a file like `bounds.csv`; FileError for mistakes."""
    path = os.fspath(path)
    table = _read(text_of(path), path)
    cases, where = {case.name for case in catalogue()}, {"table": path, "error": FileError}
    _refuse_unknown("case", (name for name, _ in table), cases, at=f"{path}.case", **where)
    names = (name for _, name in table)
    _refuse_unknown("integrator", names, INTEGRATORS, at=f"{path}.integrator", **where)
    return {key: _checked(key, bound, FileError) for key, (bound, _) in table.items()}


def write_bounds(study: xr.Dataset, path: str | PathLike[str], force: bool = False) -> None:
    """Write four times the measured errors of a study as bounds, to one digit, at least 1e-16."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for i, case in enumerate(study.case.values):
        for j, name in enumerate(study.integrator.values):
            error = float(study.error.values[i, j])
            if math.isfinite(error):
                bound = f"{_rounded_up(max(4.0 * error, 1e-16)):.0e}"
                row = [study.group.values[i], case, name, bound, f"{error:.2g}"]
                writer.writerow(map(harmless, row))
    write_bytes(path, text.getvalue().encode(), force)


def _rounded_up(value: float) -> float:
    """Return a positive number rounded up to one digit."""
    size = 10.0 ** math.floor(math.log10(value))
    return math.ceil(value / size * (1.0 - 1e-9)) * size


def _read(text: str, file: str) -> dict[Key, tuple[float, float]]:
    try:
        rows = list(csv.DictReader(text.splitlines()))
    except csv.Error as error:
        raise FileError(f"is not a table: {error}", at="bounds", file=file) from None
    bounds: dict[Key, tuple[float, float]] = {}
    for number, row in enumerate(rows, 2):
        try:
            measured = float(row.get("measured") or math.nan)
            bounds[row["case"], row["integrator"]] = float(row["bound"]), measured
        except (KeyError, TypeError, ValueError):
            rule = f"expected the columns {', '.join(_COLUMNS)}, with numbers in the last two"
            line, value = f"line {number}", row.get("bound")
            raise FileError(rule, at=f"{line}.bound", table=line, value=value, file=file) from None
    return bounds


def _checked(key: Key, bound: float, error: type[RigidmcError] = OptionError) -> float:
    """Return a bound; raise an error if it is negative or not finite."""
    if not (bound >= 0.0 and math.isfinite(bound)):
        rule = "a bound must be finite and not negative"
        table = f"{key[0]}, {key[1]}"
        raise error(rule, at=f"{table}.bound", table=table, value=bound)
    return bound


def _dataset(
    cases: Sequence[HardCase],
    outcomes: Sequence[Sequence[Outcome | None]],
    names: Sequence[str],
    limits: Mapping[Key, tuple[float, float]],
    asked_for: Collection[Key],
) -> xr.Dataset:
    """Return the Dataset of a study; `outcomes` has a row per case and a column per integrator."""
    shape, over = (len(cases), len(names)), ("case", "integrator")
    bound, measured, error, seconds = (np.full(shape, np.nan) for _ in range(4))
    verdict, reason = np.zeros(shape, "i1"), np.full(shape, "", dtype=object)
    for i, case in enumerate(cases):
        for j, name in enumerate(names):
            outcome = outcomes[i][j]
            if outcome is None or (math.isnan(outcome[0]) and not outcome[2]):
                continue
            error[i, j], seconds[i, j], reason[i, j] = outcome
            bound[i, j], measured[i, j] = bound_of(case, name, limits, asked_for)
            verdict[i, j] = VERDICTS.index(_verdict(case, name, error[i, j], bound[i, j]))
            if reason[i, j] == "" and VERDICTS[verdict[i, j]] == "not up to it":
                reason[i, j] = case.weak[name]
    flags = {
        "flag_values": np.arange(len(VERDICTS), dtype="i1"),
        "flag_meanings": " ".join(v.replace(" ", "_") for v in VERDICTS),
    }
    described = "error on the machine that measured the bounds"
    variables = {
        "error": (over, error, {"units": "1", "long_name": "error against `truth`"}),
        "bound": (over, bound, {"units": "1", "long_name": "bound of the error"}),
        "measured": (over, measured, {"units": "1", "long_name": described}),
        "seconds": (over, seconds, {"units": "s"}),
        "verdict": (over, verdict, flags),
        "reason": (over, reason),
        **{
            fact: ("case", np.array([getattr(case, fact) for case in cases], dtype=object))
            for fact in ("group", "why", "truth")
        },
    }
    coordinates = {
        "case": np.array([case.name for case in cases], dtype=object),
        "integrator": np.array(names, dtype=object),
    }
    attrs = {"title": "hard cases", "source": f"rigidmc {VERSION}"}
    return xr.Dataset(variables, coordinates, attrs)


def _verdict(case: HardCase, name: str, error: float, bound: float) -> str:
    """Return one of VERDICTS."""
    if math.isnan(error):
        return "crashed"
    if error > bound:
        return "above"
    if name in case.weak:
        return "not up to it"
    if bound == math.inf and error > 0.0:
        return "not judged"
    return "good" if error <= AMBER * bound or error == 0.0 else "close"
