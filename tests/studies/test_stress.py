"""The catalogue of hard cases: its contents, and that it sees errors; the checks of a scene."""

import inspect
import math
from functools import cache

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.studies.stress import (
    catalogue,
    free_cases,
    groups,
    heavy_cases,
    numerical_cases,
    picture,
    processes,
    trust,
)
from rigidmc.studies.stress import hard_cases as H
from rigidmc.studies.stress.case import Comparison, HardCase
from rigidmc.studies.stress.motions import (
    direction,
    distance,
    invariants,
    largest_change,
    random_tops,
    run,
    states,
    tops,
    walk,
    worst,
)
from rigidmc.studies.stress.processes import run_case
from rigidmc.studies.stress.truths import closed_states, distance_to_closed_form, flips
from tests.tools.axes import faults
from tests.tools.scenes import LAGRANGE


@cache
def cases():
    """The catalogue, made at the first use: it compiles closed forms."""
    return catalogue()


def test_no_function_that_yields_cases_is_left_out():
    parts = [f for file in (free_cases, heavy_cases, numerical_cases) for f in vars(file).values()]
    makers = {f for f in parts if inspect.isgeneratorfunction(f)}
    named = {f for f in makers if not f.__name__.startswith("_")}
    assert named == {group.cases for group in groups().values()}
    assert list(groups()) == [f"H{i}" for i in range(1, len(named) + 1)]


def test_the_catalogue_is_complete():
    assert len(cases()) >= 60
    assert len({case.name for case in cases()}) == len(cases())
    assert {case.group for case in cases()} == set(groups())
    known = H.shipped_bounds()
    for case in cases():
        assert case.why
        assert case.truth
        for name in case.integrators():
            bound, measured = H.bound_of(case, name, known)
            uncovered = name == "closed" and math.isnan(measured)
            assert math.isfinite(bound) or uncovered, (case.name, name)
            assert uncovered or measured <= bound, (case.name, name)
    assert set(known) <= {(case.name, name) for case in cases() for name in case.integrators()}


def test_calls_are_refused_for_their_reasons():
    for case in numerical_cases.refusals():
        for name in {"rk8", "gbs12"} & set(case.integrators()):
            assert run_case(case, name, H.SHORT)[0] == 0.0, (case.name, name)


@pytest.mark.parametrize("name", ["rk4", "exact", "closed"])
def test_quick_cases_are_within_their_bounds(name):
    known = H.shipped_bounds()
    for case in cases():
        if case.quick and name in case.integrators():
            error, _, reason = run_case(case, name, H.SHORT)
            if math.isnan(error) and name == "closed" and not reason:
                continue
            assert error <= H.bound_of(case, name, known)[0], (case.name, error, reason)


def test_errors_are_seen():
    """The measure of a case grows with what it measures: another truth, law or time."""
    scene, wrong = tops((1.0, 1.4, 2.0), (0.3, 0.9, 0.7)), tops((1.0, 1.4, 2.0001), (0.3, 0.9, 0.7))

    def against_wrong(integrator, share):
        ds = run(scene, integrator, 10.0)
        return worst(ds, distance(*states(ds), *closed_states(wrong, ds)).max(0))

    assert distance_to_closed_form(scene, 10.0).error("exact", 1.0) < 1e-13
    assert against_wrong("exact", 1.0) > 1e-4
    assert largest_change(scene, 10.0, invariants).error("exact", 1.0) < 1e-14
    assert largest_change(scene, 10.0, direction).error("exact", 1.0) > 0.1  # L does move

    def of_no_size(body, effects, q, l):
        return [(l, 0.0 * l[0, 0])]

    assert largest_change(scene, 10.0, of_no_size).error("exact", 1.0) == math.inf  # in any unit
    assert flips((1.0, 2.0, 3.0), (1e-4, 2.0, 0.0), 1).error("exact", 1.0) < 1e-13
    # does not start where L3 = 0
    assert flips((1.0, 2.0, 3.0), (1e-4, 2.0, 1e-4), 1).error("exact", 1.0) > 1e-3


