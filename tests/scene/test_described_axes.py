"""The axes in which a body is described are its axes, in all that a scene says and a result shows.

The truth is Euler's equations with the full tensor, by scipy (`tests.physics.effects.laws`).
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.physics.effects import name_of
from rigidmc.protocols import (
    conjugate,
    cross,
    described,
    described_attitude,
    effect,
    event,
    into_body,
    observable,
    scale,
    vertical,
)
from tests.physics.effects.laws import Motion, Properties, anomaly
from tests.tools.reference import moved

END, DT = 3.0, 0.01
START = {"omega": (0.9, -1.3, 0.7), "attitude": (0.7, -0.1, 0.5, 0.5)}
MU, DISTANCE, ECCENTRICITY, ANOMALY = 2.0, 1.3, 0.2, 0.5


def turned(moments, rotation):
    """A tensor (3, 3) with these moments about the columns of a rotation."""
    a = rotation.as_matrix()
    tensor = a @ np.diag(moments) @ a.T
    return 0.5 * (tensor + tensor.T)


LARGE = turned((1.0, 1.6, 2.1), Rotation.from_euler("ZYX", (0.9, -0.6, 1.7)))
SMALL = [[2.0, 1e-9, 0.0], [1e-9, 1.5, 0.0], [0.0, 0.0, 1.2]]
ALIKE = turned((2.0, 2.0, 1.2), Rotation.from_rotvec((0.5, 0.4, -0.9)))
NEARLY = turned((1.5, 1.5 + 3e-13, 2.2), Rotation.from_rotvec((0.3, -1.0, 0.2)))
HALF_TURN = Rotation.from_rotvec(math.pi * np.array([0.6, 0.0, 0.8])).as_matrix()
FAR_TURN = Rotation.from_rotvec(3.0 * np.array([2.0, -1.0, 2.0]) / 3.0).as_matrix()
MASSES = np.array([0.5, 0.7, 0.4, 0.9, 0.3])
PLACES = np.array(
    [[1, 0.2, 0], [-0.4, 0.9, 0.3], [0.1, -0.8, 0.9], [0.3, 0.2, -0.8], [-0.9, -0.2, 0.4]]
)


def particles():
    each = zip(MASSES, PLACES, strict=True)
    tensor = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in each)
    mass = MASSES.sum()
    return rm.Body.from_particles(MASSES, PLACES), tensor, mass, MASSES @ PLACES / mass


def mesh():
    """A box as a mesh, turned and with a pivot off its centre of mass."""
    a = Rotation.from_euler("xyz", (0.4, 0.7, -0.3)).as_matrix()
    size, pivot = np.array([1.0, 1.4, 0.6]), np.array([0.2, 0.1, -0.1])
    trimesh = pytest.importorskip("trimesh")
    place = np.block([[a, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    box = trimesh.creation.box(size, place)
    body = rm.Body.from_mesh(box, mass=3.0).with_pivot(pivot)
    own = 3.0 / 12.0 * (size @ size - size**2)
    return body, moved(a @ np.diag(own) @ a.T, 3.0, -pivot), 3.0, -pivot


def joined():
    turn, at = Rotation.from_rotvec((0.3, 0.5, 0.2)), np.array([0.2, 0.5, 0.3])
    size = np.array([0.4, 0.6, 1.0])
    body = rm.Body.cylinder(2.0, 0.5, 1.0).join(rm.Body.box(1.5, tuple(size)), tuple(at), turn)
    cylinder = 2.0 * np.diag([0.25 / 4 + 1 / 12, 0.25 / 4 + 1 / 12, 0.25 / 2])
    a = turn.as_matrix()
    box = a @ np.diag(1.5 / 12.0 * (size @ size - size**2)) @ a.T
    return body, cylinder + moved(box, 1.5, at), 3.5, 1.5 * at / 3.5


def of_tensor(tensor, mass=1.0, centre=(0.0, 0.0, 0.0)):
    return rm.Body.from_tensor(tensor, mass, centre), tensor, mass, centre


def of_moments(axes, moments=(1.2, 2.0, 1.7), centre=(0.1, 0.05, -0.1)):
    body = rm.Body(moments, 1.4, centre, tuple(map(tuple, axes.tolist())))
    return body, axes @ np.diag(moments) @ axes.T, 1.4, centre


# {name: (body, tensor, mass, centre)} in the described axes
BODIES = {
    "large products": lambda: of_tensor(LARGE, 2.0, (0.1, -0.05, 0.08)),
    "product 1e-9": lambda: of_tensor(SMALL, 2.0, (0.1, -0.05, 0.08)),
    "equal moments": lambda: of_tensor(ALIKE, 1.5, (0.0, 0.1, 0.05)),
    "nearly equal": lambda: of_tensor(NEARLY, 1.5, (0.0, 0.1, 0.05)),
    "diagonal": lambda: of_tensor(np.diag([2.0, 1.5, 1.2]), 2.0, (0.1, -0.05, 0.08)),
    "sphere": lambda: of_tensor(1.5 * np.eye(3), 1.0, (0.05, 0.1, -0.1)),
    "particles": particles,
    "mesh": mesh,
    "joined": joined,
    "half turn": lambda: of_moments(HALF_TURN),
    "far turn": lambda: of_moments(FAR_TURN),
}
PRODUCT_SPREAD = 0.02
LAW = rm.UncertainInertia(LARGE, PRODUCT_SPREAD**2 * np.eye(6))
UNCERTAIN = rm.Body.from_tensor(LAW, 2.0, (0.1, -0.05, 0.08))

WHEEL = rm.Rotor((0.2, -0.1, 0.3), (0.02, 0.01, -0.03))
FIELD, DIPOLE, RATE = (0.2, 0.5, -0.3), (0.3, -0.4, 0.25), 1.1
MATRIX, LINEAR = (0.1, 0.05, 0.2, 0.02, -0.01, 0.03), (0.2, -0.1, 0.3)
QUADRATIC = (0.2, 0.5, -0.3, 0.1, 0.25, -0.15)
ON_ORBIT = {"mu": MU, "distance": DISTANCE, "eccentricity": ECCENTRICITY, "anomaly": ANOMALY}

EFFECTS = {
    "free": (),
    "gravity": (rm.Gravity(3.0),),
    "gravity_gradient": (rm.GravityGradient(**ON_ORBIT),),
    "spring": (rm.Spring(0.8, at=(0.1, 0.2, 0.3), to=(0.1, 0.0, 1.0), length=0.3),),
    "uniform_field": (rm.UniformField(DIPOLE, FIELD),),
    "rotating_field": (rm.RotatingField(DIPOLE, FIELD, RATE),),
    "potential": (rm.Potential(LINEAR, QUADRATIC),),
    "moving_pivot": (rm.MovingPivot((0.1, -0.05, 0.2), 3.0, 0.4),),
    "body_torque": (rm.BodyTorque((0.1, -0.2, 0.05)),),
    "space_torque": (rm.SpaceTorque((0.1, -0.2, 0.05)),),
    "periodic_torque": (rm.PeriodicTorque((0.3, -0.2, 0.1), 2.0, 0.7),),
    "rotor": (WHEEL,),
    "viscous_damping": (rm.ViscousDamping(0.2),),
    "matrix_damping": (rm.MatrixDamping(MATRIX),),
    "quadratic_drag": (rm.QuadraticDrag(0.1),),
    "dry_friction": (rm.DryFriction(0.2, 0.1),),
    "energy_dissipation": (WHEEL, rm.EnergyDissipation(0.1)),
    "internal_dissipation": (WHEEL, rm.InternalDissipation(0.1)),
}


def effects_of(*names):
    return tuple(effect for name in names for effect in EFFECTS[name])


GROUND = effects_of(
    "gravity", "spring", "uniform_field", "body_torque", "periodic_torque", "rotor",
    "matrix_damping", "potential",
)  # fmt: skip
ORBIT = effects_of("gravity_gradient", "rotating_field", "energy_dissipation")


def motion_of(body, effects, end=END, points=4001):
    named = [(name_of(effect), effect) for effect in effects]
    return Motion(body, named, START["omega"], START["attitude"], end, points)


def outward(t, ahead=0.0):
    """The direction from the central body outward, or along the track, in space."""
    nu = anomaly(MU, DISTANCE, ECCENTRICITY, ANOMALY, t)[1] + ahead
    return math.cos(nu), math.sin(nu), 0.0


def field(t):
    c, s = math.cos(RATE * t), math.sin(RATE * t)
    return c * FIELD[0] - s * FIELD[1], s * FIELD[0] + c * FIELD[1], FIELD[2]


# directions in space: (of the package, of the truth)
EVERYWHERE = ("vertical", "vertical"), ("momentum", "momentum"), ((1.0, 2.0, -1.0),) * 2
IN_FIELD = (("field", FIELD),)
IN_ORBIT = (
    ("field", field),
    ("local_vertical", outward),
    ("along_track", lambda t: outward(t, math.pi / 2)),
    ("orbit_normal", "vertical"),
)
AXES = np.vstack([np.eye(3), -np.eye(3)])
SLANTED = (0.3, 0.2, 0.5)
COMPONENTS = ("omega", "momentum")
STATISTICS = ("min", "max", "mean", "variance", "last")


BROAD = {"mean": 8e-6, "variance": 2e-5}  # measured 3.5e-6, 1.1e-5: the rule of trapezes
ROUNDING = 2e-13  # of states and event times; measured 5.3e-14
FOUND = 2e-10  # of extremes within steps; measured 4.6e-11


def tolerance(name):
    how = name.rsplit("_", 1)[-1]
    return BROAD.get(how, FOUND if how in ("min", "max") else ROUNDING)


def check(errors, at=""):
    worst = {name: f"{error:.1e}" for name, error in errors.items()}
    print(at, worst)
    assert all(error <= tolerance(name) for name, error in errors.items()), (at, worst)


def observables(directions, orbit):
    cones = [rm.Passage(1 + i % 3, 0.8, about=a) for i, (a, _) in enumerate(directions)]
    cones += [rm.Passage(-1 - i % 3, 1.2, about=a) for i, (a, _) in enumerate(directions[:2])]
    angles = [rm.PointingAngle(SLANTED, about=a) for a, _ in directions]
    flips = [rm.Flips(axis, 1.2) for axis in (1, 2, 3)]
    counts = [rm.Histogram("omega[1]", -2.0, 2.0, 20), rm.Histogram("momentum[2]", -4.0, 4.0, 20)]
    return (*cones, *angles, *flips, *counts, *([rm.OrbitAngles((2, -3, -1))] if orbit else ()))


def simulated(body, effects, directions=EVERYWHERE, orbit=False, **more):
    seen = observables(directions, orbit)
    scene = rm.Scene(body, effects, rm.Start(**START), observables=seen)
    saved = ["omega", "momentum", "attitude", "energy", "nutation", "precession"]
    saved += [f"{name}_{how}" for name in COMPONENTS for how in STATISTICS]
    saved += ["pointing_angle_min", "pointing_angle_max"] + (["work"] if effects else [])
    defaults = {"integrator": "rk8", "dt": DT, "t_end": END, "every": 0.1, "members": 1}
    return rm.simulate(scene, save=tuple(saved) + seen, **{**defaults, **more})


def size_of(x):
    return max(1.0, float(np.abs(x).max()))


def compare(ds, body, effects, directions=EVERYWHERE, orbit=False, member=0, turn=None):
    """{variable: error} of a member of a result, relative to 1 or to the largest value.

    turn : a rotation of the truth's axes, by which the comparison must fail"""
    if turn is not None:
        body = Properties(turn.T @ body.tensor @ turn, body.mass, turn.T @ body.centre)
    motion = motion_of(body, effects)
    one, found = ds.isel(member=member), {}

    def note(name, got, true, scale=1.0):
        kind = name.rstrip("0123456789_")
        error = float(np.nan_to_num(np.abs(np.subtract(got, true)), nan=np.inf).max()) / scale
        found[kind] = max(found.get(kind, 0.0), error)

    at = one.time.values
    y, last = motion.solution(at), motion.states[:, -1:]
    q, true = one.attitude.transpose("quat", "time").values, motion.attitude(y)
    note("attitude", q * np.sign((q * true).sum(0)), true)
    note("energy", one.energy.values, motion.energy(y), size_of(motion.energy(y)))
    if effects:
        order = one.effect.values.tolist()
        mine = [name_of(effect) for effect in effects]
        note("work", one.work.values[:, [order.index(w) for w in mine]].T, motion.work(y))
    for name in COMPONENTS:
        get = getattr(motion, name)
        note(name, one[name].transpose("axis", "time").values, get(y), size_of(get(y)))
        note(f"{name}_last", one[f"{name}_last"].values, get(last)[:, 0])
        whole = get(motion.states)
        mean = motion.mean(whole)
        note(f"{name}_mean", one[f"{name}_mean"].values, mean)
        variance = motion.mean((whole.T - mean).T ** 2)
        note(f"{name}_variance", one[f"{name}_variance"].values, variance)
        for k in range(3):
            low, high = motion.extremes(lambda t, y, k=k, get=get: get(y)[k])
            note(f"{name}_min", one[f"{name}_min"].values[k], low)
            note(f"{name}_max", one[f"{name}_max"].values[k], high)
    low, high = motion.extremes(motion.angle(AXES[2]))
    note("nutation_min", one.nutation_min, low)
    note("nutation_max", one.nutation_max, high)
    note("precession", one.precession, motion.turned())
    for i, (_, about) in enumerate(directions):
        angle = motion.angle(SLANTED, about)
        note("pointing_angle", one[labelled("pointing_angle", i)].values, angle(at, y))
        if i == 0:
            low, high = motion.extremes(angle)
            note("pointing_angle_min", one.pointing_angle_min, low)
            note("pointing_angle_max", one.pointing_angle_max, high)
    cones = [(i % 3, 0.8, a) for i, (_, a) in enumerate(directions)]
    cones += [(3 + i % 3, 1.2, a) for i, (_, a) in enumerate(directions[:2])]
    for i, (axis, opening, about) in enumerate(cones):
        times = motion.passages(AXES[axis], opening, about)
        note_events(note, one, ("passages", "passage_first", "passage_last"), i, times)
    for i in range(3):
        times = motion.flips(AXES[i], 1.2)
        note_events(note, one, ("flips", "flip_first", "flip_last"), i, times)
    if orbit:
        nu = np.array([anomaly(MU, DISTANCE, ECCENTRICITY, ANOMALY, t)[1] for t in at])
        roll, pitch, yaw = motion.orbit_angles(y, nu, (1, 2, 0), (1, -1, -1))
        got = one.orbit_angles.transpose("angle", "time").values
        apart = got - np.array([roll, pitch, yaw])
        note("orbit_angles", np.abs(np.angle(np.exp(1j * apart))), 0.0)
    for name, values, low, high in (
        ("histogram", motion.omega(y)[0], -2.0, 2.0),
        ("histogram_2", motion.momentum(y)[1], -4.0, 4.0),
    ):
        counts = [np.histogram([v], 20, (low, high))[0] for v in values]
        if ds.sizes["member"] == 1:
            note(name, ds[name].values, counts)
    return found


