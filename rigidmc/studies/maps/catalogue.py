"""The maps of the package. A new map is one file in `cases` and one line below."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import xarray as xr

from rigidmc.errors import OptionError, unknown
from rigidmc.studies.maps.case import MapCase
from rigidmc.studies.maps.question import Borders, Resolution, adapted, question
from rigidmc.studies.maps.stability_map import Prepared, Progress, mapped, prepared

_FILES = (  # in `cases`; each has a function of the same name that returns its MapCase
    "intermediate_axis",
    "growth",
    "disturbance",
    "damped_axis",
    "sleeping_top",
    "heavy_chaos",
    "chaos_share",
    "kovalevskaya",
    "kapitza",
)
RESOLUTION = 256  # pixels per side
MAPS: dict[str, Callable[[], MapCase]] = {
    name: getattr(import_module(f"rigidmc.studies.maps.cases.{name}"), name) for name in _FILES
}


def case_map(
    name: str,
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    adaptive: bool | Borders = False,
    **settings: Any,
) -> xr.Dataset:
    """The Dataset of one of MAPS, with the variables of theory.

    settings : of the run, which replace those of the map if not None;  others : see `stability_map`
    """
    ready = prepared_case(name, resolution, members, threads, adaptive, **settings)
    return with_theory(mapped(ready, threads, progress), name)


def prepared_case(
    name: str,
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    threads: int | None = None,
    adaptive: bool | Borders = False,
    **settings: Any,
) -> Prepared:
    """One of MAPS before its first step; the arguments are those of `case_map`."""
    if name not in MAPS:
        raise unknown("", "map", name, "map", MAPS, OptionError)
    case = MAPS[name]()
    given = {key: value for key, value in settings.items() if value is not None}
    standard = {
        key: value for key, value in case.settings.items() if key != "dt" or "turn" not in given
    }
    members = case.members if members is None else members
    asked = question(case.x, case.y, case.of, resolution, members, name=name)
    asked = adapted(asked, case.borders if adaptive is True else adaptive)
    return prepared(asked, case.scene, threads, **standard | given)


def with_theory(ds: xr.Dataset, name: str) -> xr.Dataset:
    """A map of the package with its theory and title; the map itself if its name is "" or none."""
    if name not in MAPS:
        return ds
    case = MAPS[name]()
    for key, (values, attrs) in case.derived(ds).items():
        ds[key] = (("y", "x"), values, attrs)
    ds.attrs |= {"title": case.title, "map": name, "theory": case.source}
    return ds
