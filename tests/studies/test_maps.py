"""Maps against theory, pixels against single runs, blank and failed pixels, pictures.

Also ensembles that grow until a number is known.
"""

import inspect
import re

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.errors import OptionError, SceneError
from rigidmc.mechanics.free_top import analyse_free_top
from rigidmc.physics.observables import Flips
from rigidmc.results.variables import Variable
from rigidmc.scene.parameters import parameter_names, with_parameters
from rigidmc.statistics.intervals import probability
from rigidmc.statistics.measures import measure
from rigidmc.studies.stability_map import cases
from rigidmc.studies.stability_map.cases import MAPS
from rigidmc.studies.stability_map.compute import prepared_case, run_map
from rigidmc.studies.stability_map.picture import stability_map
from rigidmc.studies.stability_map.study import table
from rigidmc.studies.until import simulate_until
from tests.tools.axes import faults
from tests.tools.commands import invoke

SIDE, EACH = 12, 4
# of steps of 1.2 rad, which rk8 takes
pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")


@pytest.fixture(scope="module")
def flips():
    return run_map(prepared_case("intermediate_axis", SIDE, EACH), threads=2)


def members_of(scene, i, j):
    alone = [
        rm.simulate(scene, members=range(m, m + 1))
        for m in range(i * SIDE + j, SIDE * SIDE * EACH, SIDE * SIDE)
    ]
    return xr.concat(alone, "member")


def test_every_map_is_in_the_catalogue():
    functions = filter(inspect.isfunction, vars(cases).values())
    makers = {f for f in functions if f.__annotations__["return"] is cases.MapCase}
    assert makers == set(MAPS.values())


def test_a_pixel_is_a_run_of_its_members(flips):
    scene = rm.Scene.loads(flips.attrs["scene"])
    for i, j in ((0, 3), (5, 9), (11, 2)):
        one = members_of(scene, i, j)
        good = one.status.values == 0
        assert flips.good.values[i, j] == good.sum()
        assert flips.none.values[i, j] == (one.status.values == 2).sum()
        if good.any():
            found = one.flips.values[good].mean(), one.flip_wait.values[good].mean()
            assert (
                flips["mean(flips)"].values[i, j],
                flips["mean(flip_wait)"].values[i, j],
            ) == pytest.approx(found, rel=1e-15)
        assert np.array_equal(one.moments.values[0], np.full(EACH, flips.x.values[j]))


def test_impossible_bodies_are_blank(flips):
    one, three = np.meshgrid(flips.x.values, flips.y.values)
    exists = three <= 1.0 + one
    assert np.array_equal(flips.none.values == 0, exists)
    assert np.array_equal(np.isfinite(flips["mean(flips)"].values), exists)
    assert not flips.failed.values.any() and set(flips.none.values.ravel()) == {0, EACH}


def test_flips_come_at_the_pace_of_the_closed_form(flips):
    scene = rm.Scene.loads(flips.attrs["scene"])
    ds = rm.simulate(scene)
    good = ds.status.values == 0
    momentum = (ds.start_omega * ds.moments).values.T[good]
    interval = analyse_free_top(ds.moments.values.T[good], momentum).flip_interval
    error = np.abs(ds.flip_wait.values[good] / interval - 1.0)
    assert np.nanmedian(error) < 1e-6  # measured 1.3e-8, in steps of 1.2 s
    assert np.median(ds.flips.values[good]) >= 18.0


def test_intervals_hold_the_mean_of_many(flips):
    i, j = 3, 8
    scene = rm.Scene.loads(flips.attrs["scene"])
    members = members_of(scene, i, j).flips.values
    half = flips["mean(flips)_high"].values[i, j] - flips["mean(flips)"].values[i, j]
    # Student's t, 3 degrees of freedom
    assert half == pytest.approx(3.182 * members.std(ddof=1) / 2.0, rel=1e-3)


def test_the_sleeping_top_falls_within_a_pixel_of_theory():
    ds = run_map(prepared_case("sleeping_top", 24, 2), threads=2)
    fallen, sleeps = ds["p(passages>=1)"].values > 0.5, ds.theory.values > 0.0
    near = np.zeros_like(sleeps)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            near |= np.roll(sleeps, (di, dj), (0, 1)) != sleeps
    assert np.array_equal(fallen[~near], ~sleeps[~near]) and fallen.any() and not fallen.all()