def labelled(name, i):
    return f"{name}_{i + 1}" if i else name


def note_events(note, one, names, i, times):
    count, first, last = (one[labelled(name, i)].item() for name in names)
    note(names[0], count, len(times))
    if times and count:
        note(names[1], first, times[0])
        note(names[2], last, times[-1])


def about_centre(tensor, mass, centre):
    return np.array(tensor) - moved(np.zeros((3, 3)), mass, centre)


def tensors(ds):
    turns = Rotation.from_quat(ds.principal_axes.transpose("member", "quat"), scalar_first=True)
    moments = ds.moments.transpose("member", "axis").values
    return [turned(m, a) for m, a in zip(moments, turns, strict=True)]


@pytest.mark.parametrize("name", BODIES)
def test_free_bodies_in_closed_form(name):
    """Closed forms need no kernel: every body, each observable of a free body at save times."""
    body, tensor, _, _ = BODIES[name]()
    scene = rm.Scene(body, start=rm.Start(**START), observables=(rm.PointingAngle(SLANTED),))
    saved = ("omega", "momentum", "attitude", "energy", "pointing_angle")
    ds = rm.simulate(scene, integrator="closed", dt=DT, t_end=1.0, every=0.5, members=1, save=saved)
    assert ("body_axes" in ds.attrs) == body.is_turned
    errors = states_apart(ds.isel(member=0), motion_of(Properties(tensor), (), 1.0, 11))
    assert max(errors.values()) < 1e-13, errors  # measured 5.7e-15
    one = np.array(tensor)
    if np.ptp(np.linalg.eigvalsh(one)) > 1e-9:  # a sphere is the same in any axes
        turn = Rotation.from_rotvec((0.2, 0.1, -0.3)).as_matrix()
        other = motion_of(Properties(turn.T @ one @ turn), (), 1.0, 11)
        assert min(states_apart(ds.isel(member=0), other).values()) > 1e-4


