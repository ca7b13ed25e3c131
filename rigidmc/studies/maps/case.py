"""What a map of the package consists of."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray

from rigidmc.scene.scene import Scene
from rigidmc.studies.maps.question import Borders, Side

Derived = dict[str, tuple[NDArray[Any], dict[str, str]]]  # {name: (values, attributes)}


def nothing(ds: xr.Dataset) -> Derived:
    """No variables beside the measures."""
    return {}


class MapCase(NamedTuple):
    """A map: its scene and settings, x and y, the measures, and what theory says.

    x, y : (parameter, low, high[, log]), see `question`
    of : the measures, see `rigidmc.studies.measures`;  members : per pixel
    settings : of the run;  source : of the theory
    derived : function of the Dataset that returns more variables: theory, and combined measures
    shown : the variable that the picture shows as colours
    contours : (variable, levels, legend) of the lines drawn over it
    labels : of the x axis, the y axis, and of the colours if the long name of `shown` is too long
    ticks : {value: word} if `shown` takes a few values only
    borders : between the classes of an adaptive map, see `rigidmc.studies.maps.refine`
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
    derived: Callable[[xr.Dataset], Derived] = nothing
    contours: tuple[str, tuple[float, ...], str] | None = None
    ticks: Mapping[float, str] = {}
    borders: Borders = ()
