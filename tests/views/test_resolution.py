"""Lines through saves: how fast what is shown turns, and what a picture, a gif, a page and `unwrap`
say where saves are too far apart."""

import math

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.planning.saves import (
    ATTITUDE,
    AXIS,
    BODY,
    KINDS,
    MOST,
    Drive,
    drive,
    rounded_down,
    sparse,
    sparse_saves,
    turning_at_start,
    turning_rates,
)
from rigidmc.runs.prepare import prepare_scene
from rigidmc.scene.library import shipped_names
from rigidmc.views import animation, ensemble
from rigidmc.views.descriptions import _steps
from rigidmc.views.globes import momentum_density
from rigidmc.views.sample import TIMES, fastest, note_on, thin_result
from tests.tools.commands import invoke

GYROSCOPE = rm.Scene.load("gyroscope").with_run(members=16, t_end=0.4)


def parts(scene):
    return scene.model, scene.run


def bodies(count):
    """Moments (3, count) of bodies that exist, and momenta."""
    chance = np.random.default_rng(3)
    second = chance.uniform(0.05, 1.0, (3, count))
    return second.sum(0) - second, chance.normal(size=(3, count))


def test_a_free_momentum_turns_with_the_rate_of_its_closed_form():
    moments, l = bodies(300)
    got = turning_rates(moments, l, Drive())
    exact = rm.analyse_free_top(moments.T, l.T).rate
    assert np.abs(got.body / exact - 1.0).max() < 1e-12  # measured 3e-14
    spin = np.linalg.norm(l / moments, axis=0)
    assert np.all(exact <= spin * (1.0 + 1e-12)) and np.allclose(got.attitude, spin)


def test_a_rotor_changes_it_as_the_linear_motion_says():
    moments, l = bodies(100)
    rotor = np.random.default_rng(4).normal(size=(3, 100))
    got = turning_rates(moments, l, Drive(rotor=rotor)).body
    for k in range(100):
        inverse, whole = np.diag(1.0 / moments[:, k]), l[:, k] + rotor[:, k]
        spin = inverse @ l[:, k]
        columns = [np.cross(e, spin) + np.cross(whole, inverse @ e) for e in np.eye(3)]
        c = np.poly(np.array(columns).T)[2]
        assert abs(got[k] ** 2 / abs(c) - 1.0) < 1e-9  # measured 4e-12


def test_the_axis_of_a_symmetric_body_goes_round_its_momentum():
    moments, l = np.array([[2.0], [2.0], [3.5]]), np.array([[0.3], [0.4], [5.0]])
    got = turning_rates(moments, l, Drive()).axis
    assert got == pytest.approx(np.linalg.norm(l) / 2.0, rel=1e-12)


def test_effects_swing_shake_and_hold():
    length, g = 0.3, 9.81
    body = rm.Body((length**2, length**2, 1e-4), mass=1.0, centre=(0.0, 0.0, length))
    by = drive(*parts(rm.Scene(body, rm.Gravity(g))))
    # less the mean of 32 attitudes; measured 1.056
    assert 0.9 < by.swing / math.sqrt(g / length) < 1.1 and by.attitude
    shaken = rm.MovingPivot(swing=(0.0, 0.0, 0.01), frequency=440.0)
    assert drive(*parts(rm.Scene(body, (rm.Gravity(g), shaken)))).frequency == 440.0
    held = drive(*parts(rm.Scene(body, rm.Rotor((0.0, 0.0, 2.0)))))
    assert held.rotor[2, 0] == 2.0 and not held.attitude and held.swing == 0.0
    damped = drive(*parts(rm.Scene(body, rm.ViscousDamping(1e6))))
    assert damped.swing == 0.0 and not damped.attitude


@pytest.mark.parametrize(("rates", "drawn", "found"), [
    ([1.0, 1.9], (), None),
    ([1.0, 2.1], (), 1),
    ([2.1] + [1.0] * 1999, (), None),  # one in a thousand
    ([2.1] + [1.0] * 1999, (0,), 1),
    ([2.1] * 3 + [1.0] * 1997, (), 3),
    ([np.nan, 1.0], (), None),
    ([0.0], (0,), None),
])  # fmt: skip
def test_who_turns_too_far(rates, drawn, found):
    got = sparse(np.array(rates), 1.0, drawn)
    assert (got and got.fast) == found
    if found:
        assert got.every * 2.1 <= MOST and got.every == 0.95