def turned_apart(one, true):
    q = one.attitude.transpose("quat", "time").values
    return np.abs(q * np.sign((q * true).sum(0)) - true).max()


def states_apart(one, motion):
    y = motion.solution(one.time.values)
    errors = {"attitude": turned_apart(one, motion.attitude(y))}
    for name in ("omega", "momentum"):
        if name in one:
            saved = one[name].transpose("axis", "time").values
            errors[name] = np.abs(saved - getattr(motion, name)(y)).max()
    return errors


def own_bodies(ds):
    centres = ds.centre.broadcast_like(ds.moments).transpose("member", "axis").values
    masses = ds.mass.broadcast_like(ds.status).values
    each = zip(tensors(ds), masses, centres, strict=True)
    return [Properties(tensor, mass, centre) for tensor, mass, centre in each]


def test_rates_along_principal_axes_are_refused():
    body = rm.Body.from_tensor(LARGE)
    for refused, at in (
        (rm.AxialDamping((0.1, 0.2, 0.3)), "effects.axial_damping.rates"),
        (rm.Potential(LINEAR, quartic=(0.1, 0.0, 0.0)), "effects.potential.quartic"),
    ):
        with pytest.raises(rm.SceneError, match="one number for each principal axis") as error:
            rm.simulate(rm.Scene(body, refused, rm.Start(**START)), dt=DT, t_end=END, members=1)
        assert error.value.at == at
    principal = rm.Body.from_tensor(LARGE, axes="principal")
    for one in (principal, rm.Body((1.0, 1.6, 2.1))):
        rm.prepare(rm.Scene(one, rm.AxialDamping((0.1, 0.2, 0.3)), rm.Start(**START)), dt=DT)


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_all_observables_of_a_body_on_the_ground(name):
    """Eight effects at once, every observable; truth in other axes fails."""
    body, *known = BODIES[name]()
    directions = EVERYWHERE + IN_FIELD
    ds = simulated(body, GROUND, directions)
    errors = compare(ds, Properties(*known), GROUND, directions)
    check(errors, name)
    if name == "large products":
        turn = Rotation.from_matrix(np.array(body.axes)).as_matrix()
        for wrong in (turn, turn.T):
            apart = compare(ds, Properties(*known), GROUND, directions, turn=wrong)
            assert apart["omega"] > 0.1 and apart["attitude"] > 0.1 and apart["omega_max"] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_all_observables_of_a_body_on_an_orbit(name):
    """A satellite with a wheel, a dipole and loss; every direction, roll, pitch and yaw."""
    body, tensor, mass, centre = BODIES[name]()
    directions = EVERYWHERE + IN_ORBIT
    satellite = body.with_pivot_at_centre()
    ds = simulated(satellite, ORBIT, directions, orbit=True)
    truth = Properties(about_centre(tensor, mass, centre), mass)
    check(compare(ds, truth, ORBIT, directions, orbit=True), name)


