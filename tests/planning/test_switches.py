"""Torques that switch: steps end at the times that an effect states, at the order of the method.

About a principal axis the closed form is an impulse; elsewhere scipy integrates from switch to
switch.
"""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rigidmc as rm
from rigidmc.mechanics.rotation import attitude_error
from rigidmc.physics.integrators import INTEGRATORS, refusal
from rigidmc.planning.steps import Clock
from rigidmc.planning.switches import cut_rows, switch_times
from rigidmc.protocols import Vector, effect, select

MOMENTS = (1.0, 1.2, 1.5)
END = 5.0


@effect(units={"size": "N m"}, shapes={"size": 3}, in_body=("size",), switches=("on", "off"))
class Pulse(NamedTuple):
    """A constant torque from `on` to `off`."""

    size: Vector
    on: float
    off: float

    def torque(self, t):
        gate = select((t >= self.on) & (t < self.off), 1.0, 0.0)
        return gate * self.size[0], gate * self.size[1], gate * self.size[2]


@effect(units={"size": "N m"}, shapes={"size": 3}, in_body=("size",))
class Silent(NamedTuple):
    """The same torque, whose class does not state when it switches."""

    size: Vector
    on: float
    off: float

    torque = Pulse.torque


def scene_of(pulse, spin=(0.0, 0.0, 1.0)):
    return rm.Scene(rm.Body.from_moments(MOMENTS), (pulse,), rm.Start(omega=spin))


def impulse(times, on, off):
    """The time for which a pulse has acted."""
    return np.clip(np.minimum(times, off) - on, 0.0, None) if off > on else 0.0 * times


def pulses():
    """Times at random, at saves, at 0, beyond the end, equal, within one step, and of one part."""
    chance = np.random.default_rng(1)
    some = [tuple(sorted(map(float, chance.uniform(0.0, END, 2)))) for _ in range(6)]
    edges = [(1.0, 2.5), (0.0, 2.55), (0.0, END), (2.0, 7.0), (6.0, 7.0), (1.0, 1.0)]
    near = [(1.02, 1.07), (1.0, 1.03), (1.97, 2.0), (0.1 + 0.2, 0.7), (0.05, 1e-3 + 0.05)]
    return [*some, *edges, *near]


ABLE = [n for n in INTEGRATORS if n != "closed" and not refusal(n, (Pulse((0, 0, 1), 1, 2),))]


@pytest.mark.filterwarnings("ignore:.*may spin members up")
@pytest.mark.parametrize(
    "name", [n if n in ("rk8", "strang") else pytest.param(n, marks=pytest.mark.slow) for n in ABLE]
)
def test_pulses_about_an_axis_are_impulses(name):
    """17 pulses, two steps, evenly and by turns: the momentum is exact to rounding."""
    worst, kw = 0.0, {"t_end": END, "every": 0.5, "members": 1, "save": ("momentum",)}
    for on, off in pulses():
        for step in ({"dt": 0.1}, {"dt": 0.5 / 14}, {"turn": 0.3}):
            pulse = Pulse((0.0, 0.0, 0.3), on, off)
            ds = rm.simulate(scene_of(pulse, (0.0, 0.0, 2.0)), name, **kw, **step)
            assert not ds.status.values.any()
            l3 = ds.momentum.isel(axis=2, member=0).values
            true = 2.0 * MOMENTS[2] + 0.3 * impulse(ds.time.values, on, off)
            worst = max(worst, np.abs(l3 - true).max())
    assert worst < 4e-13  # measured 1.1e-13 with aba1064, 1.5e-14 with rk8


def test_an_unstated_switch_is_told_and_wrong():
    with pytest.warns(
        rm.SceneWarning, match=r"Silent\] its torque jumps near t = 1.037 s.*switches"
    ):
        ds = rm.simulate(
            scene_of(Silent((0.0, 0.0, 0.6), 1.037, 4.511)), "rk8", dt=0.1, t_end=END, members=1,
            save=("momentum",),
        )  # fmt: skip
    l3 = ds.momentum.isel(axis=2, member=0, time=-1).item()
    assert abs(l3 - MOMENTS[2] - 0.6 * 3.474) > 1e-3  # measured 1.7e-2


