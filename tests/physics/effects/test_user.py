"""A user's own effect: checked before compilation, then run like the built-in ones.

The message of a failed check names the class, the line and the rule.
"""

import linecache
import math
import sys
import textwrap
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.inspection import why_scalar
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.dynamics.so3 import vertical
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.planning.tolerance import choose
from rigidmc.protocols import cross, dot, effect, scale
from rigidmc.studies.stress.trust import trust
from tests.tools.commands import invoke
from tests.tools.kernels import one_step, prepare
from tests.tools.scenes import UNSYMMETRIC

START = rm.Start(omega=(0.1, 1.0, 0.2), attitude="uniform")


def scene(effect):
    return rm.Scene(UNSYMMETRIC, (effect,), START).with_run(
        dt=0.01, t_end=1.0, members=64, save=("momentum", "attitude")
    )


class Weight(NamedTuple):
    """Gravity, written again."""

    g: float

    def torque(self, body, q):
        return cross(vertical(q), scale(self.g, (body.p1, body.p2, body.p3)))

    def energy(self, body, q):
        return self.g * dot((body.p1, body.p2, body.p3), vertical(q))


class Upside(Weight):
    def torque(self, body, q):
        return scale(-1.0, Weight(self.g).torque(body, q))


def own(name, arguments, body, more=""):
    """An effect with one method, or more, from its text, whose lines messages quote."""
    text = f"class {name}(NamedTuple):\n    size: float\n    def torque(self, {arguments}):\n"
    text += textwrap.indent(f"{body}\n", 8 * " ") + textwrap.indent(more, 4 * " ")
    file = f"<effect {name}>"
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    names = {"__name__": __name__, "NamedTuple": NamedTuple, "math": math, "np": np}
    exec(compile(text, file, "exec"), names)
    return names[name](1.0)


HALVING = own("Halving", "l", """
x = self.size * l[0]
while abs(x) > 1e-3:
    x = 0.5 * x
return x, 0.0, 0.0""")  # fmt: skip
SHORT = own("Short", "l", "return self.size, 0.0")
ASKS = own("Asks", "speed", "return speed, 0.0, 0.0")
COUNTED = """
x = l[1]
for _ in range(int(l[0])):
    x = 0.5 * x
return x, 0.0, 0.0"""


SINE = own("Sine", "l", "return self.size * math.sin(l[0]), 0.0, 0.0")


class Gamma(NamedTuple):
    size: float

    def torque(self, l):
        return self.size * math.gamma(1.5 + 0.1 * math.sin(l[0])), 0.0, 0.0


@pytest.mark.parametrize(("effect", "words"), [
    (Upside(9.81), r"Upside.torque.*does not follow from its energy"),
    (own("Raises", "l", "return math.sqrt(-1.0 - l[0] * l[0]), 0.0, 0.0"),
     r"Raises.torque.*line \d+: return math.sqrt.*ValueError"),
    (own("Array", "l", "return np.array([self.size, 0.0, 0.0])"),
     r"Array.torque.*returns ndarray, expected a tuple of 3 numbers.*no arrays"),
    (SHORT, r"Short.torque.*expected a tuple of 3 numbers"),
    (ASKS, r"Asks.torque.*unknown argument 'speed'; it may name body, t, q, l"),
    (own("Infinite", "l", "return 1e308 * 10.0 * self.size, 0.0, 0.0"),
     r"Infinite.torque.*not finite"),
    (own("Lists", "l", "return float(sum([x > 0.0 for x in l])), 0.0, 0.0"),
     r"Lists.torque.*line \d+: .*cannot be compiled: sum; write the terms out"),
    (HALVING, r"Halving.torque.*line \d+: while abs\(x\) > 1e-3:: a loop whose length"),
    (own("Counting", "l", COUNTED),
     r"Counting.torque.*line \d+: for _ in range\(int\(l\[0\]\)\):: a loop whose"),
    (own("Words", "l", "return math.comb(3, 2) * l[0], 0.0, 0.0"),
     r"Words.*cannot be compiled.*no calls except of math"),
])  # fmt: skip
def test_effects_that_a_kernel_cannot_use_are_refused(effect, words):
    with pytest.raises(rm.SceneError, match=words):
        rm.simulate(scene(effect))


PAIR = "def energy(self, q):\n    return 0.0, 0.0\n"