@pytest.mark.slow
def test_all_observables_of_uncertain_bodies():
    directions = EVERYWHERE + IN_FIELD
    ds = simulated(UNCERTAIN, GROUND, directions, members=3)
    for member, truth in enumerate(own_bodies(ds)):
        check(compare(ds, truth, GROUND, directions, member=member), member)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*has no effect")  # a sphere dissipates nothing
@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect(name):
    worst, effects = {}, EFFECTS[name]
    for body_name, make in BODIES.items():
        body, tensor, mass, centre = make()
        if name == "gravity_gradient":
            body, tensor, centre = (
                body.with_pivot_at_centre(), about_centre(tensor, mass, centre), (0.0, 0.0, 0.0),
            )  # fmt: skip
        scene = rm.Scene(body, effects, rm.Start(**START))
        settings = {"dt": DT, "t_end": END, "every": 0.5, "members": 1, "checks": False}
        ds = rm.simulate(scene, integrator="rk8", save=("omega", "attitude"), **settings)
        motion = motion_of(Properties(tensor, mass, centre), effects, points=11)
        worst[body_name] = max(states_apart(ds.isel(member=0), motion).values())
    print(name, {body: f"{error:.1e}" for body, error in worst.items()})
    assert max(worst.values()) < 1e-12, worst


