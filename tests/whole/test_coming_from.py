"""The codes of docs/coming_from: ours run and agree with the closed form, theirs if installed."""

import importlib.util
import runpy

import pytest

from bench.coming_from import CODE, PAIRS, error_of

# Measured: ours 1.9e-13 (REBOUND's moon) to 1.5e-10 (4,096 tops), theirs 2.5e-14 (heyoka) to
# 2.6e-10 (diffrax); with steps of 1 ms by rk4 2.7e-7 (ours) and 1.8e-7 (MuJoCo).
LIMITS = {"mujoco": 1e-6}


def ends(name, side, task):
    attitude, omega = runpy.run_path(str(CODE / f"{name}_{side}.py"))[task]()
    return {"attitude": attitude, "omega": omega}


@pytest.mark.parametrize("name", PAIRS)
def test_our_code_agrees_with_the_reference(name):
    task = PAIRS[name].both[0]
    assert error_of(name, task, ends(name, "rigidmc", task)) < LIMITS.get(name, 1e-9)


@pytest.mark.parametrize("name", PAIRS)
def test_their_code_is_python_and_on_the_page(name):
    file = CODE / f"{name}_theirs.py"
    compile(file.read_text("utf-8"), str(file), "exec")
    page = (CODE.parent / f"{name}.md").read_text("utf-8")
    for side in ("theirs", "rigidmc"):
        assert f"{{literalinclude}} code/{name}_{side}.py" in page
    assert f"<!-- bench:coming_from_{name} -->" in page


@pytest.mark.slow  # of these packages only sympy comes with '.[slow]'
@pytest.mark.parametrize("name", ["heyoka", "mujoco", "rebound", "sympy"])
def test_their_code_agrees_with_the_reference(name):
    if not importlib.util.find_spec(name):
        pytest.skip(f"{name} is not installed")
    assert error_of(name, "one", ends(name, "theirs", "one")) < LIMITS.get(name, 1e-9)
