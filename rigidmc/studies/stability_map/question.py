"""The request of a map: two parameters of a scene, the measures, and the members of each pixel; and
the record of a shipped map, see `cases`."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray
from pydantic import TypeAdapter

from rigidmc.errors import FileError, OptionError, RigidmcError
from rigidmc.inputs.amounts import read_count
from rigidmc.scene.model import Model
from rigidmc.scene.parameters import with_parameters
from rigidmc.scene.quantities import Grid, grid
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.options import Side, Whole, whole_side

MOST = 4096  # pixels per side
LAYERS, MOST_LAYERS = 6, 64

Resolution = int | tuple[int, int]
Borders = tuple[tuple[str, tuple[float, ...]], ...]  # (measure, values between its classes)


class MapRequest(NamedTuple):
    """The definition of a map.

    Pixel (i, j) has the number p = i columns + j, or p = (k rows + i) columns + j in layer k of a
    stack. Its member r is member r pixels + p of the scene: the members of an unfinished run are
    spread over all pixels, and more members are more replicas of each pixel.

    x, y : (parameter, low, high, whether log-spaced);  z : of the layers, None without a stack
    of : the measures, see `rigidmc.statistics.measures`
    columns, rows, layers : pixels along x, y and z;  replicas : members per pixel
    confidence : of the intervals
    name : of a shipped map, or ""
    borders : of an adaptive map, see `rigidmc.studies.stability_map.refine`; None if all pixels are
        computed
    """

    x: Whole
    y: Whole
    of: tuple[str, ...]
    columns: int
    rows: int
    replicas: int
    confidence: float = 0.95
    name: str = ""
    z: Whole | None = None
    layers: int = 1
    borders: Borders | None = None

    @property
    def sides(self) -> dict[str, Whole]:
        """The sides by dimension, the slowest first."""
        return {**({} if self.z is None else {"z": self.z}), "y": self.y, "x": self.x}

    @property
    def shape(self) -> tuple[int, ...]:
        """Pixels along the sides, in that order."""
        return (self.layers,) * (self.z is not None) + (self.rows, self.columns)

    @property
    def pixels(self) -> int:
        return self.columns * self.rows * self.layers

    @property
    def members(self) -> int:
        return self.pixels * self.replicas

    def grids(self) -> dict[str, Grid]:
        """Return the values of the members along each side; OptionError for unordered ends."""
        strides = {"x": 1, "y": self.columns, "z": self.columns * self.rows}
        counts = zip(self.sides.items(), self.shape, strict=True)
        return {key: _grid(key, side, count, strides[key]) for (key, side), count in counts}

    def of_scene(self, scene: Scene) -> Scene:
        """Return the scene with the members of the map; OptionError for unknown parameters."""
        grids, model = self.grids(), scene.model
        for key in reversed(grids):
            model = with_parameters(model, {self.sides[key][0]: grids[key]}, key)
        return scene.with_model(model).with_run(members=self.members, first=0)

    def text(self) -> str:
        """Return the request as JSON, for the facts of a run directory."""
        return json.dumps(self._asdict())


_QUESTION = TypeAdapter(MapRequest)


def make_request(
    x: Side,
    y: Side,
    of: str | Sequence[str],
    resolution: Resolution,
    replicas: int,
    z: Side | None = None,
    layers: int | None = None,
    model: Model | None = None,
    adaptive: bool | Borders = False,
    **more: Any,
) -> MapRequest:
    """Return the MapRequest from user input; OptionError for bad sides, measures and sizes.

    model : its parameters convert ends with a unit to SI
    adaptive : whether the map is adaptive; or its borders, in place of the default ones
    """
    texts = (of,) if isinstance(of, str) else tuple(of)
    if not texts or not all(isinstance(text, str) for text in texts):
        raise OptionError('expected measures, such as "p(flips >= 1)"', at="of", value=texts)
    across, upwards = whole_side("x", x, model), whole_side("y", y, model)
    if x[0] == y[0]:
        raise OptionError("is already the parameter of x", at="y", value=y[0])
    if z is None and layers is not None:
        raise OptionError("requires a third parameter: give z", at="layers", value=layers)
    if z is not None:
        more["z"] = whole_side("z", z, model)
        more["layers"] = read_count(LAYERS if layers is None else layers, "layers", 1, MOST_LAYERS)
        if z[0] in (x[0], y[0]):
            raise OptionError("is already the parameter of x or y", at="z", value=z[0])
    if adaptive is not False:
        more["borders"] = () if adaptive is True else adaptive
    sizes = *columns_and_rows(resolution), read_count(replicas, "members")
    return MapRequest(across, upwards, texts, *sizes, **more)


def columns_and_rows(resolution: Resolution) -> tuple[int, int]:
    """Return the pixels across and upwards of a resolution; OptionError."""
    shape = resolution if isinstance(resolution, (list, tuple)) else (resolution, resolution)
    if len(shape) != 2:
        rule = "expected pixels per side, or (columns, rows)"
        raise OptionError(rule, at="resolution", value=resolution)
    columns, rows = (read_count(side, "resolution", 1, MOST) for side in shape)
    return columns, rows


def read_stored_request(text: str, path: str) -> MapRequest:
    """Read the MapRequest in the facts of a run directory; FileError if it is not one."""
    try:
        request = _QUESTION.validate_json(text)
        least = min(request.columns, request.rows, request.layers, request.replicas)
        if request.pixels > MOST**2 or least < 1 or (request.z is None and request.layers != 1):
            raise ValueError("impossible sizes")
    except ValueError:  # also of pydantic
        rule = "contains no readable map"
        raise FileError(rule, at="map", file=path) from None
    return request


def _grid(key: str, side: Whole, count: int, stride: int) -> Grid:
    """Return the values of a parameter along a side; OptionError for unordered ends."""
    name, low, high, log = side
    try:
        values: Grid = grid(low, high, count, stride, log)
    except RigidmcError as error:
        rule = f"expected low < high{', both above 0 for log spacing' if log else ''}"
        rule = error.rule if "whole number" in error.rule else rule
        raise OptionError(rule, at=key, value=f"{name} from {low} to {high}") from None
    return values


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
