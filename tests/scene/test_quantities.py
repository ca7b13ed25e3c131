"""How members differ: distributions, attitudes; draws depend on seed, name and index only."""

import numpy as np
import pytest
import scipy.stats

import rigidmc as rm
from rigidmc.mechanics.rotation import matrix, quaternion_from_euler
from rigidmc.scene.quantities import draw

COUNT = 1 << 16


@pytest.mark.parametrize(
    ("made", "law"),
    [
        (rm.normal(2.0, 0.5), scipy.stats.norm(2.0, 0.5)),
        (rm.uniform(-1.0, 3.0), scipy.stats.uniform(-1.0, 4.0)),
        (rm.distribution("gamma", a=2.0, scale=0.1), scipy.stats.gamma(2.0, scale=0.1)),
        (rm.distribution("weibull_min", c=1.5, loc=1.0), scipy.stats.weibull_min(1.5, loc=1.0)),
    ],
)
def test_distributions(made, law):
    """Kolmogorov-Smirnov at a fixed seed: a scale wrong by 2 % gives p < 1e-23 at this size."""
    values = draw((made,), 11, "start.omega", 0, COUNT)[0]
    assert scipy.stats.kstest(values, law.cdf).pvalue > 1e-3
    assert scipy.stats.kstest(1.02 * values + 0.02, law.cdf).pvalue < 1e-3


def test_a_draw_depends_on_seed_name_and_member_alone():
    both = (rm.normal(0, 1), 3.0, rm.distribution("gamma", a=2.0))
    whole = draw(both, 5, "start.omega", 0, 1000)
    assert np.array_equal(draw(both, 5, "start.omega", 320, 64), whole[:, 320:384])
    alone = draw((rm.normal(0, 1), 3.0, 4.0), 5, "start.omega", 0, 1000)
    # another random component does not change this one
    assert np.array_equal(alone[0], whole[0])
    assert not np.array_equal(draw(both, 6, "start.omega", 0, 1000)[0], whole[0])
    assert not np.array_equal(draw(both, 5, "body.moments", 0, 1000)[0], whole[0])


@pytest.mark.parametrize(
    "attitude", ["uniform", (0.3, rm.uniform(0, 1), 0.1), (rm.normal(0, 1),) * 4]
)
def test_attitudes_do_not_depend_on_how_they_are_asked_for(attitude):
    start = rm.Start(omega=(0, 0, 1), attitude=attitude)
    whole = start.quaternions(3, 0, 4096)
    for first, count in ((0, 32), (32, 32), (64, 96), (4000, 96)):
        assert np.array_equal(start.quaternions(3, first, count), whole[:, first : first + count])
    assert np.abs((whole * whole).sum(0) - 1).max() < 1e-15  # measured 5.6e-16


def test_uniform_attitudes():
    """Each entry of a uniform rotation has mean 0 and variance 1/3; the body axis 3 is uniform on
    the sphere.
    """
    q = rm.Start(omega=(0, 0, 1), attitude="uniform").quaternions(3, 0, COUNT)
    matrices = matrix(q.T)
    # five standard errors; measured 1.7
    assert np.abs(matrices.mean(0)).max() < 5 / np.sqrt(3 * COUNT)
    assert np.abs((matrices**2).mean(0) - 1 / 3).max() < 5 * np.sqrt(4 / 45 / COUNT)
    assert scipy.stats.kstest(matrices[:, 2, 2], scipy.stats.uniform(-1, 2).cdf).pvalue > 1e-3


def test_an_attitude_in_every_notation():
    """Quaternion, matrix, Euler angles and scipy Rotation of one attitude agree; A = Rz(phi)
    Rx(theta) Rz(psi).
    """
    from scipy.spatial.transform import Rotation

    angles = (0.3, 0.7, -1.1)
    rotation = Rotation.from_euler("ZXZ", angles)
    q = rotation.as_quat(scalar_first=True)
    forms = (
        angles,
        tuple(q),
        rotation.as_matrix(),
        rotation,
        [list(row) for row in rotation.as_matrix()],
    )
    for form in forms:
        found = rm.Start(omega=(0, 0, 1), attitude=form).quaternions(0, 0, 32)[:, 0]
        assert min(np.abs(found - q).max(), np.abs(found + q).max()) < 3e-16
    mirrored = quaternion_from_euler(-0.3, 0.7, -1.1)
    assert min(np.abs(mirrored - q).max(), np.abs(mirrored + q).max()) > 0.1


def test_a_quaternion_that_is_normalised_stays_to_the_bit():
    q = rm.Start(omega=(0, 0, 1), attitude="uniform").quaternions(1, 0, 4096)
    again = rm.Start(omega=(0, 0, 1), attitude=np.ascontiguousarray(q.T)).quaternions(1, 0, 4096)
    assert np.array_equal(q, again)


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (lambda: rm.Start(), "either omega or momentum"),
        (lambda: rm.Start(omega=(0, 0, 1), momentum=(0, 0, 1)), "either omega or momentum"),
        (lambda: rm.Start(omega=(0, 0)), "3 components"),
        (lambda: rm.Start(omega="fast"), "3 components"),
        (lambda: rm.Start(omega=(0, 0, float("nan"))), "finite"),
        (lambda: rm.Start(omega=(0, True, 0)), "finite number"),
        (lambda: rm.Start(omega=np.array([[0, 0, 1], [0, np.inf, 1]])), "row 1"),
        (lambda: rm.Start(omega=(0, 0, 1), attitude=(0, 0, 0, 0)), "norm 0"),
        (lambda: rm.Start(omega=(0, 0, 1), attitude="uniformly"), "did you mean 'uniform'"),
        (lambda: rm.Start(omega=(0, 0, 1), attitude=np.diag([1, 1, -1])), "mirror"),
        (lambda: rm.Start(omega=(0, 0, 1), attitude=np.diag([1, 1, 2])), "differs from 1 by 3"),
        (lambda: rm.Start(omega=(0, 0, 1), attitude=(0.1, 0.2)), "4 components"),
        (lambda: rm.normal(0, -1), "standard deviation > 0"),
        (lambda: rm.uniform(2, 1), "low < high"),
        (lambda: rm.distribution("gama", a=1), "did you mean 'gamma'"),
        (lambda: rm.distribution("gamma"), "a is missing"),
        (lambda: rm.distribution("gamma", a=-1.0), "domain"),
        (lambda: rm.distribution("norm", mean=1.0), "loc, scale"),
    ],
)
def test_bad_starts(make, rule):
    with pytest.raises(rm.SceneError, match=rule):
        make()


def test_more_than_four_random_components_are_independent():
    many = draw((rm.normal(0, 1),) * 6, 5, "effects.matrix_damping.matrix", 0, COUNT)
    assert np.array_equal(
        many[:4], draw((rm.normal(0, 1),) * 4, 5, "effects.matrix_damping.matrix", 0, COUNT)
    )
    assert np.abs(np.corrcoef(many) - np.eye(6)).max() < 4.5 / np.sqrt(COUNT)
    assert np.array_equal(
        many[:, 320:384], draw((rm.normal(0, 1),) * 6, 5, "effects.matrix_damping.matrix", 320, 64)
    )
