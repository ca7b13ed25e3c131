"""Maps: two parameters of a scene against measures, with replicas and an interval per pixel."""

import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.effects import labelled
from rigidmc.engine.layout import STATUSES
from rigidmc.errors import OptionError, RigidmcError, SceneError, SceneWarning
from rigidmc.planning.notes import notes
from rigidmc.planning.plan import prepare
from rigidmc.planning.tolerance.choose import resolved
from rigidmc.runs.simulate import simulate
from rigidmc.scene.amounts import counted
from rigidmc.scene.laws.protocol import Law
from rigidmc.scene.parameters import with_parameter
from rigidmc.scene.quantities import Distribution, Grid, grid
from rigidmc.scene.scene import Scene
from rigidmc.storage.schema import member_variables
from rigidmc.studies.maps.case import Side
from rigidmc.studies.measures import Measure, measure, observing
from rigidmc.version import VERSION

CHUNK = 2**17  # members at once: 20 to 40 MB, and 40 waits for the last block in a map of 4e6
REPLICAS = 16  # members per pixel
RESOLUTION = 128  # pixels per side: 262,144 members with REPLICAS
MOST = 4096  # pixels per side

Resolution = int | tuple[int, int]
Progress = Callable[[int, int], object]


def on_map(scene: Scene, x: Side, y: Side, resolution: Resolution, members: int) -> Scene:
    """The scene whose members are the pixels of a map row by row, `members` per pixel.

    x, y : (parameter, low, high), or (parameter, low, high, True) for even ratios
    resolution : pixels per side, or (columns, rows)
    """
    sides, members = _sides(resolution), counted(members, "members")
    for key, side in (("x", x), ("y", y)):
        if isinstance(side, str) or len(side) not in (3, 4) or not isinstance(side[0], str):
            rule = "expected (parameter, low, high) or (parameter, low, high, True)"
            example = 'such as ("body.moments.1", 0.1, 0.9)'
            raise OptionError("", key, side, f"{rule}, {example}")
    if x[0] == y[0]:
        raise OptionError("", "y", y[0], "is already the parameter of x")
    scene = with_parameter(scene, x[0], _grid("x", x, sides[0], members), "x")
    scene = with_parameter(scene, y[0], _grid("y", y, sides[1], members * sides[0]), "y")
    pixels: Scene = scene.with_run(members=members * sides[0] * sides[1], first=0)
    return pixels


