"""Prepared runs: with other members and other numbers they give the bits of runs of their own.

200 random scenes and numbers (about three minutes)::

    pytest -n 0 -m slow tests/runs/test_prepared.py
"""

import gc
import math
from dataclasses import replace

import numpy as np
import psutil
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.physics.effects.protocol import is_random
from rigidmc.results.layout import Selection
from rigidmc.runs.resources import block_of
from rigidmc.scene.scene import scene_of
from rigidmc.scene.varied import variables
from tests.tools import random_scenes

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")

RACKET = rm.Scene(
    rm.Body((1.0, 2.0, 2.5), mass=1.0, centre=(0.0, 0.0, 0.1)),
    rm.Gravity(0.5),
    rm.Start(omega=(0.1, 2.0, 0.1), attitude=(0.1, 0.4, 0.0)),
).with_run(dt=0.05, t_end=2.0, every=0.5, save=("omega", "attitude", "energy"))
OMEGA = np.array([[0.1, 2.0, 0.1], [0.3, 1.5, 0.0], [1.0, 0.0, 2.0], [0.5, 0.5, 0.5]])


def same(one, other):
    return all(
        np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f")
        for name in map(str, one.data_vars)
    )


def numbers(scene, names, count, chance):
    """{name: numbers of members} near those of the scene."""
    found = {}
    for name in names:
        value = np.asarray(rm.prepare(scene, varied=name).scene.run.varied[name])
        found[name] = value * chance.uniform(0.99, 1.01, (count, *value.shape))
    return found


def test_other_members_are_those_of_a_longer_run():
    run = rm.prepare(RACKET, members=3)
    whole = rm.simulate(RACKET, members=40)
    assert same(run.run(), whole.isel(member=slice(3)))
    assert same(run.run(members=40), whole)
    assert same(run.run(members=range(5, 9)), whole.isel(member=slice(5, 9)))
    some = run.run(members=[2, 30])
    assert some.member.values.tolist() == [2, 30]
    assert same(some, whole.isel(member=[2, 30]))


@pytest.mark.parametrize("integrator", ["rk4", "exact", "strang", "midpoint"])
@pytest.mark.parametrize("units", [1.0, 2.0**-200])
def test_other_numbers_are_those_of_a_scene_with_them(integrator, units):
    """Also in units of which squares leave the range of numbers."""
    body = rm.Body((1.0 * units, 2.0 * units, 2.5 * units))
    scene = replace(RACKET, body=body, effects=()).with_run(integrator=integrator)
    varied = {"start.omega": OMEGA, "body.moments.1": units * np.array([1.0, 1.2, 0.9, 1.1])}
    ds = rm.prepare(scene, varied=varied).run(values=varied)
    own = rm.simulate(scene_of(ds))
    assert same(ds, own) and ds.attrs == own.attrs
    moments = (varied["body.moments.1"], 2.0 * units, 2.5 * units)
    rows = replace(
        scene, body=replace(body, moments=moments), start=replace(scene.start, omega=OMEGA)
    )
    if integrator == "rk4":
        plain = rm.simulate(rows)
        assert same(ds[["omega", "attitude"]], plain[["omega", "attitude"]])
    again = rm.rerun(ds, member=1)
    assert again.attrs["rerun"].startswith("equal to the bit at 5 times")
    turned = rm.simulate(rows.with_run(integrator=integrator, dt=0.01))
    assert not same(ds[["omega"]], turned[["omega"]])


def test_a_symmetry_of_the_plan_is_none_of_its_members():
    """By the two equal moments of the plan a drift of one turn would do."""
    scene = replace(RACKET, body=rm.Body((1.0, 1.0, 2.0)), effects=())
    scene = scene.with_run(integrator="exact")
    moments = np.array([[1.0, 1.5, 2.0], [1.0, 1.0, 2.0]])
    ds = rm.prepare(scene, varied="body.moments").run(values={"body.moments": moments})
    true = rm.simulate(replace(scene, body=rm.Body(moments)), integrator="closed")
    assert np.abs(ds.omega - true.omega).max() < 1e-12  # measured 4e-15
    plain, varied = (
        rm.prepare(scene, varied=names).plan.scheme.integrator for names in ((), "body.moments")
    )
    assert plain != varied


def test_a_member_beyond_the_plan_is_flagged():
    run = rm.prepare(RACKET.with_run(turn_limit=0.5), varied="start.omega")
    ds = run.run(values={"start.omega": OMEGA * [[1.0], [1.0], [9.0], [1.0]]})
    assert (ds.status.values != 0).tolist() == [False, False, True, False]


