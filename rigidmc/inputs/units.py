"""Units that users may write beside a number, such as "deg/s" and "g mm2", and their conversion to
SI. Results and stored scenes have SI units alone.

A unit is a product of powers of the symbols in `_SYMBOLS`: "kg m2/s", "N m s", "m^2 s^-1",
"J/(kg m)". The angle is a dimension: "1/s" is not "rad/s", because it may mean turns. Beside a mass
it is optional, as in "N m/rad".
"""

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from rigidmc.errors import RigidmcError, SceneError, hint_of, nearest

_PI = Fraction(31415926535897932384626433832795028841971, 10**40)  # rounds once, to float64
LONGEST = 80  # characters of a unit
Powers = tuple[int, int, int, int, int]  # of kg, m, s, A, rad
_INCH, _POUND, _FOOT = Fraction(254, 10**4), Fraction(45359237, 10**8), Fraction(3048, 10**4)
_STANDARD_GRAVITY = Fraction(980665, 10**5)
_POUND_FORCE = _POUND * _STANDARD_GRAVITY

# {symbol: (factor of SI, power of pi in it, powers, allowed prefixes)}
_SYMBOLS: dict[str, tuple[Fraction, int, Powers, str]] = {
    "g": (Fraction(1, 1000), 0, (1, 0, 0, 0, 0), "kmu"),
    "t": (Fraction(1000), 0, (1, 0, 0, 0, 0), ""),
    "lb": (_POUND, 0, (1, 0, 0, 0, 0), ""),
    "oz": (_POUND / 16, 0, (1, 0, 0, 0, 0), ""),
    "slug": (_POUND_FORCE / _FOOT, 0, (1, 0, 0, 0, 0), ""),
    "m": (Fraction(1), 0, (0, 1, 0, 0, 0), "kdcmun"),
    "in": (_INCH, 0, (0, 1, 0, 0, 0), ""),
    "ft": (_FOOT, 0, (0, 1, 0, 0, 0), ""),
    "s": (Fraction(1), 0, (0, 0, 1, 0, 0), "mun"),
    "min": (Fraction(60), 0, (0, 0, 1, 0, 0), ""),
    "h": (Fraction(3600), 0, (0, 0, 1, 0, 0), ""),
    "d": (Fraction(86400), 0, (0, 0, 1, 0, 0), ""),
    "rad": (Fraction(1), 0, (0, 0, 0, 0, 1), "mu"),
    "deg": (Fraction(1, 180), 1, (0, 0, 0, 0, 1), ""),
    "arcmin": (Fraction(1, 180 * 60), 1, (0, 0, 0, 0, 1), ""),
    "arcsec": (Fraction(1, 180 * 3600), 1, (0, 0, 0, 0, 1), ""),
    "rev": (Fraction(2), 1, (0, 0, 0, 0, 1), ""),
    "rpm": (Fraction(2, 60), 1, (0, 0, -1, 0, 1), ""),
    "N": (Fraction(1), 0, (1, 1, -2, 0, 0), "kmun"),
    "lbf": (_POUND_FORCE, 0, (1, 1, -2, 0, 0), ""),
    "J": (Fraction(1), 0, (1, 2, -2, 0, 0), "kmun"),
    "W": (Fraction(1), 0, (1, 2, -3, 0, 0), "km"),
    "A": (Fraction(1), 0, (0, 0, 0, 1, 0), "mu"),
    "T": (Fraction(1), 0, (1, 0, -2, -1, 0), "mun"),
    "G": (Fraction(1, 10**4), 0, (1, 0, -2, -1, 0), "mu"),
    "%": (Fraction(1, 100), 0, (0, 0, 0, 0, 0), ""),
}
_PREFIXES = {"k": 3, "d": -1, "c": -2, "m": -3, "u": -6, "n": -9}
KNOWN = {
    **{symbol: entry[:3] for symbol, entry in _SYMBOLS.items()},
    **{
        prefix + symbol: (factor * Fraction(10) ** _PREFIXES[prefix], pi, powers)
        for symbol, (factor, pi, powers, prefixes) in _SYMBOLS.items()
        for prefix in prefixes
    },
}
_NAMES = {  # {word: its symbol}, for hints
    word: symbol
    for symbol, words in {
        "deg": "degree",
        "rev": "turn revolution",
        "rad": "radian",
        "s": "second sec",
        "min": "minute",
        "h": "hour hr",
        "d": "day",
        "m": "metre meter",
        "mm": "millimetre millimeter",
        "km": "kilometre kilometer",
        "cm": "centimetre centimeter",
        "in": "inch inche",
        "ft": "foot feet",
        "g": "gr gram gramme gm",
        "kg": "kilogram kilo",
        "t": "tonne",
        "lb": "pound lbm",
        "N": "newton",
        "J": "joule",
        "W": "watt",
        "A": "ampere amp",
        "T": "tesla",
        "G": "gauss",
        "rev/s": "rps",
        "deg/s": "dps",
    }.items()
    for word in words.split()
}
_TEMPERATURE = "temperatures are not taken; kT is an energy, in J"
REFUSED = {  # {word: why it is not a unit here}
    "Hz": "Hz may mean turns or radians per second: write rev/s, rad/s, or 1/s for a rate",
    **dict.fromkeys(("K", "degC", "degF", "°C", "°F"), _TEMPERATURE),
}
_WHAT: dict[str, tuple[str, str]] = {  # {SI: (what it is, other units for it)}
    "1": ("a number without a unit", "%"),
    "kg": ("a mass", "g, lb"),
    "m": ("a length", "mm, cm, km, in, ft"),
    "s": ("a time", "ms, min, h, d"),
    "rad": ("an angle", "deg, mrad, arcsec, rev"),
    "rad/s": ("an angular velocity", "deg/s, rpm, rev/s"),
    "rad/s2": ("an angular acceleration", "deg/s2"),
    "1/s": ("a rate", "1/min, 1/h, 1/d"),
    "m/s": ("a velocity", "mm/s, km/s"),
    "m/s2": ("an acceleration", "mm/s2, ft/s2"),
    "m3/s2": ("a gravitational parameter", "km3/s2"),
    "m2": ("an area", "mm2"),
    "m3": ("a volume", "mm3"),
    "kg m2": ("a moment of inertia", "g mm2, kg cm2, lb in2"),
    "kg2 m4": ("the square of a moment of inertia", "g2 mm4"),
    "kg m2/s": ("an angular momentum", "N m s, mN m s, g mm2/s"),
    "N": ("a force", "mN, lbf"),
    "N m": ("a torque or an energy", "mN m, uN m, J, lbf in"),
    "N/m": ("a stiffness", "N/mm"),
    "T": ("a magnetic field", "nT, uT, G"),
    "A m2": ("a magnetic moment", "mA m2"),
    "A": ("a current", "mA"),
    "W": ("a power", "mW"),
    "kg/m3": ("a density", "g/cm3"),
}
# SI units of arguments of functions that take arrays and no scene, by name
ARGUMENTS = {
    **dict.fromkeys(("moments", "tensor"), "kg m2"),
    **dict.fromkeys(("omega", "omega3", "rates"), "rad s-1"),
    **dict.fromkeys(("theta", "angles"), "rad"),
    **dict.fromkeys(("positions", "offset", "centre"), "m"),
    **dict.fromkeys(("mass", "masses"), "kg"),
    **dict.fromkeys(("momentum", "p_phi", "p_psi"), "kg m2 s-1"),
    **dict.fromkeys(("weight", "torque"), "N m"),
    "energy": "J",
    "t": "s",
}