def stability_map(
    scene: Scene,
    x: Side,
    y: Side,
    of: str | Sequence[str],
    resolution: Resolution = RESOLUTION,
    members: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    confidence: float = 0.95,
    **settings: Any,
) -> xr.Dataset:
    """Map a measure over two parameters of a scene.

    Member r of pixel (i, j) is member (j columns + i) members + r of the scene in the attributes,
    to the bit.

    Parameters
    ----------
    scene : Scene
        what is run
    x : tuple
        (parameter, low, high), or (parameter, low, high, True) for even ratios
    y : tuple
        the same for the other side
    of : str or sequence of str
        one measure or several, such as "p(flips >= 1)", see `rigidmc.studies.measures`
    resolution : int or tuple of int, optional
        pixels per side, or (columns, rows)
    members : int, optional
        per pixel; default REPLICAS, or 1 if only x and y differ between members
    threads : int, optional
        number of threads; by default one for each core that the process may use
    progress : callable, optional
        a function of (pixels done, all)
    confidence : float, optional
        of the intervals
    **settings : object
        of `simulate`

    Returns
    -------
    xarray.Dataset
        over y and x: each measure with the ends `_low` and `_high` of its confidence interval;
        `good` members per pixel, `failed` ones, which are flagged in `status` and left out, and
        `none`, for which the body or the start does not exist. A measure is nan in pixels without a
        good member

    Raises
    ------
    OptionError
        for parameters and measures that the scene does not have

    Examples
    --------
    The spin about axis 2 is unstable while I1 < I2 < I3:

    >>> start = rm.Start(omega=(0.01, 1.0, 0.01))
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=start)
    >>> sides = ("body.moments.1", 1.0, 3.0), ("start.omega.1", 0.01, 0.1)
    >>> flips = rm.stability_map(scene, *sides, "p(flips >= 1)", (2, 1), t_end=40.0, dt=0.1)
    >>> flips["p(flips>=1)"].values.tolist()
    [[1.0, 0.0]]
    """
    texts = (of,) if isinstance(of, str) else tuple(of)
    if not texts or not all(isinstance(text, str) for text in texts):
        raise OptionError("", "of", texts, 'expected measures, such as "p(flips >= 1)"')
    if members is None:
        members = REPLICAS if _replicas_differ(on_map(scene, x, y, 1, 1)) else 1
    asked = on_map(scene, x, y, resolution, members)
    asked = asked.with_run(save=settings.pop("save", ()), **settings)
    if asked.run.points != "independent":
        rule = "the interval of a pixel needs independent members"
        raise SceneError("run", "points", asked.run.points, rule)
    asked = observing(asked, texts)
    scene = _with_integrator(asked, threads)
    variables = {name: v.dims for name, v in member_variables(scene, False).items()}
    measures = [measure(text, variables) for text in texts]
    plan = prepare(scene, threads or 1)
    # the plan's own notes warn of large steps, which maps take on purpose
    for note in notes(asked, plan._replace(notes=())):
        warnings.warn(note, SceneWarning, stacklevel=2)
    pixels = _pixels(scene, measures, resolution, members, confidence, threads, progress)
    if not pixels.counts[:2].any():
        rule = f"between {x[1]:g} and {x[2]:g}, and {y[1]:g} and {y[2]:g} of {y[0]} no pixel has a"
        raise OptionError(
            "", "x", x[0], f"{rule} body and a start: moments must obey I_i <= I_j + I_k"
        )
    known = member_variables(scene, plan.carried)
    return _dataset(scene, known, measures, pixels, (x, y), _sides(resolution), confidence)


def _sides(resolution: Resolution) -> tuple[int, int]:
    """(columns, rows) of a map; SceneError if there are none or more than MOST."""
    sides = resolution if isinstance(resolution, (list, tuple)) else (resolution, resolution)
    if len(sides) != 2:
        rule = "expected pixels per side, or (columns, rows)"
        raise OptionError("", "resolution", resolution, rule)
    columns, rows = (counted(side, "resolution", 1, MOST) for side in sides)
    return columns, rows


def _grid(key: str, side: Side, count: int, stride: int) -> Grid:
    """The values of a parameter along a side; SceneError for ends that are not in order."""
    name, low, high, *log = side
    even_ratios = bool(log and log[0])
    try:
        values: Grid = grid(low, high, count, stride, even_ratios)
    except RigidmcError as error:
        rule = f"expected low < high{', both above 0 for even ratios' if even_ratios else ''}"
        rule = error.rule if "whole number" in error.rule else rule
        raise OptionError("", key, f"{name} from {low} to {high}", rule) from None
    return values


def _replicas_differ(scene: Scene) -> bool:
    """Whether the members of a pixel differ: a quantity or the attitude is drawn at random."""
    drawn = any(isinstance(q, (Distribution, Law)) for q in scene.quantities())
    return drawn or isinstance(scene.start.attitude, str)


def _with_integrator(scene: Scene, threads: int | None) -> Scene:
    """The scene with an integrator and a step for its tolerance, chosen over the whole map."""
    if scene.run.integrator != "auto":
        return scene
    run = resolved(scene.coarse(), threads)[0].run
    step = {"dt": run.dt} if run.turn is None else {"turn": run.turn}
    chosen: Scene = scene.with_run(integrator=run.integrator, dtype=run.dtype, **step)
    return chosen


class _Pixels(NamedTuple):
    """What the members of all pixels gave, pixels row by row."""

    intervals: dict[str, NDArray[np.float64]]  # {measure: (3, pixels)}: value, low, high
    counts: NDArray[np.int32]  # (3, pixels): good, failed, none
    members: int  # per pixel
    seconds: float