@pytest.mark.parametrize(
    ("varied", "values", "words"),
    [
        ("start.omga", None, "did you mean 'start.omega'"),
        ("start.omega", {}, "lacks start.omega"),
        ("start.omega", {"start.omga": OMEGA, "start.omega": OMEGA}, "start.omega'?"),
        ("start.omega", {"start.omega": OMEGA[0]}, "has the shape (3,), expected (members, 3)"),
        ("start.omega", {"start.omega": OMEGA[:, :2]}, "expected (4, 3)"),
        ("start.omega", {"start.omega": np.full((2, 3), np.nan)}, "not finite"),
        ("start.omega", None, "run varies start.omega"),
    ],
)
def test_wrong_values_are_refused(varied, values, words):
    with pytest.raises(rm.RigidmcError) as told:
        rm.prepare(RACKET, varied=varied).run(values=values)
    assert words in str(told.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("start.omega.1.mean", "differ by start.omega.1 itself, not by its distribution"),
        ("body.tensor.1.1", "turns the principal axes"),
        ("start.attitude.2", "one of the four numbers of a quaternion"),
        ("body.cylinder.radius", "only body.cylinder.mass can be varied"),
        ("start.momentum", "draws start.momentum: give numbers in its place"),
        ("start.momentum.kT", "draws start.momentum"),
        ("effects.magnus.1", "did you mean"),
    ],
)
def test_names_that_cannot_vary_are_refused_with_the_reason(name, words):
    scene = replace(RACKET, start=rm.Start(omega=(0.1, 2.0, 0.1), attitude=(1.0, 0.0, 0.0, 0.0)))
    if "cylinder" in name:
        scene = replace(scene, body=rm.Body.cylinder(mass=2.0, radius=0.3, height=0.5))
    if "momentum" in name:
        scene = replace(scene, start=rm.Start(momentum=rm.GibbsMomentum(kT=1.0)))
    with pytest.raises(rm.SceneError, match=words):
        rm.prepare(scene, varied=name)


def test_a_run_chooses_its_derivatives():
    """A result has the derivatives of a run prepared with them, without further kernels."""
    run = rm.prepare(RACKET, varied="start.omega", wrt="body.moments.1")
    values, names = {"start.omega": OMEGA}, ["effects.gravity.g", "body.moments.1"]
    whole, some = run.run(values=values), run.run(values=values, wrt=names)
    assert same(some.sel(parameter=names[1:]), whole) and scene_of(some).run.wrt == tuple(names)
    assert run.with_derivatives(names).program().kernel_keys == run.program().kernel_keys
    plain = run.run(values=values, wrt=())
    assert "parameter" not in plain.dims and same(plain, whole.drop_dims("parameter"))
    assert run.run(values=values, wrt=names, members=[1, 3]).equals(some.isel(member=[1, 3]))
    with pytest.raises(rm.SceneError, match="did you mean"):
        run.run(values=values, wrt="start.omga.1")


@pytest.mark.slow
@pytest.mark.parametrize("names", ["start.omega.1", ["effects.gravity.g", "body.moments"]])
def test_chosen_derivatives_equal_those_of_a_run_prepared_with_them(names):
    """Kernels for one, two and three derivatives of a number give each the same bits."""
    values, run = (
        {"start.omega": OMEGA},
        rm.prepare(RACKET, varied="start.omega", wrt="body.moments"),
    )
    own = rm.prepare(RACKET, varied="start.omega", wrt=names)
    chosen = run.run(values=values, wrt=names)
    assert chosen.identical(own.run(values=values))
    assert rm.rerun(chosen, member=1).attrs["rerun"].startswith("equal to the bit")
    assert own.with_derivatives("body.moments").run(values=values).identical(run.run(values=values))


@pytest.mark.slow
def test_the_mass_of_a_solid_varies_with_its_moments():
    """Without torques omega does not depend on the mass, and the energy is in proportion."""
    sizes, mass = {"radius": 0.3, "height": 0.5}, np.array([0.5, 2.0, 3.0])
    scene = replace(RACKET, body=rm.Body.cylinder(mass=2.0, **sizes), effects=())
    run = rm.prepare(scene, "rk4", varied="body.cylinder.mass", wrt="body.cylinder.mass")
    ds = run.run(values={"body.cylinder.mass": mass})
    each = (ds.energy / mass).values
    assert np.ptp(each, axis=-1).max() < 1e-14 * each.max()  # measured 4.8e-16
    assert np.abs(ds.d_energy.values[0] - each).max() < 1e-14 * each.max()  # measured 1.6e-16
    assert np.abs(ds.d_omega).max() < 1e-14  # measured 3.8e-16
    assert np.allclose(ds.moments[:, 2], rm.Body.cylinder(mass=3.0, **sizes).moments, 1e-15, 0)
    assert rm.rerun(ds, member=1).attrs["rerun"].startswith("equal to the bit")


