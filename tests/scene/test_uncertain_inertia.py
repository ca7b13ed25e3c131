"""Inertia tensors with a covariance: statistics, existence, motion in the described axes."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.mechanics.inertia import symmetric, violates_triangle
from rigidmc.mechanics.log_cholesky import numbers_of, parameters_of, rates_of
from rigidmc.planning.unit_scale import scale_scene
from tests.physics.effects.laws import Motion, Properties
from tests.tools.plans import starts

TENSOR = np.array([[2.0, 0.1, -0.05], [0.1, 2.5, 0.2], [-0.05, 0.2, 3.0]])
CENTRE, MASS = (0.05, 0.02, -0.1), 12.0
MEAN = np.array([2.0, 2.5, 3.0, 0.2, -0.05, 0.1, *CENTRE, MASS])
SIZE = np.array([2.0, 2.5, 3.0, 1.0, 1.0, 1.0, 0.2, 0.2, 0.2, MASS])


def covariance(share, size=10):
    """Of parameters known to a share of SIZE, with correlations."""
    wide = np.random.default_rng(3).normal(size=(10, 14))
    product = wide @ wide.T
    scale = share * SIZE / np.sqrt(product.diagonal())
    return (scale[:, None] * product * scale)[:size, :size]


def body_of(share, axes="described", size=10):
    law = rm.UncertainInertia(TENSOR, covariance(share, size))
    return rm.Body.from_tensor(law, MASS, CENTRE, axes=axes)


def parameters(body, count, first=0):
    return body.moments.bodies(7, "body.tensor", first, count, MASS, CENTRE)


def tensors(body, count):
    return symmetric(parameters(body, count)[:6])


def test_numbers_and_rates_are_those_of_the_pseudo_inertia():
    """J = U U^T with an upper triangular U of numpy, and differences."""
    second = 0.5 * np.trace(TENSOR) * np.eye(3) - TENSOR
    whole = np.block([[second, MASS * np.array([CENTRE]).T], [MASS * np.array(CENTRE), MASS]])
    u = np.linalg.cholesky(whole[::-1, ::-1])[::-1, ::-1] / np.sqrt(MASS)
    expected = [*np.log(u.diagonal()[:3]), u[1, 2], u[0, 2], u[0, 1], *u[:3, 3], np.log(MASS)]
    numbers = numbers_of(MEAN.tolist())
    assert np.allclose(numbers, expected, rtol=0, atol=2e-15)  # measured 2.2e-16
    back = parameters_of(np.array(numbers)[:, None])[:, 0]
    assert np.allclose(back, MEAN, rtol=0, atol=2e-14)  # measured 4.4e-16
    change = np.random.default_rng(0).normal(size=10)
    ahead, behind = (numbers_of((MEAN + s * 1e-5 * change).tolist()) for s in (1.0, -1.0))
    rates = np.subtract(ahead, behind) / 2e-5
    assert np.abs(rates - rates_of(MEAN.tolist(), change.tolist())).max() < 3e-8  # measured 7e-9


@pytest.mark.parametrize("size", [6, 9, 10])
def test_draws_have_the_mean_and_the_covariance(size):
    found = parameters(body_of(0.05, size=size), 100_000)
    given, apart = covariance(0.05, size), found[:size] - MEAN[:size, None]
    deviations = np.sqrt(given.diagonal())
    assert np.abs(apart.mean(1) / deviations).max() < 0.015  # measured 0.0054, 0.003 by chance
    assert np.abs(np.std(apart, 1) / deviations - 1.0).max() < 0.03  # measured 0.015
    correlation = given / np.outer(deviations, deviations)
    assert np.abs(np.corrcoef(apart) - correlation).max() < 0.06  # measured 0.030
    exact = MEAN[size:, None]  # known exactly
    assert np.abs(found[size:] - exact).max(initial=0.0) < 4e-15  # measured 0


def test_small_uncertainties_are_a_multivariate_normal():
    found = parameters(body_of(0.002), 20_000)
    normal = stats.multivariate_normal(MEAN, covariance(0.002))
    distance = -2.0 * (normal.logpdf(found.T) - normal.logpdf(MEAN))
    assert stats.kstest(distance, stats.chi2(10).cdf).pvalue > 0.01  # measured 0.5
    wide = stats.multivariate_normal(MEAN, covariance(0.0022))  # another covariance fails
    distance = -2.0 * (wide.logpdf(found.T) - wide.logpdf(MEAN))
    assert stats.kstest(distance, stats.chi2(10).cdf).pvalue < 1e-20


def test_every_draw_is_a_body():
    body, count = body_of(0.3), 20_000
    moments, mass, centre = body.sample(7, 0, count)
    assert not violates_triangle(moments).any() and (mass > 0.0).all()
    about = [i - mass * centre[i] ** 2 for i in range(3)]
    assert np.isfinite(about).all()
    found = parameters(body, count)
    full = symmetric(found[:6])
    second = 0.5 * np.trace(full, axis1=1, axis2=2)[:, None, None] * np.eye(3) - full
    middle = second - found[9][:, None, None] * found[6:9].T[:, :, None] * found[6:9].T[:, None]
    assert np.linalg.eigvalsh(middle).min() > 0.0  # about the centre of mass too
    rng = np.random.default_rng(1)  # normal elements are often none
    plain = stats.multivariate_normal(MEAN, covariance(0.3)).rvs(count, random_state=rng).T
    impossible = violates_triangle(np.linalg.eigvalsh(symmetric(plain[:6])).T)
    assert impossible.mean() > 0.2  # measured 0.27


@pytest.mark.parametrize("axes", ["described", "principal"])
def test_axes_are_named_after_the_nearest(axes):
    """After the nearest axis of the scene, which is described or a principal axis of the mean."""
    even = rm.UncertainInertia(np.diag([2.0, 2.01, 2.02]), 0.01 * np.eye(6))
    for body in (body_of(0.1, axes), rm.Body.from_tensor(even, axes=axes)):
        moments, _, _, turn = body.sample_turned(7, 0, 2000)
        of_scene = np.array(body.axes) if axes == "principal" else np.eye(3)
        frames = np.moveaxis(of_scene @ np.moveaxis(turn, -1, 0), 0, -1)
        back = np.einsum("ijn,jn,kjn->nik", frames, moments, frames)
        known = body.moments.bodies(7, "body.tensor", 0, 2000, body.mass, body.centre)
        assert np.abs(back - symmetric(known[:6])).max() < 2e-14  # measured 2.2e-15
        turns = Rotation.from_matrix(np.moveaxis(turn, -1, 0))  # right-handed
        group = Rotation.create_group("O")
        angles = [(turns * one).magnitude() for one in group]
        assert np.allclose(turns.magnitude(), np.min(angles, 0), rtol=0, atol=1e-7)
        assert turns.magnitude().max() < np.radians(63.0)


DIPOLE, FIELD, THRUST = (0.3, -0.1, 0.5), (1.0, 2.0, -0.5), (0.1, -0.2, 0.3)
OIL = (0.05, 0.04, 0.06, 0.01, -0.005, 0.015)


@pytest.mark.parametrize("of_scene", ["described", "principal"])
def test_members_move_as_in_the_described_axes(of_scene):
    """Euler's equations with the full tensor by scipy, all vectors in the axes of the tensor; a
    scene in the principal axes of the mean has the same members."""
    body = body_of(0.1, of_scene)
    axes = np.array(body.axes) if of_scene == "principal" else np.eye(3)

    def near(v):
        return tuple((axes.T @ v).tolist())

    oil = symmetric(np.array(OIL)[:, None])[0]
    turned = axes.T @ oil @ axes
    effects = (
        rm.UniformField(near(DIPOLE), FIELD),
        rm.BodyTorque(near(THRUST)),
        rm.MatrixDamping(tuple(turned[[0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]].tolist())),
        rm.Gravity(9.81),
    )
    omega, attitude = np.array([0.2, -1.0, 0.6]), Rotation.from_rotvec([0.3, -0.8, 0.4])
    turned_start = (attitude * Rotation.from_matrix(axes)).as_quat(scalar_first=True)
    start = rm.Start(omega=near(omega), attitude=tuple(turned_start.tolist()))
    scene = rm.Scene(body, effects, start)
    ds = rm.simulate(
        scene, "rk4", dt=2e-3, t_end=2.0, every=2.0, members=3, seed=7, save=("omega", "attitude")
    )
    spin = ds.rigid.described("omega").isel(time=-1).values
    ahead = ds.rigid.described("attitude").isel(time=-1).values
    known, plain = parameters(body, 3), ds.omega.isel(time=-1).values
    own = ds.rigid.principal("omega").isel(time=-1).values
    if of_scene == "described":
        assert np.array_equal(spin, plain)

    named = {
        "uniform_field": rm.UniformField(DIPOLE, FIELD), "body_torque": rm.BodyTorque(THRUST),
        "matrix_damping": rm.MatrixDamping(OIL), "gravity": rm.Gravity(9.81),
    }.items()  # fmt: skip
    for i in range(3):
        tensor, arm, mass = symmetric(known[:6, i : i + 1])[0], known[6:9, i], known[9, i]
        whole, turn = Properties(tensor, mass, arm), attitude.as_quat(scalar_first=True)
        a, w, _ = Motion(whole, list(named), omega, turn, 2.0, 2, np.inf).end()
        assert np.abs(spin[:, i] - w).max() < 6e-10  # measured 6.2e-11
        q = Rotation.from_matrix(a).as_quat(scalar_first=True)
        assert abs(abs(q @ ahead[:, i]) - 1.0) < 1e-14  # measured 1.1e-16
        assert np.abs(own[:, i] - w).max() > 0.01  # measured 0.19 or more in other axes
        if of_scene == "principal":
            assert np.array_equal(own, plain)


def test_members_depend_on_their_index_alone_and_files_keep_the_law():
    scene = rm.Scene(body_of(0.1), rm.Gravity(9.81), rm.Start(omega=(0.0, 0.0, 1.0)))
    again = rm.Scene.loads(scene.dumps())
    block, start = starts(again, 0, 96, True)
    some, _ = starts(scene, 32, 32, True)
    assert np.array_equal(block[:, 32:64], some)
    assert start["principal_axes"].shape == (4, 96)
    other = starts(scale_scene(scene, 4.0, 2.0, 2.0), 0, 96, True)[1]
    assert np.allclose(other["moments"], 16.0 * start["moments"], rtol=1e-13, atol=0)
    assert np.allclose(other["centre"], 2.0 * start["centre"], rtol=1e-12, atol=1e-14)


def test_mass_and_centre_are_means_and_starts_in_principal_axes_are_no_tables():
    law = rm.UncertainInertia(TENSOR, covariance(0.05))
    with pytest.raises(SceneError, match="plain numbers, the mean"):
        rm.Body.from_tensor(law, mass=rm.normal(12.0, 1.0))
    start = rm.Start(omega=(np.array([1.0, 2.0]), 0.0, 0.0))
    body = rm.Body.from_tensor(law, axes="principal")
    with pytest.raises(SceneError, match="axes differ from member to member"):
        rm.prepare(rm.Scene(body, start=start).with_run(members=2, dt=0.1, t_end=1))
    described = rm.Scene(rm.Body.from_tensor(law), start=start)
    rm.prepare(described.with_run(members=2, dt=0.1, t_end=1))
    assert np.array_equal(starts(described, 0, 2, True)[1]["start_omega"][0], [1.0, 2.0])


@pytest.mark.parametrize(("together", "low", "high"), [(0.9, 0.0, 0.02), (0.0, 0.4, 0.6)])
def test_the_small_moment_of_a_slender_body_spreads_more(together, low, high):
    """It is at least the difference of the other two, whose errors are larger than itself."""
    mean = np.array([10.0, 56.0, 60.0])
    known = 0.02 * mean
    spread = np.zeros((6, 6))
    spread[:3, :3] = np.diag(known**2)
    spread[1, 2] = spread[2, 1] = together * known[1] * known[2]
    body = rm.Body.from_tensor(rm.UncertainInertia(np.diag(mean), spread))
    moments = body.sample(0, 0, 40_000)[0]
    assert low < moments[0].std() / known[0] - 1.0 < high  # measured 0.007 and 0.51
    off = (moments.mean(1) - mean) / known
    assert np.abs(off).max() < 0.03  # measured 0.019


def test_a_tensor_about_the_centre_that_turns_there_has_no_uncertain_centre():
    """Moved to the structure and back, it would lose 2 m s^2."""
    rows = np.diag([45.0, 60.0, 30.0]).tolist()
    spread = np.diag([1e-6] * 6 + [0.01] * 3).tolist()  # 10 cm
    text = f"""
[body]
tensor = {{ uncertain_inertia = {{ mean = {rows}, covariance = {spread} }} }}
mass = 120.0
centre = [0.01, 0.0, 0.4]
about = "centre"
pivot = "centre"
[start]
omega = [0.0, 0.0, 1.0]
"""
    moments, _, centre = rm.Scene.loads(text).body.sample(0, 0, 200)
    assert np.abs(moments.mean(1) - (45.0, 60.0, 30.0)).max() < 1e-3  # measured 2e-4
    assert not centre.any()
