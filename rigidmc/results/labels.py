"""Labels and numbers as text for pictures, pages and tables.

The code that makes a Dataset gives each variable its long_name, units and, if its symbol in
formulas differs from its name, a symbol: `rigidmc.results.variables`, and the `reduce` of a study.
This module makes labels of pictures and heads of tables from these attributes; a test fails if
other code writes a unit by hand.
"""

import re
from typing import TYPE_CHECKING

# planning, which does not import results, imports it from where it is defined
from rigidmc.scene.amounts import count_text

if TYPE_CHECKING:  # commands start without xarray, which takes 0.4 to 0.6 s
    import xarray as xr

__all__ = [
    "axis_label",
    "column_head",
    "count_text",
    "label_of",
    "long_label",
    "units_text",
    "value_text",
    "with_units",
]

_FACTOR = re.compile(r"([A-Za-zµ°%]+)(-?\d+)?")
_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_GREEK = ("theta", "lambda", "nu", "phi", "psi", "omega")  # drawn as Greek letters in pictures


def units_text(units: str) -> str:
    """Write units of a CF attribute for people: "kg m²/s" for "kg m2 s-1", "1/s" for "s-1".

    "" for "1". Units of custom code that are not a product of powers stay as they are.
    """
    factors = [_FACTOR.fullmatch(word) for word in units.split()]
    if units == "1" or not all(factors):
        return "" if units == "1" else units
    powers = [(one[1], int(one[2] or 1)) for one in factors if one is not None]
    above = [_power(unit, power) for unit, power in powers if power > 0]
    below = [_power(unit, -power) for unit, power in powers if power < 0]
    if not below:
        return " ".join(above)
    over = below[0] if len(below) == 1 else f"({' '.join(below)})"
    return f"{' '.join(above) or '1'}/{over}"


def _power(unit: str, power: int) -> str:
    """Write a power of a unit: "m²"."""
    return unit if power == 1 else f"{unit}{str(power).translate(_RAISED)}"


def with_units(words: str, units: str) -> str:
    """Append the units of a CF attribute to words: "angular velocity [rad/s]"."""
    text = units_text(units)
    return f"{words} [{text}]" if text else words


def axis_label(variable: "xr.DataArray", component: object = "") -> str:
    """Return the axis label of a variable: "momentum_3 [kg m²/s]", "time [s]"; Greek letters in
    the notation of matplotlib.

    component : label of the component of a vector, "" for a scalar
    """
    symbol = _symbol(variable)
    if symbol in _GREEK:
        low = f"_{{{component}}}" if len(str(component)) > 1 else f"_{component}"
        return with_units(f"$\\{symbol}{low * (component != '')}$", _units(variable))
    return column_head(variable, component)


def label_of(dataset: "xr.Dataset", text: str) -> str:
    """Return the axis label for a text such as "omega[3]" in a Dataset."""
    name, _, component = text.strip().partition("[")
    return axis_label(dataset[name], component.rstrip("]"))


def long_label(variable: "xr.DataArray") -> str:
    """Return the long name of a variable with its units: "body.moments.1 [kg m²]"."""
    return with_units(str(variable.attrs["long_name"]), _units(variable))


def column_head(variable: "xr.DataArray", component: object = "") -> str:
    """Return the head of a table column for a variable: "nu_1 [rad/s]"."""
    low = f"_{component}" if component != "" else ""
    return with_units(f"{_symbol(variable)}{low}", _units(variable))


def value_text(x: float, variable: "xr.DataArray", digits: int = 6) -> str:
    """Write a value of a variable with its units: "0.3 rad/s"."""
    return f"{x:.{digits}g} {units_text(_units(variable))}".rstrip()


def _symbol(variable: "xr.DataArray") -> str:
    return str(variable.attrs.get("symbol", variable.name))


def _units(variable: "xr.DataArray") -> str:
    return str(variable.attrs.get("units", "1"))
