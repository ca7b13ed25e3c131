"""Vectors drawn as a whole: their laws, their files, what they refuse; laws of a user's own.

Laws are tested by Kolmogorov and Smirnov and by moments. All draws are keyed; none is flaky.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.physics.effects.sums import total_energy
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.planning.steps import physics
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.protocols import VectorDistribution, sample
from rigidmc.scene.parameters import parameter_names
from rigidmc.scene.quantities import Grid
from tests.tools.plans import starts

N = 20_000
MOMENTS = (1.0, 2.0, 2.5)


def drawn(first=0, count=N, moments=MOMENTS, effects=(), **start):
    """(starts of the members of a scene, their rows)."""
    body = rm.Body(moments, mass=1.0, centre=(0.1, 0.2, 0.3))
    block, found = starts(rm.Scene(body, effects, rm.Start(**start)), first, count, True)
    return found, block


def started(scene, first, count, name="start_omega"):
    return starts(scene, first, count, False)[1][name]


def uniform(values, low, high):
    return stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 0.01


def test_a_sphere_is_exact_and_even():
    l = drawn(momentum=rm.Sphere(3.0))[0]["start_momentum"]
    assert np.abs(np.linalg.norm(l, axis=0) - 3.0).max() < 2e-15
    assert all(uniform(x, -3.0, 3.0) for x in l)
    assert uniform(np.arctan2(l[1], l[0]), -math.pi, math.pi)


@pytest.mark.parametrize("axis", [1, 2, 3, -1, -2, -3])
def test_a_cone_is_about_its_axis(axis):
    w = drawn(omega=rm.Cone(axis, 2.0, rm.uniform(0.1, 0.4)))[0]["start_omega"]
    angle = np.arccos(np.sign(axis) * w[abs(axis) - 1] / 2.0)
    assert uniform(angle, 0.1, 0.4) and np.abs(np.linalg.norm(w, axis=0) - 2.0).max() < 1e-15
    others = [w[(abs(axis) + i) % 3] for i in (0, 1)]
    assert uniform(np.arctan2(others[1], others[0]) % (2.0 * math.pi), 0.0, 2.0 * math.pi)


def test_correlated_normals_have_their_covariance():
    covariance = np.array([[1.0, 0.6, -0.3], [0.6, 2.0, 0.1], [-0.3, 0.1, 0.5]])
    w = drawn(omega=rm.Correlated((1.0, -2.0, 0.0), covariance))[0]["start_omega"]
    error = np.abs(np.cov(w) - covariance) / np.sqrt(
        (np.outer(np.diag(covariance), np.diag(covariance)) + covariance**2) / N
    )
    assert error.max() < 4.0  # standard errors
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), w - np.array([[1.0], [-2.0], [0.0]]))
    assert all(stats.kstest(z, "norm").pvalue > 0.01 for z in whitened)


@pytest.mark.parametrize("direction", [None, (1.0, 1.0, 0.0)])
def test_a_shell_is_exact(direction):
    effects = (rm.Gravity(9.81),)
    found, block = drawn(momentum=rm.Shell(4.0, direction), attitude="uniform", effects=effects)
    body, present = physics(effects, block)
    l = found["start_momentum"]
    energy = 0.5 * (l * l / np.array(MOMENTS)[:, None]).sum(0) + total_energy(
        present, body, tuple(found["start_attitude"])
    )
    assert np.abs(energy - 4.0).max() < 2e-14 and not block[layout.STATUS].any()
    if direction is None:  # in components scaled by sqrt(I) it is even on a sphere
        v = l / np.sqrt(np.array(MOMENTS))[:, None]
        assert all(uniform(x, -1.0, 1.0) for x in v / np.linalg.norm(v, axis=0))
    else:
        assert np.abs(l[0] - l[1]).max() < 1e-15 and (l[2] == 0.0).all()


def test_a_shell_of_too_little_energy_has_no_member():
    found, block = drawn(momentum=rm.Shell(0.0), attitude="uniform", effects=(rm.Gravity(9.81),))
    none = np.isnan(found["start_momentum"]).any(0)
    assert 0.3 < none.mean() < 0.7 and np.array_equal(none, block[layout.STATUS] == 2.0)


def test_gibbs_has_its_temperature():
    l = drawn(momentum=rm.GibbsMomentum(0.7))[0]["start_momentum"]
    scaled = l / np.sqrt(0.7 * np.array(MOMENTS))[:, None]
    assert all(stats.kstest(x, "norm").pvalue > 0.01 for x in scaled)
    twice = (l * l / np.array(MOMENTS)[:, None]).sum(0)
    assert stats.kstest(twice / 0.7, stats.chi2(3).cdf).pvalue > 0.01


def test_second_moments_always_make_a_body():
    moments = rm.SecondMoments((rm.uniform(0.0, 1.0),) * 3)
    found, block = drawn(moments=moments, omega=(0.0, 1.0, 0.0))
    i = found["moments"]
    assert (2.0 * i.max(0) <= i.sum(0) * (1.0 + 1e-15)).all() and not block[layout.STATUS].any()
    assert uniform(0.5 * (i[1] + i[2] - i[0]), 0.0, 1.0)


def test_a_member_is_the_same_wherever_it_is_drawn():
    start = {"omega": rm.Cone(2, rm.normal(1.0, 0.1), rm.uniform(0.0, 0.1))}
    both = drawn(**start)[0], drawn(first=1000, count=64, **start)[0]
    all_of_them, some = (one["start_omega"] for one in both)
    assert np.array_equal(all_of_them[:, 1000:1064], some)


def test_grids_are_the_middles_of_equal_parts():
    even = rm.grid(0.0, 1.0, 4, stride=3)
    assert np.array_equal(even.at(0, 14), np.repeat([0.125, 0.375, 0.625, 0.875, 0.125], 3)[:14])
    found = rm.grid(1e-4, 1.0, 4, log=True).values()
    assert np.allclose(found, 10.0 ** np.array([-3.5, -2.5, -1.5, -0.5]), rtol=1e-14)
    assert np.array_equal(even.at(5, 3), even.at(0, 8)[5:])


def test_files_keep_them():
    body = rm.Body(rm.SecondMoments((rm.uniform(0.5, 1.0), 1.0, rm.grid(0.1, 1.0, 3))))
    for vector in (
        rm.Cone(-2, 1.0, rm.uniform(0.0, 0.1)),
        rm.Sphere(rm.normal(1, 0.1)),
        rm.Correlated((0.0, 1.0, 0.0), np.eye(3)),
        rm.Shell(2.0),
        rm.GibbsMomentum(1.0),
    ):
        scene = rm.Scene(body, start=rm.Start(momentum=vector))
        again = rm.Scene.loads(scene.dumps())
        assert again.start.momentum == scene.start.momentum
        assert again.body.moments == scene.body.moments
        assert np.array_equal(starts(again, 0, 32, False)[0], starts(scene, 0, 32, False)[0])


def test_coarse_grids_span_the_same():
    body = rm.Body((rm.grid(0.5, 1.0, 300, 16), 1.0, rm.grid(1.0, 1.4, 200, 4800)))
    tilted = rm.Start(omega=(0, 1, 0), attitude=(0, rm.grid(0.0, 0.3, 200, 4800), 0))
    scene = rm.Scene(body, start=tilted)
    coarse = scene.model.coarse()
    assert coarse.start.attitude[1].count == coarse.body.moments[2].count < 200
    moments, _, _ = coarse.body.sample(0, 0, 4096)
    for x, low, high in ((moments[0], 0.51, 0.99), (moments[2], 1.01, 1.39)):
        assert x.min() < low < high < x.max()
    assert scene.body.moments[0] == Grid(0.5, 1.0, 300, 16)


def test_other_units_move_alike():
    for vector in (
        rm.Cone(2, 1.0, 0.1),
        rm.Correlated((0.0, 1.0, 0.0), np.eye(3)),
        rm.Shell(2.0),
        rm.GibbsMomentum(1.0),
    ):
        scene = rm.Scene(rm.Body(MOMENTS), start=rm.Start(momentum=vector))
        both = scene, scale_scene(scene, 4.0, 1.0, 2.0)
        one, two = (started(s, 0, 32, "start_momentum") for s in both)
        assert np.array_equal(2.0 * one, two)


def turned(**start):
    return drawn(omega=(0.0, 1.0, 0.0), **start)[0]["start_attitude"]


@pytest.mark.parametrize("kappa", [0.0, 0.5, 20.0, 1e6])
def test_fisher_is_about_its_mean(kappa):
    mean = rm.Start(omega=(0, 0, 1), attitude=(1.0, 2.0, -1.0, 0.5)).attitude
    mean = np.array(mean) / np.linalg.norm(mean)
    q = turned(attitude=rm.Fisher(tuple(mean), kappa))
    vector = mean[0] * q[1:] - q[0] * mean[1:, None] - np.cross(mean[1:], q[1:].T).T
    away = np.array([mean[0] * q[0] + mean[1:] @ q[1:], *vector])
    angle = 2.0 * np.arctan2(np.linalg.norm(away[1:], axis=0), np.abs(away[0]))
    grid = np.linspace(0.0, math.pi, 400_001) if kappa < 100 else np.linspace(0.0, 0.02, 400_001)
    law = np.cumsum((1.0 - np.cos(grid)) * np.exp(2.0 * kappa * (np.cos(grid) - 1.0)))
    assert stats.kstest(angle, lambda x: np.interp(x, grid, law / law[-1])).pvalue > 0.01
    assert all(uniform(x, -1.0, 1.0) for x in away[1:] / np.linalg.norm(away[1:], axis=0))
    if kappa == 1e6:
        turn = 2.0 * away[1:] * np.sign(away[0])
        assert np.abs(turn.var(axis=1) * 2.0 * kappa - 1.0).max() < 0.03
    assert np.abs((q**2).sum(0) - 1.0).max() < 1e-15


@pytest.mark.parametrize("kappa", [0.0, 3.0, 1e5])
def test_pointing_is_von_mises_and_fishers(kappa):
    direction = np.array([1.0, -2.0, 0.5]) / math.sqrt(5.25)
    w, x, y, z = turned(attitude=rm.Pointing(tuple(direction), kappa))
    axis = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z])
    less = 0.5 * ((axis - direction[:, None]) ** 2).sum(0)  # 1 - cosine
    law = stats.truncexpon(2.0 * kappa, scale=1.0 / kappa) if kappa else stats.uniform(0.0, 2.0)
    assert stats.kstest(less, law.cdf).pvalue > 0.01
    side = np.cross(direction, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    assert uniform(np.arctan2(np.cross(direction, side) @ axis, side @ axis), -math.pi, math.pi)


SCENE = """
[body]
moments = [1.0, 2.0, 2.5]
[start]
omega = {}
[run]
members = 3
"""


def test_starts_from_a_table(tmp_path):
    names = 'columns = ["wx", "wy", "wz"]'
    (tmp_path / "s.toml").write_text(SCENE.format(f'{{ table = "w.csv", {names} }}'))
    (tmp_path / "w.csv").write_text("wx, wy,wz\n0.1,1.0,0.0\n0.2,1.5,-1e-3\n0.3,2.0,0.5\n")
    scene = rm.Scene.load(tmp_path / "s.toml")
    found = started(scene, 0, 3)
    assert np.array_equal(found, [[0.1, 0.2, 0.3], [1.0, 1.5, 2.0], [0.0, -1e-3, 0.5]])
    import xarray as xr

    xr.Dataset({"w": (("axis", "n"), found), "speed": (("n",), found[1])}).to_netcdf(
        tmp_path / "w.nc", engine="netcdf4"
    )
    columns = [f'{{ table = "w.nc", column = "{name}" }}' for name in ("w[1]", "speed")]
    text = SCENE.format(f"[{', '.join(columns)}, {{ normal = [0.0, 1.0] }}]")
    (tmp_path / "t.toml").write_text(text)
    assert np.array_equal(started(rm.Scene.load(tmp_path / "t.toml"), 0, 3)[:2], found[:2])


@pytest.mark.parametrize(
    ("table", "text", "words"),
    [
        ('{ table = "w.csv", columns = ["wx", "wy", "vz"] }', "wx,wy,wz\n1,2,3\n", "wz"),
        ('{ table = "w.csv", columns = ["wx", "wy"] }', "wx,wy,wz\n1,2,3\n", "3 components"),
        ('{ table = "w.csv", columns = ["wx", "wy", "wz"] }', "wx,wy,wz\n1,2\n", "names 3 columns"),
        ('{ table = "w.csv", columns = ["wx", "wy", "wz"] }', "wx,wy,wz\n1,2,3\n1,b,3\n", "row 2"),
        ('{ table = "w.csv", columns = ["wx", "wy", "wz"] }', "wx,wy,wz\n", "no rows"),
        ('{ table = "w.csv", columns = ["wx", "wy", "wz"] }', "wx,wy,wz\n1;2;3\n", "semicolons"),
        ('{ table = "v.csv", columns = ["wx", "wy", "wz"] }', "", "no such file"),
        ('{ table = "w.txt", columns = ["wx", "wy", "wz"] }', "", ".csv"),
        ('{ table = "w.csv", colums = ["wx", "wy", "wz"] }', "", "columns"),
    ],
)
def test_bad_tables_are_refused(tmp_path, table, text, words):
    (tmp_path / "s.toml").write_text(SCENE.format(table))
    (tmp_path / "w.csv").write_text(text)
    with pytest.raises(SceneError, match=words):
        rm.Scene.load(tmp_path / "s.toml")


SMOOTH = {"omega": (rm.normal(0.3, 0.1), rm.normal(1.0, 0.1), rm.normal(0.2, 0.1))}


def scene_of_points(kind, members=256, seed=3):
    scene = rm.Scene(rm.Body(MOMENTS), start=rm.Start(**SMOOTH))
    return scene.with_run(points=kind, members=members, seed=seed)


def test_sobol_points_are_scipys():
    from scipy.special import ndtri

    from rigidmc.engine.streams import stream_of

    scene = scene_of_points("sobol")
    w = starts(scene, 0, 256, False)[1]["start_omega"]
    rng = np.random.default_rng([3, stream_of("points.sobol") >> 1])
    true = stats.qmc.Sobol(3, rng=rng).random(256).T + 0.5**31
    # measured 2.2e-16: the quantiles are our own
    assert np.abs(w - (np.array([[0.3], [1.0], [0.2]]) + 0.1 * ndtri(true))).max() < 4e-16
    later = starts(scene, 96, 32, True)[1]["start_omega"]
    assert np.array_equal(later, w[:, 96:128])
    assert np.array_equal(starts(scene, 32, 32, False)[1]["start_omega"], w[:, 32:64])


def test_a_latin_hypercube_has_one_member_in_every_stratum():
    scene = scene_of_points("latin_hypercube").with_run(strata=256)
    w = starts(scene, 0, 256, False)[1]["start_omega"]
    for x, mean in zip(w, (0.3, 1.0, 0.2), strict=True):
        assert sorted(np.floor(256 * stats.norm(mean, 0.1).cdf(x))) == list(range(256))
    with pytest.raises(SceneError, match="strata has only"):
        rm.prepare(scene.with_run(members=300))


def test_points_fill_better_than_chance():
    """The mean of a smooth function of the start, 2^12 members, 8 seeds."""
    off = {}
    for kind in ("independent", "sobol", "latin_hypercube"):
        means = []
        for seed in range(8):
            w = started(scene_of_points(kind, 4096, seed).with_run(strata=4096), 0, 4096)
            means.append((w[0] * w[1] + np.sin(w[2]) * w[1] ** 2).mean())
        off[kind] = np.std(means)
    # measured 0.0064, 0.10
    assert off["sobol"] < 0.02 * off["independent"]
    assert off["latin_hypercube"] < 0.5 * off["independent"]


def test_nothing_drawn_needs_no_points():
    scene = rm.Scene(rm.Body(MOMENTS), start=rm.Start(omega=(0, 1, 0)))
    with pytest.raises(SceneError, match="nothing in the scene is drawn"):
        rm.prepare(scene.with_run(points="sobol"))


def test_antithetic_members_come_in_pairs():
    scene = scene_of_points("antithetic")
    w = starts(scene, 0, 64, False)[1]["start_omega"]
    mean = np.array([[0.3], [1.0], [0.2]])
    assert np.abs((w[:, ::2] - mean) + (w[:, 1::2] - mean)).max() < 1e-15
    assert np.array_equal(starts(scene, 31, 5, False)[1]["start_omega"], w[:, 31:36])
    independent = starts(scene_of_points("independent"), 0, 32, False)[1]["start_omega"]
    assert np.array_equal(w[:, ::2], independent)


WEIGHT = 9.81 * math.sqrt(0.01 + 0.04 + 0.09)  # m g h of the body of `drawn`


def height(found):
    """-1 ... 1: the height of the centre of mass over the fixed point, relative to its distance."""
    from rigidmc.physics.dynamics.so3 import vertical

    centre = np.array([0.1, 0.2, 0.3])
    return centre @ np.array(vertical(tuple(found["start_attitude"]))) / np.linalg.norm(centre)


@pytest.mark.slow
def test_the_canonical_ensemble_is_that_of_gravity():
    """Under gravity the height of the centre is exponential: exp(-m g h z/kT) on (-1, 1)."""
    ensemble = {"momentum": rm.GibbsMomentum(1.5), "attitude": "ensemble"}
    found, block = drawn(500_000, 100_000, effects=(rm.Gravity(9.81),), **ensemble)
    kappa = WEIGHT / 1.5
    law = lambda z: np.expm1(-kappa * (z + 1.0)) / np.expm1(-2.0 * kappa)  # noqa: E731
    assert stats.kstest(height(found), law).pvalue > 0.01 and not block[layout.STATUS].any()
    # measured 2.2e-16
    assert np.abs(np.linalg.norm(found["start_attitude"], axis=0) - 1.0).max() < 1e-15
    again = drawn(505_000, 128, effects=(rm.Gravity(9.81),), **ensemble)[0]
    assert np.array_equal(again["start_attitude"], found["start_attitude"][:, 5_000:5_128])


@pytest.mark.parametrize("energy", [5.0, 0.5])
def test_the_microcanonical_ensemble_is_that_of_gravity(energy):
    """Momenta on an energy shell give attitudes the weight sqrt(E - V): the height has the density
    sqrt(E - m g h z) where that is real."""
    start = {"momentum": rm.Shell(energy), "attitude": "ensemble"}
    found, block = drawn(effects=(rm.Gravity(9.81),), **start)
    top = min(1.0, energy / WEIGHT)
    left = lambda z: (energy - WEIGHT * np.minimum(z, top)) ** 1.5  # noqa: E731
    law = lambda z: (left(-1.0) - left(z)) / (left(-1.0) - left(top))  # noqa: E731
    assert stats.kstest(height(found), law).pvalue > 0.01 and not block[layout.STATUS].any()
    body, present = physics((rm.Gravity(9.81),), block)
    l = found["start_momentum"]
    kinetic = 0.5 * (l * l / np.array(MOMENTS)[:, None]).sum(0)
    potential = total_energy(present, body, tuple(found["start_attitude"]))
    assert np.abs(kinetic + potential - energy).max() < 2e-14


@pytest.mark.parametrize(
    ("start", "run", "rule"),
    [
        (rm.Start(momentum=rm.GibbsMomentum(0.01), attitude="ensemble"), {}, "accepts"),
        (
            rm.Start(momentum=rm.GibbsMomentum(1.0), attitude="ensemble"),
            {"points": "sobol"},
            "by rejection",
        ),
    ],
)
def test_an_ensemble_that_cannot_be_drawn_is_refused(start, run, rule):
    scene = rm.Scene(rm.Body(MOMENTS, mass=1.0, centre=(0.1, 0.2, 0.3)), (rm.Gravity(9.81),), start)
    with pytest.raises(SceneError, match=rule):
        rm.simulate(scene.with_run(members=32, t_end=1.0, **run))


def test_an_impossible_start_is_refused():
    body = rm.Body(MOMENTS, mass=1.0, centre=(0.0, 0.0, 0.3))
    scene = rm.Scene(body, rm.Gravity(9.81), rm.Start(momentum=rm.Shell(-20.0)))
    with pytest.raises(SceneError, match="none of the first"):
        rm.simulate(scene, members=32, t_end=1.0)


def test_short_words_take_distributions():
    start = "omega = { sphere = { uniform = [1.0, 2.0] } }"
    text = f"[body]\nmoments = [1.0, 2.0, 2.5]\n[start]\n{start}\n"
    assert rm.Scene.loads(text).start.omega == rm.Sphere(rm.uniform(1.0, 2.0))


def test_an_ensemble_is_that_of_a_momentum():
    with pytest.raises(SceneError, match="distribution of the momentum"):
        rm.Start(omega=(0.0, 0.0, 1.0), attitude="ensemble")


class Bowl(NamedTuple):
    """A user's effect with an energy that does not state how large it may be."""

    k: float

    def torque(self, q):
        k = 2.0 * self.k
        return k * (q[2] * q[3] + q[0] * q[1]), k * (q[0] * q[2] - q[1] * q[3]), 0.0

    def energy(self, q):
        return self.k * (q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3])


