"""Derivatives of event times and of results over all steps."""

from dataclasses import replace
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.kernel import layout
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.dual_arrays import DualArray, plain
from rigidmc.physics.observables import Megno
from rigidmc.physics.observables.saving import outputs_with_derivatives
from rigidmc.planning import monitors
from tests.runs import test_derivatives as saved

WRT = saved.WRT
SCENE = saved.SCENE
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
ALL = (
    "flips", "passage", "nutation", "precession", "energy_mean", "omega_variance", "omega_min",
    "omega_max", "omega_last", "attitude_mean",
)  # fmt: skip


def test_derivatives_of_results_are_those_of_differences():
    """The code of the results, on rows with tangents."""
    cones = rm.Passage(axis=3, angle=1.0), rm.Passage(1, 1.0, hold=0.1)
    run = rm.prepare(replace(SCENE, observables=cones), save=ALL)
    plan, rng = run.plan, np.random.default_rng(2)
    places, rows = plan.places, run.initial(0, 32)[0]
    rows[places.events : places.end] = rng.uniform(0.1, 0.9, (places.end - places.events, 32))
    changes = np.zeros((2, *rows.shape))
    changes[:, places.events : places.end] = rng.normal(size=(2, places.end - places.events, 32))
    for i in range(len(plan.monitors.events)):
        at = places.events + layout.EVENT_ROWS * i
        rows[at + layout.COUNT] = 3.0
        rows[at + layout.SQUARES] += 10.0
        changes[:, at + layout.COUNT] = 0.0
    rows[layout.STATUS], rows[layout.GOOD_STEP] = 0.0, 8.0
    rows[layout.STATUS, 3] = 1.0
    rows[places.events + layout.COUNT, 5] = 0.0  # this member never flipped

    def results(block):
        return monitors.results(plan.monitors, places, block, plan.grid.clock, 8, plan.nodes)

    values, found = results(rows), results(DualArray(rows, changes))
    names = {n for pair in plan.monitors.labelled for n in outputs_with_derivatives(*pair)}
    assert names == {n for n, x in found.items() if isinstance(x, DualArray)}
    assert values.keys() - names == {"flips", "passages", "passages_2", "followed_until"}
    for name, x in found.items():
        assert np.array_equal(plain(x), values[name], equal_nan=True), name  # to the bit
    for j in range(2):
        high, low = (results(rows + by * changes[j]) for by in (1e-6, -1e-6))
        for name in names:
            true = 0.5e6 * (high[name] - low[name])
            known = np.isfinite(true)
            assert known[..., :3].all(), name
            error = np.abs(found[name].tangents[j] - true)[known].max()
            assert error < 1e-7, (name, error)  # measured 1.6e-8
    assert np.isnan(values["flip_first"][5]) and np.isnan(values["omega_max"][:, 3]).all()


@rm.protocols.running(state_size=1, outputs={"stepwise": ("1", "a count", ())})
class Stepwise(NamedTuple):
    def begin(self, l):
        return (l[0],)

    def update(self, state):
        return state

    def results(self, state, steps):
        return {"stepwise": np.floor(state[0])}


@rm.protocols.running(
    state_size=2, outputs={"d_flip_first": ("s", "a", ()), "twice": ("s", "b", ())}
)
class Twice(NamedTuple):
    def begin(self, l):
        return l[0], l[1]

    def update(self, state):
        return state

    def results(self, state, steps):
        return {"d_flip_first": np.hypot(*state), "twice": 2.0 * state[1]}


def test_custom_results_have_derivatives_if_their_code_has():
    assert outputs_with_derivatives("stepwise", Stepwise()) == []
    assert outputs_with_derivatives("twice", Twice()) == ["d_flip_first", "twice"]
    assert outputs_with_derivatives("megno", Megno()) == []
    scene = rm.Scene(SCENE.body, observables=(Twice(),)).with_run(save=("flips", "twice"))
    rm.prepare(scene)
    own = rm.Scene(SCENE.body, observables=(Stepwise(),)).with_run(save=("stepwise",))
    words = "stepwise has no derivatives: its method `results`"
    assert words in " ".join(rm.prepare(own, wrt=WRT).notes)
    assert words not in " ".join(rm.prepare(own).notes)
    with pytest.raises(SceneError, match="gives the variable 'd_flip_first'"):
        rm.prepare(scene, wrt=WRT)