def test_the_picture_has_axes_units_and_a_legend(flips, tmp_path):
    figure = stability_map(flips)
    axes, bar = figure.axes
    assert axes.get_xlabel() == "I₁, with I₂ = 1 [kg m²]"
    assert axes.get_ylabel() == "I₃, with I₂ = 1 [kg m²]"
    assert "[1/s]" in bar.get_ylabel()
    words = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "impossible body or start" in words and any("theory" in w for w in words)
    figure.savefig(tmp_path / "map.png", dpi=60)
    assert (tmp_path / "map.png").stat().st_size > 10_000
    bare = flips.assign_attrs(map="none").drop_vars(["rate", "theory"])
    axes, bar = (drawn := stability_map(bare)).axes
    assert faults(drawn) == [] and faults(figure) == []
    assert axes.get_xlabel() == "I₁ [kg m²]" and "mean(flips)" in bar.get_ylabel()
    failed = bare.failed.copy(data=np.where(bare.none.values == 0, EACH, 0))
    failed = bare.assign(failed=failed, good=bare.good * 0)
    texts = stability_map(failed).axes[0].get_legend().get_texts()
    assert "failed members" in [text.get_text() for text in texts]


def test_a_share_has_a_line_where_half_of_the_members_do():
    start = rm.Start(omega=(0.1, rm.uniform(0.0, 1.0), 0.1))
    scene = rm.Scene(rm.Body((0.5, 1.0, 1.4)), start=start)
    axes = ("start.omega.1", 0.1, 1.0), ("start.omega.3", 0.1, 1.0)
    ds = rm.stability_map(scene, *axes, "p(flips >= 1)", 8, 4, dt=0.1, t_end=0.2)
    assert ds.sizes == {"x": 8, "y": 8}
    rise = np.broadcast_to(np.linspace(0.0, 1.0, 8), (8, 8)).copy()
    rise[3, 6], rise[0, 7] = 0.0, np.nan  # one pixel of noise, and one without a member
    (name,) = (n for n in map(str, ds.data_vars) if n.startswith("p(") and n.endswith(")"))
    axes = stability_map(ds.assign({name: ds[name].copy(data=rise)})).axes[0]
    words = [text.get_text() for text in axes.get_legend().get_texts()]
    assert words[-1] == "half of the members"
    # the numbers of the lines on the command line have units
    rates = ds.assign({name: ds[name].copy(data=rise).assign_attrs(units="rad s-1")})
    assert "0 to 1 rad/s, median " in "\n".join(table(rates))
    lines = [c for c in axes.collections if c.get_paths() and hasattr(c, "levels")]
    (line,) = (c for c in lines if c.levels[0] == 0.5)
    x = np.concatenate([path.vertices[:, 0] for path in line.get_paths()])
    assert np.ptp(x) < 2.0 * float(ds.x[1] - ds.x[0])  # straight up but for the noise
    none = stability_map(ds.assign({name: ds[name].copy(data=0.2 * rise)})).axes[0]
    assert none.get_legend() is None or "half" not in str(none.get_legend().get_texts())


def test_the_default_resolution_is_that_of_the_map_or_of_scenes():
    assert inspect.signature(prepared_case).parameters["resolution"].default == 256
    assert inspect.signature(rm.stability_map).parameters["resolution"].default == 128


def test_failed_members_are_never_stable():
    """Too long a step flags every member: the map says so and has no number for them."""
    start = rm.Start(omega=(0.01, 1.0, 0.01))
    scene = rm.Scene(rm.Body((0.5, 1.0, 1.4)), start=start, observables=(Flips(2),))
    sides = ("start.omega.2", 30.0, 40.0), ("body.moments.1", 0.45, 0.5)
    run = {"integrator": "rk8", "dt": 1.2, "t_end": 840.0}
    ds = rm.stability_map(scene, *sides, "p(flips >= 1)", (3, 2), 4, **run)
    assert (ds.failed.values == 4).all()
    assert np.isnan(ds["p(flips>=1)"].values).all()
    assert not ds.good.values.any()


