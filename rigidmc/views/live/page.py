"""A page that computes: body and momentum turn while the reader moves the scene's numbers."""

import warnings
from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np

from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, SceneWarning
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.mechanics.euler_angles import PROPER, axes_of
from rigidmc.results.labels import count_text
from rigidmc.scene.recording import conservation
from rigidmc.scene.scene import Scene, as_scene
from rigidmc.views.html_page import Page, page_text, pulls_data, shape_data, tones_data
from rigidmc.views.live.engine import doubles, engine_data, live_run
from rigidmc.views.live.sliders import Range, Slider, make_sliders, template
from rigidmc.views.surfaces import drawn_shape, ellipsoid_form, surface_of

MOST = 1000  # members of a page: 1,000 rows of 45 numbers are 360 kB


def live(
    scene: Scene | str | PathLike[str],
    output: str | PathLike[str] | None = None,
    sliders: Mapping[str, Range | None] | None = None,
    members: int | None = None,
    force: bool = False,
) -> Page:
    """Make a page that computes the motion of a scene itself, in WebAssembly, while sliders move.

    The page has the kernels of the command line: the same steps, with the same bits. It fetches
    nothing. It turns the body in space, draws its momentum sphere, Poinsot's ellipsoid, charts, a
    phase portrait and the drifts of energy and ``|L|^2``.

    Parameters
    ----------
    scene : Scene, str or path
        a scene, the name of a scene that comes with rigidmc, or a file
    output : str or path, optional
        HTML file to write
    sliders : dict, optional
        {name of a number, as `--set` says: (low, high) in SI units or as text with a unit, such as
        ``("0 deg", "60 deg")``, None for a third to three times, of moments only where bodies
        exist}; by default moments, spin, lean and gravity
    members : int, optional
        how many members the page can show, at most 1,000; by default one, or all up to 1,000 if
        members differ
    force : bool, optional
        replace the file if it exists

    Returns
    -------
    Page
        whose `text` is the page; a notebook shows it in a frame

    Raises
    ------
    OptionError
        for a name that no slider can move, for too many members, and for scenes in float32
    OutputExists
        if the file exists

    Examples
    --------
    >>> page = rm.live("dzhanibekov", members=1)
    >>> page.text.startswith("<!doctype html>")
    True
    """
    scene = as_scene(scene)
    if output is not None:
        refuse_existing(output, force, "pages")
    page = Page(_text(scene, sliders, _count(scene, members)))
    if output is not None:
        write_bytes(output, page.text.encode(), force)
    return page


def _count(scene: Scene, members: int | None) -> int:
    """Return the members of a page; OptionError."""
    if members is None:
        return min(MOST, scene.run.members)
    if not 1 <= members <= MOST:
        rule = f"a live page has 1 to {MOST:,} members"
        raise OptionError(rule, at="members", value=members)
    return members


def _text(scene: Scene, asked: Mapping[str, Range | None] | None, members: int) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of a run, which this is not
        prepared = live_run(scene, members)
        found = prepared.run
        sliders = make_sliders(found.scene, prepared.start, asked)
        text, marks = template(scene, sliders)
        engine = engine_data(prepared, members)
    run, model = found.plan.run, found.scene.model
    kept = conservation(model.effects, False)
    data = {
        "engine": engine,
        "block": doubles(prepared.block),
        "start": _start(found.scene, prepared.start),
        "omega": model.start.spin_name == "omega",
        "sequence": _sequence(model.start.sequence),
        "sliders": [_slider(one, marks[one.name]) for one in sliders],
        "scene": text,
        "source": scene.title or "scene",
        "integrator": run.integrator,
        "h": found.plan.grid.dt,
        "shape": _shape(found.scene, prepared.start),
        "tones": tones_data(),
        "pulls": pulls_data(found.scene.effects),
        "isFree": not model.effects,
        "conserved": [kept[name] == "yes" for name in ("energy_drift", "l2")],
        "statuses": STATUSES,
    }
    scripts = ("live.js", "controls.js")
    return page_text(
        str(__package__), "live", scene.title or "scene", _about(scene, members), data, scripts
    )


def _start(scene: Scene, start: Mapping[str, Any]) -> dict[str, str]:
    """Return the numbers that the page builds members from."""
    known = {name: start[name] for name in ("moments", "mass", "centre")}
    known["spin"] = start[f"start_{scene.model.start.spin_name}"]
    if "start_euler" in start:
        known["angles"] = start["start_euler"]
    return {name: doubles(values) for name, values in known.items()}


def _sequence(sequence: str) -> dict[str, Any]:
    """Return a sequence of Euler angles for the page, as in `rigidmc.mechanics.euler_angles`."""
    *axes, sign = axes_of(sequence)
    return {"axes": axes, "sign": sign, "proper": sequence in PROPER}


def _slider(slider: Slider, marks: Mapping[str, float]) -> dict[str, Any]:
    known = slider._asdict() | {"shared": slider.is_shared, "marks": marks}
    return {name: value for name, value in known.items() if name not in ("is_shared", "source")}


def _shape(scene: Scene, start: Mapping[str, Any]) -> dict[str, Any]:
    """Return the triangles of the first member's body, scaled to a largest distance of 1."""
    body = scene.model.body
    surface, form = surface_of(body), np.eye(3, 4)
    if not drawn_shape(body):
        values = start["moments"][:, 0], float(start["mass"].reshape(-1)[0]), start["centre"][:, 0]
        form = ellipsoid_form(*values)
    corners = surface.corners @ form[:, :3].T + form[:, 3]
    scale = 1.0 / np.linalg.norm(corners, axis=1).max()
    return shape_data(surface._replace(corners=scale * corners)) | {
        "form": np.eye(3, 4).ravel().tolist(),
        "scale": scale,
    }


def _about(scene: Scene, members: int) -> str:
    """Describe the page in one line."""
    effects = ", ".join(type(effect).__name__ for effect in scene.effects) or "no torque"
    return f"{count_text(members, 'member')}, {effects}. {scene.summary}".rstrip()