def test_an_integrator_without_bounds_has_those_of_its_kind():
    """A splitting of the same order is exact for a free body, which a Runge-Kutta method is not."""
    case = next(case for case in cases() if case.name == "needle")
    splitting = {(case.name, "suzuki4"): (3e-14, 1e-14)}
    others = {(case.name, "cf4"): (2e-9, 1e-9), (case.name, "ck45"): (1e-9, 1e-9)}
    assert H.bound_of(case, "rk4", splitting | others) == (2e-9, 1e-9)
    assert H.bound_of(case, "rk4", splitting)[0] == math.inf
    assert H.bound_of(case, "srkn6", splitting | others) == (3e-14, 1e-14)


def test_a_study_reports_cases_above_their_bound(tmp_path):
    """One bound at a tenth: the right row, and no other, is above it."""
    names = ["exact", "closed"]
    first = H.run_cases(["H5"], names, threads=1)
    assert not H.any_failed(first)
    assert first.sizes["case"] == sum(case.group == "H5" for case in cases())
    error = float(first.error.sel(case="needle", integrator="exact"))
    assert H._verdict(cases()[0], "rk4", 1e-3, math.inf) == "not judged"  # a new integrator's
    assert H._verdict(cases()[0], "rk4", 0.0, math.inf) == "good"
    second = H.run_cases(["H5"], names, bounds={("needle", "exact"): 0.1 * error}, threads=1)
    above = np.argwhere(second.verdict.values == H.VERDICTS.index("above"))
    names = [(str(second.case.values[i]), str(second.integrator.values[j])) for i, j in above]
    assert names == [("needle", "exact")]
    assert H.any_failed(second)
    H.write_bounds(first, tmp_path / "b.csv")
    kept = H.load_bounds(tmp_path / "b.csv")
    assert error < kept["needle", "exact"] < 6 * error
    figure = picture.hard_cases(second)
    assert faults(figure) == []
    assert figure.axes[0].get_images()[0].get_array().shape[:2] == second.error.shape
    first.to_netcdf(tmp_path / "s.nc", engine="netcdf4")


def test_a_case_that_raises_or_dies_is_red_and_stops_no_other(monkeypatch):
    def fails(integrator, share):
        raise RuntimeError("broken on purpose")

    case = HardCase("broken", "to see it red", Comparison(fails, "none"), 1.0, group="H5")
    error, _, reason = run_case(case, "rk4")
    assert math.isnan(error)
    assert "broken on purpose" in reason
    runs = [[(error, 0.1, reason)], [(0.0, 0.1, "")]]
    found = H._dataset([case, cases()[0]], runs, ["rk4"], H.shipped_bounds(), {})
    assert [H.VERDICTS[v] for v in found.verdict.values[:, 0]] == ["crashed", "good"]
    assert H.any_failed(found)
    pipes = {"stdin": -1, "stdout": -1, "text": True}
    false = lambda: processes.subprocess.Popen(["false"], **pipes)  # noqa: E731
    monkeypatch.setattr(processes, "_started", false)
    died = H.run_cases(["H15"], ["rk4"], threads=1)
    assert (died.verdict.values == H.VERDICTS.index("crashed")).all()
    assert "ended with code 1" in died.reason.values[0, 0]


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"groups": ["H99"]}, "did you mean"),
        ({"integrators": ["rk5"]}, "did you mean 'rk"),
        ({"bounds": {("needle", "exact"): -1.0}}, "not negative"),
    ],
)
def test_wrong_words_are_refused(given, word):
    with pytest.raises(rm.OptionError, match=word):
        H.run_cases(**given)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("group,case,integrator,bound,measured\nH5,needle,exact,-1e-3,\n", "not negative"),
        ("group,case,integrator,bound,measured\nH5,needel,exact,1e-3,\n", "did you mean 'needle'"),
        ("group,case,integrator,bound,measured\nH5,needle,exat,1e-3,\n", "did you mean 'exact'"),
        ("group,case,integrator,bound,measured\nH5,needle,exact,much,\n", "line 2"),
    ],
)
def test_wrong_bounds_are_refused(text, word, tmp_path):
    (tmp_path / "b.csv").write_text(text)
    with pytest.raises(rm.FileError, match=word):
        H.load_bounds(tmp_path / "b.csv")


