"""rigidmc view: a result, a scene or a map as one HTML page that needs nothing else."""

import os
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigidmc.cli.common import about, app, load_scene, opened, reported, written
from rigidmc.cli.options import AllowCode, Force, Set, completing, time_option
from rigidmc.cli.panels import LOOK
from rigidmc.errors import OptionError
from rigidmc.files.outputs import refuse_existing
from rigidmc.scene.shipped import shipped

if TYPE_CHECKING:
    import xarray as xr

MEMBERS = 500  # of a scene that is run for its page

Source = Annotated[
    str,
    typer.Argument(
        metavar="FILE|RUN|SCENE",
        help="A result (.nc, .zarr), a run directory, a map, or a scene.",
        autocompletion=completing(shipped),
    ),
]
Shown = Annotated[
    str | None,
    typer.Option(
        "--members", metavar="LIST", help="Members to show, e.g. 0,7,42; by default four."
    ),
]
Page = Annotated[
    str | None,
    typer.Option(
        "-o", "--output", metavar="FILE", help="Page to write (.html); by default NAME.html."
    ),
]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


@app.command(rich_help_panel=LOOK)
def view(
    source: Source,
    members: Shown = None,
    output: Page = None,
    until: Annotated[
        float | None, time_option("--until", help="End of the motion that is shown.")
    ] = None,
    settings: Set = [],  # noqa: B006
    show: Open = False,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    """Write one HTML page in which members turn in space beside their momentum spheres, with a
    slider, omega, Euler angles and drifts. The page works without a network."""
    with reported(), about(source):
        from rigidmc.views.viewer.page import check_k3d
        from rigidmc.views.viewer.page import view as page_of

        chosen = _indices(members)
        stem = os.path.splitext(os.path.basename(source.rstrip(os.sep)))[0]
        name = output or f"{stem}.html"
        refuse_existing(name, force, "pages")
        check_k3d()
        dataset = _result(source, settings, allow_code)
        page_of(dataset, name, chosen, until, force, allow_code)
        dataset.close()
        print(*written([name]))
        if show:
            webbrowser.open(Path(name).absolute().as_uri())


def _indices(text: str | None) -> list[int] | None:
    """The indices in a list such as 0,7,42; OptionError."""
    if text is None:
        return None
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        rule = "expected indices separated by commas, e.g. 0,7,42"
        raise OptionError("", "--members", text, rule) from None


def _map(source: str) -> "xr.Dataset | None":
    """The map in a file or a run directory; None for everything else, which `opened` tries."""
    from rigidmc.studies.maps.stored import is_map, open_map

    return open_map(source) if is_map(source) else None


def _result(source: str, settings: list[str], allow_code: bool) -> "xr.Dataset":
    """A result, or that of a scene whose first MEMBERS members are run now."""
    if os.path.isdir(source) or source.lower().endswith((".nc", ".zarr")):
        if settings:
            raise OptionError("", "--set", settings[0], "is for scenes; a result has been computed")
        found = _map(source)
        return found if found is not None else opened(source, allow_code)
    from rigidmc.runs.simulate import simulate

    scene = load_scene(source, settings, allow_code)
    few = min(scene.run.members, MEMBERS)
    return simulate(scene.with_run(members=few, save=("momentum",), keep="full"), progress=True)