@pytest.mark.slow
def test_products_of_1e_9():
    """A product of inertia of 1e-9 changes nothing by more than 1e-8."""
    tensors = [np.diag([2.0, 1.5, 1.2]), np.diag([1.5, 1.5, 2.2]), np.diag([1.5, 1.5, 1.5])]
    directions = EVERYWHERE + IN_FIELD
    for tensor in tensors:
        results = []
        for x in (0.0, 1e-9, -1e-9):
            given = tensor + x * np.array([[0, 1, 0.5], [1, 0, -1], [0.5, -1, 0]])
            body = rm.Body.from_tensor(given, 2.0, (0.1, -0.05, 0.08))
            results.append(simulated(body, GROUND, directions))
        for name in results[0].data_vars:
            if name in ("moments", "drift_law", "energy_drift_max"):
                continue
            one, *others = (ds[name].values.astype(float) for ds in results)
            for other in others:
                np.testing.assert_allclose(other, one, rtol=0, atol=1e-8, err_msg=name)


@observable(units="m", long_name="height of a point up the principal axis 3", dims=())
class Height(NamedTuple):
    at: float

    def value(self, q):
        return (self.at * vertical(q)[2],)


@observable(units="m", long_name="height of a point up axis 3", dims=())
class Tall(NamedTuple):
    at: float

    def value(self, body, q):
        return (self.at * described(body, vertical(q))[2],)


