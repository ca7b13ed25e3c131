"""How much of the saved values is kept, and what a run needs against the free memory and disk."""

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import psutil
import pytest

import rigidmc as rm
from rigidmc.errors import NoRoom, SceneError
from rigidmc.files.netcdf import read
from rigidmc.results.writer import Writer
from rigidmc.runs import resources
from rigidmc.runs.directory import gather, resume
from rigidmc.runs.directory.create import create
from tests.tools.commands import invoke
from tests.tools.scenes import FREE

SCENE = FREE.with_run(every=0.1, turn_limit=0.051)


@pytest.fixture(scope="module")
def full():
    ds = rm.simulate(SCENE)
    assert 10 < (ds.status.values != 0).sum() < 990
    return ds


def alike(one, two):
    assert set(one.variables) == set(two.variables)
    for name in one.variables:
        a, b = one[name].values, two[name].values
        assert a.tobytes() == b.tobytes() if a.dtype.kind in "fi" else (a == b).all(), name


# The others take 3 s each; tests/results/test_export.py has "final".
SELDOM = [pytest.param(one, marks=pytest.mark.slow) for one in ("final", "full")]


@pytest.mark.parametrize("keep", ["none", "thinned", *SELDOM])
def test_flagged_members_are_kept_in_full(full, tmp_path, keep):
    ds = rm.simulate(SCENE, keep=keep, threads=2, block=64)
    bad = np.flatnonzero(full.status.values)
    expected = {
        "none": {}, "full": {"omega": full.omega}, "final": {"omega_final": full.omega[-1]},
        "thinned": {"omega_thinned": full.omega[[0, 10, 20]]},
    }[keep]  # fmt: skip
    saved = {n for n in ds.data_vars if n.startswith("omega") and "flagged" not in n}
    assert saved == {*expected, "omega_max"}
    for name, values in expected.items():
        assert np.array_equal(ds[name].values, values.values)
    if keep != "full":
        assert np.array_equal(ds.flagged_member.values, bad)
        assert np.array_equal(ds.omega_flagged.values, full.omega.values[..., bad])
    with rm.simulate(SCENE, keep=keep, threads=2, block=96, output=tmp_path / "one.nc") as file:
        alike(file, ds)
        assert rm.rerun(file, 7).attrs["rerun"].startswith("equal to the bit")
        assert "members to 2 s" in file.rigid.summary()
    create(SCENE.with_run(keep=keep), tmp_path / "run", 40_000)
    resume.resume(tmp_path / "run")
    alike(rm.open(tmp_path / "run"), ds)
    for words in (["summary"], ["rerun", "--member", "5"], ["plot", "-o", f"{tmp_path}/a.png"]):
        made = invoke(words[0], f"{tmp_path}/run", *words[1:])
        assert made.exit_code == 0, made.output
    with gather.consolidate(tmp_path / "run", tmp_path / "two.nc") as file:
        alike(file, ds)
    assert gather.verify(tmp_path / "run") == []


def test_a_summary_is_over_the_steps():
    scene = SCENE.with_run(save=("omega", "l2_drift"), keep="summary")
    assert scene.recording.retained == {"omega": "summary", "l2_drift": "final"}
    ds = rm.simulate(scene, every=0.05)
    every = rm.simulate(scene, keep="full", every=0.05)
    good = every.status.values == 0
    assert "omega" not in ds and np.array_equal(ds.l2_drift_final.values, every.l2_drift.values[-1])
    more = ds.omega_max.values[:, good] - every.omega.values.max(0)[:, good]
    assert (more >= 0.0).all() and 0.0 < more.max() < 1e-4  # extremes within steps: measured 1.3e-5
    assert np.array_equal(ds.omega_last.values[:, good], every.omega.values[-1][:, good])
    variance = every.omega.values.var(0)[:, good]  # measured 0.02 off: over 41 states, not 40
    np.testing.assert_allclose(ds.omega_variance.values[:, good], variance, 0.0, 0.03)


def test_digits_are_of_saves_alone(full, tmp_path):
    ds = rm.simulate(SCENE.with_run(digits=4), output=tmp_path / "one.nc")
    off = np.abs(ds.omega.values / full.omega.values - 1.0)
    assert 2e-5 < off.max() <= 0.5e-4  # 3.1e-5
    for name in ("start_omega", "omega_max", "energy_drift_max"):
        assert ds[name].values.tobytes() == full[name].values.tobytes()
    assert "4 digits" in rm.rerun(ds, 7).attrs["rerun"]
    ds.close()
    thinned = SCENE.with_run(digits=4, keep="thinned")
    with rm.simulate(thinned, output=tmp_path / "two.nc") as ds:
        flagged = full.omega.values[..., np.flatnonzero(full.status.values)]
        assert np.array_equal(ds.omega_flagged.values, flagged)  # in full
        assert not np.array_equal(ds.omega_thinned.values, full.omega.values[::10])
        assert rm.rerun(ds, 7, save=("energy",)).attrs["rerun"].startswith("compared with nothing")
    odd = np.array([np.nan, np.inf, -np.inf, 0.0, 1.7976931348623157e308])
    rounded = Writer._rounded(SimpleNamespace(_digits={"x": 4}), "x", odd)
    assert np.array_equal(rounded, odd, equal_nan=True)


