"""Live pages of heavy symmetric tops: starts by closed forms, ends of sliders, and readings."""

import itertools
import re

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.mechanics import rotation
from tests.views.test_live import opened

KINDS = {
    "steady precession": ("steady precession",),
    "waves": ("monotone precession",),
    "cusps": ("cusps",),
    "loops": ("loops",),
    "sleeping": ("monotone precession", "cusps"),  # 0.01 rad off the vertical
}
FORMED = """() => { const { l, q } = state.samples[0], { moments, mass, centre } = state.body;
  return [moments, mass * SLIDERS.at(-1).value * centre[2], l, q]; }"""


def shown(browser, folder, scene="heavy_top", names=None, hash_=""):
    """The live page of a scene, with sliders of these names."""
    path = folder / "top.html"
    rm.live(scene, path, names and dict.fromkeys(names), members=1, force=True)
    return opened(browser, path, hash_=hash_)


@pytest.mark.parametrize("word", ["omega", "momentum"])
def test_buttons_start_the_motions_that_they_name(word, browser, tmp_path):
    """At random leans, turns and spins, of tops that stand and hang; by the closed forms."""
    scene = rm.Scene.load("heavy_top")
    if word == "momentum":
        scene = rm.Scene(scene.body, scene.effects, rm.Start(momentum=(0.0, 0.0, 0.016),
                         attitude=(0.1, 0.4, 0.2))).with_run(members=1, dt=5e-4)  # fmt: skip
    names = [f"start.{word}.{k}" for k in (1, 2, 3)]
    names += ["start.attitude.theta", "start.attitude.psi", "effects.gravity.g"]
    page = shown(browser, tmp_path, scene, names)
    some = np.random.default_rng(5)
    scale = 1.0 if word == "omega" else scene.body.moments[2]
    for _ in range(6):
        spin, lean, turn = some.uniform((150.0, 0.2, -3.0), (300.0, 2.9, 3.0)).tolist()
        for button, kinds in KINDS.items():
            numbers = {2: spin * scale, 3: lean, 4: turn}
            page.evaluate("; ".join(f"SLIDERS[{k}].set({x})" for k, x in numbers.items()))
            page.evaluate("begin()")
            page.evaluate("word => { setPreset(word); play(false); }", button)
            moments, weight, momentum, attitude = page.evaluate(FORMED)
            motion = rm.analyse_lagrange_top(moments, weight, momentum, attitude)
            assert str(motion.kind) in kinds, (button, spin, lean)
            if button == "steady precession":
                omega = np.array(momentum) / moments
                slow, _ = rm.steady_precession(moments, weight, omega[2], lean)
                push = np.hypot(*omega[:2]) / np.sin(lean)
                assert push == pytest.approx(abs(slow), rel=1e-13)  # measured 4e-16
                # the ends of the sliders are about twice the push
                ends = page.evaluate("SLIDERS[0].high") / (1.0 if word == "omega" else moments[0])
                assert ends == pytest.approx(2.0 * abs(slow) * np.sin(lean), rel=0.06)
    assert page.faults == []


def test_the_mean_rate_is_that_of_whole_nutations(browser, tmp_path):
    """Loops after 1.9 nutations: the mean over the whole time is 16 % less."""
    page = shown(browser, tmp_path, hash_="#t=0.28&start.omega.2=-1.7&start.omega.3=200")
    page.wait_for_function("!state.busy && state.step >= 560")
    moments, start = page.evaluate("state.body.moments"), (0.0, -1.7, 200.0)
    weight = page.evaluate("state.body.mass * 9.81 * state.body.centre[2]")
    motion = rm.analyse_lagrange_top(moments, weight, np.multiply(start, moments), (0.0, 0.4, 0.0))
    read = float(re.search("mean dφ/dt ([-.0-9]+)", page.inner_text("#readings"))[1])
    mean = np.degrees(float(motion.precession / motion.period))
    assert read == pytest.approx(mean, rel=1e-3)  # measured 1.6e-4


