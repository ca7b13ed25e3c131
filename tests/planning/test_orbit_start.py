"""Starts relative to an orbit, against closed forms, mpmath and scipy."""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.mechanics.rotation import attitude_error

# The long axis (least moment) points to the centre, the short one along the normal: stable.
BODY = rm.Body.from_moments((1.2, 1.4, 1.0))
MU, DISTANCE = 3.986e14, 7.0e7
RATE = math.sqrt(MU / DISTANCE**3)
AT_REST = {"rate": (0.0, 0.0, 0.0), "relative_to": "orbit"}


def aligned(angles, unit="rad"):
    return {"euler": "321", "angles": angles, "unit": unit, "relative_to": "orbit"}


def orbiting(omega=AT_REST, attitude=None, body=BODY, distance=DISTANCE, **pull):
    """A scene on an orbit, by default at rest in its frame."""
    attitude = aligned((0.0, 0.0, 0.0)) if attitude is None else attitude
    start = rm.Start(omega=omega, attitude=attitude)
    return rm.Scene(body, rm.GravityGradient(MU, distance, **pull), start)


def first(scene, **settings):
    ds = rm.simulate(scene, dt=1.0, t_end=1.0, **settings)
    return ds.start_attitude.T.values, ds.start_omega.T.values


def frame(anomaly):
    """Return the axes of the frame of the orbit as columns: track, opposite to the normal, down."""
    c, s = math.cos(anomaly), math.sin(anomaly)
    return Rotation.from_matrix([[-s, 0.0, -c], [c, 0.0, -s], [0.0, -1.0, 0.0]])


@pytest.mark.parametrize("anomaly", [0.0, 2.9, -1.2, 6.0])
def test_a_body_at_rest_in_its_orbit_stays_there(anomaly):
    run = {"dt": 300.0, "every": 3000.0, "integrator": "rk8", "members": 1}
    scene = orbiting(anomaly=anomaly).with_run(t_end=5.0 * 2.0 * math.pi / RATE, **run)
    ds = rm.simulate(scene, save=("orbit_angles", "omega"))
    assert np.abs(ds.orbit_angles).max() < 2e-13  # measured 2.1e-14
    assert np.abs(ds.omega.sel(axis=2) + RATE).max() < 2e-18  # of 3e-5; measured 2.6e-19
    still = orbiting((0.0, 0.0, 0.0), anomaly=anomaly)
    turned = rm.simulate(still, dt=10.0, t_end=1000.0, members=1, save=("orbit_angles",))
    assert np.abs(turned.orbit_angles).max() > 0.02  # measured 0.034


def test_roll_pitch_and_yaw_come_back():
    given = np.random.default_rng(4).uniform(-1.5, 1.5, (7, 3))
    angles = given[:, ::-1]  # yaw, pitch, roll
    scene = orbiting(attitude=aligned(np.degrees(angles), "deg"), eccentricity=0.3, anomaly=0.7)
    ds = rm.simulate(scene, dt=1.0, t_end=1.0, save=("orbit_angles",))
    found = ds.orbit_angles.isel(time=0).transpose("member", "angle").values
    assert list(ds.angle.values) == ["roll", "pitch", "yaw"]
    assert np.abs(found - given).max() < 5e-15  # measured 8.3e-16


def test_pitch_librates_at_its_rate():
    scene = orbiting(attitude=aligned((0.0, 1e-5, 0.0)))
    run = {"dt": 300.0, "t_end": 600000.0, "every": 3000.0, "members": 1}
    ds = rm.simulate(scene, "rk8", save=("orbit_angles",), **run)
    libration = RATE * math.sqrt(3.0 * (1.2 - 1.0) / 1.4)
    true = 1e-5 * np.cos(libration * ds.time.values)
    pitch = ds.orbit_angles.sel(angle="pitch").isel(member=0).values
    assert np.abs(pitch - true).max() < 1e-13  # of 1e-5; measured 1.9e-14


