"""The pictures, read back through their figures: data, members, labels; messages if no data."""

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure
from matplotlib.path import Path
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc import views
from rigidmc.studies.stability_map import picture as maps
from rigidmc.views import PICTURES, ensemble, globes, sphere
from rigidmc.views.descriptions import describe_body
from rigidmc.views.figures import save
from rigidmc.views.quadric import EYE, TOWARD, Quadric, screen
from rigidmc.views.sample import DRAWN, MEMBERS, TIMES, omega_or_momentum, thin_result
from tests.tools.axes import faults

MOMENTS = (1.0, 2.0, 3.0)
STATES = {"omega": "axis", "attitude": "quat"}


def euler(w, moments):
    i1, i2, i3 = moments
    torque = (i2 - i3) * w[1] * w[2], (i3 - i1) * w[2] * w[0], (i1 - i2) * w[0] * w[1]
    return np.stack(torque) / np.array(moments)[:, None]


def flips(members=400, saves=61, t_end=45.0, dt=0.05, moments=MOMENTS, spread=1e-3):
    """Free bodies about their middle axis, by RK4 in NumPy, as the Dataset of simulate()."""
    start = np.zeros((3, members))
    start[0], start[1] = np.random.default_rng(7).normal(0.0, spread, members), 1.0
    steps, w, kept = round(t_end / dt), start, []
    save = set(np.linspace(0, steps, saves).round().astype(int))
    for step in range(steps + 1):
        if step in save:
            kept.append(w)
        k1 = euler(w, moments)
        k2 = euler(w + dt / 2 * k1, moments)
        k3 = euler(w + dt / 2 * k2, moments)
        w = w + dt / 6 * (k1 + 2 * k2 + 2 * k3 + euler(w + dt * k3, moments))
    time = np.array(sorted(save)) * dt
    return dataset(time, omega=np.stack(kept), start_omega=start, moments=moments)


def dataset(time, start_omega, moments=MOMENTS, **states):
    """A Dataset as simulate() returns it, from saved states (time, component, member)."""
    members = start_omega.shape[-1]
    drift = np.geomspace(1e-14, 1e-11, members)
    variables = {
        "energy_drift_max": ("member", drift, {"units": "1", "conserved": "yes"}),
        "l2_drift_max": ("member", 2.0 * drift, {"units": "1", "conserved": "yes"}),
        "status": ("member", np.zeros(members, np.int8)),
        "moments": (("axis", "member"), np.repeat(np.array(moments)[:, None], members, axis=1)),
        "start_omega": (("axis", "member"), start_omega),
    }
    for name, values in states.items():
        variables[name] = ("time", STATES[name], "member"), values
    coords = {
        "member": np.arange(members),
        "time": ("time", np.asarray(time, float), {"units": "s"}),
        "axis": [1, 2, 3],
        "quat": list("wxyz"),
    }
    attrs = {"title": "flips", "integrator": "rk4", "dt": 0.05, "seed": 7}
    return xr.Dataset(variables, coords, attrs)


@pytest.fixture(scope="module")
def free():
    return flips()


@pytest.fixture(scope="module")
def ends(free):
    return free.isel(time=[0, -1])


@pytest.fixture
def tops(free):
    """Bodies whose axis 3 leans 0 to 40 degrees from the vertical, by a rotation about x; |L|^2 is
    not conserved."""
    half = np.radians(np.linspace(0.0, 40.0, free.sizes["member"])) / 2.0
    attitude = np.zeros((free.sizes["time"], 4, free.sizes["member"]))
    attitude[:, 0], attitude[:, 1] = np.cos(half), np.sin(half)
    tops = free.assign(attitude=(("time", "quat", "member"), attitude))
    tops["l2_drift_max"].attrs["conserved"] = "no: gravity exerts a torque"
    return tops


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def balls(figure):
    return [np.asarray(image.get_array()) for axes in figure.axes for image in axes.images]


def draw(figure):
    """Lay out and render, which is when matplotlib warns."""
    figure.canvas.draw()
    return figure


ENSEMBLES = [name for name, (file, _) in PICTURES.items() if file == "ensemble"]


@pytest.mark.parametrize("name", [*ENSEMBLES, "polhodes", "trajectory"])
def test_every_axis_has_a_label(name, free, ends, tops):
    for ds in (free, ends, tops):
        lacking = {"trajectory": ds is not tops, "middle_component": ds is ends}
        if not lacking.get(name):
            assert faults(views.picture(name)(ds)) == []


