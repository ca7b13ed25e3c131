"""Labels and numbers as text for pictures, pages and tables.

The code that makes a Dataset gives each variable its long_name, units and, if its symbol in
formulas differs from its name, a symbol: `rigidmc.results.variables`, and the `reduce` of a study.
This module makes labels of pictures and heads of tables from these attributes; a test fails if
other code writes a unit by hand. Pictures write names as symbols or plain words, and angles in
degrees; rates stay in rad/s, and errors in rad.
"""

import math
import re
from typing import TYPE_CHECKING, Any

from rigidmc.inputs.amounts import count_text

# planning, which does not import results, imports it from where it is defined
from rigidmc.inputs.units import powers_of

if TYPE_CHECKING:  # commands start without xarray, which takes 0.4 to 0.6 s
    import xarray as xr

__all__ = [
    "axis_label",
    "column_head",
    "count_text",
    "in_degrees",
    "in_symbols",
    "label_of",
    "long_label",
    "units_text",
    "value_text",
    "with_degrees",
    "with_units",
]

_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
# names of parameters, variables and their components in a text, but not of functions
_NAME = re.compile(r"[A-Za-z]\w*(?:\.\w+)*(?:\[\w+\])?(?![\w(])")
_SYMBOLS = {
    "omega": "ω", "momentum": "L", "moments": "I", "tensor": "I", "attitude": "q",
    "theta": "θ", "phi": "φ", "psi": "ψ", "lambda": "λ", "nu": "ν", "mu": "μ", "gamma": "γ",
    "t_end": "end of the run",
}  # fmt: skip
_INDEXED = ("ω", "L", "I", "q", "λ", "ν", *"₀₁₂₃₄₅₆₇₈₉")  # an index of other words is a number
_ENDS = {  # of names of results, which a picture writes first
    "max": "largest", "min": "smallest", "mean": "mean", "variance": "variance of",
    "first": "first", "last": "last", "final": "final",
}  # fmt: skip


def units_text(units: str) -> str:
    """Write units of a CF attribute for people: "kg m²/s" for "kg m2 s-1", "1/s" for "s-1".

    "" for "1". Units of custom code that are not a product of powers stay as they are.
    """
    powers = powers_of(units)
    if not powers:
        return units if powers is None else ""
    above = [_power(unit, power) for unit, power in powers.items() if power > 0]
    below = [_power(unit, -power) for unit, power in powers.items() if power < 0]
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


def in_symbols(text: str) -> str:
    """Return a text of a picture, with symbols or plain words in place of the names of parameters,
    variables and components; of the start, with (0).

    >>> in_symbols("start.omega.3"), in_symbols("p(omega_max[1] >= 2)")
    ('ω₃(0)', 'p(largest ω₁ ≥ 2)')
    """
    return _NAME.sub(_symbol_of, text).replace(">=", "≥").replace("<=", "≤")


def _symbol_of(name: re.Match[str]) -> str:
    """Return the symbol or the plain words of a name."""
    head, *words = re.split(r"[.\[]", name[0].removesuffix("]"))
    if head.startswith("start_"):
        head, words = "start", [head.removeprefix("start_"), *words]
    if head not in ("start", "body", "effects", "run") or not words:
        words = [head, *words]
    if words[0] == "attitude" and words[1:] and words[1] in _SYMBOLS:
        words = words[1:]  # an Euler angle
    parts = list[str]()
    for word in words:
        if word.isdigit() and parts:
            parts[-1] += word.translate(_LOWERED) if parts[-1][-1] in _INDEXED else f" {word}"
        else:
            parts.append(_words(word))
    if head == "start":
        parts[0] += "(0)"
    return " of ".join(reversed(parts))


def _words(name: str) -> str:
    """Return a name without dots as a symbol or as words: "largest energy drift"."""
    before, _, end = name.rpartition("_")
    if before and end in _ENDS:
        return f"{_ENDS[end]} {_words(before)}"
    return _SYMBOLS.get(name, name.replace("_", " "))


def in_degrees(values: Any, units: str) -> tuple[Any, str]:
    """Return (values, units) as pictures show them: angles in degrees, others as they are."""
    return (values * (180.0 / math.pi), "deg") if units == "rad" else (values, units)


def with_degrees(dataset: "xr.Dataset", *names: str) -> "xr.Dataset":
    """Return a Dataset with some variables as pictures show them, see `in_degrees`."""
    for name in names:
        variable = dataset[name]
        values, units = in_degrees(variable.values, _units(variable))
        new = {name: (variable.dims, values, {**variable.attrs, "units": units})}
        dataset = dataset.assign_coords(new) if name in dataset.coords else dataset.assign(new)
    return dataset


def axis_label(variable: "xr.DataArray", component: object = "") -> str:
    """Return the axis label of a variable: "L₃ [kg m²/s]", "time [s]".

    component : label of the component of a vector, "" for a scalar
    """
    inside = f"[{component}]" if component != "" else ""
    return with_units(in_symbols(f"{_symbol(variable)}{inside}"), _units(variable))


def label_of(dataset: "xr.Dataset", text: str) -> str:
    """Return the axis label for a text such as "omega[3]" in a Dataset."""
    name, _, component = text.strip().partition("[")
    return axis_label(dataset[name], component.rstrip("]"))


def long_label(variable: "xr.DataArray") -> str:
    """Return the long name of a variable with its units: "angular velocity [rad/s]"; the symbol of
    a parameter, "I₁ [kg m²]"."""
    words = str(variable.attrs["long_name"])
    return with_units(words if " " in words else in_symbols(words), _units(variable))


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
