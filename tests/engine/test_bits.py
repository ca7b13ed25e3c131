"""The bits of a member depend on scene, seed and index: not on vector width, CPU or architecture.

Draws and events included. `python -m bench bits` runs all cases and writes what is compared here:
do that after any change that is meant to change bits.
"""

import numpy as np
import pytest

import rigidmc as rm
from bench.bits import PROCESSORS, QUICK, elsewhere, equal, recorded, sums
from rigidmc.engine.program import Program
from rigidmc.physics.dynamics import functions
from rigidmc.scene.derivatives import parameters_of_run
from rigidmc.scene.vector_distributions.vectors import lower_factor
from rigidmc.studies.bits import MEMBERS, cases, with_derivatives
from tests.tools.same import assert_same

# steps too long for what is watched
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


ROWS = [row for row in recorded() if row["kind"] == "bits"]
RECORDED = {  # by an Intel Xeon with 512-bit vectors
    row["case"]: row["sums"][0]
    for row in ROWS
    if (row["architecture"], row["processor"]) == ("x86_64", "this processor")
}


# Each has a piece of code, a law or an event that no other has. Driven bodies by rk4 take 3 s to
# compile: their steps are those of heavy bodies by rk4, their torques those of driven ones by
# strang. Free bodies by rk4 take 4 s: their flips are those of free bodies by exact.
NAMES = (
    "free, exact, 0.05", "heavy, rk4, 0.05",
    "heavy, rk4, 0.1 steps of their own", "heavy, rk4, 0.05, float32",
    "heavy, strang, 0.05, works and a tangent", "driven, strang, 0.05", "in a bath, strang, 0.05",
)  # fmt: skip
EXACT, HEAVY, OWN = NAMES[:3]


def changed(digests):
    """The cases whose result, at any width, is not that of the committed file."""
    return [case for case, each in digests.items() if set(each) != {RECORDED[case]}]


def test_the_bits_are_those_recorded_on_another_machine():
    found = sums((0,), QUICK, names=NAMES)
    assert set(found) == set(NAMES) and not changed(found)


@pytest.mark.slow  # 2 min
def test_the_bits_of_all_cases():
    found = sums((0,))
    assert set(found) == set(RECORDED) and not changed(found)
    assert not changed(sums((1, 16), QUICK))


def test_derivatives_change_no_bit():
    """One case, with derivatives by start, body and effect: a case takes 8 s to compile."""
    found = sums((0,), QUICK, names=(HEAVY,), derivatives=True)
    assert set(found) == {HEAVY} and not changed(found)


def test_a_derivative_changes_no_bit_of_exact_steps():
    """Their functions are those of no other integrator; the code is that of the example of `ftle`,
    and takes 2 s to compile."""
    start = rm.Start(omega=(0.3, 0.2, rm.uniform(1.0, 2.0)))
    scene = rm.Scene(rm.Body((1.0, 1.4, 2.0)), start=start).with_run(
        integrator="exact", dt=0.1, t_end=10.0, members=MEMBERS, save=("attitude", "omega")
    )
    plain, found = rm.simulate(scene), rm.simulate(scene, wrt=("start.omega.3",))
    assert (found.d_attitude.values[:, -1] != 0.0).any()
    assert_same(plain, found)


def test_all_cases_differentiate_by_parameters_that_exist():
    for case in cases():
        case_scene = with_derivatives(case)
        assert len(parameters_of_run(case_scene.model, case_scene.run.wrt)) == 3, case.name


@pytest.mark.slow
def test_derivatives_change_no_bit_of_any_case():
    found = sums((0,), derivatives=True)
    assert set(found) == set(RECORDED) and not changed(found)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 2, 4, 8, 16])
def test_derivatives_change_no_bit_at_any_width(width):
    assert not changed(sums((width,), QUICK, derivatives=True))


@pytest.mark.slow
@pytest.mark.parametrize("processor", list(PROCESSORS)[1:])
def test_derivatives_change_no_bit_on_any_processor(processor):
    try:
        found = elsewhere(processor, (0,), QUICK, derivatives=True)
    except NotImplementedError as error:
        pytest.skip(str(error))
    assert found and not changed(found)


def test_widths_change_no_bit(monkeypatch):
    """One case; each compiles 14 kernels, and the test above has all."""
    make, made = Program.__init__, set()

    def noted(self, *given, **named):
        make(self, *given, **named)
        made.add(self.lanes)

    monkeypatch.setattr(Program, "__init__", noted)
    assert not changed(sums((1, 16), QUICK, names=(OWN,)))
    assert made == {1, 16}  # a scene keeps its program, which is no program of another width


@pytest.mark.slow
def test_another_processor_with_other_libraries_changes_no_bit():
    names = NAMES[-2:]  # with sines of the time, and with deviates
    found = elsewhere(list(PROCESSORS)[-1], (0,), QUICK, names=names)
    assert len(found) == 2 and not changed(found)


def test_two_architectures_recorded_the_same_bits():
    for word in "x86_64", "aarch64":
        assert {row["case"] for row in ROWS if row["architecture"] == word} == set(RECORDED)
    assert equal(ROWS)["measured"] == len(RECORDED)
    other = {**ROWS[-1], "sums": ["0" * 64]}
    assert equal([*ROWS, other])["measured"] == len(RECORDED) - 1


def test_the_comparison_sees_one_bit(monkeypatch):
    quantile = functions.normal_quantile
    monkeypatch.setattr(
        "rigidmc.scene.distributions.normal_quantile", lambda u: np.nextafter(quantile(u), 9.0)
    )
    assert changed(sums((0,), QUICK, names=(EXACT,)))


def test_a_cholesky_factor_is_one():
    c = np.array([[2.0, 0.3, -0.4], [0.3, 1.0, 0.2], [-0.4, 0.2, 0.5]])
    root = np.array([row + (0.0,) * (3 - len(row)) for row in lower_factor(c.tolist())])
    assert np.abs(root @ root.T - c).max() < 1e-15  # measured 4.4e-16
