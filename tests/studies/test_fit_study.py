"""What `fit` says and writes: its table, the fitted scene, the pictures, and what it refuses."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError, SceneWarning
from rigidmc.scene.parameters import with_parameters
from rigidmc.scene.varied import variables
from rigidmc.studies.fit import study as fit_study
from rigidmc.studies.fit.table import in_digits
from rigidmc.studies.fit.table import table as lines_of
from tests.tools.commands import COMMAND, invoke

ROOT = Path(__file__).parents[2]
RACKET = {"effects.quadratic_drag.drag": 3e-5}
FREE = "body.moments,start.omega"
DRAG = "effects.quadratic_drag.drag"
SENSOR = "bias,alignment"


@pytest.fixture(scope="module")
def dragged():
    """The fit of the shipped record by the scene that made it."""
    scene = rm.Scene.load("tennis_racket", RACKET)
    return rm.fit(scene, "toss", f"{FREE},{DRAG}", nuisances=SENSOR, trials=20)


@pytest.fixture(scope="module")
def free():
    """The fit without drag."""
    return rm.fit("tennis_racket", "toss", FREE, nuisances=SENSOR, trials=20)


@pytest.mark.parametrize(("value", "deviation", "texts"), [
    (9.00251, 0.0044, ("9.0025", "0.0044")),
    (0.40048, 0.0025, ("0.4005", "0.0025")),
    (-123.456, 12.0, ("-123", "12")),
    (3.0734e-5, 1.2e-6, ("3.07e-05", "1.2e-06")),
    (0.001, 5.0, ("0.0010", "5")),
    (0.017482, np.inf, ("0.01748", "not shown")),
    (2.0, 0.0, ("2", "0")),
])  # fmt: skip
def test_digits_follow_the_deviation(value, deviation, texts):
    assert in_digits(value, deviation) == texts


def test_the_right_model_says_nothing_more(dragged):
    text = "\n".join(lines_of(dragged))
    assert dragged.sizes["answer"] == 1 and "another answer" not in text
    assert "leaves something out" not in text and "--set" not in text
    found = dragged.ratio.sel(over="body.moments.3").values[:2]
    off = (found - np.array([0.00121, 0.01638]) / 0.01748) / dragged.ratio_deviation.values[:2, 2]
    assert np.abs(off).max() < 0.5  # measured 0.07
    assert 0.85 < dragged.attrs["reduced_chi_square"] ** 0.5 < 1.1  # measured 0.934


def test_a_missing_drag_is_proposed_as_it_is_typed(free, tmp_path):
    text = "\n".join(lines_of(free))
    assert "leaves something out" in text and str(free.torque.values[0]) == "quadratic drag"
    assert f'--set "{free.setting.values[0]}" --free ...,{DRAG}' in text
    words = "--set", str(free.setting.values[0]), "--free", f"{FREE},{DRAG}"
    done = invoke("fit", "tennis_racket", "toss", *words, "--nuisances", SENSOR, "--trials", 4)
    assert done.exit_code == 0 and "leaves something out" not in done.output, done.output


def test_the_written_scene_runs_as_the_body_did(dragged, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = "--set", f"{DRAG}=3e-5", "--free", f"{FREE},{DRAG}", "--nuisances", SENSOR
    done = invoke("fit", "tennis_racket", "toss", *words, "--trials", 4, "--scene", "fitted.toml")
    assert done.exit_code == 0 and "wrote fitted.toml" in done.output, done.output
    again = invoke("fit", "tennis_racket", "toss", *words, "--trials", 4, "--scene", "fitted.toml")
    assert again.exit_code != 0  # it replaces nothing without --force
    scene = rm.Scene.load("fitted.toml")
    ds = rm.simulate(scene, members=200, t_end=1.0, every=0.1, save="omega")
    assert (ds.status == 0).all()  # every draw is a body
    start = ds.omega.isel(time=0)
    places = [f"start.omega.{i}" for i in (1, 2, 3)]
    width = dragged.deviation.sel(parameter=places).values
    np.testing.assert_allclose(start.std("member"), width, rtol=0.2)  # of 200: 5 %


def test_members_of_the_fitted_scene_spread_as_the_data_allow(dragged):
    """At the end of the record, beside derivatives and covariance: a standard deviation of 4,000
    members has 1.1 %. Vectors that have nothing in common spread up to ten times as far."""
    scene = rm.Scene.loads(dragged.attrs["fitted"])
    names = [str(name) for name in dragged.parameter.values if not name.startswith("omega.")]
    value = dragged.value.sel(answer=0, parameter=names)
    covariance = dragged.covariance.sel(parameter=names, other=names)
    nominal = with_parameters(scene.model, dict(zip(names, value.values, strict=True)))
    end = float(dragged.sample_time.max())
    run = {"t_end": end, "every": end, "dt": 0.01, "integrator": "rk8", "save": "omega"}
    ds = rm.simulate(scene.with_model(nominal), members=1, wrt=names, **run)
    jacobian = ds.d_omega.isel(time=-1, member=0).transpose("axis", "parameter").values
    wanted = np.sqrt(np.diag(jacobian @ covariance.values @ jacobian.T))

    def spread(model):
        found = rm.simulate(scene.with_model(model), members=4000, **run)
        return found.omega.isel(time=-1).std("member").values

    np.testing.assert_allclose(spread(scene.model), wanted, rtol=0.05)  # measured 0.011
    apart = {}
    for vector in ("body.moments", "start.omega"):
        some = [name for name in names if name.startswith(vector)]
        own = covariance.sel(parameter=some, other=some).values
        own = own + 1e-12 * np.trace(own) * np.eye(3)  # the size of the moments is not shown
        apart[vector] = rm.Correlated(value.sel(parameter=some).values, own)
    found = spread(with_parameters(nominal, apart, "", variables(nominal)))
    assert (found > 2.0 * wanted).all()  # measured 10, 7.7 and 2.9 times


def test_members_run_whose_fitted_damping_may_drive_them():
    matrix = "effects.matrix_damping.matrix"
    scene = rm.Scene.load("tennis_racket", {matrix: [0.0] * 6})
    study = rm.fit(scene, "toss", f"start.omega,{matrix}", nuisances=SENSOR, trials=1)
    fitted = rm.Scene.loads(study.attrs["fitted"])
    with pytest.raises(rm.SceneError, match="drives some rotations"):
        rm.simulate(fitted.with_run(anti_damping=False), members=50, t_end=0.1)
    with pytest.warns(rm.SceneWarning, match="damping may be negative"):
        ds = rm.simulate(fitted, members=50, t_end=0.1)
    assert (ds.status == 0).all()


def test_the_order_of_free_does_not_matter(dragged):
    """With derivatives in another order than parameters, residuals are 23 times their noise."""
    scene = rm.Scene.load("tennis_racket", RACKET)
    study = rm.fit(scene, "toss", f"start.omega,{DRAG},body.moments", nuisances=SENSOR, trials=4)
    assert np.array_equal(np.sort(study.parameter), np.sort(dragged.parameter))
    found = study.deviation.sel(parameter=dragged.parameter).values
    np.testing.assert_allclose(found, dragged.deviation.values, rtol=1e-3)  # measured 0


def test_the_moments_of_a_solid_are_first_guesses():
    """A phone, whose moments are not quite as of its outline."""
    body = rm.Body.box(0.18, (0.0715, 0.147, 0.0074))
    true = np.array(body.moments) * (1.03, 0.95, 1.01)
    start = rm.Start(omega=(9.0, 0.5, 0.6))
    ds = rm.simulate(
        rm.Scene(rm.Body(tuple(true)), start=start), "rk8", dt=0.01, t_end=0.99, every=0.01,
        save="omega", members=1,
    ).isel(member=0)  # fmt: skip
    study = rm.fit(rm.Scene(body, start=start), ds, FREE, noise={"omega": 0.01}, trials=4)
    off = np.abs(study.ratio.values[:2, 2] - true[:2] / true[2])
    assert (off < 1e-6).all()  # of exact data: measured 1e-8
    assert rm.Scene.loads(study.attrs["fitted"]).body.shape == ()


def test_a_torque_that_gains_little_is_not_proposed(free):
    """A hand in the record leaves residuals that a torque explains no better than chance."""
    lines = lines_of(free.assign(gain=free.gain * 0.0 + 2.0))
    assert lines[-1].endswith("was the body held for a time (--between)?")
    assert not any("--set" in line for line in lines)


def test_a_drag_that_is_not_there_makes_no_other_answers():
    """Trials that reach drag 0 go on along it: steps clipped there rest in another answer."""
    body, start = rm.Body((0.82, 0.2, 1.0)), rm.Start(omega=(15.0, 0.35, 0.6))
    ds = rm.simulate(
        rm.Scene(body, start=start), "rk8", dt=0.005, t_end=0.65, every=0.005, save="omega",
        members=1,
    ).isel(member=0)  # fmt: skip
    ds["omega"] = ds.omega + np.random.default_rng(3).normal(0.0, 0.005, ds.omega.shape)
    scene = rm.Scene(body, rm.QuadraticDrag(1e-2), start)
    study = rm.fit(scene, ds, f"{FREE},{DRAG}", nuisances=SENSOR, trials=40)
    assert study.sizes["answer"] == 1


def test_a_solid_that_is_known_stays():
    """A box whose start alone is fitted: refused, as its moments were asked for as parameters."""
    start = rm.Start(omega=(9.0, 0.5, 0.6))
    scene = rm.Scene(rm.Body.box(0.18, (0.0715, 0.147, 0.0074)), start=start)
    ds = rm.simulate(
        scene, "rk8", dt=0.01, t_end=0.5, every=0.01, save="omega", members=1
    ).isel(member=0)  # fmt: skip
    study = rm.fit(scene, ds, "start.omega", noise={"omega": 0.01}, trials=4)
    off = np.abs(study.value.values[0] - start.omega)
    assert (off < 5e-6).all()  # of exact data: measured 5e-7
    assert rm.Scene.loads(study.attrs["fitted"]).body.shape == scene.body.shape
    with pytest.raises(OptionError, match=r"did you mean 'body\.moments'"):
        rm.fit(scene, ds, "moments")


def readings_of_a_top(attitude, observables):
    """(scene, its table) of a top, with noise of .01."""
    body = rm.Body.from_moments((1.0, 1.2, 1.7), mass=1.0, centre=(0.0, 0.0, 0.1))
    start = rm.Start(omega=(0.3, 0.2, 2.0), attitude=attitude)
    scene = rm.Scene(body, rm.Gravity(9.81), start)
    ds = rm.simulate(
        scene, "rk8", dt=0.01, t_end=3.0, every=0.05, save=("omega", "attitude"), members=1
    ).isel(member=0)  # fmt: skip
    random, table = np.random.default_rng(0), {"t": ds.time.values}
    for name in observables:
        for k, column in enumerate(ds[name].values.T):
            table[f"{name}[{k + 1}]"] = column + 0.01 * random.normal(size=ds.time.size)
    return scene, table


def test_rates_of_a_top_do_not_show_its_azimuth():
    """They change with it by rounding, 6e-14: a step by that went to 1e14 rad."""
    scene, table = readings_of_a_top((0.2, 0.5, 0.1), ["omega"])
    study = rm.fit(scene, table, "start.attitude.phi,start.attitude.theta", trials=4)
    assert study.attrs["unseen"].startswith("the data do not show start.attitude.phi: give it")
    assert np.isinf(study.deviation.values).tolist() == [True, False]
    assert float(study.value[0, 0]) == 0.2  # the user's
    assert abs(float(study.value[0, 1]) - 0.5) < 4.0 * float(study.deviation[1])  # measured 0.9


def test_streams_have_the_order_of_their_names_in_every_process():
    """A set has another order in another process: for half of the seeds, attitudes came first."""
    text = (
        "from tests.studies.test_fit_study import readings_of_a_top as r;"
        "from rigidmc.studies.fit.setup import records_of as of;"
        "print(*of(*r((0.2, 0.5, 0.1), ['omega', 'attitude']), {}, None, None, ())[0].times)"
    )
    for seed in "123":  # with a set, 1 and 2 gave attitude omega
        made = subprocess.run(
            [sys.executable, "-c", text], env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert made.stdout.split() == ["omega", "attitude"]


def test_the_length_of_a_quaternion_is_no_unknown():
    attitude = np.array([0.9, 0.1, 0.3, 0.2]) / np.sqrt(0.95)
    scene, table = readings_of_a_top(tuple(attitude), ["omega", "attitude"])
    study = rm.fit(scene, table, "start.omega,start.attitude", trials=4)
    places = [f"start.attitude.{k}" for k in (1, 2, 3, 4)]
    found = study.value.sel(answer=0, parameter=places).values
    deviation = study.deviation.sel(parameter=places).values
    assert study.attrs["unseen"] == "" and np.linalg.norm(found) == pytest.approx(1.0, abs=1e-14)
    assert np.abs((found - attitude) / deviation).max() < 3.0  # measured 1.2
    assert (deviation < 0.0025).all()  # of 61 readings of .01 .0013


def test_a_record_of_each_toss_is_one_row():
    t = np.arange(0.0, 0.5, 0.01)
    rows = []
    for i in range(5):
        start = rm.Start(omega=(0.4, 9.0 + i, 0.3))
        ds = rm.simulate(
            rm.Scene(rm.Body((0.00121, 0.01638, 0.01748)), start=start), "rk8", dt=0.01,
            t_end=0.49, every=0.01, save="omega", members=1,
        )  # fmt: skip
        rows.append(np.column_stack([t, np.full(50, i), ds.omega.values[:, :, 0]]))
    table = np.concatenate(rows)
    table[:, 2:] += 0.004 * np.random.default_rng(1).normal(size=(250, 3))
    data = dict(zip(("t", "toss", "omega[1]", "omega[2]", "omega[3]"), table.T, strict=True))
    study = rm.fit("tennis_racket", data, FREE, split="toss", trials=10)
    assert study.sizes["parameter"] == 3 + 15
    lines = lines_of(study)
    assert "750 readings of 5 records" in lines[0]
    assert sum("start.omega" in line for line in lines) == 3 and len(lines) < 24
    assert any(line.startswith("  start.omega.2 (5 records)") for line in lines)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no process can be killed so")
def test_a_kill_in_the_middle_loses_nothing(tmp_path):
    """Killed when its first batch of trials is written, or its second while the test looks."""
    run, words = tmp_path / "run", ("--free", FREE, "--trials", "320", "-o", "run/")
    command = *COMMAND, "fit", "tennis_racket", "toss", *words
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
    while not list(run.glob("shards/*.nc")):
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    done = {path.name: path.read_bytes() for path in run.glob("shards/*.nc")}
    assert 1 <= len(done) < 5
    assert invoke("resume", run).exit_code == 0
    assert all((run / "shards" / name).read_bytes() == old for name, old in done.items())
    whole = rm.fit("tennis_racket", "toss", FREE, trials=320, threads=1)
    xr.testing.assert_identical(rm.fit.of(run), whole)


@pytest.mark.parametrize(("scene", "free", "rule"), [
    ("tennis_racket", "body.moments", "is random, but a record is one motion"),
    ("tennis_racket", "body.moment", "did you mean 'body.moments'"),
    ("tennis_racket", "body.moments.1", "fit body.moments"),
    ("tennis_racket", "", "name parameters"),
    ("brownian_rotor", "start.omega", "noise separates any two motions"),
])  # fmt: skip
def test_what_cannot_be_fitted_is_refused(scene, free, rule):
    with pytest.raises((OptionError, SceneError), match=rule):
        rm.fit(scene, "toss", free)
    found = invoke("fit", scene, "toss", "--free", free)
    assert found.exit_code == 3 and rule in found.output.replace("\n", " ")


def test_steps_follow_a_rotor_that_outruns_the_rates(monkeypatch):
    """At .04 rad/s, the rates alone would choose steps of 3.5 s, and a rotor nutates in 20 s."""
    body = rm.Body((0.0702, 0.1391, 0.1902))
    scene = rm.Scene(body, rm.Rotor((0.0, 0.03, 0.0)), rm.Start(omega=(0.02, 0.05, -0.03)))
    data = rm.simulate(
        scene, "rk8", dt=0.05, t_end=100.0, every=1.0, save="omega", members=1
    ).isel(member=0)  # fmt: skip
    make, threads = fit_study.make_problem, set()

    def noted(*given, **named):
        threads.add(named["threads"])
        return make(*given, **named)

    monkeypatch.setattr(fit_study, "make_problem", noted)
    words = {"noise": {"omega": 1e-6}, "trials": 2, "threads": 1}
    with pytest.warns(SceneWarning, match="steps 4 times finer"):
        study = rm.fit(scene, data, FREE, **words)
    # measured 0.019 times the noise; with steps of 3.5 s 872
    assert np.abs((study.data - study.model) / study.noise).max() < 0.1
    assert threads == {1} and study.attrs["notes"] == ""
    monkeypatch.setattr(fit_study, "MOST_FINER", 2)  # too long: told, and no trial again
    study = rm.fit(scene, data, FREE, **words)
    assert fit_study.UNRESOLVED in study.attrs["notes"]


def test_the_guide_fits_periods_by_total_least_squares(tmp_path, monkeypatch):
    """Its table, beside the slope of a line through 0 with errors of both columns in closed form.

    Source: Deming, Statistical Adjustment of Data (1943), with his ratio of the variances, 1/4.
    """
    page = (ROOT / "docs/how_to/fits.md").read_text("utf-8").partition("## Periods and other")[2]
    blocks = re.findall(r"```\w*\n(.*?)```", page, re.S)
    for name, text in zip(("gyro.py", "gyro.toml", "periods.csv"), blocks, strict=False):
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    words = shlex.split(blocks[3].replace("\\\n", ""))[1:]
    done = invoke(*words, "--trials", "2", "-o", "fit.nc")
    study = xr.open_dataset("fit.nc")
    _, _, w, period = np.loadtxt("periods.csv", delimiter=",", skiprows=1).T
    a, b = period @ period - 0.25 * w @ w, w @ period
    slope = (a + np.hypot(a, b)) / (2.0 * b)  # a^2 + 4 b^2/4
    weight = 0.02 * 9.81 * 0.2 / (2.0 * np.pi)
    variance = 0.25 + slope**2
    left = np.sum((period - slope * w) ** 2) / variance / 5.0
    deviation = weight * np.sqrt(left * variance / (w @ w))
    (i,) = np.flatnonzero(study.parameter == "body.moments.3")
    assert study.value[0, i] == pytest.approx(weight * slope, rel=1e-4)  # measured 4e-6
    assert study.deviation[i] == pytest.approx(deviation, rel=1e-3)  # measured 6e-5
    assert np.isinf(study.deviation[:2]).all() and np.isinf(study.ratio_deviation[:2, 2]).all()
    assert (
        f"{study.value[0, i].item() * 1e3:.2f} \\pm {study.deviation[i].item() * 1e3:.2f}" in page
    )
    assert done.stdout.count("not shown") == 4
    rule = "noise = .period.: state it for records of one reading"
    with pytest.raises(OptionError, match=rule):
        rm.fit(
            rm.Scene.load("gyro.toml", allow_code=True), "periods.csv", "start.omega.3",
            columns={"period": "period_s"}, split="row",
        )  # fmt: skip


def test_readings_that_leave_nothing_to_judge():
    """One is refused, and of two equal ones the stated noise gives the deviation: each reads
    omega_3 alone, to .02."""
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), start=rm.Start(omega=(0.0, 0.0, 1.0)))
    columns, noise = {"omega": ("", "", "w")}, {"omega": 0.02}
    table = {"t": np.zeros(2), "row": np.array([0.0, 1.0]), "w": np.full(2, 1.5)}
    known = {"columns": columns, "split": "row", "noise": noise, "trials": 2}
    twice = {**table, "row": np.zeros(2), "t": np.array([0.0, 0.1])}
    study = rm.fit(scene, twice, "start.omega.3", **known)
    assert study.value[0, 0] == pytest.approx(1.5)
    assert study.deviation[0] == pytest.approx(0.02 / np.sqrt(2.0), rel=1e-6)  # measured 1e-9
    one = {name: x[:1] for name, x in table.items()}
    with pytest.raises(OptionError, match="holds one reading"):
        rm.fit(scene, one, "start.omega.3", **known)


def test_a_dead_channel_is_left_out():
    """The other two show the body, also that of the largest rate."""
    scene = rm.Scene(rm.Body((0.0012, 0.016, 0.017)), (), rm.Start(omega=(0.4, 9.0, 0.3)))
    true = scene.with_model(scene.model._replace(body=rm.Body((0.00121, 0.01638, 0.01748))))
    data = rm.simulate(true, "rk8", dt=0.01, t_end=1.0, every=0.01, save="omega", members=1)
    data = data.isel(member=0)[["omega"]]
    data["omega"] = data.omega + 0.01 * np.random.default_rng(1).normal(size=data.omega.shape)
    study = rm.fit(scene, data, FREE, columns={"omega": ("omega[1]", "", "omega[3]")}, trials=20)
    assert study.sizes["sample"] == 202 and not study.notes  # the empty name says so
    off = (study.ratio[:2, 2] - np.array([0.06922, 0.93707])) / study.ratio_deviation[:2, 2]
    assert np.abs(off).max() < 3.0  # measured 1.83


def test_steps_follow_a_spin_that_has_no_readings():
    """Of a wobble of 1e-5 of it, as of the pole: the readings alone choose steps of 12 rad."""
    t, random = np.arange(0.0, 100.0, 0.5), np.random.default_rng(2)
    data = {"t": t, "x": 1e-5 * np.cos(t), "y": 1e-5 * np.sin(t)}
    data |= {name: data[name] + 1e-8 * random.normal(size=t.size) for name in "xy"}
    scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), (), rm.Start(omega=(1e-5, 0.0, 1.001)))
    study = rm.fit(scene, data, "start.omega", columns={"omega": ("x", "y", "")}, trials=2)
    off = (study.value[0] - np.array([1e-5, 0.0, 1.0])) / study.deviation
    assert np.abs(off).max() < 3.0  # measured 1.4
