"""Plausible mistakes of units, signs, points and starts: each is told or refused, and none of the
scenes of the package, its pages and its docstrings is suspected."""

import re
import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import PartError
from rigidmc.scene.library import shipped_names
from tests.tools.pages import scenes

TOP = {"moments": (1.8e-3, 1.8e-3, 5e-4), "mass": 0.5, "centre": (0.0, 0.0, 0.04)}
# about its centre of mass: 0.5 kg at 0.04 m are 8e-4 kg m2
AT_CENTRE = (1e-3, 1e-3, 5e-4)
TENSOR = np.array([[2e-3, 4e-4, 0.0], [4e-4, 1.5e-3, 0.0], [0.0, 0.0, 2.2e-3]])
START = {"omega": (0.0, 0.1, 90.0), "attitude": (0.1, 0.4, 0.0)}


def of(effects=None, start=START, run=None, **body):
    """Return a scene: the top above, with something changed."""
    made = rm.Body.from_moments(**TOP | body)
    effects = (rm.Gravity(9.81),) if effects is None else effects
    return rm.Scene(made, effects, rm.Start(**start), rm.Run(dt=1e-3, t_end=0.1, **(run or {})))


def body(made):
    return rm.Scene(made, rm.Gravity(9.81), rm.Start(**START), rm.Run(dt=1e-3, t_end=0.1))


def scaled(**factors):
    """Return the top with some numbers multiplied."""
    return of(**{key: np.multiply(TOP[key], x).tolist() for key, x in factors.items()})


def start(**changes):
    return of(start=START | changes)


CYLINDER = {"mass": 0.3, "radius": 0.02, "height": 0.06}  # of steel, nearly


def cylinder(**factors):
    return body(rm.Body.cylinder(**{k: x * factors.get(k, 1.0) for k, x in CYLINDER.items()}))


def orbit(**changes):
    known = {"mu": 3.986e14, "distance": 7e6} | changes
    effect = rm.GravityGradient(**known)
    made = rm.Body.from_moments((10.0, 12.0, 8.0), 50.0)
    return rm.Scene(made, effect, rm.Start(**START), rm.Run(dt=1.0, t_end=10.0))


