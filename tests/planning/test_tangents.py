"""Derivatives of members at their start, against differences of members that are built anew.

The members of scenes with other numbers come from the plain code. Differences of order 6 of them
have an error of about 1e-13 of the numbers over the step.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.dual_arrays import zeros
from rigidmc.planning.initial import block_rows, initial_block, rows_to_fill
from rigidmc.planning.tangents import build_with_tangents, tangents_at_start
from rigidmc.planning.unit_scale import scale_scene, unit_factor
from rigidmc.scene.derivatives import parameter_names_of_derivatives, seeds_of
from rigidmc.scene.parameters import unit_at
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

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
SIX = {"1.1": 2.0, "2.2": 2.5, "3.3": 3.1, "2.3": 0.2, "1.3": -0.1, "1.2": 0.3}
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
            key: v[f"{word}.{key}"] if f"{word}.{key}" in v else v.three(f"{word}.{key}")
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


def uncertain(size, turns):
    """A body with an uncertain tensor; turns : whether it rotates about its centre of mass."""

    def make(v):
        mean = v.symmetric("body.tensor.mean")
        covariance = v.symmetric("body.tensor.covariance", size)
        centre = v.three("body.tensor.centre") if turns else None
        tensor = rm.UncertainInertia(mean, covariance, centre)
        centre = (0.0, 0.0, 0.0) if turns else v.three("body.centre")
        body = rm.Body.from_tensor(tensor, v["body.mass"], centre)
        start = rm.Start(omega=(0.4, -1.1, 0.8), attitude=(0.3, 0.7, -2.1))
        return rm.Scene(body, rm.Gravity(9.81), start=start)

    return make


def tensor_rows(v):
    rows = np.array([v.symmetric("body.tensor")] * MEMBERS)
    body = rm.Body.from_tensor(rm.TensorRows(rows, np.diag([2.0, 2.5, 3.1])), 0.7, (0.1, 0.0, 0.2))
    return rm.Scene(body, rm.Gravity(9.81), start=rm.Start(omega=(0.4, -1.1, 0.8)))


def gravity(v):
    return rm.Gravity(v["effects.gravity.g"])


def field(v):
    mean = v.three("effects.uniform_field.dipole.mean")
    covariance = v.symmetric("effects.uniform_field.dipole.covariance")
    return rm.UniformField(rm.Correlated(mean, covariance), (0.1, 0.2, 0.3))


def plain_scene(**start):
    body = rm.Body.from_moments((2.0, 2.0, 2.0), 0.5, (0.0, 0.0, 0.3))
    return rm.Scene(body, rm.Gravity(9.81), start=rm.Start(**start))


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
    "pointing": Case(
        lambda v: plain_scene(
            omega=(0.1, 0.2, 0.3),
            attitude=rm.Pointing(v.three("start.attitude.direction"), v["start.attitude.kappa"]),
        ),
        numbers(start__attitude__direction=[0.3, -0.5, 0.7], start__attitude__kappa=4.0),
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
    "uncertain tensor": Case(
        uncertain(6, False),
        numbers(
            body__tensor__mean=SIX, body__tensor__covariance={f"{i}.{i}": 1e-3 for i in range(1, 7)}
            | {"1.2": 3e-4}, body__mass=1.4, body__centre=[0.1, 0.2, -0.1],
        ),
    ),
    "uncertain satellite": Case(
        uncertain(10, True),
        numbers(
            body__tensor__mean=SIX,
            body__tensor__covariance={f"{i}.{i}": 1e-4 for i in range(1, 11)} | {"3.9": 3e-5},
            body__tensor__centre=[0.1, 0.2, -0.1], body__mass=1.4,
        ),
    ),
    "tensor rows": Case(tensor_rows, numbers(body__tensor=SIX)),
    "box off its axes": Case(
        solid("box", (0.2, -0.1, 0.3)),
        numbers(body__box__mass=2.0, body__box__size=[0.5, 0.7, 1.1]),
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
    out = np.zeros((len(names), rows, members))
    tangents_at_start(scene.model, 7, np.arange(first, first + members), names, out, axes=axes)
    return out


def by_differences(value, h):
    """The derivative at 0 of a function of a number by central differences of order 6."""
    weights = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}
    return sum(weight * (value(k * h) - value(-k * h)) / h for k, weight in weights.items())


def differences(make, given, name):
    """The derivative of `rows_of`."""
    return by_differences(
        lambda by: rows_of(make(Numbers(given | {name: given[name] + by}))), 1e-3 * abs(given[name])
    )


# each of these takes 1 to 6 s
LONG = ("drawn", "uncertain tensor", "correlated", "described", "orbit", "uncertain satellite")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in CASES]
)
def test_derivatives_are_those_of_differences(name):
    case = CASES[name]
    scene = case.make(case.given)
    names = list(case.given)
    assert set(names) <= set(parameter_names_of_derivatives(scene.model))
    found, size = tangents(scene, names), np.abs(rows_of(scene)).max(1)
    for parameter, one in zip(names, found, strict=True):
        true = differences(case.make, case.given, parameter)
        scale = np.maximum(size / abs(case.given[parameter]), np.abs(true).max(1))
        error = np.abs(one - true).max(1) / np.maximum(scale, 1e-3)
        assert np.abs(one).max() > 0.0, parameter
        print(parameter, error.max())
        assert error.max() < case.error, parameter


@pytest.mark.parametrize("name", CASES)
def test_values_keep_their_bits(name):
    scene = CASES[name].make(CASES[name].given)
    rows = block_rows(scene.effects, False)
    plain, start = initial_block(scene.model, 7, 3, MEMBERS, True, rows)
    names = parameter_names_of_derivatives(scene.model)
    block = zeros((rows, MEMBERS), len(names))
    others = build_with_tangents(block, scene.model, 7, 3, True, names)
    assert np.array_equal(block.value.view(np.uint64), plain.view(np.uint64))
    assert start.keys() <= others.keys()
    assert np.isfinite(block.tangents).all()
    for key, value in start.items():
        assert np.array_equal(getattr(others[key], "value", others[key]), value), key
    attitude = slice(layout.ATTITUDE, layout.MOMENTUM)
    norm = (block.tangents[:, attitude] * plain[attitude]).sum(1)
    # measured 3e-16 of the largest tangent
    assert np.abs(norm).max() < 2e-15 * (1.0 + np.abs(block.tangents[:, attitude]).max())


@pytest.mark.parametrize("name", CASES)
def test_tangents_change_with_the_units_as_parameters_and_rows_do(name):
    scene = CASES[name].make(CASES[name].given)
    factors = {"mass": 0.5, "length": 2.0**10, "time": 2.0**-3}
    scaled = scale_scene(scene, **factors)
    names = parameter_names_of_derivatives(scene.model)
    assert parameter_names_of_derivatives(scaled.model) == names
    momentum, body = slice(layout.MOMENTUM, layout.EXTRA), slice(layout.BODY, layout.BODY + 6)
    units = ((slice(0, 4), "1"), (momentum, "kg m2 s-1"), (body, "kg-1 m-2"))
    for parameter, here, there in zip(
        names, tangents(scene, names), tangents(scaled, names), strict=True
    ):
        by = 1.0 / unit_factor(unit_at(scene.model, parameter), **factors)
        for rows, unit in units:
            known = here[rows] * unit_factor(unit, **factors) * by
            # measured 3e-12, of the small change of an uncertain tensor by its mass
            assert np.abs(there[rows] - known).max() <= 1e-11 * np.abs(known).max(), parameter


def test_tangents_fill_a_given_array():
    scene = CASES["drawn"].make(CASES["drawn"].given)
    names = parameter_names_of_derivatives(scene.model)
    rows, known = block_rows(scene.effects, False), tangents(scene, names)
    given = np.full_like(known, 7.0)
    tangents_at_start(scene.model, 7, np.arange(MEMBERS), names, given)
    filled = np.zeros(rows, bool)
    for part in rows_to_fill(scene.effects):
        filled[part] = True
    assert np.array_equal(given[:, filled], known[:, filled]) and (given[:, ~filled] == 7.0).all()


@pytest.mark.parametrize("name", ["drawn", "uncertain tensor", "gibbs"])
def test_a_member_has_the_same_tangents_in_any_block(name):
    scene = CASES[name].make(CASES[name].given)
    names = parameter_names_of_derivatives(scene.model)
    whole = tangents(scene, names, 7)
    for first in (2, 5):
        part = tangents(scene, names, 7 - first, first)
        assert np.array_equal(part, whole[:, :, first:])
    rows = block_rows(scene.effects, False)
    members = np.array([5, 6, 1, 2, 600, 602])
    some = np.zeros((len(names), rows, members.size))
    tangents_at_start(scene.model, 7, members, names, some)
    assert np.array_equal(some[:, :, :4], whole[:, :rows, members[:4]])


def test_a_sphere_at_rest_upright():
    scene = plain_scene(omega=(0.0, 0.0, 0.0), attitude=(0.0, 0.0, 0.0))
    names = ["body.moments.3", "start.omega.1", "start.attitude.theta", "body.centre.3"]
    moment, omega, theta, centre = tangents(scene, names, 1)[:, :, 0]
    body = np.zeros(9)
    body[[2, 3, 4]] = -0.25, -0.25, 0.25  # 1/I3, (I2 - I3)/(I2 I3), (I3 - I1)/(I3 I1)
    assert np.array_equal(moment[layout.BODY : layout.EFFECTS], body)
    assert not moment[: layout.EXTRA].any()
    assert omega[: layout.EXTRA].tolist() == [0.0] * 4 + [2.0, 0.0, 0.0]
    assert theta[: layout.EXTRA].tolist() == [0.0, 0.5] + [0.0] * 5
    assert centre[layout.BODY + 8] == 0.5


def test_vectors_of_length_0_have_the_derivative_by_their_length():
    for kind in (rm.Sphere(0.0), rm.Cone(3, 0.0, 0.1, 0.2)):
        unit = rm.Sphere(1.0) if isinstance(kind, rm.Sphere) else rm.Cone(3, 1.0, 0.1, 0.2)
        known = rows_of(plain_scene(momentum=unit))[layout.MOMENTUM : layout.EXTRA]
        (found,) = tangents(plain_scene(momentum=kind), ["start.momentum.size"])
        assert np.array_equal(found[layout.MOMENTUM : layout.EXTRA], known)


def test_the_concentration_0_of_directions():
    near, at = (plain_scene(omega=(0.1, 0.2, 0.3), attitude=rm.Pointing((1.0, 1.0, 1.0), k))
                for k in (1e-6, 0.0))  # fmt: skip
    (one,), (other,) = (tangents(scene, ["start.attitude.kappa"]) for scene in (near, at))
    assert np.abs(one - other)[:4].max() < 1e-6  # measured 3e-8


def test_rows_and_varied_numbers_have_the_derivatives_of_each_member():
    table = np.array([1.0, -2.0, 3.0, 0.5, 0.1])
    quaternion = np.array([[1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.8, 0.0]] * 2 + [[0.5] * 4])
    scene = plain_scene(omega=(table, 1.0, 2.0), attitude=quaternion)
    names = ["start.omega.1", "start.attitude.3", "body.mass"]
    omega, third, mass = tangents(scene, names)
    assert np.array_equal(omega[layout.MOMENTUM], np.full(5, 2.0))
    q = quaternion.T
    assert np.allclose(third[:4], np.eye(4)[:, 2:3] - q * q[2], rtol=0.0, atol=1e-15)
    assert np.array_equal(mass[layout.BODY + 8], np.full(5, 0.3))


def test_impossible_members_have_tangents_and_no_derivative_of_their_status():
    wide = rm.Correlated((1.0, 1.0, 1.9), np.diag([0.01, 0.01, 0.01]))
    scene = rm.Scene(rm.Body.from_moments(wide), start=rm.Start(omega=(0.0, 0.0, 1.0)))
    status = rows_of(scene, 40)[layout.STATUS]
    assert 0 < np.count_nonzero(status) < 40
    found = tangents(scene, ["body.moments.mean.3", "body.moments.3", "start.omega.3"], 40)
    assert np.isfinite(found).all() and not found[:, layout.STATUS].any()
    assert np.array_equal(found[0], found[1])


EQUAL = [[2.0, 0.2, 0.0], [0.2, 2.3, 0.0], [0.0, 0.0, 2.4]]  # moments 1.9, 2.4, 2.4


def test_equal_moments_are_refused_where_the_axes_jump():
    scene = rm.Scene(rm.Body.from_tensor(EQUAL), start=rm.Start(omega=(0.1, 0.2, 1.0)))
    for name in ("body.tensor.2.3", "body.tensor.1.3"):
        with pytest.raises(SceneError, match="equal moments"):
            seeds_of(scene.model, [name])
    named = dict(zip(("1.1", "1.2", "3.3"), range(3), strict=True))
    found = tangents(scene, [f"body.tensor.{key}" for key in named])
    known = Numbers({"a.1.1": 2.0, "a.1.2": 0.2, "a.2.2": 2.3, "a.3.3": 2.4})

    def make(v):
        return rm.Scene(rm.Body.from_tensor(v.symmetric("a")), start=scene.start)

    for key, place in named.items():
        true = differences(make, known, f"a.{key}")
        assert np.abs(found[place] - true).max() < 2e-11, key  # measured 2e-12


def test_rows_with_equal_moments_give_nan_for_these_members_alone():
    rows = np.array([np.diag([2.0, 2.5, 3.0]), EQUAL])
    scene = rm.Scene(rm.Body.from_tensor(rows), start=rm.Start(omega=(0.1, 0.2, 1.0)))
    found = tangents(scene, ["body.tensor.2.3", "start.omega.1"], 2)
    assert np.isfinite(found[1]).all() and np.isfinite(found[0, :, 0]).all()
    assert np.isnan(found[0, : layout.MOMENTUM, 1]).all()


def refusals():
    ensemble = {"momentum": rm.GibbsMomentum(0.4), "attitude": "ensemble"}
    mixed = rm.mixture((1.0, rm.normal(0.0, 1.0)), (2.0, rm.uniform(0.0, 1.0)))
    turned = {"omega": (mixed, rm.distribution("gamma", a=2.0), rm.grid(0.0, 1.0, 3))}
    yield plain_scene(**ensemble), "effects.gravity.g", "rejection"
    yield plain_scene(**ensemble), "body.centre.3", "rejection"
    yield plain_scene(**ensemble), "start.momentum.kT", "rejection"
    yield plain_scene(**turned), "start.omega.1.2.weight", "jump"
    yield plain_scene(**turned), "start.omega.2.a", "shape parameter of gamma"
    yield plain_scene(**turned), "start.omega.3.count", "integer"
    yield plain_scene(**turned), "start.omga.1", "did you mean 'start.omega.1'"
    yield plain_scene(**turned), "body.cylinder.radius", "no such parameter"
    attitude = rm.Pointing((0.0, 0.0, 1.0), 5.0)
    yield plain_scene(omega=rm.Cone(3, 1.0, 0.1), attitude=attitude), "start.omega.axis", "integer"
    yield (
        plain_scene(omega=(1.0, 0.0, 0.0), attitude=attitude),
        "start.attitude.direction.1",
        "jump",
    )
    fisher = rm.Fisher((1.0, 0.0, 0.0, 0.0), 5.0)
    yield plain_scene(omega=rm.Sphere(1.0), attitude=fisher), "start.attitude.kappa", "table"


def test_what_has_no_derivative_is_refused_by_name():
    for scene, name, words in refusals():
        with pytest.raises(SceneError) as caught:
            seeds_of(scene.model, [name])
        assert words in str(caught.value), name
        assert name in str(caught.value) and "wrt" in str(caught.value), name
    with pytest.raises(SceneError, match="twice"):
        seeds_of(plain_scene(omega=(0.0, 0.0, 1.0)).model, ["body.mass", "body.mass"])


def test_an_ensemble_has_derivatives_by_what_no_attitude_depends_on():
    scene = plain_scene(momentum=rm.GibbsMomentum(0.4), attitude="ensemble")
    known = rows_of(scene)[layout.MOMENTUM]
    by_moment, by_own = tangents(scene, ["body.moments.1", "start.momentum.1"])
    assert not by_moment[: layout.MOMENTUM].any()
    assert np.allclose(by_moment[layout.MOMENTUM], known / 4.0, rtol=1e-15)  # L1 ~ sqrt(I1)
    assert np.array_equal(by_own[layout.MOMENTUM : layout.EXTRA], [[1.0] * 5, [0.0] * 5, [0.0] * 5])


def test_custom_code_that_would_lose_tangents_is_refused():
    @dataclass(frozen=True)
    class Plain(VectorDistribution):
        size: Any
        variables = ("omega",)

        def sample(self, sampler, name, first, count, facts):
            return np.full((3, count), float(self.size))

    scene = plain_scene(omega=Plain(2.0))
    with pytest.raises(SceneError, match="lose its tangents"):
        tangents(scene, ["start.omega.size"])
    (found,) = tangents(scene, ["start.omega.2"])
    assert found[layout.MOMENTUM : layout.EXTRA, 0].tolist() == [0.0, 2.0, 0.0]


def test_units_of_parameters():
    scenes = {name: case.make(case.given) for name, case in CASES.items()}
    units = {
        "heavy": {"body.moments.1": "kg m2", "effects.gravity.g": "m s-2", "body.mass": "kg",
                  "start.attitude.phi": "rad"},
        "described": {"body.tensor.1.2": "kg m2", "start.attitude.1": "1"},
        "drawn": {"start.omega.1.mean": "rad s-1", "start.attitude.psi.low": "rad"},
        "cone": {"start.omega.size.mean": "rad s-1", "start.omega.angle": "rad"},
        "correlated": {"start.momentum.covariance.1.2": "kg2 m4 s-2", "start.momentum.2":
                       "kg m2 s-1", "effects.uniform_field.dipole.covariance.1.1": "A2 m4"},
        "shell": {"start.momentum.energy": "J", "start.momentum.direction.1": "1"},
        "uncertain satellite": {"body.tensor.mean.1.1": "kg m2", "body.tensor.centre.1": "m",
                                "body.tensor.covariance.1.1": "kg2 m4",
                                "body.tensor.covariance.3.9": "kg m3",
                                "body.tensor.covariance.10.10": "kg2"},
        "box off its axes": {"body.box.mass": "kg", "body.box.size.1": "m"},
        "t_handle": {"body.t_handle.density": "kg m-3"},
    }  # fmt: skip
    for name, known in units.items():
        for parameter, unit in known.items():
            assert unit_at(scenes[name].model, parameter) == unit, parameter
