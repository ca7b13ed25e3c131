"""Solids in perspective: faces, surfaces with the inertia of their body, bodies at instants."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import rigidmc as rm
from rigidmc.mechanics import rotation
from rigidmc.mechanics.mesh import mass_properties
from rigidmc.mechanics.rotation import to_space
from rigidmc.planning.saves import MOST
from rigidmc.scene.body import Body
from rigidmc.scene.scene import Scene
from rigidmc.scene.shape import ShapePart
from rigidmc.views import snapshots, stage
from rigidmc.views.ensemble import summary
from rigidmc.views.snapshots import COUNT, body_place, flight
from rigidmc.views.surfaces import TONES, body_surface, cut, revolve, surface_of


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


# a circle of 48 corners has 0.9971 of the area and 0.9943 of the second moment of the round one;
# measured: worst 0.0057 of the largest moment, for the ball
ROUND = 0.008

BODIES = {
    "box": rm.Body.box(1.0, (1.0, 0.6, 0.2)),
    "ball": rm.Body.solid("ball", mass=1.0, radius=0.7),
    "cylinder": rm.Body.cylinder(1.0, 0.4, 1.2),
    "hollow_cylinder": rm.Body.solid("hollow_cylinder", mass=1.0, inner=0.3, outer=0.6, height=0.5),
    "cone": rm.Body.solid("cone", mass=1.0, radius=0.4, height=1.0),
    "ellipsoid": rm.Body.solid("ellipsoid", mass=1.0, semiaxes=(1.0, 0.6, 0.3)),
    "rod": rm.Body.solid("rod", mass=1.0, length=1.0, radius=0.05),
    "density": rm.Body.from_density(1000.0, ("cylinder", 0.1, (0.05, 0.3))),
    "block": rm.Body.from_density(2.0, ("box", (0.0, 1.0), (-1.0, 2.0), (0.5, 0.7))),
    "pivoted": rm.Body.cylinder(0.2, 0.03, 0.008).with_pivot((0.0, 0.01, -0.04)),
    "joined": rm.Body.cylinder(1.0, 0.1, 1.0).join(
        rm.Body.box(0.5, (0.5, 0.1, 0.2)), at=(0.0, 0.2, 0.6), turned=(0.8, 0.6, 0.0, 0.0)
    ),
}


def result_of(body):
    start = rm.Start(omega=(0.1, 0.2, 1.0))
    return rm.simulate(rm.Scene(body, start=start), dt=0.1, t_end=0.1, members=1)


@pytest.mark.parametrize("name", BODIES)
def test_a_surface_has_the_inertia_of_its_body(name):
    body = BODIES[name]
    ds = result_of(body)
    surface = body_surface(ds, body)
    triangles = surface.corners[surface.faces]
    if name != "joined":  # whose densities differ
        volume, centre, tensor = mass_properties(triangles, 1.0)
        moments = np.array(body.moments)
        size = np.sqrt(moments.max() / body.mass)
        apart = np.abs(centre - body.to_principal(body.centre)).max()
        assert apart <= 1e-12 * size  # measured 1e-15
        off = tensor * body.mass / volume - np.diag(moments)
        assert np.abs(off).max() <= ROUND * moments.max()


def test_joined_parts_lie_where_they_were_joined():
    """Each part of a joined body, as a body of its own, gives its share of the inertia."""
    body = BODIES["joined"]
    surface = body_surface(result_of(body), body)
    whole, at = np.zeros((3, 3)), 0
    for part, mass in (
        (rm.Body.cylinder(1.0, 0.1, 1.0), 1.0),
        (rm.Body.box(500.0, (1, 1, 1)), 0.5),
    ):
        faces = len(body_surface(result_of(part), part).faces)
        triangles = surface.corners[surface.faces[at : at + faces]]
        volume, _, tensor = mass_properties(triangles, 1.0)
        whole, at = whole + mass / volume * tensor, at + faces
    assert at == len(surface.faces)
    # measured 5e-5
    assert np.abs(whole - np.diag(body.moments)).max() <= ROUND * max(body.moments)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.02, -0.03, 0.25)])
def test_a_body_without_shape_is_its_ellipsoid(centre):
    body = rm.Body((0.3, 0.28, 0.11), mass=2.0, centre=centre)
    surface = body_surface(result_of(body), body)
    triangles = surface.corners[surface.faces]
    volume, middle, tensor = mass_properties(triangles, 1.0)
    assert np.abs(middle - np.array(centre)).max() <= 1e-12
    off = tensor * body.mass / volume - np.diag(body.moments)
    assert np.abs(off).max() <= ROUND * max(body.moments)  # measured 0.0035


def test_thin_solids_are_thin_and_of_their_size():
    for name, sizes, extent in (
        ("disc", {"radius": 0.5}, (1.0, 1.0, 0.015)),
        ("plate", {"size": (0.5, 0.2)}, (0.5, 0.2, 0.015)),
        ("ring", {"radius": 0.5}, (1.03, 1.03, 0.03)),
        ("shell", {"radius": 0.5}, (1.0, 1.0, 1.0)),
    ):
        body = rm.Body.solid(name, mass=1.0, **sizes)
        corners = body_surface(result_of(body), body).corners
        assert np.ptp(corners, axis=0) == pytest.approx(extent, rel=1e-9), name


def test_quarters_alternate_so_that_a_spin_is_seen():
    surface = revolve((0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0))
    x, y, _ = surface.corners[surface.faces].mean(1).T
    assert (surface.tones % 2 == (x * y < 0.0)).all()
    assert {*surface.tones.tolist()} == {0, 1, 4, 5}


def test_particles_and_holes_and_meshes():
    trimesh = pytest.importorskip("trimesh")
    torus = trimesh.creation.torus(1.0, 0.3, major_sections=200, minor_sections=100)
    body = rm.Body.from_mesh(torus, mass=2.0)
    surface = body_surface(result_of(body), body)
    assert len(surface.corners) <= 2000 < len(torus.vertices)
    volume, _, tensor = mass_properties(surface.corners[surface.faces], 1.0)
    # thinned from 20,000 corners: measured 0.0041
    assert np.abs(tensor * 2.0 / volume - np.diag(body.moments)).max() <= 0.008 * max(body.moments)

    places = [(1.0, 0.0, 0.1), (0.0, 1.0, 0.0), (-1.0, 0.5, 0.7)]
    body = rm.Body.from_particles([1.0, 8.0, 1.0], places)
    corners = body_surface(result_of(body), body).corners
    small, large, _ = np.split(body.to_reference(corners), 3)
    assert small.mean(0) == pytest.approx((1.0, 0.0, 0.1), abs=1e-9)
    assert np.ptp(large[:, 2]) == pytest.approx(2.0 * np.ptp(small[:, 2]))

    bored = rm.Body.cylinder(1.0, 0.5, 1.0).subtract(rm.Body.cylinder(0.1, 0.1, 1.0))
    tones = body_surface(result_of(bored), bored).tones
    assert (tones == 6).sum() == len(tones) / 2  # the hole is dark


def test_the_instants_cover_the_first_flip_or_the_run():
    t = np.linspace(0.0, 10.0, 2001)
    flips = np.tanh(4.0 * (3.0 - t)) * np.tanh(4.0 * (t - 8.0)) * -1.0  # at 3 s and 8 s
    found = snapshots._instants(t, flips, True, np.inf)
    assert len(found) == COUNT and found[0] < 2.6 and 3.4 < found[-1] < 5.0
    for value, is_rate in ((flips, False), (1.0 + 0.0 * t, True)):
        found = snapshots._instants(t, value, is_rate, np.inf)
        assert found == pytest.approx(np.linspace(0.0, 10.0, 8))


@pytest.mark.parametrize("rate", [0.1, 1.0, 4.0, 30.0])
def test_instants_do_not_alias_an_oscillation(rate):
    """Eight instants over a run show an oscillation at 2 rad of it or less."""
    t, still = np.linspace(0.0, 10.0, 20001), np.tile([0.0, 0.0, 1.0], (20001, 1))
    value = 25.0 + 3.0 * np.sin(rate * t)
    fastest = snapshots._rate(t, value, still)
    # chords are flatter than the curve: measured 9.4e-6 below; a cut oscillation seems faster
    assert fastest > rate * (1.0 - 1e-4)
    between = np.diff(snapshots._instants(t, value, False, MOST / fastest))
    assert (between * rate <= MOST * (1.0 + 1e-4)).all()
    whole = rate <= 1.0 and MOST / fastest * (COUNT - 1) >= 10.0
    assert (np.isclose(between.sum(), 10.0)) == whole


@pytest.mark.slow  # 4 s, to compile
def test_a_handle_is_drawn_while_it_flips():
    """Its stem, axis 3, points along L at first and against it in the end."""
    ds = rm.simulate(rm.Scene.load("dzhanibekov"), "closed", members=40, save=("omega",))
    one = flight(ds)
    stem = to_space(one.path.attitude, (0.0, 0.0, 1.0))
    l = to_space(one.path.attitude[0], one.path.momentum[0])
    along = np.interp(one.instants[[0, -1]], one.path.t, stem @ l / np.linalg.norm(l))
    assert along[0] > 0.9 and along[1] < -0.9
    saved = ds.omega.sel(member=one.path.member, axis=3).values
    again = np.interp(ds.time.values, one.path.t, one.value)
    assert np.abs(again - saved).max() < 0.02  # measured 4e-3, by interpolation
    figure = summary(ds)
    bodies = figure.axes[1]
    middles = bodies.collections[0].get_paths()
    x = np.array([path.vertices[:, 0].mean() for path in middles])
    nearest = np.abs(x[:, None] - [body_place(k) for k in range(COUNT)])
    assert nearest.min(1).max() < 1.3 and len(np.unique(nearest.argmin(1))) == COUNT
    words = [text.get_text() for text in bodies.texts]
    assert words == [f"{t:.3g} s" for t in one.instants]
    figure.canvas.draw()


def test_a_result_without_its_scene_has_no_body():
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.1, 1.0, 0.0)))
    ds = rm.simulate(scene, "closed", t_end=1.0, every=0.1, members=2, save=("omega",))
    with pytest.raises(ValueError, match="does not hold the start"):
        snapshots.snapshots(ds.drop_vars("start_omega"))
    del ds.attrs["scene"]
    with pytest.raises(ValueError, match="with its scene"):
        snapshots.snapshots(ds)
    assert len(summary(ds).axes) == 4  # time, sphere and its scale, drifts