def curves(figure, label):
    """The points of the lines with a label and their parts behind the sphere, on the screen."""
    axes, lines = figure.axes[0], []
    for k, line in enumerate(axes.lines):
        if line.get_label() == label:
            both = [one.get_xydata() for one in axes.lines[k : k + 2]]
            lines.append(np.where(np.isfinite(both[0]), both[0], both[1]))
    return lines


def test_momentum_density_shows_axes_paths_and_separatrices(free):
    figure = draw(globes.momentum_density(free))
    axes, bar = figure.axes
    assert len(axes.images) == 1
    assert [text.get_text() for text in axes.texts] == ["3", "1", "2"]  # the middle axis is up
    assert set(legend(axes)) == {"other energies", "separatrix", "single members"}
    assert bar.get_ylabel() == "saved states, isotropic: 1"  # no scene, so no closed form
    words = "Direction of the angular momentum in body axes, t = 0 to 45 s"
    assert axes.get_title().replace("\n", " ") == words
    assert figure.get_suptitle() == "flips: 400 members, rk4, dt = 0.05 s, seed 7"


def test_separatrices_are_where_2t_i_mid_is_l2(free):
    lines = curves(globes.momentum_density(free), "separatrix")
    on = Quadric(turn=np.eye(3))
    for line, u in zip(lines, sphere.family(np.array([3.0, 1.0, 2.0]))[1], strict=True):
        assert np.abs(np.sum(u * u / [3.0, 1.0, 2.0], axis=1) * 2.0 - 1.0).max() < 1e-14
        x, y, _ = screen(on.points(u))
        assert np.abs(line - np.stack([x, y], 1)).max() < 1e-14  # measured 0


