"""Members of a study in parts, what a study will cost, and totals of runs."""

import re
import time

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.runs.price import price
from rigidmc.statistics.estimates import estimate
from rigidmc.studies import totals
from rigidmc.studies.framework.members import compute_batches
from tests.tools.commands import invoke

RUN = {"integrator": "rk4", "t_end": 1.0, "dt": 0.1, "every": 0.5, "save": ("omega",)}
RACKET = rm.Scene.load("tennis_racket").with_run(**RUN)
LINE = re.compile(r"([\d,]+) members x ([\d,]+) steps, .* in all: about ([\d.e+-]+) s on")


def told(words):
    """(members, steps, seconds) of the line that a command prints, and its standard error."""
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    found = LINE.findall(done.stderr)
    assert len(found) == 1, done.stderr
    members, steps, seconds = (float(word.replace(",", "")) for word in found[0])
    return (members, steps, seconds), done.stderr


@pytest.mark.parametrize("points", ["latin_hypercube", "independent"])
def test_parts_have_the_bits_of_the_whole(points):
    """Also members from 5 on: a stratum is one of all members that there are before the last."""
    scene = RACKET.with_run(points=points, members=50, first=5)
    (whole,) = compute_batches(scene, 50, 1, None)
    parts = list(compute_batches(scene, 32, 1, None))
    assert [part.sizes["member"] for part in parts] == [32, 18]
    for name in ("omega", "start_omega"):
        joined = np.concatenate([part[name].values for part in parts], axis=-1)
        assert joined.tobytes() == np.ascontiguousarray(whole[name].values).tobytes()
    assert np.array_equal(whole.omega.values, rm.simulate(scene).omega.values)
    part = rm.simulate(scene, members=range(5, 37)).omega.values  # of 37 strata, not of 55
    assert np.array_equal(part, parts[0].omega.values) == (points == "independent")


@pytest.mark.slow
def test_a_tolerance_chooses_once_for_all_parts(monkeypatch):
    from rigidmc.runs import prepare

    asked, real = [], prepare.choose_integrator

    def choose_integrator(scene):
        asked.append(scene.run.integrator)
        return real(scene)

    monkeypatch.setattr(prepare, "choose_integrator", choose_integrator)
    scene = rm.Scene.load("dzhanibekov").with_run(
        integrator="auto", tolerance=1e-3, members=64, t_end=1.0, save=("omega",), every=0.5
    )
    parts = list(compute_batches(scene, 32, 1, None))
    assert len(parts) == 2 and asked.count("auto") == 1
    assert parts[0].attrs["integrator"] == parts[1].attrs["integrator"] != "auto"


def test_a_study_tells_its_cost_before_its_members(tmp_path, capsys):
    words = "sensitivity", "tennis_racket", "--of", "mean(omega_mean[2])", "--families", 100
    words += "--t-end", 1.0, "--dt", 0.1, "--set", "run.every=0.5"
    (members, steps, seconds), error = told(words)
    assert (members, steps) == (400, 10) and seconds > 0.0 and "of disk" not in error
    _, error = told([*words, "-o", f"{tmp_path}/run/"])
    assert re.search(r"on \d+ threads, [\d.]+ MB of disk", error)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]  # nothing is left beside
    again = invoke("sensitivity", f"{tmp_path}/run", *words[2:4])
    assert again.exit_code == 0 and "members" not in again.stderr  # they exist
    capsys.readouterr()
    rm.sensitivity(RACKET, "mean(omega_mean[2])", 100, progress=True)
    assert "400 members x 10 steps" in capsys.readouterr().err
    rm.sensitivity(RACKET, "mean(omega_mean[2])", 100)
    assert capsys.readouterr().err == ""


def test_sections_and_spectra_tell_their_cost():
    words = "--members", 40, "--t-end", 10, "--dt", 0.1, "--set", "run.every=0.1"
    for study in (("section", "--at", "omega[1] = 0"), ("frequencies", "--of", "omega[1]")):
        assert told([study[0], "tennis_racket", *study[1:], *words])[0][:2] == (40, 100)


def test_a_closed_form_has_no_steps():
    scene = RACKET.with_run(integrator="closed", members=40)
    found = price(scene, lambda result: None, 1)
    assert found.steps == 0 and str(found).startswith("40 members in closed form: about")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:energy and .L.*drift one way")  # 2,000,000 steps of rk4