# {mistake: (scene, words of the note or error)}
TOLD = {
    "no start": (lambda: rm.Scene(rm.Body.from_moments(**TOP), rm.Gravity(9.81)), "nothing moves"),
    "no start, no effect": (lambda: rm.Scene(rm.Body((1.0, 2.0, 2.5))), "nothing moves"),
    "at rest and upright": (lambda: start(omega=(0, 0, 0), attitude=(0, 0, 0)), "nothing moves"),
    "at rest and hanging": (lambda: start(omega=(0, 0, 0), attitude=(0, np.pi, 0)), "nothing mov"),
    "at rest, turned about the vertical": (
        lambda: start(omega=(0, 0, 0), attitude=(0.7, 0, 0.4)), "nothing moves"),
    "momentum of zero": (
        lambda: of(start={"momentum": (0.0, 0.0, 0.0)}), "nothing moves"),
    "5 degrees": (lambda: start(attitude=(0, 5, 0)), "more than pi"),
    "3 degrees": (lambda: start(attitude=(0, 3, 0)), "whole number"),
    "-4 degrees of roll": (
        lambda: start(attitude={"euler": "321", "angles": (0, 0, -4)}), "whole number"),
    "10 degrees of yaw": (
        lambda: start(attitude={"euler": "321", "angles": (10, 0, 0)}), "more than 2 pi"),
    "23 degrees": (lambda: start(attitude=(0, 23, 0)), "more than pi"),
    "4.5 degrees": (lambda: start(attitude=(0, 4.5, 0)), "more than pi"),
    "cone in degrees": (lambda: start(omega=rm.Cone(3, 90.0, 5.0)), "angle = 5 is more than pi"),
    "quaternion with the scalar last, not unit": (
        lambda: start(attitude=(0.1, 0.2, 0.3, 1.0)), "normalised"),
    "cylinder in mm": (lambda: cylinder(radius=1e3, height=1e3), "likely lengths in mm"),
    "cylinder in cm": (lambda: cylinder(radius=1e2, height=1e2), "lengths in cm"),
    "cylinder in inches": (
        lambda: cylinder(radius=1 / 0.0254, height=1 / 0.0254), "lengths in inches"),
    "cylinder in g": (lambda: cylinder(mass=1e3), "mass in g"),
    "cylinder in mm and g": (lambda: cylinder(mass=1e3, radius=1e3, height=1e3), "mass in g"),
    "radius in mm alone": (lambda: cylinder(radius=1e3), "far less than air"),
    "diameter in mm, height in m": (lambda: cylinder(radius=2e3), "far less than air"),
    "ball in mm": (lambda: body(rm.Body.solid("ball", mass=0.1, radius=20.0)), "lengths in mm"),
    "box in mm": (lambda: body(rm.Body.box(0.5, (20.0, 30.0, 40.0))), "lengths in mm"),
    "box in cm": (lambda: body(rm.Body.box(0.5, (2.0, 3.0, 4.0))), "lengths in cm"),
    "box of 1 kg in mm": (lambda: body(rm.Body.box(1.0, (20.0, 30.0, 40.0))), "lengths in mm"),
    "pivot of a solid in mm": (
        lambda: body(rm.Body.cylinder(0.3, 0.02, 0.06).with_pivot((0, 0, -30.0))), "millimetres"),
    "moments in g cm2": (lambda: scaled(moments=1e7), "g cm2"),
    "moments in kg mm2": (lambda: scaled(moments=1e6), "kg mm2"),
    "moments in kg cm2": (lambda: scaled(moments=1e4), "kg cm2"),
    "moments in g mm2": (lambda: scaled(moments=1e9), "g mm2"),
    "mass in g": (lambda: scaled(mass=1e3), "cannot exist.*mass is in grams"),
    "mass in g, free": (lambda: of((), centre=(0.0,) * 3, mass=500.0), "mass in g"),
    "mass in mg": (lambda: of((), centre=(0.0,) * 3, mass=5e5), "more than osmium"),
    "centre in mm": (lambda: scaled(centre=1e3), "likely cause: the centre is in millimetres"),
    "centre in cm": (lambda: scaled(centre=1e2), "centre is in centimetres"),
    "centre in inches": (lambda: scaled(centre=1 / 0.0254), "centre is in inches"),
    "centre in mm, mass in g": (lambda: scaled(centre=1e3, mass=1e3), "millimetres and the mass"),
    "centre in mm, about the centre": (
        lambda: of(moments=AT_CENTRE, centre=(0, 0, 40.0), about="centre"), "millimetres"),
    "moments about the centre": (
        lambda: of(moments=(4e-4, 4e-4, 3e-4)), r'cause.*about = "centre"'),
    "tensor about the centre": (
        lambda: body(rm.Body.from_tensor(0.1 * TENSOR, 0.5, (0.0, 0.0, 0.04))), 'about = "centre"'),
    "centre outside of a plate": (
        lambda: of(moments=(1e-3, 1e-3, 2e-3), centre=(0, 0, 0.04)), "cannot exist"),
    "g upwards": (lambda: of((rm.Gravity(-9.81),)), "pulls upwards"),
    "g in cm/s2": (lambda: of((rm.Gravity(981.0),)), "cm/s2"),
    "g in ft/s2": (lambda: of((rm.Gravity(32.174),)), "ft/s2"),
    "g in mm/s2": (lambda: of((rm.Gravity(9810.0),)), "mm/s2"),
    "gravity without a centre": (lambda: of(centre=(0.0,) * 3), "no effect"),
    "gravity without a mass": (lambda: of(mass=None, moments=(1, 1, 0.5)), "assumed mass of 1 kg"),
    "spring at the fixed point": (
        lambda: of((rm.Spring(1.0, (0.0,) * 3, (0.0, 0.0, 1.0)),)), "no effect.*torque is 0"),
    "no gravity without strength": (lambda: of((rm.Gravity(0.0),)), "no effect"),
    "altitude for distance": (lambda: orbit(distance=6e5), "inside the Earth"),
    "distance in km": (lambda: orbit(distance=7e3), "inside the Earth"),
    "anomaly in degrees": (lambda: orbit(eccentricity=0.1, anomaly=45.0), "anomaly = 45"),
    "step of a second": (lambda: of(run={}).with_run(dt=1.0, t_end=10.0), "rad"),
    "step in ms": (lambda: of(run={}).with_run(dt=5.0, t_end=100.0), "rad"),
    "rpm for rad/s, with a step that fits": (
        lambda: start(omega=(0, 0, 12000.0)).with_run(dt=1e-2, t_end=1.0), "rad"),
    "every beyond the end": (lambda: of(run={"every": 5.0}), "every"),
}  # fmt: skip
REFUSED = {
    "moments that no body has": (lambda: of(moments=(1e-3, 1e-3, 5e-3)), "moments"),
    "diameters for moments": (lambda: of(moments=(0.1, 0.2, 0.5)), "moments"),
    "moment of zero": (lambda: of(moments=(1e-3, 1e-3, 0.0)), "positive"),
    "negative mass": (lambda: of(mass=-0.5), "mass"),
    "two moments": (lambda: of(moments=(1e-3, 1e-3)), "moments"),
    "products of the other sign": (
        lambda: body(rm.Body.from_tensor(
            [[2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0]], 1.0)), "opposite sign"),
    "tensor that is not symmetric": (
        lambda: body(rm.Body.from_tensor([[1, 0.2, 0], [0, 1, 0], [0, 0, 1]])), "symmetric"),
    "solid without radius": (lambda: rm.Body.solid("ball", mass=1.0), "missing"),
    "negative radius": (lambda: rm.Body.solid("ball", mass=1.0, radius=-1.0), "positive"),
    "omega and momentum": (lambda: start(momentum=(0.0, 0.0, 1.0)), "either"),
    "unit of another quantity": (lambda: start(omega=("5 m", 0, 0)), "length"),
    "degrees per second with a wrong word": (lambda: start(omega=("5 degs", 0, 0)), "omega"),
    "negative damping": (lambda: of((rm.ViscousDamping(-0.1),)), "rate"),
    "matrix that is a mirror": (lambda: start(attitude=np.diag([1.0, 1.0, -1.0])), "mirror"),
    "matrix of degrees": (lambda: start(attitude=np.eye(3) * 57.3), "rotation"),
    "zero quaternion": (lambda: start(attitude=(0, 0, 0, 0)), "nonzero"),
    "step longer than the run": (lambda: of().with_run(dt=-1.0), "dt"),
    "half a member": (lambda: of().with_run(members=1.5), "members"),
    "about in another language": (lambda: of(about="com"), "about"),
    "axis from zero": (lambda: of().with_run(save=(rm.Passage(axis=0, angle=0.5),)), "axis"),
    "orbit about another point": (
        lambda: rm.prepare(rm.Scene(rm.Body((10.0, 12.0, 8.0), 50.0, (0, 0, 0.1)),
            rm.GravityGradient(3.986e14, 7e6), rm.Start(**START))), "centre of mass"),
}  # fmt: skip
# Numbers that are right in another unit or order, too: nothing distinguishes them
UNTOLD = {
    "rpm for rad/s": lambda: start(omega=(0, 0.1, 900.0)),  # a fast top
    "degrees per second": lambda: start(omega=(0, 0.1, 360.0)),
    "2 degrees": lambda: start(attitude=(0, 2, 0)),  # 115 degrees
    "half a degree": lambda: start(attitude=(0, 0.5, 0)),
    "angles just below pi": lambda: start(attitude=(6.28, 3.1, 0.0)),
    "cone just below pi": lambda: start(omega=rm.Cone(3, 90.0, 3.0)),
    "nearly a unit quaternion": lambda: start(attitude=(1.0, 0.0, 0.0, 1e-4)),
    "hardly any gravity": lambda: of((rm.Gravity(1e-9),)),
    "spring off the fixed point": lambda: of((rm.Spring(1.0, (0.1, 0.0, 0.0), (0.0, 0.0, 1.0)),)),
    "orbit": lambda: orbit(distance=8e6, eccentricity=0.1, anomaly=3.0).with_run(dt=1e-3),
    "box": lambda: body(rm.Body.box(0.5, (0.2,) * 3).with_pivot((0.0, 0.0, -0.1))),
    "ball": lambda: body(
        rm.Body.solid("ball", mass=0.2, radius=0.02).with_pivot((0.0, 0.0, -0.02))
    ),
    "swapped moments": lambda: of(moments=(1.8e-3, 5e-4, 1.8e-3), centre=(0, 0.04, 0)),
    "moments of 1 kg in kg cm2": lambda: scaled(moments=1e4, mass=2.0),  # as in a textbook
    "pounds for kg": lambda: scaled(mass=1.1),
    "centre on the other side": lambda: scaled(centre=-1.0),
    "quaternion with the scalar last": lambda: start(attitude=(0.0, 0.0, 0.6, 0.8)),
}