def free(**run):
    start = rm.Start(omega=rm.Cone(2, 1.0, rm.uniform(0.0, 0.3)))
    scene = rm.Scene(rm.Body((0.5, 1.0, 1.4)), start=start, observables=(Flips(2),))
    return scene.with_run(integrator="rk8", dt=1.2, t_end=12.0, save=(), **run)


def test_members_are_added_until_it_is_known_and_no_bit_differs():
    looks = []
    told = lambda n, _: looks.append(n)  # noqa: E731
    ds, found = simulate_until(free(), "p(flips >= 1) +- 0.004", progress=told)
    assert found.half <= 0.004
    assert looks[0] == 8192
    assert 2 <= len(looks) <= 4
    assert ds.sizes["member"] == looks[-1]
    assert simulate_until(free(), "p(flips >= 1) +- 0.05")[0].sizes["member"] == 8192
    at_once = rm.simulate(free(), members=looks[-1])
    assert all(ds[name].values.tobytes() == at_once[name].values.tobytes() for name in ds.data_vars)
    assert found == tuple(map(float, probability((ds.flips.values >= 1).sum(), looks[-1])))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p(flips >= 1) +- 1e-5", "needs about"),
        ("p(flips >= 1)", "half the width"),
        ("p(flips >= 1) +- 0", "half the width"),
        ("p(flip >= 1) +- 0.1", "flips"),
        ("p(flips > ) +- 0.1", "expected p"),
        ("p(flips > 100) +- 1 %", "give an absolute width"),
        ("quantile(passage_first, 0.5) +- 1", "no such variable"),
    ],
)
def test_what_cannot_be_reached_is_told(text, words):
    with pytest.raises(OptionError, match=words):
        simulate_until(free(), text, most=1_000_000)


def test_a_goal_that_is_not_reached_is_reported():
    with pytest.warns(rm.SceneWarning, match="not reached"):
        ds, found = simulate_until(free(), "p(flips >= 1) +- 0.001", most=8192)
    assert ds.sizes["member"] == 8192 and found.half > 0.001
    words = "run tennis_racket --save flips --most 5000 --until", "p(flips >= 3) +- 0.001"
    made = invoke(*words)
    assert made.exit_code == 5 and "not reached" in made.stderr
    made = invoke("run tennis_racket --t-end 0.1 --until", "mean(flip_wait) +- 1 %")
    assert made.exit_code == 3 and "none of the first" in made.stderr


def test_names_of_parameters():
    start = rm.Start(omega=rm.Cone(2, 1.0, 0.1), attitude=(0.0, 1.0, 0.0))
    effects = rm.Gravity(9.81), rm.Spring(1.0, (0, 0, 1), (0, 0, 1))
    scene = rm.Scene(rm.Body((1, 1, 1)), effects, start)
    for i, name in enumerate(parameter_names(scene.model)):
        changed = with_parameters(scene.model, {name: 1.5 + 0.001 * i})
        flat = [x for x in changed.quantities() if isinstance(x, float)]
        assert flat.count(1.5 + 0.001 * i) == 1, name
    with pytest.raises(SceneError, match=r"did you mean 'effects\.gravity\.g'"):
        with_parameters(scene.model, {"effects.gravity.h": 1.0})


DIMS = {"flips": "member", "omega_max": "axis member", "omega": "time axis member"}
VARIABLES = {name: Variable(tuple(dims.split()), "f8", {}) for name, dims in DIMS.items()}


MEASURES = """flips; mean(flips); p(flips>=1); p( omega_max[2] < -1.5e-3 ); median(flips)
quantile(flips, 0.9); mean(flips | omega_max[2] >= 1); p(flips >= 1 | omega_max[2] < 2.5)
quantile(omega_max[1], 0.9 | flips == 2)"""
NONE = """omega; omega_max; flips[1]; p(flips); __import__('os'); mean(flips, 2); quantile(flips, 2)
p(flips => 1); flips | flips > 1; mean(flips | flips); mean(flips | omega_max > 1)
mean(flips | tilt > 1); mean(flips | flips > 1 | flips < 2); correlation(flips)
correlation(flips, omega_max)"""


