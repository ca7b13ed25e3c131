"""Scenes: TOML there and back, shipped scenes, settings, and a message for all mistakes."""

import inspect
import re
from fractions import Fraction
from types import NoneType
from typing import get_args

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.main import get_command

import rigidmc as rm
from bench.tools.mistakes import MOMENTS, TABLES
from bench.tools.mistakes import SCENE as GOOD
from rigidmc.cli.app import app
from rigidmc.planning.steps import _count, make_time_grid
from rigidmc.scene.library import shipped_names
from rigidmc.scene.settings import Run, types
from tests.tools.plans import plan_of

# what the messages must say; MORE and the registry tell {mistake: (text replaced, replacement)}
BAD = {
    "unknown table": ["bdy", "did you mean 'body'"],
    "unknown key": ["[start]", "omgea", "did you mean 'omega'"],
    "unknown setting": ["[run]", "member", "did you mean 'members'"],
    "unknown effect": ["gravty", "did you mean 'gravity'"],
    "unknown parameter": ["[effects.gravity]", "k", "known: g"],
    "missing parameter": ["[effects.gravity]", "g", "missing"],
    "unknown integrator": ["[run]", "integrator", "'rkm4'", "did you mean 'rkmk4'"],
    "integrator that is a number": ["[run]", "integrator", "string"],
    "integrator that takes no torque": ["[run]", "takes no torque", "gravity", "or rk8"],
    "triangle inequality": ["[body]", "moments", "triangle inequality", "(1, 2, 9)", "by 6"],
    "negative moment": ["[body]", "moments", "positive"],
    "two moments": ["[body]", "moments", "3 components"],
    "moment that is nan": ["[body]", "moments", "finite"],
    "text for a number": ["[effects.gravity]", "g", "9.81 m"],
    "two bodies": ["[body] moments, box", "keep one"],
    "dt of zero": ["[run]", "dt", "0.0", "greater than 0"],
    "no members": ["[run]", "members", "greater than 0"],
    "half a member": ["[run]", "members", "integer"],
    "negative seed": ["[run]", "seed", "greater than or equal to 0"],
    "observable that is none": ["[run]", "save", "did you mean 'omega'"],
    "quaternion of norm 0": ["[start]", "attitude", "nonzero"],
    "matrix that is no rotation": ["[start]", "attitude", "differs from 1 by 0.1"],
    "attitude that is none": ["[start]", "attitude", "did you mean 'uniform'"],
    "distribution that is none": ["[start]", "omega", "did you mean 'normal'"],
    "negative standard deviation": ["[start]", "omega", "standard deviation > 0"],
    "impossible bodies": ["[body]", "sampled bodies are impossible"],
    "no TOML": ["not valid TOML", "line"],
    "rows of a result": ["[start]", "omega", "result file"],
    "only a shape": ["[body] moments", "only drawn", "ellipsoid"],
    "a list of bodies": ["body", "write [body] in single brackets"],
    "text that is a number": ["[effects.gravity]", "g", "'9.81'", "number"],
    "dt negative": ["[run]", "dt", "-0.1", "greater than 0"],
    "dt nan": ["[run]", "dt", "finite"],
}
MORE = {
    "only a shape": (f"moments = {MOMENTS}", "shape = [{ solid = 'ball', radius = 1.0 }]"),
    "a list of bodies": ("[body]", "[[body]]"),
    "text that is a number": ("9.81", '"9.81"'),
    "dt negative": ("dt = 0.01", "dt = -0.1"),
    "dt nan": ("dt = 0.01", "dt = nan"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes(case):
    old, new = (TABLES | MORE)[case]
    assert old in GOOD
    with pytest.raises(rm.SceneError) as caught:
        prepared(GOOD.replace(old, new, 1))
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert "\n" not in message or "TOML" in message
    for word in BAD[case]:
        assert word in message, message


def prepared(text):
    scene = rm.Scene.loads(text, "mine.toml")
    try:
        return plan_of(scene)
    except rm.SceneError as error:
        error.file = "mine.toml"
        raise


def test_the_good_scene_is_good():
    assert prepared(GOOD).run.members == 100


values = st.recursive(
    st.none().map(lambda _: "")
    | st.booleans()
    | st.integers(-3, 3)
    | st.floats(allow_nan=True)
    | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(["normal", "uniform", "g", "x"]), inner, max_size=2)
    ),
    max_leaves=6,
)
places = st.sampled_from(
    ["body.moments", "body.mass", "body.centre", "body.pivot", "body.tensor", "body.cylinder",
    "body.particles", "effects.gravity.g",
     "effects.viscous_damping", "effects", "start.omega", "start.momentum", "start.attitude",
     "start", "run.dt", "run.t_end", "run.members",
     "run.every", "run.save", "run.integrator", "run.seed", "run", "title", "body"]
)  # fmt: skip


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(places, values)
def test_any_value_anywhere_is_good_or_gets_one_message(place, value):
    """Hypothesis puts anything anywhere: a scene loads or a SceneError says why; nothing else is
    ever raised."""
    import tomllib
    import warnings

    data = tomllib.loads(GOOD)
    *tables, key = place.split(".")
    inner = data
    for table in tables:
        inner = inner.setdefault(table, {})
    inner[key] = value
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            prepared(tomli_w.dumps(data))
        except rm.SceneError as error:
            assert str(error).startswith("mine.toml: ")


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_scenes_load_and_return(name):
    scene = rm.Scene.load(name)
    again = rm.Scene.loads(scene.dumps())
    assert again.dumps() == scene.dumps()
    assert scene.title == name
    assert scene.summary
    assert scene.source
    rm.prepare(scene)


