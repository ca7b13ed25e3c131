"""Mistakes whose messages are compared by `bench.fingerprints`: one registry.

Four groups: errors in a scene file (TABLES), in custom classes (PARTS), in a command and the files
that it names (WORDS), and in a Python call (CALLS). All but the last are commands.
"""

import os
import shlex
import shutil
import textwrap
import warnings

import numpy as np

SCENE = """
title = "mine"
[body]
moments = [1.0, 2.0, 2.5]
mass = 0.5
centre = [0.0, 0.0, 0.1]
[effects.gravity]
g = 9.81
[effects.viscous_damping]
rate = 0.1
[start]
omega = [{ normal = [0.0, 0.001] }, 1.0, 0.0]
attitude = "uniform"
[run]
integrator = "rk4"
dt = 0.01
t_end = 1.0
members = 100
"""
BODY = "moments = [1.0, 2.0, 2.5]\nmass = 0.5\ncentre = [0.0, 0.0, 0.1]"
OMEGA, MOMENTS, RUN = "[{ normal = [0.0, 0.001] }, 1.0, 0.0]", "[1.0, 2.0, 2.5]", "members = 100"
# {mistake: (text replaced in SCENE, replacement)}; the file is checked
TABLES = {
    "unknown table": ("[body]", "[bdy]"),
    "unknown key": ("omega =", "omgea ="),
    "unknown setting": ("members =", "member ="),
    "unknown effect": ("effects.gravity", "effects.gravty"),
    "effect by another name": ("effects.viscous_damping", "effects.friction"),
    "unknown parameter": ("g = 9.81", "k = 9.81"),
    "missing parameter": ("g = 9.81", ""),
    "no start": ("[start]", "[effects.spring]"),
    "unknown integrator": ('"rk4"', '"rkm4"'),
    "integrator that is a number": ('"rk4"', "4"),
    "integrator that takes no torque": ('"rk4"', '"exact"'),
    "integrator that keeps no tolerance": ("dt = 0.01", "tolerance = 1e-6"),
    "triangle inequality": (MOMENTS, "[1.0, 2.0, 9.0]"),
    "negative moment": (MOMENTS, "[-1.0, 2.0, 2.5]"),
    "two moments": (MOMENTS, "[1.0, 2.0]"),
    "moment that is nan": (MOMENTS, "[nan, 2.0, 2.5]"),
    "impossible bodies": (MOMENTS, "[{ uniform = [0.1, 2.0] }, 1.0, 1.5]"),
    "negative mass": ("mass = 0.5", "mass = -0.5"),
    "centre of two numbers": ("[0.0, 0.0, 0.1]", "[0.0, 0.1]"),
    "centre too far out": ("[0.0, 0.0, 0.1]", "[0.0, 0.0, 100.0]"),
    "two bodies": ("[body]", "[body]\nbox = { mass = 1.0, size = [1, 1, 1] }"),
    "no body": (f"moments = {MOMENTS}", ""),
    "solid that is none": (BODY, "cylindre = { radius = 1.0 }"),
    "solid without a size": (BODY, "cylinder = { mass = 1.0, radius = 1.0 }"),
    "solid of negative size": (BODY, "ball = { mass = 1.0, radius = -1.0 }"),
    "tensor that is not symmetric": (
        f"moments = {MOMENTS}", "tensor = [[1, 0, 0], [0, 1, 0.5], [0, 0, 1]]",
    ),
    "particles on a line": (
        BODY, "particles = { masses = [1, 1], positions = [[0,0,1],[0,0,2]] }",
    ),
    "mass beside a solid": (f"moments = {MOMENTS}", "ball = { mass = 1.0, radius = 1.0 }"),
    "body that is a mesh": (BODY, 'mesh = { file = "none.stl", mass = 1.0 }'),
    "shape of a solid that is none": (
        "[effects.gravity]", '[[body.shape]]\nsolid = "cylindre"\nradius = 1.0\n[effects.gravity]',
    ),
    "shape without a solid": ("[effects.gravity]", "[[body.shape]]\nradius = 1\n[effects.gravity]"),
    "text for a number": ("9.81", '"9.81 m"'),
    "infinite number": ("9.81", "inf"),
    "negative damping": ("rate = 0.1", "rate = -0.1"),
    "vector for a number": ("rate = 0.1", "rate = [0.1, 0.1, 0.1]"),
    "dt of zero": ("dt = 0.01", "dt = 0.0"),
    "dt that is no time": ("dt = 0.01", 'dt = "soon"'),
    "dt and turn": ("dt = 0.01", "dt = 0.01\nturn = 0.1"),
    "no members": (RUN, "members = 0"),
    "half a member": (RUN, "members = 1.5"),
    "too many members": (RUN, "members = 1e30"),
    "negative seed": (RUN, "seed = -1"),
    "precision that is none": (RUN, 'dtype = "float16"'),
    "points that are none": (RUN, 'points = "sobl"'),
    "digits beyond a double": (RUN, "digits = 17"),
    "observable that is none": (RUN, 'save = ["omga"]'),
    "observable that needs a table": (RUN, 'save = ["pointing_angle"]'),
    "work without a law": (RUN, 'save = ["wrk"]'),
    "keep that is none": (RUN, 'keep = "ful"'),
    "keep of what is not saved": (RUN, 'keep = { energy = "final" }'),
    "table of an observable that is none": (RUN, f"{RUN}\n[observables.flps]\nn = 1"),
    "parameter of an observable": (RUN, f"{RUN}\n[observables.passage]\naxis = 5\nangle = 1"),
    "quaternion of norm 0": ('"uniform"', "[0, 0, 0, 0]"),
    "matrix that is no rotation": ('"uniform"', "[[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]"),
    "attitude that is none": ('"uniform"', '"unifrom"'),
    "ensemble without a momentum": ('"uniform"', '"ensemble"'),
    "omega and momentum": (f"omega = {OMEGA}", f"omega = {OMEGA}\nmomentum = [1, 1, 1]"),
    "distribution that is none": ("normal", "norml"),
    "negative standard deviation": ("0.001", "-0.001"),
    "bounds in the wrong order": (OMEGA, "[{ normal = [2, 0.1], between = [4, 3] }, 1, 0]"),
    "nothing in common": (OMEGA, "[{ common = [1.0] }, 1, 0]"),
    "mixture of one part": (OMEGA, "[{ mixture = [{ weight = 1, normal = [0, 1] }] }, 1, 0]"),
    "grid that falls": (OMEGA, "[{ grid = [1.0, 0.0, 5] }, 1.0, 0.0]"),
    "law that is none": (OMEGA, "{ spere = 2.0 }"),
    "law of something else": (OMEGA, "{ shell = { energy = 1.0 } }"),
    "law with a missing number": (OMEGA, "{ cone = { axis = 2, size = 1.0 } }"),
    "law with an unknown number": (OMEGA, "{ cone = { axis = 2, size = 1.0, angel = 0.1 } }"),
    "covariance that is none": (
        OMEGA,
        "{ correlated = { mean = [0, 1, 0], covariance = [[1, 2, 0], [2, 1, 0], [0, 0, 1]] } }",
    ),
    "energy that no start has": (f"omega = {OMEGA}", "momentum = { shell = { energy = -20.0 } }"),
    "rows of a result": (OMEGA, '{ stored = "start_omega" }'),
    "table that is not there": (OMEGA, '{ table = "none.csv", columns = ["a", "b", "c"] }'),
    "column that is not there": (OMEGA, '{ table = "rows.csv", columns = ["a", "b", "d"] }'),
    "code that is not allowed": (RUN, f'{RUN}\n[integrators.mine]\nmodule = "mine.py"'),
    "key that is there twice": ("g = 9.81", "g = 9.81\ng = 1.62"),
    "no TOML": ("[start]", "[start"),
}  # fmt: skip

