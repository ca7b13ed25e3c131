"""Hints: what people write for what rigidmc calls by another name, and what they forget."""

import re

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import nearest
from rigidmc.inputs.synonyms import NAMES
from rigidmc.mechanics.solids import SOLIDS
from rigidmc.physics.effects import EFFECTS
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables import OUTCOMES, bare_observables, monitors, saveable_names
from rigidmc.scene.derivatives import parameter_names_of_derivatives
from rigidmc.scene.library import shipped_names
from rigidmc.scene.parameters import parameter_names
from rigidmc.scene.settings import Run
from rigidmc.scene.toml.read import _value
from rigidmc.scene.varied import variables
from rigidmc.scene.vector_distributions import VECTOR_DISTRIBUTIONS
from rigidmc.views import PICTURES

BODY = rm.Body.from_moments((1.0, 2.0, 2.5))
SETTINGS = [*Run.model_fields, "threads", "output", "force"]


@pytest.mark.parametrize(
    ("word", "known", "right"),
    [
        ("sphere", SOLIDS, "ball"),  # 2/5, and not the 2/3 of a shell
        ("Sphere", SOLIDS, "ball"),
        ("hollow_sphere", SOLIDS, "shell"),
        ("cuboid", SOLIDS, "box"),
        ("disk", SOLIDS, "disc"),
        ("cylindre", SOLIDS, "cylinder"),
        ("gravitation", EFFECTS, "gravity"),
        ("Gravitation", [kind.__name__ for kind in EFFECTS.values()], "Gravity"),
        ("gravity_grad", EFFECTS, "gravity_gradient"),
        ("drag", EFFECTS, "quadratic_drag"),
        ("euler", saveable_names(), "attitude"),
        ("euler_angles", saveable_names(), "attitude"),
        ("omga", saveable_names(), "omega"),
        ("gravity", ["start.omega.1", "effects.gravity.g"], "effects.gravity.g"),
        ("grvity", ["effects.gravity.g"], "effects.gravity.g"),
        ("effects", ["effects.gravity.g"], None),
        ("euler", INTEGRATORS, None),
        ("dopri5", INTEGRATORS, "rk8"),
        ("tmax", SETTINGS, "t_end"),
        ("duration", SETTINGS, "t_end"),
        ("n", SETTINGS, "members"),
        ("time_step", SETTINGS, "dt"),
        ("tol", SETTINGS, "tolerance"),
        ("memebrs", SETTINGS, "members"),
        ("foo", shipped_names(), None),
        ("heavytop", shipped_names(), "heavy_top"),
        ("gaussian", ["normal", "uniform"], "normal"),
        ("momentum_sphere", PICTURES, "polhodes"),  # its name in 0.1.0
        ("axis_sphere", PICTURES, "trajectory"),
        ("phase_space", PICTURES, "phase_portrait"),
    ],
)
def test_the_nearest_word(word, known, right):
    assert nearest(word, known) == right


def test_every_hint_is_a_name_that_there_is():
    """A name that is renamed would leave hints behind that name nothing."""
    keys = {"mass", "centre", "radius", "height", "density", "particles", "tensor", "moments"}
    keys |= {"normal", "uniform", "common", "expon"} | {law.name for law in VECTOR_DISTRIBUTIONS}
    known = {
        *SOLIDS,
        *EFFECTS,
        *saveable_names(),
        *INTEGRATORS,
        "closed",
        *SETTINGS,
        *PICTURES,
        *keys,
    }
    assert {name for names in NAMES.values() for name in names} <= known


def test_a_missing_file_is_not_a_book(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        rm.Scene.load(tmp_path / "foo.toml")
    assert "did you mean" not in str(error.value)
    (tmp_path / "my_rotor.toml").write_text("")
    with pytest.raises(FileNotFoundError, match=r"did you mean '.*my_rotor.toml'"):
        rm.Scene.load(tmp_path / "myrotor.toml")


def test_a_scene_by_its_name_and_a_body_alone(tmp_path):
    by_name = rm.simulate("heavy_top", members=2, t_end=0.1)
    assert by_name.equals(rm.simulate(rm.Scene.load("heavy_top"), members=2, t_end=0.1))
    assert by_name.equals(rm.simulate(scene="heavy_top", members=2, t_end=0.1))
    (tmp_path / "s.toml").write_text(rm.Scene.load("heavy_top").dumps())
    assert by_name.omega.equals(rm.simulate(tmp_path / "s.toml", members=2, t_end=0.1).omega)
    settings = {"of": "p(flips >= 1)", "until": "p(flips >= 1) +- 0.1", "x": (), "y": ()}
    for function, names in (
        (rm.simulate, ()),
        (rm.simulate_until, ("until",)),
        (rm.accuracy, ()),
        (rm.stability_map, ("x", "y", "of")),
        (rm.sensitivity, ("of",)),
        (rm.basins, ("of",)),
        (rm.ftle, ()),
        (rm.lyapunov, ()),
        (rm.rare, ("of",)),
        (rm.multilevel, ("until",)),
        (rm.frequencies, ("of",)),
        (rm.precompile, ()),
        (rm.prepare, ()),
        (rm.live, ()),
        (rm.linearise, ()),
    ):
        more = {name: settings[name] for name in names}
        with pytest.raises(rm.SceneError, match=r"is a Body; .*rm.Scene\(body, start="):
            function(BODY, **more)
        with pytest.raises(rm.SceneError, match="is a int; expected a Scene, the path"):
            function(3, **more)
        with pytest.raises(FileNotFoundError, match="no shipped scene has this name"):
            function("no such scene at all", **more)


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (rm.Gravity((0, 0, -9.81)), "expected one number in m s-2"),
        (rm.Gravity("9.81"), 'expected one number in m s-2, or text such as "1.5 m/s2"'),
        (rm.BodyTorque("1 N m"), "expected 3 numbers in N m"),
    ],
)
def test_parameters_are_refused_in_the_words_of_users(effect, words):
    with pytest.raises(rm.SceneError) as error:
        rm.Scene(BODY, effect)
    assert words in str(error.value) and "@effect" not in str(error.value)


