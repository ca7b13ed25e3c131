"""Solids in perspective: each point of a visible face has the colour of that face."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from rigidmc.mechanics import rotation
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.shape import ShapePart
from rigidmc.views import stage
from rigidmc.views.surfaces import TONES, cut, surface_of


def test_cut_triangles_are_the_same_surface():
    whole = surface_of(Scene.load("book").body)
    triangles = whole.corners[whole.faces]
    pieces, tones = cut(triangles, whole.tones, 0.02)

    def areas(of, by):
        normals = np.cross(of[:, 1] - of[:, 0], of[:, 2] - of[:, 0])
        return [0.5 * normals[by == tone].sum(0) for tone in range(6)]

    assert len(pieces) > len(triangles)
    assert np.linalg.norm(np.roll(pieces, -1, 1) - pieces, axis=2).max() <= 0.02
    off = np.abs(np.array(areas(pieces, tones)) - areas(triangles, whole.tones))
    assert off.max() < 1e-15  # measured 6e-17 of 0.03 m2


@pytest.mark.parametrize("seed", range(4))
def test_a_flat_box_is_drawn_face_by_face(seed):
    figure = Figure((4.0, 4.0))
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    body = Scene.load("book").body
    q = np.random.default_rng(seed).normal(size=4)
    turn = rotation.matrix(q / np.linalg.norm(q))
    shown = stage.Stage(axes, -0.95, 0.32, 1.0)
    shown.solid(stage.Solid(surface_of(body)), turn)
    shown.end()
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3] / 255.0
    part = body.shape[0]
    assert part == ShapePart("box", part.sizes)
    half = np.array(part.sizes["size"]) / np.linalg.norm(part.sizes["size"])
    seen = 0
    for axis in range(3):
        for tone, end in enumerate((1.0, -1.0), 2 * axis):
            normal = end * turn[:, axis]
            if normal @ (shown.far * shown.toward - half[axis] * normal) < 0.3 * shown.far:
                continue
            light = stage.DARK + (1.0 - stage.DARK) * max(normal @ stage.LAMP, 0.0)
            for across in np.linspace(-0.85, 0.85, 8):
                for along in (-0.8, -0.4, 0.4, 0.8):
                    place = np.full(3, end)
                    place[[(axis + 1) % 3, (axis + 2) % 3]] = across, along
                    (x, y), _ = shown.place(turn @ (place * half))
                    column, row = axes.transData.transform((x, y))
                    found = image[int(image.shape[0] - row), int(column)]
                    off = np.abs(found - light * np.array(to_rgb(TONES[tone]))).max()
                    assert off < 0.1  # measured 0.05 next to a rim; with the back faces 0.16
                    seen += 1
    assert seen >= 32


def test_a_stick_ends_at_the_surface():
    """A box held 1 m below its middle: the stick reaches it; one held inside shows none."""
    size, far = np.array([0.4, 0.6, 0.8]), np.array([0.0, 0.0, 1.0])
    box = Body.box(1.0, tuple(size))
    surface = surface_of(box)
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.6, 0.6, (400, 3))
    solid = stage.Solid(surface)
    assert (solid.holds(solid.scale * points) == (np.abs(points) < 0.5 * size).all(1)).all()
    moved = surface._replace(corners=surface.corners + far)
    held = stage.Solid(moved, far)
    ends = held.stick[:, :, 2] / held.scale
    assert ends.min() == 0.0 and abs(ends.max() - 0.6) < 1.0 / 12  # one piece
    assert len(stage.Solid(surface, (0.0, 0.0, 0.3)).stick) == 0


def test_near_things_are_larger_and_hide_far_ones():
    shown = stage.Stage(Figure().add_subplot(), 0.0, 0.0, 1.0)
    (near, far), depth = shown.place([[0.5, 0.2, 0.0], [-0.5, 0.2, 0.0]])
    assert depth.tolist() == [0.5, -0.5]  # toward the eye, which is on axis 1
    assert near[0] == pytest.approx(0.2 * 5.0 / 4.5) and far[0] == pytest.approx(0.2 * 5.0 / 5.5)
    shown.curve([[0.5, 0.0, 0.0], [0.5, 1.0, 0.0]], "#ff0000")
    shown.curve([[-0.5, 0.0, 0.0], [-0.5, 1.0, 0.0]], "#0000ff")
    shown.end()
    assert shown.polygons.get_edgecolor().tolist() == [[0, 0, 1, 1], [1, 0, 0, 1]]
