"""The main job: the contents of a Dataset, its bits, and running it again.

The bits depend on scene, seed and member alone.
"""

import subprocess
import sys
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.physics.dynamics.so3 import vertical
from rigidmc.runs.settled import mostly_flagged
from tests.tools.scenes import DAMPED, STATE, UNSYMMETRIC

FREE = replace(DAMPED, effects=())
SETTINGS = {"dt": 0.02, "t_end": 2.0, "every": 0.5, "members": 300, "seed": 5}
SAVED = (
    *STATE, "energy_drift_max", "l2_drift_max", "status", "start_omega", "start_attitude",
    "moments",
)  # fmt: skip


def same(a, b, members=slice(None)):
    return all(np.array_equal(a[name].values[..., members], b[name].values) for name in SAVED)


@pytest.mark.parametrize("scene", [DAMPED, FREE], ids=["heavy", "free"])
def test_bits_do_not_depend_on_how_it_is_run(scene, tmp_path):
    """tests/whole/test_same_result_everywhere.py has files, directories, threads and blocks."""
    whole = rm.simulate(scene, **SETTINGS)
    assert same(whole, rm.simulate(scene, **SETTINGS, threads=5, block=96))
    fewer = {**SETTINGS, "members": 77}
    assert same(whole, rm.simulate(scene, **fewer), slice(0, 77))
    part = {**SETTINGS, "members": range(101, 165)}
    assert same(whole, rm.simulate(scene, **part), slice(101, 165))
    for picked in (np.array([3, 4, 150, 299]), np.arange(1, 300, 7)):
        given = {**SETTINGS, "members": picked, "output": tmp_path / "b.nc", "force": True}
        part = rm.simulate(scene, **given)
        assert same(whole, part, picked) and part.member.values.tolist() == picked.tolist()
        part.close()
    assert not same(whole, rm.simulate(scene, **{**SETTINGS, "seed": 6}))


def test_noise_goes_by_the_index_of_a_member(monkeypatch):
    """Also across the ranges that are staged at once."""
    scene = rm.Scene.load("brownian_rotor")
    settings = {"t_end": 2e-3, "dt": 2e-5, "every": 2e-4, "save": ("omega",)}
    whole = rm.simulate(scene, members=2000, **settings)
    monkeypatch.setattr("rigidmc.planning.initial.RANGE", 64)
    picked = np.array([0, 1, 63, 64, 65, 500, 1999])
    part = rm.simulate(scene, members=picked, **settings)
    assert np.array_equal(part.omega.values, whole.omega.values[..., picked])
    assert not np.array_equal(part.omega.values, whole.omega.values[..., : picked.size])


