"""Meshes: solids made of triangles, files in any unit, and surfaces that enclose no volume."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc import Body, SceneError
from rigidmc.mechanics import mesh
from tests.tools.commands import invoke

trimesh = pytest.importorskip("trimesh")


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_a_box_from_a_file_is_the_box(ending, tmp_path):
    trimesh.creation.box((1.0, 2.0, 0.5)).export(tmp_path / f"part.{ending}")
    body = Body.from_mesh(tmp_path / f"part.{ending}", density=3.0)
    assert body.mass == pytest.approx(3.0, rel=1e-15)
    # measured 4.4e-16
    assert np.abs(body.tensor - Body.box(3.0, (1.0, 2.0, 0.5)).tensor).max() < 4e-15


def test_round_solids_as_polyhedra_tend_to_their_closed_forms():
    """The error of n sides is quadratic: four times less for twice as many."""
    for made, exact in (
        (lambda n: trimesh.creation.cylinder(0.7, 1.5, sections=n), Body.cylinder(1.0, 0.7, 1.5)),
        (
            lambda n: trimesh.creation.uv_sphere(0.7, count=[n // 2, n]),
            Body.solid("ball", mass=1.0, radius=0.7),
        ),
    ):
        error = [
            np.abs(
                np.sort(Body.from_mesh(made(n), mass=1.0).with_pivot_at_centre().moments)
                - np.sort(exact.moments)
            ).max()
            for n in (64, 128)
        ]
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
    soup = trimesh.Trimesh(
        np.asarray(made.triangles).reshape(-1, 3),
        np.arange(3 * len(made.faces)).reshape(-1, 3),
        process=False,
    )
    assert Body.from_mesh(soup, density=2.0, scale=0.1).moments == pytest.approx(
        body.moments, rel=1e-13
    )


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
    solid = Body.from_mesh(outer, density=1.0)
    assert Body.from_mesh(both, density=1.0).mass == pytest.approx(7 / 8 * solid.mass, rel=1e-13)
    assert Body.from_mesh(both, density=1.0).moments == pytest.approx(
        31 / 32 * np.array(solid.moments), rel=1e-13
    )


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
