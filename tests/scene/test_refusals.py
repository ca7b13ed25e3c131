"""What calls and scene files refuse: one short line with the place, the mistake and the cure."""

import numpy as np
import pytest

import rigidmc as rm

ONE = rm.Body((1, 2, 2.5))
TENSOR = [[10.0, 0.4, -0.3], [0.4, 12.0, 0.2], [-0.3, 0.2, 8.0]]
LAW = rm.UncertainInertia(TENSOR, 1e-4 * np.eye(6), (0.1, 0, 0))


def tensor(tensor=TENSOR, **options):
    return rm.Body.from_tensor(tensor, **{"mass": 2.0, "centre": (0.1, 0.0, 0.0)} | options)


def run(body, **run):
    rm.simulate(rm.Scene(body), **run)


def mesh(**options):
    trimesh = pytest.importorskip("trimesh")
    rm.Body.from_mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.7), **options)


CALLS = [  # (call, words of the message)
    (lambda: rm.Body.from_moments((1, 2, 9)), "triangle inequality"),
    (lambda: rm.Body.from_moments((-1, 2, 2)), "positive"),
    (lambda: rm.Body.from_moments((1, 2)), "3 components"),
    (lambda: rm.Body.from_moments(np.array([[1, 2, 3], [1, 1, 9.0]])), "row 1"),
    (lambda: rm.Body.from_moments((1, 2, 3), mass=0), "mass must be positive"),
    (lambda: rm.Body.from_tensor([[1, 0, 0], [0, 1, 0.5], [0, 0, 1]]), "symmetric"),
    (lambda: rm.Body.from_tensor(np.eye(2)), "3x3"),
    (lambda: rm.Body.from_tensor([[rm.normal(1, 0.1), 0, 0]] * 3), "not distributions or text"),
    (lambda: rm.Body.from_particles([1, 1], [(0, 0, 1)]), "shape"),
    (lambda: rm.Body.from_particles([0, 0], [(0, 0, 1), (1, 0, 0)]), "some mass positive"),
    (lambda: rm.Body.from_particles([1, 1], [(0, 0, 1), (0, 0, 2)]), "positive"),
    (lambda: rm.Body.cylinder(1, -1, 1), "positive"),
    (lambda: rm.Body.from_moments((rm.uniform(1, 2), 2, 2)).with_pivot((1, 0, 0)), "plain numbers"),
    (lambda: rm.Start(), "either omega or momentum"),
    (lambda: rm.Start(omega=(0, 0, 1), momentum=(0, 0, 1)), "either omega or momentum"),
    (lambda: rm.Start(omega=(0, 0)), "3 components"),
    (lambda: rm.Start(omega="fast"), "3 components"),
    (lambda: rm.Start(omega=(0, 0, float("nan"))), "finite"),
    (lambda: rm.Start(omega=(0, True, 0)), "finite number"),
    (lambda: rm.Start(omega=np.array([[0, 0, 1], [0, np.inf, 1]])), "row 1"),
    (lambda: rm.Start(omega=(0, 0, 1), attitude=(0, 0, 0, 0)), "nonzero"),
    (lambda: rm.Start(omega=(0, 0, 1), attitude="uniformly"), "did you mean 'uniform'"),
    (lambda: rm.Start(omega=(0, 0, 1), attitude=np.diag([1, 1, -1])), "mirror"),
    (lambda: rm.Start(omega=(0, 0, 1), attitude=np.diag([1, 1, 2])), "differs from 1 by 3"),
    (lambda: rm.Start(omega=(0, 0, 1), attitude=(0.1, 0.2)), "4 components"),
    (lambda: rm.normal(0, -1), "standard deviation > 0"),
    (lambda: rm.uniform(2, 1), "low < high"),
    (lambda: rm.distribution("gama", a=1), "did you mean 'gamma'"),
    (lambda: rm.distribution("gamma"), "a is missing"),
    (lambda: rm.distribution("gamma", a=-1.0), "domain"),
    (lambda: rm.distribution("norm", mean=1.0), "loc, scale"),
    (lambda: rm.normal(0, 1).between(1, 1), "low < high"),
    (lambda: rm.normal(0, 1).between(float("nan"), 1), "low < high"),
    (lambda: rm.uniform(0, 1).between(2, 3), "no numbers between"),
    (lambda: rm.distribution("gamma", a=1.0).between(-2, -1), "no numbers between"),
    (lambda: rm.normal(0, 1).between(-1, 1).between(2, 3), "low < high"),
    (lambda: rm.mixture((1.0, rm.normal(0, 1))), "two or more components"),
    (lambda: rm.mixture((1.0, rm.common(0, 1)), (1.0, rm.normal(0, 1))), "two or more components"),
    (lambda: rm.common(1.0), "not all of a_1"),
    (lambda: rm.common(1.0, 0.0), "not all of a_1"),
    (lambda: rm.common(1.0, 0.1).between(0, 1), "has no bounds"),
    (lambda: rm.mixture((1.0, rm.normal(0, 1)), (0.0, rm.normal(0, 1))), "weight > 0"),
    (lambda: rm.mixture((1.0, rm.normal(0, 1)), (1.0, 3.0)), "and a distribution"),
    (
        lambda: rm.mixture((1, rm.normal(0, 1)), (1, rm.normal(2, 1))).between(0, 1),
        "truncate the components",
    ),
    (lambda: rm.Scene(ONE, effects=("gravity",)), "expected an effect"),
    (lambda: rm.Scene(ONE, effects=(rm.Gravity,)), "give its parameters"),
    (lambda: rm.Scene(ONE, effects=(rm.ViscousDamping(-1.0),)), "between 0 and inf"),
    (lambda: rm.Scene(ONE, effects=(rm.Gravity(float("nan")),)), "finite"),
    (lambda: rm.Scene((1, 2, 3)), "expected a Body"),
    (lambda: rm.Scene(ONE, start=(0, 0, 1)), "expected a Start"),
    (
        lambda: rm.Scene(ONE, (rm.Gravity(np.ones(3)),), rm.Start(omega=np.ones((4, 3)))),
        "same number of rows",
    ),
    (
        lambda: rm.simulate(rm.Scene(ONE, start=rm.Start(omega=np.ones((4, 3)))), members=5),
        "rows for only 4 members",
    ),
    (lambda: rm.simulate(rm.Scene(ONE), threads=0), "at least 1"),
    (lambda: rm.simulate(rm.Scene(ONE), members=range(5, 5)), "range"),
    (lambda: rm.simulate(rm.Scene(ONE), dt="small"), "finite number"),
    (lambda: mesh(solid="shell", density=1.0), "has no volume: give its mass"),
    (lambda: mesh(solid="hul", mass=1.0), "did you mean 'hull'"),
    (lambda: mesh(solid="hull"), "either density or mass"),
    (lambda: rm.Body.from_moments((1, 2, 2.5), centre=(0, 0, 1), about="centre"), "[body] mass"),
    (lambda: rm.Body.from_tensor(TENSOR, centre=(0, 0, 1), about="centre"), "[body] mass"),
    (lambda: ONE.with_pivot((0, 0, 1)), "[body] mass"),
    (lambda: rm.Body((1, 2, 2.5), centre=(0, 0, 1)).with_pivot_at_centre(), "[body] mass"),
    (lambda: ONE.join(rm.Body.box(1.0, (1, 2, 3))), "[body] mass"),
    (
        lambda: rm.Body.from_moments((1, 2, rm.uniform(2, 2.5)), 1.0, (0, 0, 1), about="centre"),
        "must be plain numbers with about",
    ),
    (lambda: tensor(about="center"), "about = 'center' ... did you mean 'centre'"),
    (lambda: tensor(about=None), "no such point"),
    (
        lambda: tensor(about="centre", mass=rm.uniform(1, 2)),
        "mass ... plain numbers ... UncertainInertia",
    ),
    (
        lambda: tensor(about="centre", centre=(0, 0, rm.normal(0, 1))),
        "centre: must be plain numbers",
    ),
    (lambda: tensor(LAW, about="centre"), "omit this"),
]


