"""Meshes as hulls and shells, inverted, open, with NaN, in millimetres; and their reference."""

import hashlib
import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics import mesh
from rigidmc.scene.scene import scene_of
from rigidmc.views.surfaces import drawn_shape, surface_of

trimesh = pytest.importorskip("trimesh")


def holed(made, count=5):
    return trimesh.Trimesh(made.vertices, made.faces[count:], process=False)


def test_the_hull_against_trimesh():
    rng = np.random.default_rng(1)
    cloud = trimesh.Trimesh(rng.normal(size=(60, 3)), rng.integers(0, 60, (90, 3)), process=False)
    body = rm.Body.from_mesh(cloud, density=2.0, solid="hull")
    hull = trimesh.Trimesh(np.asarray(mesh.load(cloud, closed=False)).reshape(-1, 3)).convex_hull
    hull.density = 2.0
    assert body.mass == pytest.approx(hull.mass, rel=1e-12)
    assert body.centre == pytest.approx(hull.center_mass, abs=1e-12)
    own = body.with_pivot_at_centre().tensor
    assert np.abs(own - hull.moment_inertia).max() < 4e-12  # of 102; measured 2.8e-13
    box = holed(trimesh.creation.box((1.0, 2.0, 3.0)), 2)
    made = rm.Body.from_mesh(box, mass=6.0, solid="hull")
    box = rm.Body.box(6.0, (1.0, 2.0, 3.0)).tensor
    assert np.abs(made.tensor - box).max() < 4e-15  # measured 0


def test_shells_against_their_closed_forms():
    # a cube of six plates of mass m/6: I = 5/18 m a^2
    cube = rm.Body.from_mesh(trimesh.creation.box((2.0, 2.0, 2.0)), mass=3.0, solid="shell")
    # measured 4.4e-16
    assert np.abs(cube.tensor - 5.0 / 18.0 * 3.0 * 4.0 * np.eye(3)).max() < 4e-15
    # an open strip, as a plate about its corner: m/3 diag(b^2, a^2, a^2 + b^2), Ixy = -m a b/4
    corners, faces = [[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]], [[0, 1, 2], [0, 2, 3]]
    strip = trimesh.Trimesh(corners, faces, process=False)
    plate = rm.Body.from_mesh(strip, mass=6.0, solid="shell")
    expected = np.array([[18.0, -9.0, 0.0], [-9.0, 8.0, 0.0], [0.0, 0.0, 26.0]])
    assert np.abs(plate.tensor - expected).max() < 2e-14  # measured 0
    shells = (rm.Body.from_mesh(ball(n), mass=1.0, solid="shell").moments[0] for n in (2, 3))
    errors = [2.0 / 3.0 * 0.49 - moment for moment in shells]
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.2)  # measured 3.94
    assert 0.0 < errors[1] < 4e-3  # measured 1.9e-3


def ball(subdivisions):
    return trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.7)


def test_an_inverted_mesh_is_turned():
    made = ball(2)
    exact = rm.Body.from_mesh(made, density=3.0)
    made.invert()
    with pytest.warns(rm.SceneWarning, match="all its triangles faced inward"):
        body = rm.Body.from_mesh(made, density=3.0)
    assert body.moments == pytest.approx(exact.moments, rel=1e-14)
    # a cavity faces inward as well, and is not turned
    outer, inner = trimesh.creation.icosphere(radius=1.0), trimesh.creation.icosphere(radius=0.5)
    inner.invert()
    both = trimesh.util.concatenate([outer, inner])
    assert rm.Body.from_mesh(both, density=1.0).mass < rm.Body.from_mesh(outer, density=1.0).mass


def test_vertices_that_are_nan_are_counted(tmp_path):
    made = ball(1)
    points = np.array(made.vertices)
    points[[3, 7], 1] = np.nan
    broken = trimesh.Trimesh(points, made.faces, process=False)
    with pytest.raises(rm.SceneError, match=r"2 of its 42 vertices are NaN, the first is vertex 3"):
        rm.Body.from_mesh(broken, mass=1.0)
    points[7, 1] = np.inf
    broken = trimesh.Trimesh(points, made.faces, process=False)
    with pytest.raises(rm.SceneError, match="NaN or infinite"):
        rm.Body.from_mesh(broken, mass=1.0)
    # the cure of the message
    broken.update_faces(np.isfinite(broken.triangles).all((1, 2)))
    broken.remove_unreferenced_vertices()
    assert rm.Body.from_mesh(broken, mass=1.0, solid="hull").mass == 1.0


def test_a_mesh_with_holes_is_told_what_to_do(tmp_path):
    with pytest.raises(rm.SceneError) as caught:
        rm.Body.from_mesh(holed(ball(2)), mass=1.0)
    for words in ("edges with only one triangle", "Screened Poisson", '"hull"', '"shell"'):
        assert words in str(caught.value)
    # a scan whose triangles repeat their corners to five digits
    soup = np.array(ball(2).triangles).reshape(-1, 3)
    soup += np.random.default_rng(1).uniform(-2e-7, 2e-7, soup.shape)
    scan = trimesh.Trimesh(soup, np.arange(len(soup)).reshape(-1, 3), process=False)
    with pytest.raises(rm.SceneError, match=r"mesh.merge_vertices\(digits_vertex=(\d)\)") as caught:
        rm.Body.from_mesh(scan, mass=1.0)
    digits = int(str(caught.value).partition("digits_vertex=")[2][0])
    scan.merge_vertices(digits_vertex=digits)
    body = rm.Body.from_mesh(scan, mass=1.0)
    exact = rm.Body.from_mesh(ball(2), mass=1.0)
    assert body.moments[0] == pytest.approx(exact.moments[0], rel=1e-4)