@pytest.mark.parametrize(
    ("study", "asked", "run", "count"),
    [
        ("sensitivity", ("mean(omega_mean[2])", 50_000), (20.0, None), 200_000),
        ("section", ("omega[1] = 0",), (60.0, 0.01), 1000),
        ("section", ("omega[1] = 0",), (20_000.0, 0.1), 16),  # a block longer than a rehearsal
        ("frequencies", ("omega[1]",), (60.0, 0.05), 500),
    ],
)
def test_a_price_is_right_within_a_factor_of_three(study, asked, run, count):
    study, (t_end, every) = getattr(rm, study), run
    more = {} if every is None else {"every": every, "members": count}
    scene = study.design(RACKET.with_run(dt=0.01), *asked, t_end=t_end, **more)

    def studied(result):
        return study.of(result, asked[0])

    found = price(scene, studied)
    assert found.members == count
    began = time.perf_counter()
    studied(rm.simulate(scene))
    taken = time.perf_counter() - began
    assert 1.0 / 3.0 < found.seconds / taken < 3.0  # measured 0.76 to 1.19


HISTOGRAM = rm.Histogram("omega[1]", -0.2, 0.2, 8)
MEASURES = "mean(omega_last[1])", "p(omega_last[2] > 0)", "mean(energy_drift_max)"
MEASURES += ("p(omega_last[1] > 0 | omega_last[2] > 0)",)


@pytest.fixture(scope="module")
def scene():
    run = {"members": 20_000, "t_end": 0.5, "every": 0.5, "save": (HISTOGRAM, "omega_last")}
    return rm.Scene.load("dzhanibekov").with_run(**run)


@pytest.fixture(scope="module")
def whole(scene):
    return rm.simulate(scene)


def test_totals_are_those_of_the_members(scene, whole):
    found = rm.simulate_totals(scene, MEASURES)
    for i, text in enumerate(MEASURES):
        one, wanted = found.isel(measure=i), estimate(whole, text)
        numbers = [float(one[name]) for name in ("value", "low", "high", "without")]
        assert numbers == pytest.approx([*wanted, wanted.without], rel=1e-12), text
    assert found.units.values.tolist() == ["rad s-1", "1", "1", "1"]
    for name in ("histogram", "histogram_below", "histogram_above"):
        assert np.array_equal(found[name].values, whole[name].values)
    assert found.members.values.tolist() == [20_000, 0, 0, 0, 0, 0, 0]
    assert found.attrs["scene"] and "member" not in found.dims


def test_bits_do_not_depend_on_threads_or_blocks(scene, monkeypatch):
    run = {"members": 3000, "momentum_limit": 1e-13}  # some flagged, the last group not whole
    found = rm.simulate_totals(scene, MEASURES, threads=1, **run)
    for threads, more in (3, 1), (2, 7):  # blocks of 256 and 2,688 members, not of all
        monkeypatch.setattr(totals, "MORE", more)
        assert found.identical(rm.simulate_totals(scene, MEASURES, threads=threads, **run))


def test_flagged_members_are_counted_and_left_out(scene):
    run = {"members": 500, "momentum_limit": 1e-13}
    whole, found = rm.simulate(scene, **run), rm.simulate_totals(scene, MEASURES, **run)
    flagged = int((whole.status != 0).sum())
    assert 0 < flagged < 500 and int(found.members[0]) == 500 - flagged
    assert float(found.value[0]) == pytest.approx(estimate(whole, MEASURES[0]).value, rel=1e-12)


def test_no_measures_and_one_member(scene):
    found = rm.simulate_totals(scene, members=1)
    assert found.sizes["measure"] == 0 and int(found.histogram.sum()) <= found.sizes["time"]
    one = rm.simulate_totals(scene, "mean(omega_last[1])", members=1)
    assert np.isfinite(one.value) and np.isnan(one.low)


def test_an_event_that_some_members_lack_has_no_mean(scene):
    texts = ["mean(flip_first)", "p(flip_first <= 0.2)"]
    found = rm.simulate_totals(scene, texts, members=64)
    assert np.isnan(found.value[0]) and float(found.without[0]) > 0.0
    assert float(found.value[1]) == 0.0


@pytest.mark.parametrize(
    "text", ["median(omega_last[1])", "correlation(l2_drift_max, energy_drift_max)"]
)
def test_what_needs_all_members_is_refused(scene, text):
    with pytest.raises(OptionError, match="needs the numbers of all members"):
        rm.simulate_totals(scene, text)
