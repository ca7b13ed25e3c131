"""Counts, times and lists in readable notation, on the command line, in scene files and in Python:
1e6 members, "1h30m", "omega,energy"."""

import contextlib
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from numbers import Integral, Real
from typing import Any, TypeGuard

from rigidmc.errors import OptionError, RigidmcError
from rigidmc.inputs.measured import from_foreign, is_foreign
from rigidmc.inputs.units import LONGEST

_UNITS: dict[str, tuple[Fraction, str]] = {  # unit: (seconds, pattern of its names)
    "d": (Fraction(86400), "d|days?"),
    "h": (Fraction(3600), "h|hours?"),
    "min": (Fraction(60), "m|min|minutes?"),
    "s": (Fraction(1), "s|sec|seconds?"),
    "ms": (Fraction(1, 10**3), "ms"),
    "us": (Fraction(1, 10**6), "us|µs"),
    "ns": (Fraction(1, 10**9), "ns"),
}
LARGEST = 2**63 - 1  # in TOML and netCDF
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?"
_DURATION = re.compile(
    r"([-+]?)\s*" + "".join(rf"(?:({_NUMBER})\s*(?:{word})\s*)?" for _, word in _UNITS.values()),
    re.ASCII,
)
_PLAIN = re.compile(rf"[-+]?{_NUMBER}", re.ASCII | re.IGNORECASE)
TIME = 'expected a finite number of seconds, or a time such as "90 s", "1h30m", "2 min", "250 ms"'


def parse_seconds(value: Any, positive: bool = True) -> float:
    """Return a time [s] from a number, or from text such as "90 s", "1h30m", "250 ms".

    Raises ValueError for anything else, and with `positive` for 0 or less.
    """
    number = math.nan
    if is_foreign(value):
        try:
            value = float(from_foreign(value, "s", "time"))
        except (RigidmcError, TypeError) as error:
            raise ValueError(getattr(error, "rule", TIME)) from None
    with contextlib.suppress(OverflowError):  # Python's integers may exceed floats
        if isinstance(value, str):
            number = _seconds_of(value)
        elif _is_number(value):
            number = float(value)
    if not math.isfinite(number):
        raise ValueError(TIME)
    if positive and not number > 0.0:
        raise ValueError("must be greater than 0")
    return number


def read_seconds(value: Any, at: str, positive: bool = True) -> float:
    """Return the time [s] given by an argument named `at`; OptionError."""
    with _argument(value, at):
        return parse_seconds(value, positive)


@contextlib.contextmanager
def _argument(value: Any, at: str) -> Iterator[None]:
    """Turn a ValueError, which contains only a rule, into an OptionError with place and value."""
    try:
        yield
    except ValueError as wrong:
        raise OptionError(str(wrong), at=at, value=value) from None


def _seconds_of(text: str) -> float:
    """Return the seconds of a text, rounded only once, so that `3 ms` equals `0.003` to the bit;
    nan if the text is not a time."""
    text = text.strip()
    if len(text) > 2 * LONGEST:  # the search would take the square of its length
        return math.nan
    if _PLAIN.fullmatch(text):
        return float(text)
    match = _DURATION.fullmatch(text)
    if match is None or not any(match.groups()[1:]):
        return math.nan
    parts = zip(match.groups()[1:], (size for size, _ in _UNITS.values()), strict=True)
    total = sum(Fraction(number) * size for number, size in parts if number)
    return float(-total if match[1] == "-" else total)


def parse_count(value: Any, least: int | None = 1, most: int | None = None) -> int:
    """Return an integer, which may be written as a float such as 1e6.

    Raises ValueError for anything else, and for a number outside least ... most (by default 64
    bits).
    """
    low = -LARGEST - 1 if least is None else least
    high = LARGEST if most is None else most
    if _is_number(value) and (isinstance(value, Integral) or float(value).is_integer()):
        if low <= value <= high:
            return int(value)
        if not -LARGEST - 1 <= value <= LARGEST:
            raise ValueError("expected an integer of 64 bits")
    limits = f" from {low:,} to {high:,}" if most is not None else f" of at least {low:,}"
    limits = "" if least is None else limits
    raise ValueError(f"expected an integer{limits}")


def read_count(value: Any, at: str, least: int | None = 1, most: int | None = None) -> int:
    """Return the integer given by an argument named `at`; OptionError."""
    with _argument(value, at):
        return parse_count(value, least, most)


def read_count_text(text: str, at: str, least: int = 1, most: int | None = None) -> int:
    """Return an integer from command-line text; OptionError."""
    plain = text.strip().replace("_", "") if isinstance(text, str) else ""
    if not _PLAIN.fullmatch(plain):
        return read_count(text, at, least, most)
    exact = Fraction(plain)
    return read_count(int(exact) if exact.denominator == 1 else float(plain), at, least, most)


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a list such as "omega,energy"; "none" and "" are the empty list."""
    return tuple(word.strip() for word in text.split(",") if word.strip() not in ("", "none"))


def _is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a real number; NumPy numbers are, booleans are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def two_digits(number: float) -> str:
    """Format a number with two or three digits: `0.5`, `99`, `1.3 k`, `100 k`, `3.4 M`."""
    for size, word in ((1e6, " M"), (1e3, " k")):
        if number >= 99.5 * size:
            return f"{number / size:.0f}{word}"
        if number >= size:
            return f"{number / size:.2g}{word}"
    return f"{number:.0f}" if number >= 99.5 else f"{number:.2g}"


def count_text(count: int, one: str, many: str = "") -> str:
    """Format a count with its noun: "1 member", "20,000 members", "2 families".

    many : plural of `one`, unless regular: "tasks are missing" for "task is missing"
    """
    if count == 1:
        return f"1 {one}"
    return f"{count:,} {many or (f'{one[:-1]}ies' if one.endswith('y') else f'{one}s')}"
