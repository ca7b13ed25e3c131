"""Effects with a state and with a memory, against scipy between samples."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.errors import SceneError, SceneWarning
from rigidmc.physics.dynamics.euler import angular_velocity
from rigidmc.physics.dynamics.so3 import cross, scale
from rigidmc.physics.effects.protocol import effect
from rigidmc.physics.integrators import INTEGRATORS, integrators_for
from rigidmc.physics.observables.protocol import observable

BODY = (1.0, 1.2, 0.9)
NO_TORQUE = 0.0, 0.0, 0.0


@effect(
    units={"gain": "N m", "damping": "N m s", "command": "N m"}, shapes={"command": 3},
    every="sample_time", after="delay", memory=("command",),
    commands={"command": ("reaction_wheel", "command")}, example=(0.03, 0.2, 1.0),
)  # fmt: skip
class Pointing(NamedTuple):
    """A sampled controller: three wheels get gain q0 qv + damping omega."""

    gain: Any
    damping: Any
    sample_time: Any
    delay: Any = 0.0
    command: Any = (0.0, 0.0, 0.0)

    def sample(self, body, q, l):
        w = angular_velocity(body, l)
        k = self.gain * q[0]
        d = self.damping
        return k * q[1] + d * w[0], k * q[2] + d * w[1], k * q[3] + d * w[2]


def wheels(inertia=0.02, friction=0.001, most=0.02, momenta=NO_TORQUE):
    """Three wheels along the axes."""
    return [
        rm.ReactionWheel(tuple(axis), inertia, 0.0, friction, most, momentum=h)
        for axis, h in zip(np.eye(3).tolist(), momenta, strict=True)
    ]


def rates(t, y, u, inertia, friction, most):
    """The rates of (q, L, H) of a body with three wheels, written out."""
    q, l, h = y[:4], y[4:7], y[7:]
    w = l / BODY
    dh = np.clip(u, -most, most) - friction * (h / inertia - w)
    dq = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
    return np.concatenate([dq, np.cross(l, w) + np.cross(h, w) - dh, dh])


def closed_loop(start, control, end, plant, level=None):
    """Return (omega at the end, times at which axis 3 crosses a level) by scipy."""
    (q, w), (gain, damping, every, delay) = start, control
    y, u = np.concatenate([q, BODY * np.asarray(w), np.zeros(3)]), np.zeros(3)
    times = [k * every + delay for k in range(math.ceil((end - delay) / every))]
    crossings = []
    for now, then in zip([0.0, *times], [*times, end], strict=True):
        if now in times:
            now_q = y[:4] / np.linalg.norm(y[:4])
            u = gain * now_q[0] * now_q[1:] + damping * y[4:7] / BODY
        if then == now:
            continue
        motion = solve_ivp(
            rates, (now, then), y, "DOP853", args=(u, *plant), rtol=1e-13, atol=1e-15,
            dense_output=level is not None,
        )  # fmt: skip
        if level is not None:

            def above(t, path=motion.sol):
                q = path(t)[:4] / np.linalg.norm(path(t)[:4])
                return 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2) - level

            grid = np.linspace(now, then, 60)
            signs = np.sign([above(t) for t in grid])
            crossings += [brentq(above, *grid[i : i + 2], xtol=1e-13)
                          for i in np.flatnonzero(np.diff(signs))]  # fmt: skip
        y = motion.y[:, -1]
    return y[4:7] / BODY, crossings


def design(seed):
    """Return (start, control, plant) of a random closed loop."""
    some = np.random.default_rng(seed)
    q = Rotation.random(random_state=seed).as_quat(scalar_first=True)
    control = some.uniform(0.01, 0.1), some.uniform(0.1, 0.4), some.uniform(0.2, 2.0)
    plant = some.uniform(0.01, 0.1), some.uniform(0.0, 0.01), some.uniform(0.005, 0.05)
    delay = some.choice([0.0, some.uniform(0.0, 0.3)])
    return (q, 0.2 * some.normal(size=3)), (*control, delay), plant


def simulated(start, control, plant, end, observables=(), **how):
    """Return the motion of a closed loop."""
    q, w = start
    effects = (*wheels(*plant), Pointing(*control))
    scene = rm.Scene(
        rm.Body.from_moments(BODY), effects, start=rm.Start(omega=tuple(w), attitude=tuple(q)),
        observables=observables,
    )  # fmt: skip
    known = {"integrator": "rk8", "dt": 0.05, "members": 1, "every": end, "save": "omega"}
    return rm.simulate(scene, t_end=end, threads=1, **{**known, **how})


@pytest.mark.parametrize("seed", range(6))
def test_a_closed_loop_is_that_of_scipy_between_samples(seed):
    start, control, plant = design(seed)
    truth, _ = closed_loop(start, control, 6.0, plant)
    found = simulated(start, control, plant, 6.0).omega.values[-1, :, 0]
    assert np.abs(found - truth).max() < 1e-11  # measured 2e-16 to 4e-15


def test_members_with_their_own_steps_sample_at_the_same_times():
    start, control, plant = design(4)
    truth, _ = closed_loop(start, control, 6.0, plant)
    how = {"dt": None, "turn": 0.02, "every": 0.5}
    with pytest.warns(SceneWarning, match="may spin members up"):
        found = simulated(start, control, plant, 6.0, **how).omega.values[-1, :, 0]
    assert np.abs(found - truth).max() < 1e-11  # measured 4e-16


def test_another_delay_is_another_motion():
    """The check above sees when the samples are taken."""
    start, control, plant = design(1)
    late = (*control[:3], control[3] + 1e-6)
    one, other = (simulated(start, c, plant, 6.0).omega.values[-1] for c in (control, late))
    assert np.abs(one - other).max() > 1e-9


ACCEPTED = [name for name in integrators_for(wheels()) if INTEGRATORS[name].order < 13]


@pytest.mark.parametrize("name", ACCEPTED)
def test_each_integrator_keeps_its_order_with_a_state(name):
    """Wheels with friction and saturation, without a controller."""
    start, plant = ((0.8, 0.3, -0.4, 0.33), (0.5, -0.8, 0.4)), (0.02, 0.01, 1.0)
    momenta = 0.3, -0.2, 0.1
    q = np.array(start[0]) / np.linalg.norm(start[0])
    y = np.concatenate([q, BODY * np.array(start[1]), momenta])
    known = {"args": (np.zeros(3), *plant), "rtol": 1e-13, "atol": 1e-15}
    truth = solve_ivp(rates, (0.0, 4.0), y, "DOP853", **known).y[4:7, -1] / BODY
    scene = rm.Scene(
        rm.Body.from_moments(BODY), tuple(wheels(*plant, momenta)),
        start=rm.Start(omega=start[1], attitude=tuple(q)),
    )  # fmt: skip
    order = min(INTEGRATORS[name].order, 12)
    h = {12: 1.0, 8: 0.4}.get(order, 0.05)
    how = {"integrator": name, "t_end": 4.0, "members": 1, "every": 4.0, "save": "omega"}
    errors = [
        np.abs(rm.simulate(scene, dt=dt, threads=1, **how).omega.values[-1, :, 0] - truth).max()
        for dt in (h, 0.5 * h)
    ]
    # measured: 1.97 to 2.03, 3.9 to 4.2, 7.6 and more; or rounding
    assert errors[1] < 1e-12 or math.log2(errors[0] / errors[1]) > 0.9 * order


def test_events_see_the_state():
    start = (np.array([0.8, 0.3, -0.4, 0.33]) / np.linalg.norm([0.8, 0.3, -0.4, 0.33]),
             (0.05, -0.08, 0.1))  # fmt: skip
    control, plant = (0.03, 0.2, 0.73, 0.13), (0.02, 0.001, 0.02)
    _, crossings = closed_loop(start, control, 20.0, plant, math.cos(1.2))
    both = (rm.Passage(3, 1.2, "leaves", at_start="ignore"),
            rm.Passage(3, 1.2, "reaches", at_start="ignore"))  # fmt: skip
    for dt in (0.1, 0.4):
        ds = simulated(start, control, plant, 20.0, both, dt=dt)
        found = [float(ds.passage_first[0]), float(ds.passage_first_2[0])]
        assert sorted(found) == pytest.approx(crossings, abs=1e-11)  # measured 8e-14


@pytest.mark.parametrize("name", ["gain", "delay_of_none", "momentum"])
def test_derivatives_pass_through_samples(name):
    start, control, plant = design(3)
    if name == "delay_of_none":
        with pytest.raises(SceneError, match="has no derivative: the samples of a run"):
            simulated(start, control, plant, 3.0, wrt=["effects.Pointing.sample_time"])
        return
    path = {"gain": "effects.Pointing.gain", "momentum": "effects.reaction_wheel.momentum"}[name]

    def moved(by):
        q, w = start
        momenta = (by, 0.0, 0.0) if name == "momentum" else NO_TORQUE
        changed = (control[0] + by * (name == "gain"), *control[1:])
        effects = (*wheels(*plant, momenta), Pointing(*changed))
        scene = rm.Scene(rm.Body.from_moments(BODY), effects,
                         start=rm.Start(omega=tuple(w), attitude=tuple(q)))  # fmt: skip
        how = {"integrator": "rk8", "dt": 0.05, "t_end": 6.0, "every": 6.0, "members": 1}
        return rm.simulate(scene, save="omega", threads=1, wrt=[path] if by == 0.0 else None, **how)

    exact = moved(0.0).d_omega.values[0, -1, :, 0]
    slope = (moved(1e-6).omega.values[-1, :, 0] - moved(-1e-6).omega.values[-1, :, 0]) / 2e-6
    assert exact == pytest.approx(slope, rel=1e-6, abs=1e-7)  # measured 2e-8


@effect(units={"seen": "1"}, every="sample_time", memory=("seen",), example=(0.1,))
class Gauge(NamedTuple):
    """A sensor that reads noise alone, and an actuator that applies it."""

    sample_time: Any
    seen: Any = 0.0

    def sample(self, noise):
        return (noise[0],)

    def torque(self):
        return self.seen, 0.0, 0.0


@effect(units={"seen": "1"}, every="sample_time", memory=("seen",), example=(0.1,))
class Silent(NamedTuple):
    """A sensor that nothing reads."""

    sample_time: Any
    seen: Any = 0.0

    def sample(self, noise):
        return (noise[0],)


def test_noise_of_a_sample_depends_on_its_number_alone():
    """Not on the step, the blocks, or what else samples."""
    body, end = rm.Body.from_moments((1.0, 1.0, 1.0)), 1.0

    def momentum(dt, *others):
        scene = rm.Scene(body, (Gauge(0.1), *others), start=rm.Start(omega=NO_TORQUE))
        how = {"integrator": "rk4", "dt": dt, "t_end": end, "members": 40, "every": 0.1}
        return rm.simulate(scene, save="momentum", threads=1, **how).momentum.values[:, 0]

    steps, finer = momentum(0.1), momentum(0.025)
    drawn = np.diff(steps, axis=0) / 0.1
    assert np.abs(np.diff(finer, axis=0) / 0.1 - drawn).max() < 1e-12  # measured 7e-15
    # of 400 normal deviates these have deviations of .05 and .035
    assert abs(drawn.mean()) < 0.2 and abs(drawn.std() - 1.0) < 0.15
    assert len(np.unique(drawn)) == drawn.size
    beside = np.diff(momentum(0.05, Silent(0.25)), axis=0) / 0.1
    assert np.abs(beside - drawn).max() < 1e-12


@effect(units={"count": "1"}, every="sample_time", memory=("count",), example=(0.1,))
class Counter(NamedTuple):
    """A memory that counts samples, as a torque."""

    sample_time: Any
    count: Any = 0.0

    def sample(self):
        return (self.count + 1.0,)

    def torque(self):
        return self.count, 0.0, 0.0


@pytest.mark.parametrize(("every", "dt"), [(0.1, 0.1), (0.1, 0.25), (0.3, 0.1), (0.07, 0.05)])
def test_samples_are_at_multiples_of_their_period(every, dt):
    """L = sum of the time since each sample."""
    body, end = rm.Body.from_moments((100.0, 100.0, 100.0)), 3.0
    scene = rm.Scene(body, Counter(every), start=rm.Start(omega=NO_TORQUE))
    how = {"integrator": "rk4", "dt": dt, "t_end": end, "members": 2, "every": end}
    found = rm.simulate(scene, save="momentum", threads=1, **how).momentum.values[-1, 0, 0]
    times = np.arange(math.ceil(end / every - 1e-9)) * every
    assert found == pytest.approx(np.sum(end - times), rel=1e-13)  # measured 2e-15


class Twice(NamedTuple):
    """A class with a method that none of its facts explains."""

    size: Any

    def torque(self):
        return NO_TORQUE

    def state_rate(self):
        return (1.0,)


@effect(every="sample_time", memory=("seen",))
class Short(NamedTuple):
    """A sample that returns too many numbers."""

    sample_time: Any
    seen: Any = 0.0

    def sample(self):
        return 1.0, 2.0


@pytest.mark.parametrize(("part", "rule"), [
    (Twice(1.0), "state_rate: needs the fact `state`"),
    (Short(0.1), "expected a tuple of 1 number"),
    (Counter(0.0), "expected a time above 0 between samples"),
    (Counter(-1.0), "expected a time above 0 between samples"),
    (Counter(rm.normal(0.1, 0.01)), "must be one number for all"),
    (Counter(1e-9), "samples exceed the limit"),
])  # fmt: skip
def test_what_cannot_be_sampled_is_refused(part, rule):
    scene = rm.Scene(rm.Body.from_moments(BODY), part)
    with pytest.raises(SceneError, match=rule):
        rm.simulate(scene, integrator="rk4", dt=0.1, t_end=1.0, members=2)


@pytest.mark.parametrize("save", ["megno", "passage"])
def test_monitors_that_cannot_follow_a_state_are_refused(save):
    stop = (rm.Passage(3, 0.5, stop=True),) if save == "passage" else ()
    scene = rm.Scene(rm.Body.from_moments(BODY), tuple(wheels()), observables=stop)
    with pytest.raises(SceneError, match="numbers that move"):
        rm.simulate(scene, integrator="rk4", dt=0.1, t_end=1.0, members=2, save=save)


@observable(units="kg2 m4 s-2", long_name="squared momentum of body and wheels", dims=())
class Whole(NamedTuple):
    """|L + sum of H a|^2 of three wheels along the axes."""

    def value(self, effects, l):
        x = l[0] + effects[0].momentum
        y = l[1] + effects[1].momentum
        z = l[2] + effects[2].momentum
        return (x * x + y * y + z * z,)


@effect(state=("momentum",), units={"momentum": "kg m2 s-1"}, example=(0.1, 0.3))
class Lossy(NamedTuple):
    """A wheel along axis 1 that a torque drives, which the body does not feel."""

    drive: Any
    momentum: Any = 0.0

    def torque(self, body, l):
        return scale(self.momentum, cross((1.0, 0.0, 0.0), angular_velocity(body, l)))

    def state_rate(self):
        return (self.drive,)


def drift_of_the_whole(*parts):
    scene = rm.Scene(rm.Body.from_moments(BODY), parts, start=rm.Start(omega=(0.5, -0.8, 0.4)),
                     observables=(Whole(),))  # fmt: skip
    how = {"integrator": "rk8", "dt": 0.05, "t_end": 100.0, "members": 1, "every": 1.0}
    whole = rm.simulate(scene, save="whole", threads=1, **how).whole.values[:, 0]
    return np.abs(whole / whole[0] - 1.0).max()


def test_wheels_conserve_the_momentum_of_the_whole():
    """A wheel whose motor does not push back does not."""
    wheel = wheels(0.05, 0.01, 1.0, (0.3, -0.2, 0.1))
    assert drift_of_the_whole(*wheel) < 1e-13  # measured 3e-15
    assert drift_of_the_whole(*wheel[1:], Lossy(0.01, 0.3)) > 1e-4
