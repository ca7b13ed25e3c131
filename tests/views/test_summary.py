"""`rigidmc summary --of`: estimates and intervals, against direct counts."""

import re

import numpy as np
import pytest
from scipy import stats

import rigidmc as rm
from rigidmc.views.summary import summary_text
from tests.tools.commands import invoke

NUMBER = r"([-+.e\d]+|nan|inf)"


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A netCDF file and its Dataset: 300 tops, some of which flip, and two of which are flagged."""
    file = tmp_path_factory.mktemp("result") / "r.nc"
    omega = (rm.normal(0, 0.05), 6.0, rm.normal(0, 0.05))
    scene = rm.Scene(rm.Body((0.00121, 0.01638, 0.01748)), start=rm.Start(omega=omega))
    save = ("omega", "flips", "megno")
    ds = rm.simulate(scene, dt=0.01, t_end=1.0, members=300, save=save).load()
    ds["status"][:2] = 1
    ds.to_netcdf(file)
    return file, ds


def numbers(line):
    """(estimate, low, high) of a line of a summary."""
    found = re.search(rf": {NUMBER}, 95 % between {NUMBER} and {NUMBER}$", line)
    return tuple(map(float, found.groups()))


def test_a_probability_is_a_count(result):
    file, ds = result
    done = invoke("summary", file, "--of", "p(flips >= 1)")
    assert done.exit_code == 0, done.output
    good = ds.flips.values[2:]
    count = int((good >= 1).sum())
    assert 20 < count < 278
    wilson = stats.binomtest(count, 298).proportion_ci(method="wilson")
    wanted = (count / 298, wilson.low, wilson.high)
    assert numbers(done.output.splitlines()[-1]) == pytest.approx(wanted, rel=2e-6)
    # flagged members are left out: with them the numbers differ
    assert (ds.flips.values >= 1).mean() != pytest.approx(count / 298, rel=2e-6)
    assert "flagged: 2" in done.output


def test_several_measures_and_python(result):
    file, ds = result
    some = "mean(flip_first | flips >= 1)"
    texts = [some, "median(megno)", "quantile(megno, 0.9)", "start_omega[1]"]
    words = [word for text in texts for word in ("--of", text)]
    lines = invoke("summary", file, *words).output.splitlines()
    assert [line.strip().split(":")[0] for line in lines[2:]] == texts
    first = ds.flip_first.values[2:]
    first = first[np.isfinite(first)]
    half = stats.t.ppf(0.975, first.size - 1) * stats.sem(first)
    wanted = (first.mean(), first.mean() - half, first.mean() + half)
    assert numbers(lines[2]) == pytest.approx(wanted, rel=2e-6)
    megno = ds.megno.values[2:]
    assert numbers(lines[3])[0] == pytest.approx(np.median(megno), rel=2e-6)
    nine = np.quantile(megno, 0.9, method="averaged_inverted_cdf")
    assert numbers(lines[4])[0] == pytest.approx(nine, rel=2e-6)
    assert numbers(lines[5])[0] == pytest.approx(ds.start_omega.values[0, 2:].mean(), rel=2e-6)
    assert ds.rigid.summary(of=texts).splitlines()[1:] == lines[1:]
    assert ds.rigid.summary(of=texts[0]).splitlines()[-1] == lines[2]
    narrow = summary_text(ds, confidence=0.5, of=texts[0]).splitlines()[-1]
    assert "50 % between" in narrow


@pytest.mark.parametrize(("text", "parts"), [
    ("p(flps >= 1)", ("p(flps >= 1)", "did you mean 'flips'", "known: energy_drift_max")),
    ("mean(passages)", ("no such variable", "--save NAME")),
    ("flips > 1", ("expected p(NAME >= NUMBER)",)),
    ("mean(start_omega)", ("three components", "start_omega[3]")),
    ("quantile(flips, 2)", ("between 0 and 1",)),
])  # fmt: skip
def test_what_is_no_measure_is_told(result, text, parts):
    file, ds = result
    done = invoke("summary", file, "--of", "flips", "--of", text)
    assert done.exit_code == 3 and f"{file}: --of = " in done.output, done.output
    assert all(part in done.output for part in parts) and "Traceback" not in done.output
    with pytest.raises(rm.OptionError, match="of = "):
        ds.rigid.summary(of=text)


def test_points_that_tell_no_interval():
    scene = rm.Scene.load("tennis_racket")
    ds = rm.simulate(scene, members=64, t_end=1.0, points="sobol", save=("flips",))
    lines = ds.rigid.summary(of="p(flips >= 0)").splitlines()
    assert lines[2] == "  p(flips >= 0): 1" and "rigidmc.estimate_rqmc" in lines[3]
