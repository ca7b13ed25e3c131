"""An animation: a rotating top beside the sphere on which its angular momentum moves."""

import contextlib
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
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike, NDArray

from rigidmc.files.outputs import Part, check_suffix, naming, refuse_existing
from rigidmc.mechanics import rotation
from rigidmc.views.figure import GREY, LIGHT, PATH

# of the two ends of axes 1, 2, 3: one dark, one light
FACES = ("#08306b", "#9ecae1", "#7f2704", "#fdae6b", "#252525", "#d9d9d9")
LAMP = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)  # direction of the light
SMOOTH = 4  # saves per frame: the path on the sphere is drawn through all of them

Draw = Callable[[int], None]


def box(moments: ArrayLike) -> NDArray[np.float64]:
    """Half the edges (3) of the uniform box with some moments, the longest 1.

    The mean of x_i^2 is (I_j + I_k - I_i)/2 per mass.
    """
    second = 0.5 * (np.sum(moments) - 2.0 * np.asarray(moments))
    edges = np.sqrt(np.maximum(second, 0.0))
    half: NDArray[np.float64] = np.maximum(edges / edges.max(), 0.03)  # so that plates are visible
    return half


def faces(half: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(faces (6, 4, 3), normals (6, 3)) of a box with half edges `half`, in body axes."""
    half = np.asarray(half)
    corners, normals = [], []
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        for end in (1.0, -1.0):
            face = np.zeros((4, 3))
            face[:, axis] = end * half[axis]
            face[:, j] = half[j] * np.array([1, -1, -1, 1])
            face[:, k] = half[k] * np.array([1, 1, -1, -1])
            corners.append(face)
            normals.append(end * np.eye(3)[axis])
    return np.array(corners), np.array(normals)


def check_writer(path: str) -> None:
    """Check that an animation can be written to a path.

    Raises OptionError if the path does not end in .gif, .mp4 or .webm; ValueError if it needs
    ffmpeg and ffmpeg is not installed.
    """
    check_suffix(path, "animations")
    if not path.endswith(".gif") and not animation.writers.is_available("ffmpeg"):
        kind = path[-4:]
        rule = f"{kind} is written by ffmpeg, which is not installed; .gif needs nothing more"
        raise ValueError(f"{path}: {rule}")


def animate(
    ds: xr.Dataset,
    path: str | PathLike[str],
    fps: int = 25,
    progress: Callable[[int, int], object] | None = None,
    force: bool = False,
) -> None:
    """Write an animation of one member, completely or not at all.

    ds : one member, with attitude and momentum at evenly spaced times; SMOOTH times are a frame
    path : .gif (by pillow), .mp4 or .webm (by ffmpeg);  force : replace an existing file
    progress : a function of (frames done, all)

    Left: the body in space as the box of its moments, with the vertical and the angular momentum.
    Right: the angular momentum in body axes on the momentum sphere, with its path so far.
    Raises as `check_writer`, and OutputExists if the file exists and `force` is False.
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
    with Part(path, force) as part, naming(path, part), _finished(path, writer):
        writer.setup(figure, part, dpi=90)
        for i in frames:
            draw(i)
            writer.grab_frame()
            if progress is not None:
                progress(i // SMOOTH + 1, len(frames))


@contextlib.contextmanager
def _finished(path: str, writer: animation.AbstractMovieWriter) -> Iterator[None]:
    """Finish a writer; if ffmpeg fails, OSError names the file.

    `writer.saving` would report only the consequences of the error.
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
        raise OSError(f"{path}: could not be written by ffmpeg: {error}") from None


def scene(ds: xr.Dataset) -> tuple[Figure, Draw]:
    """(figure, draw): draw(i) shows time i."""
    q = ds.attitude.transpose("time", "quat", "member").values[..., 0]
    l = ds.momentum.transpose("time", "axis", "member").values[..., 0]
    size = np.linalg.norm(l, axis=1)
    unit = l / np.where(size > 0.0, size, 1.0)[:, None]
    figure = Figure((9.6, 5.0))
    FigureCanvasAgg(figure)
    title = figure.suptitle("", fontsize=11, parse_math=False)
    left = _axes(figure, 0.0, "the body in space")
    right = _axes(figure, 0.5, "its angular momentum in body axes")
    half = box(ds.moments.values[:, 0])
    parts = _body(left, half, rotation.matrix(q), l, size), _sphere(right, unit)
    name = f"{ds.attrs.get('title', 'top')}: member {int(ds.member.values[0])}"

    def draw(i: int) -> None:
        for part in parts:
            part(i)
        title.set_text(f"{name}, t = {float(ds.time.values[i]):.2f} s")

    return figure, draw


def _axes(figure: Figure, left: float, title: str) -> Any:
    """Three-dimensional axes around the unit sphere, on one half of a figure."""
    axes: Any = figure.add_axes((left, 0.0, 0.5, 0.9), projection="3d")
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), zlim=(-1.0, 1.0), box_aspect=(1, 1, 1))
    axes.set_axis_off()
    axes.set_title(title, fontsize=10, y=0.98)
    axes.view_init(elev=20.0, azim=-50.0)
    return axes


def _body(
    axes: Any,
    half: NDArray[np.float64],
    turn: NDArray[np.float64],
    l: NDArray[np.float64],
    size: NDArray[np.float64],
) -> Draw:
    """The body as a box, the vertical and the angular momentum in space.

    turn : rotation matrices (times, 3, 3);  l, size : momentum (times, 3) and its size
    """
    toward = np.einsum("tij,tj->ti", turn, l) / np.where(size > 0.0, size, 1.0)[:, None]
    corners, normals = faces(half)
    solid = Poly3DCollection([corners[0]] * 6, edgecolors="black", linewidths=0.6)
    axes.add_collection3d(solid)
    axes.plot([0, 0], [0, 0], [-1.25, 1.25], ":", color=GREY, lw=1.0)
    axes.text(0.0, 0.0, 1.3, "z", color=GREY, ha="center")
    arrow = axes.plot([], [], [], "-", color=PATH, lw=2.5)[0]
    tip = axes.plot([], [], [], "o", color=PATH, ms=6)[0]
    words = "— angular momentum L"
    axes.text2D(0.04, 0.06, words, color=PATH, transform=axes.transAxes, fontsize=9)

    def draw(i: int) -> None:
        solid.set_verts(list(corners @ turn[i].T))
        shade = 0.65 + 0.35 * np.clip(normals @ turn[i].T @ LAMP, 0.0, 1.0)
        colors = [tuple(np.array(to_rgb(c)) * s) for c, s in zip(FACES, shade, strict=True)]
        solid.set_facecolor(colors)
        arrow.set_data_3d(*np.outer([0.0, 1.15], toward[i]).T)
        tip.set_data_3d(*(1.15 * toward[i])[:, None])

    return draw


def _sphere(axes: Any, unit: NDArray[np.float64]) -> Draw:
    """The momentum sphere with its axes and the path (times, 3) of unit vectors on it."""
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