def _pixels(
    scene: Scene,
    measures: Sequence[Measure],
    resolution: Resolution,
    members: int,
    confidence: float,
    threads: int | None,
    progress: Progress | None,
) -> _Pixels:
    """Integrate the members of all pixels, CHUNK at a time."""
    columns, rows = _sides(resolution)
    pixels, chunk = columns * rows, max(1, CHUNK // members)
    intervals = {one.text: np.full((3, pixels), np.nan) for one in measures}
    counts, began = np.zeros((3, pixels), "i4"), time.perf_counter()
    for low in range(0, pixels, chunk):
        high = min(pixels, low + chunk)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # the notes were given before
            dataset = simulate(scene, members=range(low * members, high * members), threads=threads)
        status = dataset.status.values.reshape(-1, members)
        none, good = status == STATUSES["invalid_input"], status == 0
        counts[:, low:high] = good.sum(1), (~good & ~none).sum(1), none.sum(1)
        for one in measures:
            values = one.values(dataset).reshape(-1, members)
            intervals[one.text][:, low:high] = one.interval(values, good, confidence)
        if progress is not None:
            progress(high, pixels)
    return _Pixels(intervals, counts, members, time.perf_counter() - began)


def _dataset(
    scene: Scene,
    known: dict[str, Any],
    measures: Sequence[Measure],
    pixels: _Pixels,
    sides: tuple[Side, Side],
    shape: tuple[int, int],
    confidence: float,
) -> xr.Dataset:
    """The Dataset of a map; `known` describes the variables of its members."""
    variables, (columns, rows) = {}, shape
    for one in measures:
        attrs = known[one.name].attrs
        units = "1" if one.kind == "p" else attrs.get("units", "1")
        text = f"{one.text}: {attrs.get('long_name', '')}"
        for end, values in zip(("", "low", "high"), pixels.intervals[one.text], strict=True):
            of_end = f", {end} end of its interval of {100 * confidence:g} %" if end else ""
            variables[one.text.replace(" ", "") + (f"_{end}" if end else "")] = (
                ("y", "x"),
                values.reshape(rows, columns),
                {"units": units, "long_name": text + of_end},
            )
    words = {
        "good": "good members",
        "failed": "members that failed",
        "none": "members for which there is no such body or start",
    }
    for (name, text), count in zip(words.items(), pixels.counts, strict=True):
        attrs = {"units": "1", "long_name": text}
        variables[name] = (("y", "x"), count.reshape(rows, columns), attrs)
    coordinates = {}
    for key, side, count in zip(("x", "y"), sides, shape, strict=True):
        log = int(len(side) > 3 and bool(side[3]))
        attrs = {"long_name": side[0], "units": units_of(scene, side[0]), "log": log}
        coordinates[key] = ((key,), _grid(key, side, count, 1).values(), attrs)
    facts = {
        "title": scene.title,
        "source": f"rigidmc {VERSION}",
        "scene": scene.dumps(),
        "members": pixels.members,
        "confidence": confidence,
        "integrator": scene.run.integrator,
        "t_end": scene.run.t_end,
        "seconds": pixels.seconds,
    }
    return xr.Dataset(variables, coordinates, facts)


_UNITS = {
    "angle": "rad",
    "azimuth": "rad",
    "phi": "rad",
    "theta": "rad",
    "psi": "rad",
    "energy": "J",
    "kT": "J",
    "mass": "kg",
    "centre": "m",
    "moments": "kg m2",
    "omega": "rad s-1",
    "momentum": "kg m2 s-1",
}


def units_of(scene: Scene, name: str) -> str:
    """The units of a scene parameter."""
    table, first, *rest = name.split(".")
    if table == "effects":
        effect = dict(labelled(scene.effects))[first]
        units: dict[str, str] = getattr(effect, "units", {})  # a user's effect may have none
        return units.get(rest[0], "1")
    return _UNITS.get(rest[-1] if rest else first) or _UNITS.get(first, "1")
