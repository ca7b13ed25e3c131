"""Ranges of scene parameters, such as the sides of a map: KEY=LOW:HIGH."""

from typing import Any

from rigidmc.errors import OptionError, SceneError
from rigidmc.inputs.units import as_measured, in_units, quantity_text
from rigidmc.scene.parameters import parameter_names, unit_at
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.options import Option

Side = tuple[str, float, float] | tuple[str, float, float, bool]  # parameter, low, high[, log]
Whole = tuple[str, float, float, bool]  # a side with all entries


def read_side(value: Any, at: str) -> Any:
    """Parse KEY=LOW:HIGH[:log] into (parameter, low, high, whether log-spaced); OptionError.

    A unit beside HIGH alone is the unit of both. `whole_side` converts ends with units, and
    checks values that are not text.
    """
    if not isinstance(value, str):
        return value
    name, equals, ends = value.partition("=")
    parts = ends.split(":")
    try:
        low, high = map(_end_of, parts[:2])
    except ValueError:
        low = high = float("nan")
    if isinstance(high, str) and isinstance(low, float):
        low = f"{low!r} {as_measured(high).unit}"
    if not equals or len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]) or low != low:
        rule = "expected KEY=LOW:HIGH or KEY=LOW:HIGH:log, e.g. body.moments.1=0.1:0.9"
        raise OptionError(rule, at=at, value=value)
    return name.strip(), low, high, len(parts) == 3


def _end_of(text: str) -> float | str:
    """Return a number, or a text with a unit; ValueError."""
    return text if quantity_text(text) else float(text)


def whole_side(key: str, side: Side, scene: Scene | None) -> Whole:
    """Return a side with all entries, its ends in SI units; OptionError."""
    if isinstance(side, str) or len(side) not in (3, 4) or not isinstance(side[0], str):
        rule = "expected (parameter, low, high) or (parameter, low, high, True)"
        example = 'such as ("body.moments.1", 0.1, 0.9)'
        raise OptionError(f"{rule}, {example}", at=key, value=side)
    name, low, high, *log = side
    if scene is not None and name in parameter_names(scene.model):
        try:
            low, high = (in_units(end, unit_at(scene.model, name), key) for end in (low, high))
        except SceneError as error:
            raise OptionError(
                error.rule, at=key, value=error.value, nearest=error.nearest
            ) from None
    return name, low, high, bool(log and log[0])


# option for a parameter and its range
SIDE = Option(
    "", metavar="KEY=LOW:HIGH", type=str, kind="tuple or str", reader=read_side, is_new=True
)
