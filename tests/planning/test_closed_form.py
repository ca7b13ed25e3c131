"""rigidmc exact: which scenes have a closed form, and what it says of both kinds of scene."""

import numpy as np
import pytest

from rigidmc import (
    Body,
    Gravity,
    Run,
    Scene,
    SceneError,
    SceneWarning,
    Start,
    ViscousDamping,
    grid,
    normal,
)
from rigidmc.engine.kernel.layout import STATUSES
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.runs.simulate import simulate
from rigidmc.studies.exact import compare
from tests.tools import reference
from tests.tools.commands import invoke
from tests.tools.plans import closed_form

LAGRANGE = Body.from_moments((0.5, 0.5, 0.2), mass=1.0, centre=(0.0, 0.0, 0.1))


def run(*arguments):
    return invoke("exact", *arguments)


def worst(scene, members=64, **settings):
    """Largest difference of omega [rad/s] and attitude [rad] between the two at the end."""
    scene = scene.with_run(members=members, save=("omega", "attitude"), **settings)
    last = simulate(scene).isel(time=-1)
    motion = closed_form(scene).motion(scene.run.t_end)
    turned = attitude_error(last.attitude.transpose("member", "quat").values, motion.attitude)
    return np.abs(last.omega.transpose("member", "axis").values - motion.omega).max(), turned.max()


def test_free_scene_agrees_with_its_exact_integration():
    scene = Scene(
        Body.from_moments((1.0, 2.0, 3.0)),
        start=Start(omega=(normal(0, 0.1), 1.0, normal(0, 0.1)), attitude="uniform"),
    )
    omega, attitude = worst(scene, integrator="exact", dt=0.5, t_end=20.0)
    assert omega < 5e-12  # 1.3e-13: near the middle axis errors grow by e^(0.58 t)
    assert attitude < 5e-12  # 1.7e-13


@pytest.mark.parametrize(
    ("spin", "attitude", "words"),
    [
        (7.1, (1.0, 0.0, 0.0, 0.0), "stable (4); stable above a spin of 7.00357 rad/s"),
        (6.9, (1.0, 0.0, 0.0, 0.0), "unstable (4); stable above a spin of 7.00357 rad/s; a tilt"),
        (6.9, (0.0, 1.0, 0.0, 0.0), None),  # it hangs
        (7.1, (0.8, 0.6, 0.0, 0.0), None),
    ],
)
def test_an_upright_top_is_told_to_sleep_or_not(spin, attitude, words):
    """2 sqrt(I1 m g l)/I3 = 7.003574 rad/s."""
    scene = Scene(LAGRANGE, Gravity(9.81), Start(omega=(0.0, 0.0, spin), attitude=attitude))
    lines = [
        line for line in compare(scene.with_run(dt=1e-3), 0.01, 4) if line.startswith("upright")
    ]
    assert lines == [] if words is None else words in lines[0]


def test_heavy_symmetric_scene_agrees_with_rk4():
    scene = Scene(
        LAGRANGE,
        (Gravity(9.81),),
        Start(omega=(normal(0, 1.0), 0.5, 20.0), attitude=(0.3, 0.7, 0.2)),
    )
    coarse, fine = (worst(scene, integrator="rk4", dt=dt, t_end=2.0)[1] for dt in (2e-3, 1e-3))
    assert fine < 1e-8  # 4.4e-9
    assert coarse / fine == pytest.approx(16.0, rel=0.2)  # the difference is all rk4's, of order 4


def test_damped_free_scene_runs_through_the_undamped_motion():
    moments, omega, rate = (1.0, 2.0, 3.0), (0.4, 1.0, -0.3), 0.3
    scene = Scene(Body.from_moments(moments), (ViscousDamping(rate),), Start(omega=omega)).with_run(
        members=1
    )
    motion = closed_form(scene).motion(4.0)
    q, l = reference.taylor(
        moments, [i * w for i, w in zip(moments, omega, strict=True)], 4.0, damping=rate
    )
    assert np.abs(motion.momentum[0] - np.array(l, float)).max() < 2e-15  # 1.1e-16
    assert reference.attitude_error(motion.attitude[0], np.array(q, float)) < 4e-15  # 2.5e-16


@pytest.mark.parametrize(
    ("body", "effects", "why"),
    [
        (
            Body.from_moments((1, 2, 2.5), mass=1.0, centre=(0, 0, 0.1)),
            (Gravity(9.81),),
            "I1 = 1 and I2 = 2 differ",
        ),
        (
            Body.from_moments((1, 1, 1.5), mass=1.0, centre=(0.1, 0, 0.1)),
            (Gravity(9.81),),
            "lies on none",
        ),
        (LAGRANGE, (Gravity(9.81), ViscousDamping(0.1)), "damped heavy top"),
    ],
)
def test_scenes_without_a_closed_form_are_refused_with_the_reason(body, effects, why):
    scene = Scene(body, effects, Start(omega=(0.1, 0.2, 0.3)))
    with pytest.raises(SceneError, match=why) as found:
        closed_form(scene)
    assert "covered are" in str(found.value)


