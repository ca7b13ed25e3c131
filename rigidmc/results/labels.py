"""Words and numbers as people read them on pictures, pages and tables.

A variable has long_name, units and, if its name does not stand for it in a formula, symbol, where
its Dataset is made: `rigidmc.results.variables`, and the `reduce` of a study. Labels of pictures
and heads of tables are made here from these attributes; a test fails where code writes a unit by
hand.
"""

import re
from typing import TYPE_CHECKING

# planning counts too, and lies beside results: it takes this from where it is defined
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
_GREEK = ("theta", "lambda", "nu", "phi", "psi", "omega")  # symbols that a picture shows as letters


def units_text(units: str) -> str:
    """Units of a CF attribute as people write them: "kg m²/s" of "kg m2 s-1", "1/s" of "s-1".

    "" for "1"; units that are no product of powers, which a user's own code may have, as they are.
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
    """A power of a unit: "m²"."""
    return unit if power == 1 else f"{unit}{str(power).translate(_RAISED)}"


def with_units(words: str, units: str) -> str:
    """Words with the units of a CF attribute behind them: "angular velocity [rad/s]"."""
    text = units_text(units)
    return f"{words} [{text}]" if text else words


def axis_label(variable: "xr.DataArray", component: object = "") -> str:
    """What an axis of a picture shows of a variable: "momentum_3 [kg m²/s]", "time [s]"; a Greek
    letter as matplotlib draws it.

    component : its label along the dimension of a vector, "" for a scalar
    """
    symbol = _symbol(variable)
    if symbol in _GREEK:
        low = f"_{{{component}}}" if len(str(component)) > 1 else f"_{component}"
        return with_units(f"$\\{symbol}{low * (component != '')}$", _units(variable))
    return column_head(variable, component)


def label_of(dataset: "xr.Dataset", text: str) -> str:
    """The label of an axis that a text such as "omega[3]" names in a Dataset."""
    name, _, component = text.strip().partition("[")
    return axis_label(dataset[name], component.rstrip("]"))


def long_label(variable: "xr.DataArray") -> str:
    """The long name of a variable with its units: "body.moments.1 [kg m²]"."""
    return with_units(str(variable.attrs["long_name"]), _units(variable))


def column_head(variable: "xr.DataArray", component: object = "") -> str:
    """The same as the head of a column of text: "nu_1 [rad/s]"."""
    low = f"_{component}" if component != "" else ""
    return with_units(f"{_symbol(variable)}{low}", _units(variable))


def value_text(x: float, variable: "xr.DataArray", digits: int = 6) -> str:
    """A value of a variable with its units: "0.3 rad/s"."""
    return f"{x:.{digits}g} {units_text(_units(variable))}".rstrip()


def _symbol(variable: "xr.DataArray") -> str:
    return str(variable.attrs.get("symbol", variable.name))


def _units(variable: "xr.DataArray") -> str:
    return str(variable.attrs.get("units", "1"))
