"""Poincare sections: the free body's period, scipy's orbits, a constant of motion, angles."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.studies.section import points
from rigidmc.studies.section.picture import section_points
from rigidmc.studies.section.points import crossing_of, period_of
from rigidmc.studies.section.study import table
from tests.tools.same import assert_same

BODY = rm.Body((1.0, 2.0, 2.5), mass=1.0, centre=(0.1, 0.0, 0.2))
FREE = rm.Scene(rm.Body((1.0, 2.0, 3.0)), start=rm.Start(omega=(1.0, 0.2, 0.1))).with_run(
    members=1, dt=0.05, integrator="rk8"
)


def straight(scene, name, row):
    """The first times at which a component rises through 0, by straight lines between saves."""
    ds = rm.simulate(scene.with_run(save=(name,), every=scene.run.dt))
    x, t = ds[name].values[:, row, 0], ds.time.values
    k = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return t[k] - x[k] * (t[k + 1] - t[k]) / (x[k + 1] - x[k])


def test_a_free_body_comes_back_after_its_period():
    """Landau & Lifshitz, Mechanics, 37.10, for a momentum about axis 1."""
    i1, i2, i3 = 1.0, 2.0, 3.0
    omega = np.array([1.0, 0.2, 0.1])
    i = np.array([i1, i2, i3])
    energy2, l2 = (i * omega**2).sum(), ((i * omega) ** 2).sum()
    rate = math.sqrt((i1 - i2) * (l2 - energy2 * i3) / (i1 * i2 * i3))
    m = (i2 - i3) * (energy2 * i1 - l2) / ((i1 - i2) * (l2 - energy2 * i3))
    period = 4.0 * ellipk(abs(m)) / rate
    found = rm.section(FREE, "omega[2] = 0", t_end=100.0)
    assert found.sizes["point"] == 9
    apart = np.diff(found.time.values)
    assert np.abs(apart / period - 1.0).max() < 1e-13  # measured 2e-15
    assert np.abs(found.omega.values[1]).max() < 1e-15  # measured 9e-18
    lines = np.diff(straight(FREE.with_run(t_end=100.0), "omega", 1))
    assert np.abs(lines / period - 1.0).max() > 1e-8  # measured 7e-8


def rotated(omega_dot, y0, crossing, t_end):
    """Times, by scipy's DOP853, at which crossing(t, y) rises through 0."""
    crossing.direction = 1.0
    run = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "events": crossing}
    found = solve_ivp(omega_dot, (0.0, t_end), y0, **run)
    return found.t_events[0], found.y_events[0]


def test_a_driven_body_crosses_when_scipy_says():
    """A torque with the time as an argument, and crossings in the middle of steps."""
    torque = rm.PeriodicTorque((0.0, 0.3, 0.2), frequency=1.7)
    scene = rm.Scene(rm.Body((1.0, 2.0, 3.0)), torque, rm.Start(omega=(1.0, 0.2, 0.1))).with_run(
        members=1, dt=0.05, t_end=30.0, integrator="rk8"
    )
    found = rm.section(scene, "momentum[2] = 0.1", way="falls")
    i = np.array([1.0, 2.0, 3.0])

    def rhs(t, l):
        return np.cross(l, l / i) + np.array((0.0, 0.3, 0.2)) * math.cos(1.7 * t)

    times, states = rotated(rhs, i * (1.0, 0.2, 0.1), lambda t, l: 0.1 - l[1], 30.0)
    assert len(times) == found.sizes["point"] >= 3
    assert np.abs(found.time.values - times).max() < 1e-11  # measured 2.4e-13
    assert np.abs(found.momentum.values.T - states).max() < 1e-12  # measured 3e-14


def test_seldom_looks_at_a_fast_torque_find_the_crossings():
    """The steps to a crossing go by the moments, in any unit, and by the steps of the run."""
    unit, push = 0.01, np.array((0.0, 3.0, 2.0))
    torque, i = rm.PeriodicTorque(tuple(unit * push), frequency=40.0), np.array([1.0, 2.0, 3.0])
    body = rm.Body(tuple(unit * i))
    scene = rm.Scene(body, torque, rm.Start(omega=(1.0, 0.2, 0.1))).with_run(
        members=1, dt=0.005, t_end=30.0, integrator="rk8"
    )
    found = rm.section(scene, "momentum[2] = 0.001", way="falls", every=0.2)

    def rhs(t, l):
        return np.cross(l, l / i) + push * math.cos(40.0 * t)

    times, _ = rotated(rhs, i * (1.0, 0.2, 0.1), lambda t, l: 0.1 - l[1], 30.0)
    near = np.abs(times[:, None] - found.time.values).min(axis=0)
    assert found.sizes["point"] >= 3 and found.attrs["lost"] == 0
    assert near.max() < 1e-12  # measured 4e-14; 1e-3 if steps go by the free motion alone
    norms = np.linalg.norm(found.attitude.values, axis=0)
    assert np.abs(norms - 1.0).max() < 1e-14  # measured 1.1e-16