def test_rounding_never_goes_up():
    for value in np.random.default_rng(5).uniform(-12.0, 12.0, 500):
        number = 10.0**value
        down = rounded_down(number)
        assert 0.9 * number < down <= number * (1.0 + 1e-9)
    assert rounded_down(0.0033) == 0.0033


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenes_save_what_lines_can_join(name):
    """As their starts and their effects tell."""
    scene = rm.Scene.load(name)
    assert sparse_saves(*parts(scene)) is None
    assert round(scene.run.t_end / scene.run.every) + 1 <= TIMES  # all saves are drawn


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenes_as_they_move(name):
    """From rest and under torques bodies get faster than their starts tell."""
    scene = rm.Scene.load(name)
    scene = scene.with_run(members=200, save=(*scene.run.save, "momentum"), keep="full")
    if scene.effects == () or scene.run.t_end / scene.run.dt < 20_000 or name == "chandler":
        part = thin_result(rm.simulate(scene))
    else:  # the step of a benchmark takes long, and rk8 needs fewer
        part = thin_result(rm.simulate(scene, integrator="rk8", dt=scene.run.every / 4.0))
    kinds = {KINDS[word] for word in scene.run.save if word in KINDS}
    for kind in kinds | ({AXIS} if ATTITUDE in kinds else set()):
        assert note_on(part, kind) == ""
        angle = fastest(part, kind).max() * scene.run.every
        assert angle < MOST  # measured 0.13 (pendulum) to 1.84 (toutatis)


def test_every_picture_of_what_turns_too_far_says_so(tmp_path):
    coarse = rm.simulate(GYROSCOPE, threads=1, every=0.01)
    fine = rm.simulate(GYROSCOPE, threads=1)
    many = rm.simulate(GYROSCOPE, threads=1, every=0.01, members=24)
    for draw, ds, says in (
        (ensemble.middle_component, coarse, "of 16 members turn by up to"),
        (ensemble.middle_component, fine, ""),
        (momentum_density, coarse, ""),  # closed forms show the motion between the saves
        (momentum_density, fine, ""),
        (ensemble.summary, coarse, ""),  # up to 20 members are recomputed where saves are coarse
        (ensemble.summary, many, ""),  # its spheres are in closed form, too
    ):
        figure = draw(ds)
        titles = " ".join(axes.get_title() for axes in figure.axes).replace("\n", " ")
        assert says in titles and ("turn by up to" in titles) is bool(says), (draw, titles)
        assert ("use every <= 0.003" in titles) is bool(says)
    truth = np.linalg.norm(fine.omega.values, axis=1).max()
    assert truth * 0.0034 < MOST < truth * 0.0035
    # a scene of somebody's own code is not read: what is conserved tells whether there are torques
    unread = coarse.copy()
    del unread.attrs["scene"]
    for figure in (unread.rigid.plot.middle_component(), momentum_density(unread)):
        title = figure.axes[0].get_title().replace("\n", " ")
        assert "of 16 members turn by up to" in title
    # of more saves than a picture can draw, the time to draw is named
    long = fine.isel(time=np.arange(40_000) % 2)
    long = long.assign_coords(time=np.arange(40_000) * 0.002)
    (title,) = (axes.get_title() for axes in long.rigid.plot.middle_component().axes)
    assert "of 40,000 saves drawn, 0.02 s apart" in title.replace("\n", " ")


def test_unwrap_follows_or_refuses():
    """800 rad/s: the documented way gave -448 rad/s at the saves that `rigidmc new` wrote."""
    scene = GYROSCOPE.with_run(members=2)
    spin = scene.with_run(every=0.002)
    ds = rm.simulate(spin, threads=1)
    psi = ds.rigid.unwrapped("psi")
    rate = (psi[-1] - psi[0]).values / float(ds.time[-1])
    truth = ds.start_omega.sel(axis=3).values  # constant; level, so that psi' = omega_3
    assert np.abs(rate / truth - 1.0).max() < 0.01  # measured 2e-3, by the nodding
    naive = np.unwrap(rm.simulate(scene, threads=1, every=0.01).rigid.euler().psi.values, axis=0)
    assert np.abs(naive[-1] / 0.4 / truth - 1.0).min() > 0.5
    with pytest.raises(ValueError, match=r"psi: all of 2 members turn .* every <= 0.00\d+ s"):
        rm.simulate(scene, threads=1, every=0.01).rigid.unwrapped("psi")
    with pytest.raises(ValueError, match="expected phi, psi or an angle"):
        ds.rigid.unwrapped("energy")
    only = rm.simulate(scene, threads=1, every=0.01, save=("attitude",))
    with pytest.raises(ValueError, match="turn by up to"):
        only.rigid.unwrapped("phi")


