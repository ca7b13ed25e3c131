"""A page that computes: body and momentum turn while the reader moves the scene's numbers."""

import html
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from os import PathLike
from typing import Any

import numpy as np

from rigidmc.engine.kernel import layout
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.errors import OptionError, SceneWarning
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.mechanics.euler_angles import PROPER, TEXTBOOK, axes_of
from rigidmc.physics.effects import shared_parameters
from rigidmc.physics.effects.gravity import Gravity
from rigidmc.physics.effects.protocol import is_random
from rigidmc.scene.body import Body
from rigidmc.scene.model import Model
from rigidmc.scene.quantities import is_variable
from rigidmc.scene.recording import conservation
from rigidmc.scene.scene import Scene, as_scene
from rigidmc.views.html_page import (
    Page,
    fill_template,
    page_text,
    pulls_data,
    script_json,
    shape_data,
    tones_data,
)
from rigidmc.views.live.engine import SAVED, doubles, engine_data, even_end, live_run
from rigidmc.views.live.saving import saving_data, texts
from rigidmc.views.live.sliders import Asked, Range, Slider, make_sliders, rows_of_effects
from rigidmc.views.surfaces import drawn_shape, ellipsoid_form, surface_of

Source = Scene | str | PathLike[str]
MOST = 1000  # members of a page: 1,000 rows of 45 numbers are 360 kB


def live(
    scene: Source | Mapping[str, Source],
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
    scene : Scene, str, path or dict
        a scene, the name of a scene that comes with rigidmc, or a file; or several, as
        {title: scene}: a page that shows one of them, or two side by side
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
    if output is not None:
        refuse_existing(output, force, "pages")
    if isinstance(scene, Mapping):
        page = Page(_several(scene, sliders, members))
    else:
        page = Page(_text(as_scene(scene), sliders, members))
    if output is not None:
        write_bytes(output, page.text.encode(), force)
    return page


def _count(members: int | None, most: int) -> int:
    """Return the members of a page, of a scene with `most`; OptionError."""
    if members is None:
        return min(MOST, most)
    if not 1 <= members <= MOST:
        rule = f"a live page has 1 to {MOST:,} members"
        raise OptionError(rule, at="members", value=members)
    return members


def _several(scenes: Mapping[str, Source], asked: Asked, members: int | None) -> str:
    """Return the page of several pages; OptionError without any."""
    if not scenes:
        raise OptionError("expected at least one scene, as {title: scene}", at="scene")
    titled = {title: replace(as_scene(scene), title=title) for title, scene in scenes.items()}
    pages = [(title, _text(scene, asked, members)) for title, scene in titled.items()]
    form = files(str(__package__)).joinpath("several.html").read_text(encoding="utf-8")
    title = html.escape(", ".join(scenes))
    return fill_template(form, {"TITLE": title, "DATA": script_json(pages)})


def _text(scene: Scene, asked: Asked, count: int | None) -> str:
    members = _count(count, scene.run.members)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of a run, which this is not
        prepared = live_run(scene, members)
        moving = prepared.run.scene
        sliders = make_sliders(moving.model, prepared.start, asked, moving.run.anti_damping)
        engine = engine_data(prepared, members)
        moved = [_slider(slider) | saving_data(prepared, slider) for slider in sliders]
    plan, model = prepared.run.plan, moving.model
    kept, (*axes, sign) = conservation(model.effects, False), axes_of(model.start.sequence)
    saved = moving.with_run(save=tuple(dict.fromkeys((*SAVED, *scene.run.save))))
    data = {
        "engine": engine,
        "block": doubles(prepared.block),
        "start": _start(model.start.spin_name, prepared.start),
        "isIndependent": plan.run.points == "independent",
        "isBodyDrawn": is_variable(model.body.moments),
        "omega": model.start.spin_name == "omega",
        "sequence": {"axes": axes, "sign": sign, "proper": model.start.sequence in PROPER},
        "sliders": moved,
        "sums": _sums(model.effects),
        "scene": texts(saved.with_run(t_end=even_end(prepared.run)), sliders),
        "source": scene.title or "scene",
        "integrator": plan.run.integrator,
        "h": plan.grid.dt,
        "shape": _shape(model.body, prepared.start),
        "tones": tones_data(),
        "pulls": pulls_data(moving.effects),
        "isFree": not model.effects,
        "isRandom": any(map(is_random, model.effects)),
        "gravity": layout.EFFECTS if _is_top(model) else None,
        "end": scene.run.t_end,
        "conserved": [kept[name] == "yes" for name in ("energy_drift", "l2")],
        "statuses": STATUSES,
    }
    scripts = ("start.js", "live.js", "pictures.js", "tops.js", "controls.js")
    return page_text(str(__package__), "live", scene.title or "scene", _about(scene), data, scripts)


def _is_top(model: Model) -> bool:
    """Return whether Euler angles and a spin start a body on which gravity alone acts; the page
    looks at its moments and centre."""
    start, is_heavy = model.start, [*map(type, model.effects)] == [Gravity]
    angles = start.has_euler_angles and start.sequence == TEXTBOOK
    return is_heavy and angles and not model.body.is_turned


def _start(spin: str, start: Mapping[str, Any]) -> dict[str, str]:
    """Return the numbers that the page builds members from."""
    arrays = {name: start[name] for name in ("moments", "mass", "centre")}
    arrays["spin"] = start[f"start_{spin}"]
    if "start_euler" in start:
        arrays["angles"] = start["start_euler"]
    return {name: doubles(values) for name, values in arrays.items()}


def _slider(slider: Slider) -> dict[str, Any]:
    fields = slider._asdict() | {"shared": slider.is_shared}
    left = "parameter", "is_shared", "source", "array", "component"
    return {name: value for name, value in fields.items() if name not in left}


def _sums(effects: Sequence[Any]) -> list[tuple[int, list[int]]]:
    """Return (row, the rows it is the sum of) of each number that effects share."""
    rows = rows_of_effects(effects)
    return [
        (at, [rows[source][k] for source in sources])
        for name, sources in shared_parameters(effects).items()
        for k, at in enumerate(rows[name])
    ]


def _shape(body: Body, start: Mapping[str, Any]) -> dict[str, Any]:
    """Return the triangles of the first member's body, scaled to a largest distance of 1."""
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


def _about(scene: Scene) -> str:
    """Describe the page in one line."""
    effects = ", ".join(type(effect).__name__ for effect in scene.effects) or "No torque"
    return f"{effects}. {scene.summary}".rstrip()