def test_density_is_one_for_an_isotropic_ensemble_and_holds_all_members():
    rng = np.random.default_rng(1)
    v = rng.normal(size=(3, 1_000_000))
    v /= np.linalg.norm(v, axis=0)
    even = sphere.even_directions()
    pixels = (np.arange(sphere.PIXELS) + 0.5) / (0.5 * sphere.PIXELS) - 1.0
    disc = np.hypot(pixels, pixels[:, None]) < 1.0
    for side in (1, -1):
        places = v[:2, side * v[2] > 0.0]
        shown = sphere.smooth_density(places, v.shape[1], even[:2, side * even[2] > 0.0], 1.0)
        assert (shown[1][disc] == 1.0).all()
        assert np.median(shown[0][disc]) == pytest.approx(1.0, abs=3e-3)
        # in the middle 280 of 1,000,000 members are under the kernel: 0.06
        assert np.std(shown[0][disc]) < 0.08
    octant = v[:2, (v > 0.0).all(0)]
    dense, opacity = sphere.smooth_density(octant, octant.shape[1], even[:2, even[2] > 0.0], 1.0)
    assert np.nanmedian(dense[opacity == 1.0]) == pytest.approx(8.0, abs=0.1)
    assert np.isnan(dense[: sphere.PIXELS // 3]).all()
    cap = sphere.even_directions(1e-7)  # a cap of any size, where 1 - cos is 0
    assert np.hypot(*cap[:2]).max() == pytest.approx(1e-7, rel=1e-5)


@pytest.mark.parametrize("moments", [None, np.array([1.0, 2.0, 4.0])])
def test_the_outline_is_the_rim_that_the_reader_sees(moments):
    on = Quadric(moments, Rotation.from_euler("xyz", (0.3, 0.5, 0.7)).as_matrix())
    rim = on.outline()
    x = on.points(rim)
    normal = rim @ on.turn.T
    # the line of sight touches the surface; measured 3e-10
    assert np.abs((normal * (EYE * TOWARD - x)).sum(1)).max() < 1e-8
    inside = np.random.default_rng(2).normal(size=(2000, 3))
    shown = np.stack(screen(on.points(inside / np.linalg.norm(inside, axis=1)[:, None]))[:2], 1)
    outline = np.stack(screen(x)[:2], 1)
    # a polygon of 361 corners lies within 4e-5 of the rim
    assert Path(1.0002 * outline).contains_points(shown).all()


def test_polhodes_keep_energy_and_pass_through_the_start():
    moments = np.array([[1.0, 1.0, 3.0], [2.0, 2.0, 2.0], [3.0, 3.0, 2.0]])
    l = np.array([[0.1, 2.0, 0.3], [1.0, 1.0, 0.2], [1.0, -0.1, 0.5]])
    curves = sphere.polhodes(l, moments)
    for k in range(3):
        u, inverse = l[:, k] / np.linalg.norm(l[:, k]), 1.0 / moments[:, k]
        assert np.abs(np.linalg.norm(curves[..., k], axis=1) - 1.0).max() < 1e-15  # measured 1e-16
        # measured 2e-16
        assert np.abs(curves[..., k] ** 2 @ inverse - u**2 @ inverse).max() < 1e-15
        # measured 0.11 or more: another body
        other = inverse[[1, 0, 2]]
        assert np.abs(curves[..., k] ** 2 @ other - u**2 @ other).max() > 0.1
        # measured 0.003 or less, with 721 points around
        assert np.linalg.norm(curves[..., k] - u, axis=1).min() < 0.01


def test_paths_of_tops_under_torque_are_their_saves(tops):
    saved = omega_or_momentum(tops, "momentum")[0][:, :, 0]
    line = curves(globes.momentum_density(tops), "single members")[0]
    u = saved / np.linalg.norm(saved, axis=1, keepdims=True)
    every = omega_or_momentum(tops, "momentum")[0]
    every = np.moveaxis(every / np.linalg.norm(every, axis=1, keepdims=True), 1, 0)
    turn = globes.toward_reader(every.reshape(3, -1)[[2, 0, 1]])
    x, y, _ = screen(u[:, [2, 0, 1]] @ turn.T)  # to the right is axis 3, up is axis 2
    assert np.abs(line - np.stack([x, y], 1)).max() < 1e-14


def test_middle_component_has_bands_units_and_a_few_members(free):
    figure = draw(ensemble.middle_component(free))
    (axes,) = figure.axes
    assert axes.get_xlabel() == "time [s]"
    assert axes.get_ylabel() == "ω₂ [rad/s]"
    assert legend(axes) == ["5 to 95 %", "25 to 75 %", "median", "single members"]
    median, *few = axes.lines
    assert len(few) == DRAWN
    assert np.array_equal(median.get_ydata(), np.median(free.omega.sel(axis=2), axis=1))
    assert median.get_ydata().min() < -0.99  # it flips
    assert np.array_equal(few[-1].get_ydata(), free.omega.sel(axis=2, member=399))


def test_middle_component_follows_the_middle_moment_of_each_member(free):
    mixed = free.copy(deep=True)
    mixed["moments"][:, 200:] = np.array([2.0, 1.0, 3.0])[:, None]
    mixed["omega"][:, :, 200:] = mixed.omega.values[:, [1, 0, 2], 200:]
    (axes,) = ensemble.middle_component(mixed).axes
    assert axes.get_ylabel() == "ω about the middle axis [rad/s]"
    assert np.array_equal(axes.lines[0].get_ydata(), np.median(free.omega.sel(axis=2), axis=1))
    assert "separatrices" not in legend(globes.momentum_density(mixed).axes[0])  # not one body


def test_pictures_in_principal_axes_do_not_depend_on_the_axes_of_the_description():
    """One motion, described in turned axes and in principal axes; the middle axis is principal."""
    turn = Rotation.from_euler("ZYX", (0.9, -0.6, 1.7))
    tensor = turn.as_matrix() @ np.diag([1.0, 1.6, 2.1]) @ turn.as_matrix().T
    described = rm.Body.from_tensor(0.5 * (tensor + tensor.T))
    axes, omega = np.array(described.axes), np.array([0.9, -1.3, 0.7])
    settings = {"dt": 0.1, "t_end": 5.0, "every": 0.5, "members": 2, "save": ("omega",)}
    results = [
        rm.simulate(rm.Scene(body, start=rm.Start(omega=tuple(w))), "closed", **settings)
        for body, w in ((described, omega), (rm.Body(described.moments), omega @ axes))
    ]
    assert abs(results[0].omega - results[1].omega).max() > 0.1
    for picture in (ensemble.middle_component, globes.momentum_density):
        drawn = [picture(ds).axes[0].lines for ds in results]
        one, other = ([line.get_xydata() for line in lines] for lines in drawn)
        assert len(one) == len(other) > 2
        apart = [np.abs(a - b).max() for a, b in zip(one, other, strict=True)]
        assert max(apart) < 1e-13  # measured 1.3e-15
    labels = [ensemble.middle_component(ds).axes[0].get_ylabel() for ds in results]
    assert "middle" in labels[0]
    assert "middle" not in labels[1]  # the number is one of principal axes


def test_symmetric_tops_are_seen_along_their_symmetry_axis(free):
    moments = np.repeat([[2.0], [2.0], [1.0]], 400, axis=1)
    lagrange = free.assign(moments=free.moments.copy(data=moments))
    texts = draw(globes.momentum_density(lagrange)).axes[0].texts
    assert [text.get_text() for text in texts] == ["1", "2", "3"]
    title = ensemble.middle_component(lagrange).axes[0].get_title()
    assert title == "Angular velocity normal to the symmetry axis"


def test_momentum_saved_instead_of_omega_gives_the_same_pictures(free):
    other = free.assign(momentum=free.omega * free.moments).drop_vars("omega")
    one, two = (balls(globes.momentum_density(ds)) for ds in (free, other))
    assert np.array_equal(one, two)
    medians = [ensemble.middle_component(ds).axes[0].lines[0].get_ydata() for ds in (free, other)]
    assert np.abs(medians[0] - medians[1]).max() < 1e-15  # measured 0: moments are 1, 2, 3
    started = other.rename(start_omega="start_momentum").drop_vars("momentum")
    started["start_momentum"] = started.start_momentum * started.moments
    assert np.isfinite(omega_or_momentum(started, "omega")[0]).all()


def test_drift_histogram_marks_median_worst_and_zeros(free):
    ds = free.copy(deep=True)
    ds["energy_drift_max"][:3] = 0.0
    (axes,) = draw(ensemble.drift_histogram(ds)).axes
    assert axes.get_xlabel() == "largest relative drift"
    assert axes.get_xscale() == "log"
    energy, l2 = legend(axes)
    assert energy == "E: median (¦) 3.2e-13, worst (▾) 1.0e-11; 3 members at 0"
    assert l2 == "|L|²: median (¦) 6.3e-13, worst (▾) 2.0e-11"
    assert [patch.get_data().values.sum() for patch in axes.patches] == [397, 400]
    assert "conserved" not in axes.get_title()


def test_drift_histogram_says_what_is_not_conserved(tops):
    title = draw(ensemble.drift_histogram(tops)).axes[0].get_title()
    assert title.replace("\n", " ").endswith("|L|² is not conserved: gravity exerts a torque")
    assert "E is" not in title


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_drift_histogram_without_a_drift_to_show(free, value):
    values = "member", np.full(400, value)
    ds = free.assign(energy_drift_max=values, l2_drift_max=values)
    patches = draw(ensemble.drift_histogram(ds)).axes[0].patches
    assert sum(patch.get_data().values.sum() for patch in patches) == 0


def test_axis_density_shows_the_third_column_of_a(tops):
    """Axis 3 leans from the vertical to -y, by 40 degrees at most."""
    figure = draw(globes.axis_density(tops))
    axes = figure.axes[0]
    image = np.asarray(axes.images[0].get_array())
    blue = image[..., 2] - image[..., 0] > 0.2
    row, column = np.nonzero(blue)
    size = axes.images[0].get_extent()[1]
    place = np.stack([column, row], 1) / (0.5 * sphere.PIXELS) * size - size
    lean = np.radians(np.linspace(0.0, 40.0, 200))
    u = np.stack([0.0 * lean, -np.sin(lean), np.cos(lean)])
    turn = globes.toward_reader(u)
    line = np.stack(screen((turn @ u).T)[:2], 1)
    far = np.linalg.norm(place[:, None] - line[None], axis=2).min(1)
    assert far.max() < 0.08  # measured 0.067, where the kernel fades
    assert np.linalg.norm(place[:, None] - line[None], axis=2).min(0).max() < 0.03
    words = "Axis 3 of the body in space, t = 0 to 45 s"
    assert axes.get_title().replace("\n", " ") == words


@pytest.mark.parametrize(
    ("angle", "words"),
    [(9e-7, "0.2\N{DOUBLE PRIME}"), (2e-4, "1\N{PRIME}"), (0.01, "1°"), (0.4, "30°")],
)
def test_the_rim_of_a_cap_is_the_next_round_angle(angle, words):
    start = rm.Start(momentum=rm.Cone(3, 1.0, angle))
    scene = rm.Scene(rm.Body((1.0, 1.0, 1.5)), start=start)
    ds = rm.simulate(scene, members=32, dt=0.1, t_end=1.0, save=("omega",))
    axes = draw(globes.momentum_density(ds)).axes[0]
    assert f"rim: {words} from centre" in legend(axes)


def test_summary_composes_all_and_heads_them(free, tops):
    figure = draw(ensemble.summary(free))
    titles = " ".join(axes.get_title() for axes in figure.axes).replace("\n", " ")
    known = "Direction of the angular momentum", "middle moment", "drift"
    assert all(words in titles for words in known)
    assert figure.get_suptitle().startswith("flips: 400 members, rk4, dt = 0.05 s, seed 7")
    assert "Axis 3" not in titles
    titles = [axes.get_title() for axes in draw(ensemble.summary(tops)).axes]
    assert "Axis 3" in " ".join(titles) and "Angle of axis 3 from the vertical" in titles


def test_summary_of_a_few_members_draws_lines():
    """No quantiles of three members: one line each, in the colours of their paths; and a power of
    ten of the ticks stands in the label."""
    start = rm.Start(omega=(rm.normal(0.0, 1e-8), 1e-7, 0.0))
    scene = rm.Scene(rm.Body.box(1.0, (0.3, 0.2, 0.1)), start=start)
    ds = rm.simulate(scene, "closed", members=3, t_end=4e8, every=1e7, save=("omega",))
    figure = draw(ensemble.summary(ds))
    series = next(axes for axes in figure.axes if axes.get_xlabel().startswith("time"))
    assert series.get_xlabel() == "time [$10^{8}$ s]"
    assert series.get_ylabel() == "ω₂ [$10^{-7}$ rad/s]"
    labels = {line.get_label() for line in series.lines}
    assert {"member 0, drawn above", "member 1", "member 2"} <= labels
    assert not series.collections  # no band
    assert "Angular momentum in principal axes" in " ".join(a.get_title() for a in figure.axes)


def test_summary_of_first_and_last_save_shows_the_spread(ends):
    figure = draw(ensemble.summary(ends))
    title = "Spread of the angular velocity"
    spread = next(axes for axes in figure.axes if axes.get_title() == title)
    assert legend(spread) == ["t = 0 s", "t = 45 s"]
    assert spread.get_xlabel() == "angular velocity, body axes [rad/s]"
    assert "t = 45 s" in figure.axes[1].get_title()


def test_summary_without_states_shows_the_start_and_says_so(free):
    bare = free.drop_vars("omega")
    figure = draw(ensemble.summary(bare))
    assert figure.axes[1].get_title().endswith("at the start (later states were not saved)")
    assert any(
        axes.get_legend() and legend(axes) == ["at the start (later states were not saved)"]
        for axes in figure.axes
    )
    for ds, picture, wanted in (
        (bare, ensemble.middle_component, "every="),
        (bare, globes.axis_density, 'save=("attitude",)'),
        (bare.drop_vars("start_omega"), globes.momentum_density, 'save=("omega",)'),
    ):
        with pytest.raises(ValueError, match="run with") as error:
            picture(ds)
        assert wanted in str(error.value)


def test_a_flagged_member_is_left_out_and_counted(free):
    bad = free.copy(deep=True)
    bad["status"][5], bad["omega"][30:, :, 5], bad["energy_drift_max"][5] = 1, 1e6, 1e9
    bad["omega"][2, 1, 6] = np.nan  # not flagged, and harmless
    good = free.drop_sel(member=[5, 6])
    figure = draw(ensemble.summary(bad))
    assert figure.get_suptitle().endswith("1 flagged and excluded")
    assert np.array_equal(balls(figure), balls(ensemble.summary(good)))
    axes = [ensemble.middle_component(ds).axes[0] for ds in (bad, good)]
    assert np.array_equal(*(one.lines[0].get_ydata() for one in axes))
    assert "worst (▾) 1.0e-11" in legend(ensemble.drift_histogram(bad).axes[0])[0]
    bad["status"][5] = 0
    one, two = (balls(ensemble.summary(ds)) for ds in (bad, good))
    assert not np.array_equal(one, two, equal_nan=True)


def test_nothing_but_flagged_members(free):
    dead = free.assign(status=("member", np.ones(400, np.int8)))
    words = "nothing to draw: every member is flagged"
    assert draw(ensemble.summary(dead)).texts[-1].get_text() == words
    with pytest.raises(ValueError, match="400 members"):
        globes.momentum_density(dead)


@pytest.mark.parametrize("members", [1, 2, 3])
def test_a_handful_of_members(free, members):
    figure = draw(ensemble.summary(free.isel(member=slice(members))))
    assert f"{members} member{'s' if members > 1 else ''}," in figure.get_suptitle()


def test_bodies_at_rest_have_no_direction():
    rest = dataset([0.0, 1.0], np.zeros((3, 5)), omega=np.zeros((2, 3, 5)))
    assert "at rest" in draw(ensemble.summary(rest)).axes[1].texts[0].get_text()


def test_spherical_bodies_and_bodies_that_stay_on_an_axis():
    start = np.repeat([[0.0], [0.0], [1.0]], 4, axis=1)
    for moments in ((2.0, 2.0, 2.0), (1.0, 2.0, 3.0)):
        states = np.repeat(start[None], 3, axis=0)
        draw(ensemble.summary(dataset([0.0, 1.0, 2.0], start, moments, omega=states)))


def test_what_is_read_is_bounded_and_ends_with_the_last_save():
    # 7 GB, were it in memory
    huge = np.broadcast_to(np.array([0.1, 1.0, 0.2])[None, :, None], (1001, 3, 300_000))
    part = thin_result(dataset(np.arange(1001.0), huge[0], omega=huge))
    assert part.sizes["time"] <= TIMES
    assert part.sizes["member"] <= MEMBERS
    assert part.time[-1] == 1000.0
    assert thin_result(part).sizes == part.sizes
    two = thin_result(dataset([0.0, 1.0], huge[0], omega=huge[:2]))
    assert two.sizes["member"] == 300_000  # under POINTS vectors all members are read


@pytest.mark.parametrize("number", [1e-20, 1e20])
def test_a_map_of_one_column_is_as_wide_as_its_number(number):
    edges = maps._edges(xr.DataArray([number], attrs={"log": 0}))
    assert edges.tolist() == pytest.approx([0.5 * number, 1.5 * number], rel=1e-12, abs=0.0)
    edges = maps._edges(xr.DataArray([number], attrs={"log": 1}))
    assert edges[1] / edges[0] == pytest.approx(np.e, rel=1e-12)


def test_a_small_centre_is_told():
    body = rm.Body((1e-40, 1.2e-40, 2e-40), 1e-10, (1e-16, 2e-16, 0.0))
    told = next(line for line in describe_body(body, "body") if line.startswith("centre"))
    assert "(1e-16, 2e-16, 0) m" in told


def test_a_picture_goes_into_given_axes(free):
    figure = Figure((4.0, 3.0))
    axes = figure.add_subplot()
    assert ensemble.middle_component(free, axes) is figure
    assert figure.axes == [axes]
    assert figure.get_suptitle() == ""
    assert ensemble.summary(free, figure) is figure


@pytest.mark.parametrize(
    ("suffix", "magic"),
    [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml"), ("PNG", b"\x89PNG")],
)
def test_save_writes_by_suffix_and_leaves_nothing_else(free, tmp_path, suffix, magic):
    path = tmp_path / f"flips.{suffix}"
    save(ensemble.drift_histogram(free), str(path))
    assert path.read_bytes().startswith(magic)
    assert list(tmp_path.iterdir()) == [path]


def test_save_refuses_other_suffixes_and_keeps_the_old_picture(free, tmp_path, monkeypatch):
    figure = ensemble.drift_histogram(free)
    for name in ("flips.jpeg", "flips"):
        with pytest.raises(ValueError, match=r"\.png, \.pdf, \.svg"):
            save(figure, tmp_path / name)
    old = tmp_path / "flips.png"
    old.write_bytes(b"old")

    def full(half, **_):
        half.write(b"half")
        raise OSError("No space left on device")

    with pytest.raises(FileExistsError, match="--force"):
        save(figure, old)
    monkeypatch.setattr(figure, "savefig", full)
    with pytest.raises(OSError, match="No space"):
        save(figure, old, force=True)
    assert old.read_bytes() == b"old" and list(tmp_path.iterdir()) == [old]


def test_pyplot_is_left_alone():
    code = "import sys, rigidmc.views.ensemble; assert 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
