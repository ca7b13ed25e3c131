"""Tensors and moments about the centre of mass, in Python and in scene files."""

from dataclasses import replace

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.mechanics import inertia
from rigidmc.scene.scene import Scene
from tests.tools.reference import moved

TENSOR = np.array([[10.0, 0.4, -0.3], [0.4, 12.0, 0.2], [-0.3, 0.2, 8.0]])
CENTRE, MASS = np.array([0.3, -0.2, 0.5]), 40.0


def test_a_tensor_about_the_centre_is_moved_by_the_parallel_axis_theorem():
    body = rm.Body.from_tensor(TENSOR, MASS, CENTRE, about="centre")
    # measured 3.6e-15
    assert np.abs(body.tensor - moved(TENSOR, MASS, CENTRE)).max() < 4e-14
    again = body.with_pivot_at_centre()
    assert np.abs(again.tensor - TENSOR).max() < 1e-13  # measured 3.6e-15
    same = rm.Body.from_tensor(TENSOR, MASS, (0, 0, 0), about="centre")
    assert np.array_equal(same.tensor, rm.Body.from_tensor(TENSOR, MASS).tensor)


def test_moments_about_the_centre():
    body = rm.Body.from_moments((1.0, 2.0, 2.5), 3.0, CENTRE, about="centre")
    expected = moved(np.diag([1.0, 2.0, 2.5]), 3.0, CENTRE)
    assert np.abs(body.tensor - expected).max() < 2e-15  # measured 1.1e-16
    along = rm.Body.from_moments((1.0, 1.0, 0.5), 2.0, (0, 0, 3), about="centre")
    assert along.moments == (19.0, 19.0, 0.5)


def test_an_impossible_tensor_is_refused_before_it_is_moved():
    """Moved by m c^2 = 16, the moments (1, 1, 5) would obey the triangle inequality."""
    with pytest.raises(rm.SceneError, match="no mass distribution has these moments"):
        rm.Body.from_tensor(np.diag([1.0, 1.0, 5.0]), 1.0, (4.0, 0.0, 0.0), about="centre")


@pytest.mark.parametrize("size", [6, 9, 10])
def test_an_uncertain_tensor_moves_with_its_covariance(size):
    """The truth: members of a normal sample of (tensor, centre, mass), each moved by itself."""
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(10, 10)) * np.array([0.02] * 6 + [1e-3] * 3 + [0.02])[:, None]
    covariance = (ways @ ways.T)[:size, :size]
    law = rm.UncertainInertia(TENSOR, covariance)
    body = rm.Body.from_tensor(law, MASS, tuple(CENTRE), about="centre")
    mean = np.array([*inertia.elements(TENSOR), *CENTRE, MASS])
    drawn = np.tile(mean, (50_000, 1))
    drawn[:, :size] += rng.multivariate_normal(np.zeros(size), covariance, len(drawn))
    moved = inertia.about_point(inertia.symmetric(drawn[:, :6].T), drawn[:, 9], drawn[:, 6:9])
    truth = np.array(inertia.elements(np.moveaxis(moved, 0, -1)))
    made = np.array(body.moments.covariance)[:6, :6]
    scale = np.sqrt(np.outer(truth.var(1), truth.var(1)))
    assert np.abs(made - np.cov(truth)).max() / scale.max() < 0.02  # measured 2.9e-3
    unmoved = np.abs(covariance[:6, :6] - np.cov(truth)).max() / scale.max()
    assert size == 6 or unmoved > 0.1  # measured 0.60, 0.64
    off = np.array(inertia.elements(body.moments.mean)) - truth.mean(1)
    assert np.abs(off).max() < 5e-3  # of 22: second order; measured 1.8e-3
    moved_mean = inertia.elements(inertia.about_point(TENSOR, MASS, CENTRE))
    assert np.array_equal(np.array(inertia.elements(body.moments.mean)), moved_mean)


def test_a_body_keeps_whether_its_mass_is_given():
    free, given = rm.Body((1, 2, 2.5)), rm.Body((1, 2, 2.5), 1.0)
    assert (free.mass, free.has_mass) == (1.0, False) and given.has_mass
    assert free.with_pivot_at_centre().moments == given.moments  # 0 m apart: no mass is needed
    assert not replace(free, frame="principal").has_mass and replace(free, mass=2.0).has_mass
    assert not rm.Body.from_tensor(TENSOR, about="centre").has_mass
    text = "[body]\nmoments = [1, 2, 2.5]\n[start]\nomega = [0, 0, 1]\n"
    assert not rm.Scene.loads(text).body.has_mass


TEXT = """
[body]
tensor = [[10.0, 0.4, -0.3], [0.4, 12.0, 0.2], [-0.3, 0.2, 8.0]]
mass = 40.0
centre = [0.3, -0.2, 0.5]
MORE
[start]
omega = [0.0, 0.0, 1.0]
"""


def test_a_scene_file_says_about():
    body = Scene.loads(TEXT.replace("MORE", 'about = "centre"')).body
    assert np.abs(body.tensor - moved(TENSOR, MASS, CENTRE)).max() < 4e-14
    plain = Scene.loads(TEXT.replace("MORE", 'about = "pivot"')).body
    assert np.array_equal(plain.tensor, Scene.loads(TEXT.replace("MORE", "")).body.tensor)
    # a satellite: the numbers of the sheet, about the point about which it turns
    satellite = Scene.loads(TEXT.replace("MORE", 'about = "centre"\npivot = "centre"')).body
    assert satellite.centre == (0.0, 0.0, 0.0) and satellite.mass == MASS
    assert np.array_equal(satellite.tensor, rm.Body.from_tensor(TENSOR, MASS).tensor)


def test_moments_and_uncertain_tensors_of_a_scene_file():
    text = TEXT.replace(TEXT.splitlines()[2], "moments = [10.0, 12.0, 8.0]")
    body = Scene.loads(text.replace("MORE", 'about = "centre"')).body
    expected = moved(np.diag([10.0, 12.0, 8.0]), MASS, CENTRE)
    assert np.abs(body.tensor - expected).max() < 8e-14  # measured 7.1e-15
    rows = [[1e-4 * (i == j) for j in range(6)] for i in range(6)]
    mean = "[[10.0, 0.4, -0.3], [0.4, 12.0, 0.2], [-0.3, 0.2, 8.0]]"
    law = f"tensor = {{ uncertain_inertia = {{ mean = {mean}, covariance = {rows} }} }}"
    text = TEXT.replace(TEXT.splitlines()[2], law)
    body = Scene.loads(text.replace("MORE", 'about = "centre"')).body
    assert np.abs(np.array(body.moments.mean) - moved(TENSOR, MASS, CENTRE)).max() < 4e-14
    turning = Scene.loads(text.replace("MORE", 'about = "centre"\npivot = "centre"')).body
    assert np.abs(np.array(turning.moments.mean) - TENSOR).max() == 0.0
    assert turning.moments.centre is None and turning.centre == (0.0, 0.0, 0.0)