def test_a_mean_of_less_than_a_nutation_is_one_so_far(browser, tmp_path):
    """The change of phi by the time passed, beside the closed form."""
    for t in (0.03, 0.09, 0.13):  # of a nutation of 0.15 s
        page = shown(browser, tmp_path, hash_=f"#t={t}&start.omega.2=-1.7&start.omega.3=200")
        page.wait_for_function(f"!state.busy && state.step >= {round(t / 5e-4)}")
        moments = page.evaluate("state.body.moments")
        weight = page.evaluate("state.body.mass * 9.81 * state.body.centre[2]")
        momentum = np.multiply((0.0, -1.7, 200.0), moments)
        true = rm.solve_lagrange_top(moments, weight, momentum, (0.0, 0.4, 0.0), [t]).attitude
        phi = np.degrees(float(rotation.euler(true[0])[0]))
        read = float(re.search("so far ([-.0-9]+)", page.inner_text("#readings"))[1])
        assert read == pytest.approx(phi / t, rel=5e-4)  # measured 8e-5
        page.close()


ULPS = (0, 1, 2, 8, 1000, 1e8)  # between the ends of an axis, in those of its lower end


@pytest.mark.parametrize("low", [0.0, 1e-9, 30.0, -30.0, 1e6])
def test_charts_draw_values_that_differ_by_rounding(low, browser, tmp_path):
    """As theta does in steady precession: a page that could not draw them stopped."""
    page = shown(browser, tmp_path)
    for dots in (True, False):
        for across, upward in itertools.product(ULPS, ULPS):
            x, y = ([low, low + float(np.spacing(low)) * ulps] for ulps in (across, upward))
            drawn = {"series": [{"x": x, "y": y, "name": "a"}], "across": "", "upward": ""}
            page.evaluate("drawn => charts.portrait.draw(drawn)", {**drawn, "dots": dots})
    assert page.faults == []


def test_buttons_need_no_slider_of_a_spin_that_is_0(browser, tmp_path):
    names = ["start.omega.2", "start.omega.3", "start.attitude.theta"]
    page = shown(browser, tmp_path, names=names)
    assert page.locator("#presets button").count() == len(KINDS)
    for word in KINDS:
        page.click(f"#presets >> text={word}")
    assert page.evaluate("SLIDERS.map(s => s.value)")[2] == 0.01  # sleeping
    assert page.faults == []


def test_a_page_reads_off_the_motion(browser, tmp_path):
    """Rates and periods beside the closed form; a top that spins too slowly says what it needs."""
    page = shown(browser, tmp_path, hash_="#t=2&start.omega.3=200")
    page.wait_for_function("!state.busy && state.step >= 4000")
    moments = page.evaluate("state.body.moments")
    weight = page.evaluate("state.body.mass * 9.81 * state.body.centre[2]")
    start = moments, weight, (0.0, 0.0, 200.0 * moments[2]), (0.0, 0.4, 0.0)
    motion, text = rm.analyse_lagrange_top(*start), page.inner_text("#readings")
    read = {name: float(re.search(f"{name} ([-.e0-9]+)", text)[1]) for name in
            ("nutation", "mean dφ/dt", "E", "steady precession")}  # fmt: skip
    assert read["nutation"] == pytest.approx(float(motion.period), rel=1e-3)  # measured 1.5e-4
    assert read["E"] == pytest.approx(float(motion.energy), rel=1e-5)  # measured 5e-7
    mean = np.degrees(float(motion.precession / motion.period))
    assert read["mean dφ/dt"] == pytest.approx(mean, rel=5e-4)  # measured 5e-5
    slow, _ = rm.steady_precession(moments, weight, 200.0, 0.4)
    assert read["steady precession"] == pytest.approx(np.degrees(slow), rel=1e-3)
    # waves end at the push that the page states
    push = float(re.search("waves for a push dφ/dt sin θ of 0 to ([.0-9]+)", text)[1])
    for part, kind in ((0.999, "monotone precession"), (1.001, "loops")):
        momentum = np.multiply(moments, (0.0, part * push, 200.0))
        assert rm.analyse_lagrange_top(moments, weight, momentum, start[3]).kind == kind
    page.evaluate("SLIDERS.find(s => s.name === 'start.omega.3').set(80); begin()")
    page.click("text=steady precession")
    least = float(rm.least_spin(moments, weight, 0.4))
    assert f"needs |ω₃| above {least:.4g} rad/s, and ω₃ is 80 rad/s" in page.inner_text("#told")


