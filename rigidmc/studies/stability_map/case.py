"""The definition of a shipped map, and the list of these maps: a new one is a function in a file of
`cases` and one line in `_FILES`."""

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import OptionError, unknown
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.sides import Side
from rigidmc.studies.stability_map.compute import MapRun, Progress, prepare_map, run_map
from rigidmc.studies.stability_map.question import (
    Borders,
    Resolution,
    make_request,
    with_borders,
)

Derived = dict[str, tuple[NDArray[Any], dict[str, str]]]  # {name: (values, attributes)}


def nothing(ds: xr.Dataset) -> Derived:
    """Return no variables in addition to the measures."""
    return {}


class MapCase(NamedTuple):
    """A map: its scene and settings, x and y, the measures, and the theory.

    x, y : (parameter, low, high[, log]), see `make_request`
    of : the measures, see `rigidmc.statistics.measures`;  members : per pixel
    settings : of the run;  source : of the theory
    derived : function of the Dataset that returns more variables: theory, and combined measures
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
    derived: Callable[[xr.Dataset], Derived] = nothing
    contours: tuple[str, tuple[float, ...], str] | None = None
    ticks: Mapping[float, str] = {}
    borders: Borders = ()


_FILES = {  # {map: file in `cases` with a function of this name that returns its MapCase}
    "intermediate_axis": "intermediate_axis",
    "growth": "growth",
    "disturbance": "disturbance",
    "damped_axis": "damped_axis",
    "sleeping_top": "sleeping_top",
    "heavy_chaos": "heavy_chaos",
    "chaos_share": "chaos_share",
    "kovalevskaya": "heavy_chaos",
    "kapitza": "kapitza",
    "hyperion_chaos": "hyperion_chaos",
}
RESOLUTION = 256  # pixels per side


def _made(name: str) -> MapCase:
    """Return a map by its name; import its file only now, because that file imports this one."""
    case: MapCase = getattr(import_module(f"{__package__}.cases.{_FILES[name]}"), name)()
    return case


MAPS: dict[str, Callable[[], MapCase]] = {name: partial(_made, name) for name in _FILES}


def case_map(
    name: str,
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    threads: int | None = None,
    progress: Progress = None,
    adaptive: bool | Borders = False,
    **settings: Any,
) -> xr.Dataset:
    """Compute one of MAPS; return its Dataset with the variables of theory.

    settings : run settings of the map to replace, if not None;  others : see `stability_map`
    """
    ready = prepared_case(name, resolution, members, adaptive, **settings)
    return with_theory(run_map(ready, threads, progress), name)


def prepared_case(
    name: str,
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    adaptive: bool | Borders = False,
    **settings: Any,
) -> MapRun:
    """Prepare one of MAPS, before its first step; arguments as in `case_map`."""
    if name not in MAPS:
        raise unknown("map", MAPS, at="map", value=name, error=OptionError)
    case = MAPS[name]()
    given = {key: value for key, value in settings.items() if value is not None}
    standard = {
        key: value for key, value in case.settings.items() if key != "dt" or "turn" not in given
    }
    members = case.members if members is None else members
    request = make_request(case.x, case.y, case.of, resolution, members, name=name)
    request = with_borders(request, case.borders if adaptive is True else adaptive)
    return prepare_map(request, case.scene, **standard | given)


def with_theory(ds: xr.Dataset, name: str) -> xr.Dataset:
    """Return a shipped map with its theory and title; any other map unchanged."""
    if name not in MAPS:
        return ds
    case = MAPS[name]()
    for key, (values, attrs) in case.derived(ds).items():
        ds[key] = (("y", "x"), values, attrs)
    ds.attrs |= {"title": case.title, "map": name, "theory": case.source}
    return ds
