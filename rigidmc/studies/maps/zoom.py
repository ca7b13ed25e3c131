"""A part of a map, drawn anew."""

import xarray as xr

from rigidmc.errors import OptionError
from rigidmc.files.outputs import Path
from rigidmc.studies.maps.catalogue import with_theory
from rigidmc.studies.maps.question import Resolution, Whole, columns_and_rows
from rigidmc.studies.maps.stability_map import Prepared, Progress, mapped, prepared
from rigidmc.studies.maps.stored import asked_of

Ends = tuple[float, float]


def zoom_map(
    source: Path | xr.Dataset,
    x: Ends,
    y: Ends,
    threads: int | None = None,
    progress: Progress | None = None,
    allow_code: bool = False,
    resolution: Resolution | None = None,
) -> xr.Dataset:
    """Draw a part of a map anew: other ends of its sides, and the same scene, settings, measures
    and members of a pixel.

    Parameters
    ----------
    source : path_like or xarray.Dataset
        a map: a netCDF file, a run directory or a Dataset
    x : tuple of float
        (low, high) in the units of the map
    y : tuple of float
        the same for the other side
    threads : int, optional
        number of threads; by default one for each core that the process may use
    progress : callable, optional
        a function of (members done, all)
    allow_code : bool, optional
        whether to run the Python files of a user's own effects
    resolution : int or tuple of int, optional
        pixels per side, or (columns, rows); by default those of the map

    Returns
    -------
    xarray.Dataset
        as of `stability_map`

    Raises
    ------
    OptionError
        for ends that are not in order, that lie outside the map, or of which the scene can have
        none
    FileError
        for a source that is no map

    Examples
    --------
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)))
    >>> sides = ("body.moments.1", 1.0, 3.0), ("start.omega.2", 0.1, 1.0)
    >>> whole = rm.stability_map(scene, *sides, "p(flips >= 1)", 2, t_end=1.0)
    >>> rm.zoom_map(whole, (1.0, 1.5), (0.5, 1.0)).x.values.tolist()
    [1.125, 1.375]
    """
    ready = zoomed(source, x, y, threads, allow_code, resolution)
    return with_theory(mapped(ready, threads, progress), ready.question.name)


def zoomed(
    source: Path | xr.Dataset,
    x: Ends,
    y: Ends,
    threads: int | None = None,
    allow_code: bool = False,
    resolution: Resolution | None = None,
) -> Prepared:
    """A part of a map before its first step; the arguments and errors are those of `zoom_map`."""
    asked, scene = asked_of(source, allow_code)
    across, upwards = _side("x", asked.x, x), _side("y", asked.y, y)
    asked = asked._replace(x=across, y=upwards)
    if resolution is not None:
        columns, rows = columns_and_rows(resolution)
        asked = asked._replace(columns=columns, rows=rows)
    return prepared(asked, scene, threads, save=scene.run.save)


def _side(key: str, side: Whole, ends: Ends) -> Whole:
    """A side with other ends; OptionError if they are no two numbers of the side."""
    try:
        low, high = map(float, ends)
    except (TypeError, ValueError):
        raise OptionError("", key, ends, f"expected (low, high) of {side[0]}") from None
    if low < side[1] or high > side[2]:
        rule = f"is no part of the map, whose {side[0]} goes from {side[1]:g} to {side[2]:g}"
        raise OptionError("", key, f"{low:g} to {high:g}", rule)
    return side[0], low, high, side[3]