HEAD = """
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rigidmc.protocols import VectorDistribution, event, observable, running, sample

"""
EFFECT = "class Own(NamedTuple):\n    size: float\n"
VALUE = '@observable(units="1", long_name="own", dims=())\nclass Own(NamedTuple):\n'
EVENT = '@event(outputs={"own": ("1", "own", ())})\nclass Own(NamedTuple):\n'
RUNNING = '@running(state_size=1, outputs={"own": ("1", "own", ())})\nclass Own(NamedTuple):\n'
LAW = """@dataclass(frozen=True)
class Own(VectorDistribution):
    size: Any
    variables = ("omega",)
"""
SAMPLE = "def sample(self, source, name, first, count, facts): return "
STEP = """class Own(NamedTuple):
    order, evaluations, is_reversible, conserves = 4, 4, False, ()
    accepts, compensated = "any torque", False
"""
# {mistake: (kind of class, the class in mine.py, its body)}; --allow-code lets it run
PARTS = {
    "no such class": ("effects", "class Other:\n", "pass"),
    "file that raises": ("effects", "nothing()\n", ""),
    "file that is no Python": ("effects", "class Own(:\n", ""),
    "no torque": ("effects", EFFECT, "pass"),
    "torque that raises": ("effects", EFFECT, "def torque(self, l): return l[3], 0.0, 0.0"),
    "torque of two numbers": ("effects", EFFECT, "def torque(self, l): return self.size, 0.0"),
    "torque that is an array": (
        "effects", EFFECT, "def torque(self, l): return np.array([self.size, 0.0, 0.0])",
    ),
    "torque that asks for something else": (
        "effects", EFFECT, "def torque(self, speed): return speed, 0.0, 0.0",
    ),
    "torque that is infinite": (
        "effects", EFFECT, "def torque(self, l): return 1e308 * 10.0 * self.size, 0.0, 0.0",
    ),
    "torque that is not that of its energy": (
        "effects", EFFECT,
        "def torque(self, q): return q[1], 0.0, 0.0\ndef energy(self, q): return self.size * q[1]",
    ),
    "torque with a list": (
        "effects", EFFECT, "def torque(self, l): return float(sum([x for x in l])), 0.0, 0.0",
    ),
    "loop without an end": (
        "effects", EFFECT,
        "def torque(self, l):\n    x = self.size * l[0]\n"
        "    while abs(x) > 1e-3:\n        x = 0.5 * x\n    return x, 0.0, 0.0",
    ),
    "value that is no tuple": ("observables", VALUE, "def value(self, q): return q[0]"),
    "value of a dimension that is none": (
        "observables", VALUE.replace("dims=()", 'dims=("face",)'), "def value(self): return (1.0,)",
    ),
    "value without units": (
        "observables", VALUE.replace('units="1", ', ""), "def value(self): return (1.0,)",
    ),
    "event without a level": (
        "observables", EVENT, "def results(self, record): return {'own': record.count}",
    ),
    "event without results": (
        "observables", EVENT,
        "def level(self, q): return q[0]\ndef results(self, record): return {}",
    ),
    "running observable of two marks": (
        "observables", RUNNING,
        "def begin(self): return 1.0, 2.0\ndef update(self, state): return state\n"
        "def results(self, state, steps): return {'own': state[0]}",
    ),
    "law that draws two components": ("start", LAW, f"{SAMPLE}np.ones((2, count))"),
    "law that draws nan": ("start", LAW, f"{SAMPLE}np.full((3, count), np.nan)"),
    "law with random numbers of its own": (
        "start", LAW, f"{SAMPLE}np.random.default_rng().random((3, count))",
    ),
    "law of something else": ("start", LAW.replace("omega", "attitude"), f"{SAMPLE}np.ones(3)"),
    "step that asks for something else": (
        "integrators", STEP, "def step(self, speed): return speed",
    ),
    "step that gives no momentum": (
        "integrators", STEP, "def step(self, body, effects, t, h, q, l): return q",
    ),
    "integrator without facts": (
        "integrators", "class Own(NamedTuple):\n",
        "def step(self, body, effects, t, h, q, l): return q, l",
    ),
}  # fmt: skip