def test_a_button_without_an_effect_says_why(browser, tmp_path):
    """Before, nothing happened; and a vertical top had a mean rate of phi, by rounding."""
    names = ["start.omega.2", "start.omega.3", "start.attitude.theta", "effects.gravity.g"]
    page = shown(browser, tmp_path, names=names)
    page.evaluate("SLIDERS[2].set(0); begin(0.05)")
    page.wait_for_function("!state.busy && state.step >= 100")
    assert "mean dφ/dt" not in page.inner_text("#readings")
    page.click("#presets >> text=loops")
    assert "let it lean first" in page.inner_text("#told")
    page.evaluate("SLIDERS[2].set(0.4); SLIDERS[3].set(0); begin()")
    page.click("#presets >> text=loops")
    assert "No weight turns this top" in page.inner_text("#told")
    page.evaluate("SLIDERS[3].set(9.81); begin(0.05)")
    page.wait_for_function("!state.busy && state.step >= 100")
    assert "mean dφ/dt" in page.inner_text("#readings") and page.faults == []


def test_a_link_takes_a_bounded_time_and_says_so(browser, tmp_path):
    link = "#t=1e9&start.omega.9=3&start.omega.3=1e7&space=moon&body.moments.1=x"
    page = shown(browser, tmp_path, hash_=link)
    page.evaluate("state.spent = LONGEST")  # the work of ten seconds
    page.wait_for_function("!state.busy && state.step * state.h === state.time")
    told = page.inner_text("#told")
    for words in ("this page has no start.omega.9", "start.omega.3 = 1e7 is beyond its slider",
                  "space = moon is not possible", "body.moments.1 = x is not possible",
                  "The time 1e9 s takes", "stopped after 10 s of work"):  # fmt: skip
        assert words in told
    page.evaluate("begin(0.1)")
    page.wait_for_function("!state.busy && state.step >= 200")
    assert page.inner_text("#told") == "" and page.faults == []


def test_a_page_of_several_scenes_shows_two_side_by_side(browser, tmp_path):
    """At the lower speed of both, and both start again by one key."""
    slow = rm.Scene.load("heavy_top", {"start.omega": (0, 0, 60)})
    rm.live({"a <top>": "heavy_top", "slow": slow}, tmp_path / "class.html", members=1)
    page = browser.new_page(reduced_motion="reduce")
    page.goto((tmp_path / "class.html").as_uri())
    page.check("#two")
    page.wait_for_function("speeds.size >= 2")
    frames = page.frames[1:]
    assert [frame.inner_text("h1") for frame in frames] == ["a <top>", "slow"]
    for frame in frames:
        frame.wait_for_function("state.ready && state.speed === 0.05")
        frame.evaluate("begin(0.1)")
    page.click("#both")
    for frame in frames:
        frame.wait_for_function("state.time === 0")
    # after the mouse the keys are the pages', and a speed is that of both
    page.keyboard.press(" ")
    for frame in frames:
        frame.wait_for_function("state.playing")
    frames[1].select_option("#speed", "0.2")
    for frame in frames:
        frame.wait_for_function("state.speed === 0.2")
    # a key pressed in a page reaches the other: after Space both rest, though one had rested
    frames[0].evaluate("play(false)")
    frames[1].locator("h1").click()
    page.keyboard.press(" ")
    page.keyboard.press("Home")
    for frame in frames:
        frame.wait_for_function("!state.playing && state.time === 0")
    page.keyboard.press("ArrowRight")
    for frame in frames:
        frame.wait_for_function("state.time === state.h")
    page.locator("#two").click()
    page.locator("#two").click()
    page.keyboard.press(" ")
    assert page.is_checked("#two")
    with pytest.raises(OptionError, match="at least one scene"):
        rm.live({})