@observable(units="1", long_name="the vertical in the body", dims=("axis",))
class Up(NamedTuple):
    def value(self, q):
        return vertical(q)


@observable(units="kg m2 s-1", long_name="momentum in space", dims=("axis",), in_body=())
class InSpace(NamedTuple):
    def value(self, q, l):
        return into_body(conjugate(q), l)


@event(outputs={"rises": ("1", "how often axis 3 came up through the horizontal", ())})
class Rises(NamedTuple):
    def level(self, body, q):
        return vertical(described_attitude(body, q))[2]

    def results(self, record):
        return {"rises": record.count}


@effect(units={"stiffness": "N m"})
class Torsion(NamedTuple):
    stiffness: float

    def torque(self, q):
        return scale(self.stiffness, cross((1.0, 0.0, 0.0), into_body(q, (1.0, 0.0, 0.0))))


OWN = (Height(1.0), Tall(1.0), Up(), InSpace(), Rises())


def test_custom_parts_say_what_they_turn():
    """A note names those that take the state and state nothing; no note if there is no turn."""
    for body, counts in (
        (rm.Body.from_tensor(LARGE), {"height": 1, "up": 1, "Torsion": 1}),
        (rm.Body.from_tensor(LARGE, axes="principal"), {}),
        (rm.Body((1.0, 1.6, 2.1)), {}),
    ):
        scene = rm.Scene(body, Torsion(0.1), rm.Start(**START), observables=OWN)
        notes = rm.prepare(scene, dt=DT, t_end=END, save=("tall",)).notes
        for name in ("height", "tall", "up", "in_space", "rises", "Torsion"):
            assert sum(f".{name}]" in note for note in notes) == counts.get(name, 0), name


