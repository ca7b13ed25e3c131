"""The maps of the package. A new map is one file in `cases` and one line below."""

from collections.abc import Callable
from typing import Any

import xarray as xr

from rigidmc.errors import OptionError, unknown
from rigidmc.studies.maps.case import MapCase
from rigidmc.studies.maps.cases.damped_axis import damped_axis
from rigidmc.studies.maps.cases.disturbance import disturbance
from rigidmc.studies.maps.cases.growth import growth
from rigidmc.studies.maps.cases.heavy_chaos import heavy_chaos
from rigidmc.studies.maps.cases.intermediate_axis import intermediate_axis
from rigidmc.studies.maps.cases.kapitza import kapitza
from rigidmc.studies.maps.cases.kovalevskaya import kovalevskaya
from rigidmc.studies.maps.cases.sleeping_top import sleeping_top
from rigidmc.studies.maps.stability_map import stability_map

MAPS: dict[str, Callable[[], MapCase]] = {
    "intermediate_axis": intermediate_axis,
    "growth": growth,
    "disturbance": disturbance,
    "damped_axis": damped_axis,
    "sleeping_top": sleeping_top,
    "heavy_chaos": heavy_chaos,
    "kovalevskaya": kovalevskaya,
    "kapitza": kapitza,
}


def case_map(
    name: str,
    resolution: int | tuple[int, int] = 256,
    members: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    **settings: Any,
) -> xr.Dataset:
    """The Dataset of one of MAPS, with the variables of theory.

    settings : of the run, which replace those of the map if not None;  others : see `stability_map`
    """
    if name not in MAPS:
        raise unknown("", "map", name, "map", MAPS, OptionError)
    case = MAPS[name]()
    given = {key: value for key, value in settings.items() if value is not None}
    standard = {
        key: value for key, value in case.settings.items() if key != "dt" or "turn" not in given
    }
    ds = stability_map(
        case.scene,
        case.x,
        case.y,
        case.of,
        resolution,
        case.members if members is None else members,
        threads,
        progress,
        **standard | given,
    )
    for key, (values, attrs) in case.derived(ds).items():
        ds[key] = (("y", "x"), values, attrs)
    ds.attrs |= {"title": case.title, "map": name, "theory": case.source}
    return ds
