"""One inertia tensor per member: axes by numpy, motion by scipy, and what is refused."""

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.views.descriptions import describe_scene
from tests.physics.effects.laws import Motion, Properties

COUNT = 5
SOME = np.random.default_rng(4)
ERRORS = SOME.normal(0.0, 0.1, (COUNT, 3, 3))
TENSORS = np.diag([2.0, 3.0, 4.0]) + 0.5 * (ERRORS + np.swapaxes(ERRORS, 1, 2))
SIX = TENSORS[:, [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]]


def described(sampled):
    """Tensors in the described axes from moments and axes of the members."""
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
    text = (
        f'[body]\ntensor = {{ table = "t.csv", columns = [{words}] }}\n'
        "[start]\nomega = [0.1, 0.2, 1.0]\n"
    )
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