def told(make):
    """Return the notes and the error of a scene, as one text."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return "\n".join(rm.prepare(make()).notes)


@pytest.mark.parametrize("mistake", TOLD)
def test_a_mistake_is_told(mistake):
    make, words = TOLD[mistake]
    text = told(make)
    assert re.search(words, text), text


@pytest.mark.parametrize("mistake", REFUSED)
def test_a_mistake_is_refused(mistake):
    make, words = REFUSED[mistake]
    with pytest.raises((rm.RigidmcError, TypeError), match=words):
        told(make)


def test_what_is_right_in_another_unit_is_not_told():
    """The limit of what numbers can tell, and no alarm: 74 mistakes are told or refused."""
    assert len(TOLD) + len(REFUSED) >= 70
    assert {name: told(make) for name, make in UNTOLD.items() if told(make)} == {}


# notes that suspect a mistake in the numbers of a scene
SUSPICIONS = re.compile(
    "nothing moves|more than (2 )?pi|whole number|normalised|far less than air|more than osmium"
    "|lengths in|mass in g|pulls upwards|: g is in m/s2"
)
# pages that show a mistake, and its note
SHOWN = {"docs/how_to/units.md"}


def suspicions(scene):
    """Return the notes of a scene that suspect a mistake in its numbers."""
    try:
        notes = told(lambda: scene).splitlines()
    except PartError:  # the example of this error
        return []
    return [note for note in notes if SUSPICIONS.search(note)]


@pytest.mark.parametrize("name", shipped_names())
def test_no_shipped_scene_is_suspected(name):
    assert suspicions(rm.Scene.load(name)) == []


@pytest.mark.slow
def test_no_scene_of_a_page_is_suspected(monkeypatch, tmp_path):
    """150 scenes, which statements of pages and docstrings would run."""
    found = scenes(monkeypatch, tmp_path)
    monkeypatch.undo()
    assert len(found) > 120
    suspected = {place: suspicions(scene) for place, scene in found if place not in SHOWN}
    assert {place: words for place, words in suspected.items() if words} == {}