class Unit(NamedTuple):
    """A unit: its text, the powers of kg, m, s, A and rad, and its factor ratio * pi^turns."""

    text: str
    powers: Powers
    ratio: Fraction = Fraction(1)
    turns: int = 0

    def per(self, other: "Unit") -> "Unit":
        """Return this unit divided by another."""
        powers = tuple(a - b for a, b in zip(self.powers, other.powers, strict=True))
        # five powers, as in both units
        return Unit(self.text, powers, self.ratio / other.ratio, self.turns - other.turns)  # type: ignore[arg-type]

    def squared(self) -> "Unit":
        """Return the unit of a variance."""
        powers = tuple(2 * power for power in self.powers)
        return Unit(self.text, powers, self.ratio**2, 2 * self.turns)  # type: ignore[arg-type]

    @property
    def factor(self) -> float:
        """The number of SI units in this unit, rounded once."""
        return float(self.ratio * _PI**self.turns)

    def is_for(self, units: "Unit") -> bool:
        """Return whether a number in this unit can be converted to `units`."""
        same, optional = self.powers == units.powers, units.powers[0] and not units.powers[4]
        return same or bool(optional and self.powers[:4] == units.powers[:4])

    def convert(self, number: float) -> float:
        """Return a number in SI units; as for text, with one rounding."""
        if self.turns or not np.isfinite(number):
            return number * self.factor
        try:
            return float(Fraction(repr(float(number))) * self.ratio)
        except OverflowError:
            return float("inf") * number

    def convert_array(self, array: Any) -> Any:
        """Return an array of numbers in SI units."""
        with np.errstate(over="ignore", under="ignore"):  # the reader refuses what is not finite
            if self.ratio.numerator == 1 and not self.turns:
                return array / float(self.ratio.denominator)
            return array * self.factor