@pytest.mark.parametrize(("effect", "words"), [
    (SHORT, r"Short.torque.*expected a tuple of 3 numbers"),
    (own("NoReturn", "q", "self.size * q[0]"),
     r"NoReturn.torque: returns None, expected a tuple of 3 numbers"),
    (ASKS, r"Asks.torque.*unknown argument 'speed'; it may name body, t, q, l"),
    (own("Divides", "q", "return 1 / 0, 0.0, 0.0"),
     r"Divides.torque: .*line \d+: return 1 / 0.*ZeroDivisionError"),
    (own("Pair", "q", "return 0.0, 0.0, 0.0", PAIR),
     r"Pair.energy: returns \(0.0, 0.0\), expected a number"),
])  # fmt: skip
def test_a_custom_effect_is_checked_before_anything_evaluates_it(effect, words):
    """Beside gravity, saves of few members and steady motions follow from the torques."""
    beside = rm.Scene(UNSYMMETRIC, (rm.Gravity(9.81), effect), rm.Start(omega=(0.1, 1.0, 0.2)))
    for use in (
        lambda: rm.simulate(beside, members=1, dt=0.01, t_end=1.0),
        lambda: rm.simulate(beside, members=1, dt=0.01, t_end=1.0, every="50/turn"),
        lambda: rm.simulate(beside, members=1, t_end=1.0, tolerance=1e-4),
        lambda: rm.linearise(beside),
    ):
        with pytest.raises(rm.PartError, match=words):
            use()


FREE = {"torque": lambda self: (0.0, 0.0, 0.0)}


def named(methods, **stated):
    """A class of effects with the parameter k, as a user may write it."""
    kind = type("Mine", (NamedTuple("Mine", [("k", float)]),), dict(methods))
    return effect(**stated)(kind) if stated else effect(kind)


@pytest.mark.parametrize(("one", "words"), [
    (named({"torqe": FREE["torque"]})(1.0),
     r"Mine: has no method `torque`, .*it has `torqe`: did you mean `torque`\?"),
    (named({})(1.0), r"Mine: has no method `torque`, .*`add_noise`\)$"),
    (type("Mine", (), FREE)(), r"Mine: is not a NamedTuple, .*write class Mine\(NamedTuple\)"),
    (named(FREE), r"Mine: is a class: give its parameters, as in Mine\(k\)"),
    (named(FREE, units={"kk": "N m"})(1.0), r"Mine.units: names 'kk', .*did you mean 'k'"),
    (named(FREE, shapes={"size": 3})(1.0), r"Mine.shapes: names 'size', which is not a parameter"),
    (named(FREE, units={"k": "Newton"})(1.0), r"Mine.units: .*'Newton' of k: .*is not a unit.*'N'"),
])  # fmt: skip
def test_a_class_that_is_not_an_effect_names_its_mistake(one, words):
    for effects in (one, (rm.Gravity(9.81), one)):
        with pytest.raises(rm.PartError, match=words):
            rm.Scene(UNSYMMETRIC, effects)
    rm.Scene(UNSYMMETRIC, named(FREE)(1.0))  # @effect without parentheses states no facts
    with pytest.raises(TypeError, match=r"no such fact 'unit'.*did you mean 'units'"):
        effect(unit={"k": "N m"})


def test_a_misspelt_method_in_a_scene_file_is_one_message(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from typing import NamedTuple\n\n\nclass Push(NamedTuple):\n    k: float\n\n"
        "    def torqe(self):\n        return 0.0, 0.0, self.k\n"
    )
    (tmp_path / "scene.toml").write_text(
        "[body]\nmoments = [1, 2, 2.5]\n[start]\nomega = [0, 1, 0]\n"
        '[effects.push]\nmodule = "mine.py"\nk = 1.0\n'
    )
    done = invoke("check", tmp_path / "scene.toml", "--allow-code")
    assert done.exit_code == 3 and "it has `torqe`: did you mean `torque`?" in done.stderr


FIVE = own(
    "Five",
    "l",
    """
x = self.size
for _ in range(5):
    x = 0.5 * x * x + l[1]
return (x, 0.0, 0.0) if l[0] > 0.3 else (0.0, x, 0.0)""",
)


class Switch(NamedTuple):
    size: float

    def torque(self, l):
        if l[0] > 0.3:
            return -self.size, 0.0, 0.0
        return self.size, 0.0, self.size * l[1]


class Wall(NamedTuple):
    """A torque that works for any vector, and a flow of its own that branches."""

    size: float

    def torque(self, l):
        return -self.size * l[0], 0.0, 0.0

    def kick(self, h, l):
        if l[0] > 0.3:
            return l[0] * (1.0 - self.size * h), l[1], l[2]
        return l[0] / (1.0 + self.size * h), l[1], l[2]


