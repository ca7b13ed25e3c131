"""Animations: a rotating top next to the sphere on which its angular momentum moves."""

import contextlib
import math
import subprocess
from collections.abc import Callable, Iterator
from os import PathLike

import numpy as np
import xarray as xr
from matplotlib import animation, rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rigidmc.errors import OptionError
from rigidmc.files.opening import check_suffix
from rigidmc.files.outputs import PartialFile, naming_the_path, refuse_existing
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import rotation
from rigidmc.planning.saves import ATTITUDE, sparse
from rigidmc.results.principal_axes import in_principal_axes, is_described
from rigidmc.scene.scene import scene_of
from rigidmc.views.figures import ALARM, AXES, GREY, HALO, INK, PATH
from rigidmc.views.globes import draw_ball, toward_reader
from rigidmc.views.quadric import Quadric, screen
from rigidmc.views.sample import fastest
from rigidmc.views.sphere import family
from rigidmc.views.stage import Solid, Stage
from rigidmc.views.surfaces import body_surface, member_body

AZIMUTH, ELEVATION = -0.95, 0.32  # of the eye, as on the pages [rad]
SMOOTH = 4  # saves per frame, all of them on the path on the sphere
TRACE = 400  # saves until the trace of axis 3 fades

Draw = Callable[[int], None]


def check_writer(path: str) -> None:
    """Check that an animation can be written to a path.

    Raises OptionError if the path does not end in .gif, .mp4 or .webm, or if it needs ffmpeg and
    there is none.
    """
    check_suffix(path, "animations")
    if not path.lower().endswith(".gif") and find_ffmpeg() is None:
        rule = (
            "needs ffmpeg: install ffmpeg, or the package imageio-ffmpeg that brings it, with"
            " pip install 'rigidmc[movie]'; .gif needs neither"
        )
        raise OptionError(rule, at="output", value=path)


def find_ffmpeg() -> str | None:
    """Return the path of ffmpeg, the system's or that of imageio-ffmpeg; None without both."""
    if animation.writers.is_available("ffmpeg"):
        return str(rcParams["animation.ffmpeg_path"])
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return None


