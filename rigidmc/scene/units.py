"""Conversion of values with units to SI, where they enter a scene; everything behind is SI.

A value with a unit is `Measured` (in a file { value = 10.0, unit = "deg/s" }), a text such as
"10 deg/s", or a quantity of pint or astropy. What a number measures follows from its place.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rigidmc.errors import SceneError
from rigidmc.inputs.amounts import parse_seconds
from rigidmc.inputs.measured import Measured, from_foreign, is_foreign, quantity_text
from rigidmc.inputs.units import Unit, converter, powers_of, units_of_powers
from rigidmc.physics.effects.protocol import Effect, facts, shape
from rigidmc.physics.observables import bare_observables
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Grid

# SI units of the quantities of a scene, by the last word of their path
BODY = {"moments": "kg m2", "tensor": "kg m2", "mass": "kg", "centre": "m", "pivot": "m"}
START = {"omega": "rad s-1", "momentum": "kg m2 s-1", "attitude": "rad"}
# distributions of numbers in radians: in another unit they would lose their period of 2 pi
_PERIODIC = ("vonmises", "vonmises_line", "wrapcauchy")


def in_si(value: Any, units: str | None, at: str) -> Any:
    """Return a value with the numbers that have a unit converted to SI; anything else unchanged.

    units : SI units of the quantity at this place; None if it has none that is known

    Raises SceneError for a unit of another dimension, and for text that begins with a number and
    continues with anything but a unit.
    """
    plain = type(value) is np.ndarray and value.dtype.kind != "O"
    if plain or isinstance(value, (float, int, Distribution, Grid)):
        return value
    if isinstance(value, str):
        return _text_in_si(value, units, at)
    if isinstance(value, Measured):
        return _scaled(_values(value.value, at), _converter(value.unit, units, at), at)
    if is_foreign(value):
        return _plain(from_foreign(value, _known(units, at), at))
    if isinstance(value, (list, tuple)) and not hasattr(value, "_fields"):
        if all(type(part) in (float, int) for part in value):
            return value
        parts = [in_si(part, units, at) for part in value]
        same = all(part is other for part, other in zip(parts, value, strict=True))
        return value if same else parts
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return in_si(value.tolist(), units, at)
    if hasattr(value, "dims") and is_foreign(getattr(value, "data", None)):  # xarray around pint
        return value.copy(data=in_si(value.data, units, at))
    return value


def vector_in_si(value: Any, units: str | None, at: str) -> Any:
    """Return `in_si` of a vector; one text stays, because it cannot be a vector."""
    return value if isinstance(value, str) else in_si(value, units, at)


def _text_in_si(text: str, units: str | None, at: str) -> Any:
    """Return the number of a text such as "10 deg/s"; another text unchanged."""
    parts = quantity_text(text)
    if parts is None:
        return text
    if units == "s":  # as for the settings of a run: "1h30m"
        try:
            return parse_seconds(text, positive=False)
        except ValueError:
            pass
    return _converter(parts[1], units, at, text).convert(float(parts[0]))


def _known(units: str | None, at: str) -> str:
    """Return the SI units of a place; SceneError if they are unknown."""
    if units is None:
        rule = (
            "this number has no known unit, so none can be converted to it; a custom class states"
            ' it as units={"NAME": "N m"}'
        )
        raise SceneError(rule, at=at)
    return units


def _converter(unit: Any, units: str | None, at: str, value: Any = None) -> Unit:
    return converter(unit, _known(units, at), at, value)


def _values(value: Any, at: str) -> Any:
    """Return the value beside a unit; SceneError if it is text, or has a unit of its own."""
    for part in value if isinstance(value, (list, tuple)) else (value,):
        if (
            isinstance(part, Measured)
            or is_foreign(part)
            or (isinstance(part, str) and quantity_text(part))
        ):
            rule = "one number has one unit: here one stands inside, and another beside it"
            raise SceneError(rule, at=at, value=part if isinstance(part, (str, Measured)) else None)
        if isinstance(part, str):
            raise SceneError(_NUMBERS, at=at, value=part)
        if isinstance(part, (list, tuple)):
            _values(part, at)
    return value


_NUMBERS = "expected numbers beside a unit"


def _scaled(value: Any, unit: Unit, at: str) -> Any:
    """Return numbers, arrays, lists, distributions and grids in SI units."""
    if isinstance(value, bool):
        raise SceneError(_NUMBERS, at=at, value=value)
    if isinstance(value, (float, int, np.floating, np.integer)):
        return unit.convert(float(value))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        return unit.convert_array(value)
    if isinstance(value, (list, tuple)):
        return [_scaled(part, unit, at) for part in value]
    if isinstance(value, Distribution):
        _refuse_periodic(value, unit, at)
        return _in_range(value, value.times(unit.factor), at)
    if isinstance(value, Grid):
        return _in_range(value, value.times(unit.factor), at)
    if hasattr(value, "scaling"):  # a vector distribution
        return in_unit(value, unit, at)
    raise SceneError(_NUMBERS, at=at, value=value)


def _in_range(stated: Any, made: Any, at: str) -> Any:
    """Return a distribution or a grid in SI units; SceneError if its numbers overflow, or merge."""
    ends = np.array([0.01, 0.99])
    low, high = (made.low, made.high) if isinstance(made, Grid) else made.ppf(ends)
    if not np.isfinite([low, high]).all() or low == high:
        rule = "is too large or too small in SI units for floating-point numbers"
        raise SceneError(rule, at=at, value=stated.as_table())
    return made


def _refuse_periodic(distribution: Distribution, unit: Unit, at: str) -> None:
    """Raise SceneError for a distribution of angles in radians in another unit."""
    parts = [part for part in distribution.parameters if isinstance(part, Distribution)]
    parts += [part[1] for part in distribution.parameters if isinstance(part, tuple)]
    for law in (distribution, *(part for part in parts if isinstance(part, Distribution))):
        if law.name in _PERIODIC and (unit.turns or unit.ratio != 1):
            rule = f"{law.name} has a period of 2 pi: its numbers are radians; omit the unit"
            raise SceneError(rule, at=at)


def in_unit(distribution: Any, unit: Unit, at: str) -> Any:
    """Return a vector distribution in SI units, from its numbers in a unit of the vector.

    Raises SceneError if its parameters differ in dimension.
    """
    powers = distribution.scaling
    mixed = [name for name in distribution.names() if powers.get(name) not in (1, 2)]
    if mixed:
        fields = ", ".join(distribution.names())
        rule = (
            f"the parameters of {distribution.name}, {fields}, differ in dimension: give each its"
            ' own unit, as in { value = 10.0, unit = "deg/s" }'
        )
        raise SceneError(rule, at=at)
    changed = {
        name: _scaled(
            _values(getattr(distribution, name), f"{at}.{distribution.name}.{name}"),
            unit if powers[name] == 1 else unit.squared(),
            at,
        )
        for name in distribution.names()
    }
    return replace(distribution, **changed)


def parameters_in_si(distribution: Any, at: str) -> Any:
    """Return a vector distribution with each parameter that has a unit converted to SI; SceneError.

    at : its path, such as "start.omega"
    """
    units = parameter_units(distribution, {**BODY, **START}.get(at.rpartition(".")[2], "1"))
    shipped = type(distribution).__module__.startswith("rigidmc.")
    changed = {}
    for name, value in distribution.as_dict().items():
        path = f"{at}.{distribution.name}.{name}"
        converted = in_si(value, units.get(name, "1" if shipped else None), path)
        if converted is not value:
            changed[name] = converted
    if distribution.name == "uncertain_inertia" and len(changed.get("covariance", "123456")) != 6:
        rule = "a covariance of tensor, centre and mass has several units: give it in SI units"
        raise SceneError(rule, at=f"{at}.{distribution.name}.covariance")
    return replace(distribution, **changed) if changed else distribution


def parameter_units(distribution: Any, vector: str) -> dict[str, str]:
    """Return {parameter: SI units} of a distribution of vectors in SI units `vector`."""
    of = {1: vector, 2: squared(vector), "energy": "J"}
    by_power: dict[str, str] = {
        name: of[power] for name, power in distribution.scaling.items() if power in of
    }
    return {**by_power, **distribution.units}


def size_units(key: str) -> str:
    """Return the SI units of an argument of a solid, or of particles."""
    return {"mass": "kg", "masses": "kg", "density": "kg m-3"}.get(key, "m")


def squared(units: str) -> str:
    """Return the square of SI units: "rad2 s-2" of "rad s-1"."""
    return units_of_powers(
        {symbol: 2 * power for symbol, power in (powers_of(units) or {}).items()}
    )


def effect_in_si(effect: Effect, name: str) -> Effect:
    """Return an effect with each parameter that has a unit converted to SI; SceneError.

    name : of its table
    """
    units: Mapping[str, str] = facts(effect).units
    values = [
        (in_si if shape(effect, key) is None else vector_in_si)(
            value, units.get(key), f"effects.{name}.{key}"
        )
        for key, value in zip(effect._fields, effect, strict=True)
    ]
    same = all(a is b for a, b in zip(values, effect, strict=True))
    return effect if same else type(effect)(*values)


def observable_in_si(observable: Any, word: str) -> Any:
    """Return an observable with each parameter that has a unit converted to SI; SceneError.

    word : its name in a scene
    """
    shipped = "1" if type(observable).__module__.startswith("rigidmc.") else None
    units: Mapping[str, str] = getattr(observable, "parameter_units", {})
    if word == "histogram":
        of = bare_observables().get(str(observable.of).split("[")[0])
        shipped = None if of is None else shipped
        units = {} if of is None else dict.fromkeys(("low", "high"), of.units)
    changed = {}
    for name, value in zip(observable._fields, observable, strict=True):
        if name in units or isinstance(value, Measured) or is_foreign(value):
            converted = in_si(value, units.get(name, shipped), f"observables.{word}.{name}")
            if converted is not value:
                changed[name] = converted
    return observable._replace(**changed) if changed else observable


def angles_in_si(value: Any, at: str) -> Any:
    """Return Euler angles in radians; SceneError for a quaternion or a matrix with a unit.

    Rows of angles with a unit are returned by columns, because 3 x 3 numbers may be a matrix.
    """
    angles = vector_in_si(value, "rad", at)
    if angles is value or hasattr(angles, "dims"):
        return angles
    several = isinstance(angles, np.ndarray) or all(isinstance(x, (list, tuple)) for x in angles)
    rows = np.asarray(angles) if several else None
    if rows is not None and rows.ndim == 2 and rows.shape[1] == 3:
        return tuple(np.ascontiguousarray(rows.T))
    if len(angles) != 3 or (rows is not None and rows.ndim != 1):
        rule = "only Euler angles [phi, theta, psi] have a unit; a quaternion has none"
        raise SceneError(rule, at=at)
    return angles


def _plain(value: Any) -> Any:
    """Return a scalar of NumPy, or an integer, as a float."""
    return float(value) if isinstance(value, (np.floating, np.integer, int)) else value