@pytest.mark.parametrize(("e", "anomaly"), [(0.0, 0.4), (0.2, 0.0), (0.6, 3.0), (0.9, -0.3)])
def test_the_frame_turns_with_the_true_anomaly(e, anomaly):
    with mp.workdps(30):

        def true_anomaly(t):
            m = mp.sqrt(mp.mpf(MU) / mp.mpf(DISTANCE) ** 3) * t + mp.mpf(anomaly)
            x = mp.findroot(lambda x: x - mp.mpf(e) * mp.sin(x) - m, m + mp.mpf(e) * mp.sin(m))
            return 2 * mp.atan2(
                mp.sqrt(1 + mp.mpf(e)) * mp.sin(x / 2), mp.sqrt(1 - mp.mpf(e)) * mp.cos(x / 2)
            )

        f, rate = float(true_anomaly(0)), float(mp.diff(true_anomaly, 0))
    relative = Rotation.from_euler("ZYX", (0.4, -0.7, 1.1))
    own = (1e-4, -2e-4, 3e-4)
    scene = orbiting(
        {"rate": own, "relative_to": "orbit"},
        {"matrix": relative.as_matrix(), "relative_to": "orbit"},
        eccentricity=e,
        anomaly=anomaly,
    )
    q, omega = first(scene)
    true = frame(f) * relative
    assert attitude_error(q[0], true) < 2e-15  # measured 5.2e-16
    expected = true.inv().apply([0.0, 0.0, rate]) + own
    assert np.abs(omega[0] - expected).max() < 5e-15 * rate  # measured 1.0e-15
    assert np.abs(omega[0] - own).max() > 0.1 * rate


def test_each_member_has_its_own_orbit():
    distances = np.array([1.0e7, 7.0e7, 4.2e8])
    q, omega = first(orbiting(distance=distances, anomaly=np.array([0.0, 1.0, 2.0])))
    for i, anomaly in enumerate((0.0, 1.0, 2.0)):
        assert attitude_error(q[i], frame(anomaly)) < 1e-15  # measured 7.9e-17
        assert omega[i, 1] == pytest.approx(-math.sqrt(MU / distances[i] ** 3), rel=1e-14)
    assert np.abs(omega[:, [0, 2]]).max() < 1e-18


def test_distributions_may_be_relative():
    text = """
[body]
moments = [1.2, 1.4, 1.0]
[effects.gravity_gradient]
mu = 3.986e14
distance = 7e7
[start]
omega = { sphere = 1e-4, relative_to = "orbit" }
attitude = { fisher = { attitude = [1, 0, 0, 0], kappa = 1e6 }, relative_to = "orbit" }
[run]
members = 50
"""
    scene = rm.Scene.loads(text)
    q, omega = first(scene)
    assert attitude_error(q, frame(0.0)).max() < 0.01  # about 3e-3, ten times its scatter
    space = Rotation.from_quat(q, scalar_first=True)
    own = omega - space.inv().apply([0.0, 0.0, RATE])
    assert np.abs(np.linalg.norm(own, axis=1) - 1e-4).max() < 1e-18  # measured 1.4e-20
    again = rm.Scene.loads(scene.dumps())
    assert again.start == scene.start or again.dumps() == scene.dumps()
    assert np.array_equal(first(again)[1], omega)
    # uniform attitudes are uniform in any frame
    anywhere = rm.Start(omega=(0, 0, 0), attitude="uniform", relative_to_orbit="attitude")
    assert anywhere.relative_to_orbit == ()


