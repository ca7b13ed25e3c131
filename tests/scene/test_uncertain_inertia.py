"""Inertia tensors with a covariance, and one tensor per member: statistics, existence, motion."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.mechanics.inertia import symmetric, violates_triangle
from rigidmc.mechanics.log_cholesky import numbers_of, parameters_of, rates_of
from rigidmc.planning.unit_scale import scale_scene
from rigidmc.views.descriptions import describe_scene
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
    six = tuple(turned[[0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]].tolist())
    effects = rm.UniformField(near(DIPOLE), FIELD), rm.BodyTorque(near(THRUST))
    effects += rm.MatrixDamping(six), rm.Gravity(9.81)
    omega, attitude = np.array([0.2, -1.0, 0.6]), Rotation.from_rotvec([0.3, -0.8, 0.4])
    turned_start = (attitude * Rotation.from_matrix(axes)).as_quat(scalar_first=True)
    start = rm.Start(omega=near(omega), attitude=tuple(turned_start.tolist()))
    scene = rm.Scene(body, effects, start)
    run = {"dt": 2e-3, "t_end": 2.0, "every": 2.0, "members": 3, "seed": 7}
    ds = rm.simulate(scene, "rk4", save=("omega", "attitude"), **run)
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


COUNT = 5
SOME = np.random.default_rng(4)
ERRORS = SOME.normal(0.0, 0.1, (COUNT, 3, 3))
TENSORS = np.diag([2.0, 3.0, 4.0]) + 0.5 * (ERRORS + np.swapaxes(ERRORS, 1, 2))
SIX = TENSORS[:, [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]]


def described(sampled):
    moments, _, _, frames = sampled
    return np.einsum("ijn,jn,kjn->nik", frames, moments, frames)


def test_each_member_has_its_tensor():
    """All ways to give it; from any first member on."""
    body = rm.Body.from_tensor(TENSORS)
    known = body.sample_turned(7, 0, COUNT)
    assert np.abs(described(known) - TENSORS).max() < 5e-15  # measured 8.9e-16
    assert np.allclose(np.sort(known[0], 0).T, np.linalg.eigvalsh(TENSORS), rtol=1e-14)
    assert np.degrees(np.arccos(np.einsum("iin->in", known[3]))).max() < 45.0  # nearest axes
    for same in (
        TENSORS.tolist(),
        list(TENSORS),
        rm.TensorRows(TENSORS),
        tuple(SIX.T),
        xr.DataArray(np.moveaxis(TENSORS, 0, -1), dims=("row", "column", "member")),
    ):
        assert np.array_equal(rm.Body.from_tensor(same).sample(7, 0, COUNT)[0], known[0])
    assert np.array_equal(body.sample_turned(7, 2, 2)[3], known[3][..., 2:4])
    assert "rows" in repr(body) and len(repr(body)) < 500


def test_members_move_as_by_the_full_tensor():
    """Angular velocities in the described axes, by DOP853."""
    body = rm.Body.from_tensor(TENSORS)
    omega = np.array([0.3, -0.5, 0.8])
    start = rm.Start(omega=tuple(omega.tolist()))
    ds = rm.simulate(rm.Scene(body, start=start), "exact", dt=0.1, t_end=4.0, every=4.0)
    found = ds.omega.isel(time=-1).transpose("member", "axis").values
    for tensor, one in zip(TENSORS, found, strict=True):
        _, true, _ = Motion(Properties(tensor), (), omega, (1.0, 0.0, 0.0, 0.0), 4.0).end()
        assert np.abs(one - true).max() < 1e-9  # measured 1.5e-11
    assert np.abs(found - found[0]).max() > 0.01  # they differ


def test_results_keep_the_tensors(tmp_path):
    body = rm.Body.from_tensor(TENSORS, mass=np.arange(1.0, 1.0 + COUNT))
    scene = rm.Scene(body, start=rm.Start(omega=(0.1, 0.2, 1.0)))
    ds = rm.simulate(scene, "exact", dt=0.1, t_end=0.2, output=tmp_path / "x.nc")
    assert np.array_equal(ds.tensor.transpose("member", "component"), SIX)
    assert ds.mass.values.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    for part in (ds, rm.open(tmp_path / "x.nc"), ds.isel(member=[4, 2])):
        again = rm.rerun(part, member=2)
        assert "equal to the bit" in again.attrs["rerun"]


def test_tensors_from_a_table(tmp_path):
    names = "xx,yy,zz,yz,zx,xy"
    np.savetxt(tmp_path / "t.csv", SIX, "%.17g", ",", header=names, comments="")
    words = ", ".join(f'"{name}"' for name in names.split(","))
    table = f'{{ table = "t.csv", columns = [{words}] }}'
    text = f"[body]\ntensor = {table}\n[start]\nomega = [0.1, 0.2, 1.0]\n"
    (tmp_path / "s.toml").write_text(text)
    scene = rm.Scene.load(tmp_path / "s.toml")
    assert "tensor_rows(rows = one of 5 rows, mean" in describe_scene(scene, 1)
    wanted = rm.Body.from_tensor(TENSORS).sample(0, 0, COUNT)[0]
    assert np.array_equal(scene.body.sample(0, 0, COUNT)[0], wanted)
    (tmp_path / "s.toml").write_text(text.replace('"xx", ', ""))
    with pytest.raises(rm.SceneError, match="a tensor 6, xx, yy, zz, yz, zx, xy"):
        rm.Scene.load(tmp_path / "s.toml")


def test_about_the_centre_of_mass():
    """I - m (c^2 1 - c c^T), with a mass for each member."""
    mass, c = np.linspace(1.0, 1.2, COUNT), np.array([0.1, -0.2, 0.3])
    body = rm.Body.from_tensor(TENSORS, mass, tuple(c)).with_pivot_at_centre()
    shift = c @ c * np.eye(3) - np.outer(c, c)
    wanted = TENSORS - mass[:, None, None] * shift
    assert np.abs(described(body.sample_turned(0, 0, COUNT)) - wanted).max() < 5e-15
    assert body.centre == (0.0, 0.0, 0.0)
    with pytest.raises(rm.SceneError, match="plain numbers"):
        body.with_pivot((0.0, 0.0, 1.0))


def changed(row, tensor):
    return np.concatenate([TENSORS[:row], [tensor], TENSORS[row + 1 :]])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.ones((5, 3)), "Body.from_moments"),
        (np.moveaxis(TENSORS, 0, -1), "np.moveaxis"),
        (np.moveaxis(TENSORS[:3], 0, -1), "members last"),
        (TENSORS[:, :2], "expected one tensor for each member"),
        (TENSORS[:0], "expected one tensor for each member"),
        (changed(3, [[2, 0.1, 0], [0, 3, 0], [0, 0, 4]]), "row 3: is not symmetric"),
        (changed(2, np.diag([1.0, 1.0, 3.0])), "row 2: principal moments must be positive and"),
        (changed(1, np.diag([1.0, -1.0, 1.0])), "row 1: principal moments"),
        (changed(0, np.full((3, 3), np.nan)), "row 0: is not finite"),
        (np.ma.masked_array(TENSORS, np.arange(45).reshape(5, 3, 3) == 20), "row 2 is masked"),
        (np.add.outer(np.add.outer(range(3), range(3)), range(3)), "row 0 .3 of 3 rows"),
    ],
)  # fmt: skip
def test_wrong_tensors_are_refused_with_their_row(given, words):
    with pytest.raises(rm.SceneError, match=words) as error:
        rm.Body.from_tensor(given)
    assert len(str(error.value)) < 500


def test_what_a_table_of_tensors_excludes():
    for more, words in (
        ({"centre": np.ones((COUNT, 3))}, "plain numbers or distributions"),
        ({"mass": np.ones(4)}, "same number of rows"),
    ):
        with pytest.raises(rm.SceneError, match=words):
            scene = rm.Scene(rm.Body.from_tensor(TENSORS, **more), start=rm.Start(omega=(0, 0, 1)))
            rm.prepare(scene, dt=0.1, t_end=0.1)
    drawn = rm.Body.from_tensor(TENSORS, centre=(rm.normal(0.0, 0.01), 0.0, 0.0))
    _, _, centre, turn = drawn.sample_turned(3, 0, COUNT)
    back = np.einsum("ijn,jn->ni", turn, centre)
    assert np.abs(back[:, 1:]).max() < 1e-16 and (np.abs(back[:, 0]) > 1e-4).any()
