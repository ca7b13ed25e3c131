"""Animations: what a frame shows, its colours, and what writes it."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.colors import to_rgb, to_rgba

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.views import animation
from rigidmc.views.figures import AXES, PATH
from rigidmc.views.quadric import screen


def spinning_box():
    """A box that turns about axis 3 by 0.1 rad from save to save."""
    start = rm.Start(omega=(0.0, 0.0, 1.0), attitude=(1.0, 0.0, 0.0, 0.0))
    scene = rm.Scene(rm.Body.box(1.0, (1.0, 0.5, 0.25)), start=start)
    run = {"t_end": 1.0, "every": 0.1, "members": 1}
    return rm.simulate(scene, "closed", save=("momentum", "attitude"), **run)


def test_without_ffmpeg_two_ways_to_it_are_named(monkeypatch):
    monkeypatch.setattr(animation.animation.writers, "is_available", lambda name: False)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(OptionError, match=r"install ffmpeg, or .*imageio-ffmpeg.*\[movie\]"):
        animation.check_writer("top.mp4")
    animation.check_writer("top.gif")
    with pytest.raises(OptionError, match=r"`rigidmc view` makes a page"):
        animation.check_writer("top.html")


@pytest.mark.parametrize("name", ["top.mp4", "top.webm"])
def test_a_film_plays(name, tmp_path):
    """Without yuv420p, ffmpeg refuses to write .webm, and many players to show .mp4."""
    writer = animation.make_writer(name, 25)
    writer.outfile = name
    args = " ".join(writer.output_args)
    assert "-pix_fmt yuv420p" in args and "gbrap" not in args
    if (ffmpeg := animation.find_ffmpeg()) is None:
        return
    animation.animate(spinning_box(), tmp_path / name, fps=5)  # 11 saves, 4 a frame
    command = [ffmpeg, "-i", str(tmp_path / name), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    film = subprocess.run(command, capture_output=True, check=True)
    assert b" 864x450" in film.stderr and b" 5 fps" in film.stderr
    frames = np.frombuffer(film.stdout, np.uint8).reshape(-1, 450, 864, 3)
    assert len(frames) == 3
    off = np.abs(frames[-1] / 255.0 - to_rgb(PATH)).max(-1).min()
    assert off < 0.05  # measured 0.01: a pixel of the path has its colour


def test_a_frame_shows_body_axes_momentum_and_path():
    """A box that spins about axis 3: traces and axes have the colours of the page."""
    ds = spinning_box()
    figure, draw = animation.scene(ds)
    draw(8)
    left, right = figure.axes
    edges = {tuple(color) for color in left.collections[0].get_edgecolor()}
    assert {to_rgba(color) for color in (*AXES, PATH)} <= edges
    labels = {text.get_text(): text.get_position() for text in left.texts}
    turn = np.array([[np.cos(0.8), -np.sin(0.8), 0.0], [np.sin(0.8), np.cos(0.8), 0.0], [0, 0, 1]])
    ends = {"1": 1.3 * turn[:, 0], "2": 1.3 * turn[:, 1], "L": (0.0, 0.0, 1.15**2)}
    stage = animation.Stage(left, animation.AZIMUTH, animation.ELEVATION, 1.6)
    for name, end in ends.items():
        beside = np.array([0.13, 0.0]) * (name == "L")
        assert labels[name] == pytest.approx(tuple(stage.place(end)[0] - beside), abs=1e-9)
    point = right.lines[-1].get_xydata()[0]  # momentum along axis 3
    assert point == pytest.approx(screen(np.eye(3)[2])[:2], abs=1e-12)
