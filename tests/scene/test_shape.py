"""The shape of a body: kept by scenes, files and results; a mistake in it is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.scene.parameters import parameter_names, with_parameters
from rigidmc.scene.scene import Scene, scene_of

TOML = """
[body]
moments = [1.0, 2.0, 2.5]
mass = 2.0
centre = [0.0, 0.0, 0.3]
{shape}
[start]
omega = [0.0, 0.0, 1.0]
"""


def load(shape):
    return Scene.loads(TOML.format(shape=shape), "top.toml").body.shape


def test_a_shape_is_declared_with_moments_and_comes_back():
    (rod, ball) = load(
        """
        [[body.shape]]
        solid = "rod"
        length = 0.6
        radius = 0.01
        at = [0.0, 0.0, 0.3]
        [[body.shape]]
        solid = "ball"
        radius = 0.1
        at = [0.0, 0.0, 0.6]
        hole = true
        """
    )
    assert (rod.solid, rod.sizes, rod.at) == ("rod", {"length": 0.6, "radius": 0.01}, (0, 0, 0.3))
    assert ball.hole and not rod.hole


def test_a_result_keeps_the_shape_and_no_bit_depends_on_it():
    body = rm.Body.cylinder(0.2, 0.03, 0.008).with_pivot((0.0, 0.0, -0.04))
    bare = rm.Body.from_moments(body.moments, body.mass, body.centre)
    start = rm.Start(omega=(0.0, 1.0, 20.0), attitude=(0.0, 0.4, 0.0))
    results = [
        rm.simulate(rm.Scene(b, (rm.Gravity(9.81),), start), dt=0.01, t_end=0.1, save=("attitude",))
        for b in (body, bare)
    ]
    assert scene_of(results[0]).body.shape == body.shape != ()
    assert scene_of(results[1]).body.shape == ()
    assert np.array_equal(results[0].attitude.values, results[1].attitude.values)


def test_bodies_without_a_known_part_have_no_shape():
    known, unknown = rm.Body.box(1.0, (1, 2, 3)), rm.Body.from_moments((1, 2, 2.5), 1.0)
    assert known.join(unknown).shape == () == unknown.join(known).shape
    assert len(known.join(known, at=(5, 0, 0)).shape) == 2
    turn = Rotation.from_rotvec([0.3, 0.5, 0.2])
    ways = (turn, turn.as_matrix(), turn.as_quat(scalar_first=True))
    one, *others = (known.join(known, (5, 0, 0), way).shape[1].turned for way in ways)
    assert np.abs(np.array(one) - turn.as_quat(scalar_first=True)).max() < 1e-15  # measured 0
    assert all(np.allclose(other, one, rtol=0, atol=1e-15) for other in others)
    curved = ((-1.0, 1.0), lambda x: (-1 + 0 * x, 1 + x * x), lambda x, y: (0 * x, 1 + 0 * x))
    assert rm.Body.from_density(1.0, curved).shape == ()
    many = np.random.default_rng(1).normal(size=(3000, 3))
    assert rm.Body.from_particles(np.ones(3000), many).shape == ()


def test_another_body_loses_the_shape():
    scene = Scene.load("tennis_racket")
    assert scene.body.shape
    assert with_parameters(scene.model, {"body.moments.2": 0.0165}).body.shape == ()
    assert Scene.load("tennis_racket", [("body.moments", "[1, 2, 2.5]")]).body.shape == ()
    assert Scene.load("tennis_racket", [("body.mass", "0.4")]).body.shape == ()
    assert with_parameters(scene.model, {"start.omega.2": 5.0}).body.shape == scene.body.shape


def test_a_map_varies_the_mass_of_a_solid_and_its_moments_with_it():
    scene = Scene.load("heavy_top")
    names = parameter_names(scene.model)
    assert "body.cylinder.mass" in names and "body.mass" not in names
    body = with_parameters(scene.model, {"body.cylinder.mass": rm.grid(0.05, 1.0, 8)}).body
    moments, masses, centre = body.sample(0, 0, 8)
    for i, mass in enumerate(masses.tolist()):
        true = rm.Body.cylinder(mass, 0.03, 0.008).with_pivot((0.0, 0.0, -0.04))
        assert np.abs(moments[:, i] / true.moments - 1.0).max() < 1e-15  # measured 2.2e-16
        assert tuple(centre[:, i]) == true.centre
    again = with_parameters(scene.model, {"body.cylinder.mass": 0.4}).body
    assert again.mass == 0.4 and again.shape == body.shape == scene.body.shape
    for name in ("body.mass", "body.centre.3", "body.moments.1", "body.cylinder.radius"):
        with pytest.raises(SceneError, match=r"did you mean 'body\.cylinder\.mass'"):
            with_parameters(scene.model, {name: 0.4})


def test_a_solid_drawn_for_other_moments_makes_no_solid_of_a_body():
    scene = Scene.load("heavy_top")
    other = replace(scene, body=replace(scene.body, moments=(3e-4, 3e-4, 8e-5)))
    names = parameter_names(other.model)
    assert "body.mass" in names and "body.cylinder.mass" not in names


def test_a_body_of_many_corners_is_a_line():
    """Before, a mesh of 2,562 corners made 120,414 characters of each notebook cell."""
    mesh = pytest.importorskip("trimesh").creation.icosphere(4)
    points = np.random.default_rng(1).normal(size=(1000, 3))
    for body, words in (
        (rm.Body.from_mesh(mesh, mass=1.0), "mesh(1,902 corners, 3,800 faces)"),
        (rm.Body.from_particles(np.ones(1000), points), "particles(1,000 masses, 1,000 positions)"),
        (rm.Body.box(1.0, (1, 2, 3)).with_pivot((0, 0, 1)), "box(size=(1.0, 2.0, 3.0), at=(0.0"),
    ):
        assert words in repr(body) and len(repr(body)) < 500 and len(repr(rm.Scene(body))) < 2000