def test_bits_in_another_process(tmp_path):
    """A fresh process, which loads the kernel from the disk cache, gets the same bits."""
    scene = tmp_path / "scene.toml"
    scene.write_text(DAMPED.with_run(**SETTINGS).dumps())
    code = (
        f"import rigidmc as rm; rm.simulate(rm.Scene.load({str(scene)!r}), "
        f"output={str(tmp_path / 'other.nc')!r}, threads=1)"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
    with rm.open(tmp_path / "other.nc") as other:
        assert same(rm.simulate(DAMPED, **SETTINGS), other)


def test_layout_and_attributes():
    ds = rm.simulate(DAMPED, **SETTINGS)
    assert dict(ds.sizes) == {"member": 300, "time": 5, "axis": 3, "quat": 4}
    assert np.allclose(ds.time, [0, 0.5, 1.0, 1.5, 2.0], rtol=1e-15)
    assert ds.omega.dims == ("time", "axis", "member")
    assert ds.attitude.dims == ("time", "quat", "member")
    assert ds.energy.dims == ("time", "member")
    for name, variable in ds.data_vars.items():
        assert "long_name" in variable.attrs, name
        assert "units" in variable.attrs or "flag_meanings" in variable.attrs, name
    assert ds.attrs["Conventions"] == "CF-1.11"
    assert ds.status.attrs["flag_meanings"].split()[0] == "ok"
    assert ds.energy_drift_max.attrs["conserved"].startswith("no: viscous_damping")
    assert rm.simulate(FREE, **SETTINGS).l2_drift_max.attrs["conserved"] == "yes"
    assert "every 64th step" in ds.energy_drift_max.attrs["long_name"]


def test_stored_starts_are_what_the_kernel_used():
    ds = rm.simulate(DAMPED, **SETTINGS)
    assert np.array_equal(ds.attitude.values[0], ds.start_attitude.values)
    omega = ds.start_omega.values
    moments = ds.moments.values
    assert np.array_equal(ds.omega.values[0], (omega * moments) * (1 / moments))
    height = np.stack(vertical(tuple(ds.start_attitude.values)))
    energy = (
        0.5 * (moments * omega**2).sum(0)
        + DAMPED.effects[0].g * (ds.mass * (ds.centre.values * height).sum(0)).values
    )
    assert np.allclose(ds.energy.values[0], energy, rtol=1e-14)


@pytest.mark.parametrize("integrator", ["rk4", "exact"])
def test_drift_is_the_largest_over_saves_and_every_32nd_step(integrator):
    """With a save at each step the kernel's maximum equals numpy's, to rounding of the energies."""
    settings = {
        **SETTINGS,
        "every": 0.02,
        "save": ("energy", "l2", "energy_drift", "l2_drift"),
        "integrator": integrator,
    }
    ds = rm.simulate(FREE, **settings)
    for name in ("energy", "l2"):
        drift = np.abs(ds[name] / ds[name][0] - 1).max("time").values
        assert np.abs(drift - ds[f"{name}_drift_max"].values).max() < 1e-15  # measured 1.1e-16
        assert np.array_equal(
            np.abs(ds[f"{name}_drift"]).max("time").values, ds[f"{name}_drift_max"].values
        )
    worst = float(ds.energy_drift_max.max())
    # measured 4.6e-11, 2.8e-15
    assert 1e-12 < worst < 2e-10 if integrator == "rk4" else worst < 8e-15


def test_an_attitude_that_nothing_needs_is_not_stored():
    ds = rm.simulate(FREE, **{**SETTINGS, "save": ("omega",)})
    assert "attitude" not in ds
    assert "start_attitude" not in ds
    assert np.array_equal(ds.omega, rm.simulate(FREE, **SETTINGS).omega)
    assert "start_attitude" in rm.simulate(DAMPED, **{**SETTINGS, "save": ()})


def test_nothing_saved_but_the_summary():
    ds = rm.simulate(DAMPED, **{**SETTINGS, "save": ()})
    assert "omega" not in ds
    assert np.array_equal(ds.energy_drift_max, rm.simulate(DAMPED, **SETTINGS).energy_drift_max)


# impossible bodies, and quaternions of any length
@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
def test_one_row_per_member():
    """Bodies, starts and effect parameters as arrays: each member is the same as alone, and the
    stored file runs again to the same bits.
    """
    rng = np.random.default_rng(1)
    parts = rng.uniform(0.2, 1, (100, 3))
    moments = parts.sum(1, keepdims=True) - parts
    q = rng.normal(size=(100, 4))
    scene = rm.Scene(
        rm.Body.from_moments(
            moments, mass=rng.uniform(1, 2, 100), centre=rng.normal(size=(100, 3))
        ),
        (rm.Gravity(rng.uniform(1, 10, 100)),),
        rm.Start(omega=rng.normal(size=(100, 3)), attitude=q),
    )
    settings = {"dt": 0.005, "t_end": 1.0, "every": 1.0, "save": ("omega", "attitude", "energy")}
    ds = rm.simulate(scene, members=100, **settings)
    for i in (0, 31, 99):
        alone = rm.Scene(
            rm.Body.from_moments(
                tuple(moments[i]), scene.body.mass[i], tuple(c[i] for c in scene.body.centre)
            ),
            (rm.Gravity(scene.effects[0].g[i]),),
            rm.Start(omega=tuple(w[i] for w in scene.start.omega), attitude=tuple(q[i])),
        )
        assert np.array_equal(
            rm.simulate(alone, members=1, **settings).omega[..., 0], ds.omega[..., i]
        )
    assert np.array_equal(ds.gravity_g, scene.effects[0].g)


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # quaternions of any length
@pytest.mark.parametrize("attitude", ["uniform", "quaternions", "angles"])
def test_a_result_file_is_enough_to_run_again(attitude, tmp_path):
    rng = np.random.default_rng(2)
    given = {
        "uniform": "uniform",
        "quaternions": rng.normal(size=(50, 4)),
        "angles": tuple(rng.uniform(0, 3, (3, 50))),
    }[attitude]
    centre = (0.0, rm.uniform(0, 0.1), 0.1)
    start = rm.Start(momentum=(rng.normal(size=50), rm.normal(0, 1), 1.0), attitude=given)
    scene = rm.Scene(
        rm.Body.from_moments((1.0, 2.0, 2.5), mass=1.0, centre=centre),
        (rm.Gravity(rm.normal(9.81, 0.1)),),
        start,
    )
    first = rm.simulate(
        scene,
        members=50,
        seed=9,
        dt=0.025,
        t_end=1.0,
        save=("momentum", "attitude"),
        output=tmp_path / "one.nc",
    )
    again = rm.simulate(rm.Scene.load(tmp_path / "one.nc"), output=tmp_path / "two.nc")
    part = rm.simulate(
        rm.Scene.load(tmp_path / "one.nc"), members=range(33, 40), output=tmp_path / "part.nc"
    )
    part_again = rm.simulate(rm.Scene.load(tmp_path / "part.nc"))
    assert np.array_equal(part.member, np.arange(33, 40))
    assert np.array_equal(part.momentum, first.momentum[..., 33:40])
    assert np.array_equal(part_again.momentum, part.momentum)
    for name in first.data_vars:
        assert np.array_equal(first[name], again[name], equal_nan=first[name].dtype.kind == "f"), (
            name
        )
    assert again.attrs == first.attrs


def test_part_of_an_array_runs_again_as_it_ran(tmp_path):
    """The fastest member decides how finely the exact motion is cut, even if the file does not
    contain that member.
    """
    omega = np.random.default_rng(4).normal(size=(64, 3))
    omega[0] *= 50.0
    scene = rm.Scene(UNSYMMETRIC, (), rm.Start(omega=omega))
    settings = {"integrator": "exact", "dt": 0.5, "t_end": 5.0, "save": ("omega", "attitude")}
    part = rm.simulate(scene, members=range(32, 64), **settings, output=tmp_path / "part.nc")
    again = rm.simulate(rm.Scene.load(tmp_path / "part.nc"))
    assert part.attrs["parts_per_step"] == again.attrs["parts_per_step"] > 4
    assert np.array_equal(part.attitude, again.attitude)
    alone = rm.simulate(
        rm.Scene(UNSYMMETRIC, (), rm.Start(omega=omega[32:])), members=32, **settings
    )
    assert alone.attrs["parts_per_step"] < 4
    assert not np.array_equal(part.attitude, alone.attitude)
    assert np.abs(part.omega.values - alone.omega.values).max() < 1e-12  # measured 2.2e-14


@pytest.mark.parametrize("step", [{"dt": 0.01}, {"turn": 0.2}])
def test_a_bad_member_among_thousands(step):
    """One member that overflows is flagged, frozen and counted; all others equal, to the bit, a run
    without it.
    """
    rng = np.random.default_rng(3)
    omega = rng.normal(size=(4096, 3))
    wild = omega.copy()
    wild[1234] = 1e160
    body = rm.Body.from_moments((1.0, 2.0, 2.5), mass=1.0, centre=(0, 0, 0.1))
    made = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)
        for name, w in (("good", omega), ("bad", wild)):
            scene = rm.Scene(body, (rm.Gravity(9.81),), rm.Start(omega=w, attitude="uniform"))
            made[name] = rm.simulate(
                scene, members=4096, t_end=1.0, every=0.1, save=("omega", "attitude"), **step
            )
    others = np.arange(4096) != 1234
    assert made["good"].status.values.sum() == 0
    assert list(np.flatnonzero(made["bad"].status)) == [1234]
    for name in ("omega", "attitude", "energy_drift_max", "l2_drift_max"):
        assert np.array_equal(
            made["good"][name].values[..., others], made["bad"][name].values[..., others]
        )
    assert np.isfinite(made["bad"].omega.values[:, :, 1234]).all()
    assert made["bad"].encoding["rigidmc"]["flagged"]["non_finite"] == 1


