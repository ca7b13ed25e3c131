"""Covariances against closed forms: of a free symmetric top, of a disc, and of distributions."""

import math

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from scipy.linalg import block_diag

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics.rotation import from_rotation_vector, product
from rigidmc.planning.initial import uncertain_numbers
from rigidmc.studies.propagate.covariance import (
    at_means,
    checked_covariance,
    draw_normal,
    moments_of,
    of_distributions,
)
from rigidmc.studies.propagate.picture import cut_linear, ellipse
from rigidmc.studies.propagate.study import Input, deviations_of, linear_until, rounding_of, rows_of

A, C, SPIN, W1, W2 = 1.0, 1.5, 2.0, 0.3, 0.1
START = rm.Start(omega=(W1, W2, SPIN), attitude=(0.3, 0.2, 0.1))
TOP = rm.Scene(rm.Body((A, A, C)), start=START)
NAMES = "start.omega", "body.moments.3"
FACTOR = 1e-2 * np.random.default_rng(1).normal(size=(4, 4))
C0 = FACTOR @ FACTOR.T
DISC = rm.Body((1.0, 1.0, 2.0))


def jacobian(t):
    """Of omega of the free top by its start and I_3: omega_1 + i omega_2 turns at
    (C - A)/A omega_3."""
    turned = np.exp(1j * (C - A) / A * SPIN * t)
    by_rate = 1j * t * (W1 + 1j * W2) * turned
    z = np.array([turned, 1j * turned, by_rate * (C - A) / A, by_rate * SPIN / A])
    return np.array([z.real, z.imag, [0.0, 0.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    "law",
    [
        rm.normal(2.0, 0.5),
        rm.uniform(1.0, 3.0),
        rm.distribution("expon", loc=1.0, scale=0.5),
        rm.normal(2.0, 0.5).between(1.0, math.inf),
        rm.mixture((3.0, rm.normal(0.0, 0.1)), (1.0, rm.uniform(-1.0, 3.0))),
    ],
)
def test_moments_of_distributions_are_those_of_their_numbers(law):
    x = law.ppf((np.arange(400_000) + 0.5) / 400_000)
    assert moments_of(law) == pytest.approx((x.mean(), x.var()), rel=1e-4)


def test_a_scene_gives_means_and_covariances():
    full = ((1e-4, 5e-5, 0.0), (5e-5, 1e-4, 0.0), (0.0, 0.0, 4e-4))
    start = rm.Start(omega=rm.Correlated((1.0, 2.0, 3.0), full), attitude=(0.1, 0.2, 0.3))
    scene = rm.Scene(rm.Body((rm.uniform(1.0, 1.2), 1.1, 2.0)), rm.Gravity(9.81), start)
    names, found = of_distributions(scene.model)
    assert names == ["body.moments.1", *(f"start.omega.{i}" for i in (1, 2, 3))]
    np.testing.assert_allclose(found[1:, 1:], full)
    np.testing.assert_allclose(found[0], [0.04 / 12.0, 0.0, 0.0, 0.0], rtol=1e-12)
    nominal = at_means(scene)
    assert nominal.start.omega == (1.0, 2.0, 3.0)
    assert nominal.body.moments[0] == pytest.approx(1.1)


def test_numbers_in_common_give_their_covariance():
    body = rm.Body((rm.common(1.0, 0.1), rm.common(1.1, 0.05, 0.02), rm.normal(2.0, 0.1)))
    start = rm.Start(omega=(rm.common(1.0, 0.3, 0.0, 0.4), 2.0, 3.0), attitude=(0.1, 0.2, 0.3))
    scene = rm.Scene(body, start=start)
    names, found = of_distributions(scene.model)
    assert names == ["body.moments.3", "body.moments.1", "body.moments.2", "start.omega.1"]
    own, rows = [[0.01]], np.array([[0.1, 0.0, 0.0], [0.05, 0.02, 0.0], [0.3, 0.0, 0.4]])
    np.testing.assert_allclose(found, block_diag(own, rows @ rows.T), rtol=1e-12)
    assert at_means(scene).start.omega == (1.0, 2.0, 3.0)
    # what a number adds to those before it is named after it
    assert uncertain_numbers(scene.model)[0] == [names[1], names[2], names[0], names[3]]


def test_normal_deviations_have_their_covariance_even_if_singular():
    full = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    x = draw_normal(full, 40_000, 1)
    np.testing.assert_allclose(np.cov(x), full, atol=0.06)
    np.testing.assert_allclose(x[0], 2.0 * x[1], atol=1e-7)
    assert not x[2].any()


@pytest.mark.parametrize(
    "bad", [np.eye(2), [[1.0, 2.0], [0.0, 1.0]], np.diag([1.0, np.nan]), "x", np.diag([1.0, -1.0])]
)
def test_matrices_that_are_no_covariance_are_refused(bad):
    with pytest.raises(OptionError, match="covariance = "):
        checked_covariance(bad, 3 if np.array_equal(bad, np.eye(2)) else 2)


@pytest.mark.parametrize(
    ("start", "options", "words"),
    [
        ((0.0, 0.0, 1.0), {}, "nothing in the scene is drawn"),
        ((0.0, 0.0, rm.distribution("cauchy")), {}, "has no finite variance"),
        ((0.0, 0.0, rm.grid(0.0, 1.0, 4)), {}, "grids and tables have no covariance"),
        (rm.Sphere(1.0), {}, "draws a vector, a matrix or an attitude"),
        ((0.0, 0.0, rm.normal(1.0, 0.1)), {"wrt": "start.omega.3"}, "give `covariance`"),
        ((0.0, 0.0, 1.0), {"deviations": "1e-3"}, "wrt: is missing"),
        ((0.0, 0.0, 1.0), {"deviations": (1.0, 2.0), "wrt": "start.omega.3"}, "1 number of at"),
        ((0.0, 0.0, 1.0), {"deviations": 1.0, "wrt": "start.omga.3"}, "did you mean"),
    ],
)
def test_what_has_no_covariance_is_refused(start, options, words):
    options = {**options, **({"deviations": (1.0,)} if options.get("deviations") == 1.0 else {})}
    with pytest.raises((OptionError, SceneError), match=words):
        rm.propagate(rm.Scene(DISC, start=rm.Start(omega=start)), **options)
    with pytest.raises(SceneError, match="the sizes of a cylinder determine its centre"):
        rm.propagate("heavy_top", wrt="body.cylinder.radius", deviations=(1e-3,))
    noisy = rm.Scene(DISC, rm.Bath(0.5, 1.0), rm.Start(omega=(0.0, 0.0, rm.normal(1.0, 0.1))))
    with pytest.raises(SceneError, match="without noise"):
        rm.propagate(noisy)


def result_of(q, omega, status):
    dims = ("time", "quat", "member"), ("time", "member"), ("member",)
    each = zip(dims, (q, omega, status), strict=True)
    return xr.Dataset(dict(zip(("attitude", "energy", "status"), each, strict=True)))


def test_attitudes_deviate_by_a_rotation_vector_in_body_axes():
    own = from_rotation_vector(np.array([[0.3, -0.2, 2.0]]))
    turn = np.array([[0.01, 0.02, -0.03], [0.0, 0.4, 0.0], [1.0, 1.0, 1.0]])
    q = np.stack([product(own[0], from_rotation_vector(one)) for one in turn], -1)[None]
    q[..., 1] *= -1.0  # the same attitude
    some = result_of(q, np.array([[2.0, 3.0, np.nan]]), [0, 0, 1])
    one = result_of(own[:, :, None], np.array([[1.5]]), [0])
    found = deviations_of(some, one, ("attitude", "energy"))
    np.testing.assert_allclose(found[0, :3], turn[:2].T, atol=1e-15)
    np.testing.assert_allclose(found[0, 3], [0.5, 1.5])


def test_results_of_the_whole_run_are_refused_by_name():
    one = result_of(np.zeros((2, 4, 1)), np.zeros((2, 1)), [0])
    one["energy_mean"], one["d_energy_mean"] = one.status, one.status.expand_dims(parameter=2)
    for name in ("energy_mean", "nutation"):
        with pytest.raises(OptionError, match=f"'{name}': has no derivative at each save"):
            rows_of(one, (name,))


def test_rounding_is_measured_by_the_largest_value_of_a_row():
    one = result_of(np.ones((2, 4, 1)), np.array([[-4.0], [3.0]]), [0])
    run = {"save": ("attitude", "energy"), "dtype": "float32", "integrator": "rk4", "dt": 0.1}
    given = Input(TOP.with_run(t_end=10.0, **run), (), C0, None)
    found = rounding_of(given, one) / (32.0 * 10.0 * np.finfo("f4").eps)
    np.testing.assert_allclose(found, [math.pi, math.pi, math.pi, 4.0])


def test_linear_until_the_first_save_that_misses_more():
    def until(*missed):
        times = {"time": np.arange(float(len(missed)))}
        rows = ("time", "row"), [[x, 0] for x in missed]
        return linear_until(xr.Dataset({"missed": rows}, times))

    assert until(np.nan, 0.01, 0.02) == 2.0
    assert until(np.nan, 0.01, 0.2, 0.01) == 1.0
    assert math.isnan(until(0.3, 0.0))


def test_an_ellipse_has_its_covariance():
    c = np.array([[4.0, 1.0], [1.0, 1.0]])
    x = ellipse(c, 2.0)
    np.testing.assert_allclose(np.einsum("in,ij,jn->n", x, np.linalg.inv(c), x), 4.0)
    assert np.isfinite(ellipse(np.diag([1.0, 0.0]), 1.0)).all()


def test_a_linear_ellipse_much_wider_than_the_ensemble_is_cut():
    axes, members = Figure().add_subplot(), np.array([[-1.0, 1.0], [-3.0, -1.0]])
    linear = np.array([[-300.0, 300.0], [-2.0, 2.0]])
    assert cut_linear(axes, members, linear, members) == 300.0
    assert axes.get_xlim() == (-4.0, 4.0)  # 4 widths; the other row is not cut, and has the origin
    assert axes.get_ylim() == (0.0, 1.0)  # as it was
    flat = np.zeros((2, 2))
    assert cut_linear(axes, flat, linear, flat) == 1.0


@pytest.mark.slow  # pytest -m slow tests/studies/test_propagate.py: 20 s
def test_the_covariance_of_a_free_symmetric_top():
    run = {"of": ("omega",), "integrator": "exact", "t_end": 10.0, "every": 2.5, "members": 4000}
    found = rm.propagate(TOP, C0, NAMES, **run)
    for i, t in enumerate(found.time.values):
        true = jacobian(t) @ C0 @ jacobian(t).T
        np.testing.assert_allclose(found.covariance[i], true, atol=1e-13 * np.abs(true).max())
        wrong = jacobian(1.01 * t) @ C0 @ jacobian(1.01 * t).T  # another precession rate
        assert t == 0.0 or np.abs(found.covariance[i] - wrong).max() > 1e-4 * np.abs(true).max()
    # near the start the ensemble has it too, to its sampling error of 1/sqrt(2 4000) = 1.1 %
    near = found.isel(time=0)
    scale = np.sqrt(np.outer(*[np.diagonal(near.covariance)] * 2))
    np.testing.assert_allclose((near.sample_covariance - near.covariance) / scale, 0.0, atol=0.06)


@pytest.mark.slow
def test_the_fraction_that_linearity_misses_in_closed_form():
    """With a spin s of deviation d, the phase p of omega_1 + i omega_2 is normal; at a whole turn
    the row of omega_1 is cos p - 1, which is not linear at all, and omega_2 is sin p."""
    d, turns = 0.05, 4
    t = turns * 2.0 * math.pi * A / ((C - A) * SPIN)
    sd = (C - A) / A * d * t
    start = rm.Start(omega=(W1, 0.0, rm.normal(SPIN, d)))
    run = {"integrator": "exact", "t_end": t, "every": t, "of": ("omega",)}
    found = rm.propagate(rm.Scene(TOP.body, start=start), **run, members=20_000).isel(time=-1)
    square = 0.5 * (1.0 - math.exp(-2.0 * sd**2))
    missed = (square - 2.0 * sd**2 * math.exp(-0.5 * sd**2) + sd**2) / square
    assert float(found.missed[0]) == pytest.approx(1.0, abs=1e-6)
    assert float(found.missed[1]) == pytest.approx(missed, rel=0.05)
    assert float(found.bias[0]) == pytest.approx(W1 * (math.exp(-0.5 * sd**2) - 1.0), rel=0.03)
    assert float(found.missed[2]) < 1e-20
    assert float(found.sample_covariance[1, 1]) == pytest.approx(W1**2 * square, rel=0.03)
