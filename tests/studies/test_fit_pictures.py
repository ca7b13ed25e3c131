"""The pictures and the page of a fit: what they draw, beside members and the Dataset."""

import base64

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection

import rigidmc as rm
from rigidmc.errors import OptionError, OutputExists
from rigidmc.studies.fit.page import motion, save_page
from rigidmc.studies.fit.picture import pictures, shown_parameters
from tests.tools.commands import invoke
from tests.views.test_viewer import data_of

FREE = "body.moments,start.omega"


@pytest.fixture(scope="module")
def study():
    """A fit of rates and energies of a toss of a known body, in two records, with noise alone."""
    body, t = rm.Body((0.00121, 0.01638, 0.01748)), np.arange(0.0, 0.8, 0.01)
    random, rows = np.random.default_rng(3), []
    for k, omega in enumerate([(0.4, 9.0, 0.3), (0.3, -7.0, 0.5)]):
        ds = rm.simulate(
            rm.Scene(body, start=rm.Start(omega=omega)), "rk8", dt=0.01, t_end=0.79, every=0.01,
            save=("omega", "energy"), members=1,
        )  # fmt: skip
        rows.append(np.column_stack([t, np.full(80, k), ds.omega.values[..., 0], ds.energy[:, 0]]))
    table = np.concatenate(rows)
    table[:, 2:] += np.array([0.01] * 3 + [0.003]) * random.normal(size=(160, 4))
    names = ("t", "toss", "omega[1]", "omega[2]", "omega[3]", "energy")
    data = dict(zip(names, table.T, strict=True))
    columns = {"omega": names[2:5], "energy": "energy"}
    return rm.fit("tennis_racket", data, FREE, columns=columns, split="toss", trials=10)


def test_the_band_is_the_spread_of_members_of_the_fitted_scene(study):
    """A standard deviation of 2,000 members has 1.6 %."""
    scene = rm.Scene.loads(study.attrs["fitted"])
    ds = rm.simulate(scene, members=2000, t_end=0.79, every=0.01, save=("omega", "energy"))
    first = study.isel(sample=study.record.values == 1)
    for name, found in (("omega[2]", ds.omega[:, 1]), ("energy", ds.energy)):
        band = first.model_deviation[first.channel.values == name]
        np.testing.assert_allclose(found.std("member"), band, rtol=0.07)  # measured 0.034


def test_readings_lie_in_their_interval(study):
    residual = (study.data - study.model) / study.noise
    error = study.attrs["white"] + study.attrs["lasting"]
    width = 1.96 * np.sqrt((study.model_deviation / study.noise) ** 2 + error)
    assert 0.92 < float((np.abs(residual) < width).mean()) < 0.98  # measured 0.944


def test_each_observable_has_a_panel_and_each_record_a_column(study):
    axes = pictures(study).axes
    assert [a.get_ylabel() for a in axes[::2]] == ["ω [rad/s]", "energy [J]", "residual/noise"]
    assert [a.get_title() for a in axes[:2]] == ["record 1", "record 2"]
    assert len(axes[4].lines) == 4 * 3 + 1  # readings and two ends of their interval; zero
    assert len(pictures(study, record=2).axes) == 3


def test_records_share_limits_that_hold_the_largest_residual_of_all(study):
    wild = study.assign(data=study.data + 50.0 * study.noise * (study.record == 1))
    low, high = pictures(wild).axes[-1].get_ylim()
    residual = (wild.data - wild.model) / wild.noise
    assert high == -low == pytest.approx(1.1 * np.abs(residual).max())


