"""Questions to a result: ds.rigid, rigidmc summary, rigidmc animate."""

import re

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.mechanics.free_top import analyse_free_top
from rigidmc.mechanics.rotation import from_euler
from rigidmc.processes import progress
from rigidmc.views import PICTURES
from tests.tools.commands import invoke


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    path = tmp_path_factory.mktemp("result") / "r.nc"
    start = rm.Start(omega=(rm.normal(0.0, 0.01), 1.0, 0.0), attitude="uniform")
    body = rm.Body((1.0, 2.0, 2.8), mass=1.0, centre=(0.0, 0.0, 0.1))
    scene = rm.Scene(body, rm.Gravity(1.0), start)
    save = ("omega", "attitude", "momentum", "energy", "l2", "energy_drift", "l2_drift")
    run = {"members": 64, "dt": 0.02, "t_end": 4.0, "every": 0.2}
    rm.simulate(scene, save=save, output=str(path), **run).close()
    return path


def test_energy_and_drift_are_those_of_the_kernel(result):
    with rm.open(str(result)) as ds:
        bare = ds[[name for name in ds.data_vars if name not in ("energy", "momentum")]]
        assert np.abs(bare.rigid.energy().values - ds.energy.values).max() < 1e-14  # measured 3e-16
        assert np.abs(bare.rigid.momentum().values - ds.momentum.values).max() < 1e-15
        assert np.abs(ds.rigid.drift().values - ds.energy_drift.values).max() < 1e-12
        with pytest.raises(ValueError, match="attitude"):
            bare.drop_vars("attitude").rigid.energy()


def test_a_selection_has_its_own_energy(tmp_path):
    body = rm.Body((1.0, 2.0, 2.8), mass=rm.uniform(0.1, 2.0), centre=(0.0, 0.0, 0.1))
    start = rm.Start(omega=(0.0, 1.0, 0.0), attitude="uniform")
    scene = rm.Scene(body, rm.Gravity(rm.uniform(1.0, 10.0)), start)
    ds = rm.simulate(scene, members=300, dt=0.05, t_end=1.0, save=("omega", "attitude", "energy"))
    bare = ds.drop_vars("energy")
    for part in ([3, 7, 250], slice(0, 300, 2), slice(10, 20), slice(None, None, -1)):
        off = bare.isel(member=part).rigid.energy() - ds.energy.isel(member=part)
        assert np.abs(off.values).max() < 1e-14
    with pytest.raises(ValueError, match="member"):
        bare.isel(member=7).rigid.energy()


def test_euler_angles_give_the_attitude_back(result):
    with rm.open(str(result)) as ds:
        angles = ds.rigid.euler()
        back = from_euler(np.stack([angles[name].values for name in ("phi", "theta", "psi")], -1))
        apart = np.abs((back * ds.attitude.transpose("time", "member", "quat").values).sum(-1))
        assert np.abs(apart - 1.0).max() < 1e-14  # measured 4e-16
        with pytest.raises(ValueError, match="attitude"):
            ds.drop_vars("attitude").rigid.euler()


def test_the_phase_of_free_motion_runs_evenly():
    """It grows by t/period, to 2e-15 as measured, against saves of the exact flow of random bodies;
    a permanent rotation has none."""
    some = np.random.default_rng(4)
    second = some.uniform(0.2, 1.0, (500, 3))
    moments = second.sum(1)[:, None] - second
    momentum = some.normal(size=(500, 3))
    momentum[0] = 0.0, 1.0, 0.0
    scene = rm.Scene(rm.Body(moments), start=rm.Start(momentum=momentum))
    ds = rm.simulate(scene, integrator="exact", dt=0.1, t_end=5.0, every=0.5, save=("omega",))
    phase, period = ds.rigid.phase().values, analyse_free_top(moments, momentum).period
    off = phase[:, 1:] - phase[0, 1:] - ds.time.values[:, None] / period[1:]
    assert np.abs(off - np.rint(off)).max() < 1e-13 and np.isnan(phase[:, 0]).all()


def test_a_member_runs_again_from_the_dataset(result):
    with rm.open(str(result)) as ds:
        again = ds.rigid.rerun(5, every=0.1)
        assert "equal to the bit at 21 times" in again.attrs["rerun"] and again.sizes["time"] == 41


def test_a_polhode_keeps_energy_and_size(result):
    with rm.open(str(result)) as ds:
        assert ds.rigid.polhode(3, points=50).shape == (50, 3)
        with pytest.raises(ValueError, match="no member 64"):
            ds.rigid.polhode(64)
        curve = ds.rigid.polhode(3).values
        start = ds.start_omega.values[:, 3] * ds.moments.values[:, 3]
        for weights in (np.ones(3), 1.0 / ds.moments.values[:, 3]):
            assert np.abs((curve**2 @ weights) / (start**2 @ weights) - 1.0).max() < 1e-12


def test_pictures_and_summary(result):
    with rm.open(str(result)) as ds:
        assert ds.rigid.plot.polhodes().axes
        assert all(callable(getattr(ds.rigid.plot, name)) for name in PICTURES)
        assert set(PICTURES) <= set(dir(ds.rigid.plot))
        with pytest.raises(AttributeError, match="known"):
            _ = ds.rigid.plot.nothing
        text = ds.rigid.summary()
    assert "64 members to 4 s with rk4" in text
    assert "energy_drift_max" in text
    assert "flagged: none" in text
    assert invoke("summary", result).stdout.strip() == text