def animate(
    ds: xr.Dataset,
    path: str | PathLike[str],
    fps: int = 25,
    progress: Callable[[int, int], object] | None = None,
    force: bool = False,
) -> None:
    """Write an animation of one member, completely or not at all.

    ds : one member, with attitude and momentum at evenly spaced times, SMOOTH times per frame
    path : .gif, or with ffmpeg .mp4 or .webm;  force : replace an existing file
    progress : a function of (finished frames, all frames)

    Left: the body in space, as its declared solid or the ellipsoid of its moments, on a stick from
    its fixed point, with the trace of axis 3, the vertical and the angular momentum.
    Right: the angular momentum on the momentum sphere, in the principal axes, with its path so far.
    Raises the errors of `check_writer`, and OutputExists if the file exists and `force` is False.
    """
    path = str(path)
    check_writer(path)
    refuse_existing(path, force, "animations")
    figure, draw = scene(ds)
    frames = range(0, ds.sizes["time"], SMOOTH)
    with rc_context({"animation.ffmpeg_path": find_ffmpeg() or "ffmpeg"}):
        writer = make_writer(path, fps)
        with PartialFile(path, force) as part, naming_the_path(path, part), _finished(path, writer):
            writer.setup(figure, part, dpi=90)
            for i in frames:
                draw(i)
                writer.grab_frame()
                if progress is not None:
                    progress(i // SMOOTH + 1, len(frames))


def make_writer(path: str, fps: int) -> animation.AbstractMovieWriter:
    """Return what writes the frames of a .gif, .mp4 or .webm."""
    if path.lower().endswith(".gif"):
        return animation.PillowWriter(fps=fps)
    # without it VP9 of .webm refuses frames with transparency, and players refuse H.264 of .mp4
    opaque = ["-pix_fmt", "yuv420p"]
    return animation.FFMpegWriter(fps=fps, bitrate=2400, extra_args=opaque)


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
    named = rotation.matrix(ds.attitude.transpose("time", "quat", "member").values[..., 0])
    words = "principal" if is_described(ds) else "body"
    ds = in_principal_axes(ds)
    turn = rotation.matrix(ds.attitude.transpose("time", "quat", "member").values[..., 0])
    l = ds.momentum.transpose("time", "axis", "member").values[..., 0]
    size = np.linalg.norm(l, axis=1)
    # at rest L = 0; dividing by 1 keeps it 0
    unit = l / np.where(size > 0.0, size, 1.0)[:, None]
    figure = Figure((9.6, 5.0))
    FigureCanvasAgg(figure)
    title = figure.suptitle("", fontsize=11, parse_math=False)
    note = between_frames(ds)
    top = 0.84 if note else 0.88  # the note stands above the titles of both pictures
    left, right = (figure.add_axes((side, 0.0, 0.5, top)) for side in (0.0, 0.5))
    left.set_title("body in space", fontsize=10)
    right.set_title(f"angular momentum in {words} axes", fontsize=10)
    body = scene_of(ds, allow_code=None).body
    solid = Solid(body_surface(ds, body), member_body(ds, body)[2])
    parts = (
        _in_space(left, solid, turn, named, unit),
        _on_sphere(right, ds.moments.values[:, 0], unit),
    )
    name = f"{ds.attrs.get('title', 'top')}: member {int(ds.member.values[0])}"
    if note:
        figure.text(0.5, 0.9, note, ha="center", fontsize=9, color=ALARM)

    def draw(i: int) -> None:
        for part in parts:
            part(i)
        title.set_text(f"{name}, t = {float(ds.time.values[i]):.2f} s")

    return figure, draw


def _in_space(axes: Axes, solid: Solid, turn: Array, named: Array, unit: Array) -> Draw:
    """Draw the body with its axes, its stick from the fixed point to the centre of mass, the trace
    of axis 3, the vertical and the angular momentum.

    turn, named : rotation matrices (times, 3, 3) of the principal and of the named axes
    unit : directions (times, 3) of the momentum in principal axes
    """
    axes.set(xlim=(-1.75, 1.75), ylim=(-1.6, 1.6), aspect="equal")
    axes.set_axis_off()
    stage = Stage(axes, AZIMUTH, ELEVATION, 1.6)
    toward = 1.15 * np.einsum("tij,tj->ti", turn, unit)
    colours = {"z": GREY, "1": AXES[0], "2": AXES[1], "3": AXES[2], "L": PATH}
    labels = {
        word: axes.text(
            0.0, 0.0, word, color=colour, ha="center", va="center", weight="bold", path_effects=HALO
        )
        for word, colour in colours.items()
    }
    axes.text(-1.7, -1.5, "orange: L, and the trace of axis 3", color=PATH, fontsize=9)

    def draw(i: int) -> None:
        stage.begin()
        stage.segment((0.0, 0.0, -1.25), (0.0, 0.0, 1.25), GREY, 1.0)
        stage.solid(solid, turn[i])
        ends = {"z": np.array([0.0, 0.0, 1.36]), "L": 1.15 * toward[i]}
        for k in range(3):
            ends[str(k + 1)] = 1.3 * named[i, :, k]
            stage.segment((0.0, 0.0, 0.0), 1.2 * named[i, :, k], AXES[k], 1.6)
        stage.stick(solid, turn[i], INK, 2.0)
        stage.curve(1.2 * named[max(0, i - TRACE) : i + 1, :, 2], PATH, 1.4, is_fading=True)
        stage.arrow(toward[i], PATH)
        stage.end()
        for word, end in ends.items():
            x, y = stage.place(end)[0]
            # beside its arrow, where no other name stands
            labels[word].set_position((x - 0.13, y) if word == "L" else (x, y))

    return draw


def _on_sphere(axes: Axes, moments: Array, unit: Array) -> Draw:
    """Draw the momentum sphere with the polhodes of the body, and the path (times, 3) on it."""
    on = Quadric(turn=toward_reader(unit.T))
    draw_ball(axes, on, ("1", "2", "3"), family(moments))
    x, y, _ = screen(on.points(unit))
    is_front = on.is_seen(unit)
    behind, front = (axes.plot([], [], color=PATH, linewidth=w)[0] for w in (0.5, 1.5))
    point = axes.plot([], [], "o", color=PATH, ms=8, markeredgecolor="white", zorder=5)[0]

    def draw(i: int) -> None:
        for line, shown in ((front, is_front[: i + 1]), (behind, ~is_front[: i + 1])):
            line.set_data(np.where(shown, x[: i + 1], np.nan), np.where(shown, y[: i + 1], np.nan))
        point.set_data(x[i : i + 1], y[i : i + 1])
        point.set_alpha(1.0 if is_front[i] else 0.4)

    return draw


def between_frames(ds: xr.Dataset) -> str:
    """Return a warning if a member turns too far between the frames of an animation; else ""."""
    times = ds.time.values[::SMOOTH]
    if times.size < 2:
        return ""
    between = float(np.diff(times).max())
    turn = sparse(fastest(ds, ATTITUDE), between)
    if turn is None:
        return ""
    frames, shown = math.ceil((times[-1] - times[0]) / turn.every) + 1, len(times)
    return (
        f"the body {turn.who()} between frames, so the apparent motion is wrong: show"
        f" {turn.every * (shown - 1):.2g} s or less in {shown:,} frames, or use {frames:,} frames"
    )