def test_a_misspelt_name_gets_the_nearest():
    with pytest.raises(FileNotFoundError, match="did you mean 'heavy_top'"):
        rm.Scene.load("heavytop")


def test_a_setting_names_a_component():
    settings = [("start.omega.3", "300"), ("body.pivot.3", "-0.05")]
    scene = rm.Scene.load("heavy_top", settings)
    assert rm.Scene.load("heavy_top", dict(settings)).dumps() == scene.dumps()
    assert scene.start.omega == (0.0, 0.0, 300.0) and scene.body.centre[2] == pytest.approx(0.05)
    for key in ("start.omega.4", "start.omega.x", "start.omega.3.1"):
        with pytest.raises(rm.SceneError, match=r"component|table"):
            rm.Scene.load("heavy_top", [(key, "1")])


def test_a_setting_names_a_component_of_a_vector_with_one_unit():
    """`rigidmc show`, maps and sliders name start.omega.3 of such a scene: --set takes it, too."""
    whole = {"start.omega": "[60.0, 0.0, 1500.0] rpm", "start.attitude": "[0.0, 30.0, 0.0] deg"}
    parts = {"start.omega.3": "25 rev/s", "start.omega.2": "2.0", "start.attitude.theta": "20 deg"}
    start = rm.Scene.load("heavy_top", {**whole, **parts}).start
    turn = 2.0 * np.pi
    assert start.omega == pytest.approx((turn, 2.0, 25.0 * turn), rel=1e-15)
    assert start.attitude == pytest.approx((0.0, np.pi / 9.0, 0.0), rel=1e-15)
    with pytest.raises(rm.SceneError, match="component from 1 to 3"):
        rm.Scene.load("heavy_top", {**whole, "start.omega.x": "1"})


def test_settings_override():
    settings = {"effects.gravity.g": "1.62", "body.moments": "[1, 2, 2.5]"}
    scene = rm.Scene.load("bruels_cardona", {**settings, "run.integrator": "rkmk4"})
    assert scene.effects == (rm.Gravity(1.62),)
    assert scene.body.moments == (1.0, 2.0, 2.5)
    assert scene.run.integrator == "rkmk4"


