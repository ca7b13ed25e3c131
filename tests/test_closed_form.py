"""rigidmc exact: which scenes have a closed form, what is said of them, and what of those that have none."""

import numpy as np
import pytest
from typer.testing import CliRunner

from rigidmc import Body, Gravity, Scene, SceneError, Start, ViscousDamping, normal
from rigidmc.cli import app
from rigidmc.closed_form import closed_form
from rigidmc.comparison import compare
from rigidmc.rotation import attitude_error
from rigidmc.simulation import simulate
from tests import reference

LAGRANGE = Body.from_moments((0.5, 0.5, 0.2), mass=1.0, centre=(0.0, 0.0, 0.1))


def run(*arguments):
    return CliRunner().invoke(app, ["exact", *arguments])


def worst(scene, members=64, **settings):
    """Largest difference of omega [rad/s] and attitude [rad] between closed form and integration at the end."""
    scene = scene.with_run(members=members, save=("omega", "attitude"), **settings)
    last = simulate(scene).isel(time=-1)
    motion = closed_form(scene).motion(scene.run.t_end)
    turned = attitude_error(last.attitude.transpose("member", "quat").values, motion.attitude)
    return np.abs(last.omega.transpose("member", "axis").values - motion.omega).max(), turned.max()


def test_free_scene_agrees_with_its_exact_integration():
    scene = Scene(Body.from_moments((1.0, 2.0, 3.0)), start=Start(omega=(normal(0, 0.1), 1.0, normal(0, 0.1)), attitude="uniform"))
    omega, attitude = worst(scene, integrator="exact", dt=0.5, t_end=20.0)
    assert omega < 5e-12  # 1.3e-13: near the middle axis errors grow by e^(0.58 t)
    assert attitude < 5e-12  # 1.7e-13


def test_heavy_symmetric_scene_agrees_with_rk4():
    scene = Scene(LAGRANGE, (Gravity(9.81),), Start(omega=(normal(0, 1.0), 0.5, 20.0), attitude=(0.3, 0.7, 0.2)))
    coarse, fine = (worst(scene, integrator="rk4", dt=dt, t_end=2.0)[1] for dt in (2e-3, 1e-3))
    assert fine < 1e-8  # 4.4e-9
    assert coarse / fine == pytest.approx(16.0, rel=0.2)  # the difference is all rk4's, of order 4


def test_damped_free_scene_runs_through_the_undamped_motion():
    moments, omega, rate = (1.0, 2.0, 3.0), (0.4, 1.0, -0.3), 0.3
    scene = Scene(Body.from_moments(moments), (ViscousDamping(rate),), Start(omega=omega)).with_run(members=1)
    motion = closed_form(scene).motion(4.0)
    q, l = reference.taylor(moments, [i * w for i, w in zip(moments, omega, strict=True)], 4.0, damping=rate)
    assert np.abs(motion.momentum[0] - np.array(l, float)).max() < 2e-15  # 1.1e-16
    assert reference.attitude_error(motion.attitude[0], np.array(q, float)) < 4e-15  # 2.5e-16


@pytest.mark.parametrize(
    ("body", "effects", "why"),
    [
        (Body.from_moments((1, 2, 2.5), centre=(0, 0, 0.1)), (Gravity(9.81),), "I1 = 1 and I2 = 2 differ"),
        (Body.from_moments((1, 1, 1.5), centre=(0.1, 0, 0.1)), (Gravity(9.81),), "lies on none"),
        (LAGRANGE, (Gravity(9.81), ViscousDamping(0.1)), "damped heavy top"),
    ],
)
def test_what_no_closed_form_covers_is_refused_with_the_reason(body, effects, why):
    scene = Scene(body, effects, Start(omega=(0.1, 0.2, 0.3)))
    with pytest.raises(SceneError, match=why) as found:
        closed_form(scene)
    assert "covered are" in str(found.value)


def test_command_shows_both_and_their_difference():
    shown = run("nasa_brick", "--at", "30")
    assert shown.exit_code == 0
    assert "free top, closed form at t = 30 s" in shown.stdout
    assert "flips every  8.6922446359" in shown.stdout
    assert "apart by" in shown.stdout


def test_command_refuses_with_one_line_and_code_3(tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text(
        "[body]\nmoments = [1, 2, 2.5]\ncentre = [0, 0, 0.1]\n[effects.gravity]\ng = 9.81\n[start]\nomega = [0, 1, 2]\n"
    )
    shown = run(str(file))
    assert shown.exit_code == 3
    assert "bad.toml" in shown.stderr
    assert "differ" in shown.stderr
    assert "Traceback" not in shown.stderr


def test_command_draws_and_does_not_overwrite(tmp_path):
    for scene in ("heavy_top", "dzhanibekov"):
        picture = tmp_path / f"{scene}.png"
        assert run(scene, "--members", "2", "--plot", str(picture)).exit_code == 0
        assert picture.stat().st_size > 20_000
    assert run("heavy_top", "--plot", str(picture)).exit_code == 6


def test_before_the_start_there_is_the_closed_form_alone():
    scene = Scene(Body.from_moments((1.0, 2.0, 3.0)), start=Start(omega=(0.1, 1.0, 0.2))).with_run(members=1)
    assert "none: it starts at t = 0" in "\n".join(compare(scene, -3.0, 1))
