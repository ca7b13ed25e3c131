"""Meshes: solids made of triangles, files in any unit, and surfaces that enclose no volume."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc import Body, SceneError
from rigidmc.mechanics import inertia, mesh
from tests.tools.commands import invoke
from tests.tools.reference import apart

trimesh = pytest.importorskip("trimesh")
RNG, BALL = np.random.default_rng(33), Body.solid("ball", mass=1.0, radius=0.7)


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_a_box_from_a_file_is_the_box(ending, tmp_path):
    trimesh.creation.box((1.0, 2.0, 0.5)).export(tmp_path / f"part.{ending}")
    body = Body.from_mesh(tmp_path / f"part.{ending}", density=3.0)
    assert body.mass == pytest.approx(3.0, rel=1e-15)
    # measured 4.4e-16
    assert np.abs(body.tensor - Body.box(3.0, (1.0, 2.0, 0.5)).tensor).max() < 4e-15


@pytest.mark.parametrize("name", ["box", "icosphere", "capsule"])
def test_equals_trimeshs_own(name):
    made = getattr(trimesh.creation, name)()
    made.apply_transform(trimesh.transformations.random_rotation_matrix(RNG.uniform(size=3)))
    made.apply_translation([3.0, -2.0, 5.0])
    mass, centre, tensor = mesh.mass_properties(np.asarray(made.triangles), 2.5)
    assert mass == pytest.approx(2.5 * made.volume, rel=1e-12)
    assert apart(centre, made.center_mass) < 1e-12
    about = inertia.about_centre(tensor, mass, centre)
    assert apart(about, 2.5 * made.moment_inertia) < 1e-12 * apart(tensor)


def test_body_command_on_an_stl(tmp_path):
    trimesh.creation.cylinder(radius=10.0, height=40.0, sections=512).export(tmp_path / "part.stl")
    shown = invoke("body", tmp_path / "part.stl", "--density", "7850", "--scale", "0.001")
    assert shown.exit_code == 0 and "prolate" in shown.stdout
    exact = Body.solid("cylinder", mass=7850 * np.pi * 0.01**2 * 0.04, radius=0.01, height=0.04)
    body = Body.from_mesh(tmp_path / "part.stl", density=7850.0, scale=0.001)
    # 512 sides for a circle
    assert sorted(body.moments) == pytest.approx(sorted(exact.moments), rel=1e-4)
    by_mass = Body.from_mesh(tmp_path / "part.stl", mass=exact.mass, scale=0.001)
    assert by_mass.mass == pytest.approx(exact.mass, rel=1e-14)


def test_what_is_not_closed_is_refused_with_what_is_wrong(tmp_path):
    made = trimesh.creation.icosphere()
    holed, flipped = made.copy(), made.faces.copy()
    holed.update_faces(np.arange(len(made.faces)) > 0)
    holed.export(tmp_path / "holed.stl")
    shown = invoke("body", tmp_path / "holed.stl")
    assert shown.exit_code == 3 and "3 edges with only one triangle" in shown.stderr
    flipped[0] = flipped[0][::-1]
    assert "3 edges whose triangles are wound" in mesh.open_edges(flipped)
    with pytest.raises(SceneError, match="outward"):
        mesh.mass_properties(np.asarray(made.triangles)[:, ::-1], 1.0)
    (tmp_path / "none.stl").write_text("no mesh")
    assert invoke("body", tmp_path / "none.stl").exit_code == 3
    assert invoke("body", tmp_path / "missing.stl").exit_code == 74


@pytest.mark.parametrize(
    ("make", "exact"),
    [
        (lambda n: trimesh.creation.cylinder(0.7, 1.5, sections=n), Body.cylinder(1.0, 0.7, 1.5)),
        (lambda n: trimesh.creation.uv_sphere(0.7, count=[n // 2, n]), BALL),
    ],
)
def test_round_solids_as_polyhedra_tend_to_their_closed_forms(make, exact):
    """The error of n sides is quadratic: four times less for twice as many."""
    found = [Body.from_mesh(make(n), mass=1.0).with_pivot_at_centre().moments for n in (64, 128)]
    error = [apart(np.sort(moments), np.sort(exact.moments)) for moments in found]
    assert error[1] < 1.5e-3 * max(exact.moments)  # measured 3.2e-4, 5.1e-4
    assert error[0] / error[1] == pytest.approx(4.0, abs=0.2)  # measured 3.998, 4.100


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1.0, 1e6])
def test_the_unit_of_a_file_does_not_matter(size, tmp_path):
    """trimesh by default merges vertices closer than 1e-8, in whatever unit the file uses."""
    assert trimesh.constants.tol.merge == 1e-8
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale(size)
    ball.export(tmp_path / "ball.stl")
    body = Body.from_mesh(tmp_path / "ball.stl", density=1.0)
    assert body.mass == pytest.approx(4.15274 * size**3, rel=1e-5)


def test_a_trimesh_is_taken_as_it_is():
    made = trimesh.creation.torus(0.5, 0.1)
    body = Body.from_mesh(made, density=2.0, scale=0.1)
    assert body.mass == pytest.approx(2.0e-3 * made.volume, rel=1e-13)
    corners = np.asarray(made.triangles).reshape(-1, 3)
    soup = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    again = Body.from_mesh(soup, density=2.0, scale=0.1)
    assert again.moments == pytest.approx(body.moments, rel=1e-13)


def test_merging_is_exact_and_complete_on_round_numbers():
    """Coordinates on a lattice have all digits in the upper bits, which a weak hash would lose."""
    side = np.arange(30) * 0.25 - 3.0
    lattice = np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)
    points = np.concatenate([lattice, lattice[::-1]])
    index = mesh.first_vertices(points)
    assert np.array_equal(points[index], points)
    assert len(np.unique(index)) == len(lattice)
    close = np.array([[1.0, 0.0, 0.0], [np.nextafter(1.0, 2.0), 0.0, 0.0]])
    assert len(np.unique(mesh.first_vertices(close))) == 2


def test_triangles_without_an_area_are_left_out():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    faces = np.concatenate([box.faces, [[0, 0, 1], [2, 3, 3]]])
    body = Body.from_mesh(trimesh.Trimesh(box.vertices, faces, process=False), density=1.0)
    assert body.mass == pytest.approx(1.0, rel=1e-15)
    with pytest.raises(SceneError, match="no triangles with an area"):
        Body.from_mesh(trimesh.Trimesh(box.vertices, [[0, 0, 1]], process=False), density=1.0)


def test_a_cavity_is_no_mass():
    outer, inner = trimesh.creation.icosphere(radius=1.0), trimesh.creation.icosphere(radius=0.5)
    inner.invert()
    both = trimesh.util.concatenate([outer, inner])
    solid, hollow = (Body.from_mesh(one, density=1.0) for one in (outer, both))
    assert hollow.mass == pytest.approx(7 / 8 * solid.mass, rel=1e-13)
    assert hollow.moments == pytest.approx(31 / 32 * np.array(solid.moments), rel=1e-13)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({}, "either density or mass"),
        ({"density": 1.0, "mass": 1.0}, "either density or mass"),
        ({"density": -1.0}, "must be positive"),
        ({"mass": 1.0, "scale": 0.0}, "scale = 0.0: must be positive"),
        ({"mass": rm.uniform(1, 2)}, "a plain number"),
    ],
)
def test_bad_options(options, rule):
    with pytest.raises(SceneError, match=rule):
        Body.from_mesh(trimesh.creation.box(), **options)


def test_body_command_refuses_what_it_cannot_say(tmp_path):

    text = (
        "[body]\nmoments = [{ uniform = [1.0, 1.1] }, 2.0, 2.5]\n[start]\nomega = [0.0, 1.0, 0.0]\n"
    )
    (tmp_path / "many.toml").write_text(text)
    for words, rule in (
        (["body", str(tmp_path / "many.toml")], "differs from member"),
        (["body", "dzhanibekov", "--mass", "3"], "files with a body only"),
    ):
        shown = invoke(*words)
        assert shown.exit_code == 3
        assert rule in shown.stderr
        assert shown.stderr.count("\n") == 1
