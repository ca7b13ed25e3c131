"""Pages of HTML in one file: how they are put together, and the body that they draw."""

import base64
import html
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.physics.effects.field import UniformField
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.protocol import Effect
from rigidmc.scene.quantities import is_shared
from rigidmc.views.surfaces import TONES, Surface

WEB = "rigidmc.views.web"
SHARED = ("common.js", "stage.js", "drawings.js", "charts.js")


class Page:
    """An HTML page, which a notebook shows in a frame."""

    def __init__(self, text: str) -> None:
        self.text = text

    def _repr_html_(self) -> str:
        inside = html.escape(self.text, quote=True)
        return f'<iframe srcdoc="{inside}" style="width:100%;height:780px;border:0"></iframe>'


def page_text(
    package: str, name: str, title: str, about: str, data: Mapping[str, Any], scripts: Sequence[str]
) -> str:
    """Return the text of a page.

    package : with NAME.html, the content of the page, and NAME.css;  about : a line below the title
    data : for the scripts, as JSON;  scripts : files of the package, after the shared ones; the
    worker of a page is the file worker.js
    """
    of_page, shared = files(package), files(WEB)
    worker = of_page.joinpath("worker.js")
    parts = {
        "TITLE": html.escape(title),
        "ABOUT": html.escape(about),
        "STYLE": "".join(
            path.read_text(encoding="utf-8")
            for path in (shared.joinpath("page.css"), of_page.joinpath(f"{name}.css"))
        ),
        "MAIN": of_page.joinpath(f"{name}.html").read_text(encoding="utf-8"),
        "DATA": script_json(data),
        "WORKER": worker.read_text(encoding="utf-8") if worker.is_file() else "",
        "SCRIPT": "".join(
            path.read_text(encoding="utf-8")
            for path in (
                *(shared.joinpath(script) for script in SHARED),
                *(of_page.joinpath(script) for script in scripts),
            )
        ),
    }
    return fill_template(shared.joinpath("page.html").read_text(encoding="utf-8"), parts)


def script_json(data: Any) -> str:
    """Return data as JSON for a script of a page."""
    # no "<": it could end the script, or begin a comment that hides the end of the script
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def fill_template(text: str, parts: Mapping[str, str]) -> str:
    """Fill the places @@NAME@@ of a page."""
    # by pieces, because the inserted text may contain a placeholder
    pieces = text.split("@@")
    return "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))


def shape_data(surface: Surface) -> dict[str, Any]:
    """Return the triangles of a surface, and the tone of each, for a page."""
    corners = surface.corners[surface.faces].astype("<f4")
    return {
        "corners": base64.b64encode(corners.tobytes()).decode(),
        "faces": surface.tones.tolist(),
    }


def tones_data() -> list[list[int]]:
    """Return TONES as red, green and blue."""
    return [[int(tone[k : k + 2], 16) for k in (1, 3, 5)] for tone in TONES]


def pulls_data(effects: Iterable[Effect]) -> list[tuple[str, list[float]]]:
    """Return (name, direction) of gravity and of uniform fields, which a page draws as arrows."""
    pulls = list[tuple[str, list[float]]]()
    for effect in effects:
        if isinstance(effect, Gravity):
            pulls.append(("g", [0.0, 0.0, -1.0]))
        elif isinstance(effect, UniformField) and is_shared(effect.field):
            field: Array = np.array(effect.field)
            pulls.append(("B", (field / np.linalg.norm(field)).tolist()))
    return pulls