def test_a_message_says_whether_an_effect_is_packed_and_why_not():
    assert why_scalar(SINE) == why_scalar(Weight(9.81)) == ""
    for one in (FIVE, Gamma(1.0), HALVING, Switch(1.0), Wall(1.0)):
        assert "takes one number at a time" in why_scalar(one)


@pytest.mark.slow
def test_studies_take_an_effect_that_runs_one_member_at_a_time(monkeypatch):
    """Each of them makes programs of its own."""
    # one contender tells as much as six
    monkeypatch.setattr(choose, "contenders", lambda *_: ["rk4"])
    branching = scene(Switch(0.01)).with_run(t_end=0.2, dt=0.05, members=32, save=("omega",))
    with pytest.warns(rm.SceneWarning, match="members are not vectorized"):
        chosen = rm.simulate(branching, tolerance=1e-3)
    assert chosen.attrs["tolerance"] == 1e-3
    rows = rm.accuracy(branching, integrators=("rk4",), members=8)
    assert rows.error_state_median.min() < 1e-10  # measured 3e-14
    assert trust(branching, quick=True).attrs["digits"] >= 10  # measured 12


FILE = """
from typing import NamedTuple
print("code of the user's runs")

class Vane(NamedTuple):
    size: float
    speed: float = 1.0

    def torque(self, body, l):
        return self.size * (self.speed - body.i1 * l[0]), -self.size * body.i2 * l[1], 0.0
"""
TABLES = """
[body]
moments = [1.0, 1.4, 2.0]
[start]
omega = [0.1, 1.0, 0.2]
[effects.Vane]
module = "vane.py"
size = 0.3
[run]
members = 64
save = ["momentum"]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "vane.py").write_text(FILE)
    (tmp_path / "scene.toml").write_text(TABLES)
    return tmp_path


def test_code_from_a_scene_file_runs_only_where_it_is_allowed(folder, capfd):
    path = str(folder / "scene.toml")
    words = r"\[effects.Vane\] module = 'vane.py': is code, and scene files execute nothing.*--all"
    with pytest.raises(rm.SceneError, match=f"{words}ow-code"):
        rm.Scene.load(path)
    for command in ("run", "show", "check", "stress", "accuracy"):
        assert invoke(command, path).exit_code == 3
    assert "user's" not in capfd.readouterr().out
    scene = rm.Scene.load(path, allow_code=True)
    assert "user's" in capfd.readouterr().out
    output = str(folder / "a.nc")
    ds = rm.simulate(scene, t_end=1.0, output=output)
    assert np.abs(ds.momentum - rm.simulate(scene, t_end=1.0).momentum).max() == 0.0
    assert np.ptp(ds.momentum.values[-1, 0]) == 0.0
    assert float(ds.momentum[-1, 0, 0]) > 0.2
    with pytest.raises(rm.SceneError, match="is code"):
        rm.Scene.load(output)
    assert rm.Scene.load(output, allow_code=True).effects == scene.effects


@pytest.mark.parametrize(("old", "new", "words"), [
    ("vane.py", "vain.py", "there is no file .*vain.py"),
    ("vane.py", "scene.toml", "is not a Python file"),
    ("effects.Vane", "effects.Vain",
     r"has no class Vain; it has Vane \(did you mean 'Vane'\?\)"),
    ("size =", "sice =",
     r"\[effects.Vane\] sice: no such key; known: size, speed, module \(did you mean 'size'"),
    ('module = "vane.py"\n', "",
    r"\[effects\] Vane: no such effect; known: gravity.*a custom effect needs module"),
    ('"vane.py"', '"bad.py"',
    "bad.py.*raises NameError \\(line 1\\): name 'nothing' is not defined"),
])  # fmt: skip
def test_bad_references_to_code(folder, old, new, words):
    (folder / "bad.py").write_text("nothing()")
    (folder / "scene.toml").write_text(TABLES.replace(old, new))
    with pytest.raises(rm.SceneError, match=words):
        rm.Scene.load(str(folder / "scene.toml"), allow_code=True)


def test_a_users_effect_runs_like_a_built_in_one():
    own, known = rm.simulate(scene(Weight(9.81))), rm.simulate(scene(rm.Gravity(9.81)))
    assert np.abs(own.momentum - known.momentum).max() < 1e-12
    assert own.energy_drift_max.attrs["conserved"] == "yes"


@pytest.mark.parametrize(
    ("kind", "integrator"),
    # Gamma, too, takes one number at a time, in the same code as Switch
    [pytest.param(Gamma, "rk4", marks=pytest.mark.slow), (Switch, "rk4"), (Wall, "strang")],
)
def test_an_effect_that_takes_one_number_at_a_time_runs(kind, integrator):
    words = f"{kind.__name__}.*takes one number at a time.*members are not vectorized"
    with pytest.warns(rm.SceneWarning, match=words):
        alone = rm.simulate(scene(kind(0.1)), integrator=integrator).isel(member=0)
    q, l = (tuple(alone[name].values[0].tolist()) for name in ("attitude", "momentum"))
    body, effects = MassProperties.of((1.0, 1.4, 2.0), (0.1, 0.2, 0.3)), (kind(0.1),)
    made = prepare(INTEGRATORS[integrator], 0.1, effects)
    for i in range(100):
        q, l = one_step(made, body, effects, 0.01 * i, 0.01, q, l)
    assert np.abs(alone.momentum.values[-1] - l).max() < 1e-13  # measured 1.2e-14


class Analysis(NamedTuple):
    """A torque of many functions of the library."""

    size: float

    def torque(self, l):
        x, y, z = l
        first = math.exp(-x) + math.log(2.0 + y * y) + math.sin(z) * math.cos(x)
        second = math.tanh(y) + math.atan2(x, 2.0 + z) + math.hypot(x, y) + math.expm1(0.1 * x)
        third = math.pow(2.0 + z * z, 0.3) + math.sinh(0.5 * y) + math.tan(0.3 * x)
        return scale(self.size, (first, second, third))


@pytest.mark.slow
def test_functions_of_the_library_in_float32():
    """These functions use the bits of float64; the result is then rounded."""
    double, single = (
        rm.simulate(scene(Analysis(0.3)), dtype=dtype) for dtype in ("float64", "float32")
    )
    error = np.abs(double.momentum - single.momentum).max()
    assert 1e-9 < error < 3e-7  # measured 3.4e-8, of 2.5: and it is not float64


def test_a_tuple_without_its_length_is_told_how_to_give_it():
    with pytest.raises(rm.SceneError, match=r"g = .*@effect\(shapes=\{\"g\": 3\}\)"):
        scene(Weight((1.0, 2.0, 3.0)))


OWN = """
from typing import NamedTuple