def test_an_ensemble_needs_to_know_the_largest_energy():
    start = rm.Start(momentum=rm.GibbsMomentum(2.0), attitude="ensemble")
    with pytest.raises(SceneError, match="energy_scale"):
        rm.simulate(rm.Scene(rm.Body(MOMENTS), (Bowl(3.0),), start), members=32, t_end=1.0)


def test_a_bath_takes_no_part_in_the_law_of_its_ensemble():
    start = {"momentum": rm.GibbsMomentum(1.5), "attitude": "ensemble"}
    heavy, bath = rm.Gravity(9.81), rm.Bath(1.0, 1.5)
    found = [drawn(0, 512, effects=e, **start)[0] for e in ((heavy,), (heavy, bath))]
    assert np.array_equal(*(one["start_attitude"] for one in found))


def test_a_vector_of_an_effect_may_be_correlated():
    """Means and covariance by numpy; the same members from the scene file, and in other units."""
    covariance = np.array([[1e-2, 5e-3, 0.0], [5e-3, 2e-2, -3e-3], [0.0, -3e-3, 1e-2]])
    wheel = rm.Rotor(rm.Correlated((0.0, 0.1, 1.0), covariance))
    scene = rm.Scene(rm.Body((1, 2, 2.5)), wheel, rm.Start(omega=(0.1, 1.0, 0.2)))
    drawn = starts(scene, 0, 20000, False)[1]["rotor_momentum"]
    assert np.abs(drawn.mean(1) - (0.0, 0.1, 1.0)).max() < 4e-3  # measured 1.0e-3
    assert np.abs(np.cov(drawn) - covariance).max() < 6e-4  # measured 2.4e-4
    z = np.linalg.solve(np.linalg.cholesky(covariance), drawn - [[0.0], [0.1], [1.0]])
    assert stats.kstest(z.ravel(), "norm").pvalue > 0.01
    again = rm.Scene.loads(scene.dumps())
    assert np.array_equal(starts(again, 0, 100, False)[1]["rotor_momentum"], drawn[:, :100])
    assert again.dumps() == scene.dumps()
    assert uncertain_numbers(scene.model)[0] == ["effects.rotor.momentum"]
    moved = scale_scene(scene, 2.0, 3.0, 5.0).effects[0].momentum  # kg m2/s times 2 9/5
    assert moved[0].whole.covariance[1][1] == pytest.approx(2e-2 * 3.6**2, rel=1e-15)
    assert all("rotor.momentum" not in name for name in parameter_names(scene.model))
    for wrong in (rm.Gravity(wheel.momentum), rm.Rotor(rm.Cone(1, 1.0, 0.1))):
        with pytest.raises(SceneError, match=r"[Cc]orrelated"):
            rm.Scene(rm.Body((1, 2, 2.5)), (wrong,), rm.Start(omega=(0.1, 1.0, 0.2)))