# {mistake: command}, in a folder made by `prepare`
WORDS = """
runn dzhanibekov
run
run dzhanibekow
run nowhere.toml
run room/dzhanibekov
run empty
run junk.nc
run latin.toml
run dzhanibekov --no-such-option
run dzhanibekov --members abc
run dzhanibekov --members 0
run dzhanibekov --t-end soon
run dzhanibekov --dt -1
run dzhanibekov --dt 0.1 --turn 0.1
run dzhanibekov --integrator rk9
run dzhanibekov --integrator rk4 --tolerance 1e-6
run dzhanibekov --dtype float16
run dzhanibekov --save omga
run dzhanibekov --keep sometimes
run dzhanibekov --threads 0
run dzhanibekov --device gpu
run dzhanibekov --energy-limit x
run dzhanibekov --first -1
run dzhanibekov --plot x.foo
run dzhanibekov -o x.txt
run dzhanibekov -o nowhere/x.nc
run dzhanibekov -o result.nc
run dzhanibekov -o run/
run dzhanibekov -o run/ --force
run dzhanibekov --shards 0:1
run dzhanibekov -o new/ --shards 1:0
run dzhanibekov -o new/ --shards 7:9
run dzhanibekov -o new/ --plot x.png
run dzhanibekov -o new/ --shard-size 1e7
run dzhanibekov -o new/ --shards 0:1 --shard-time 60
run dzhanibekov -o new/ --cluster here
run dzhanibekov --max-wall 1h
run dzhanibekov --until 'p(flips >= 1)'
run dzhanibekov --until 'p(flip >= 1) +- 0.1'
run dzhanibekov --until 'p(flips >= 1) +- 0.1' --members 5
run nasa_brick --until 'p(flips >= 1) +- 0.1'
show dzhanibekov --set x
show dzhanibekov --set body.momets=[1,2,3]
show dzhanibekov --set start.omega.4=1
show dzhanibekov --set run.dt.x=1
show heavy_top --set effects.gravity.g=heavy
show result.nc --set start.omega=[0,0,1,1]
scenes nosuch
view result.nc -o x.txt
view result.nc --members 0,x
view result.nc --members 777
view result.nc -o y.html --until 1e9
summary dzhanibekov
summary resul.nc
summary junk.nc
summary torn.nc
summary empty
summary result.nc --of 'p(flip >= 1)'
summary result.nc --of 'p(flips => 1)'
summary result.nc --of 'mean(omega)'
summary result.nc --of 'correlation(flips)'
plot result.nc -o x.txt
plot result.nc -o x.png --picture sumary
plot result.nc -o x.png --picture gibbs
export result.nc -o x.doc
export result.nc -o result.nc
rerun result.nc
rerun result.nc --member 999
rerun result.nc --member 1 --every 0
rerun result.nc --member 1 --save omga
animate result.nc --member 0 -o x.avi
animate result.nc --member 999 -o x.gif
status empty
status nowhere
status damaged
status edited
verify torn
verify other
verify foreign
resume other
resume torn --shards 5:9
resume torn --max-wall never
consolidate torn -o y.nc
extend run --members 10
extend run --members 10 --cluster here
merge new run/ different/
merge run empty
summary none
map nosuch
map list nosuch
map heavy_top
map growth --members 0
map growth --z body.mass=1:2
map growth --zoom 0:1,0:1
map growth --border 0.5
map growth --x body.mass=1:2
map growth --shards 0:1
map result.nc
map map.nc --members 3
map map.nc --zoom 0:1
map heavy_top --x body.momets.1=1:2 --y start.omega.1=1:2 --of 'p(flips >= 1)'
map heavy_top --x start.omega.1=1 --y start.omega.2=1:2 --of 'p(flips >= 1)'
map heavy_top --x start.omega.1=2:1 --y start.omega.2=1:2 --of 'p(flips >= 1)'
map heavy_top --x start.omega.1=0:1:log --y start.omega.2=1:2 --of 'p(flips >= 1)'
map heavy_top --x start.omega.1=1:2 --y start.omega.2=1:2 --of 'p(tilt >= 1)'
map heavy_top --x start.omega.1=1:2 --y start.omega.1=1:2 --of 'p(flips >= 1)'
linearise driven_pendulum
linearise heavy_top --along start.omega.4=1:2
linearise heavy_top --along start.omega.3=2:1
ftle heavy_top --families 0
ftle result.nc
ftle result.nc --families 5
section kovalevskaya --at 'omga[1] = 0'
section kovalevskaya --at 'omega[1] > 0'
section kovalevskaya --at 'omega[1] = 0' --way rise
section dzhanibekov --at 'every orbit'
section brownian_rotor --at 'omega[1] = 0'
section result.nc --at 'momentum[1] = 0'
frequencies dzhanibekov
frequencies dzhanibekov --of 'omga[1]'
frequencies dzhanibekov --of 'omega[4]'
frequencies dzhanibekov --of 'omega[1]' --t-end 1
basins dzhanibekov --of 'mean(omega_max[1])'
basins nasa_brick --of 'p(flips >= 1)'
basins result.nc --of 'p(flips >= 1)'
sensitivity dzhanibekov --of 'quantile(flips, 0.5)'
sensitivity nasa_brick --of 'mean(flips)'
rare dzhanibekov
rare dzhanibekov --of 'mean(omega_max[1])'
rare dzhanibekov --of 'p(omega_max[1] >= 1)' --target 2
rare nasa_brick --of 'p(omega_max[1] >= 1)'
rare dzhanibekov --of 'p(omega_max[1] >= 1)' -o new/ --shard-size 1
rare run/
multilevel brownian_rotor
multilevel brownian_rotor --until 'mean(energy_final)'
multilevel brownian_rotor --until 'p(energy_final > 0) +- 0.1'
accuracy dzhanibekov --integrators rk9
accuracy heavy_top --integrators exact
accuracy dzhanibekov --tolerances a,b
stress --group H99
stress --integrator rk9
stress --bounds none.csv
stress --bounds rows.csv
exact hyperion
exact heavy_top --members 0
body none.stl
body junk.stl
body heavy_top --scale 0
new x.txt
new scene.toml
new x.toml --mass abc
new x.toml --solid cylindre
new x.toml --size radius
new x.toml --size radius=1,hight=2
new x.toml --moments 1,2
new x.toml --moments 1,2,9
new x.toml --moments 1,2,2.5 --solid cone
new x.toml --centre 0,0,1
new x.toml --spin 1,2
new x.toml --lean 400
new x.toml --spread 2
new x.toml --solid ball --gravity 9.81
effects gravty
observables omga
integrators rk9
integrators --scene nowhere.toml
warm nosuch
"""


