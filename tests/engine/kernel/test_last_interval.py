"""The last interval between saves is shorter if `every` does not divide t_end, and so are the steps
in it. What is found is compared with runs of equal steps, with DOP853 and with closed forms."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rigidmc as rm
from rigidmc.engine.program import Program
from rigidmc.physics.observables.protocol import running
from rigidmc.planning.steps import make_time_grid, round_grid
from tests.tools.same import assert_same

EVERY, T_END, DT = 0.7001, 3.0, 0.007001
TIMES = [0.0, 0.7001, 1.4002, 2.1003, 2.8004, 3.0]
MOMENTS, CENTRE = (1.0, 1.7, 2.3), (0.0, 0.05, 0.3)
FEW = "attitude", "momentum", "energy_drift", "flips", "omega_mean", "omega_variance"
WATCHED = *FEW, "omega_max", "omega_min", "omega_last", "energy_mean"


def scene(**run):
    # most turn over at 1 s and, after the last save but one, at 2.85 s
    start = rm.Start(omega=(rm.normal(0.2, 0.1), 9.0, rm.normal(0.5, 0.1)))
    body = rm.Body(MOMENTS, mass=1.0, centre=CENTRE)
    run = {"members": 9, "t_end": T_END, "dt": DT, "every": EVERY} | run
    return rm.Scene(body, rm.Gravity(2.0), start).with_run(**run)


@pytest.fixture(scope="module")
def watched():
    """The same by rk8 and srkn11, which keeps a state part of a step further on; fewer by the
    latter: the others take 5 s to compile, and follow its states as those of rk8."""
    saves = {"rk8": WATCHED, "srkn11": FEW}
    return {name: rm.simulate(scene(integrator=name, save=save)) for name, save in saves.items()}


def motion(omega):
    """(q, omega, integrals of omega and of its squares) at TIMES by DOP853."""
    one, weight = np.array(MOMENTS), 2.0 * np.array(CENTRE)

    def slope(_, y):
        (a, b, c, d), w = y[:4], y[4:7]
        up = np.array([2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d])
        turn = 0.5 * np.array([
            -b * w[0] - c * w[1] - d * w[2], a * w[0] + c * w[2] - d * w[1],
            a * w[1] + d * w[0] - b * w[2], a * w[2] + b * w[1] - c * w[0],
        ])  # fmt: skip
        rate = (np.cross(one * w, w) + np.cross(up, weight)) / one
        return np.concatenate([turn, rate, w, w * w])

    first = np.concatenate([[1.0, 0.0, 0.0, 0.0], omega, np.zeros(6)])
    y = solve_ivp(slope, (0.0, T_END), first, "DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-13).y
    return y[:4].T, y[4:7].T, y[7:10].T, y[10:].T


@pytest.mark.parametrize("integrator", ["rk8", "srkn11"])
def test_states_and_means_are_those_of_the_motion(watched, integrator):
    ds = watched[integrator]
    assert ds.time.values == pytest.approx(TIMES, rel=1e-14) and ds.attrs["steps"] == 429
    for m in range(3):
        one = ds.isel(member=m)
        q, omega, sums, squares = motion(one.start_omega.values)
        mean = sums[-1] / T_END
        variance = squares[-1] / T_END - mean**2
        found = one.attitude.transpose("time", "quat").values
        found = found * np.sign((found * q).sum(1))[:, None]
        l = one.momentum.transpose("time", "axis").values
        # measured 3e-12 and 4e-11, of |L| = 16: those of DOP853
        assert np.abs(found - q).max() < 1e-11
        assert np.abs(l - omega * MOMENTS).max() < 1e-10
        # the trapezoidal rule on two states a step: measured 5e-6 and 2e-6; steps counted without
        # their lengths are 2e-3 off
        assert np.abs(one.omega_mean.values - mean).max() < 2e-5
        assert np.abs(one.omega_variance.values / variance - 1.0).max() < 1e-5


def test_events_extremes_and_drifts_are_those_of_even_steps(watched):
    """The first and the last flip are sought by steps back, whose length is that of their time."""
    even = rm.simulate(scene(integrator="rk8", save=WATCHED, every=None, dt=0.0075))
    for name, ds in watched.items():
        assert (ds.flips.values == even.flips.values).all()
        late = ds.flip_last.values > TIMES[-2]
        assert late.sum() == 8 and (ds.flip_first.values < TIMES[1:][1]).all()
        for when in ("flip_first", "flip_last"):
            assert np.nanmax(np.abs(ds[when].values - even[when].values)) < 1e-11
        if name == "rk8":
            same_statistics(ds, even)
        assert ds.energy_drift_max.max() < 1e-11
        assert (ds.followed_until == T_END).all()
    # one last step, 62 times shorter than those in which the events are sought
    tiny = rm.simulate(scene(integrator="rk8", save=WATCHED, every=0.74997, dt=0.0074997))
    assert tiny.attrs["last_steps"] == 1
    for name in ("flip_first", "flip_last"):
        assert np.nanmax(np.abs(tiny[name].values - even[name].values)) < 1e-11


def same_statistics(ds, even):
    for name in ("omega_max", "omega_min"):
        assert np.abs(ds[name].values - even[name].values).max() < 1e-5
    assert np.abs(ds.omega_last.values - even.omega_last.values).max() < 1e-11
    assert np.abs(ds.energy_mean / even.energy_mean - 1.0).max() < 1e-12


@pytest.mark.slow  # 5 s, to compile
def test_extremes_and_means_of_a_state_further_on_are_those_of_even_steps():
    even = rm.simulate(scene(integrator="rk8", save=WATCHED, every=None, dt=0.0075))
    same_statistics(rm.simulate(scene(integrator="srkn11", save=WATCHED)), even)


def test_bits_up_to_the_last_save_but_one_are_those_of_a_run_that_ends_there(watched):
    for name, ds in watched.items():
        save = WATCHED if name == "rk8" else FEW
        part = rm.simulate(scene(integrator=name, save=save, t_end=4 * EVERY))
        for variable in ("attitude", "momentum", "energy_drift"):
            assert (part[variable].values == ds[variable].values[:-1]).all()


@pytest.mark.parametrize("settings", [
    {"integrator": "srkn11", "save": FEW},
    {"integrator": "rk8", "save": ("attitude", "megno")},
    {"turn": 0.05, "integrator": "rk8", "save": WATCHED},
    pytest.param(  # 7 s, to compile
        {"turn": 0.05, "integrator": "rk8", "save": (*WATCHED, "megno")}, marks=pytest.mark.slow
    ),
], ids=["kept", "tangent", "own steps", "tangent in own steps"])  # fmt: skip
def test_calls_change_no_bit(monkeypatch, settings):
    """A run may be cut anywhere, also before and after the first step of the last interval."""
    whole = rm.simulate(scene().with_run(**settings))
    through = Program.through

    def cut(self, block, steps, noise, saves):
        head = steps.head
        for first in (0, 1, head - 1, head, head + 1, steps.total - 1):
            after = {0: 1, 1: head - 1, head - 1: head, head: head + 1, head + 1: steps.total - 1}
            last = after.get(first, steps.total)
            yield from through(self, block, steps._replace(first=first, last=last), noise, saves)

    monkeypatch.setattr(Program, "through", cut)
    again = rm.simulate(scene().with_run(**settings))
    assert_same(whole, again)


def test_chaos_is_measured_in_time():
    settings = {"integrator": "rk8", "save": ("megno",)}
    short = rm.simulate(scene(**settings))
    even = rm.simulate(scene(**settings | {"every": None, "dt": 0.0075}))
    assert np.abs(short.lyapunov - even.lyapunov).max() < 1e-5
    assert np.abs(short.megno - even.megno).max() < 1e-3


@pytest.mark.parametrize(("settings", "most"), [
    ({"turn": 0.05, "integrator": "rk8"}, 1e-11),
    ({"integrator": "strang", "compensated": True}, 1e-4),
], ids=["turn", "compensated"])  # fmt: skip
def test_ways_to_step(watched, settings, most):
    ds = rm.simulate(scene(save=("attitude",)).with_run(**settings))
    assert ds.time.values == pytest.approx(TIMES, rel=1e-14)
    assert np.abs(ds.attitude.values - watched["rk8"].attitude.values).max() < most


def test_closed_forms_are_saved_at_the_same_times():
    free = rm.Scene(rm.Body(MOMENTS), start=rm.Start(omega=(0.1, 2.0, 0.3)))
    run = {"members": 1, "t_end": T_END, "every": EVERY, "save": ("omega",), "dt": DT}
    closed, exact = (rm.simulate(free, name, **run) for name in ("closed", "exact"))
    assert closed.time.values == pytest.approx(TIMES, rel=1e-14)
    assert np.abs(closed.omega - exact.omega).max() < 1e-12


def test_noise_goes_on():
    """Steps keep their numbers, and so their noise: the first saves keep every bit; temperature
    holds in the last interval."""
    bath = rm.Scene(rm.Body(MOMENTS), rm.Bath(1.0, 1.0), rm.Start(omega=(0.0, 0.0, 0.0)))
    run = {"members": 4096, "dt": 0.05, "save": ("omega",), "integrator": "strang"}
    short = rm.simulate(bath, t_end=12.0037, every=11.05, **run)
    part = rm.simulate(bath, t_end=11.05, **run)
    assert (short.omega.values[1] == part.omega.values[-1]).all()
    kinetic = 0.5 * np.array(MOMENTS) @ (short.omega.values[-1] ** 2)
    assert kinetic.mean() == pytest.approx(1.5, abs=5 * 1.5 / np.sqrt(1.5 * 4096))


def test_a_rerun_has_the_same_bits_and_refuses_other_saves(watched, tmp_path):
    ds = watched["rk8"]
    again = rm.rerun(ds, 3)
    assert again.attrs["rerun"].startswith("equal to the bit")
    words = r"every = 0\.35: the last steps of this run are shorter"
    with pytest.raises(rm.SceneError, match=words):
        rm.rerun(ds, 3, every=0.35)
    ds.rigid.export(tmp_path / "a.nc")
    stored = rm.open(tmp_path / "a.nc")
    assert (stored.attrs["steps"], stored.attrs["last_steps"]) == (429, 29)


@running(state_size=1, outputs={"turned": ("rad s-1", "mean over steps", ())})
class Turned(NamedTuple):
    """A user's sum over steps."""

    def begin(self, body, l):
        return (0.0 * l[1],)

    def update(self, state, body, l):
        return (state[0] + body.i2 * l[1],)

    def results(self, state, steps):
        return {"turned": state[0] / steps}