def test_even_points_give_no_interval():
    start = rm.Start(omega=(rm.normal(0.0, 0.1), 1.0, 0.0))
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.8)), start=start).with_run(points="sobol")
    save = ("omega_max", rm.Histogram("energy", 0, 2))
    ds = rm.simulate(scene, members=64, t_end=1.0, dt=0.05, save=save)
    assert "+-" not in ds.rigid.summary() and "estimate_rqmc" in ds.rigid.summary()
    # a histogram is of all members, and is not compared
    assert "equal to the bit" in ds.rigid.rerun(7).attrs["rerun"]


def test_lines_of_progress_promise_no_time_before_the_first_result(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_LINE_SECONDS", -1.0)
    show = progress._lines()
    show(0, 4)
    show(1, 4)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "0 % done"
    assert re.fullmatch(r"25 % done, \d+ s left", second)


def test_an_animation(result, tmp_path, monkeypatch):
    from PIL import Image

    monkeypatch.setattr("rigidmc.processes.progress._LINE_SECONDS", 0.0)
    path = tmp_path / "top.gif"
    done = invoke("animate", result, "--member", "7", "-o", path, "--seconds", "0.5", "--fps", "10")
    assert done.exit_code == 0, done.output
    assert re.search(
        r"80 % done, \d+ s left", done.output
    )  # a film takes half a minute: it must show progress
    with Image.open(path) as picture:
        assert picture.n_frames == 5 and picture.size == (864, 450)
        picture.seek(0)
        first = np.asarray(picture.convert("L"), float)
        picture.seek(picture.n_frames - 1)
        assert np.abs(np.asarray(picture.convert("L"), float) - first).max() > 100.0
    assert invoke("animate", result, "--member", "7", "-o", path).exit_code == 6
    for name, options, words in (
        ("top.avi", ("--member", "64"), "ends in"),
        ("other.gif", ("--member", "64"), "members 0 to 63"),
        ("other.gif", (), "the result has 64 members: choose one"),
        # before, the film ended with the run, without a word
        ("other.gif", ("--member", "7", "--until", "1e3 s"), "the run ends at "),
    ):
        bad = invoke("animate", result, *options, "-o", tmp_path / name)
        assert bad.exit_code == 3 and words in bad.stderr, bad.stderr
    with rm.open(str(result)) as ds:
        ds.isel(member=[7]).to_netcdf(tmp_path / "one.nc")
    options = ("-o", str(tmp_path / "one.gif"), "--seconds", "0.2", "--fps", "10")
    made = invoke("animate", tmp_path / "one.nc", *options)
    assert made.exit_code == 0 and "scene: member 7, " in made.stdout, made.output


BODY = rm.Body.from_tensor(rm.UncertainInertia(np.diag([2.0, 2.5, 3.0]) + 0.1, 1e-3 * np.eye(6)))


@pytest.mark.parametrize("kind", ["file", "run", "no dask"])
def test_what_is_read_lazily_stays_lazy(kind, tmp_path, monkeypatch):
    pytest.importorskip("dask")
    scene = rm.Scene(BODY, start=rm.Start(omega=(0.2, 0.3, rm.normal(1.0, 0.1)))).with_run(
        members=40, dt=0.1, t_end=1.0, every=0.5, integrator="rk4", save=("omega", "attitude")
    )
    if kind == "run":
        path, file = tmp_path / "r", tmp_path / "s.toml"
        file.write_text(scene.dumps())
        words = ["run", str(file), "--shard-size", "0.002", "-o", f"{path}/"]
        assert invoke(*words).exit_code == 0
    else:
        path = tmp_path / "a.nc"
        rm.simulate(scene, output=str(path)).close()
    if kind == "no dask":
        monkeypatch.setattr("rigidmc.results.principal_axes.find_spec", lambda name: None)
    whole = rm.simulate(scene)
    with rm.open(path) as ds:
        for name in ("omega", "attitude", "start_omega"):
            same = ds.rigid.described(name)  # the variable itself, as lazy as it is
            assert same.identical(ds[name]) and not (kind == "file" and same.variable._in_memory)
            found, wanted = ds.rigid.principal(name), whole.rigid.principal(name)
            assert (found.chunks is None) == (kind == "no dask")
            assert abs(found - wanted).max() < 1e-15  # measured 1.1e-16
            assert abs(found - whole[name]).max() > 0.01  # measured 0.05 or more
            assert found.dims == wanted.dims == whole[name].dims
        for made in (lambda x: x.euler(), lambda x: x.euler("132"), lambda x: x.phase()):
            found, wanted = made(ds.rigid), made(whole.rigid)
            assert bool(found.chunks) == (kind != "no dask")
            off = abs(found - wanted)
            off = off.to_array() if hasattr(off, "data_vars") else off
            assert off.max() < 1e-14  # measured 0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nutation_max", r'was not saved: run with save=\("nutation",\)'),
        ("omega", "is a variable of the result: ds.omega"),
        ("energi", "did you mean 'energy'"),
        ("xyz", "ds.rigid has no 'xyz'$"),
    ],
)
def test_a_name_that_is_not_there(name, words, result):
    with rm.open(str(result)) as ds, pytest.raises(AttributeError, match=words):
        getattr(ds.rigid, name)


def test_a_map_has_no_members():
    """`rm.open` opens maps too, and all xarray Datasets have `rigid`."""
    maps = xr.Dataset({"mean(omega_mean[2])": (("y", "x"), np.ones((2, 2)))})
    for call in (
        maps.rigid.summary, maps.rigid.energy, lambda: maps.rigid.rerun(0),
        lambda: maps.rigid.polhode(0), lambda: maps.rigid.plot.summary(),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="a map or a study, not a result with members"):
            call()
    with pytest.raises(rm.OptionError, match="source: expected a result with members"):
        rm.rerun(maps, 0)
