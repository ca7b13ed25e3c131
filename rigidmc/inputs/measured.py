"""Values with a unit: texts such as "9.81 m/s2", quantities of other packages, and numbers that
look like degrees. `rigidmc.inputs.units` has the units."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.units import (
    LONGEST,
    REFUSED,
    converter,
    unit_of,
    units_of_powers,
    units_text,
    what_is,
    wrong_dimension,
)

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
# not 11/s as 1 1/s, nor 1e999 as 1 e999
_QUANTITY = re.compile(
    rf"({_NUMBER})(?:\s*(?![eE][-+]?\d)([A-Za-zµμ°%].*)|\s+(1\s*/.*))", re.ASCII | re.DOTALL
)
_LIST = re.compile(r"(\[.*\])\s*([A-Za-zµμ°%].*|1\s*/.*)", re.ASCII | re.DOTALL)


@dataclass(frozen=True, eq=False)
class Measured:
    """A value with its unit, until the room that knows its dimension converts it to SI.

    value : numbers, lists, arrays or distributions of them
    """

    value: Any
    unit: str

    def __repr__(self) -> str:
        return f"{self.value!r} {self.unit}"

    def between(self, low: Any, high: Any) -> "Measured":
        """Truncate a distribution with a unit; see `rigidmc.scene.distributions.Distribution`."""
        ends = (in_units(end, self.unit, "between") for end in (low, high))
        return Measured(self.value.between(*ends), self.unit)


def quantity_text(text: str) -> tuple[str, str] | None:
    """Return (number, unit) of a text such as "9.81 m/s2"; None for any other text."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) <= 2 * LONGEST else None
    return (match[1], (match[2] or match[3]).strip()) if match else None


def list_text(text: str) -> tuple[str, str] | None:
    """Return (list, unit) of a text such as "[10, 0, 0] deg/s"; None for any other text."""
    match = _LIST.fullmatch(text.strip())
    return (match[1], match[2].strip()) if match else None


def is_foreign(value: Any) -> bool:
    """Return whether a value is a quantity of pint or astropy; imports neither."""
    kinds = getattr(type(value), "__mro__", ())
    return any(kind.__module__.split(".")[0] in ("pint", "astropy") for kind in kinds) and (
        hasattr(value, "to") and (hasattr(value, "units") or hasattr(value, "unit"))
    )


def from_foreign(value: Any, units: str, at: str) -> Any:
    """Return the numbers of a quantity of pint or astropy in SI `units`; SceneError."""
    unit_text = str(value.units if hasattr(value, "units") else value.unit)
    if "/" not in unit_text and re.search(r"hertz|Hz", unit_text):
        raise SceneError(REFUSED["Hz"], at=at, value=unit_text)
    text = "*".join(re.sub(r"(-?\d)$", r"**\1", word) for word in units.split() if word != "1")
    try:
        converted = value.to(text)
    except Exception:  # each library has its own
        raise wrong_dimension(units, f"{unit_text} does not convert to it", unit_text, at) from None
    return converted.magnitude if hasattr(converted, "magnitude") else converted.value


def as_measured(value: Any) -> Any:
    """Return a quantity of pint or astropy, a text with a unit, or a table { value, unit } as
    Measured; other values unchanged."""
    if isinstance(value, dict) and value.keys() == {"value", "unit"}:
        return Measured(value["value"], value["unit"])
    if isinstance(value, str):
        parts = quantity_text(value)
        return value if parts is None else Measured(float(parts[0]), parts[1])
    if not is_foreign(value):
        return value
    if hasattr(value, "to_base_units"):
        base = value.to_base_units()
        return Measured(base.magnitude, f"{base.units:~C}" or "1")
    return Measured(value.si.value, value.si.unit.to_string() or "1")


def common_unit(values: Mapping[str, Any], at: str) -> tuple[dict[str, Any], str]:
    """Return (numbers in SI, their SI units) of values by name; "" if no value has a unit.

    0 needs no unit. Raises SceneError if values differ in dimension, or only some have a unit.
    """
    measured = {name: as_measured(value) for name, value in values.items()}
    units = {name: unit_of(x.unit, at) for name, x in measured.items() if type(x) is Measured}
    if not units:
        return dict(values), ""
    first = next(iter(units.values()))
    for name, value in measured.items():
        if name not in units and not (isinstance(value, (int, float)) and value == 0.0):
            raise SceneError(f"give {name} a unit, too, such as {first.text}", at=at)
        if name in units and units[name].powers != first.powers:
            given_unit = f"{units[name].text} is {what_is(units[name])}"
            rule = f"numbers of one distribution have one dimension: {given_unit}"
            raise SceneError(f"{rule}, {first.text} is {what_is(first)}", at=at)
    numbers = {
        name: units[name].convert(float(x.value)) if name in units else x
        for name, x in measured.items()
    }
    powers = dict(zip(("kg", "m", "s", "A", "rad"), first.powers, strict=True))
    return numbers, units_of_powers(powers)


def in_units(value: Any, units: str, at: str) -> Any:
    """Return a number, text or quantity in `units`; a number without a unit unchanged."""
    if is_foreign(value):
        number = from_foreign(value, units, at)
        if np.ndim(number):
            raise SceneError("expected one number, not an array", at=at)
        return float(number)
    measured = as_measured(value)
    if type(measured) is not Measured:
        return value
    if isinstance(measured.value, bool) or not isinstance(measured.value, (int, float, np.number)):
        raise SceneError("expected one number beside a unit", at=at, value=measured.value)
    return converter(measured.unit, units, at).convert(float(measured.value))


def numbers_in(units: str, value: Any, at: str) -> Any:
    """Return quantities, texts such as "23 deg", and lists with them as numbers in SI `units`;
    other values unchanged. SceneError for a text without a unit."""
    if is_foreign(value):
        return from_foreign(value, units, at)
    if isinstance(value, str):
        if (parts := quantity_text(value)) is None:
            rule = f'expected a number, or a text with its unit, such as "1 {units_text(units)}"'
            raise SceneError(rule, at=at, value=value)
        return converter(parts[1], units, at, value).convert(float(parts[0]))
    if not isinstance(value, (list, tuple)) or all(type(x) in (float, int) for x in value):
        return value
    return [numbers_in(units, x, at) for x in value]


def degrees_note(angles: Any, what: str, most: int = 2, cure: str = 'write "30 deg"') -> str:
    """Return a note if an angle [rad] exceeds `most` pi, as only degrees do; else "".

    what : the words before the largest angle, such as "theta ="
    """
    sizes = np.abs(np.asarray(angles, dtype=float))
    worst = float(np.max(sizes, where=np.isfinite(sizes), initial=0.0))
    if worst <= most * np.pi * (1.0 + 1e-9):
        return ""
    limit = f"{most} pi" if most > 1 else "pi"
    return f"{what} {worst:g} is more than {limit}: angles are in rad; for degrees {cure}"


def euler_degrees_note(angles: Any, what: str, cure: str, is_shared: bool = True) -> str:
    """Return a note if Euler angles (3, ...) look like degrees; else "".

    The middle angle exceeds pi or another 2 pi, or an angle that all members share is an integer
    above 2.

    what : the words before the angle
    """
    sizes = np.abs(np.asarray(angles, dtype=float))
    if note := degrees_note(sizes[1], what, 1, cure) or degrees_note(sizes, what, 2, cure):
        return note
    integers = sizes[(sizes > 2.0) & (sizes == np.round(sizes))]
    if not (is_shared and integers.size):
        return ""
    return f"{what} {integers[0]:g} is a whole number: angles are in rad; for degrees {cure}"
