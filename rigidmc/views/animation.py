"""Animations: a rotating top next to the sphere on which its angular momentum moves."""

import contextlib
import math
import subprocess
from collections.abc import Callable, Iterator
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import animation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from rigidmc.figures import ALARM, COLOURS, GREY, INK, LIGHT, PATH
from rigidmc.files.opening import check_suffix
from rigidmc.files.outputs import PartialFile, naming_the_path, refuse_existing
from rigidmc.mechanics import rotation
from rigidmc.planning.turns import ATTITUDE, sparse
from rigidmc.results.frames import in_principal_axes, is_described
from rigidmc.scene.scene import scene_of
from rigidmc.views.sample import fastest
from rigidmc.views.surfaces import TONES, Surface, body_surface, cut, member_body

ELEVATION, AZIMUTH = np.radians([20.0, -50.0])  # of the distant viewer
VIEWER = np.array(
    [
        np.cos(ELEVATION) * np.cos(AZIMUTH),
        np.cos(ELEVATION) * np.sin(AZIMUTH),
        np.sin(ELEVATION),
    ]
)
LAMP = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)  # direction of the light
SMOOTH = 4  # saves per frame, all of them on the path on the sphere
TRACE, TRACED = 400, COLOURS[4]  # saves until the trace of axis 3 fades, and its colour
LONGEST = 0.2  # longest edge of a triangle relative to the body: faces are sorted by mean depth

Draw = Callable[[int], None]


def check_writer(path: str) -> None:
    """Check that an animation can be written to a path.

    Raises OptionError if the path does not end in .gif, .mp4 or .webm; ValueError if it needs
    ffmpeg and ffmpeg is not installed.
    """
    check_suffix(path, "animations")
    if not path.endswith(".gif") and not animation.writers.is_available("ffmpeg"):
        kind = path[-4:]
        rule = f"{kind} requires ffmpeg, which is not installed; .gif does not"
        raise ValueError(f"{path}: {rule}")


def animate(
    ds: xr.Dataset,
    path: str | PathLike[str],
    fps: int = 25,
    progress: Callable[[int, int], object] | None = None,
    force: bool = False,
) -> None:
    """Write an animation of one member, completely or not at all.

    ds : one member, with attitude and momentum at evenly spaced times, SMOOTH times per frame
    path : .gif (with pillow), .mp4 or .webm (with ffmpeg);  force : replace an existing file
    progress : a function of (finished frames, all frames)

    Left: the body in space, as its declared solid or the ellipsoid of its moments, on a stick from
    its fixed point, with the trace of axis 3, the vertical and the angular momentum.
    Right: the angular momentum on the momentum sphere, in the principal axes, with its path so far.
    Raises the errors of `check_writer`, and OutputExists if the file exists and `force` is False.
    """
    path = str(path)
    check_writer(path)
    refuse_existing(path, force, "animations")
    writer: animation.AbstractMovieWriter = (
        animation.PillowWriter(fps=fps)
        if path.endswith(".gif")
        else animation.FFMpegWriter(fps=fps, bitrate=2400)
    )
    figure, draw = scene(ds)
    frames = range(0, ds.sizes["time"], SMOOTH)
    with PartialFile(path, force) as part, naming_the_path(path, part), _finished(path, writer):
        writer.setup(figure, part, dpi=90)
        for i in frames:
            draw(i)
            writer.grab_frame()
            if progress is not None:
                progress(i // SMOOTH + 1, len(frames))


@contextlib.contextmanager
def _finished(path: str, writer: animation.AbstractMovieWriter) -> Iterator[None]:
    """Finish a writer; if ffmpeg fails, raise OSError with the name of the file.

    `writer.saving` reports only the consequences of the error.
    """
    try:
        try:
            yield
        except BaseException:
            with contextlib.suppress(Exception):
                writer.finish()
            raise
        writer.finish()
    except (subprocess.CalledProcessError, BrokenPipeError) as error:
        raise OSError(f"{path}: ffmpeg could not write it: {error}") from None


def scene(ds: xr.Dataset) -> tuple[Figure, Draw]:
    """Return (figure, draw); draw(i) shows time i."""
    # the described axes turn, too; the surface and the sphere are in the principal axes
    third = rotation.matrix(ds.attitude.transpose("time", "quat", "member").values[..., 0])[:, :, 2]
    named = "principal" if is_described(ds) else "body"
    ds = in_principal_axes(ds)
    q = ds.attitude.transpose("time", "quat", "member").values[..., 0]
    l = ds.momentum.transpose("time", "axis", "member").values[..., 0]
    size = np.linalg.norm(l, axis=1)
    # at rest L = 0; dividing by 1 keeps it 0
    unit = l / np.where(size > 0.0, size, 1.0)[:, None]
    figure = Figure((9.6, 5.0))
    FigureCanvasAgg(figure)
    title = figure.suptitle("", fontsize=11, parse_math=False)
    left = _axes(figure, 0.0, "body in space")
    right = _axes(figure, 0.5, f"angular momentum in {named} axes")
    body = scene_of(ds, allow_code=None).body
    parts = (
        _body(left, body_surface(ds, body), member_body(ds, body)[2], rotation.matrix(q)),
        _trace(left, third),
        _momentum(left, rotation.matrix(q), l, size),
        _sphere(right, unit),
    )
    name = f"{ds.attrs.get('title', 'top')}: member {int(ds.member.values[0])}"
    note = between_frames(ds)
    if note:
        figure.text(0.5, 0.9, note, ha="center", fontsize=9, color=ALARM)

    def draw(i: int) -> None:
        for part in parts:
            part(i)
        title.set_text(f"{name}, t = {float(ds.time.values[i]):.2f} s")

    return figure, draw


def between_frames(ds: xr.Dataset) -> str:
    """Return a warning if a member turns too far between the frames of an animation; else ""."""
    times = ds.time.values[::SMOOTH]
    if times.size < 2:
        return ""
    between = float(np.diff(times).max())
    found = sparse(fastest(ds, ATTITUDE), between)
    if found is None:
        return ""
    frames = math.ceil((times[-1] - times[0]) / found.every) + 1
    return (
        f"the body {found.who()} between frames, so the apparent motion is wrong;"
        f" use frames <= {found.every:g} s apart, {frames:,} in total"
    )


def _axes(figure: Figure, left: float, title: str) -> Any:
    """Add three-dimensional axes around the unit sphere to one half of a figure."""
    axes: Any = figure.add_axes((left, 0.0, 0.5, 0.9), projection="3d")
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), zlim=(-1.0, 1.0), box_aspect=(1, 1, 1))
    axes.set_axis_off()
    axes.set_title(title, fontsize=10, y=0.98)
    axes.set_proj_type("ortho")
    axes.view_init(elev=np.degrees(ELEVATION), azim=np.degrees(AZIMUTH))
    return axes