def test_effects_have_one_order():
    body = rm.Body((1, 2, 2.5), centre=(0, 0, 1))
    one = rm.Scene(body, (rm.ViscousDamping(0.1), rm.Gravity(9.81)))
    assert [type(e) for e in one.effects] == [rm.Gravity, rm.ViscousDamping]


@pytest.mark.parametrize(
    ("t_end", "dt", "every", "expected"),
    [
        (10.0, 0.01, None, (1000, 1000)),
        (10.0, 0.01, 0.1, (1000, 10)),
        (10.0, 0.03, None, (334, 334)),
        (10.0, 0.03, 0.1, (400, 4)),
        (10.0, 0.1, 0.3, (100, 3)),
        (1.0, 5.0, None, (1, 1)),
        (1.0, 0.1, 2.0, (10, 10)),
        (0.3, 0.1, 0.1, (3, 1)),
    ],
)
def test_steps_and_saves(t_end, dt, every, expected):
    made = make_time_grid(t_end, dt, every)
    assert (made.steps, made.stride) == expected
    assert made.dt <= dt * (1 + 1e-9)
    assert made.steps * made.dt == pytest.approx(t_end, rel=1e-15)
    assert (made.head, made.last_dt) == (made.steps, made.dt)
    assert bool(made.notes) == (abs(made.dt / dt - 1) > 0.01)
    # the reduced step is a fixed point
    assert make_time_grid(t_end, made.dt, every)[:-1] == made[:-1]


def test_negative_damping_needs_a_word():
    body, start = rm.Body((1.0, 1.5, 2.0)), rm.Start(omega=(0.1, 0.2, 0.3))
    for effect in (
        rm.ViscousDamping(-0.1),
        rm.AxialDamping((0.1, -0.1, 0.1)),
        rm.DryFriction(-0.1, 0.1),
    ):
        with pytest.raises(rm.SceneError, match="anti_damping = true"):
            rm.Scene(body, (effect,), start)
    run = rm.Run(anti_damping=True, dt=0.1, t_end=1.0, members=32)
    with pytest.warns(rm.SceneWarning, match="drives the body"):
        ds = rm.simulate(rm.Scene(body, (rm.ViscousDamping(-0.1),), start, run), save="l2")
    assert np.allclose(ds.l2[-1], np.exp(0.2) * ds.l2[0], rtol=1e-6)


def test_effects_with_vectors_and_two_of_a_kind(tmp_path):
    """From TOML, stored per member, and back from the file to the same bits."""
    text = """
    [body]
    moments = [1.0, 1.5, 2.0]
    [[effects.spring]]
    stiffness = 2.0
    at = [0.5, 0.0, { normal = [0.0, 0.1] }]
    to = [0.0, 0.0, 1.0]
    [[effects.spring]]
    stiffness = { uniform = [0.5, 1.0] }
    at = [0.0, 0.5, 0.0]
    to = [1.0, 0.0, 0.0]
    length = 0.3
    [start]
    omega = [0.1, 0.2, 0.3]
    [run]
    dt = 0.05
    t_end = 2.0
    members = 40
    save = ["omega", "energy"]
    """
    scene = rm.Scene.loads(text)
    ds = rm.simulate(scene, output=tmp_path / "a.nc")
    assert {"spring_at", "spring_2_stiffness"} <= set(ds.data_vars)
    assert ds.spring_at.dims == ("axis", "member")
    assert float(ds.energy_drift_max.max()) < 1e-5
    again = rm.simulate(rm.Scene.loads(scene.dumps()))
    stored = rm.simulate(rm.Scene.load(tmp_path / "a.nc"))
    for name in ("omega", "energy"):
        assert np.array_equal(ds[name], again[name])
        assert np.array_equal(ds[name], stored[name])
    with pytest.raises(rm.SceneError, match="3 components"):
        rm.Scene.loads(text.replace("[0.0, 0.5, 0.0]", "[0.0, 0.5]"))
    with pytest.raises(rm.SceneError, match=r"effects.spring.*stifness.*stiffness"):
        rm.Scene.loads(text.replace("stiffness = 2.0", "stifness = 2.0"))