def test_rows_come_back_from_a_result():
    rng = np.random.default_rng(5)
    q = Rotation.random(6, rng=5).as_quat(scalar_first=True)
    omega = {"rate": rng.normal(0.0, 1e-3, (6, 3)), "relative_to": "orbit"}
    scene = orbiting(omega, {"quaternion": q, "relative_to": "orbit"}, anomaly=0.3)
    ds = rm.simulate(scene, dt=1.0, t_end=10.0, save=("omega", "attitude"))
    assert np.array_equal(ds.start_relative_omega.T, np.stack(scene.start.omega, -1))
    assert "frame of the orbit" in ds.start_relative_attitude.long_name
    again = rm.simulate(ds.rigid.scene())
    assert np.array_equal(again.omega, ds.omega)
    one = ds.rigid.rerun(4)
    assert np.array_equal(one.attitude.isel(member=0), ds.attitude.isel(member=4))
    part = ds.isel(member=[4]).rigid.scene()
    assert part.start.relative_to_orbit == ("omega", "attitude")


def test_an_uncertain_structure_is_aligned_in_its_described_axes():
    law = rm.UncertainInertia(np.diag([1.2, 1.4, 1.0]), 1e-4 * np.eye(6))
    scene = orbiting(body=rm.Body.from_tensor(law), anomaly=0.7)
    ds = rm.simulate(scene, dt=1.0, t_end=1.0, members=20)
    q = ds.rigid.described("start_attitude").transpose("member", "quat").values
    omega = ds.rigid.described("start_omega").transpose("member", "axis").values
    assert attitude_error(q, frame(0.7)).max() < 2e-15  # measured 5.0e-16
    assert np.abs(omega - [0.0, -RATE, 0.0]).max() < 1e-14 * RATE  # measured 4.0e-16


def test_other_units_of_integration_start_alike():
    tiny = rm.Body.from_moments(tuple(x * 2.0**-133 for x in (1.2, 1.4, 1.0)))
    one, two = (
        rm.simulate(
            orbiting(attitude=aligned((0, 0.1, 0)), body=body), dt=1.0, t_end=100.0, save=("omega",)
        )
        for body in (BODY, tiny)
    )
    assert np.array_equal(one.omega, two.omega)


def test_sensitivity_knows_the_relative_numbers():
    omega = {"rate": (0.0, rm.normal(0.0, 1e-6), 0.0), "relative_to": "orbit"}
    scene = orbiting(omega, aligned((0.0, rm.normal(0.0, 1e-3), 0.0)))
    run = scene.with_run(dt=10.0, t_end=100.0, save=("orbit_angles",))
    study = rm.sensitivity(run, of="mean(omega_max[2])", members=64)
    assert {*study.number.values} == {"start.omega.2", "start.attitude.pitch"}


def refused(at, word, effects=(), **start):
    with pytest.raises(rm.SceneError) as caught:
        rm.Scene(BODY, effects, rm.Start(**start))
    assert caught.value.at == at
    assert word in str(caught.value)


def test_what_is_refused():
    pull = rm.GravityGradient(MU, DISTANCE)
    rest = (0.0, 0.0, 0.0)
    refused("start.omega.relative_to", "no orbit", omega=AT_REST)
    refused("start.attitude.relative_to", "no orbit", omega=rest, attitude=aligned(rest))
    refused("start.omega.relative_to", "2 orbits", (pull, pull), omega=AT_REST)
    refused("start.momentum.relative_to", "give omega", pull, momentum=AT_REST)
    refused("start.relative_to_orbit", "give omega", pull, momentum=rest, relative_to_orbit="omega")
    refused("start.relative_to_orbit", "omega, attitude", pull, omega=rest, relative_to_orbit=3)
    refused("start.relative_to_orbit", "'omega'", pull, omega=rest, relative_to_orbit="omeg")
    refused("start.omega.relative_to", "missing", pull, omega={"rate": rest})
    refused("start.omega.rat", "'rate'", pull, omega={"rat": rest, "relative_to": "orbit"})
    gibbs = rm.GibbsMomentum(1.0)
    refused(
        "start.attitude",
        "energies",
        pull,
        momentum=gibbs,
        attitude="ensemble",
        relative_to_orbit="attitude",
    )
