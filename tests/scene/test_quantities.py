"""How members differ: distributions, attitudes; draws depend on seed, name and index only."""

import numpy as np
import pytest
import scipy.stats

import rigidmc as rm
from rigidmc.mechanics.rotation import matrix, quaternion_from_euler
from rigidmc.scene.derivatives import parameter_names_of_derivatives
from rigidmc.scene.quantities import draw, quantity
from rigidmc.scene.sampling import drawn_through

COUNT = 1 << 16


@pytest.mark.parametrize(
    ("made", "law"),
    [
        (rm.normal(2.0, 0.5), scipy.stats.norm(2.0, 0.5)),
        (rm.uniform(-1.0, 3.0), scipy.stats.uniform(-1.0, 4.0)),
        (rm.distribution("gamma", a=2.0, scale=0.1), scipy.stats.gamma(2.0, scale=0.1)),
        (rm.distribution("weibull_min", c=1.5, loc=1.0), scipy.stats.weibull_min(1.5, loc=1.0)),
        (rm.normal(2.0, 0.5).between(1.0, 2.2), scipy.stats.truncnorm(-2.0, 0.4, 2.0, 0.5)),
        (rm.uniform(-1.0, 3.0).between(0.0, np.inf), scipy.stats.uniform(0.0, 3.0)),
        (
            rm.distribution("expon", scale=2.0).between(1.0, 4.0),
            scipy.stats.truncexpon(1.5, loc=1.0, scale=2.0),
        ),
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
    whole = start.sample_attitude(3, 0, 4096)
    for first, count in ((0, 32), (32, 32), (64, 96), (4000, 96)):
        part = start.sample_attitude(3, first, count)
        assert np.array_equal(part, whole[:, first : first + count])
    assert np.abs((whole * whole).sum(0) - 1).max() < 1e-15  # measured 5.6e-16


def test_uniform_attitudes():
    """Each entry of a uniform rotation has mean 0 and variance 1/3; the body axis 3 is uniform on
    the sphere."""
    q = rm.Start(omega=(0, 0, 1), attitude="uniform").sample_attitude(3, 0, COUNT)
    matrices = matrix(q.T)
    # five standard errors; measured 1.7
    assert np.abs(matrices.mean(0)).max() < 5 / np.sqrt(3 * COUNT)
    assert np.abs((matrices**2).mean(0) - 1 / 3).max() < 5 * np.sqrt(4 / 45 / COUNT)
    assert scipy.stats.kstest(matrices[:, 2, 2], scipy.stats.uniform(-1, 2).cdf).pvalue > 1e-3


def test_an_attitude_in_every_notation():
    """Quaternion, matrix, Euler angles and scipy Rotation of one attitude agree; A = Rz(phi)
    Rx(theta) Rz(psi)."""
    from scipy.spatial.transform import Rotation

    angles = (0.3, 0.7, -1.1)
    rotation = Rotation.from_euler("ZXZ", angles)
    q = rotation.as_quat(scalar_first=True)
    whole = rotation.as_matrix()
    forms = angles, tuple(q), whole, rotation, [list(row) for row in whole]
    for form in forms:
        found = rm.Start(omega=(0, 0, 1), attitude=form).sample_attitude(0, 0, 32)[:, 0]
        assert min(np.abs(found - q).max(), np.abs(found + q).max()) < 3e-16
    mirrored = quaternion_from_euler(-0.3, 0.7, -1.1)
    assert min(np.abs(mirrored - q).max(), np.abs(mirrored + q).max()) > 0.1


def test_a_quaternion_that_is_normalised_stays_to_the_bit():
    q = rm.Start(omega=(0, 0, 1), attitude="uniform").sample_attitude(1, 0, 4096)
    same = rm.Start(omega=(0, 0, 1), attitude=np.ascontiguousarray(q.T))
    again = same.sample_attitude(1, 0, 4096)
    assert np.array_equal(q, again)


def test_more_than_four_random_components_are_independent():
    many = draw((rm.normal(0, 1),) * 6, 5, "effects.damping.matrix", 0, COUNT)
    four = draw((rm.normal(0, 1),) * 4, 5, "effects.damping.matrix", 0, COUNT)
    assert np.array_equal(many[:4], four)
    assert np.abs(np.corrcoef(many) - np.eye(6)).max() < 4.5 / np.sqrt(COUNT)
    part = draw((rm.normal(0, 1),) * 6, 5, "effects.damping.matrix", 320, 64)
    assert np.array_equal(many[:, 320:384], part)


def test_a_mixture_has_the_density_of_its_parts_by_weight():
    """Kolmogorov-Smirnov against the weighted sum of distribution functions; with the weights the
    other way round it fails."""
    parts = (3.0, rm.normal(0.0, 0.1)), (1.0, rm.uniform(-1.0, 2.0))
    values = draw((rm.mixture(*parts),), 11, "start.omega", 0, COUNT)[0]
    laws = scipy.stats.norm(0.0, 0.1).cdf, scipy.stats.uniform(-1.0, 3.0).cdf

    def far(first):
        return scipy.stats.kstest(values, lambda x: first * laws[0](x) + (1 - first) * laws[1](x))

    assert far(0.75).pvalue > 1e-3
    assert far(0.25).pvalue < 1e-3


FACTORS = np.array([
    [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-0.2, 0.3, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.1, 0.0, 0.0, 0.2, 0.0],
    [0.05, 0.0, 0.0, 0.0, 0.0, 0.02],
])  # fmt: skip


def correlated_scene(**run):
    """A mass, a start and two effects with numbers in common; one angle draws its own."""
    mass, w, g, rate = (
        rm.common(m, *row) for m, row in zip((2, 1, 9, 0.5), FACTORS.tolist(), strict=True)
    )
    body = rm.Body.from_moments((1.0, 1.0, 1.5), mass=mass, centre=(0.0, 0.0, 0.1))
    start = rm.Start(omega=(0.0, rm.normal(0.0, 1.0), w), attitude=(0.1, 0.2, 0.3))
    effects = rm.Gravity(g), rm.ViscousDamping(rate)
    return rm.Scene(body, effects, start, rm.Run(members=4096, t_end=0.01, dt=0.01, **run))


@pytest.mark.parametrize("points", ["independent", "sobol"])
def test_numbers_in_common_have_their_covariance(points):
    ds = rm.simulate(correlated_scene(points=points), save="omega")
    w = ds.start_omega.values
    found = np.cov([ds.mass.values, w[2], ds.gravity_g.values, ds.viscous_damping_rate.values])
    wanted, size = FACTORS @ FACTORS.T, np.linalg.norm(FACTORS, axis=1)
    # 4.5 standard errors of a covariance; measured 1.9, and .1 of Sobol points
    assert np.abs((found - wanted) / np.outer(size, size)).max() < 4.5 * np.sqrt(2.0 / 4096)
    assert abs(np.corrcoef(w[1], w[2])[0, 1]) < 4.5 / np.sqrt(4096)
    some = rm.simulate(correlated_scene(points=points, first=1000), members=40, save="omega")
    assert np.array_equal(some.gravity_g, ds.gravity_g[1000:1040])


def test_a_number_in_common_moves_with_its_mean():
    scene = correlated_scene()
    names = ("start.omega.3", "start.omega.3.mean", "effects.gravity.g.mean")
    ds = rm.simulate(scene, members=8, wrt=names, save="omega")
    by = ds.d_omega.sel(axis=3).isel(time=-1)
    assert np.array_equal(by.sel(parameter=names[0]), by.sel(parameter=names[1]))
    assert (by.sel(parameter=names[0]) > 0.9).all()
    assert "start.omega.3.1" not in parameter_names_of_derivatives(scene.model)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_truncated_law_keeps_its_digits_in_the_tails(side):
    """N(0, 1) between 10 and 11, where 1 - F is 7.6e-24: quantiles against 50 digits of mpmath."""
    import mpmath as mp

    u = np.array([0.001, 0.25, 0.5, 0.999])
    law = rm.normal(0.0, 1.0).between(*sorted((side * 10.0, side * 11.0)))
    found = np.sort(np.abs(law.ppf(u if side > 0 else 1.0 - u)))
    with mp.workdps(50):
        tail = [mp.erfc(x / mp.sqrt(2)) / 2 for x in (10, 11)]
        wanted = [
            mp.findroot(lambda x, a=a: mp.log(mp.erfc(x / mp.sqrt(2)) / 2) - mp.log(a), 10.1)
            for a in (tail[0] - mp.mpf(float(v)) * (tail[0] - tail[1]) for v in u)
        ]
    assert np.abs(found / np.array(wanted, float) - 1).max() < 1e-14  # measured 6.7e-16


@pytest.mark.parametrize(
    "law",
    [
        rm.normal(2.0, 0.5).between(1.0, np.inf),
        rm.mixture((0.1, rm.normal(2.0, 0.5).between(1.0, 2.5)), (0.2, rm.uniform(2.0, 3.0))),
        rm.mixture((7, rm.distribution("gamma", a=2.0)), (1, rm.normal(3.0, 0.1))),
        rm.common(2.0, 0.0, 0.1, 0.2, 0.0, -0.3),
    ],
)
def test_laws_made_of_laws(law):
    """Written to TOML and read again, drawn in blocks, the numbers are the same."""
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(law, 1.0, 0.0)))
    again = rm.Scene.loads(scene.dumps()).start.omega[0]
    assert again == law
    whole = draw((law,), 5, "start.omega", 0, 1000)
    assert np.array_equal(draw((again,), 5, "start.omega", 0, 1000), whole)
    assert np.array_equal(draw((law,), 5, "start.omega", 320, 64), whole[:, 320:384])
    assert ("scipy" in drawn_through(scene.model, scene.run)) == law.uses_scipy


def test_an_array_is_shared_only_if_nothing_can_change_it():
    memory = np.ones(3)
    view = memory.view()
    view.flags.writeable = False
    copied = quantity(view, "body.mass")
    memory[0] = 5.0  # still changes the view
    assert view[0] == 5.0 and copied[0] == 1.0
    memory.flags.writeable = False
    assert quantity(view, "body.mass") is view