@pytest.mark.parametrize(("call", "words"), CALLS)
def test_calls(call, words):
    with pytest.raises((rm.SceneError, rm.OptionError)) as error:
        call()
    check(error.value, words)


def check(error, words):
    """`...` stands for anything between words."""
    assert all(word in str(error) for word in words.split(" ... ")), error
    assert "\n" not in str(error) and len(str(error)) < 700


BODY = "[body]\nmoments = [1.0, 2.0, 2.5]\n"
SIX, MINUS = np.eye(6).tolist(), (-np.eye(6)).tolist()
START = "[start]\nomega = [0, 0, 1]\n"
ORBIT = "[effects.gravity_gradient]\nmu = 3.986e14\ndistance = 7e6\n"
TEXTS = {  # {the rest of a scene file: {text: words of the message}}
    BODY + "[start]\n{}\n": {
        "omega = { cone = { axis = 4, size = 1.0, angle = 0.1 } }": "axis",
        "omega = { cone = { axis = 2, size = 1.0 } }": "[start.omega.cone] angle: is missing",
        "omega = { cone = { axis = 2, size = 1.0, angel = 0.1 } }": "cone] angel: ... 'angle'",
        "omega = { cone = 3.0 }": "[start.omega] cone = 3.0: expected a table",
        "omega = { con = { axis = 2, size = 1.0, angle = 0.1 } }": "con",
        "omega = { shell = 1.0 }": "shell",
        "omega = { correlated = { mean = [0.0, 1.0, 0.0], covariance = [[1, 2, 0], [2, 1, 0], "
        "[0, 0, 1]] } }": "positive definite",
        'omega = { correlated = { mean = [0, 0, 0], covariance = [[1, "a"], [2]] } }': "symmetric",
        "omega = { spere = 2.0 }": "did you mean 'sphere'",
        "omega = { shell = { energy = 1.0 } }": "'shell' is a distribution of momentum",
        "momentum = { gibs = 0.1 }": "did you mean 'gibbs'",
        "momentum = { gibbs = -0.1 }": "0 or more",
        "omega = { cone = { axis = 1, size = -1.0, angle = 0.1 } }": "0 or more",
        "momentum = { shell = { energy = 1.0, direction = [0.0, 0.0, 0.0] } }": "direction",
        "omega = [{ grid = [1.0, 0.0, 5] }, 1.0, 0.0]": "low < high",
        "omega = [{ grid = [0.0, 1.0, 0] }, 1.0, 0.0]": "at least 1",
        "omega = [{ grid = [0.0, 1.0, 5], log = true }, 1.0, 0.0]": "above 0",
    },
    BODY + "[start]\nomega = [{}, 1, 0]\n": {
        "{ normal = [2, 0.1], between = [3] }": "one distribution with bounds",
        "{ between = [3, 4] }": "one distribution with bounds",
        "{ normal = [2, 0.1], betwen = [3, 4] }": "did you mean 'between'",
        "{ normal = [2, 0.1], between = [4, 3] }": "low < high",
        "{ grid = [0, 1, 3], between = [0, 1] }": "between",
        "{ mixture = [{ normal = [0, 1] }] }": "mixture = ",
        "{ mixture = [{ weight = 1, normal = [0, 1] }] }": "two or more",
        "{ mixture = [{ weight = 1, normal = [0, 1] }, { weight = 1, grid = [0, 1, 3] }] }": "dist",
    },
    "[body]\ntensor = {{ uncertain_inertia = {{ {} }} }}\n" + START: {
        "mean = [[2, 0, 0], [0, 2, 0], [0, 0, 3]]": "covariance: is missing",
        "mean = [2, 2, 3], covariance = [[1]]": "mean ... 3x3",
        "mean = [[2, 0, 0], [0, 2, 0], [0, 0, 3]], covariance = [[1]]": "6x6 or 9x9 or 10x10",
        f"mean = [[2, 0, 0], [0, 2, 0], [0, 0, 9]], covariance = {SIX}": "no body",
        f"mean = [[2, 0, 0], [0, 2, 0], [0, 0, 3]], covariance = {MINUS}": "negative eigenvalues",
    },
    BODY + "[[body.shape]]\n{}\n" + START: {
        'solid = "cylindre"\nradius = 1.0': "did you mean 'cylinder'",
        'solid = "ball"': "radius",
        'solid = "ball"\nradius = -1.0': "must be positive",
        'solid = "ball"\nradius = nan': "finite",
        'solid = "ball"\nradius = "big"': "finite",
        'solid = "ball"\nradius = 1.0\nheight = 2.0': "height",
        'solid = "ball"\nradius = 1.0\nat = [0.0, 1.0]': "at",
        'solid = "ball"\nradius = 1.0\nturned = [0.0, 0.0, 0.0, 0.0]': "nonzero",
        'solid = "ball"\nradius = 1.0\nhole = 1': "true or false",
        'solid = "box"\nsize = [1.0, 2.0]': "3",
        "radius = 1.0": "solid",
        'solid = "mesh"\ncorners = [[0.0, 0.0, 0.0]]\nfaces = [[0, 1, 2]]': "corners",
        'solid = "particles"\nmasses = [1.0]\npositions = [[0,0,0],[1,0,0]]': "each mass",
    },
    BODY + '[[body.shape]]\nsolid = "mesh_file"\n{}\n' + START: {
        'file = 3\nsha256 = "A"\nscale = 1.0': "the name of a mesh file",
        f'file = "/etc/passwd"\nsha256 = "{"a" * 64}"\nscale = 1.0': "the name of a mesh file",
        'file = "a.stl"\nsha256 = "A"\nscale = 1.0': "64 hexadecimal digits",
        f'file = "a.stl"\nsha256 = "{"a" * 64}"\nscale = 0.0': "must be positive",
        f'file = "a.stl"\nsha256 = "{"a" * 64}"': "is missing",
    },
    "[body]\ntensor = [[10.0, 0.4, -0.3], [0.4, 12.0, 0.2], [-0.3, 0.2, 8.0]]\n{}\n" + START: {
        'about = "middle"': "no such point; known: pivot, centre",
        "about = 3": "about = 3",
        'about = "centre"\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]': "give the tensor instead",
    },
    '[body]\nabout = "centre"\n{}\n' + START: {
        "cylinder = { mass = 1.0, radius = 0.1, height = 0.2 }": "about"
    },
    BODY + "{}\n" + START: {
        '[[body.shape]]\nsolid = "ball"\nradius = 1.0\n' * 201: "more than 200",
        'shape = "cube"': "expected tables",
    },
    "body.moments = [1.0, 2.0, 2.5]\n{}": {
        'start.omega = ["3 mm", 0, 0]': "omega = '3 mm': is in rad/s, or deg/s, rpm, rev/s; mm is",
        'start.omega = { value = [1, 2, 3], unit = "kg" }': "kg is a mass",
        'start.omega = { value = ["1 rpm", 2, 3], unit = "rpm" }': "one number has one unit",
        'start.omega = { value = ["one", 2, 3], unit = "rpm" }': "expected numbers",
        'start.omega = [{ value = true, unit = "rpm" }, 2, 3]': "expected numbers",
        "start.omega = { value = [1, 2, 3] }": "expected a unit beside the value",
        'start.omega = { unit = "rpm" }': "expected { value = 10.0",
        'start.omega = { value = [1, 2, 3], unit = "rpm", x = 1 }': "no such key; known: value",
        'start.omega = "10 deg/s"': "expected 3 components",
        'start.omega = ["10 Hz", 0, 0]': "rev/s",
        'start.omega = ["10 1/s", 0, 0]': "1/s is a rate",
        'start.omega = [{ vonmises = { kappa = 2 }, unit = "deg/s" }, 0, 0]': "period of 2 pi",
        'start.omega = ["9.81", 0, 0]': "expected a finite number",
        'start.omega = ["1e400 deg/s", 0, 0]': "finite",
        'start.omega = [0, 0, 1]\nstart.attitude = { value = [1, 0, 0, 0], unit = "deg" }': "Euler",
        'start.omega = [0, 0, 1]\neffects.gravity.g = "9.81"': 'or text such as "1.5 m/s2"',
        'start.omega = [0, 0, 1]\neffects.gravity.g = "9.81 m/s"': "(did you mean 'm/s2'?)",
        'start.omega = [0, 0, 1]\neffects.gravity.g = "9.81 furlong"': "'furlong' is not a unit",
        'start.omega = [0, 0, 1]\nrun.t_end = { value = 3, unit = "m" }': "m is a length",
        'start.omega = [0, 0, 1]\nrun.turn = "5 mm"': "mm is a length",
        'start.omega = [0, 0, 1]\nobservables.passage = { axis = "3 mm", angle = 1 }': "1, 2 or 3",
        "start.omega = [0, 0, 1]\nobservables.passage = { axis = 3, angle = 30 }": '"30 deg"',
        'start.momentum = { gibbs = "300 K" }': "kT is an energy",
    },
    "body.moments = [1.0, 2.0, 2.5]\nstart.omega = {}": {
        '{ value = [1, 2, 3], units = "deg/s" }': "(did you mean 'unit'?)",
        '[{ normal = [1, 2], units = "deg/s" }, 0, 0]': "(did you mean 'unit'?)",
        "[{ degrees = 30 }, 0, 0]": 'unit = "deg" }',
        '[{ normal = [1e308, 1], unit = "rev/s" }, 0, 0]': "too large or too small",
        '[{ normal = [1, 1e-320], unit = "rev/h" }, 0, 0]': "too large or too small",
        '[{ grid = [0, 1e308, 3], unit = "rev/s" }, 0, 0]': "too large or too small",
        '{ value = [1e308, 0, 0], unit = "rev/s" }': "finite",
    },
    ORBIT + BODY + "[start]\nomega = [0.0, 0.1, 1.0]\nattitude = {}": {
        "{ fisher = { attitude = [1, 0, 0, 0], kappa = 1e300 } }": "between 0 and 1e12",
        '{ euler = "331", angles = [1, 2, 3] }': ("start.attitude.euler", "neighbours different"),
        '{ euler = "zyx", angles = [1, 2, 3] }': ("start.attitude.euler", "lower case"),
        '{ euler = "321" }': ("start.attitude.angles", "missing"),
        '{ euler = "321", angles = [1, 2] }': ("start.attitude.angles", "3 components"),
        '{ euler = "321", angles = [1, 2, 3], unit = "degree" }': ("start.attitude.unit", "deg"),
        '{ euler = "321", angles = [1, 2, 3], units = "deg" }': ("start.attitude.units", "'unit'"),
        '{ euler = "321", angels = [1, 2, 3] }': ("start.attitude.angels", "'angles'"),
        '{ eular = "321", angles = [1, 2, 3] }': ("start.attitude.eular", "'euler'"),
        "{ angles = [1, 2, 3] }": ("start.attitude", "give one of these keys: euler"),
        '{ euler = "321", angles = [1, 2, 3], order = "xyzw" }': (
            "start.attitude.order",
            "no such key",
        ),
        '{ quaternion = [0, 0, 0, 1], order = "wxzy" }': ("start.attitude.order", "xyzw"),
        '{ quaternion = [0, 0, 0, 1], unit = "deg" }': ("start.attitude.unit", "no such key"),
        "{ quaternion = [0, 0, 1] }": ("start.attitude.quaternion", "4 components"),
        '{ quaternion = [0, 0, 0, 0], order = "xyzw" }': ("start.attitude", "nonzero"),
        "{ matrix = [1, 2, 3] }": ("start.attitude.matrix", "3x3"),
        "{ matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] }": ("start.attitude", "mirror"),
        "{ matrix = [[1, 0], [0, 1, 0], [0, 0, 1]] }": ("start.attitude.matrix", "3x3"),
        '{ euler = "321", quaternion = [0, 0, 0, 1], angles = [1, 2, 3] }': (
            "start.attitude",
            "one",
        ),
        '{ euler = "321", angles = ["a", 2, 3] }': ("start.attitude.angles", "finite number"),
        '{ euler = "321", angles = [nan, 2, 3] }': ("start.attitude.angles", "finite number"),
        '{ euler = ["3", "2", "1"], angles = [1, 2, 3] }': ("start.attitude.euler", "one of"),
        '{ relative_to = "orbit" }': ("start.attitude", "give one of"),
        '{ matrix = "a", relative_to = "orbit" }': ("start.attitude.matrix", "3x3"),
        '{ euler = "321", angles = [1, 2, 3], relative_to = "orbt" }': (
            "start.attitude.relative_to",
            "'orbit'",
        ),
    },
}


@pytest.mark.parametrize(
    ("frame", "text"), [(frame, text) for frame in TEXTS for text in TEXTS[frame]]
)
def test_scene_files(frame, text):
    words, at = TEXTS[frame][text], None
    if isinstance(words, tuple):
        at, words = words
    with pytest.raises(rm.SceneError) as error:
        rm.Scene.loads(frame.format(text), "top.toml")
    check(error.value, words)
    assert "omega" in str(error.value) or "omega = [{}" not in frame
    assert str(error.value).startswith("top.toml: ") and at in (None, error.value.at)