@pytest.mark.parametrize(
    ("dims", "in_body"), [((), ("at",)), ((), ("value",)), (("quat",), "value")]
)
def test_what_an_observable_may_state(dims, in_body):
    def value(self, q):
        return (self.at,)

    kind = type("Own", (), {"at": 1.0, "value": value})
    with pytest.raises(TypeError, match="in_body"):
        observable(units="1", long_name="own", dims=dims, in_body=in_body)(kind)


@pytest.mark.slow
def test_custom_observables_in_described_axes():
    """By hand from the saved attitudes and momenta; principal axis 3 is another."""
    body, *_ = BODIES["large products"]()
    scene = rm.Scene(body, rm.Gravity(3.0), rm.Start(**START))
    saved = ("attitude", "momentum", *OWN)
    with pytest.warns(rm.SceneWarning, match="principal axes of each member"):
        ds = rm.simulate(scene, "rk4", dt=DT, t_end=END, every=DT, members=1, save=saved)
    one = ds.isel(member=0).transpose(..., "axis", "time", "quat")
    a = Rotation.from_quat(one.attitude.values, scalar_first=True).as_matrix()
    assert np.abs(one.tall.values - a[:, 2, 2]).max() < 1e-14  # measured 5.6e-16
    assert np.abs(one.height.values - a[:, 2, 2]).max() > 0.1  # measured 0.5
    assert np.abs(one.up.values - a[:, 2, :].T).max() < 1e-14  # measured 5.6e-16
    momentum = np.einsum("tij,jt->it", a, one.momentum.values)
    assert np.abs(one.in_space.values - momentum).max() < 1e-13  # measured 2.7e-15
    up = a[:, 2, 2] >= 0.0
    assert one.rises.item() == up[0] + (up[1:] & ~up[:-1]).sum()  # a start above counts


def test_a_tensor_that_hardly_determines_its_axes_says_so():
    tensor = np.diag([2.0, 2.0, 3.0]) + 1e-9 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]])
    start = rm.Start(omega=(0.1, 0.2, 1.0))
    run = {"dt": 0.1, "t_end": 0.1, "members": 1}
    rm.simulate(rm.Scene(rm.Body.from_tensor(tensor), start=start), **run)  # no note
    asked = rm.Scene(rm.Body.from_tensor(tensor, axes="principal"), start=start)
    for scene, save in (
        (asked, "omega"),
        (replace(asked, body=rm.Body.from_tensor(tensor)), "principal_omega"),
    ):
        with pytest.warns(rm.SceneWarning, match="determine the principal axes 1 and 2"):
            rm.simulate(scene, save=(save,), **run)
