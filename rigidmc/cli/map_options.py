"""The options of `rigidmc map` that describe a map.

What `rigidmc map` is asked: the options that describe a new map.
"""

import errno
import os
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rigidmc.cli.app import load_scene
from rigidmc.cli.directories import Ways
from rigidmc.cli.options import count_option
from rigidmc.errors import OptionError, unknown

if TYPE_CHECKING:
    from rigidmc.studies.stability_map.question import Borders
    from rigidmc.studies.stability_map.study import Prepared

Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME|SCENE|FILE|MAP/",
        help="A map of the package (rigidmc map list), a TOML file, a shipped scene; or a map that"
        " exists, as a file (.nc) or a run directory.",
    ),
]
Listed = Annotated[
    str | None,
    typer.Argument(metavar="[NAME]", help="With `rigidmc map list`: the map to explain."),
]
Across = Annotated[
    str | None,
    typer.Option(
        metavar="KEY=LOW:HIGH",
        help="Scene parameter across, e.g. body.moments.1=0:1; with :log in even ratios.",
    ),
]
Upwards = Annotated[
    str | None, typer.Option(metavar="KEY=LOW:HIGH", help="Scene parameter upwards.")
]
Third = Annotated[
    str | None,
    typer.Option(
        metavar="KEY=LOW:HIGH", help="A third scene parameter: a stack of maps, one for each value."
    ),
]
Layers = Annotated[
    int | None, count_option("--layers", help="Number of maps in the stack; by default 6.")
]
Adaptive = Annotated[
    bool,
    typer.Option(
        "--adaptive",
        help="Compute a coarse grid, and more pixels where neighbours are of different classes or"
        " an interval holds the border between two; the others show one nearby.",
    ),
]
Border = Annotated[
    list[float],
    typer.Option(
        metavar="NUMBER",
        help="With --adaptive: a value of the first measure between two classes; may be repeated."
        " By default 0.5 of a share, 4 of a MEGNO, else eight equal parts of its range.",
    ),
]
Measures = Annotated[
    list[str],
    typer.Option(
        metavar="MEASURE",
        help='What a pixel shows: "p(flips >= 1)", "mean(megno)", "quantile(flip_wait, 0.9)";'
        " may be repeated.",
    ),
]
Resolution = Annotated[
    int | None,
    count_option(
        "--resolution",
        help="Pixels along each side; by default 256 for a map of the package, 128 for a scene.",
    ),
]
Members = Annotated[
    int | None,
    count_option(
        "--members",
        help="Members of a pixel; by default the map's own, or 16, or 1 if only x and y differ.",
    ),
]
Zoom = Annotated[
    str | None,
    typer.Option(
        metavar="LOW:HIGH,LOW:HIGH",
        help="Draw this part of a map that exists anew, across and upwards in its units.",
    ),
]


OWN = ("x", "y", "z", "layers", "of", "resolution", "members", "border")


