"""The setting `every`, the times of saves: a time between saves, increasing times, or a number of
saves per turn such as "50/turn"."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from rigidmc.errors import RigidmcError, SceneError, nearest
from rigidmc.inputs.amounts import parse_seconds
from rigidmc.inputs.arrays import as_plain_arrays
from rigidmc.inputs.labelled import is_labelled
from rigidmc.inputs.measured import Measured, as_measured, in_units
from rigidmc.inputs.units import converter, rule_with_hint

SaveTimes = float | tuple[float, ...] | str
EVERY = 'expected a time, increasing times, or saves per turn such as "50/turn"'
MOST_TIMES = 100_000  # the text of a scene lists them: 2 MB
_PER_TURN = re.compile(r"([-+.\w]*)\s*/\s*([A-Za-z]*)", re.ASCII)


def parse_every(value: Any) -> SaveTimes:
    """Return a time between saves [s], increasing times [s], or saves per turn as "N/turn".

    Raises ValueError for anything else; SceneError with the nearest right text for "50/trun".
    """
    if isinstance(value, str) and "/" in value:
        return _per_turn(value)
    if isinstance(value, str) and "," in value:
        value = value.strip().removeprefix("[").removesuffix("]").split(",")
    try:
        times = _listed(value)
    except SceneError as error:
        raise ValueError(rule_with_hint(error)) from None
    return seconds_of(value) if times is None else _increasing(times)


def seconds_of(value: Any, positive: bool = True) -> float:
    """Return a time [s] from a number, a text or a quantity with a unit; ValueError."""
    if not isinstance(value, str):  # "1h30m" is a time, too, and m are minutes
        try:
            value = in_units(value, "s", "run")
        except SceneError as error:
            raise ValueError(rule_with_hint(error)) from None
    return parse_seconds(value, positive)


def settled(every: SaveTimes | None) -> float | tuple[float, ...] | None:
    """Return save times in seconds: `rigidmc.planning.saves.settle_saves` replaced the others."""
    assert not isinstance(every, str), "save times are not settled"
    return every


def _per_turn(text: str) -> str:
    match = _PER_TURN.fullmatch(text.strip())
    try:
        number = float(match[1]) if match else math.nan
    except ValueError:
        number = math.nan
    if match is None or not 0.0 < number < math.inf:
        raise ValueError(f"{EVERY}; N of N/turn is a number above 0")
    if match[2] != "turn":
        right = f"{number:g}/turn"
        near = right if nearest(match[2], ("turn",)) or match[2] in ("rev", "rad") else None
        raise SceneError(EVERY, at="run.every", value=text, nearest=near)
    return f"{number!r}/turn".replace(".0/", "/")


def _listed(value: Any) -> Sequence[Any] | None:
    """Return the elements of a list or an array of times, in seconds if it has a unit; None for
    one value."""
    value, unit = value if isinstance(value, str) else as_measured(value), None
    if isinstance(value, Measured):
        value, unit = value.value, converter(value.unit, "s", "run")
    value = as_plain_arrays(np.asarray(value) if is_labelled(value) else value, "run.every")
    if isinstance(value, np.ndarray) and value.ndim != 1:
        if value.ndim == 0:
            return None
        raise SceneError(f"has shape {value.shape}; times are a list", at="run.every")
    if not isinstance(value, (list, tuple, np.ndarray)):
        return None
    return list(value) if unit is None else [unit.convert(float(x)) for x in value]


def _increasing(times: Sequence[Any]) -> tuple[float, ...]:
    if not 0 < len(times) <= MOST_TIMES:
        raise ValueError(f"expected 1 to {MOST_TIMES:,} times; or give one time between saves")
    seconds = tuple(seconds_of(time, positive=False) for time in times)
    if seconds[0] < 0.0:
        raise ValueError("expected times from 0 on")
    if wrong := next((i for i in range(1, len(seconds)) if not seconds[i - 1] < seconds[i]), 0):
        rule = f"times must increase, but {seconds[wrong]:g} s follows {seconds[wrong - 1]:g} s"
        raise ValueError(rule)
    return seconds


def read_every(value: Any, at: str, error: type[RigidmcError] = SceneError) -> SaveTimes:
    """Return `parse_every` of an argument named `at`; raises `error`."""
    try:
        return parse_every(value)
    except RigidmcError as wrong:
        raise error(wrong.rule, at=at, value=value, nearest=wrong.nearest) from None
    except ValueError as wrong:
        raise error(str(wrong), at=at, value=value) from None