_WORD = r"[A-Za-z%°]+(?:\^?-?\d)?"
_PRODUCT = rf"{_WORD}(?: {_WORD})*"
_UNIT = re.compile(rf"(1|{_PRODUCT})((?: ?/ ?(?:{_WORD}|\( ?{_PRODUCT} ?\)))*)", re.ASCII)
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹µμ", "-0123456789uu")


def unit_of(text: Any, at: str = "unit", value: Any = None) -> Unit:
    """Return the unit of a text; SceneError that names the nearest right one.

    value : what the error shows, by default the text
    """
    shown = text if value is None else value
    if not isinstance(text, str) or not text.strip() or len(text) > LONGEST:
        rule = 'expected a unit, such as "deg/s", "mm" or "kg m2"'
        raise SceneError(rule, at=at, value=shown)
    plain = text.translate(_SUPERSCRIPTS).replace("**", "^")
    plain = " ".join(re.sub(r"[*·⋅]", " ", plain).split())
    match = _UNIT.fullmatch(plain)
    if match is None:
        rule = f"'{text}' is not a product of powers of units, such as deg/s, g mm2, kg m2/s"
        right = None
        if after := re.fullmatch(rf"([^/()]+)/ ?({_WORD}(?: {_WORD})+)", plain):
            rule = f"'{text}' can be read in two ways: put what is below the / in parentheses"
            right = f"{after[1].strip()}/({after[2]})"
        raise SceneError(rule, at=at, value=shown, nearest=right)
    powers, ratio, turns = [0] * 5, Fraction(1), 0
    for sign, word, power in _factors(*match.groups()):
        if word not in KNOWN:
            raise _no_such_unit(word, text, at, shown)
        factor, pi, each = KNOWN[word]
        ratio, turns = ratio * factor ** (sign * power), turns + sign * power * pi
        powers = [a + sign * power * b for a, b in zip(powers, each, strict=True)]
    return Unit(text.strip(), tuple(powers), ratio, turns)  # type: ignore[arg-type]  # five powers


def unit_named(word: str) -> str | None:
    """Return the unit that a word names, "deg" for "degrees"; None for any other word."""
    try:
        return unit_of(word).text
    except SceneError:
        return _NAMES.get(word.lower().removesuffix("s"))


def _factors(top: str, below: str) -> Iterator[tuple[int, str, int]]:
    """Yield (1 or -1, symbol, power) for each word of a unit."""
    for sign, part in ((1, top), (-1, below)):
        for word in re.finditer(r"([A-Za-z%°]+)\^?(-?\d)?", part):
            symbol = "deg" if word[1] == "°" else word[1]
            yield sign, symbol, int(word[2] or 1)


