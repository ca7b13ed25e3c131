"""The generic checks of a scene: they agree with a known truth.

They see a long step, chaos and bad members.
"""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.studies.stress import picture, trust
from tests.tools.axes import faults
from tests.tools.scenes import LAGRANGE

SCENE = LAGRANGE.with_run(t_end=5.0, dt=0.02, members=100, integrator="rk4")


@pytest.fixture(scope="module")
def good():
    return trust.trust(SCENE, quick=True)


def test_a_good_scene_is_trusted_as_far_as_it_is_true(good):
    error = dict(zip(good.check.values, good.error.values[:, -1], strict=True))
    assert good.time.units == "s"
    assert set(error) == {
        "another integrator (rk8)",
        "half the step",
        "other units",
        "permuted axes",
        "turned space",
        "there and back",
        "closed form",
    }
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
    body = rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.25, 0.15))
    start = rm.Start(omega=(rm.normal(0.0, 0.3), rm.normal(0.0, 0.3), 0.3), attitude="uniform")
    found = trust.trust(
        rm.Scene(body, (rm.Gravity(10.0),), start).with_run(
            t_end=200.0, dt=0.02, members=64, integrator="rk8"
        ),
        quick=True,
    )
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