import helper
from helper import along

class Hum(NamedTuple):
    noise: float

    def torque(self, l):
        return along(self.noise)

class Tug(NamedTuple):
    size: float

    def torque(self, l):
        return helper.along(helper.scaled(self.size))
"""
HELPER = """
def scaled(x):
    return FACTOR * x

def along(x):
    return (x, 0.0, 0.0)
"""
BOTH = """
[body]
moments = [1.0, 1.4, 2.0]
[effects.Hum]
module = "own.py"
noise = 0.5
[effects.Tug]
module = "own.py"
size = 0.25
[start]
omega = [0.1, 1.0, 0.2]
"""


def test_a_field_named_noise_and_helpers_in_another_file(tmp_path):
    """Files of the same name in two folders are two files, and hide no library."""
    for factor in (2.0, 4.0):
        folder = tmp_path / str(factor)
        folder.mkdir()
        (folder / "own.py").write_text(OWN)
        (folder / "math.py").write_text("raise RuntimeError('hides a library')")
        (folder / "helper.py").write_text("import math\n" + HELPER.replace("FACTOR", str(factor)))
        (folder / "s.toml").write_text(BOTH)
        own = rm.Scene.load(folder / "s.toml", allow_code=True)
        torque = rm.BodyTorque((0.5 + factor * 0.25, 0.0, 0.0))
        shipped = rm.Scene(own.body, torque, own.start)
        run = {"integrator": "rk4", "dt": 0.01, "t_end": 1.0, "members": 2}
        ends = [rm.simulate(one, **run).omega.values[-1] for one in (own, shipped)]
        assert np.abs(ends[0] - ends[1]).max() < 1e-14  # measured 4.4e-16
    assert not {"helper", "own"} & {*sys.modules}


@pytest.mark.parametrize(
    ("fields", "facts"), [([("noise", tuple)], {"shapes": {"noise": 3}}), ([], {"is_random": True})]
)
def test_noise_is_drawn_for_effects_that_say_so(fields, facts):
    kind = type("Own", (NamedTuple("Own", fields),), {"add_noise": lambda self, l: l, **facts})
    with pytest.raises(rm.SceneError, match=r"is_random=True|needs a field for the normal"):
        rm.prepare(scene(kind(*[(0.0, 0.0, 0.0)] * len(fields))).with_run(integrator="strang"))