def test_every_integrator_has_hard_cases():
    for name in INTEGRATORS:
        assert sum(name in case.integrators() for case in cases()) >= 20


@pytest.mark.slow
def test_rounding_walks_over_1e8_steps():
    """40 to 100 s: the free motion of 32 tops over 1e8 steps; the rms drift at 1e8 steps is
    sqrt(64) times that at 1.6e6, to a factor of 6.

    The factor is below 3 on a Zen 4 and 4.5 on a Sapphire Rapids, which rounds differently: there
    two of the 32 drift evenly, by 1.6e-19 of their energy a step, while the others random-walk; the
    rms of all at 1e8 is 4.1e-12. If all drifted evenly, the factor would be 8."""
    moments, momentum = random_tops()
    assert walk(tops(moments, momentum), 0.1, 100_000_000).error("exact", 1.0) < 6.0


SCENE = LAGRANGE.with_run(t_end=5.0, dt=0.02, members=100, integrator="rk4")


@pytest.fixture(scope="module")
def good():
    return trust.trust(SCENE, quick=True)


def test_a_good_scene_is_trusted_as_far_as_it_is_true(good):
    error = dict(zip(good.check.values, good.error.values[:, -1], strict=True))
    assert good.time.units == "s"
    names = {"another integrator (rk8)", "half the step", "other units", "permuted axes"}
    assert set(error) == names | {"turned space", "there and back", "closed form"}
    # 5.652e-9 and 5.652e-9
    assert error["half the step"] == pytest.approx(error["closed form"], rel=0.05)
    assert error["another integrator (rk8)"] == pytest.approx(error["closed form"], rel=0.01)
    for name, tells, values in zip(
        good.check.values, good.tells.values, good.error.values, strict=True
    ):
        assert tells == "accuracy" or (values < 1e-13).all(), name  # measured 9e-15 to 1.8e-14
        assert (np.diff(values) >= 0).all()
    assert good.attrs["digits"] == int(-np.log10(error["closed form"]))
    assert good.attrs["verdict"] == f"trust {good.attrs['digits']} digits to t = 5 s"
    assert not trust.has_failed(good)
    assert "verdict" in trust.table(good)[-1]
    figure = picture.trust(good)
    assert len(figure.axes[0].lines) == 8 and faults(figure) == []


def test_a_long_step_is_seen():
    found = trust.trust(SCENE.with_run(dt=1.0, t_end=50.0), quick=True)
    assert found.attrs["digits"] == 0
    assert "the step is too long" in found.attrs["verdict"]
    assert trust.has_failed(found)


def test_chaos_is_told_from_a_long_step():
    body = rm.Body((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.25, 0.15))
    start = rm.Start(omega=(rm.normal(0.0, 0.3), rm.normal(0.0, 0.3), 0.3), attitude="uniform")
    run = {"t_end": 200.0, "dt": 0.02, "members": 64, "integrator": "rk8"}
    found = trust.trust(rm.Scene(body, rm.Gravity(10.0), start).with_run(**run), quick=True)
    assert found.attrs["chaotic_share"] > 0.1
    assert found.attrs["horizon"] < 200.0
    assert "beyond, chaos" in found.attrs["verdict"]
    assert not trust.has_failed(found)
    rounding = found.error.values[found.tells.values == "rounding"].max(0)
    assert rounding[-1] > 1e-2  # rounding alone


def test_the_closed_form_is_judged_by_an_integrator():
    found = trust.trust(SCENE.with_run(integrator="closed"), quick=True)
    assert list(found.check.values) == ["another integrator (rk8)"]
    assert found.attrs["digits"] >= 11