def _no_such_unit(word: str, text: str, at: str, value: Any) -> SceneError:
    """Return the error for an unknown symbol in a unit."""
    if word in REFUSED:
        return SceneError(REFUSED[word], at=at, value=value)
    symbols = {symbol.lower(): symbol for symbol in KNOWN}
    plain = word.lower().removesuffix("s")
    right = _NAMES.get(plain) or _NAMES.get(word.lower()) or _divided(word)
    right = right or symbols.get(word.lower()) or symbols.get(plain) or nearest(word, KNOWN)
    rule = f"'{word}' is not a unit"
    if right is None:
        rule += f"; known: {', '.join(_SYMBOLS)}, and some with prefixes, such as mm and uN"
    cure = re.sub(rf"(?<![A-Za-z]){re.escape(word)}(?![A-Za-z])", right, text) if right else None
    return SceneError(rule, at=at, value=value, nearest=cure)


def _divided(word: str) -> str | None:
    """Return "N m" for "Nm": a word divided into known symbols, the longest first; else None."""
    for end in range(len(word) - 1, 0, -1):
        if word[:end] in KNOWN:
            rest = word[end:] if word[end:] in KNOWN else _divided(word[end:])
            rest = "m s" if rest == "ms" else rest  # mNms are newton metre seconds
            if rest is not None:
                return f"{word[:end]} {rest}"
    return None


def powers_of(units: str) -> dict[str, int] | None:
    """Return {symbol: power} of SI units, {"kg": 1, "s": -1} of "kg s-1" and {} of "1"; None for a
    text that is not a product of powers."""
    factors = [re.fullmatch(r"(1$|%|[A-Za-zµ°]+)(-?\d+)?", word) for word in units.split()]
    powers = dict[str, int]()
    for factor in factors:
        if factor is None:
            return None
        powers[factor[1]] = powers.get(factor[1], 0) + int(factor[2] or 1)
    return {symbol: power for symbol, power in powers.items() if power and symbol != "1"}


def units_of_powers(powers: Mapping[str, int]) -> str:
    """Return SI units, such as "kg s-1" of {"kg": 1, "s": -1}; the inverse of `powers_of`."""
    words = (f"{symbol}{n if n != 1 else ''}" for symbol, n in powers.items() if n)
    return " ".join(words) or "1"


def units_text(units: str) -> str:
    """Return SI units in the notation of messages: "kg m2/s" for "kg m2 s-1"."""
    powers = powers_of(units) or {}
    top = units_of_powers({symbol: n for symbol, n in powers.items() if n > 0})
    below = units_of_powers({symbol: -n for symbol, n in powers.items() if n < 0})
    return top if below == "1" else f"{top}/({below})" if " " in below else f"{top}/{below}"


def what_is(unit: Unit) -> str:
    """Return what a unit measures, in words: "a length"."""
    return next((what for _, what, _ in _words_for(unit)), "of another kind")


def _words_for(unit: Unit) -> Iterator[tuple[str, str, str]]:
    """Yield (SI, what it is, other units) for units with the dimension of a unit."""
    for text, (what, others) in _WHAT.items():
        if unit_of(text).powers == unit.powers:
            yield text, what, others


def converter(text: Any, units: str, at: str, value: Any = None) -> Unit:
    """Return the unit of a text, relative to SI `units`; SceneError for another dimension.

    >>> round(converter("rpm", "rad s-1", "start.omega").convert(60.0) / np.pi, 12)
    2.0
    """
    unit, wanted = unit_of(text, at, value), unit_of(units, at)
    if not unit.is_for(wanted):
        shown = text if value is None else value
        raise wrong_dimension(units, f"{unit.text} is {what_is(unit)}", unit.text, at, shown)
    return unit.per(wanted)


def wrong_dimension(units: str, what: str, text: str, at: str, value: Any = None) -> SceneError:
    """Return the error for a unit of another dimension. what : "mm is a length" """
    others = next((others for _, _, others in _words_for(unit_of(units))), "").split(", ")
    right = units_text(units)
    if right == "1":
        return SceneError(f"has no unit; {what}", at=at, value=value)
    more = f", or {', '.join(others)}" if any(others) else ""
    rule = f"is in {right}{more}; {what}"
    return SceneError(rule, at=at, value=value, nearest=nearest(text, (right, *others)))


def rule_with_hint(error: RigidmcError) -> str:
    """Return the rule of an error with its nearest right unit, for readers without a place."""
    return error.rule + hint_of(error.nearest)
