"""A live page saves its motion as a scene file: the command line makes the same bits of it."""

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.physics.dynamics.functions import sincos
from rigidmc.scene.parameters import with_parameters
from rigidmc.views.live.engine import SAVED, even_end, live_run
from rigidmc.views.live.sliders import make_sliders
from tests.tools.commands import invoke
from tests.views.test_live import TOP, opened

# the splitting "strang" has one form for bodies with two equal moments and one for others
SCENES = {
    "heavy_top": {},
    "dzhanibekov": {"points": "latin_hypercube"},
    "brownian_rotor": {},
    "sleeping_top": {"integrator": "strang", "first": 7},
    "hyperion": {},
    "tennis_racket": {"integrator": "exact"},
    "pendulum": {},
    "kapitza_top": {"turn": 0.3},
    "damped_dzhanibekov": {},
    "dual_spin": {},
}
CASES = 10  # motions of each scene
MOVE = """([k, part]) => {
  const input = document.querySelectorAll('#sliders input')[k], slider = SLIDERS[k];
  input.value = Math.round(2000 * part);
  if (part < 0.5) input.dispatchEvent(new Event('input'));
  else { slider.set(slider.low + (2 * part - 1) * (slider.high - slider.low)); begin(); } }"""


def move_sliders(page, some):
    """Move up to four sliders at random, by the mouse or to any double, and choose members."""
    page.evaluate("for (const s of SLIDERS) s.set(s.given)")
    options = page.evaluate("[...document.getElementById('members').options].map(o => o.value)")
    page.select_option("#members", options[some.integers(len(options))])
    count = page.evaluate("SLIDERS.length")
    for k in some.choice(count, size=some.integers(min(count, 4) + 1), replace=False):
        page.evaluate(MOVE, [int(k), float(some.random())])


def states(page, steps):
    page.evaluate(f"begin({steps} * state.h)")
    page.wait_for_function(f"state.step >= {steps} && !state.busy", timeout=120_000)
    assert page.evaluate("[state.step, state.status]") == [steps, 0]
    if page.evaluate("state.members") == 1:
        return np.array(page.evaluate("[...shown().s.q, ...shown().s.l]"))[:, None]
    return np.array(page.evaluate("[...state.others]")).reshape(len(SAVED) + 5, -1)[:7]


def assert_same_bits(page, path):
    """The scene that a page saves has the step and the bits of the page, by the command line."""
    if page.evaluate("state.why"):  # no body has these moments
        page.evaluate("download()")
        assert "cannot be saved" in page.inner_text("#told")
        return
    saved, h = page.evaluate("[savedScene(), state.h]")
    assert saved["text"] and not saved["lost"]
    path.write_text(saved["text"])
    grid, output = rm.prepare(str(path)).plan.grid, path.with_suffix(".nc")
    assert grid.dt == h and not grid.is_shortened
    ran = invoke("run", path, "-o", output, "--force")
    assert ran.exit_code == 0, ran.output
    with xr.open_dataset(output) as ds:
        assert (ds.status.values == 0).all()
        last = [ds[name].isel(time=-1).transpose(..., "member").values for name in SAVED[:2]]
    np.testing.assert_array_equal(np.concatenate(last), states(page, grid.steps))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
@pytest.mark.parametrize("name", SCENES)
def test_hundred_saved_scenes_have_the_bits_of_the_page(name, browser, tmp_path):
    some = np.random.default_rng(sum(map(ord, name)))
    scene = rm.Scene.load(name)
    dt = scene.run.dt
    # most end times leave a last interval that is shorter
    times = {"t_end": dt * some.uniform(100, 400), "every": dt * some.uniform(2, 9)}
    scene = scene.with_run(**times, members=3).with_run(**SCENES[name])
    live = live_run(scene, 3)
    names = [slider.name for slider in make_sliders(live.run.scene.model, live.start, None)]
    if name == "dual_spin":  # the dissipation knows the momentum of the rotor
        names.append("effects.rotor.momentum.3")
    rm.live(scene, tmp_path / "page.html", dict.fromkeys(names))
    page = opened(browser, tmp_path / "page.html")
    for _ in range(CASES):
        move_sliders(page, some)
        assert_same_bits(page, tmp_path / "saved.toml")
    assert page.faults == []


@pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
def test_a_saved_scene_has_the_bits_of_the_page(browser, tmp_path):
    """With all members of a moved distribution, and a step that a faster spin has halved."""
    rm.live(TOP.with_run(t_end=0.4321, every=0.04, save=SAVED), tmp_path / "top.html")
    page = opened(browser, tmp_path / "top.html")
    for name, value in (("start.omega.3", 31.0), ("start.attitude.theta", 2.111)):
        page.evaluate(f"SLIDERS.find(s => s.name === '{name}').set({value}); begin()")
    assert page.evaluate("[state.members, state.h]") == [3, 0.0025]
    assert_same_bits(page, tmp_path / "saved.toml")


def test_angles_of_a_page_have_the_bits_of_the_command_line(browser, tmp_path):
    """Math.sin and numpy.sin round one in some thousand differently."""
    rm.live(TOP, tmp_path / "top.html", members=1)
    page = opened(browser, tmp_path / "top.html")
    angles = np.random.default_rng(1).uniform(-20.0, 20.0, 20_000)
    np.testing.assert_array_equal(page.evaluate("x => x.map(sincos)", angles.tolist()),
                                  np.stack(sincos(angles), -1))  # fmt: skip


def test_a_page_says_what_its_file_leaves_out(browser, tmp_path):
    """A solid stays one while no moment moves; a table has no file; a mixture stays where it is."""
    rm.live("pendulum", tmp_path / "page.html", {"start.attitude.theta": None, "body.mass": None})
    page = opened(browser, tmp_path / "page.html")
    solid = rm.Scene.loads(page.evaluate("savedScene().text")).body.shape[0].solid
    page.evaluate("SLIDERS[0].set(1.0); begin(); download()")
    moved = rm.Scene.loads(page.evaluate("savedScene().text"))
    grid = moved.start.attitude[1]
    assert solid == moved.body.shape[0].solid == "rod" and page.inner_text("#told") == ""
    given = rm.Scene.load("pendulum").start.attitude[1]
    first = given.values()[0]
    assert (grid.low, grid.high) == (given.low + (1.0 - first), given.high + (1.0 - first))
    page.evaluate("SLIDERS[1].set(1.1)")
    assert rm.Scene.loads(page.evaluate("savedScene().text")).body.shape == ()

    two = rm.mixture((1.0, rm.normal(0.3, 0.1)), (1.0, rm.normal(0.5, 0.1)))
    top = TOP.with_model(with_parameters(TOP.model, {"start.attitude.theta": two}))
    rm.live(top, tmp_path / "two.html", {"start.attitude.theta": None})
    page = opened(browser, tmp_path / "two.html")
    page.evaluate("SLIDERS[0].set(SLIDERS[0].given + 0.1); begin(); download()")
    assert "leaves out θ(0), moved by 5.73 °" in page.inner_text("#told")
    page.select_option("#members", "1")
    page.evaluate("download()")
    assert page.inner_text("#told") == ""

    rows = rm.Start(omega=np.array([[0.1, 0.2, 12.0], [0.3, 0.1, 13.0]]), attitude=(0.2, 0.6, -0.3))
    rm.live(rm.Scene(TOP.body, TOP.effects, rows).with_run(members=2, dt=0.01), tmp_path / "t.html")
    page = opened(browser, tmp_path / "t.html")
    page.evaluate("download()")
    assert "cannot be saved as a scene" in page.inner_text("#told")
    page.select_option("#members", "1")
    assert rm.Scene.loads(page.evaluate("savedScene().text")).start.omega == (0.1, 0.2, 12.0)


def test_a_page_has_the_members_of_its_scene():
    """Those from `first` on, and those of the points that a run of as many members has."""
    for settings in ({"first": 2}, {"points": "latin_hypercube"}, {"first": 1, "points": "sobol"}):
        scene = TOP.with_run(t_end=0.01, **settings)
        start = live_run(scene, 3).start["start_omega"][2, :3]
        ran = rm.simulate(scene, members=3).start_omega.sel(axis=3).values
        np.testing.assert_array_equal(start, ran)


@pytest.mark.parametrize("every", [0.0317, 0.7, 1 / 3])
def test_the_end_of_a_saved_scene_keeps_the_step_and_its_halves(every):
    run = live_run(TOP.with_run(t_end=1.23457, every=every), 1).run
    dt, end = run.plan.grid.dt, even_end(run)
    assert run.plan.grid.is_shortened
    for halves in range(13):
        again = rm.prepare(run.scene, t_end=end, dt=dt / 2**halves).plan.grid
        assert again.dt == dt / 2**halves and not again.is_shortened