def test_a_flat_mesh_has_no_hull():
    corners, faces = [[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]], [[0, 1, 2], [0, 2, 3]]
    strip = trimesh.Trimesh(corners, faces, process=False)
    with pytest.raises(rm.SceneError, match="is flat"):
        rm.Body.from_mesh(strip, mass=1.0, solid="hull")


def written(tmp_path, made, name="part.stl"):
    made.export(tmp_path / name)
    return tmp_path / name


def test_millimetres_are_guessed_and_told(tmp_path):
    part = written(tmp_path, trimesh.creation.box((40.0, 20.0, 10.0)))
    with pytest.warns(
        rm.SceneWarning, match=r"read in millimetres, as a body of 0.04 x 0.02 x 0.01"
    ):
        body = rm.Body.read(part, density=1000.0)
    assert body.mass == pytest.approx(0.008, rel=1e-6)
    # 3 kg make 9e-3 kg/m3 of 7 m, and 9e6 of 7 mm: neither is matter, so the size decides
    small = written(tmp_path, trimesh.creation.box((7.0, 7.0, 7.0)), "small.stl")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rm.Body.read(small, mass=3.0).mass == 3.0
        assert rm.Body.read(part, density=1.0, scale=1.0).mass == pytest.approx(8000.0, rel=1e-6)
    # 1 g makes 2,900 kg/m3 of 7 mm
    with pytest.warns(rm.SceneWarning, match="in millimetres"):
        grams = rm.Body.read(small, mass=1e-3)
    assert grams.moments[0] == pytest.approx(1e-3 * 2 * 0.007**2 / 12, rel=1e-6)


def test_options_of_other_files_are_refused(tmp_path):
    part = written(tmp_path, ball(1))
    for options in ({"link": "arm"}, {"products": "positive"}, {"about": "centre"}):
        with pytest.raises(rm.SceneError, match="a mesh has none"):
            rm.Body.read(part, mass=1.0, **options)


def test_a_result_names_the_file_of_its_mesh(tmp_path):
    """The text of a scene had 320,000 characters; the motion needs the numbers of the body only."""
    part = written(tmp_path, ball(4))
    body = rm.Body.from_mesh(part, mass=2.0).with_pivot((0.0, 0.0, -0.5))
    assert "\n" not in repr(body) and len(repr(body)) < 700
    scene = rm.Scene(body, (rm.Gravity(9.81),), rm.Start(omega=(0.0, 1.0, 20.0)))
    ds = rm.simulate(scene, members=2, dt=0.01, t_end=0.1, save=("omega",))
    assert ds.omega.sizes["time"] > 1
    text = ds.attrs["scene"]
    assert len(text) < 2000
    assert hashlib.sha256(part.read_bytes()).hexdigest() in text and "part.stl" in text
    stored = scene_of(ds).body
    assert (stored.moments, stored.centre, stored.axes) == (body.moments, body.centre, body.axes)
    # pictures read the file, as it was
    surface = surface_of(stored)
    direct = surface_of(rm.Body.from_mesh(ball(4), mass=2.0).with_pivot((0.0, 0.0, -0.5)))
    assert np.abs(surface.corners.mean(0) - direct.corners.mean(0)).max() < 1e-4
    assert len(drawn_shape(stored)[0].sizes["corners"]) > 1000
    # without the file, a rerun has every bit, and pictures an ellipsoid
    part.unlink()
    lost = rm.rerun(ds, 1, every=0.1)
    end = ds.omega.isel(member=1, time=-1).values
    assert np.array_equal(lost.omega.isel(member=0, time=-1).values, end)


@pytest.mark.parametrize(("change", "words"), [("delete", "not there"), ("edit", "sha256 differs")])
def test_a_lost_or_changed_file_is_drawn_as_an_ellipsoid(tmp_path, change, words):
    part = written(tmp_path, ball(2))
    body = rm.Body.from_mesh(part, mass=2.0)
    if change == "delete":
        part.unlink()
    else:
        ball(1).export(part)
    with pytest.warns(rm.SceneWarning, match=f"{words}.*: pictures show an ellipsoid"):
        surface = surface_of(body)
    assert np.abs(np.linalg.norm(surface.corners, axis=1) - 1.0).max() < 1e-12


def test_a_scene_names_a_mesh(tmp_path):
    written(tmp_path, holed(ball(2)), "scan.stl")
    text = """[body]
file = "scan.stl"
mass = 2.0
scale = 1.0
solid = "shell"
pivot = [0.0, 0.0, -1.0]
[start]
omega = [0.0, 0.0, 1.0]
"""
    (tmp_path / "scene.toml").write_text(text)
    body = rm.Scene.load(tmp_path / "scene.toml").body
    assert body.mass == pytest.approx(2.0, rel=1e-15)
    assert body.centre[2] == pytest.approx(1.0, abs=0.02)
    # another body drops the file and its options, but a mass is a mass
    settings = [("body.moments", "[3, 3, 2.5]"), ("body.pivot", '"centre"')]
    moved = rm.Scene.load(tmp_path / "scene.toml", settings).body
    assert (moved.mass, moved.centre, moved.shape) == (2.0, (0, 0, 0), ())
    assert moved.moments == (3, 3, 2.5)