def test_command_shows_both_and_their_difference():
    shown = run("nasa_brick", "--at", "30")
    assert shown.exit_code == 0
    assert "free top, closed form at t = 30 s" in shown.stdout
    assert "flips every  8.6922446359" in shown.stdout
    assert "attitude     difference" in shown.stdout


def test_command_refuses_with_one_line_and_code_3(tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text(
        "[body]\nmoments = [1, 2, 2.5]\ncentre = [0, 0, 0.1]\n[effects.gravity]\ng = 9.81\n"
        "[start]\nomega = [0, 1, 2]\n"
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


def end(scene, **settings):
    """momentum (n, 3) and attitude (n, 4) at t_end, with sums compensated."""
    last = simulate(scene, save=("momentum", "attitude"), **settings).isel(time=-1)
    return last.momentum.transpose("member", "axis").values, last.attitude.transpose(
        "member", "quat"
    ).values


def test_effects_of_one_kind_add_up():
    heavy = Body.from_moments((1.4, 1.4, 1.0), mass=1.0, centre=(0.0, 0.0, 0.2))
    start = Start(omega=(0.3, normal(0.4, 0.1), 6.0), attitude=(0.3, 0.7, 0.2))
    twice = Scene(heavy, (Gravity(5.0), Gravity(4.81)), start)
    free = Body.from_moments((1.0, 2.0, 3.0))
    for scene in (twice, Scene(free, (ViscousDamping(0.2), ViscousDamping(0.15)), start)):
        found, true = (
            end(scene, members=8, t_end=2.0, integrator=name, dt=2e-3) for name in ("closed", "rk8")
        )
        assert np.abs(found[0] - true[0]).max() < 5e-13  # 2.7e-14
        assert attitude_error(found[1], true[1]).max() < 5e-13  # 1.2e-14
    alone = Scene(heavy, (Gravity(5.0),), start)
    wrong = (
        end(alone, members=8, t_end=2.0, integrator="closed")[0]
        - end(twice, members=8, t_end=2.0, integrator="closed")[0]
    )
    assert np.abs(wrong).max() > 1e-2
    none = Scene(heavy, (Gravity(5.0), Gravity(-5.0)), start)
    assert closed_form(none, 4).name == "free top"


def test_negative_damping_changes_the_time_too():
    scene = Scene(
        Body.from_moments((1.0, 2.0, 3.0)),
        (ViscousDamping(-0.5),),
        Start(omega=(0.3, 2.0, 0.1)),
        run=Run(anti_damping=True, members=1, t_end=2.0, dt=2e-3),
    )
    with pytest.warns(SceneWarning, match="drives the body"):
        found, true = (end(scene, integrator=name) for name in ("closed", "rk8"))
    assert np.abs(found[0] - true[0]).max() < 2e-12  # 9.9e-14, of |L| = 11
    assert found[0][0] == pytest.approx((5.43, 1.71, -9.33), abs=1e-2)
    assert attitude_error(found[1], true[1]).max() < 5e-13  # 1.4e-14
    motion = closed_form(scene).motion(-3.0)  # and backwards
    q, l = reference.taylor((1.0, 2.0, 3.0), (0.3, 4.0, 0.3), -3.0, damping=-0.5)
    assert np.abs(motion.momentum[0] - np.array(l, float)).max() < 4e-15  # 3.4e-16
    assert reference.attitude_error(motion.attitude[0], np.array(q, float)) < 4e-15  # 4.1e-16


def heavy_ones(mass, omega):
    """300 members: about the first 30 of the grid and the last 80 are impossible bodies; masses and
    starts as given.
    """
    body = Body.from_moments((1.4, 1.4, grid(-0.5, 4.0, 300)), mass=1.0, centre=(0.0, 0.0, mass))
    return Scene(body, (Gravity(9.81),), Start(omega=omega, attitude=(0.3, 0.7, 0.2))).with_run(
        members=300, t_end=2.0, every=0.3, save=("omega", "attitude", "energy")
    )


@pytest.mark.filterwarnings("ignore:.*cannot exist")  # some are random
def test_impossible_members_are_flagged_as_with_rk8_and_the_others_keep_every_bit():
    some = np.random.default_rng(0)
    centre, omega = some.normal(0.0, 0.1, 300), some.normal(size=(300, 3))
    centre[120:200] = (
        # free ones: of other closed forms, in blocks with heavy ones and in blocks of their own
        0.0
    )
    fast = omega.copy()
    fast[[111, 150]] = 1e200
    well, sick = (simulate(heavy_ones(centre, o), integrator="closed") for o in (omega, fast))
    true = simulate(heavy_ones(centre, fast), integrator="rk8", dt=0.01)
    assert (sick.status.values == true.status.values).all()
    assert np.bincount(sick.status.values).tolist() == [185, 2, 113]
    flagged = sick.status.values > 0
    for name in ("omega", "attitude", "energy_drift_max", "status_step", "status_time"):
        x, y = (ds[name].transpose("member", ...).values[flagged] for ds in (sick, true))
        assert np.array_equal(x, y, equal_nan=True)  # frozen at the start
    assert not np.isnan(sick.omega.isel(member=~flagged)).any()
    for name in well.variables:
        if "member" in well[name].dims and not name.startswith("start_omega"):
            x, y = (ds[name].transpose("member", ...).values[~flagged] for ds in (well, sick))
            assert x.tobytes() == y.tobytes()


@pytest.mark.filterwarnings("ignore:.*cannot exist")  # some are random
def test_bits_do_not_depend_on_who_shares_a_block():
    some = np.random.default_rng(1)
    centre, omega = some.normal(0.0, 0.1, 300), some.normal(size=(300, 3))
    centre[100:230] = 0.0
    scene = heavy_ones(centre, omega)
    whole = simulate(scene, integrator="closed", threads=1)
    for block, threads in ((32, 2), (64, 1), (96, 2)):
        other = simulate(scene, integrator="closed", block=block, threads=threads)
        assert all(
            whole[name].values.tobytes() == other[name].values.tobytes() for name in whole.variables
        )
    few = simulate(scene, integrator="closed", members=range(90, 110))
    same = whole.isel(member=slice(90, 110))
    assert (
        few.omega.transpose("member", ...).values.tobytes()
        == same.omega.transpose("member", ...).values.tobytes()
    )
    assert closed_form(scene).name == "free top and Lagrange top"


def test_a_member_that_spins_beyond_all_digits_stays_where_it_was():
    """Driven at a rate of 30 1/s, the phase exceeds 1e15 rad between 1 and 1.5 s, and the numbers
    overflow later.
    """
    scene = Scene(
        Body.from_moments((1.0, 1.0, 1.0)), (ViscousDamping(np.array([-30.0, -700.0, 0.1])),),
        Start(omega=(0.3, 2.0, 0.1)),
        run=Run(anti_damping=True, members=3, t_end=2.0, every=0.5, save=("momentum",)),
    )  # fmt: skip
    with pytest.warns(SceneWarning, match="drives"):
        ds = simulate(scene, integrator="closed")
    assert ds.status.values.tolist() == [STATUSES["off_unit_quaternion"], STATUSES["non_finite"], 0]
    assert ds.status_time.values[:2].tolist() == [1.5, 0.5]
    momentum = ds.momentum.transpose("member", "time", "axis").values
    assert np.isfinite(momentum).all()
    assert (momentum[0, 3:] == momentum[0, 2]).all()
    assert momentum[0, 2] == pytest.approx(np.exp(30.0) * momentum[0, 0], rel=1e-12)
    assert (momentum[1] == momentum[1, 0]).all()
    assert (np.diff(momentum[2, :, 1]) < 0).all()


BODIES = """[body]
moments = [1.4, 1.4, { grid = [-4.0, 4.0, 2] }]
mass = 1.0
centre = [0, 0, 0.1]
[effects.gravity]
g = 9.81
[start]
omega = [0.3, 1, 2]
[run]
members = 2
dt = 0.01
t_end = 1.0
"""


def test_many_exact_steps_stay_with_the_closed_form():
    scene = Scene(
        Body.from_moments((1.0, 1.4, 2.0)),
        (),
        Start(omega=(normal(0.0, 1.0),) * 3, attitude="uniform"),
    )
    omega, attitude = worst(scene, members=64, seed=1, integrator="exact", dt=0.03, t_end=3000.0)
    # measured 2.9e-12 and 2.4e-12; 9e-10 and 4e-10 if the rounding of T random-walks
    assert omega < 2e-11 and attitude < 2e-11


def test_command_with_flagged_members(tmp_path):
    file = tmp_path / "bodies.toml"
    file.write_text(BODIES)
    shown = run(str(file))
    assert shown.exit_code == 0
    assert "impossible body or start: 1" in shown.stdout
    assert "member 1:" in shown.stdout  # the good member
    assert "over 1 member" in shown.stdout
    assert "nan" not in shown.stdout
    for settings, said in (
        (("--members", "1"), "each of the first 1 has an impossible body"),
        (("--plot", str(tmp_path / "a.png")), "no motion to draw"),
        (
            (
                "--set",
                "body.moments=[1.4,1.4,2]",
                "--set",
                "start.omega=[{ normal = [0, 1e60] }, 1, 2]",
            ),
            "all 2 members are flagged (2 ",
        ),
        (
            ("--set", "body.moments=[1.4,1.4,2]", "--integrator", "closed"),
            "cannot compare the closed form with itself",
        ),
    ):
        shown = run(str(file), *settings)
        assert shown.exit_code == 3
        assert said in shown.stderr
        assert len(shown.stderr.splitlines()) < 4


def test_before_the_start_there_is_the_closed_form_alone():
    scene = Scene(Body.from_moments((1.0, 2.0, 3.0)), start=Start(omega=(0.1, 1.0, 0.2))).with_run(
        members=1
    )
    assert "none: it runs forward from t = 0" in "\n".join(compare(scene, -3.0, 1))
