"""Members of a study in parts, and what a study will cost."""

import re
import time

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.runs.price import price
from rigidmc.studies.framework.members import compute_batches
from tests.tools.commands import invoke

RACKET = rm.Scene.load("tennis_racket").with_run(
    integrator="rk4", t_end=1.0, dt=0.1, every=0.5, save=("omega",)
)
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
    ("designed", "studied", "count"),
    [
        (
            lambda scene: rm.sensitivity.design(scene, "mean(omega_mean[2])", 50_000, t_end=20.0),
            lambda result: rm.sensitivity.of(result, "mean(omega_mean[2])"),
            200_000,
        ),
        (
            lambda scene: rm.section.design(
                scene, "omega[1] = 0", members=1000, t_end=60.0, every=0.01
            ),
            lambda result: rm.section.of(result, "omega[1] = 0"),
            1000,
        ),
        (  # one block takes longer than a rehearsal may
            lambda scene: rm.section.design(
                scene, "omega[1] = 0", members=16, t_end=20_000.0, dt=0.01, every=0.1
            ),
            lambda result: rm.section.of(result, "omega[1] = 0"),
            16,
        ),
        (
            lambda scene: rm.frequencies.design(
                scene, "omega[1]", members=500, t_end=60.0, every=0.05
            ),
            lambda result: rm.frequencies.of(result, "omega[1]"),
            500,
        ),
    ],
)
def test_a_price_is_right_within_a_factor_of_three(designed, studied, count):
    scene = designed(RACKET.with_run(dt=0.01))
    found = price(scene, studied)
    assert found.members == count
    began = time.perf_counter()
    studied(rm.simulate(scene))
    taken = time.perf_counter() - began
    assert 1.0 / 3.0 < found.seconds / taken < 3.0  # measured 0.76 to 1.19
