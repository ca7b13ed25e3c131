"""Derivatives of members at their start, against differences of members that are built anew.

The members of scenes with other numbers come from the plain code. Differences of order 6 of them
have an error of about 1e-13 of the numbers over the step.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.planning.derivative_names import (
    parameter_names_of_derivatives,
)
from rigidmc.planning.initial import block_rows, initial_block
from rigidmc.planning.tangents import tangents_at_start

MEMBERS = 5


class Numbers(dict):
    """Numbers of a scene by the names of its parameters."""

    def three(self, name, count=3):
        return tuple(self[f"{name}.{i + 1}"] for i in range(count))

    def normal(self, name):
        return rm.normal(self[f"{name}.mean"], self[f"{name}.standard_deviation"])

    def symmetric(self, name, size=3):
        """The symmetric matrix with elements NAME.i.j, each given once."""
        whole = np.zeros((size, size))
        for key, value in self.items():
            if key.startswith(name):
                i, j = (int(word) - 1 for word in key.split(".")[-2:])
                whole[i, j] = whole[j, i] = value
        return whole


def numbers(**groups):
    """{NAME: number} from {NAME with _ for .: number, list, or dict of the last words}."""
    found = Numbers()
    for name, values in groups.items():
        name = name.replace("__", ".")
        if isinstance(values, dict):
            found |= {f"{name}.{key}": value for key, value in values.items()}
        elif isinstance(values, (list, tuple)):
            found |= {f"{name}.{i + 1}": value for i, value in enumerate(values)}
        else:
            found[name] = values
    return found


SPIN = [0.4, -1.1, 0.8]
ANGLES = {"phi": 0.3, "theta": 0.7, "psi": -2.1}
SIX = {"1.1": 2.0, "2.2": 2.5, "3.3": 3.1, "2.3": 0.2, "3.1": -0.1, "1.2": 0.3}
SPREAD = {"1.1": 0.04, "2.2": 0.09, "3.3": 0.01, "1.2": 0.02, "1.3": 0.005, "2.3": -0.01}


def angles(v, names=("phi", "theta", "psi")):
    return tuple(v[f"start.attitude.{name}"] for name in names)


def heavy(v):
    body = rm.Body.from_moments(v.three("body.moments"), v["body.mass"], v.three("body.centre"))
    start = rm.Start(omega=v.three("start.omega"), attitude=angles(v))
    return rm.Scene(body, rm.Gravity(v["effects.gravity.g"]), start=start)


def solid(name, pivot=(0.0, 0.0, 0.0)):
    def make(v):
        word = f"body.{name}"
        sizes = {key.split(".")[2] for key in v if key.startswith(word)}
        given = {
            key: v[f"{word}.{key}"]
            if f"{word}.{key}" in v
            else v.three(f"{word}.{key}", 2 if name == "plate" else 3)
            for key in sizes
        }
        body = rm.Body.solid(name, **given).with_pivot(pivot)
        start = rm.Start(omega=(0.4, -1.1, 0.8), attitude=(0.3, 0.7, -2.1))
        return rm.Scene(body, rm.Gravity(9.81), start=start)

    return make


def described(axes):
    def make(v):
        matrix = v.symmetric("body.tensor")
        body = rm.Body.from_tensor(matrix, v["body.mass"], v.three("body.centre"), axes=axes)
        spring = rm.Spring(
            v["effects.spring.stiffness"], v.three("effects.spring.at"), (0.5, 0.4, 1.9)
        )
        damping = rm.MatrixDamping(v.three("effects.matrix_damping.matrix", 6))
        start = rm.Start(omega=v.three("start.omega"), attitude=v.three("start.attitude", 4))
        return rm.Scene(body, [spring, damping], start=start)

    return make


TENSOR = numbers(
    body__tensor=SIX, body__mass=1.4, body__centre=[0.1, 0.2, -0.1], start__omega=SPIN,
    start__attitude=[0.5, -0.5, 0.7, 0.4], effects__spring__stiffness=3.0,
    effects__spring__at=[0.2, 0.1, -0.3],
    effects__matrix_damping__matrix=[0.3, 0.4, 0.5, 0.02, 0.03, -0.04],
)  # fmt: skip


def drawn(v):
    """Every kind of distribution of one number, and both kinds of grid."""
    cut = v.normal("start.omega.2").between(*v.three("start.omega.2.between", 2))
    gamma = rm.distribution(
        "gamma", a=2.5, loc=v["start.omega.3.loc"], scale=v["start.omega.3.scale"]
    )
    expon = rm.distribution("expon", scale=v["start.attitude.phi.scale"])
    mixed = rm.mixture(
        (2.0, rm.normal(v["start.attitude.theta.1.mean"], 0.02)),
        (1.0, rm.uniform(1.1, v["start.attitude.theta.2.high"])),
    )
    uniform = rm.uniform(v["start.attitude.psi.low"], v["start.attitude.psi.high"])
    grid = rm.grid(v["effects.gravity.g.low"], v["effects.gravity.g.high"], 3)
    log = rm.grid(v["body.mass.low"], v["body.mass.high"], 2, stride=2, log=True)
    body = rm.Body.from_moments((1.0, 1.7, 2.2), log, (0.1, -0.2, 0.3))
    attitude = (expon.between(v["start.attitude.phi.between.1"], np.inf), mixed, uniform)
    start = rm.Start(omega=(v.normal("start.omega.1"), cut, gamma), attitude=attitude)
    return rm.Scene(body, rm.Gravity(grid), start=start)


DRAWN = numbers(
    start__omega__1={"mean": 0.2, "standard_deviation": 0.3},
    start__omega__2={"mean": 0.2, "standard_deviation": 0.3, "between.1": -0.1, "between.2": 0.4},
    start__omega__3={"loc": 0.5, "scale": 1.4},
    start__attitude__phi={"scale": 1.2, "between.1": 0.5},
    start__attitude__theta={"1.mean": 0.5, "2.high": 1.6},
    start__attitude__psi={"low": -0.4, "high": 2.0},
    effects__gravity__g={"low": 8.0, "high": 10.0},
    body__mass={"low": 0.7, "high": 1.9},
)  # fmt: skip


def orbit(v):
    body = rm.Body.from_tensor(v.symmetric("body.tensor"))
    pull = rm.GravityGradient(*(v[f"effects.gravity_gradient.{x}"] for x in ORBIT))
    start = rm.Start(
        omega=v.three("start.omega"),
        attitude=angles(v, ("yaw", "pitch", "roll")),
        sequence="321",
        relative_to_orbit=("omega", "attitude"),
    )
    return rm.Scene(body, pull, start=start)


ORBIT = {"mu": 2.0, "distance": 1.3, "eccentricity": 0.2, "anomaly": 0.5}


def spin(distribution, effects=(), body=None):
    """A scene whose spin is a distribution of a vector."""

    def make(v):
        key, made = distribution(v)
        bodies = body or (lambda v: rm.Body.from_moments((1.0, 1.7, 2.2), 0.5, (0.0, 0.1, 0.2)))
        start = rm.Start(**{key: made}, attitude=(0.3, 0.7, -2.1))
        return rm.Scene(bodies(v), [make(v) for make in effects], start=start)

    return make


def cone(v):
    size = v.normal("start.omega.size")
    given = v["start.omega.angle"], v["start.omega.azimuth"]
    return "omega", rm.Cone(-2, size, *given)


def correlated(v):
    mean = v.three("start.momentum.mean")
    return "momentum", rm.Correlated(mean, v.symmetric("start.momentum.covariance"))


def shell(v):
    return "momentum", rm.Shell(v["start.momentum.energy"], v.three("start.momentum.direction"))


def second_moments(v):
    return rm.Body.from_moments(
        rm.SecondMoments((v["body.moments.values.1"], v.normal("body.moments.values.2"), 0.9))
    )


def gravity(v):
    return rm.Gravity(v["effects.gravity.g"])


def field(v):
    mean = v.three("effects.uniform_field.dipole.mean")
    covariance = v.symmetric("effects.uniform_field.dipole.covariance")
    return rm.UniformField(rm.Correlated(mean, covariance), (0.1, 0.2, 0.3))


class Case(NamedTuple):
    make: Any
    given: Numbers
    error: float = 2e-11


CASES = {
    "heavy": Case(
        heavy,
        numbers(
            body__moments=[1.0, 1.7, 2.2], body__mass=1.3, body__centre=[0.1, -0.2, 0.3],
            start__omega=SPIN, start__attitude=ANGLES, effects__gravity__g=9.81,
        ),
    ),
    "described": Case(described("described"), TENSOR),
    "principal": Case(described("principal"), TENSOR),
    "drawn": Case(drawn, DRAWN, 2e-10),
    "orbit": Case(
        orbit,
        numbers(
            body__tensor=SIX, start__omega=SPIN, effects__gravity_gradient=ORBIT,
            start__attitude={"yaw": 0.3, "pitch": -0.4, "roll": 0.9},
        ),
    ),
    "cone": Case(
        spin(cone),
        numbers(
            start__omega__size={"mean": 2.0, "standard_deviation": 0.1},
            start__omega={"angle": 0.4, "azimuth": 1.2},
        ),
    ),
    "sphere": Case(
        spin(lambda v: ("momentum", rm.Sphere(v["start.momentum.size"]))),
        numbers(start__momentum__size=2.0),
    ),
    "correlated": Case(
        spin(correlated, [field]),
        numbers(
            start__momentum__mean=[0.3, 0.4, 0.5], start__momentum__covariance=SPREAD,
            effects__uniform_field__dipole__mean=[0.3, 0.1, 0.2],
            effects__uniform_field__dipole__covariance=SPREAD,
        ),
    ),
    "shell": Case(
        spin(shell, [gravity]),
        numbers(
            start__momentum={"energy": 4.0}, start__momentum__direction=[0.3, 0.4, 0.5],
            effects__gravity__g=3.0,
        ),
    ),
    "gibbs": Case(
        spin(lambda v: ("momentum", rm.GibbsMomentum(v["start.momentum.kT"])), body=second_moments),
        numbers(
            start__momentum__kT=0.4, body__moments__values={"1": 0.8},
            body__moments__values__2={"mean": 0.7, "standard_deviation": 0.05},
        ),
    ),
    "cylinder": Case(
        solid("cylinder", (0.0, 0.0, -0.2)),
        numbers(body__cylinder={"mass": 2.0, "radius": 0.3, "height": 0.8}),
    ),
    "box off its axes": Case(
        solid("box", (0.2, -0.1, 0.3)),
        numbers(body__box__mass=2.0, body__box__size=[0.5, 0.7, 1.1]),
    ),
    "cone solid": Case(
        solid("cone", (0.0, 0.1, 0.05)),
        numbers(body__cone={"mass": 2.0, "radius": 0.3, "height": 0.8}),
        4e-10,  # two moments differ by 1 %
    ),
    "ellipsoid": Case(
        solid("ellipsoid"), numbers(body__ellipsoid__mass=2.0, body__ellipsoid__semiaxes=[1, 2, 3])
    ),
    "plate": Case(solid("plate"), numbers(body__plate__mass=2.0, body__plate__size=[1.0, 2.0])),
    "ball": Case(solid("ball"), numbers(body__ball={"mass": 2.0, "radius": 0.3})),
    "tube": Case(
        solid("hollow_cylinder"),
        numbers(body__hollow_cylinder={"mass": 2.0, "inner": 0.3, "outer": 0.5, "height": 0.8}),
    ),
    "t_handle": Case(
        solid("t_handle"),
        numbers(body__t_handle={"density": 8e3, "radius": 0.01, "bar": 0.1, "stem": 0.06}),
    ),
}  # fmt: skip


def rows_of(scene, members=MEMBERS, first=0):
    """The block of a scene, with the principal axes in four more rows if they turn."""
    count = block_rows(scene.effects, False)
    block, start = initial_block(scene.model, 7, first, members, True, count)
    axes = [start["principal_axes"]] if "principal_axes" in start else []
    return np.concatenate([block, *axes])


def tangents(scene, names, members=MEMBERS, first=0):
    """The derivatives of `rows_of`."""
    count, turned = block_rows(scene.effects, False), scene.body.is_turned
    rows, axes = (count + 4, count) if turned else (count, None)
    return tangents_at_start(scene.model, 7, first, members, True, rows, names, axes)


def differences(make, given, name):
    """The derivative of `rows_of` by central differences of order 6."""
    h = 1e-3 * max(abs(given[name]), 0.05)
    weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
    total = 0.0
    for k, weight in weights.items():
        ahead, back = (
            rows_of(make(Numbers(given | {name: given[name] + sign * k * h}))) for sign in (1, -1)
        )
        total = total + weight * (ahead - back) / h
    return total


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_differences(name):
    case = CASES[name]
    scene = case.make(case.given)
    names = list(case.given)
    assert set(names) <= set(parameter_names_of_derivatives(scene))
    found, size = tangents(scene, names), np.abs(rows_of(scene)).max(1)
    for parameter, one in zip(names, found, strict=True):
        true = differences(case.make, case.given, parameter)
        scale = np.maximum(size / max(abs(case.given[parameter]), 0.05), np.abs(true).max(1))
        error = np.abs(one - true).max(1) / np.maximum(scale, 1e-3)
        assert np.abs(one).max() > 0.0, parameter
        print(parameter, error.max())
        assert error.max() < case.error, parameter