def test_an_impossible_sampled_body_is_flagged():
    """Beyond the pilot a distribution may still give an impossible body: it is flagged and frozen,
    not integrated.
    """
    scene = rm.Scene(
        rm.Body.from_moments((rm.normal(1.0, 0.24), 1.0, 1.0)), (), rm.Start(omega=(1.0, 1.0, 1.0))
    )
    seed = next(s for s in range(50) if _clean_pilot(scene, s))
    ds = rm.simulate(scene, members=60_000, seed=seed, dt=0.1, t_end=1.0)
    bad = ds.status.values == 2
    assert 0 < bad.sum() < 20
    assert np.array_equal(bad, (ds.moments.values[0] > 2) | (ds.moments.values[0] <= 0))
    assert np.isnan(ds.energy_drift_max.values[bad]).all()
    assert np.array_equal(ds.omega.values[0][:, bad], ds.omega.values[1][:, bad], equal_nan=True)


def _clean_pilot(scene, seed):
    try:
        rm.prepare(scene.with_run(seed=seed))
    except rm.SceneError:
        return False
    return True


def test_a_step_that_does_not_divide_t_end_is_reduced_with_a_message():
    with pytest.warns(rm.SceneWarning, match=r"dt reduced from 0.03 to 0.025"):
        ds = rm.simulate(FREE, **{**SETTINGS, "dt": 0.03, "every": 0.1})
    assert ds.attrs["dt"] == pytest.approx(0.025)


