"""A top that turns, beside the sphere on which its angular momentum moves: an animation by matplotlib's own writers."""

import contextlib
import subprocess
from typing import Any

import numpy as np
from matplotlib import animation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from rigidmc.files.outputs import Part, check_suffix, naming, refuse_existing
from rigidmc.mechanics import rotation

FACES = (
    "#08306b",
    "#9ecae1",
    "#7f2704",
    "#fdae6b",
    "#252525",
    "#d9d9d9",
)  # of the ends of axes 1, 2, 3: dark one end, light the other
LIGHT = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)


def box(moments):
    """Half the edges (3) of the uniform box of these moments, the longest 1: edge i has (I_j + I_k - I_i)/2 for the mean of x_i^2."""
    second = 0.5 * (np.sum(moments) - 2.0 * np.asarray(moments))
    edges = np.sqrt(np.maximum(second, 0.0))
    return np.maximum(edges / edges.max(), 0.03)  # a plate is still seen


def faces(half):
    """The six faces (6, 4, 3) of a box with half edges `half` in body axes, and their outward normals (6, 3)."""
    corners, normals = [], []
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        for end in (1.0, -1.0):
            face = np.zeros((4, 3))
            face[:, axis] = end * half[axis]
            face[:, j], face[:, k] = (
                half[j] * np.array([1, -1, -1, 1]),
                half[k] * np.array([1, 1, -1, -1]),
            )
            corners.append(face)
            normals.append(end * np.eye(3)[axis])
    return np.array(corners), np.array(normals)


SMOOTH = 4  # saves to a frame: the path on the sphere is drawn through all of them


def check_writer(path):
    """OptionError if a path does not end in .gif, .mp4 or .webm; ValueError if it needs ffmpeg and ffmpeg is not installed."""
    check_suffix(path, "animations")
    if not path.endswith(".gif") and not animation.writers.is_available("ffmpeg"):
        raise ValueError(
            f"{path}: {path[-4:]} is written by ffmpeg, which is not installed; .gif needs nothing more"
        )


def animate(ds, path, fps=25, progress=None, force=False):
    """Write an animation of a Dataset of one member with attitude and momentum at evenly spaced times, a frame to every SMOOTH of them.

    path : .gif by pillow, .mp4 or .webm by ffmpeg, which has to be there;  progress : a function of (frames done, all);  force : replace a file

    Left the body as the box of its moments, in space, with the vertical and its angular momentum (an arrow); right its angular momentum in body axes on
    the momentum sphere, with its path so far. It appears whole or not at all. Raises as `check_writer`, OutputExists where a file is there.
    """
    path = str(path)
    check_writer(path)
    refuse_existing(path, force, "animations")
    writer = (
        animation.PillowWriter(fps=fps)
        if path.endswith(".gif")
        else animation.FFMpegWriter(fps=fps, bitrate=2400)
    )
    figure, draw = scene(ds)
    shown = range(0, ds.sizes["time"], SMOOTH)
    with Part(path, force) as part, naming(path, part), _finished(path, writer):
        writer.setup(figure, part, dpi=90)
        for i in shown:
            draw(i)
            writer.grab_frame()
            if progress is not None:
                progress(i // SMOOTH + 1, len(shown))


@contextlib.contextmanager
def _finished(path, writer):
    """Finish a writer; if ffmpeg fails, OSError names the file. `writer.saving` would report only what the error leads to."""
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


def scene(ds):
    """(figure, draw): draw(i) brings the figure to time i."""
    q = ds.attitude.transpose("time", "quat", "member").values[..., 0]
    l = ds.momentum.transpose("time", "axis", "member").values[..., 0]
    turn, size = rotation.matrix(q), np.linalg.norm(l, axis=1)
    toward = np.einsum("tij,tj->ti", turn, l) / np.where(size > 0.0, size, 1.0)[:, None]
    unit = l / np.where(size > 0.0, size, 1.0)[:, None]
    corners, normals = faces(box(ds.moments.values[:, 0]))
    figure = Figure((9.6, 5.0))
    FigureCanvasAgg(figure)
    left: Any
    right: Any
    left, right = (
        figure.add_axes((0.0, 0.0, 0.5, 0.9), projection="3d"),
        figure.add_axes((0.5, 0.0, 0.5, 0.9), projection="3d"),
    )
    title = figure.suptitle("", fontsize=11, parse_math=False)
    for axes, words in ((left, "the body in space"), (right, "its angular momentum in body axes")):
        axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), zlim=(-1.0, 1.0), box_aspect=(1, 1, 1))
        axes.set_axis_off()
        axes.set_title(words, fontsize=10, y=0.98)
        axes.view_init(elev=20.0, azim=-50.0)
    solid = Poly3DCollection([corners[0]] * 6, edgecolors="black", linewidths=0.6)
    left.add_collection3d(solid)
    left.plot([0, 0], [0, 0], [-1.25, 1.25], ":", color="#888888", lw=1.0)
    left.text(0.0, 0.0, 1.3, "z", color="#555555", ha="center")
    arrow: Any = left.plot([], [], [], "-", color="#d94801", lw=2.5)[0]
    tip: Any = left.plot([], [], [], "o", color="#d94801", ms=6)[0]
    left.text2D(
        0.04, 0.06, "— angular momentum L", color="#d94801", transform=left.transAxes, fontsize=9
    )
    a, b = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, np.pi, 13))
    right.plot_wireframe(
        np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b), color="#cccccc", lw=0.4
    )
    for i in range(3):
        ends = np.outer([-1.2, 1.2], np.eye(3)[i])
        right.plot(*ends.T, color="#777777", lw=0.8)
        right.text(*(1.3 * np.eye(3)[i]), str(i + 1), ha="center", va="center")
    path: Any = right.plot([], [], [], "-", color="#d94801", lw=1.2)[0]
    point: Any = right.plot([], [], [], "o", color="#d94801", ms=7)[0]

    def draw(i):
        solid.set_verts(list(corners @ turn[i].T))
        shade = 0.65 + 0.35 * np.clip(normals @ turn[i].T @ LIGHT, 0.0, 1.0)
        solid.set_facecolor(
            [tuple(np.array(to_rgb(c)) * s) for c, s in zip(FACES, shade, strict=True)]
        )
        arrow.set_data_3d(*np.outer([0.0, 1.15], toward[i]).T)
        tip.set_data_3d(*(1.15 * toward[i])[:, None])
        path.set_data_3d(*unit[: i + 1].T)
        point.set_data_3d(*unit[i][:, None])
        title.set_text(
            f"{ds.attrs.get('title', 'top')}: member {int(ds.member.values[0])}, t = {float(ds.time.values[i]):.2f} s"
        )

    return figure, draw