def flip_time(one, two, three, *w):
    """When a free top first has no angular momentum about its middle axis, by its closed form
    (Landau & Lifshitz, Mechanics, par. 37): in 50 digits."""
    moments = one, two, three
    energy = sum(i * x * x for i, x in zip(moments, w, strict=True))
    square = sum((i * x) ** 2 for i, x in zip(moments, w, strict=True))
    a, b = (one, three) if square > energy * two else (three, one)
    largest = mp.sqrt((energy * b - square) / (two * (b - two)))
    rate = mp.sqrt((b - two) * (square - energy * a) / (one * two * three))
    m = (two - a) * (energy * b - square) / ((b - two) * (square - energy * a))
    phase = mp.ellipf(mp.asin(abs(w[1]) / largest), m)
    rises = (three - one) * w[0] * w[1] * w[2] > 0
    return (2 * mp.ellipk(m) - phase if rises else phase) / rate


@compiled
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "dt", "most"),
    [
        ("exact", 0.1, 1e-14),  # measured 1.7e-15
        ("rk8", 0.05, 2e-14),  # 3.4e-15
        ("gbs12", 0.05, 2e-14),  # 3.0e-15
        ("rk4", 0.01, 2e-10),  # 4.9e-11; with twice the step, 16 times as much
    ],
)
def test_flip_times_have_the_derivatives_of_the_closed_form(name, dt, most):
    moments, rng, n = (1.0, 1.5, 2.0), np.random.default_rng(3), 32
    middle = rng.uniform(0.8, 1.5, n) * rng.choice([-1, 1], n)
    omega = np.stack([0.2 * rng.normal(size=n), middle, 0.2 * rng.normal(size=n)], 1)
    wrt = tuple(f"{part}.{i}" for part in ("body.moments", "start.omega") for i in (1, 2, 3))
    scene = rm.Scene(rm.Body.from_moments(moments), start=rm.Start(omega=omega))
    ds = rm.simulate(
        scene, name, dt=dt, t_end=40.0, members=n, save=("flips",), wrt=wrt, every=40.0
    )
    true, times = np.zeros((6, n)), np.zeros(n)
    with mp.workdps(50):
        for k in range(n):
            p = [mp.mpf(x) for x in (*moments, *omega[k].tolist())]
            times[k] = flip_time(*p)
            for j in range(6):
                moved = lambda x, j=j, p=p: flip_time(*p[:j], x, *p[j + 1 :])  # noqa: E731
                true[j, k] = mp.diff(moved, p[j])
    size = np.abs(true).max(0)
    assert (np.abs(ds.d_flip_first.values - true) / size).max() < most
    assert np.abs(ds.flip_first / times - 1.0).max() < most


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"every": 2.0}, {"every": 4.0}, {"turn": 0.1, "every": 2.0}])
def test_derivatives_of_whole_runs_are_those_of_differences(settings):
    """Heavy tops, also with a last interval that is shorter, and with steps of their own."""
    rng, n = np.random.default_rng(1), 32
    q = rng.normal(size=(n, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    omega, wrt = 1.5 * rng.normal(size=(n, 3)), ("start.omega.1", "effects.gravity.g")

    def scene(first=0.0, g=9.81):
        body = rm.Body.from_moments((1.0, 1.5, 2.0), mass=1.0, centre=(0.05, 0.02, 0.1))
        start = rm.Start(omega=omega + [first, 0.0, 0.0], attitude=q)
        cone = rm.Passage(axis=3, angle=1.0)
        return rm.Scene(body, effects=(rm.Gravity(g=g),), start=start, observables=(cone,))

    settings = {
        "integrator": "rk4", "dt": 0.02, "t_end": 6.0, "members": n, "save": ALL, **settings
    }  # fmt: skip
    if "turn" in settings:
        del settings["dt"]
    run = rm.simulate(scene(), wrt=wrt, **settings)
    for name, step in (("first", 1e-5), ("g", 1e-5)):
        at = {"first": 0.0, "g": 9.81}[name]
        high, low = (rm.simulate(scene(**{name: at + s}), **settings) for s in (step, -step))
        j = ("first", "g").index(name)
        for d_name in run.data_vars:
            if run[d_name].dims[0] == "parameter":
                true = (high[d_name[2:]] - low[d_name[2:]]).values / (2.0 * step)
                error = np.abs(run[d_name].values[j] - true)
                size = np.nanmax(np.abs(true))
                assert np.nanmax(error) < 1e-6 * size + 1e-8, (d_name, np.nanmax(error), size)
