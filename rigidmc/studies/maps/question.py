"""What a map asks: two parameters of a scene, the measures, and which members belong to a pixel."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from rigidmc.effects import labelled
from rigidmc.errors import FileError, OptionError, RigidmcError
from rigidmc.scene.amounts import counted
from rigidmc.scene.parameters import with_parameter
from rigidmc.scene.quantities import Grid, grid
from rigidmc.scene.scene import Scene

MOST = 4096  # pixels per side

Side = tuple[str, float, float] | tuple[str, float, float, bool]  # parameter, low, high[, log]
Resolution = int | tuple[int, int]


class Question(NamedTuple):
    """What is mapped.

    Pixel (i, j) has the number p = i columns + j, and its member r is member r pixels + p of the
    scene: the members of a run that has not ended are spread over all pixels, and more members
    are more replicas of each.

    x, y : (parameter, low, high, whether in even ratios)
    of : the measures, see `rigidmc.studies.measures`
    columns, rows : pixels along x and y;  replicas : members of a pixel
    confidence : of the intervals
    name : of the map of the package, or ""
    """

    x: tuple[str, float, float, bool]
    y: tuple[str, float, float, bool]
    of: tuple[str, ...]
    columns: int
    rows: int
    replicas: int
    confidence: float = 0.95
    name: str = ""

    @property
    def pixels(self) -> int:
        return self.columns * self.rows

    @property
    def members(self) -> int:
        return self.pixels * self.replicas

    def grids(self) -> tuple[Grid, Grid]:
        """The values of x and y of the members; OptionError for ends that are not in order."""
        x, y = (
            _grid(key, side, count, stride)
            for key, side, count, stride in (
                ("x", self.x, self.columns, 1),
                ("y", self.y, self.rows, self.columns),
            )
        )
        return x, y

    def of_scene(self, scene: Scene) -> Scene:
        """The scene whose members are those of the map; OptionError for unknown parameters."""
        x, y = self.grids()
        scene = with_parameter(with_parameter(scene, self.x[0], x, "x"), self.y[0], y, "y")
        whole: Scene = scene.with_run(members=self.members, first=0)
        return whole

    def text(self) -> str:
        """The question as JSON, for the facts of a run directory."""
        return json.dumps(self._asdict())


_QUESTION = TypeAdapter(Question)


def question(
    x: Side, y: Side, of: str | Sequence[str], resolution: Resolution, replicas: int, **more: Any
) -> Question:
    """The Question of a user; OptionError for sides, measures and sizes that are none."""
    texts = (of,) if isinstance(of, str) else tuple(of)
    if not texts or not all(isinstance(text, str) for text in texts):
        raise OptionError("", "of", texts, 'expected measures, such as "p(flips >= 1)"')
    across, upwards = _whole_side("x", x), _whole_side("y", y)
    if x[0] == y[0]:
        raise OptionError("", "y", y[0], "is already the parameter of x")
    shape = resolution if isinstance(resolution, (list, tuple)) else (resolution, resolution)
    if len(shape) != 2:
        rule = "expected pixels per side, or (columns, rows)"
        raise OptionError("", "resolution", resolution, rule)
    columns, rows = (counted(side, "resolution", 1, MOST) for side in shape)
    return Question(across, upwards, texts, columns, rows, counted(replicas, "members"), **more)


def _whole_side(key: str, side: Side) -> tuple[str, float, float, bool]:
    """A side with all its parts; OptionError."""
    if isinstance(side, str) or len(side) not in (3, 4) or not isinstance(side[0], str):
        rule = "expected (parameter, low, high) or (parameter, low, high, True)"
        example = 'such as ("body.moments.1", 0.1, 0.9)'
        raise OptionError("", key, side, f"{rule}, {example}")
    name, low, high, *log = side
    return name, low, high, bool(log and log[0])


def stored_question(text: str, path: str) -> Question:
    """The Question in the facts of a run directory; FileError if it is none."""
    try:
        found = _QUESTION.validate_json(text)
        if found.pixels > MOST**2 or min(found.columns, found.rows, found.replicas) < 1:
            raise ValueError("impossible sizes")
    except ValueError:  # also of pydantic
        rule = "there is no map that can be read"
        raise FileError("", "map", None, rule, file=path) from None
    return found


def _grid(key: str, side: tuple[str, float, float, bool], count: int, stride: int) -> Grid:
    """The values of a parameter along a side; OptionError for ends that are not in order."""
    name, low, high, log = side
    try:
        values: Grid = grid(low, high, count, stride, log)
    except RigidmcError as error:
        rule = f"expected low < high{', both above 0 for even ratios' if log else ''}"
        rule = error.rule if "whole number" in error.rule else rule
        raise OptionError("", key, f"{name} from {low} to {high}", rule) from None
    return values


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