def reference(size, on, off, spin):
    """Attitude and momentum at the end, by scipy from switch to switch."""

    def rates(t, y, acts):
        q, l = y[:4], y[4:]
        w = l / np.array(MOMENTS)
        dq = 0.5 * np.array([
            -q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
            q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
            q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
            q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
        ])  # fmt: skip
        return np.concatenate([dq, np.cross(l, w) + acts * np.array(size)])

    y = np.concatenate([[1.0, 0.0, 0.0, 0.0], np.array(MOMENTS) * spin])
    for low, high, acts in ((0.0, on, 0.0), (on, off, 1.0), (off, END, 0.0)):
        sol = solve_ivp(rates, (low, high), y, "DOP853", args=(acts,), rtol=1e-13, atol=1e-13)
        y = sol.y[:, -1]
    return y[:4], y[4:]


SPIN, SIZE, TIMES = (0.4, 1.0, 1.3), (0.3, -0.2, 0.5), (1.037, 3.511)


@pytest.mark.parametrize(
    "name", [n if n in ("rk4", "strang") else pytest.param(n, marks=pytest.mark.slow) for n in ABLE]
)
def test_the_order_stays_that_of_the_method(name):
    """Half the step divides the error by 2^order, as without a switch; Silent: by about 2."""
    q, l = reference(SIZE, *TIMES, SPIN)
    errors = []
    for dt in (0.2, 0.1):
        ds = rm.simulate(
            scene_of(Pulse(SIZE, *TIMES), SPIN), name, dt=dt, t_end=END, members=1,
            save=("momentum", "attitude"),
        )  # fmt: skip
        last = ds.isel(time=-1, member=0)
        turned = attitude_error(last.attitude.values[None], q[None])[0]
        errors.append(max(np.abs(last.momentum.values - l).max(), turned))
    order = min(INTEGRATORS[name].order, 8)
    assert errors[1] < 1e-11 or math.log2(errors[0] / errors[1]) > 0.75 * order
    assert errors[1] < 0.05


def test_parts_meet_at_the_switches():
    """Parts of a step add up to it, and no part passes a switching time to the torque."""
    chance = np.random.default_rng(2)
    for _ in range(300):
        dt, units = float(chance.uniform(0.01, 0.3)), int(chance.integers(2, 40))
        clock = Clock(dt, units - 1, 0.6 * dt)
        on, off = (
            float(chance.integers(0, 5)) * dt if chance.random() < 0.3 else t
            for t in chance.uniform(0.0, 1.2 * units * dt, 2)
        )
        effects = (Pulse((0.0, 0.0, 1.0), on, off),)
        rows = cut_rows(effects, clock, units, False)[:-1]
        for unit in np.unique(rows[:, 0]):
            mine, begin = rows[rows[:, 0] == unit], clock.time(unit)
            length = clock.time(unit + 1) - begin
            assert abs(mine[:, 1].sum() - length) < 1e-12 * (1.0 + clock.time(units))
            for _, h, start in mine:
                ends = start + unit * h, start + unit * h + h
                for time in switch_times(effects):
                    assert not ends[0] <= time <= ends[1], (ends, time)


@pytest.mark.parametrize(
    ("changes", "run", "rule"),
    [
        ({"on": rm.uniform(1.0, 2.0)}, {}, "one number for all members"),
        ({"on": np.array([1.0, 1.5])}, {"members": 2}, "one number for all members"),
        ({}, {"wrt": ("effects.Pulse.on",)}, "jump of the torque"),
        ({}, {"dtype": "float32"}, "rounds times"),
        ({}, {"save": ("megno",)}, "steps of one length"),
    ],
)
def test_what_no_grid_can_be_cut_at_is_refused(changes, run, rule):
    fields = {"size": (0.0, 0.0, 0.6), "on": 1.0, "off": 2.0, **changes}
    with pytest.raises(rm.SceneError, match=rule):
        rm.simulate(scene_of(Pulse(**fields)), "rk4", **{"dt": 0.1, "t_end": END, **run})


