"""Numbers that the documentation states of integrators, from rows of a bench or measured here."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.physics.integrators import INTEGRATORS, description

ROOT = Path(__file__).parents[3]
BODY = rm.Body.from_moments((rm.uniform(0.6, 1.0), rm.uniform(0.8, 1.2), rm.uniform(1.2, 1.4)))


def ratios(body, one, other):
    """(errors, cost) of an integrator at the steps of `python -m bench accuracy`, of another's: the
    least and the largest ratio of median errors above 1e-11, by steps of less than 1 rad."""
    file = ROOT / "bench" / "results" / "accuracy.json"
    rows = {
        (row["integrator"], round(row["dt"], 12)): row
        for row in json.loads(file.read_text())["rows"]
        if row["kind"] == "error" and row["body"] == body and row["dtype"] == "float64"
    }
    found = [
        (a["error_state_median"] / b["error_state_median"], a["ns_per_member_step"], b)
        for (name, dt), a in rows.items()
        if name == one and (b := rows.get((other, dt)))
        if a["turn"] < 1.0 and a["error_state_median"] > 1e-11
    ]
    errors = [ratio for ratio, _, _ in found]
    return (min(errors), max(errors)), found[0][1] / found[0][2]["ns_per_member_step"]


@pytest.mark.parametrize(
    ("one", "other"), [("rkmk4", "rk4"), ("cf4", "rkmk4"), ("ck45", "rkmk4")], ids=str
)
def test_the_errors_and_costs_of_lie_group_methods(one, other):
    text = " ".join(description(INTEGRATORS[one]).split())
    heavy, free = rf"is (.*?) times that of {other} for heavy tops", r"and (.*?) for free"
    said = re.search(f"{heavy} {free}", text)
    assert said, text
    for body, figures in (("heavy", said[1].split(" to ")), ("free", said[2].split(" to "))):
        (low, high), _ = ratios(body, one, other)
        assert f"{low:.2f}" == figures[0] and f"{high:.2f}" == figures[-1], (body, low, high)
    costs = re.search(r"at ([\d.]+)(?: and ([\d.]+))? times the cost", text)
    heavy, free = (f"{ratios(body, one, other)[1]:.1f}" for body in ("heavy", "free"))
    assert (heavy, free) == (costs[1], costs[2] or costs[1])


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")  # long steps
def test_how_far_rk4_may_turn_a_body_in_a_step():
    """Flagged beyond 2 rad, some from 1 rad on, and most finite up to 5 rad without checks."""

    def share(dt, checks=True):
        start = rm.Start(omega=rm.Sphere(1.0))
        ways = {"dt": dt, "t_end": 200 * dt, "members": 256, "checks": checks}
        return float((rm.simulate(rm.Scene(BODY, start=start), "rk4", **ways).status == 0).mean())

    assert share(0.5) == 1.0 and share(2.1) == 0.0
    assert 0.8 < share(1.5) < 1.0  # measured 0.93
    assert share(3.0, False) == 1.0 and 0.8 < share(5.0, False) < 1.0  # measured 0.92


def table():
    """{integrator: {(angle, step): error}} of the table on float32 in theory/integrators.md."""
    text = (ROOT / "docs" / "theory" / "integrators.md").read_text()
    places = [(phi, dt) for phi in (1e3, 1e4) for dt in (0.1, 0.4, 0.8)]
    rows = re.findall(r"^  \| `(\w+)` \|(.*)\|$", text, re.M)
    return {
        name: dict(zip(places, map(float, cells.split("|")), strict=True)) for name, cells in rows
    }


def single_error(name, dt, t_end):
    """The median error [rad] of 64 free tops that turn by 1 rad/s, of float32 against float64."""
    scene = rm.Scene(BODY, start=rm.Start(omega=rm.Sphere(1.0), attitude="uniform"))
    ways = {"dt": dt, "t_end": t_end, "every": t_end, "members": 64, "checks": False}
    one, other = (
        rm.simulate(scene, name, dtype=dtype, save=("attitude",), **ways).attitude.values[-1]
        for dtype in ("float32", "float64")
    )
    apart = np.minimum(((one - other) ** 2).sum(0), ((one + other) ** 2).sum(0))
    return float(np.median(2.0 * np.sqrt(apart)))


@pytest.mark.parametrize(
    "name", ["exact", *(pytest.param(n, marks=pytest.mark.slow) for n in ("strang", "rk4", "rk8"))]
)
def test_the_error_of_float32(name):
    """To 40 %, of the one digit of the table."""
    rows = table()[name]
    assert len(rows) == 6
    for (phi, dt), said in rows.items():
        assert 0.6 < single_error(name, dt, phi) / said < 1.4, (phi, dt)


@pytest.mark.slow
def test_float32_by_rk8_grows_as_the_square():
    near, far = (single_error("rk8", 0.4, phi) for phi in (1e3, 1e4))
    assert 50.0 < far / near < 200.0  # measured 110
