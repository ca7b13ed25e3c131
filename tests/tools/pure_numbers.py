"""Whether functions give the same pure numbers in other units, and by how much they differ.

The table of the worst differences, kind of scene by kind, as tests/whole/test_units.py holds them::

    python -m tests.tools.pure_numbers [KIND ...]
"""

import math
import re
import sys
import warnings
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import rigidmc as rm
from tests.tools import units
from tests.tools.units import (
    KINDS,
    OTHERS,
    PLAIN,
    T_END,
    Units,
    asked,
    in_units,
    of_dataset,
    without_numbers,
)

# notes on what a body may be made of, and in which units a user thinks, know SI units
ABOUT_SI = re.compile(r"air|molecule|star|osmium|millimetre|degrees|kelvin| K\b")
LIMIT = 1e-10  # measured 3.1e-12, of an index of `sensitivity`; all others below 1e-12
# {row of the table: limit}
LIMITS = {
    # an error of 1.9e-7 of |L|^2 is a difference of near numbers: 3.1e-9 of it, 6e-16 of |L|^2
    "accuracy": 1e-7,
    # what is the cheapest way to a tolerance of 1e-6 is a matter of the clock: 6e-7
    "simulate(tolerance)": 1e-5,
}
SEEDS = range(4)


class Answer(NamedTuple):
    """What a function gave: pure numbers, the notes without numbers, or the words of an error."""

    numbers: dict[str, Any]
    notes: tuple[str, ...]
    error: str


def answer(function: Any, units: Units) -> Answer:
    """The Answer of a function of `asked`, its numbers divided by their units."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = function()
        except rm.RigidmcError as error:
            return Answer({}, (), without_numbers(str(error)))
    if isinstance(found, xr.Dataset):
        found = of_dataset(found)
    numbers = {}
    for name, (values, unit) in found.items():
        pure = 1.0 if unit in ("", "degree", "%") else units.of(unit)
        with np.errstate(all="ignore"):
            numbers[name] = np.asarray(values, float) / pure
    texts = {str(w.message) for w in caught if issubclass(w.category, rm.SceneWarning)}
    notes = sorted(without_numbers(x) for x in texts if not ABOUT_SI.search(x))
    return Answer(numbers, tuple(notes), "")


def differences(one: Answer, two: Answer) -> dict[str, float]:
    """{variable: largest difference of two Answers, of its size}; inf with words for another error,
    other notes, variables or shapes."""
    if one.error != two.error:
        return {f"{one.error or 'no error'} / {two.error or 'no error'}": math.inf}
    if one.notes != two.notes:
        return {f"notes {set(one.notes) ^ set(two.notes)}": math.inf}
    if one.numbers.keys() != two.numbers.keys():
        return {f"variables {one.numbers.keys() ^ two.numbers.keys()}": math.inf}
    found = {}
    for name, a in one.numbers.items():
        b = two.numbers[name]
        if a.shape != b.shape or not np.array_equal(np.isfinite(a), np.isfinite(b)):
            found[f"{name}: {a} / {b}"] = math.inf
            continue
        ends = np.isfinite(a)
        off = np.abs(a[ends] - b[ends]).max(initial=0.0)
        size = _size(name, one.numbers)
        found[name] = 0.0 if off == 0.0 else float(off / size) if size > 0.0 else math.inf
    return found


def _size(name: str, numbers: dict[str, Any]) -> float:
    """By what a difference is measured: the largest of the numbers. A drift and an error of a check
    are relative, to be measured by 1; a variance may be rounding of a constant, to be measured by
    the square of the mean, and an error of a step that of the value; the exponent of a body that
    stays at rest is rounding, to be measured by 1/t_end."""
    size = _largest(numbers[name])
    if "drift" in name or name in ("error", "error_median"):
        return max(1.0, size)
    if "variance" in name:
        return max(size, _largest(numbers.get(name.replace("variance", "mean"), 0.0)) ** 2)
    if name == "ftle":
        return max(size, 1.0 / T_END)
    return max(size, _largest(numbers["value"])) if name == "bias" else size


def _largest(values: Any) -> float:
    return float(
        np.abs(values, where=np.isfinite(values), out=np.zeros(np.shape(values))).max(initial=0.0)
    )


class Row(NamedTuple):
    """A row of the table, also of one scene in one system of units.

    off, where : the worst difference and where;  numbers : how many finite ones were compared
    answers : answers compared;  refused : those that were refused in the same words
    """

    off: float
    where: str
    numbers: int
    answers: int
    refused: int

    def __add__(self, other: "Row") -> "Row":  # type: ignore[override]
        worst = max(self, other, key=lambda row: row.off)
        counts = (a + b for a, b in zip(self[2:], other[2:], strict=True))
        return Row(*worst[:2], *counts)


def rows(kind: str, seed: int, only: Iterable[str] = ()) -> Iterator[tuple[str, Row]]:
    """(name, Row) of every function of a scene in each of OTHERS: megno and lyapunov have
    rows of their own."""
    one = units.scene(kind, seed)
    for name, function in asked(one, PLAIN).items():
        if only and name not in only:
            continue
        plain = answer(function, PLAIN)
        for other in OTHERS:
            found = answer(asked(in_units(one, other), other)[name], other)
            for variable, off in differences(plain, found).items() or [("", 0.0)]:
                near = next((word for word in ("lyapunov", "megno") if word in variable), name)
                place = f"{variable} of {kind} {seed}, kg x {other.mass:g}, s x {other.time:g}"
                count = int(np.isfinite(plain.numbers.get(variable, np.nan)).sum())
                yield near, Row(off, place, count, 0, 0)
            yield name, Row(0.0, "", 0, 1, bool(plain.error))


def table(found: dict[str, Row]) -> list[str]:
    """Lines of Markdown."""
    lines = ["| function | worst difference | limit | where | answers | refused | numbers |"]
    lines.append("| --- | ---: | ---: | --- | ---: | ---: | ---: |")
    for name, row in found.items():
        limit = LIMITS.get(name, LIMIT)
        counts = f"{row.answers} | {row.refused} | {row.numbers}"
        lines.append(f"| {name} | {row.off:.1e} | {limit:.0e} | {row.where} | {counts} |")
    return lines


def main(kinds: Iterable[str]) -> None:
    """Print the table of each kind of scene as it is found, then that of all."""
    every: dict[str, Row] = {}
    for kind in kinds or KINDS:
        found: dict[str, Row] = {}
        for seed in SEEDS:
            for name, row in rows(kind, seed):
                for one in (found, every):
                    one[name] = one[name] + row if name in one else row
        print("\n".join([f"{kind}:", *table(found), ""]), flush=True)
    print("\n".join([f"all, {len(OTHERS)} other systems of units:", *table(every)]))


if __name__ == "__main__":
    main(sys.argv[1:])