@pytest.mark.parametrize("text", re.split("; |\n", MEASURES))
def test_measures(text):
    assert measure(text, VARIABLES).result.name in ("flips", "omega_max")


@pytest.mark.parametrize("text", re.split("; |\n", NONE))
def test_what_is_no_measure_is_told(text):
    with pytest.raises(OptionError):
        measure(text, VARIABLES)


def test_where_nothing_else_is_drawn_a_pixel_is_one_member():
    scene = rm.Scene(rm.Body((0.5, 1.0, 1.4)), (), rm.Start(omega=(0.01, 1.0, 0.01)))
    axes = ("start.omega.1", 0.01, 0.2), ("start.omega.3", 0.01, 0.2)
    ds = rm.stability_map(scene, *axes, "flips", resolution=1, dt=0.1, t_end=20.0)
    assert ds.attrs["members"] == 1 and stability_map(ds).axes
    sides = ((f"body.moments.{i}", 1.0, 1.1) for i in (1, 3))
    assert rm.stability_map(free(), *sides, "flips", 1, t_end=1.0).attrs["members"] == 16
    for x in (("start.omega.1", 0.0), "start.omega.1=0", "start.omega.1"):
        with pytest.raises(OptionError, match="expected"):
            rm.stability_map(scene, x, axes[1], "flips")


def test_a_map_is_no_result(tmp_path):
    file, picture = tmp_path / "m.nc", tmp_path / "m.png"
    done = invoke("map intermediate_axis --resolution 1 --plot", picture, "-o", file)
    assert done.exit_code == 0
    for text, *more in (
        ("summary", file),
        ("rerun --member 1", file),
        ("plot", file, "-o", tmp_path / "p.png"),
    ):
        made = invoke(text, *more)
        assert made.exit_code == 3 and "a map" in made.stderr, made.output


def test_the_command_maps(tmp_path):
    file, plot = tmp_path / "m.nc", tmp_path / "m.png"
    words = "map intermediate_axis --resolution 6 --members 2 -o", file, "--plot", plot
    result = invoke(*words)
    assert result.exit_code == 0 and "36" not in result.stderr
    assert "impossible pixels (body or start): 15" in result.stdout
    assert file.exists() and plot.exists()
    assert invoke(*words).exit_code == 6
    assert all(name in invoke("map list").stdout for name in MAPS)


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPS)
def test_every_map(name):
    ds = run_map(prepared_case(name, 24))
    assert not ds.failed.values.any()
    stability_map(ds)
    if name == "growth":
        error = ds.error.values[np.isfinite(ds.error.values)]
        assert (error < 0.01).mean() > 0.99
    if name == "disturbance":
        assert ds.error.values[ds.y.values > 1e-3].max() < 1e-8  # measured 1.3e-9
        assert ds.error_first.values.max() < 1e-14  # measured 6e-16
        # per factor e of the disturbance: 1/lambda, and 2/lambda between flips
        low, high = (int(np.abs(np.log(ds.y.values / y)).argmin()) for y in (1e-4, 1e-2))
        factors = np.log(ds.y.values[high] / ds.y.values[low])
        for name, slope in (("mean(flip_first)", 1.0), ("mean(flip_wait)", 2.0)):
            wait = ds[name].values
            gain = (wait[low] - wait[high]).mean() / factors / np.sqrt(3.0)
            assert abs(gain / slope - 1.0) < 1e-4  # measured 9e-6
    if name == "damped_axis":
        assert (ds.end.values != 0.0).all()
        # of 400 s; measured 124 at 256 pixels
        assert np.nanmax(ds["mean(passage_first)"].values) < 200.0
    if name == "heavy_chaos":
        megno = ds["mean(megno)"].values
        share = (megno[np.isfinite(megno)] > 3.0).mean()
        assert 0.45 < share < 0.65  # measured 0.55 at 48 and at 256 pixels
    if name == "kovalevskaya":
        assert np.nanmax(ds["mean(megno)"].values) < 3.0