def _body(
    axes: Any, surface: Surface, centre: NDArray[np.float64], turn: NDArray[np.float64]
) -> Draw:
    """Draw the body and its stick from the fixed point to the centre of mass.

    Surfaces are closed, so faces that point away from the viewer are hidden and not drawn.
    turn : rotation matrices (times, 3, 3)
    """
    scale = 1.0 / np.abs(surface.corners).max()
    triangles, tones = cut(scale * surface.corners[surface.faces], surface.tones, LONGEST)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    # for a surface of size 1; a face without area has normal 0
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    colours = np.array([to_rgb(tone) for tone in TONES])[tones]
    # edges in the colours of the faces close the gaps between slender triangles
    solid = Poly3DCollection(triangles, linewidths=0.8, joinstyle="round")
    axes.add_collection3d(solid)
    stick = axes.plot([], [], [], "-", color=INK, lw=2.0)[0]
    axes.plot([0.0], [0.0], [0.0], "o", color=INK, ms=4)

    def draw(i: int) -> None:
        seen = normals @ turn[i].T @ VIEWER > 0.0
        solid.set_verts(list(triangles[seen] @ turn[i].T))
        shade = 0.65 + 0.35 * np.clip(normals[seen] @ turn[i].T @ LAMP, 0.0, 1.0)
        solid.set_color(colours[seen] * shade[:, None])
        stick.set_data_3d(*np.outer([0.0, scale], turn[i] @ centre).T)

    return draw


def _trace(axes: Any, axis: NDArray[np.float64]) -> Draw:
    """Draw the fading trace of the body's axis 3, unit vectors (times, 3) in space."""
    line = Line3DCollection([], linewidths=1.2)
    axes.add_collection3d(line, autolim=False)
    words = "— trace of axis 3"
    axes.text2D(0.04, 0.02, words, color=TRACED, transform=axes.transAxes, fontsize=9)

    def draw(i: int) -> None:
        points = 1.2 * axis[max(0, i - TRACE) : i + 1]
        age = np.arange(len(points) - 1, 0, -1) / TRACE
        line.set_segments(list(np.stack([points[:-1], points[1:]], 1)))
        line.set_color([(*to_rgb(TRACED), 1.0 - share) for share in age])

    return draw


def _momentum(
    axes: Any, turn: NDArray[np.float64], l: NDArray[np.float64], size: NDArray[np.float64]
) -> Draw:
    """Draw the vertical, and the angular momentum in space: l (times, 3), its size (times,)."""
    # at rest L = 0; dividing by 1 keeps it 0
    toward = np.einsum("tij,tj->ti", turn, l) / np.where(size > 0.0, size, 1.0)[:, None]
    axes.plot([0, 0], [0, 0], [-1.25, 1.25], ":", color=GREY, lw=1.0)
    axes.text(0.0, 0.0, 1.3, "z", color=GREY, ha="center")
    arrow = axes.plot([], [], [], "-", color=PATH, lw=2.5)[0]
    tip = axes.plot([], [], [], "o", color=PATH, ms=6)[0]
    words = "— angular momentum L"
    axes.text2D(0.04, 0.06, words, color=PATH, transform=axes.transAxes, fontsize=9)

    def draw(i: int) -> None:
        arrow.set_data_3d(*np.outer([0.0, 1.15], toward[i]).T)
        tip.set_data_3d(*(1.15 * toward[i])[:, None])

    return draw


def _sphere(axes: Any, unit: NDArray[np.float64]) -> Draw:
    """Draw the momentum sphere with its axes and the path (times, 3) of unit vectors on it."""
    a, b = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, np.pi, 13))
    x, y, z = np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)
    axes.plot_wireframe(x, y, z, color=LIGHT, lw=0.4)
    for i in range(3):
        axes.plot(*np.outer([-1.2, 1.2], np.eye(3)[i]).T, color=GREY, lw=0.8)
        axes.text(*(1.3 * np.eye(3)[i]), str(i + 1), ha="center", va="center")
    path = axes.plot([], [], [], "-", color=PATH, lw=1.2)[0]
    point = axes.plot([], [], [], "o", color=PATH, ms=7)[0]

    def draw(i: int) -> None:
        path.set_data_3d(*unit[: i + 1].T)
        point.set_data_3d(*unit[i][:, None])

    return draw
