"""Units of mass-property texts: "( grams * square millimeters )", "kg m^2", "lb in²"."""

import re

from rigidmc.errors import FileError
from rigidmc.inputs.units import unit_of

Unit = float
MASS, LENGTH, INERTIA = "mass", "length", "inertia"

_MASSES = {
    "kg": ("kg", "kgs", "kilogram", "kilograms"),
    "g": ("g", "gram", "grams"),
    "mg": ("mg", "milligram", "milligrams"),
    "t": ("t", "tonne", "tonnes"),
    "lb": ("lb", "lbs", "lbm", "pound", "pounds"),
    "oz": ("oz", "ounce", "ounces"),
    "slug": ("slug", "slugs"),
}
_LENGTHS = {
    "m": ("m", "meter", "meters", "metre", "metres"),
    "cm": ("cm", "centimeter", "centimeters", "centimetre", "centimetres"),
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "in": ("in", "inch", "inches"),
    "ft": ("ft", "foot", "feet"),
}
MASSES = {word: unit_of(unit).factor for unit, words in _MASSES.items() for word in words}
LENGTHS = {word: unit_of(unit).factor for unit, words in _LENGTHS.items() for word in words}


def find_unit(text: str, kind: str, at: str, file: str) -> Unit:
    """Return the factor to SI of the unit in a heading or behind a number.

    kind : MASS, LENGTH or INERTIA

    The unit stands in the last brackets, "( millimeters )", or behind the number. FileError for no
    unit, an unknown unit, or a unit of another kind.
    """
    inside = re.findall(r"\(([^()]*)\)", text.replace("(Using", "").replace("(using", ""))
    unit = next((text for text in reversed(inside) if _words(text)), text)
    words = _words(unit)
    masses = [MASSES[word] for word in words if word in MASSES]
    lengths = [LENGTHS[word] for word in words if word in LENGTHS]
    wanted = {MASS: (1, 0), LENGTH: (0, 1), INERTIA: (1, 1)}[kind]
    squares = "square" in words or "2" in unit or "²" in unit
    fits = (len(masses), len(lengths)) == wanted and squares == (kind == INERTIA)
    are_known = set(words) <= {*MASSES, *LENGTHS, "square", "per"}
    if not fits or not are_known or "per" in words:
        example = {MASS: "grams", LENGTH: "millimeters", INERTIA: "grams * square millimeters"}
        rule = f"expected a unit of {kind}, such as ( {example[kind]} )"
        raise FileError(rule, at=at, value=unit.strip(), file=file)
    if kind == INERTIA:
        return masses[0] * lengths[0] ** 2
    return masses[0] if kind == MASS else lengths[0]


def _words(text: str) -> list[str]:
    """Return the words of a unit, in small letters, without powers."""
    return re.findall(r"[a-z]+", text.lower())