class Weighed(Turned):
    """The same, which knows that the last steps may be shorter."""

    def reweighed(self, state, longer):
        return (state[0] * longer,)


class Seen(Turned):
    """One that counts no steps."""

    def results(self, state, steps):
        return {"turned": state[0]}


def test_sums_of_a_user_over_steps_count_them_by_their_length_or_are_refused(watched):
    with pytest.raises(rm.SceneError, match=r"every = 0\.7001.* turned needs a method `reweighed`"):
        rm.simulate(scene(save=(Turned(),)))
    rm.prepare(scene(save=(Seen(),)))
    ds = rm.simulate(scene(save=(Weighed(),), integrator="rk8"))
    mean, end = watched["rk8"].omega_mean[1], watched["rk8"].omega_last[1]
    first = watched["rk8"].start_omega[1]
    # the sum has the ends of steps and not their starts: half a step of the last length each
    off = 0.5 * (end - first) / (400 * DT / (T_END - TIMES[-2]) * 29 + 29)
    assert np.abs(ds.turned - mean).max() < 0.2 * np.abs(off).max() + 0.02


@pytest.mark.parametrize("seed", range(4))
def test_grids_of_any_numbers(seed):
    """Whatever the numbers: saves at k every and at t_end, no step longer than dt, and the step of
    a result leads to the same grid."""
    some, shorter = np.random.default_rng(seed), 0
    for _ in range(500):
        t_end = float(f"{10 ** some.uniform(-3, 5):.{some.integers(1, 9)}g}")
        every = float(f"{t_end * some.uniform(1e-3, 1.2):.{some.integers(1, 17)}g}")
        dt = float(f"{t_end * 10 ** some.uniform(-6, 0.5):.{some.integers(1, 17)}g}")
        made = make_time_grid(t_end, dt, every)
        assert max(made.dt, made.last_dt) <= dt * (1 + 2e-9)
        assert make_time_grid(t_end, made.dt, every)[:-1] == made[:-1]
        saves = made.clock.time(np.append(np.arange(0, made.steps, made.stride), made.steps))
        exact = [k * every for k in range(len(saves) - 1)] + [t_end]
        assert np.abs(saves - exact).max() <= 1e-9 * every
        if made.is_shortened:
            assert made.steps - made.head <= made.stride and made.head % made.stride == 0
        shorter += made.is_shortened
        whole = round_grid(t_end, every)
        assert whole.steps * whole.dt <= t_end * 1.05 * (1 + 1e-9)
        ends = whole.clock.time(np.arange(whole.steps + 1))
        assert ends[-1] == pytest.approx(t_end, rel=1e-13)
    assert shorter > 100  # 226 of 500


def test_a_rest_of_rounding_is_none():
    assert not make_time_grid(1.0, 0.01, 0.333333333333).is_shortened
    assert make_time_grid(1.0, 0.01, 0.333333).steps - make_time_grid(1.0, 0.01, 0.333333).head == 1
    assert Fraction(make_time_grid(86400.0, 1.0, 5400.123).head, 5401) == 15