def test_keywords_that_other_programs_have():
    for word, right in (("tmax", "t_end"), ("n", "members"), ("timestep", "dt")):
        with pytest.raises(TypeError, match=f"did you mean '{right}'"):
            rm.simulate("heavy_top", **{word: 3})


def test_one_observable_alone():
    assert rm.Scene(BODY, observables=rm.Flips()).observables == (rm.Flips(),)


def test_a_dumbbell_has_its_mass_on_a_line():
    with pytest.raises(rm.SceneError, match=r"lies on a line.*give the body a thickness"):
        rm.Body.from_particles([1.0, 1.0], [[0, 0, 1], [0, 0, -1]])
    with pytest.raises(rm.SceneError, match="no mass distribution has these moments"):
        rm.Body.from_tensor(np.diag([1.0, 1.0, 3.0]))
    with pytest.raises(rm.SceneError, match="all mass lies at the fixed point"):
        rm.Body.from_particles([1.0], [[0, 0, 0]])


@pytest.mark.parametrize(("centre", "asked"), [((0, 0, 40.0), True), ((0, 0, 0.2), False)])
def test_a_centre_in_millimetres(centre, asked):
    body, start = rm.Body((1e-3, 1e-3, 5e-4), mass=0.5, centre=centre), rm.Start(omega=(0, 0, 1.0))
    scene = rm.Scene(body, rm.Gravity(9.81), start)
    with pytest.warns(rm.SceneWarning, match="centre: the body cannot exist") as found:
        rm.simulate(scene, members=2, dt=1e-3, t_end=0.01)
    assert any("in millimetres" in str(one.message) for one in found) == asked
    assert not any("4,096" in str(one.message) for one in found)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (".6", 0.6),
        ("-.5", -0.5),
        ("+.5", 0.5),
        ("1.", 1.0),
        ("2.e3", 2000.0),
        ("[.6, 1., -.5]", [0.6, 1.0, -0.5]),
        ("{normal=[0., .1]}", {"normal": [0.0, 0.1]}),
        ("'.5'", ".5"),
        ("a.toml", "a.toml"),
        (".5 s", ".5 s"),
        ("v1.0", "v1.0"),
        ("1..2", "1..2"),
        (1.62, 1.62),
        ([0.5, 1.0], [0.5, 1.0]),
    ],
)
def test_numbers_on_the_command_line(text, value):
    assert _value(text) == value


def tails(names):
    """Yield (name without its first parts, names) of parameter paths."""
    for name in names:
        parts = name.split(".")
        for k in range(1, len(parts)):
            if not "".join(parts[k:]).isdigit():
                yield ".".join(parts[k:])


def test_the_end_of_every_path_of_a_parameter_gets_the_path():
    pairs = 0
    for scene in map(rm.Scene.load, shipped_names()):
        for known in (parameter_names_of_derivatives, parameter_names, variables):
            names = known(scene.model)
            for tail in tails(names):
                assert f".{nearest(tail, names)}".endswith(f".{tail}"), tail
                pairs += 1
    assert pairs > 1000  # 1,486
    scene = rm.Scene.load("heavy_top")
    for name in ("tend", "run.t_ends", "duration", "tmax"):
        assert nearest(name, parameter_names_of_derivatives(scene.model)) == "run.t_end"
    for name in ("g", "omega", "t_end"):
        with pytest.raises(rm.RigidmcError, match="no such scene parameter"):
            rm.linearise(scene, along=(name, 0.0, 1.0))


def test_every_variable_of_a_result_names_what_to_save():
    scene = rm.Scene.load("heavy_top")
    names = saveable_names(())
    variables = [v for kind in monitors().values() for v in kind.outputs if v not in names]
    at_saves = [
        f"{name}_{end}" for name in bare_observables() for end in ("final", "thinned", "flagged")
    ]
    derived = [f"d_{name}" for name in bare_observables()]
    asked = (*variables, *at_saves, *derived, *OUTCOMES)
    assert len(asked) > 50  # 60
    for name in asked:
        with pytest.raises(rm.SceneError) as caught:
            scene.with_run(save=(name,))
        message = str(caught.value)
        assert "omit it" in message or re.search(r"save '(\w+)'", message)[1] in names, name


def test_an_observable_is_not_a_variable_of_a_member():
    for name in ("nutation", "passage", "energy", "omega"):
        with pytest.raises(rm.RigidmcError, match=f"{name} is an observable: use one of its"):
            rm.gradient("heavy_top", f"mean({name})", "start.omega.3")
    for name in ("flips", "flip_first", "nutation_max"):
        with pytest.raises(rm.RigidmcError, match="has one value per member"):
            rm.Scene.load("heavy_top").with_run(keep={name: "final"})