def test_compressed_is_without_loss(full, tmp_path):
    with rm.simulate(SCENE.with_run(compress=True), output=tmp_path / "one.nc") as ds:
        assert np.array_equal(ds.omega.values, full.omega.values)
    assert set(read(tmp_path / "one.nc")) == {*ds.variables}


@pytest.mark.parametrize(
    ("keep", "words"),
    [({"omga": "final"}, "did you mean 'omega'"), ({"energy": "finl"}, "did you mean 'final'"),
    ("ful", "did you mean 'full'"),
     ({"energy_drift": "summary"}, "no summary"), (3, "keep")],
)  # fmt: skip
def test_bad_values_of_keep(keep, words):
    with pytest.raises(SceneError, match=words):
        SCENE.with_run(keep=keep)


def test_a_run_beyond_memory_or_disk_is_refused(tmp_path, monkeypatch):
    big = SCENE.with_run(members=10**12)
    for refused, words in (
        (lambda: rm.simulate(big), "-o FILE"),
        (lambda: rm.simulate(big, output=tmp_path / "one.nc"), "--keep final"),
        (lambda: create(big, tmp_path / "run"), "--keep final"),
    ):
        with pytest.raises(NoRoom, match=words):
            refused()
    monkeypatch.setattr(resources, "free_memory", lambda: 1000)
    monkeypatch.setattr(resources, "LITTLE", 0)
    with pytest.raises(NoRoom, match="run fewer members"):
        rm.simulate(SCENE, output=tmp_path / "one.nc")
    assert list(tmp_path.iterdir()) == []
    told = invoke("run tennis_racket -o", f"{tmp_path}/one.nc")
    assert told.exit_code == 74 and "nothing was written" in told.stderr
    assert told.stderr.count("rigidmc:") == 1


def test_threads_beyond_the_blocks_take_no_memory(monkeypatch):
    assert rm.simulate(SCENE, threads=10**8).sizes["member"] == 1000
    with pytest.raises(NoRoom, match="fewer than 100,000,000 threads"):
        rm.simulate(SCENE.with_run(members=10**10), threads=10**8)


def test_free_memory_is_what_the_narrowest_group_allows(tmp_path, monkeypatch):
    """Control groups of both versions, the outer one without limit."""
    group = tmp_path / "a" / "b"
    group.mkdir(parents=True)
    for folder, limit in ((tmp_path, None), (tmp_path / "a", "max"), (group, "5000")):
        if limit:
            (folder / "memory.max").write_text(limit)
        (folder / "memory.current").write_text("3000")
        (folder / "memory.stat").write_text("anon 1\ninactive_file 300\nactive_file 100\n")
    names = "memory.max", "memory.current", ("inactive_file", "active_file")
    assert resources._allowed(str(tmp_path), "/a/b", *names) == [2400]
    assert resources._allowed(str(tmp_path), "/a", *names) == []
    assert 0 < resources.free_memory() <= psutil.virtual_memory().total
    asked = []
    monkeypatch.setattr(resources, "_allowed", lambda *given: asked.append(given) or [1])
    assert resources.free_memory() == 1 or not asked
    # a list of names, not the letters of one
    assert all(isinstance(given[4], tuple) and len(given[4]) == 2 for given in asked)
    # Windows and macOS have no control groups
    monkeypatch.setattr(resources, "_free_in_groups", list)
    with patch.object(psutil, "virtual_memory", lambda: SimpleNamespace(available=12345)):
        assert resources.free_memory() == 12345
    with patch.object(psutil, "virtual_memory", side_effect=FileNotFoundError):
        assert resources.free_memory() is None


def test_one_bad_member_of_a_million():
    """It is flagged and saved in full; the other members have the bits of a run without it."""
    count, bad = 1_000_000, 654_321
    speed = 1.0 + np.random.default_rng(3).uniform(0.0, 0.1, count)
    run = SCENE.run.model_dump(exclude={"turn"})
    run |= {"members": count, "turn_limit": 1.0, "t_end": 0.5, "keep": "final"}
    ends = []
    for fast in (1.0, 1e200):
        speed[bad] = fast
        scene = rm.Scene(SCENE.body, start=rm.Start(omega=(0.01, speed.copy(), 0.01)))
        ends.append(rm.simulate(scene.with_run(**run)))
    good, one = ends
    assert (good.status.values == 0).all()
    assert np.array_equal(np.flatnonzero(one.status.values), [bad])
    assert one.flagged_member.values.tolist() == [bad] and one.omega_flagged.shape == (6, 3, 1)
    # 0: of the momentum that is kept
    np.testing.assert_allclose(one.omega_flagged.values[0, :, 0], [0.01, 1e200, 0.01], 1e-15)
    others = np.arange(count) != bad
    for name in good.data_vars:
        if "member" in good[name].dims:
            a, b = (ds[name].values[..., others] for ds in ends)
            assert a.tobytes() == b.tobytes(), name
