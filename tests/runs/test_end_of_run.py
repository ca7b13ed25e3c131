"""Derivatives by the end of a run: rates of the last state."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.program import Program
from rigidmc.errors import OptionError, SceneError
from rigidmc.physics.dynamics.so3 import select
from rigidmc.runs import assemble, settled
from tests.runs import test_derivatives as saved

compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
END = "run.t_end"
SCENE = saved.SCENE


@compiled
def test_the_last_save_changes_at_the_rate_of_its_state(monkeypatch):
    """By a program that moves nothing: the last state is the start."""
    monkeypatch.setattr(Program, "advance", saved.advance)
    monkeypatch.setattr(settled, "make_program", partial(assemble.make_program, compiled=False))
    for scene in (SCENE, SCENE.with_run(turn=0.1, t_end=1.0, every=0.5, members=70)):
        ds = rm.simulate(scene, wrt=("body.moments.2", END), threads=2, block=32)
        assert ds.parameter_unit.values.tolist() == ["kg m2", "s"]
        moments, omega = np.array([1.0, 2.0, 3.0])[:, None], ds.start_omega.values
        rate = np.cross(moments * omega, omega, axis=0) / moments
        rate[:, 3] = 0.0  # flagged
        assert np.abs(ds.d_omega.values[1, -1] - rate).max() < 1e-15  # measured 2.2e-16
        assert ds.d_omega.attrs["units"] == "rad s-1 per parameter_unit"
        assert np.abs(ds.d_energy.values[1, -1]).max() < 1e-15  # 2.2e-16


@compiled
def test_moments_over_time_change_by_what_the_end_adds():
    """Of f over a longer T: d mean/dT = (f(T) - mean)/T, d variance/dT = ((f(T) - mean)^2 -
    variance)/T."""
    save = "omega", "omega_mean", "omega_variance"
    scene = SCENE.with_run(t_end=2.0, dt=0.02, every=0.5, members=4, save=save, dtype="float64")
    ds = rm.simulate(scene, wrt=(END,))
    mean, variance = ds.omega_mean.values, ds.omega_variance.values
    off = ds.omega.values[-1] - mean
    for found, true in (ds.d_omega_mean, off), (ds.d_omega_variance, off**2 - variance):
        error = np.abs(found.values[0] - true / 2.0)[:, ds.status.values == 0].max()
        assert error < 1e-12 * np.nanmax(np.abs(true))  # measured 3e-16


class Swing(NamedTuple):
    """A torque with a branch-free jump, and explicit in time."""

    size: float

    def torque(self, t, l):
        return self.size * t, select(l[0] > 0.0, self.size, -self.size), 0.0


def tops(members=32, **settings):
    """Heavy tops that are described in other axes, with all that a run can save."""
    rng = np.random.default_rng(1)
    q = rng.normal(size=(members, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    tensor = [[1.0, 0.1, 0.0], [0.1, 1.5, 0.2], [0.0, 0.2, 2.0]]
    body = rm.Body.from_tensor(tensor, mass=1.0, centre=(0.05, 0.02, 0.1), axes="described")
    start = rm.Start(omega=1.5 * rng.normal(size=(members, 3)), attitude=q)
    effects = rm.Gravity(g=9.81), rm.ViscousDamping(rate=0.1)
    cone = rm.Passage(axis=3, angle=1.0)
    save = (
        "omega", "attitude", "energy", "energy_drift", "l2", "work", "passage", "nutation",
        "precession", "energy_mean", "omega_mean", "omega_variance", "omega_min", "omega_max",
        "omega_last", "attitude_mean",
    )  # fmt: skip
    scene = rm.Scene(body, effects=effects, start=start, observables=(cone,))
    steps = {} if "turn" in settings else {"dt": 0.0099}
    known = {"integrator": "rk8", "members": members, "save": save}
    return scene.with_run(**{**known, **steps, **settings})


def errors(settings, at=2.55123, step=1e-5):
    """{d_NAME: (derivatives by the end less central differences, largest derivative)}.

    For the three ends the number of steps is the same.
    """
    one = rm.simulate(tops(t_end=at, **settings), wrt=("start.omega.1", END))
    high, low = (rm.simulate(tops(t_end=at + s, **settings)) for s in (step, -step))
    found = {}
    for name in one.data_vars:
        if one[name].dims[0] != "parameter" or name == "d_attitude":
            continue
        change = one[name].values[1]
        true = (high[name[2:]].values - low[name[2:]].values) / (2.0 * step)
        if "time" in one[name].dims:
            assert not change[:-1].any(), name
            change, true = change[-1], true[-1]
        found[name] = change - true, max(1.0, np.nanmax(np.abs(true)))
    turned = one.d_attitude.values[1, -1]
    assert np.abs(turned - one.omega.values[-1]).max() < 1e-13  # the attitude turns with omega
    return found


AVERAGES = ("_mean", "_variance")


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"every": 0.7}, {"turn": 0.05}, {"compensated": True}])
def test_derivatives_by_the_end_are_those_of_differences(settings):
    """The last interval may be shorter, and members may have steps of their own."""
    if settings.get("compensated"):
        settings = {**settings, "save": ("omega", "attitude", "omega_min", "omega_max")}
    for name, (error, size) in errors(settings).items():
        print(name, np.nanmax(np.abs(error)) / size)
        # measured 2.3e-9; of means by the trapezoidal rule 5.0e-5, of order 2 in the step
        most = 2e-4 if name.endswith(AVERAGES) else 1e-8
        assert np.nanmax(np.abs(error)) < most * size, name


@compiled
@pytest.mark.slow
def test_derivatives_of_means_by_the_end_converge_with_the_trapezoidal_rule():
    save = "omega", "energy_mean", "omega_mean", "omega_variance", "attitude_mean", "attitude"
    known = {"every": 0.7, "save": save}
    coarse, fine = (errors({**known, "dt": dt}) for dt in (0.0099, 0.00495))
    for name in (n for n in coarse if n.endswith(AVERAGES)):
        (error, size), (half, _) = coarse[name], fine[name]
        extrapolated = np.abs(4.0 * half - error).max() / 3.0
        print(name, np.abs(error).max() / size, extrapolated / size)
        assert extrapolated < 1e-8 * size, name  # measured 1.8e-9


@compiled
@pytest.mark.slow
def test_the_closed_form_of_a_symmetric_top():
    """omega turns about the axis at the rate (C - A)/A omega_3, TdC Example 3.5."""
    n, a, c, t = 32, 1.0, 1.7, 3.0
    omega = np.random.default_rng(2).normal(size=(n, 3))
    start = rm.Start(omega=omega, attitude=(1.0, 0.0, 0.0, 0.0))
    scene = rm.Scene(rm.Body.from_moments((a, a, c)), start=start)
    save = "omega", "attitude", "omega_mean", "omega_variance", "omega_last"
    ds = rm.simulate(scene, "exact", dt=0.01, t_end=t, every=1.0, members=n, save=save, wrt=(END,))
    rate = (c - a) / a * omega[:, 2]
    z = (omega[:, 0] + 1j * omega[:, 1]) * np.exp(1j * rate * t)
    change = 1j * rate * z
    true = np.stack([change.real, change.imag, 0.0 * rate])
    last = np.stack([z.real, z.imag, omega[:, 2]])
    assert np.abs(ds.d_omega.values[0, -1] - true).max() < 1e-13
    assert np.abs(ds.d_omega_last.values[0] - true).max() < 1e-13
    assert np.abs(ds.d_attitude.values[0, -1] - last).max() < 1e-13
    by_mean = (last - ds.omega_mean.values) / t
    assert np.abs(ds.d_omega_mean.values[0] - by_mean).max() < 1e-13
    by_variance = ((last - ds.omega_mean.values) ** 2 - ds.omega_variance.values) / t
    assert np.abs(ds.d_omega_variance.values[0] - by_variance).max() < 1e-13


@compiled
@pytest.mark.slow
def test_members_that_stop_move_no_more():
    scene = replace(
        tops(t_end=0.4, dt=0.01), observables=(rm.Passage(axis=3, angle=1.0, stop=True),)
    )
    ds = rm.simulate(scene, save=("omega", "passage", "omega_last"), wrt=(END,))
    stopped = np.isfinite(ds.passage_first.values)
    assert 5 < stopped.sum() < 30
    for found in (ds.d_omega.values[0, -1], ds.d_omega_last.values[0]):
        assert not found[:, stopped].any() and np.abs(found[:, ~stopped]).min(0).max() > 0.1


@compiled
@pytest.mark.slow
def test_custom_effects_and_observables_have_rates():
    @rm.protocols.observable(units="rad s-1", long_name="a sum", dims=())
    class Sum(NamedTuple):
        def value(self, body, t, l):
            return (body.i1 * l[0] * t,)

    push = rm.protocols.effect(units={"size": "N m"}, limits={"size": (0.0, 1.0)}, example=(0.1,))
    scene = rm.Scene(
        SCENE.body, (push(Swing)(0.3),), rm.Start(omega=(1.0, 0.2, 0.3)), observables=(Sum(),)
    )
    ds = rm.simulate(scene, "rk8", dt=0.01, t_end=2.0, members=1, save=("omega", "sum"), wrt=END)
    w, i, t = ds.omega.values[-1, :, 0], np.array([1.0, 2.0, 3.0]), 2.0
    rate = (np.cross(i * w, w) + [0.3 * t, 0.3 * np.sign(w[0]), 0.0]) / i
    assert np.abs(ds.d_omega.values[0, -1, :, 0] - rate).max() < 1e-14
    assert abs(ds.d_sum.values[0, -1, 0] - (w[0] + t * rate[0])) < 1e-14


@rm.protocols.running(state_size=1, outputs={"reach": ("1", "a result", ())})
class Reach(NamedTuple):
    def begin(self, l):
        return (l[0],)

    def update(self, state):
        return state

    def results(self, state, steps):
        return {"reach": state[0]}


def test_what_has_no_derivative_by_the_end_is_refused_with_the_reason():
    noisy = replace(SCENE, effects=(rm.Bath(gamma=0.1, kT=1.0),))
    with pytest.raises(SceneError, match=r"run.t_end.*under the noise of bath no state has a rate"):
        rm.prepare(noisy, "strang", wrt=END)
    own = rm.Scene(SCENE.body, observables=(Reach(),))
    with pytest.raises(SceneError, match=r"run.t_end.*no derivative of reach: the class needs"):
        rm.prepare(own, wrt=END, save=("reach",))
    with pytest.raises(OptionError, match=r"run.t_end"):
        rm.propagate(
            replace(SCENE, start=rm.Start(omega=(1.0, 0.0, 0.0))), wrt=(END,), deviations=(0.1,)
        )