def test_members_that_a_scene_lacks_are_refused():
    rows = replace(RACKET, start=replace(RACKET.start, omega=OMEGA))
    for scene, members in ((rows, 5), (rows, range(3, 6)), (RACKET, [3, 1]), (RACKET, range(0))):
        with pytest.raises(rm.SceneError):
            rm.prepare(scene).run(members=members)


ROWS = 5  # of tables and of values; arrays of 3 or 4 rows read two ways


def drawn(kind, seed):
    """(scene, numbers of what is varied, names) of a random scene."""
    chance = np.random.default_rng([seed, 17])
    scene = random_scenes.scene(kind, seed, members=ROWS)
    able = [name for name in variables(scene.model) if not name.startswith("body.c")]
    names = list(dict.fromkeys(chance.choice(able, 2)))
    names = [name for name in names if not any(n != name and name.startswith(n) for n in names)]
    return scene, names, chance


def compared(kind, seed):
    """Whether a random scene was taken; its bits are compared."""
    scene, names, chance = drawn(kind, seed)
    try:
        run, values = rm.prepare(scene, varied=names), numbers(scene, names, ROWS, chance)
        ds = run.run(values=values)
    except rm.SceneError as error:
        assert "no closed form" in str(error), error
        return False
    own = rm.simulate(scene_of(ds))
    assert same(ds, own), (kind, seed, names)
    if not (scene.run.turn or any(map(is_random, scene.effects))):
        again = rm.rerun(ds, member=1)
        assert "equal to the bit" in again.attrs["rerun"], (kind, seed, again.attrs["rerun"])
    return True


@pytest.mark.slow
def test_two_hundred_random_scenes():
    taken = seed = 0
    every = [*random_scenes.QUICK, *random_scenes.kinds(20)]
    while taken < 200:
        taken += compared(every[seed % len(every)], seed)
        seed += 1
    assert seed < 600


@pytest.mark.slow
def test_ten_thousand_calls_leak_nothing():
    """Measured: 0.1 MB after the first thousand."""
    run = rm.prepare(RACKET, varied="start.omega")
    values, process = np.resize(OMEGA, (32, 3)), psutil.Process()
    for i in range(10_000):
        run.run(values={"start.omega": values + i * 1e-6})
        if i == 1000:
            gc.collect()
            before = process.memory_info().rss
    gc.collect()
    assert process.memory_info().rss - before < 8e6


def test_results_of_one_run_share_nothing():
    """From its second result on, a run copies one without values; each is still its own."""
    scene = rm.Scene.load("dzhanibekov").with_run(t_end=0.2, every=0.1)
    run, fresh = rm.prepare(scene, members=40), rm.prepare(scene, members=40).run()
    spoiled = [run.run(attrs={"note": "mine"}), run.run(attrs={"note": "mine"})]
    for dataset in spoiled:
        xr.testing.assert_identical(dataset.drop_attrs(deep=False), fresh.drop_attrs(deep=False))
        dataset.attrs["scene"] = dataset.omega.attrs["units"] = dataset.time.attrs["units"] = "?"
        dataset.omega.values[:] = dataset.status.values[:] = 7
    xr.testing.assert_identical(run.run(), fresh)
    for members in (range(3, 9), range(2, 8), 6, 40):
        for _ in range(2):
            expected = rm.prepare(scene, members=members).run()
            xr.testing.assert_identical(run.run(members=members), expected)


def test_a_result_is_what_xarray_makes_of_its_arrays():
    found = rm.simulate("dzhanibekov", members=2, t_end=0.1, every=0.05)
    parts = [
        {name: (v.dims, v.values, v.attrs) for name, v in some.items()}
        for some in (found.data_vars, found.coords)
    ]
    plain = xr.Dataset(*parts, found.attrs)
    xr.testing.assert_identical(found, plain)
    for name in found.coords:
        assert found[name].dtype == plain[name].dtype
        assert found.xindexes[name].equals(plain.xindexes[name])


def test_threads_have_as_many_blocks():
    """With 17 blocks on two threads, one of them waited for half a block."""
    run = rm.prepare("dzhanibekov", members=65_536, t_end=1.0)
    for threads in (2, 3):
        assert math.ceil(65_536 / block_of(run, threads, "cpu", False)) % threads == 0
    run = replace(run, members=Selection(0, 4096), plan=run.plan._replace(mean_steps=1.0))
    assert block_of(run, 1, "cpu", False) >= 4096