@pytest.mark.parametrize("spin", [0.3, 20.0, 800.0, 5e4])
def test_a_new_scene_saves_what_lines_can_join(tmp_path, spin):
    file = tmp_path / "top.toml"
    words = ["new", str(file), "--force", "--spin", f"0,0,{spin}"]
    assert invoke(*words).exit_code == 0
    scene = rm.Scene.load(file)
    assert sparse_saves(*parts(scene)) is None
    fastest_rate = max(float(np.max(rate)) for rate in turning_at_start(*parts(scene)))
    assert scene.run.every * fastest_rate <= 1.0 + 1e-9
    assert invoke(*words, "--t-end", "1day").exit_code == 0
    assert rm.Scene.load(file).run.every == 86400.0  # the first and the last state


def test_show_says_so():
    scene = GYROSCOPE.with_run(every=0.01)
    shown = "\n".join(_steps(prepare_scene(scene), scene.run.every))
    assert "turn by up to 5.93 rad between saves" in shown and "use every <= 0.0033 s" in shown


def test_an_animation_says_how_far_it_turns_between_frames():
    from rigidmc.runs.frames import frames

    ds = rm.simulate(GYROSCOPE, threads=1, members=1)
    few = frames(ds, 0, 4 * 20)
    words = animation.between_frames(few)
    assert "turns by up to" in words and "apparent motion is wrong" in words
    figure, _ = animation.scene(few)
    assert any("apparent motion is wrong" in text.get_text() for text in figure.texts)
    shown = float(words.partition("show ")[2].split(" s ")[0])
    assert 0.01 < shown < 0.2 * GYROSCOPE.run.t_end
    assert animation.between_frames(frames(ds, 0, 4 * 20, until=shown)) == ""
    assert animation.between_frames(frames(ds, 0, 4 * 200)) == ""


@pytest.mark.slow  # 6 s, to compile
def test_a_page_shows_what_spins_up():
    """From rest: the first momentum tells no rate, and 300 frames would jump by 10 rad each."""
    from rigidmc.runs.frames import frames
    from rigidmc.views.viewer.data import closer, motion_span, unseen

    body = rm.Body((1.0, 1.2, 1.5))
    torque = rm.BodyTorque((0.0, 0.0, 1.5))
    scene = rm.Scene(body, torque, rm.Start(omega=(0.0, 0.0, 0.0)))
    ds = rm.simulate(scene, integrator="rk8", dt=0.02, t_end=40.0, members=1, threads=1)
    count, end, _ = motion_span(ds, 40.0)
    shown = frames(ds, 0, count, until=end)
    assert unseen(shown)
    count, end, rate = closer(shown, 40.0)
    assert rate == pytest.approx(40.0, rel=1e-3) and end == 40.0
    shown = frames(ds, 0, count, until=end)
    assert closer(shown, 40.0) is None and unseen(shown) == ""


def test_closed_forms_are_drawn_finely_enough():
    """A pencil: its spin turns 100 times in a nutation."""
    from rigidmc.views.closed_forms import _resolved
    from rigidmc.views.sample import DENSE, FINE

    t = _resolved((1.0, 1.0, 0.004), (0.0, 0.1, 0.4), 2.0 * np.pi / 0.4)
    assert np.diff(t).max() * 100.0 <= FINE * 1.01 and t[-1] == 2.0 * np.pi / 0.4
    t = _resolved((1.0, 1.0, 1e-6), (0.0, 0.1, 0.4), 10.0)
    assert len(t) == DENSE[1] and np.diff(t).max() * 4e5 <= FINE * 1.01


def test_kinds_are_fields_of_turning():
    rates = turning_rates(np.ones((3, 1)), np.ones((3, 1)), Drive())
    assert {BODY, AXIS, ATTITUDE} == set(rates._fields)