def _body():
    import rigidmc as rm

    return rm.Body.from_moments((1.0, 2.0, 2.5))


def _scene(*effects, **start):
    import rigidmc as rm

    return rm.Scene(_body(), effects, rm.Start(**start or {"omega": (0.0, 0.0, 1.0)}))


def _rm():
    import rigidmc as rm

    return rm


def _open_map(path):
    from rigidmc.studies.stability_map.stored import open_map

    return open_map(path)


# {mistake: a call that raises}
CALLS = {
    "name of the package": lambda: _rm().simulat,
    "body: no moments": lambda: _rm().Body.from_moments((1, 2)),
    "body: one of two rows": lambda: _rm().Body.from_moments(np.array([[1, 2, 2.5], [1, 1, 9.0]])),
    "body: mass of zero": lambda: _rm().Body.from_moments((1, 2, 3), mass=0),
    "body: tensor of 2 x 2": lambda: _rm().Body.from_tensor(np.eye(2)),
    "body: particles": lambda: _rm().Body.from_particles([1, 1], [(0, 0, 1)]),
    "body: negative radius": lambda: _rm().Body.cylinder(1, -1, 1),
    "body: left-handed axes": lambda: _rm().Body((1, 2, 2.5), axes=-np.eye(3)),
    "start: nothing": lambda: _rm().Start(),
    "start: text": lambda: _rm().Start(omega="fast"),
    "start: truth value": lambda: _rm().Start(omega=(0, True, 0)),
    "start: one of two rows": lambda: _rm().Start(omega=np.array([[0, 0, 1], [0, np.inf, 1]])),
    "start: transposed": lambda: _rm().Start(omega=np.ones((3, 5))),
    "start: mirror": lambda: _rm().Start(omega=(0, 0, 1), attitude=np.diag([1, 1, -1])),
    "start: complex": lambda: _rm().Start(omega=(1j, 0, 0)),
    "start: huge number": lambda: _rm().Start(omega=(10**400, 0, 0)),
    "distribution: none": lambda: _rm().distribution("gama", a=1),
    "distribution: no number": lambda: _rm().distribution("gamma"),
    "distribution: uniform": lambda: _rm().uniform(2, 1),
    "distribution: between": lambda: _rm().uniform(0, 1).between(2, 3),
    "distribution: common": lambda: _rm().common(1.0, "0.1"),
    "distribution: mixture": lambda: _rm().mixture((1.0, _rm().normal(0, 1)), (1.0, 3.0)),
    "scene: effect as a word": lambda: _rm().Scene(_body(), ("gravity",)),
    "scene: effect as a class": lambda: _rm().Scene(_body(), (_rm().Gravity,)),
    "scene: negative damping": lambda: _scene(_rm().ViscousDamping(-1.0)),
    "scene: body as numbers": lambda: _rm().Scene((1, 2, 3)),
    "scene: rows of two lengths": lambda: _rm().Scene(
        _body(), (_rm().Gravity(np.ones(3)),), _rm().Start(omega=np.ones((4, 3)))
    ),
    "scene: TOML": lambda: _rm().Scene.loads("[body]\nmoments = [1, 2, 9]"),
    "scene: name": lambda: _rm().Scene.load("heavytop"),
    "scene: setting": lambda: _scene().with_run(tend=1.0),
    "scene: value of a setting": lambda: _scene().with_run(t_end=-1.0),
    "simulate: keyword": lambda: _rm().simulate(_scene(), tolerence=1e-6),
    "simulate: threads": lambda: _rm().simulate(_scene(), threads=0),
    "simulate: members": lambda: _rm().simulate(_scene(), members=range(5, 5)),
    "simulate: indices": lambda: _rm().simulate(_scene(), members=[2, 1]),
    "simulate: more than rows": lambda: _rm().simulate(
        _scene(omega=np.ones((4, 3))), members=5, integrator="exact"
    ),
    "simulate: dt": lambda: _rm().simulate(_scene(), dt="small"),
    "simulate: integrator": lambda: _rm().simulate(_scene(), 1.0),
    "simulate: device": lambda: _rm().simulate(_scene(), device="cud"),
    "simulate: output": lambda: _rm().simulate(_scene(), output="x.txt"),
    "simulate: output that exists": lambda: _rm().simulate(_scene(), output="result.nc"),
    "simulate: no scene": lambda: _rm().simulate((1, 2, 3)),
    "open: folder": lambda: _rm().open("empty"),
    "open: nothing": lambda: _rm().open("resul.nc"),
    "open: no result": lambda: _rm().open("junk.nc"),
    "rerun: member": lambda: _rm().rerun("result.nc", 999),
    "rerun: result without a scene": lambda: _rm().rerun(
        _rm().open("result.nc").drop_attrs(), 1
    ),
    "map: side": lambda: _rm().stability_map(
        _scene(), ("start.omega.1", 0.0), ("start.omega.2", 0.0, 1.0), "flips"
    ),
    "map: layers": lambda: _rm().stability_map(
        _scene(), ("start.omega.1", 0.0, 1.0), ("start.omega.2", 0.0, 1.0), "flips", layers=3
    ),
    "map: file": lambda: _open_map("result.nc"),
    "until: width": lambda: _rm().simulate_until("dzhanibekov", "p(flips >= 1) +- 0"),
    "until: members": lambda: _rm().simulate_until(
        "dzhanibekov", "p(flips >= 1) +- 0.1", members=9
    ),
    "ftle: unit": lambda: _rm().ftle("dzhanibekov", 8, unit=-1.0),
    "rare: confidence": lambda: _rm().rare(
        "dzhanibekov", "p(omega_max[1] >= 9)", 0.1, 20, 2, confidence=2.0, t_end=0.1
    ),
    "free top: moments": lambda: _rm().solve_free_top((1, 2, -3), (0, 1, 0), (1, 0, 0, 0), 1.0),
    "free top: shapes": lambda: _rm().solve_free_top(
        np.ones((2, 3)), np.ones((3, 3)), (1, 0, 0, 0), 1.0
    ),
    "heavy top: moments": lambda: _rm().solve_lagrange_top(
        (1, 2, 3), 1.0, (0, 0, 1), (1, 0, 0, 0), 1.0
    ),
    "result: method": lambda: _rm().open("result.nc").rigid.summry,
    "result: measure": lambda: _rm().open("result.nc").rigid.measure("p(flip >= 1)"),
}  # fmt: skip