class Request(NamedTuple):
    """The options of `rigidmc map` that describe a new map, None or empty where none is given."""

    name: str
    x: str | None
    y: str | None
    of: list[str]
    resolution: int | None
    members: int | None
    settings: list[str]
    run: dict[str, Any]
    zoom: str | None = None
    z: str | None = None
    layers: int | None = None
    adaptive: bool = False
    border: list[float] = []

    def draws(self, ways: Ways) -> bool:
        """Whether a map that exists is to be drawn as it is; OptionError for an option of a new map
        beside one that exists, and for a part of a map that does not."""
        from rigidmc.studies.stability_map.stored import is_map

        exists = is_map(self.name)
        if self.zoom is not None and not exists:
            rule = f"is a part of a map that exists, and {self.name} is no file or directory of one"
            raise OptionError(rule, at="zoom", value=self.zoom)
        own = {key: getattr(self, key) for key in OWN}
        given = {**own, "adaptive": self.adaptive or None, "set": self.settings, **self.run}
        if self.zoom is not None:  # which is a new map of the same question
            del given["resolution"]
        for key, value in {**given, **({} if self.zoom else ways._asdict())}.items():
            if exists and value not in (None, []):
                rule = f"is for a new map, and {self.name} is one that exists"
                raise OptionError(rule, at=key, value=value)
        if self.border and not self.adaptive:
            raise OptionError("goes with --adaptive", at="border", value=self.border)
        of_shards = {name: value for name, value in ways._asdict().items() if "shard" in name}
        if self.adaptive and any(of_shards.values()):
            name, value = next((name, value) for name, value in of_shards.items() if value)
            rule = "the shards of an adaptive map follow from its pixels, and each level needs all"
            raise OptionError(rule, at=name, value=value)
        return exists and self.zoom is None

    def of_package(self) -> bool:
        """Whether a map of the package is asked for; OptionError if neither it nor a map of a scene
        is described completely."""
        from rigidmc.scene.library import shipped
        from rigidmc.studies.stability_map.case import MAPS

        plain = not (self.x or self.y or self.of or self.settings)
        if self.name in MAPS and plain:
            if self.z is not None:
                rule = (
                    "a map of the package has two sides; give a scene with --x, --y, --z and --of"
                )
                raise OptionError(rule, at="z", value=self.z)
            return True
        if plain and self.name not in shipped():
            if self.name.lower().endswith((".nc", ".toml", "/")) and not os.path.exists(self.name):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), self.name)
            raise unknown("map", MAPS, at="map", value=self.name, error=OptionError)
        missing = [
            key for key, value in (("x", self.x), ("y", self.y), ("of", self.of)) if not value
        ]
        if missing and self.name in MAPS:
            rule = (
                "a map of the package has its own x, y, measures and scene; give --resolution,"
                " --members, --dt and the like, or a scene with all of --x, --y and --of"
            )
            raise OptionError(rule, at="map", value=self.name)
        if missing:
            own = ", ".join(MAPS)
            rule = (
                f"is missing: a map of a scene needs --x, --y and --of; maps of the package: {own}"
            )
            raise OptionError(rule, at=", ".join(missing))
        return False

    def sides(self) -> int:
        """Pixels per side."""
        from rigidmc.studies.stability_map import case
        from rigidmc.studies.stability_map import study as stability_map

        if self.resolution is not None:
            return self.resolution
        return case.RESOLUTION if self.of_package() else stability_map.RESOLUTION

    def size(self) -> int:
        """Bytes of the file of the map; 0 for a part of a map, which is as large as that."""
        from rigidmc.studies.stability_map.question import LAYERS

        if self.zoom is not None:
            return 0
        layers = 1 if self.z is None else self.layers or LAYERS
        return 8 * max(self.sides(), 1) ** 2 * layers * (4 + 3 * len(self.of))

    def prepared(self, threads: int | None, allow_code: bool) -> "Prepared":
        """The map before its first step."""
        from rigidmc.studies.stability_map import case
        from rigidmc.studies.stability_map import study as stability_map
        from rigidmc.studies.stability_map.question import adapted, question
        from rigidmc.studies.stability_map.stored import zoomed

        if self.zoom is not None:
            return zoomed(self.name, *_part(self.zoom), threads, allow_code, self.resolution)
        if self.of_package():
            first = case.MAPS[self.name]().of[0]
            of_case = self.name, self.sides(), self.members, threads, self._borders(first)
            return case.prepared_case(*of_case, **self.run)
        scene = load_scene(self.name, self.settings, allow_code)
        across, upwards = _side(self.x or "", "x"), _side(self.y or "", "y")
        third = None if self.z is None else _side(self.z, "z")
        replicas = self.members
        if replicas is None:
            replicas = stability_map.replicas_of(scene, across, upwards)
        sizes = self.sides(), replicas, third, self.layers
        asked = adapted(question(across, upwards, self.of, *sizes), self._borders(self.of[0]))
        return stability_map.prepare_map(asked, scene, **self.run)

    def _borders(self, first: str) -> "bool | Borders":
        """Whether the map is adaptive, or borders between the classes of its first measure."""
        return ((first, tuple(self.border)),) if self.border else self.adaptive


def _side(text: str, key: str) -> tuple[str, float, float, bool]:
    """(parameter, low, high, whether in even ratios) of KEY=LOW:HIGH[:log]; OptionError."""
    name, equals, ends = text.partition("=")
    parts = ends.split(":")
    try:
        low, high = float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        low = high = float("nan")
    if not equals or len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]) or low != low:
        rule = "expected KEY=LOW:HIGH or KEY=LOW:HIGH:log, e.g. body.moments.1=0.1:0.9"
        raise OptionError(rule, at=key, value=text)
    return name.strip(), low, high, len(parts) == 3


def _part(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """((low, high), (low, high)) of LOW:HIGH,LOW:HIGH; OptionError."""
    try:
        x, y = (side.split(":") for side in text.split(","))
        (left, right), (low, high) = map(float, x), map(float, y)
    except ValueError:
        rule = "expected the ends across and upwards, LOW:HIGH,LOW:HIGH, e.g. 0.1:0.2,1:1.5"
        raise OptionError(rule, at="zoom", value=text) from None
    return (left, right), (low, high)