def test_a_step_more_is_made_from_a_billionth_of_a_step_on():
    """_count rounds up, and takes 1e-9 of a step for rounding."""
    ten = Fraction(10)
    assert _count(ten * (1 + Fraction(1, 2 * 10**9))) == 10
    assert _count(ten * (1 + Fraction(2, 10**9))) == 11


COMMANDS = get_command(app).commands


def options_of(command):
    return {option.name for option in COMMANDS[command].params}


def test_every_setting_says_what_it_is():
    for name, field in Run.model_fields.items():
        text = field.description
        assert text and text == text.strip() and not text.endswith("."), name
        assert not text[0].isupper(), name


@pytest.mark.parametrize("name", [name for name in Run.model_fields if name != "varied"])
def test_a_setting_is_a_key_a_keyword_and_an_option(name):
    signature = inspect.signature(rm.simulate)
    assert name in signature.parameters
    assert signature.parameters[name].default is None
    assert re.search(rf"^ *{name} : ", rm.simulate.__doc__, re.MULTILINE)
    assert name in options_of("run") and name in options_of("show")
    (option,) = (p for p in COMMANDS["run"].params if p.name == name)
    assert f"--{name.replace('_', '-')}" in option.opts
    described = Run.model_fields[name].description
    assert option.help.replace("\\[", "[").lower().startswith(described.lower())


def test_settings_reach_the_run_from_all_three_sides(tmp_path):
    """Each value below differs from the default, so that a setting that is dropped shows."""
    values = {"dt": 0.02, "seed": 7, "points": "sobol", "checks": False, "thin": 3}
    values["compress"] = True
    assert all(Run.model_fields[name].default != value for name, value in values.items())
    body = "[body]\nmoments = [1.0, 2.0, 3.0]\n[start]\nomega = [{ normal = [0, 1] }, 1.0, 0.0]\n"
    texts = {k: str(v).lower() if isinstance(v, bool) else repr(v) for k, v in values.items()}
    run = "\n".join(f"{k} = {text}" for k, text in texts.items())
    from_file = rm.Scene.loads(f"{body}[run]\n{run}").run
    from_python = rm.Scene.loads(body).with_run(**values).run
    assert from_file == from_python
    assert from_file != rm.Scene.loads(body).run
    flags = {True: "--{}", False: "--no-{}"}
    words = [flags.get(v, "--{}={}").format(k, v) for k, v in values.items()]
    context = COMMANDS["show"].make_context("show", ["dzhanibekov", *words])
    taken = {k: v for k, v in context.params.items() if k in values}
    assert taken == values


def test_an_unknown_keyword_is_refused_with_the_nearest():
    scene = rm.Scene.load("dzhanibekov")
    with pytest.raises(
        TypeError, match=r"simulate\(\) got .* 'tolerence'; did you mean 'tolerance'"
    ):
        rm.simulate(scene, tolerence=1e-6)


def test_types_are_without_none():
    assert set(types()) == set(Run.model_fields)
    assert not any(NoneType in get_args(kind) for kind in types().values())


def test_rows_are_the_members_unless_a_number_is_given():
    """A number of members was once ignored if a scene had one row per member."""
    omega = (np.linspace(0.1, 0.5, 5), 1.0, 0.01)
    scene = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=omega))
    quick = {"t_end": 0.1, "integrator": "exact"}
    assert rm.simulate(scene, **quick).sizes["member"] == 5
    assert rm.simulate(scene, members=2, **quick).sizes["member"] == 2
    assert rm.simulate(scene.with_run(members=3), **quick).sizes["member"] == 3
    assert rm.simulate(scene.with_run(seed=1), **quick).sizes["member"] == 5
    assert rm.simulate(scene.with_run(first=2), **quick).member.values.tolist() == [2, 3, 4]
    assert rm.simulate(scene, first=2, **quick).member.values.tolist() == [2, 3, 4]
    with pytest.raises(rm.SceneError, match="rows for only 5 members"):
        rm.simulate(scene.with_run(members=9), **quick)
