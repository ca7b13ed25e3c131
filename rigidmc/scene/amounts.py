"""Counts and times as people write them, on the command line, in scene files and in Python: 1e6
members, "1h30m"."""

import contextlib
import math
import re
from fractions import Fraction
from numbers import Integral, Real
from typing import Any, TypeGuard

from rigidmc.errors import OptionError, RigidmcError, SceneError

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


def seconds(value: Any, key: str | None, table: str = "", positive: bool = True) -> float:
    """A time [s] from a number, or from text such as "90 s", "1h30m", "250 ms".

    Raises SceneError, or without a table OptionError, for anything else, and with `positive` for 0
    or less.
    """
    number = math.nan
    with contextlib.suppress(OverflowError):  # whole numbers of Python may be larger than floats
        if isinstance(value, str):
            number = _seconds_of(value)
        elif _is_number(value):
            number = float(value)
    if not math.isfinite(number):
        raise _refused(table, key, value, TIME)
    if positive and not number > 0.0:
        raise _refused(table, key, value, "has to be greater than 0")
    return number


def _refused(table: str, key: str | None, value: Any, rule: str) -> RigidmcError:
    """A SceneError about a key of a table, or an OptionError about an argument."""
    return (SceneError if table else OptionError)(table, key or "", value, rule)


def _seconds_of(text: str) -> float:
    """Seconds of a text, rounded only once, so that `3 ms` is `0.003` to the bit; nan if the text
    is no time."""
    text = text.strip()
    if _PLAIN.fullmatch(text):
        return float(text)
    match = _DURATION.fullmatch(text)
    if match is None or not any(match.groups()[1:]):
        return math.nan
    parts = zip(match.groups()[1:], (size for size, _ in _UNITS.values()), strict=True)
    total = sum(Fraction(number) * size for number, size in parts if number)
    return float(-total if match[1] == "-" else total)


def counted(
    value: Any,
    key: str | None,
    least: int | None = 1,
    most: int | None = None,
    table: str = "",
) -> int:
    """A whole number, also written as a float such as 1e6.

    Raises SceneError, or without a table OptionError, for anything else, and for a number outside
    least ... most (by default 64 bits).
    """
    low = -LARGEST - 1 if least is None else least
    high = LARGEST if most is None else most
    if _is_number(value) and (isinstance(value, Integral) or float(value).is_integer()):
        if low <= value <= high:
            return int(value)
        if not -LARGEST - 1 <= value <= LARGEST:
            raise _refused(table, key, value, "expected a whole number of 64 bits")
    limits = f" from {low:,} to {high:,}" if most is not None else f" of at least {low:,}"
    limits = "" if least is None else limits
    raise _refused(table, key, value, f"expected a whole number{limits}")


def counted_text(text: str, key: str, least: int = 1, most: int | None = None) -> int:
    """A whole number from the text of the command line; OptionError."""
    plain = text.strip().replace("_", "") if isinstance(text, str) else ""
    if not _PLAIN.fullmatch(plain):
        return counted(text, key, least, most)
    exact = Fraction(plain)
    return counted(int(exact) if exact.denominator == 1 else float(plain), key, least, most)


def _is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a real number; numbers of numpy are, truth values are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def in_two_digits(number: float) -> str:
    """A number with two digits or three: `0.5`, `99`, `1.3 k`, `100 k`, `3.4 M`."""
    for size, word in ((1e6, " M"), (1e3, " k")):
        if number >= 99.5 * size:
            return f"{number / size:.0f}{word}"
        if number >= size:
            return f"{number / size:.2g}{word}"
    return f"{number:.0f}" if number >= 99.5 else f"{number:.2g}"