@pytest.mark.slow
def test_a_phone_scrolls_and_keeps_the_top_in_view(browser, tmp_path):
    """A swipe up scrolls, one to the side turns the picture, and the body stays on the screen."""
    rm.live("heavy_top", tmp_path / "top.html", members=1)
    size = {"width": 390, "height": 800}
    kind = {"has_touch": True, "is_mobile": True, "reduced_motion": "reduce"}
    phone = browser.new_context(viewport=size, **kind)
    page = phone.new_page()
    page.goto((tmp_path / "top.html").as_uri())
    page.wait_for_function("state.ready")
    hand, now = phone.new_cdp_session(page), "[scrollY, stages.body.azimuth, stages.body.elevation]"

    def swipe(x, y, right, up):
        for kind, part in (("touchStart", 0.0), *(("touchMove", 0.1 * k) for k in range(1, 11))):
            point = {"x": x + part * right, "y": y - part * up}
            hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
        hand.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        page.wait_for_timeout(500)

    box = page.locator("#body").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    before = page.evaluate(now)
    for right, up in ((0, 100), (80, 0)):
        swipe(x, y, right, up)
        after = page.evaluate(now)
        assert after[2] == before[2]
        assert (after[0] > 50, after[1] == before[1]) == (True, right == 0)
    page.evaluate("scrollTo(0, 900)")
    page.wait_for_timeout(300)
    assert page.locator("#body").bounding_box()["y"] == 0.0
    # a swipe that begins on a slider leaves it where it was
    values = page.evaluate("SLIDERS.map(s => s.value)")
    for slider in page.locator("#sliders input").all()[:4]:
        slider.scroll_into_view_if_needed()
        page.wait_for_timeout(300)
        box = slider.bounding_box()
        x, y, from_top = box["x"] + 0.8 * box["width"], box["y"] + 8.0, page.evaluate("scrollY")
        swipe(x, y, 0, 200)
        assert page.evaluate("scrollY") > from_top + 50
        assert page.evaluate("SLIDERS.map(s => s.value)") == values
    assert "circle of fixed points" in page.inner_text("#inside-words")


def test_a_slider_has_a_finer_drag(browser, tmp_path):
    """With Shift, by the mouse and by keys, and with the box `fine` where there is no Shift."""
    page = shown(browser, tmp_path, "dzhanibekov")
    slider = page.locator("#sliders input").nth(4)
    width = page.evaluate("SLIDERS[4].high - SLIDERS[4].low")
    moves = {}
    for key in ("", "Shift"):
        slider.focus()
        before = page.evaluate("SLIDERS[4].value")
        page.keyboard.press(f"{key}+ArrowRight" if key else "ArrowRight")
        moves[key] = page.evaluate("SLIDERS[4].value") - before
    assert moves[""] == pytest.approx(1e-3 * width, rel=0.01)
    assert moves["Shift"] == pytest.approx(1e-4 * width, rel=0.01)
    box = slider.bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    drags = {}
    for key in ("", "Shift", "fine"):
        page.evaluate("SLIDERS[4].set(0)")
        page.set_checked("#fine", key == "fine")
        page.mouse.move(x, y)
        if key == "Shift":
            page.keyboard.down(key)
        page.mouse.down()
        page.mouse.move(x + 10.0, y)
        page.mouse.move(x + 40.0, y)
        page.mouse.up()
        if key == "Shift":
            page.keyboard.up(key)
        drags[key] = page.evaluate("SLIDERS[4].value") / width
    for key in ("Shift", "fine"):  # from the place of the pointer after its first move, or at once
        assert 0.05 * drags[""] < drags[key] < 0.12 * drags[""]
