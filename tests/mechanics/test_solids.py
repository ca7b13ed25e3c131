"""Solids against quadrature of their shape, densities with and without edges.

Every mistake gets a message.
"""

import re

import mpmath as mp
import numpy as np
import pytest

import rigidmc as rm
from rigidmc import Body, SceneError
from rigidmc.mechanics import inertia
from rigidmc.mechanics.solids import SOLIDS
from tests.tools.reference import apart

RNG = np.random.default_rng(35)


def round_body(profile, low, high, hollow=lambda z: mp.mpf(0)):
    """(volume, z of the centre, I1 = I2 and I3 about the origin) of a body of revolution with
    radius `profile(z)`, density 1, by mpmath.
    """

    volume, first, second = (
        mp.quad(lambda z, n=n: mp.pi * z**n * (profile(z) ** 2 - hollow(z) ** 2), [low, high])
        for n in range(3)
    )
    about = mp.quad(lambda z: mp.pi / 2 * (profile(z) ** 4 - hollow(z) ** 4), [low, high])
    return volume, first / volume, about / 2 + second, about


ROUND = {  # sizes, radius at z, from, to, radius of the hole
    "ball": ({"radius": 0.7}, lambda z: mp.sqrt(max(mp.mpf("0.49") - z * z, 0)), -0.7, 0.7),
    "cylinder": ({"radius": 0.7, "height": 1.5}, lambda z: mp.mpf("0.7"), -0.75, 0.75),
    "rod": ({"radius": 0.01, "length": 1.5}, lambda z: mp.mpf("0.01"), -0.75, 0.75),
    "hollow_cylinder": (
        {"inner": 0.3, "outer": 0.7, "height": 1.5},
        *(lambda z: mp.mpf("0.7"), -0.75, 0.75, lambda z: mp.mpf("0.3")),
    ),
    "cone": ({"radius": 0.7, "height": 1.5}, lambda z: mp.mpf("0.7") * z / mp.mpf("1.5"), 0, 1.5),
    "ellipsoid": (
        {"semiaxes": (0.7, 0.7, 0.9)},
        *(lambda z: mp.mpf("0.7") * mp.sqrt(max(1 - (z / mp.mpf("0.9")) ** 2, 0)), -0.9, 0.9),
    ),
}


@pytest.mark.parametrize("name", ROUND)
def test_bodies_of_revolution_by_quadrature(name):
    sizes, *shape = ROUND[name]
    with mp.workdps(25):
        volume, height, side, axis = round_body(*shape)
        expected = [float(2 / volume * m) for m in (side, side, axis)]
    body = Body.solid(name, mass=2.0, **sizes)
    assert body.moments == pytest.approx(expected, rel=1e-14)  # measured 2.2e-16
    assert body.centre == pytest.approx((0.0, 0.0, float(height)), abs=1e-15)


@pytest.mark.parametrize("semiaxes", [(0.7, 0.7, 0.7), (0.5, 0.7, 0.9)])
def test_curved_limits_are_integrated_to_rounding(semiaxes):
    """TdC (3.17) over a ball and an ellipsoid, whose limits meet like square roots at the rim."""
    a, b, c = semiaxes

    def half(size, *places):
        """(-size, size) times the height of a unit sphere above a point."""
        s = size * np.sqrt(np.maximum(1 - sum(x * x for x in places), 0.0))
        return -s, s

    region = (-a, a), lambda x: half(b, x / a), lambda x, y: half(c, x / a, y / b)
    body = Body.from_density(2.0 / (4 / 3 * np.pi * a * b * c), region)
    assert body.mass == pytest.approx(2.0, rel=1e-13)  # measured 1.1e-14
    known = Body.solid("ellipsoid", mass=2.0, semiaxes=semiaxes)
    assert apart(body.tensor, known.tensor) < 1e-13  # measured 7.3e-15


def test_cone_is_the_integral_over_its_limits():
    """Along axis 1 from its tip: |(y, z)| < a x/h."""
    a, h = 0.7, 1.5

    def half(x, y):
        s = np.sqrt(np.maximum((a * x / h) ** 2 - y * y, 0))
        return -s, s

    region = (0, h), lambda x: (-a * x / h, a * x / h), half
    body = Body.from_density(6.0 / (np.pi * a * a * h), region)
    cone = np.diag(Body.solid("cone", mass=2.0, radius=a, height=h).tensor)
    assert body.tensor == pytest.approx(np.diag(cone[[2, 0, 1]]), abs=1e-13)  # measured 2.9e-14
    assert body.centre == pytest.approx((0.75 * h, 0.0, 0.0), abs=1e-14)  # measured 2.4e-18


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_the_estimate_does_not_depend_on_the_unit_of_length(size):
    box = ("box", (0.0, size), (0.0, size), (0.0, size))
    smooth = Body.from_density(lambda x, y, z: np.exp(x / size) + 0 * y * z, box)
    assert smooth.mass == pytest.approx((np.e - 1) * size**3, rel=1e-13)  # measured 1.1e-14
    with pytest.raises(SceneError, match=r"difference of two rules is 4\.5e-02"):
        Body.from_density(lambda x, y, z: np.exp(-10 * np.abs(x / size - 0.3)) + 0 * y * z, box)