def test_an_ellipse_has_the_form_of_its_correlation(study):
    """A point of it, in the directions of the axes of the picture, has the quantile of 95 %."""
    (axes,) = pictures(study, "corner").axes
    names, *_, relative = shown_parameters(study, None)
    assert [a.get_text() for a in axes.get_xticklabels()] == names and "I₁" in names
    ellipses = next(c for c in axes.collections if isinstance(c, EllipseCollection))
    i, j = np.tril_indices(len(names), -1)
    inverse = [np.linalg.inv(relative[np.ix_(pair, pair)]) for pair in zip(j, i, strict=True)]
    np.testing.assert_allclose(ellipses._angles, np.pi / 4.0)  # up to the right, on the screen
    half = 0.5 * 7.0  # standard deviations of half a cell, over the half width of an ellipse
    for k, (wide, high) in enumerate(zip(ellipses._widths, ellipses._heights, strict=True)):
        for length, way in ((wide, (1.0, 1.0)), (high, (1.0, -1.0))):
            point = 2.0 * half * length * np.array(way) / np.sqrt(2.0)
            assert point @ inverse[k] @ point == pytest.approx(5.991, rel=1e-3)


def test_ratios_stand_for_moments_that_are_not_shown():
    study = rm.fit("tennis_racket", "toss", FREE, nuisances="bias,alignment", trials=4)
    names, units, values, deviation, relative = shown_parameters(study, None)
    assert names[:2] == ["I₁/I₃", "I₂/I₃"] and units[:2] == ["1", "1"] and len(names) == 11
    np.testing.assert_allclose(values[0, :2], study.ratio[:2, 2])
    assert np.array_equal(deviation[:2], study.ratio_deviation[:2, 2])
    scene = rm.Scene.loads(study.attrs["fitted"])
    one, two, three = scene.body.sample(0, 0, 4000)[0]
    found = np.corrcoef(one / three, two / three)[0, 1]
    assert found == pytest.approx(relative[0, 1], abs=1e-3) and found < -0.9  # measured 1e-6


def test_other_answers_are_marked_where_they_are(study):
    """An answer two deviations up in all parameters lies up and to the right in each cell."""
    value = np.stack([study.value[0], study.value[0] + 2.0 * study.deviation])
    more = study.drop_vars(["value", "cost", "ends"]).assign(value=(("answer", "parameter"), value))
    (axes,) = pictures(more, "corner").axes
    (line,) = (one for one in axes.lines if one.get_marker() == "$2$")
    i, j = np.tril_indices(study.sizes["parameter"], -1)
    np.testing.assert_allclose(line.get_xdata() - j, 2.0 / 7.0)
    np.testing.assert_allclose(i - line.get_ydata(), 2.0 / 7.0)  # downwards is larger here
    assert axes.yaxis_inverted()


def test_the_command_draws_both(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = "fit", "tennis_racket", "toss", "--free", FREE, "--trials", 4
    done = invoke(*words, "--plot", "corner.png", "--picture", "corner")
    assert done.exit_code == 0 and "wrote corner.png" in done.output, done.output
    wrong = invoke(*words, "--plot", "x.png", "--picture", "cornr")
    assert wrong.exit_code == 3 and "did you mean 'corner'" in wrong.output.replace("\n", " ")


def test_the_page_has_the_motion_and_the_readings_of_each_record(study, tmp_path):
    assert save_page(study, tmp_path / "fit.html", False)
    known = data_of((tmp_path / "fit.html").read_text())
    assert [len(one["readings"]) for one in known["members"]] == [2, 2]
    second = known["members"][1]["readings"][1]
    assert second["names"] == ["ω₁", "ω₂", "ω₃"] and second["upward"] == "ω [rad/s]"
    part = study.isel(sample=(study.record.values == 2) & (study.channel.values == "omega[2]"))
    for key in ("data", "model"):
        found = np.frombuffer(base64.b64decode(second[key][1]["f4"]), "<f4")
        np.testing.assert_allclose(found, part[key].values, rtol=1e-6)  # of 32 bits
    ends = motion(study).omega.isel(time=-1).sel(axis=2)
    assert float(ends[1]) == pytest.approx(float(part.model[-1]), rel=1e-5)  # measured 4e-8
    with pytest.raises(OutputExists):
        save_page(study, tmp_path / "fit.html", False)


def test_a_record_that_there_is_not(study):
    with pytest.raises(OptionError, match="expected a record from 1 to 2"):
        pictures(study, record=3)