def test_paths_that_do_not_converge_give_no_points(monkeypatch):
    scene = FREE.with_run(t_end=100.0)
    assert rm.section(scene, "omega[2] = 0").attrs["lost"] == 0
    monkeypatch.setattr(points, "FAIR", -1.0)
    found = rm.section(scene, "omega[2] = 0")
    assert found.sizes["point"] == 0 and found.attrs["lost"] == 9
    assert "9; save more often" in table(found)[-1]
    monkeypatch.setattr(points, "MOST", 0)
    with pytest.raises(OptionError, match="save more often"):
        rm.section(scene, "omega[2] = 0")


def test_hyperion_once_an_orbit():
    """The planar equation of Wisdom, Peale & Mignard, Icarus 58 (1984) 137, equation 1."""
    scene = rm.Scene.load("hyperion", [("start.attitude", "[0.4, 0.0, 0.0]")])
    scene = scene.with_run(members=1)
    pull = scene.effects[0]
    found = rm.section(scene, "every orbit", t_end=3e7)
    rate = math.sqrt(pull.mu / pull.distance**3)
    orbits = np.diff(found.time.values) * rate / (2.0 * math.pi)
    assert np.abs(orbits - 1.0).max() < 1e-14  # measured 1e-16
    a, b, c = scene.body.moments
    e = pull.eccentricity

    def rhs(t, y):
        anomaly = rate * t
        u = anomaly
        for _ in range(50):
            u = anomaly + e * math.sin(u)
        f = 2.0 * math.atan2(math.sqrt(1 + e) * math.sin(u / 2), math.sqrt(1 - e) * math.cos(u / 2))
        near = 1.0 / (1.0 - e * math.cos(u))
        return y[1], -1.5 * rate**2 * (b - a) / c * near**3 * math.sin(2.0 * (y[0] - f))

    start = 0.4, float(found.omega[2, 0])
    ends = solve_ivp(
        rhs, (0.0, found.time.values[-1]), start, method="DOP853", rtol=1e-12, atol=1e-16,
        t_eval=found.time.values,
    ).y  # fmt: skip
    q = found.attitude.values
    angle = 2.0 * np.arctan2(q[3], q[0])
    off = np.angle(np.exp(1j * (angle - ends[0])))
    assert np.abs(off).max() < 1e-5  # measured 3e-7, which chaos has grown
    assert np.abs(found.omega.values[2] / ends[1] - 1.0).max() < 1e-5  # measured 7e-7


def test_a_constant_of_motion_at_the_points():
    """Kovalevskaya's, of every member: |xi|^2 is the same at all its points."""
    found = rm.section(rm.Scene.load("kovalevskaya"), "omega[1] = 0", members=5, t_end=20.0)
    scene = rm.Scene.load("kovalevskaya")
    w, q = found.omega.values, found.attitude.values
    up = np.array([
        2.0 * (q[1] * q[3] - q[0] * q[2]), 2.0 * (q[2] * q[3] + q[0] * q[1]),
        q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2,
    ])  # fmt: skip
    moments, centre = np.array(scene.body.moments), np.array(scene.body.centre)
    third = int(np.argmin(moments))  # I1 = I2 = 2 I3
    one, two = (third + 1) % 3, (third + 2) % 3
    pull = scene.body.mass * scene.effects[0].g * (centre[one] + 1j * centre[two]) / moments[third]
    xi = (w[one] + 1j * w[two]) ** 2 - pull * (up[one] + 1j * up[two])
    for one in np.unique(found.member.values):
        size = np.abs(xi[found.member.values == one]) ** 2
        assert size.size > 3
        assert np.abs(size / size[0] - 1.0).max() < 1e-11  # measured 1.8e-13


def test_an_angle_that_jumps_does_not_pass():
    orbit = rm.GravityGradient(mu=3.986e14, distance=7e6)
    angles = rm.OrbitAngles(axes=(1, 2, 3))
    body = rm.Body((1.0, 1.4, 1.2))
    start = rm.Start(omega=(0.01, 0.0, 0.0))  # roll goes round: it jumps at pi
    scene = rm.Scene(body, orbit, start, observables=(angles,)).with_run(
        members=1, dt=5.0, t_end=3000.0, save=("orbit_angles",)
    )
    rises = rm.section(scene, "orbit_angles[roll] = 0", way="rises")
    both = rm.section(scene, "orbit_angles[roll] = 0", way="both")
    assert both.orbit_angles.attrs["long_name"].endswith("axes 1, 2, 3 on the orbit")
    roll = both.orbit_angles.sel(angle="roll").values
    assert np.abs(roll).max() < 1e-12  # measured 1.4e-16; a jump is at pi
    assert both.sizes["point"] >= rises.sizes["point"] >= 1


