"""Derivatives of event times and of results over all steps."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import mpmath as mp
import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.kernel import layout
from rigidmc.engine.program import Program
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.dual_arrays import DualArray, plain
from rigidmc.physics.observables import Megno
from rigidmc.physics.observables.saving import outputs_with_derivatives
from rigidmc.planning import monitors
from rigidmc.results.export import member_table
from rigidmc.runs import assemble, settled
from rigidmc.runs.directory import gather, resume
from rigidmc.runs.directory.create import create
from tests.runs import test_derivatives as saved
from tests.runs.test_resume import changed

WRT = saved.WRT
SCENE = saved.SCENE.with_run(save=("omega", "attitude", "energy", "flips", "omega_mean"))
LINEAR = ("flip_first", "flip_last", "flip_wait", "omega_mean")  # in the rows of a block
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
ALL = (
    "flips", "passage", "nutation", "precession", "energy_mean", "omega_variance", "omega_min",
    "omega_max", "omega_last", "attitude_mean",
)  # fmt: skip


def advance(program, block, steps, noise=None, saves=None):
    """What `Program.advance` does: the derivative of each row of a monitor by parameter j is j + 1
    times the row. Each member has flipped twice."""
    base, rows = 0.01 + abs(block[layout.MOMENTUM]), program.rows
    saved.advance(program, block, steps, noise, saves)
    at = layout.EFFECTS
    values = np.arange(1.0, rows - at + 1)[:, None] * base
    for j in range(-1, len(block) // rows - 1):
        start = (1 + j) * rows
        block[start + at : start + rows] = values * (1.0 if j < 0 else 1.0 + j)
        block[start + at + layout.COUNT] = 2.0 * (j < 0)


@pytest.fixture
def known_numbers(monkeypatch):
    monkeypatch.setattr(Program, "advance", advance)
    monkeypatch.setattr(settled, "make_program", partial(assemble.make_program, compiled=False))


def check(ds):
    """Compare the derivatives of a result with its values."""
    assert "d_flips" not in ds and "d_followed_until" not in ds
    for name in LINEAR:
        found = ds[f"d_{name}"]
        assert found.dims == ("parameter", *ds[name].dims)
        assert np.isnan(found.values[..., 3]).all() == (3 in ds.member.values)  # flagged
        true = np.multiply.outer([1.0, 2.0, 3.0], ds[name].values)
        np.testing.assert_allclose(found.values, true, 1e-13)
    return ds


def test_results_by_member_have_derivatives(known_numbers):
    ds = check(rm.simulate(SCENE, wrt=WRT, threads=2, block=32))
    assert ds.d_flip_first.attrs == {
        "units": "s per parameter_unit",
        "long_name": "derivative of time of the first flip; nan if none",
    }
    assert rm.simulate(SCENE, wrt="body.mass").d_flip_first.attrs["units"] == "s kg-1"
    some = rm.simulate(SCENE, wrt=WRT, members=[1, 2, 40])
    assert some.equals(ds.sel(member=[1, 2, 40]))
    without = rm.simulate(SCENE)
    assert without.identical(ds.drop_dims("parameter").assign_attrs(scene=without.scene))
    assert "d_omega_mean_body.moments.2_1" in member_table(ds)
    assert "d_flip_first" not in ds.rigid.summary()


def test_files_and_run_directories_have_them(known_numbers, tmp_path):
    made, file, path = rm.simulate(SCENE, wrt=WRT), tmp_path / "one.nc", tmp_path / "run"
    rm.simulate(SCENE, wrt=WRT, output=file, threads=2, block=32).close()
    with rm.open(file) as opened:
        assert list(check(opened).data_vars) == list(made.data_vars)
        for name in LINEAR:
            assert opened[f"d_{name}"].attrs == made[f"d_{name}"].attrs
    create(SCENE.with_run(wrt=WRT), path, 20_000)
    changed(path, block=32, shard=32)
    resume.resume(path, threads=1)
    with gather.consolidate(path, tmp_path / "whole.nc") as whole:
        xr.testing.assert_equal(whole.d_flip_first, made.d_flip_first)
        check(whole)
    again = rm.rerun(tmp_path / "whole.nc", 5, save=SCENE.run.save)
    assert "d_flip_first" in again.attrs["rerun"] and "differs" not in again.attrs["rerun"]
    other = rm.rerun(tmp_path / "whole.nc", 5, save=SCENE.run.save, wrt=WRT[1:])
    assert "equal to the bit" in other.attrs["rerun"] and "d_" not in other.attrs["rerun"]


def test_units_of_integration_are_those_of_the_scene_again(known_numbers):
    scene = rm.Scene(
        rm.Body.from_moments((1e-32, 2e-32, 3e-32)),
        start=rm.Start(omega=(rm.normal(0.0, 1e-9), 1e-8, 0.0)),
    ).with_run(t_end=1e8, dt=1e7, every=5e7, members=5, save=SCENE.run.save)
    run = rm.prepare(scene, wrt=WRT)
    assert run.units is not None
    ds = run.run().isel(member=[0, 1, 2, 4])
    for j, unit in enumerate(saved.UNITS):
        for name in LINEAR:
            true = (1 + j) / run.units.factor(unit) * ds[name].values
            np.testing.assert_allclose(ds[f"d_{name}"][j].values, true, 1e-13)


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
