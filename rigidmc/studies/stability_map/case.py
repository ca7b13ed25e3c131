"""The definition of a shipped map; `cases` has these maps."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray

from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.options import Side
from rigidmc.studies.stability_map.question import Borders


class MapTheory(NamedTuple):
    """A variable of a map in addition to its measures: theory, or combined measures.

    text : its long name
    values : (Dataset of the measures, x and y of each pixel) -> values (rows, columns)
    """

    units: str
    text: str
    values: Callable[[xr.Dataset, NDArray[Any], NDArray[Any]], NDArray[Any]]


class MapCase(NamedTuple):
    """A map: its scene and settings, x and y, the measures, and the theory.

    x, y : (parameter, low, high[, log]), see `make_request`
    of : the measures, see `rigidmc.statistics.measures`;  members : per pixel
    settings : of the run;  source : of the theory
    derived : {name: more variables}
    shown : the variable that the picture shows in colour
    contours : (variable, levels, legend) of the lines drawn over it
    labels : of the x axis, the y axis, and of the colours if the long name of `shown` is too long;
        a picture adds the units
    ticks : {value: word} if `shown` has only a few values
    borders : between the classes of an adaptive map, see `rigidmc.studies.stability_map.refine`
    """

    title: str
    scene: Scene
    x: Side
    y: Side
    of: tuple[str, ...]
    members: int
    shown: str
    labels: tuple[str, ...]
    settings: dict[str, Any]
    source: str = ""
    derived: Mapping[str, MapTheory] = {}
    contours: tuple[str, tuple[float, ...], str] | None = None
    ticks: Mapping[float, str] = {}
    borders: Borders = ()