CUBE = "box", (0, 1), (0, 1), (0, 1)
BOX = Body.box(1.0, (1, 1, 1))
ON_A_LINE = [(1, 0.3, 0.7), (2, 0.6, 1.4), (-3, -0.9, -2.1)]


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        *((lambda density=density, region=region: Body.from_density(density, region), rule)
          for density, region, rule in (
            (lambda x, y, z: x - 0.1, CUBE, "not negative"),
            (lambda x, y, z: x * np.nan, CUBE, "must be finite"),
            (lambda x, y, z: float(x), CUBE, "arrays have the shape"),
            (lambda x, y, z: np.where(x > 0.1, 1.0, 2.0) + 0.0 * (y + z), CUBE,
             "relative difference of two rules is"),
            (0.0, CUBE, "must be positive"),
            # reversed twice: the volume would be right
            (1.0, ("box", (1, 0), (1, 0), (0, 1)), "lower limit exceeds"),
            (1.0, ("sphere", 1.0), "expected .*cylinder"),
            (1.0, ("box", (0, 1), (0, 1)), "expected .*cylinder"),
            (1.0, ((0, 1), (0, 1)), "three pairs"),
        )),
        (lambda: Body.box(1.0, (1.0, 2.0)), r"\[body.box\] size .*3 components"),
        (lambda: Body.box(1.0, 1.0), "3 components"),
        (lambda: Body.cylinder(1.0, [1, 2], 1.0), r"\[body.cylinder\] radius .*a finite number"),
        (lambda: Body.solid("plate", mass=1.0, size=(1.0, 2.0, 3.0)), "2 components"),
        (lambda: Body.solid("ellipsoid", mass=1.0, semiaxes=(1, -2.0, 3)), "semiaxes = -2.0: must"),
        (lambda: Body.solid("ball", mass=rm.uniform(1, 2), radius=1.0), "a plain number"),
        (lambda: BOX.join(3), "only bodies"),
        (lambda: BOX.join(BOX, at=(1, 2)), "at .*3 components"),
        (lambda: Body.from_particles([1, 1], [(1, 1, 1), (2, 2, 2)]), "all mass lies on a line"),
        (lambda: Body.from_particles([1, 1, 0.3], ON_A_LINE), "all mass lies on a line"),
        (lambda: inertia.principal_axes(np.full((3, 3), np.nan)), "finite components"),
        (lambda: inertia.principal_axes(np.zeros((3, 3))), "all moments are 0"),
    ],
)  # fmt: skip
def test_bad_densities_and_solids(make, rule):
    with pytest.raises(SceneError, match=rule):
        make()


def test_no_tensors_have_no_axes():
    moments, axes = inertia.principal_axes(np.empty((0, 3, 3)))
    assert (moments.shape, axes.shape) == ((0, 3), (0, 3, 3))


SHAPES = {
    "box": "{ mass = 2.0, size = [1.0, 2.0, 0.5] }",
    "ball": "{ mass = 2.0, radius = 0.7 }",
    "shell": "{ mass = 2.0, radius = 0.7 }",
    "cylinder": "{ mass = 2.0, radius = 0.7, height = 1.5 }",
    "hollow_cylinder": "{ mass = 2.0, inner = 0.3, outer = 0.7, height = 1.5 }",
    "cone": "{ mass = 2.0, radius = 0.7, height = 1.5 }",
    "ellipsoid": "{ mass = 2.0, semiaxes = [0.5, 0.7, 0.9] }",
    "rod": "{ mass = 2.0, length = 1.5, radius = 0.01 }",
    "plate": "{ mass = 2.0, size = [1.0, 0.6] }",
    "disc": "{ mass = 2.0, radius = 0.7 }",
    "ring": "{ mass = 2.0, radius = 0.7 }",
    "t_handle": "{ density = 8500.0, radius = 0.005, bar = 0.08, stem = 0.04 }",
}


@pytest.mark.parametrize("name", SOLIDS)
def test_every_solid_is_a_shape_of_scene_files(name):
    text = f"[body]\n{name} = {SHAPES[name]}\n[start]\nomega = [0.0, 0.0, 1.0]\n"
    scene = rm.prepare(rm.Scene.loads(text)).scene
    again = rm.Scene.loads(scene.dumps())
    assert again.body.quantities() == scene.body.quantities()
    assert not inertia.violates_triangle(np.array(scene.body.moments))
    with pytest.raises(SceneError, match=rf"\[body.{name}\].*mss"):
        rm.Scene.loads(text.replace(" = {", " = { mss = 1.0,", 1))
    for pattern, to in (  # a list where a number belongs; and the other way round, or one too many
        (r"(\d\.\d+|\d{4}\.0)", r"[\1]"),
        (r"(size|semiaxes) = \[.*\]|(radius|inner) = [\d.]+", r"\1\2 = [[1.0]]"),
    ):
        with pytest.raises(SceneError, match=rf"\[body.{name}\]"):
            rm.Scene.loads(re.sub(pattern, to, text, count=1))