def test_other_derivatives_are_right_across_switches():
    """dL_3/dsize = the duration, dL_1/domega_1 as by a difference of two runs."""
    kw = {"dt": 0.1, "t_end": END, "members": 1, "save": ("momentum",)}
    names = ("effects.Pulse.size.3", "start.omega.3")
    ds = rm.simulate(scene_of(Pulse((0.0, 0.0, 0.6), *TIMES)), "rk8", wrt=names, **kw)
    got = ds.d_momentum.isel(time=-1, axis=2, member=0).values
    assert np.abs(got - (TIMES[1] - TIMES[0], MOMENTS[2])).max() < 1e-13  # measured 1.8e-15
    one = rm.simulate(scene_of(Pulse(SIZE, *TIMES), SPIN), "rk8", wrt=names[1:], **kw)
    ends = [
        rm.simulate(scene_of(Pulse(SIZE, *TIMES), (*SPIN[:2], SPIN[2] + by)), "rk8", **kw)
        for by in (-1e-4, 1e-4)
    ]
    by_runs = (ends[1].momentum - ends[0].momentum).isel(time=-1, member=0) / 2e-4
    got = one.d_momentum.isel(time=-1, member=0).values.ravel()
    assert np.abs(got - by_runs.values).max() < 1e-7  # measured 8.7e-9


def test_switches_must_be_parameters():
    @effect(switches=("begin",))
    class Wrong(NamedTuple):
        on: float

        def torque(self, t):
            return t, 0.0, 0.0

    with pytest.raises(rm.SceneError, match=r"switches.*names 'begin', which is not a parameter"):
        scene_of(Wrong(1.0))


def test_a_run_continues_across_a_cut_step(tmp_path):
    """Calls, blocks, monitors and the tolerance see whole steps only."""
    pulse = scene_of(Pulse(SIZE, *TIMES), (rm.normal(0.4, 0.1), 1.0, 1.3))
    kw = {"dt": 0.1, "t_end": END, "members": 48, "save": ("momentum", "energy_mean")}
    once = rm.simulate(pulse, "rk8", **kw)
    fine = rm.simulate(pulse, "rk8", **{**kw, "dt": 0.01})
    alone = rm.simulate(pulse, "rk8", **{**kw, "members": range(7, 9)})
    assert np.array_equal(once.momentum.sel(member=[7, 8]), alone.momentum)
    # a part of a step counts by its length: measured 3.9e-5; 1.6e-2 if it counts as a step
    assert np.abs(once.energy_mean / fine.energy_mean - 1.0).max() < 1e-4
    found = rm.simulate(pulse, tolerance=1e-8, **{k: v for k, v in kw.items() if k != "dt"})
    assert np.abs(found.momentum - fine.momentum).max() < 5e-8  # measured 9.4e-9


PAGE = Path(__file__).parents[2] / "docs/how_to/pulses.md"


@pytest.mark.filterwarnings("error")
def test_the_page_on_pulses_runs():
    """Its numbers: the impulse of each torque, by hand."""
    names = {"__name__": "pulses"}
    exec("\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)), names)
    assert abs(names["spin"] - 2.948) < 1e-14  # measured 4e-16
    kw = {"dt": 0.1, "t_end": END, "members": 1, "save": ("momentum",)}
    areas = {
        "tabled": 0.5 * (1.234 - 0.513) - 0.2 * (3.1 - 1.234), "linear": 0.5 * 0.5 * (3.1 - 0.513),
    }  # fmt: skip
    for name, area in areas.items():
        ds = rm.simulate(names[name], "rk4", **kw)
        assert abs(ds.momentum.isel(time=-1, axis=2, member=0).item() - area) < 1e-14  # 2e-16