def test_a_large_step_warns():
    with pytest.warns(rm.SceneWarning, match=r"omega dt reaches .* more than 1"):
        rm.simulate(FREE, **{**SETTINGS, "dt": 1.0, "every": None})


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # gravity that has no effect
def test_long_drifts_are_cut_and_stay_exact():
    """A splitting of a free body is its exact motion, at any angle of a step, without a warning."""
    scene = rm.Scene(UNSYMMETRIC, (rm.Gravity(0.0),), rm.Start(omega=(100.0, 50.0, 20.0)))
    with pytest.warns(rm.SceneWarning, match="more than 3"):
        cut = rm.simulate(
            scene, integrator="strang", dt=0.1, t_end=1.0, members=1, save=("omega", "attitude")
        )
    assert cut.attrs["parts_per_step"] > 4
    true = rm.simulate(scene, integrator="closed", t_end=1.0, members=1, save=("omega", "attitude"))
    assert np.abs(cut.omega - true.omega).max() < 1e-9
    assert np.abs(np.abs((cut.attitude * true.attitude).sum("quat")) - 1.0).max() < 1e-13


def test_progress_is_reported():
    seen = []
    rm.simulate(FREE, **SETTINGS, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (300 * 100, 300 * 100)


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # gravity upwards
def test_effects_of_one_shape_or_name_are_not_mixed_up():
    """Numba's own dispatch takes tuples of NamedTuples of one shape for one type; a second effect
    would get the torque of the first.
    """

    class Gravity(NamedTuple):
        g: float

        def torque(self, body, q):
            down = vertical(q)
            return self.g * body.p3 * down[1], -self.g * body.p3 * down[0], 0.0

    body = rm.Body.from_moments((1.0, 2.0, 2.5), mass=1.0, centre=(0, 0, 0.1))
    ends = []
    for effect in (
        rm.Gravity(9.81),
        Gravity(9.81),
        Gravity(-9.81),
        rm.ViscousDamping(9.81),
        rm.Gravity(9.81),
        rm.Gravity(-9.81),
    ):
        ds = rm.simulate(rm.Scene(body, effect, rm.Start(omega=(1, 0, 0))), members=1, t_end=1.0)
        ends.append(float(ds.omega[-1, 0, 0]))
    assert ends == pytest.approx(
        [1.4769072, 1.4769072, 0.57623184, 5.49e-5, 1.4769072, 0.57623184], rel=1e-5
    )
    assert ends[0] == ends[4]


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([np.nan, 0.5, np.nan], ""),  # estimates leave a minority out
        ([np.nan, 0.5], ""),
        ([2.0, 0.5, np.nan], "2 of 3 members are flagged (1 energy_drift, 1 non_finite) at"
         " 0.5 to 2 s and keep the last good state, of at most 64 steps before"),
        ([0.0, 0.0], "all 2 members are flagged (1 energy_drift, 1 non_finite) at 0 s and keep"),
        ([0.5], "the member is flagged (1 non_finite) at 0.5 s and keeps the last good state"),
    ],
)  # fmt: skip
def test_a_run_says_if_most_members_stand_still(times, words):
    count = int(np.isfinite(times).sum())
    kinds = {"ok": len(times) - count, "energy_drift": count - 1, "non_finite": 1}
    result = xr.Dataset({"status_time": ("member", np.array(times))})
    result.encoding["rigidmc"] = {"flagged": kinds}
    note = mostly_flagged(result)
    assert note.startswith(words) and bool(note) == bool(words)
