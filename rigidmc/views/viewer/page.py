"""The page of a result or a map as one self-contained file."""

import warnings
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr

from rigidmc.errors import OptionError, SceneWarning
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.results.labels import count_text
from rigidmc.runs.frames import frames
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.views.html_page import Page, page_text, pulls_data, shape_data, tones_data
from rigidmc.views.surfaces import surface_of, surface_radius
from rigidmc.views.viewer.data import (
    closer,
    drifts,
    map_data,
    motion_data,
    motion_span,
    sphere_density,
    status_of,
    unseen,
)

SHOWN, MOST = 4, 12  # members of a page: default and maximum


def view(
    ds: xr.Dataset,
    output: str | PathLike[str] | None = None,
    members: Sequence[int] | None = None,
    until: float | None = None,
    force: bool = False,
    allow_code: bool = False,
    readings: Sequence[Any] | None = None,
) -> "Page":
    """Make a page of a result: members turn in space next to their momentum spheres, with omega,
    Euler angles and drifts against time, and the density of the ensemble.

    ds : a result, or a map of `rigidmc.stability_map`, whose pixels show their values and a turning
        member
    members : indices; by default SHOWN members, evenly spaced, and the first flagged one
    until : end of the motion on the page [s]; by default the end of the run, or as far as 4,000
        frames reach (tests/whole/test_claims.py)
    readings : of each member of `members`, for the page, see `rigidmc.studies.fit.page`
    output : HTML file to write; force : replace it if it exists

    Reruns the members, see `rigidmc.runs.frames`. Raises OptionError for members that the result
    does not have, OutputExists.
    """
    if output is not None:
        refuse_existing(output, force, "pages")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # the run has shown them
        if {"x", "y"} <= set(ds.dims) and "good" in ds:  # a map
            page = Page(_of_map(ds, allow_code))
        else:
            page = Page(_written(ds, _chosen(ds, members), until, allow_code, readings))
    if output is not None:
        write_bytes(output, page.text.encode(), force)
    return page


def _chosen(ds: xr.Dataset, members: Sequence[int] | None) -> list[int]:
    """Return the indices of the members to show; OptionError."""
    indices, status = ds.member.values, ds.status.values
    started = indices[status != 2]  # a member that never started has no motion
    if members is None:
        if not started.size:
            raise OptionError("no member of the result has started", at="members")
        even = started[np.unique(np.linspace(0, started.size - 1, SHOWN).round().astype(int))]
        flagged = indices[(status != 0) & (status != 2)][:1]
        return sorted({*even.tolist(), *flagged.tolist()})
    if not 1 <= len(members) <= MOST:
        raise OptionError(f"a page shows 1 to {MOST} members", at="members", value=len(members))
    for member in members:
        if member not in indices:
            rule = f"the result has the members {indices[0]} to {indices[-1]}"
            raise OptionError(rule, at="members", value=member)
        if member not in started:
            rule = "this member never started: impossible body or start"
            raise OptionError(rule, at="members", value=member)
    return list(dict.fromkeys(members))


def _written(
    ds: xr.Dataset, members: list[int], until: float | None, allow_code: bool, readings: Any
) -> str:
    """Return the text of the page of a result."""
    scene = scene_of(ds, allow_code=allow_code)
    facts = []
    last = float(ds.time.values[-1])
    end = last if until is None else until
    if end > last * (1.0 + 1e-9):
        rule = f"the run ends at {last:g} s; for a scene, use --set run.t_end={end:g}"
        raise OptionError(rule, at="until", value=end)
    for i, member in enumerate(members):
        count, reached, rate = motion_span(ds.sel(member=[member]), end)
        shown = frames(ds, member, count, allow_code, until=reached)
        if (again := closer(shown, end)) is not None:
            count, reached, rate = again
            shown = frames(ds, member, count, allow_code, until=reached)
        shown.attrs["frames"] += unseen(shown)
        data = motion_data(shown, scene) | {"rate": rate, "status": status_of(ds, member)}
        data["whole"] = data["end"] >= 0.999 * end
        data["readings"] = readings[i] if readings else []
        data["drift"] = drifts(ds, member, data["end"], allow_code)
        facts.append(data)
    crowd = ds.sizes["member"] > len(members)
    return _filled(
        ds.attrs.get("title", "rigidmc"),
        _about(ds, scene, until),
        scene,
        {"members": facts, "density": sphere_density(ds) if crowd else None},
    )


def _of_map(ds: xr.Dataset, allow_code: bool) -> str:
    """Return the text of the page of a map."""
    scene, data = map_data(ds, allow_code)
    a = ds.attrs
    about = (
        f"{ds.sizes['x']} x {ds.sizes['y']} pixels of {count_text(a['members'], 'member')},"
        f" {a['integrator']}, t_end = {a['t_end']:g} s. {scene.summary}"
    )
    return _filled(a.get("title", "map"), about, scene, data)


def _about(ds: xr.Dataset, scene: Scene, until: float | None) -> str:
    """Describe the run in one line."""
    end = f"t_end = {scene.run.t_end:g} s"
    if until is not None and until < scene.run.t_end:
        end += f", shown up to {until:g} s"
    effects = ", ".join(type(effect).__name__ for effect in scene.effects) or "no torque"
    return (
        f"{count_text(ds.sizes['member'], 'member')}, {effects}, {ds.attrs['integrator']},"
        f" {end}. {scene.summary}".rstrip()
    )


def _filled(title: str, about: str, scene: Scene, data: dict[str, Any]) -> str:
    """Fill the template."""
    surface = surface_of(scene.body)
    # at size 1; the form of a member maps it to the member's body
    surface = surface._replace(corners=surface.corners / surface_radius(surface))
    common = {
        "shape": shape_data(surface),
        "tones": tones_data(),
        "pulls": pulls_data(scene.effects),
        "quantity": "theta" if scene.effects else "omega",
    }
    return page_text(
        str(__package__), "viewer", title, about, data | common, ("map.js", "viewer.js")
    )
