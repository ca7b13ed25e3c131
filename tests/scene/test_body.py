"""Bodies: tensors and principal axes, against the chapter; impossible ones; shapes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.mechanics.inertia import principal_axes, violates_triangle
from rigidmc.scene.parameters import parameter_names, with_parameters
from rigidmc.scene.scene import Scene, scene_of


def test_four_particles_of_the_chapter():
    """TdC Example 3.2: moments 1, 3, 4 (m a^2), axes (1, 1, 0), (1, -1, 0), (0, 0, 1)."""
    m, a = 0.3, 0.7
    body = rm.Body.from_particles([m] * 4, [(a, 0, 0), (0, a, 0), (a, a, 0), (0, 0, 0)])
    # measured 3.3e-16
    tensor = m * a * a * np.array([[2, -1, 0], [-1, 2, 0], [0, 0, 4]])
    assert np.allclose(body.tensor, tensor, rtol=0, atol=1e-15)
    assert np.allclose(body.moments, m * a * a * np.array([1, 3, 4]), rtol=1e-15)
    axes = np.array(body.axes)
    known = np.array([[1, 1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    assert np.allclose(np.abs(axes), known, atol=1e-15)
    assert axes[0, 0] * axes[1, 0] > 0 > axes[0, 1] * axes[1, 1]
    assert body.mass == pytest.approx(4 * m)
    assert body.centre == pytest.approx((a / 2, a / 2, 0))


def test_cylinder_on_the_edge_of_its_base():
    """Theory: M/12 [[3a^2+4h^2, 0, -6ah], [0, 15a^2+4h^2, 0], [-6ah, 0, 18a^2]]; with h = sqrt(3)
    a: 9/4, 9/4, 1/2 (M a^2)."""
    mass, a = 1.7, 0.2
    for h in (0.1, 0.3, np.sqrt(3) * a):
        body = rm.Body.cylinder(mass, a, h).with_pivot((a, 0, -h / 2))
        off = 6 * a * h
        direct = np.diag([3 * a * a + 4 * h * h, 15 * a * a + 4 * h * h, 18 * a * a])
        direct = mass / 12 * (direct + [[0, 0, off], [0, 0, 0], [off, 0, 0]])
        # x points from the axis to the edge here, so I13 changes sign
        assert np.allclose(body.tensor, direct, rtol=0, atol=1e-16)
        root = np.sqrt(225 * a**4 + 24 * a * a * h * h + 16 * h**4)
        half = 21 * a * a + 4 * h * h
        expected = np.array([2 * (15 * a * a + 4 * h * h), half + root, half - root])
        assert np.allclose(sorted(body.moments), sorted(mass / 24 * expected), rtol=1e-14)
    assert np.allclose(sorted(body.moments), mass * a * a * np.array([0.5, 2.25, 2.25]), rtol=1e-14)
    along = np.array(body.axes)[:, int(np.argmin(body.moments))]
    assert np.allclose(np.abs(along), np.array([2, 0, np.sqrt(3)]) / np.sqrt(7), atol=1e-14)


clouds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(clouds, st.sampled_from(["general", "two equal", "three equal"]))
def test_principal_axes(rng, kind):
    """TdC (3.19)-(3.23): I = B diag B^T with det B = +1, also with equal moments."""
    moments = rng.uniform(0.5, 1, 3) if kind == "general" else np.full(3, 0.9)
    if kind == "two equal":
        moments[:2] = 0.7
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tensor = (turn * moments) @ turn.T
    tensor = 0.5 * (tensor + tensor.T)
    found, axes = principal_axes(tensor)
    assert np.allclose((axes * found) @ axes.T, tensor, rtol=0, atol=5e-15)  # measured 2.0e-15
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-14)  # measured 2e-15
    assert np.allclose(sorted(found), sorted(moments), rtol=0, atol=5e-15)  # measured 1.2e-15


def test_a_diagonal_tensor_keeps_its_axes():
    body = rm.Body.from_tensor(np.diag([3.0, 1.0, 2.5]))
    assert body.moments == (3.0, 1.0, 2.5)
    assert np.array_equal(body.axes, np.eye(3))


def test_impossible_bodies():
    good = [(1, 2, 3), (1, 1, 1), (1, 1, 2), (0.1 + 0.2, 0.1, 0.2)]
    bad = [(1, 2, 3.0001), (0, 1, 1), (-1, 1, 1), (np.nan, 1, 1)]
    assert not violates_triangle(np.array(good, float).T).any()
    assert violates_triangle(np.array(bad, float).T).all()


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
    bare = rm.Body(body.moments, body.mass, body.centre)
    start = rm.Start(omega=(0.0, 1.0, 20.0), attitude=(0.0, 0.4, 0.0))
    results = [
        rm.simulate(rm.Scene(b, (rm.Gravity(9.81),), start), dt=0.01, t_end=0.1, save=("attitude",))
        for b in (body, bare)
    ]
    assert scene_of(results[0]).body.shape == body.shape != ()
    assert scene_of(results[1]).body.shape == ()
    assert np.array_equal(results[0].attitude.values, results[1].attitude.values)


def test_bodies_without_a_known_part_have_no_shape():
    known, unknown = rm.Body.box(1.0, (1, 2, 3)), rm.Body((1, 2, 2.5), 1.0)
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