def prepare(command):
    """Make the files that mistakes are about, in the working directory.

    command : a function that runs a command and raises if it fails
    """
    few = ("--members", 100, "--t-end", 1, "--save", "omega,flips")
    command("run", "dzhanibekov", *few, "-o", "result.nc")
    command("run", "dzhanibekov", *few, "-o", "run/", "--shard-time", 1e-9)
    command("run", "dzhanibekov", *few, "--seed", 9, "-o", "different/", "--shard-time", 1e-9)
    command("map", "growth", "--resolution", 4, "--members", 1, "-o", "map.nc")
    for name in ("torn", "other", "damaged", "edited", "foreign"):
        shutil.copytree("run", name)
    first, *_, last = sorted(os.listdir("run/shards"))
    os.unlink(f"torn/shards/{last}")  # one shard is missing
    _replace("damaged/run.json", '"seed"', '"sead"')
    _replace("edited/run.json", '"seed": 1', '"seed": 2')
    _replace("other/scene.toml", "seed = 1", "seed = 2")
    shutil.copy(f"different/shards/{sorted(os.listdir('different/shards'))[0]}", "foreign/shards")
    os.unlink(f"foreign/shards/{first}")
    with open("result.nc", "rb") as file:
        data = file.read()
    contents = {
        "torn.nc": data[: len(data) // 2],
        "junk.nc": b"junk" * 100,
        "junk.stl": b"junk" * 100,
        "latin.toml": b'title = "\xe4"\n',
        "scene.toml": SCENE.encode(),
        "rows.csv": b"a,b,c\n1,2,3\n4,5,6\n",
    }
    for name, content in contents.items():
        with open(name, "wb") as file:
            file.write(content)
    os.mkdir("empty")


def _replace(path, old, new):
    with open(path) as file:
        text = file.read()
    if old not in text:
        raise ValueError(f"{path} has no {old}")
    with open(path, "w") as file:
        file.write(text.replace(old, new))


def commands():
    """(mistake, words of a command) of all but CALLS; writes the file that the command reads."""
    for name, (old, new) in TABLES.items():
        if old not in SCENE:
            raise ValueError(f"{name}: the scene has no {old}")
        with open("mine.toml", "w") as file:
            file.write(SCENE.replace(old, new, 1))
        yield f"scene file: {name}", ("check", "mine.toml")
    for i, (name, (part, head, body)) in enumerate(PARTS.items()):
        # a folder for each: Python keeps the modules that it has loaded
        os.makedirs(folder := f"part-{i}")
        with open(f"{folder}/mine.py", "w") as file:
            file.write(f"{HEAD}{head}{textwrap.indent(body, '    ')}\n")
        with open(f"{folder}/scene.toml", "w") as file:
            file.write(_with(part))
        yield f"own part: {name}", ("check", f"{folder}/scene.toml", "--allow-code")
    for line in WORDS.strip().splitlines():
        yield line, tuple(shlex.split(line))


def _with(part):
    """Return SCENE with a custom class from mine.py."""
    if part == "start":
        return SCENE.replace(OMEGA, '{ Own = { size = 1.0 }, module = "mine.py" }')
    size = "\nsize = 1.0" * (part == "effects")
    more = {"observables": 'save = ["own"]', "integrators": 'integrator = "own"'}.get(part, "")
    text = SCENE.replace('integrator = "rk4"', more) if part == "integrators" else SCENE
    text = text.replace(RUN, f"{RUN}\n{more}") if part == "observables" else text
    return f'{text}\n[{part}.Own]\nmodule = "mine.py"{size}\n'


def error_of(call):
    """Return the error of a call: the class that `except` catches, and its text."""
    import rigidmc as rm

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = call()
    except Exception as error:
        # a new subclass is caught by the same `except` as before
        known = (rm.SceneError, rm.OptionError, rm.FileError, rm.OutputExists, rm.NoDevice)
        kind = next((one for one in known if isinstance(error, one)), type(error))
        return f"{kind.__name__}: {error}"
    raise RuntimeError(f"no error, but {type(found).__name__}")