def test_other_members_change_no_point():
    scene = rm.Scene(BODY, rm.Gravity(9.81), rm.Start(omega=(rm.normal(0.0, 3.0),) * 3)).with_run(
        members=70, dt=0.02, t_end=4.0, integrator="rk8"
    )
    many = rm.section(scene, "omega[1] = 0", threads=2)
    few = rm.section(scene, "omega[1] = 0", members=7, threads=1)
    assert few.sizes["point"] > 3
    assert_same(few, many.isel(point=many.member.values < 7))


def test_questions_that_have_no_answer():
    wrong = {
        "omega = 0": "omega has the components 1, 2, 3",
        "energy[1] = 0": "energy has no components",
        "omga[1] = 0": "did you mean 'omega'",
        "energy_drift = 0": "no such observable of the state",
        "omega[1] > 0": 'expected "NAME = NUMBER"',
        "every orbit": "no orbit",
        "every 0": 'expected "NAME = NUMBER"',
    }
    for at, message in wrong.items():
        with pytest.raises(OptionError) as caught:
            rm.section(FREE, at, t_end=1.0)
        assert message in str(caught.value), at
    with pytest.raises(OptionError, match="did you mean 'rises'"):
        rm.section(FREE, "omega[1] = 0", way="rise", t_end=1.0)
    bath = rm.Scene(FREE.body, rm.Bath(1.0, 1.0), rm.Start(omega=(1.0, 0.0, 0.0)))
    with pytest.raises(SceneError, match="noise"):
        rm.section(bath, "omega[1] = 0", members=1, dt=0.1, t_end=1.0)
    ds = rm.simulate(FREE, t_end=1.0, every=0.5, save=("omega",))
    with pytest.raises(OptionError, match="--save attitude,momentum,omega"):
        rm.section.of(ds, "omega[1] = 0")


def test_picture_and_table():
    found = rm.section(FREE, "omega[2] = 0", t_end=50.0)
    assert table(found)[1].startswith("  4 points, omega[2] = 0 as it rises, of 1 of 1 member")
    axes = section_points(found).axes[0]
    assert axes.get_xlabel() == "ω₁ [rad/s]"
    assert axes.get_ylabel() == "ω₃ [rad/s]"
    points = axes.collections[0].get_offsets()
    assert np.array_equal(points, found.omega.sel(axis=[1, 3]).values.T)
    assert section_points(found, "theta", "momentum[1]").axes[0].get_xlabel() == "θ [deg]"
    with pytest.raises(OptionError, match="did you mean 'omega'"):
        section_points(found, "omga[1]")


def test_no_point_at_all():
    found = rm.section(FREE, "omega[1] = 50", t_end=1.0)
    assert found.sizes["point"] == 0 and "  0 points" in table(found)[1]
    section_points(found)


def test_values_and_periods_have_units():
    assert crossing_of(FREE, "omega[1] = 90 deg/s", "rises").value == pytest.approx(np.pi / 2.0)
    for text, period in (("every 1h30m", 5400.0), ("every 250 ms", 0.25)):
        assert period_of(FREE.effects, text) == period
    with pytest.raises(OptionError, match="mm is a length"):
        crossing_of(FREE, "omega[1] = 90 mm", "rises")


@pytest.mark.parametrize(("energies", "noise", "differ"), [
    ((1.0, 2.0, 3.0), 1e-9, True),
    ((1.0, 1.0, 1.0), 1e-9, False),  # one energy surface
    ((1.0, 2.0, 3.0), 1.0, False),  # a driven body keeps none
    ((5.0,), 1e-9, False),
])  # fmt: skip
def test_a_picture_of_several_energies_has_a_colour_for_each(energies, noise, differ):
    rng, count = np.random.default_rng(3), 40
    members = np.repeat(np.arange(len(energies)) + 7, count)
    energy = np.repeat(energies, count) + noise * rng.normal(size=members.size)
    omega = rng.normal(size=(3, members.size))
    found = xr.Dataset(
        {
            "member": ("point", members),
            "energy": ("point", energy, {"units": "J"}),
            "omega": (("axis", "point"), omega, {"units": "rad s-1"}),
        },
        {"axis": [1, 2, 3]},
        {"title": "some", "at": "omega[1] = 0", "way": "rises"},
    )
    axes, *bars = section_points(found).axes
    words = "energies; curves of different energies may cross" if differ else "members"
    assert axes.get_title() == f"colours: {words}"
    assert [bar.get_ylabel() for bar in bars] == ["energy [J]"] * differ
