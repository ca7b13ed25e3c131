"""The options of `fit`, and how they are read."""

from typing import Any

import numpy as np

from rigidmc.errors import OptionError
from rigidmc.studies.fit.posterior import SAMPLERS
from rigidmc.studies.fit.problem import LOSSES
from rigidmc.studies.fit.records import read_columns_option
from rigidmc.studies.fit.streams import NUISANCES
from rigidmc.studies.framework.options import Names, Options, Words, confidence_option, option


class PictureOptions(Options):
    """The options of the pictures of `fit`."""

    picture: str = option(
        "data",
        "kind of picture: data, with the fitted motion and residuals, or corner",
        metavar="KIND",
    )
    record: int | None = option(None, "the only record to draw, from 1; by default the first four")


def read_intervals(value: Any, at: str) -> list[tuple[float, float]]:
    """Return intervals of time [s] of texts FROM:TO, or of pairs of numbers; OptionError."""
    found = list[tuple[float, float]]()
    for one in (value,) if isinstance(value, str) else value:
        try:
            low, high = map(float, one.split(":") if isinstance(one, str) else one)
        except (TypeError, ValueError):
            low = high = np.nan
        if not low < high:
            raise OptionError("expected FROM:TO in seconds, e.g. 0.9:1.4", at=at, value=one)
        found.append((low, high))
    return found


class FitOptions(Options):
    """The options of `fit`."""

    data: Any = option(
        None,
        "the measurements: a CSV file, a mapping of columns, a DataFrame, or a Dataset",
        missing="is missing: the table of the measurements",
        reader=lambda value, name: value,
        metavar="DATA",
        type=Words,
        is_argument=True,
        kind="path_like or table",
        is_new=True,
    )
    free: Names | None = option(
        None,
        "parameters to fit, e.g. body.moments,start.omega,effects.gravity.g",
        missing="is missing: the parameters to fit, e.g. body.moments,start.omega",
        is_new=True,
    )
    columns: Any = option(
        None,
        "columns of an observable and their unit, e.g. omega=gx,gy,-gz:deg/s",
        metavar="NAME=A,B,C[:UNIT]",
        type=Words,
        reader=read_columns_option,
        kind="mapping or str",
        is_new=True,
    )
    time: str | None = option(None, "column of the times, NAME or NAME:UNIT", is_new=True)
    rate: float | None = option(
        None, "samples a second, of a table without times", above=0.0, unit="1/s", is_new=True
    )
    split: str | None = option(
        None, "column whose values are separate records of the body", is_new=True
    )
    between: Words | None = option(
        None,
        "interval of times that is a record, e.g. 0.9:1.4",
        metavar="FROM:TO",
        reader=read_intervals,
        is_new=True,
    )
    noise: Any = option(
        None,
        "standard deviation of the readings, e.g. omega=0.002; by default from third differences",
        metavar="NAME=NUMBER",
        type=Words,
        reader=lambda value, name: value,
        kind="mapping or str",
        is_new=True,
    )
    nuisances: Names | None = option(
        None,
        f"unknown properties of the sensors, of {', '.join(NUISANCES)}",
        metavar="NAME,...",
        is_new=True,
    )
    loss: str = option(
        "linear",
        "cost of outliers: squares (linear, by default), or less (huber, cauchy)",
        words=LOSSES,
        is_new=True,
    )
    each: Names | None = option(
        None, "free parameters that differ between records, beside [start]", is_new=True
    )
    trials: int = option(100, "first guesses; by default 100", is_new=True)
    posterior: str | None = option(
        None, "draw the posterior by emcee, or for many parameters by nuts", words=SAMPLERS
    )
    draws: int = option(1000, "draws of each chain; by default 1000")
    chains: int = option(4, "independent chains; by default 4", least=2)
    pool: Names | None = option(
        None, "parameters of --each that records draw from one distribution", metavar="NAME,..."
    )
    confidence: float = confidence_option("confidence of the intervals")