BODY = rm.Body((1.0, 1.4, 2.0))


@dataclass(frozen=True)
class OnLine(VectorDistribution):
    """A vector along axis 1."""

    size: Any
    variables = ("omega", "momentum")

    def sample(self, source, name, first, count, facts):
        (x,) = sample((self.size,), source, name, first, count)
        return np.stack([x, 0.0 * x, 0.0 * x])


def other(**changed):
    return dataclass(frozen=True)(type("Own", (OnLine,), {"__annotations__": {}, **changed}))


def sampling(sample):
    return other(sample=lambda self, source, name, first, count, facts: sample(first, count))


@pytest.mark.parametrize(("kind", "words"), [
    (other(variables=("speed",)), "Own.variables: is .'speed',., expected a tuple of some"),
    (other(variables=("attitude",)), "Own.variables: is a distribution of attitude, not of omega"),
    (sampling(lambda first, count: np.ones((2, count))), r"Own.sample: returns shape \(2, 5\)"),
    (sampling(lambda first, count: [1.0, 2.0, 3.0]), "Own.sample: returns list, expected an array"),
    (sampling(lambda first, count: np.ones((3, count), int)), "not finite floats"),
    (sampling(lambda first, count: np.full((3, count), np.nan)), "not finite floats"),
    (sampling(lambda first, count: np.random.default_rng().random((3, count))),
     "Own.sample: returns other numbers for a member if other members are"),
    (sampling(lambda first, count: np.random.default_rng(1).random((3, count))),
     "Own.sample: returns other numbers for a member if other members are"),
    (sampling(lambda first, count: nothing), "Own.sample: raises NameError"),  # noqa: F821
    (other(check=lambda self, where: None), "Own.check: returns NoneType, expected Own"),
    (type("Own", (OnLine,), {"__annotations__": {"more": Any}}), "expected a frozen dataclass"),
])  # fmt: skip
def test_laws_that_could_not_be_drawn_from_are_refused(kind, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.Start(omega=kind(1.0))


def test_parameters_are_checked_and_members_do_not_depend_on_others():
    with pytest.raises(rm.SceneError, match=r"\[start.omega.on_line\] size"):
        rm.Start(omega=OnLine("fast"))
    start = rm.Start(omega=OnLine(rm.normal(2.0, 0.5)))
    _, drawn = start.sample_spin(7, 0, 4000, None)
    assert abs(drawn[0].mean() - 2.0) < 0.03  # measured 0.016, two standard errors
    assert abs(drawn[0].std() - 0.5) < 0.02  # measured 0.0008
    assert np.array_equal(start.sample_spin(7, 1000, 10, None)[1], drawn[:, 1000:1010])
    scene = rm.prepare(rm.Scene(BODY, start=start)).scene
    assert "on_line" in scene.dumps() and __file__ in scene.dumps()
