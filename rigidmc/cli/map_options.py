"""The options of `rigidmc map` that describe a map."""

from typing import Annotated

import typer

from rigidmc.cli.options import count_option

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
