"""The page as one self-contained file: K3D plots, numbers, style and script."""

import base64
import html
import json
import warnings
from collections.abc import Sequence
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rigidmc.errors import FileError, OptionError, SceneWarning
from rigidmc.files.outputs import refuse_existing, write_bytes
from rigidmc.results.frames import in_principal_axes
from rigidmc.results.labels import count_text
from rigidmc.runs.rerun import frames
from rigidmc.scene.scene import Scene, scene_of
from rigidmc.views.html_page import Page, fill_template
from rigidmc.views.sample import omega_or_momentum
from rigidmc.views.surfaces import ball_surface, surface_of
from rigidmc.views.viewer.data import (
    closer,
    drifts,
    is_map_dataset,
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
) -> "Page":
    """Make a page of a result: members turn in space next to their momentum spheres, with omega,
    Euler angles and drifts against time, and the density of the ensemble.

    ds : a result, or a map of `rigidmc.stability_map`, whose pixels show their values and a turning
        member
    members : indices; by default SHOWN members, evenly spaced, and the first flagged one
    until : end of the motion on the page [s]; by default the end of the run, or as far as 4,000
        frames reach (tests/whole/test_claims.py)
    output : HTML file to write; force : replace it if it exists

    Reruns the members, see `rigidmc.runs.rerun`. Raises OptionError for members that the result
    does not have, FileError without k3d, OutputExists.
    """
    if output is not None:
        refuse_existing(output, force, "pages")
    check_k3d()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # the run has shown them
        if is_map_dataset(ds):
            page = Page(_of_map(ds, allow_code))
        else:
            page = Page(_written(ds, _chosen(ds, members), until, allow_code))
    if output is not None:
        write_bytes(output, page.text.encode(), force)
    return page


def check_k3d() -> None:
    """Raise FileError if k3d, which draws pages, is not installed."""
    try:
        import k3d  # noqa: F401
    except ImportError as error:
        rule = f"pages require k3d: pip install 'rigidmc[view]' ({error})"
        raise FileError(rule, at="view") from None


def _chosen(ds: xr.Dataset, members: Sequence[int] | None) -> list[int]:
    """Return the indices of the members to show; OptionError."""
    known, status = ds.member.values, ds.status.values
    started = known[status != 2]  # a member that never started has no motion
    if members is None:
        if not started.size:
            raise OptionError("no member of the result has started", at="members")
        even = started[np.unique(np.linspace(0, started.size - 1, SHOWN).round().astype(int))]
        flagged = known[(status != 0) & (status != 2)][:1]
        return sorted({*even.tolist(), *flagged.tolist()})
    if not 1 <= len(members) <= MOST:
        raise OptionError(f"a page shows 1 to {MOST} members", at="members", value=len(members))
    for member in members:
        if member not in known:
            rule = f"the result has the members {known[0]} to {known[-1]}"
            raise OptionError(rule, at="members", value=member)
        if member not in started:
            rule = "this member never started: impossible body or start"
            raise OptionError(rule, at="members", value=member)
    return list(dict.fromkeys(members))


def _written(ds: xr.Dataset, members: list[int], until: float | None, allow_code: bool) -> str:
    """Return the text of the page of a result."""
    scene = scene_of(ds, allow_code=allow_code)
    facts, bodies = [], list[list[float]]()
    last = float(ds.time.values[-1])
    end = last if until is None else until
    if end > last * (1.0 + 1e-9):
        rule = f"the run ends at {last:g} s; for a scene, use --set run.t_end={end:g}"
        raise OptionError(rule, at="until", value=end)
    for member in members:
        count, reached, rate = motion_span(ds.sel(member=[member]), end)
        shown = frames(ds, member, count, allow_code, until=reached)
        if (again := closer(shown, end)) is not None:
            count, reached, rate = again
            shown = frames(ds, member, count, allow_code, until=reached)
        shown.attrs["frames"] += unseen(shown)
        known = motion_data(shown, scene) | {"rate": rate, "status": status_of(ds, member)}
        known["whole"] = known["end"] >= 0.999 * end
        known["drift"] = drifts(ds, member, known["end"], allow_code)
        if known["moments"] not in bodies:
            bodies.append(known["moments"])
        facts.append(known | {"family": bodies.index(known["moments"])})
    crowd = ds.sizes["member"] > len(members)
    start = in_principal_axes(ds.sel(member=members[:1]))
    return _filled(
        ds.attrs.get("title", "rigidmc"),
        _about(ds, scene, until),
        {
            "members": facts,
            "quantity": "theta" if scene.effects else "omega",
            "density": sphere_density(ds, ball_surface(1.0).corners) if crowd else None,
            "plots": _plots(scene, bodies, omega_or_momentum(start, "momentum")[0][0, :, 0]),
        },
    )


def _of_map(ds: xr.Dataset, allow_code: bool) -> str:
    """Return the text of the page of a map."""
    scene, data, bodies = map_data(ds, allow_code)
    a = ds.attrs
    about = (
        f"{ds.sizes['x']} x {ds.sizes['y']} pixels of {count_text(a['members'], 'member')},"
        f" {a['integrator']}, t_end = {a['t_end']:g} s. {scene.summary}"
    )
    plots = _plots(scene, bodies, np.ones(3))
    quantity = "theta" if scene.effects else "omega"
    return _filled(a.get("title", "map"), about, data | {"plots": plots, "quantity": quantity})


def _plots(scene: Scene, bodies: list[list[float]], l: NDArray[np.float64]) -> dict[str, str]:
    """Return the two K3D plots as base64.

    bodies : moments of the bodies with polhodes;  l : the first momentum (3,)
    """
    from rigidmc.views.viewer.stage import body_plot, sphere_plot

    plots = {
        "body": body_plot(surface_of(scene.body), scene.effects),
        "sphere": sphere_plot([np.array(moments) for moments in bodies], l),
    }
    return {
        name: base64.b64encode(plot.get_binary_snapshot(9)).decode() for name, plot in plots.items()
    }


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


def _filled(title: str, about: str, data: dict[str, Any]) -> str:
    """Fill the template."""
    import k3d

    own = files(__package__)
    library = Path(k3d.__file__).parent / "static" / "standalone.js"
    parts = {
        "TITLE": html.escape(title),
        "ABOUT": html.escape(about),
        "STYLE": own.joinpath("viewer.css").read_text(encoding="utf-8"),
        "LIBRARY": library.read_text(encoding="utf-8").replace("</script", "<\\/script"),
        # no "<": it could end the script, or begin a comment that hides the end of the script
        "DATA": json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
        "SCRIPT": own.joinpath("viewer.js").read_text(encoding="utf-8"),
    }
    return fill_template(own.joinpath("viewer.html").read_text(encoding="utf-8"), parts)
