"""Counts and times as people give them, on the command line, in scene files and in Python: 1e6 members, "1h30m"."""

import contextlib
import math
import re
from fractions import Fraction
from numbers import Integral, Real

from rigidmc.errors import OptionError, RigidmcError, SceneError

_UNITS: dict[str, tuple[Fraction, str]] = {  # unit: (seconds, what it is called)
    "d": (Fraction(86400), "d|days?"),
    "h": (Fraction(3600), "h|hours?"),
    "min": (Fraction(60), "m|min|minutes?"),
    "s": (Fraction(1), "s|sec|seconds?"),
    "ms": (Fraction(1, 10**3), "ms"),
    "us": (Fraction(1, 10**6), "us|µs"),
    "ns": (Fraction(1, 10**9), "ns"),
}
LARGEST = 2**63 - 1  # what TOML and netCDF hold
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?"
_DURATION = re.compile(
    r"([-+]?)\s*" + "".join(rf"(?:({_NUMBER})\s*(?:{word})\s*)?" for _, word in _UNITS.values()),
    re.ASCII,
)
_PLAIN = re.compile(rf"[-+]?{_NUMBER}", re.ASCII | re.IGNORECASE)
TIME = 'expected a finite number of seconds, or a time such as "90 s", "1h30m", "2 min", "250 ms"'


def seconds(value, key, table="", positive=True):
    """A time [s] from a number or from text such as "90 s", "1h30m", "250 ms". SceneError (without a table OptionError) else, and if `positive` for 0 or less."""
    number = math.nan
    with contextlib.suppress(OverflowError):  # whole numbers of Python may be larger than floats
        number = (
            _seconds_of(value)
            if isinstance(value, str)
            else float(value)
            if _is_number(value)
            else math.nan
        )
    if not math.isfinite(number):
        raise _refused(table, key, value, TIME)
    if positive and not number > 0.0:
        raise _refused(table, key, value, "has to be greater than 0")
    return number


def _seconds_of(text):
    """Seconds of a text, rounded only once, so that 3 ms is 0.003 to the bit; nan if the text is no time."""
    text = text.strip()
    if _PLAIN.fullmatch(text):
        return float(text)
    found = _DURATION.fullmatch(text)
    if found is None or not any(found.groups()[1:]):
        return math.nan
    parts = zip(found.groups()[1:], (size for size, _ in _UNITS.values()), strict=True)
    whole = sum(Fraction(number) * size for number, size in parts if number)
    return float(-whole if found[1] == "-" else whole)


def counted(value, key, least=1, most=None, table=""):
    """A whole number, also one that is written as a float, as 1e6 is; SceneError (without a table OptionError) where it is none, or outside its range (of 64 bits at most)."""
    low, high = -LARGEST - 1 if least is None else least, LARGEST if most is None else most
    whole = _is_number(value) and (isinstance(value, Integral) or float(value).is_integer())
    if not whole or not low <= value <= high:
        limits = (
            ""
            if least is None
            else f" of at least {least:,}"
            if most is None
            else f" from {low:,} to {high:,}"
        )
        wide = whole and not -LARGEST - 1 <= value <= LARGEST
        raise _refused(
            table, key, value, f"expected a whole number{' of 64 bits' if wide else limits}"
        )
    return int(value)


def _refused(table, key, value, rule) -> RigidmcError:
    """A SceneError for a key of a table, an OptionError for an argument."""
    return (SceneError if table else OptionError)(table, key, value, rule)


def counted_text(text, key, least=1, most=None):
    """A whole number as it stands on the command line; OptionError."""
    plain = text.strip().replace("_", "") if isinstance(text, str) else ""
    if not _PLAIN.fullmatch(plain):
        return counted(text, key, least, most)
    exact = Fraction(plain)
    return counted(int(exact) if exact.denominator == 1 else float(plain), key, least, most)


def _is_number(value):
    return isinstance(value, Real) and not isinstance(
        value, bool
    )  # numbers of numpy count too, its truth values do not
