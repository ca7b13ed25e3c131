"""Adaptive maps: which pixels are computed, that these are those of the whole map, and what is
stored of a map that has not ended; and stacks, whose layers are maps."""

import json
import random

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError, OptionError
from rigidmc.runs.directory import resume
from rigidmc.runs.directory.folder import CHOSEN, RunDirectory, status
from rigidmc.scene.parameters import with_parameters
from rigidmc.studies.framework.options import read_side
from rigidmc.studies.stability_map.compute import prepare_map
from rigidmc.studies.stability_map.picture import stability_map
from rigidmc.studies.stability_map.pixels import Pixels
from rigidmc.studies.stability_map.question import make_request
from rigidmc.studies.stability_map.refine import BEGUN, STRIDE, pixel_multiple, refine
from rigidmc.studies.stability_map.stored import create_map, resume_growing
from tests.tools import torture
from tests.tools.axes import faults
from tests.tools.commands import invoke
from tests.tools.faulty import LINUX

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
START = rm.Start(omega=(rm.normal(0.0, 1e-3), 1.0, 1e-3))
SCENE = rm.Scene(rm.Body((0.5, 1.0, 1.4)), start=START)
# a body turns over on the left and right, and too late below; beyond 2.4 there is none
SIDES = ("body.moments.1", 0.2, 2.6), ("start.omega.2", 0.2, 1.5)
OF = ("p(flips >= 1)", "median(flip_wait)")
RUN = {"integrator": "rk8", "dt": 0.5, "t_end": 30.0}
SHAPE, REPLICAS = (101, 80), 2
BORDERS = ((OF[0], (0.5,)),)


@pytest.fixture(scope="module")
def whole():
    return rm.stability_map(SCENE, *SIDES, OF, SHAPE, 1, **RUN)


@pytest.fixture(scope="module")
def adaptive():
    return rm.stability_map(SCENE, *SIDES, OF, SHAPE, 1, adaptive=True, **RUN)


def started(path):
    asked = make_request(*SIDES, OF, SHAPE, 1, adaptive=True)
    return create_map(prepare_map(asked, SCENE, **RUN), path)


def equal(one, other):
    return one.drop_attrs().identical(other.drop_attrs())


def share_of_wrong(found, whole, name="p(flips>=1)"):
    one, other = found[name].values, whole[name].values
    return float(((one != other) & ~(np.isnan(one) & np.isnan(other))).mean())


def test_the_pixels_that_are_computed_are_those_of_the_whole_map(whole, adaptive):
    computed = adaptive.computed.values > 0
    for name in whole.data_vars:
        one, other = adaptive[name].values[computed], whole[name].values[computed]
        assert np.array_equal(one, other, equal_nan=True), name
    assert 0.1 < computed.mean() < 0.5  # measured 0.25
    assert share_of_wrong(adaptive, whole) < 0.001  # measured 2.5e-4, the coarse grid 0.061
    # what is not computed shows a pixel that is: the coarse grid alone is wrong more often
    rows, columns = (np.arange(size) // STRIDE * STRIDE for size in whole.good.shape)
    coarse = whole.isel(y=rows, x=columns)
    assert share_of_wrong(coarse, whole) > 5 * share_of_wrong(adaptive, whole)
    assert np.isfinite(adaptive["p(flips>=1)"].values[adaptive.none.values == 0]).all()


def test_members_of_a_pixel_are_those_of_the_whole_map():
    more = rm.stability_map(SCENE, *SIDES, OF, 24, REPLICAS, adaptive=BORDERS, **RUN)
    full = rm.stability_map(SCENE, *SIDES, OF, 24, REPLICAS, **RUN)
    computed = more.computed.values > 0
    for name in full.data_vars:
        one, other = more[name].values[computed], full[name].values[computed]
        assert np.array_equal(one, other, equal_nan=True), name
    assert json.loads(more.attrs["asked"])["borders"] == [[OF[0], [0.5]]]


def pixels_of(asked, values, low=None, high=None, known=None):
    known = np.ones(values.shape, bool) if known is None else known
    parts = [values, values if low is None else low, values if high is None else high, 0 * values]
    found = np.where(known, parts, np.nan).reshape(4, -1)
    counts = np.zeros((3, values.size), "i4")
    counts[0] = known.ravel()
    return Pixels({asked.of[0]: found}, counts)


def levels(asked, values, low=None, high=None):
    """Compute a map level by level; (how many pixels came at each, what it shows in the end)."""
    known, came, level = np.zeros(values.size, bool), [], BEGUN
    while True:
        pixels = pixels_of(asked, values, low, high, known.reshape(values.shape))
        found = refine(asked, pixels, level)
        level = found.level
        assert np.array_equal(found.known, known)
        if not found.wanted.size:
            return came, values.ravel()[found.source].reshape(values.shape)
        assert not known[found.wanted].any() and (np.diff(found.wanted) > 0).all()
        known[found.wanted] = True
        came.append(found.wanted.size)


@pytest.mark.parametrize("shape", [(300, 200), (61, 37), (1, 64), (8, 8), (130, 1)])
def test_a_disc_is_found_by_its_edge(shape):
    asked = make_request(*SIDES, "p(flips >= 1)", shape, 1, adaptive=True)
    asked = asked._replace(borders=(("p(flips >= 1)", (0.5,)),))
    y, x = np.mgrid[: shape[1], : shape[0]]
    values = ((x - 0.4 * shape[0]) ** 2 + (y - 0.4 * shape[1]) ** 2 < (0.3 * max(shape)) ** 2) * 1.0
    came, shown = levels(asked, values)
    # a map of 8 x 8 pixels has a grid of one
    assert np.array_equal(shown, values) or shape == (8, 8)
    assert all(count % pixel_multiple(asked) == 0 for count in came[:-1])
    if shape == (300, 200):
        assert sum(came) < 0.12 * values.size  # measured 0.0965
        flat, _ = levels(asked, 0.0 * values)
        assert sum(flat) < 0.02 * values.size  # the coarse grid: 1/64


def test_pixels_that_are_not_sure_are_computed_more_finely():
    asked = make_request(*SIDES, "p(flips >= 1)", 128, 20, adaptive=True)
    asked = asked._replace(borders=(("p(flips >= 1)", (0.5,)),))
    values = np.full((128, 128), 0.7)
    few, _ = levels(asked, values, values - 0.1, values + 0.1)
    some = np.where(np.arange(128) < 64, 0.3, 0.1)
    many, _ = levels(asked, values, values - some, values + 0.1)
    assert sum(few) < 0.02 * values.size and sum(many) > 0.5 * values.size
    agreed, _ = levels(asked, values + 0.3, values - 0.4)  # all of a few members do
    assert sum(agreed) == sum(few)


def test_a_map_in_a_directory_is_the_one_in_memory(adaptive, tmp_path):
    directory = started(tmp_path / "map")
    facts = status(directory.path)
    assert facts["growing"] and facts["members"] == 160  # 13 x 10 pixels, and 30 more
    resume.resume(tmp_path / "map")  # the first level
    part = rm.open(tmp_path / "map")
    assert part.attrs["missing"] > 0 and int(part.computed.sum()) == 160
    assert status(tmp_path / "map")["growing"] and invoke("status", tmp_path / "map").exit_code == 5
    assert invoke("verify", tmp_path / "map").exit_code == 5
    resume_growing(tmp_path / "map")
    found = rm.open(tmp_path / "map")
    assert equal(found, adaptive) and "missing" not in found.attrs
    # 4: there are members without a body
    for word, code in (("status", 4), ("verify", 0), ("map", 0), ("resume", 4)):
        assert invoke(word, tmp_path / "map").exit_code == code, word
    directory = RunDirectory(tmp_path / "map")
    assert directory.count > 5 and not directory.facts["growing"]
    assert directory.facts["members"] == int(adaptive.computed.sum())
    adaptive.to_netcdf(tmp_path / "map.nc")
    assert rm.open(tmp_path / "map.nc").identical(adaptive)
    rm.zoom_map(tmp_path / "map", (0.9, 1.1), (0.3, 0.6)).computed  # noqa: B018


def test_a_run_of_chosen_members_may_have_more_of_them_on_disk(adaptive, tmp_path):
    """As a process leaves it that is killed while it grows."""
    directory = started(tmp_path / "map")
    (tmp_path / "map" / CHOSEN).write_bytes(
        (tmp_path / "map" / CHOSEN).read_bytes() + np.arange(64, dtype="<i8").tobytes()
    )
    assert RunDirectory(directory.path).chosen.size == 160
    resume_growing(tmp_path / "map")
    assert equal(rm.open(tmp_path / "map"), adaptive)
    (tmp_path / "map" / CHOSEN).write_bytes(b"\1" * 8 * 5000)
    with pytest.raises(FileError, match="was changed"):
        rm.open(tmp_path / "map")
    (tmp_path / "map" / CHOSEN).unlink()
    with pytest.raises(FileError, match="is missing"):
        rm.open(tmp_path / "map")


def test_what_an_adaptive_map_cannot_do_is_refused(tmp_path):
    started(tmp_path / "map")
    told = invoke("extend", tmp_path / "map", "--members", 3)
    assert told.exit_code == 3 and "start a new map" in told.stderr
    with pytest.raises(OptionError, match="start a new run"):
        resume.extend(tmp_path / "map", 10_000)
    told = invoke("resume", tmp_path / "map", "--shards", "0:1")
    assert told.exit_code == 3 and "the next shards of an adaptive map" in told.stderr
    for bad, rule in ((3, "expected .measure, values"), ((("p(flips > 2)", (1,)),), "measure of")):
        with pytest.raises(OptionError, match=rule):
            rm.stability_map(SCENE, *SIDES, OF, 8, 1, adaptive=bad, **RUN)


@LINUX
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["map", "adaptive"])
def test_fifty_kills(kind, tmp_path):
    """As `python tests/tools/torture.py --kills 50 --kinds map`, and of adaptive maps."""
    told = torture.kills(50, str(tmp_path), random.Random(7), 100_000, 1, [kind])
    assert told["kills"] == 50 and told["torn shards seen"] == 0
    assert told["sha256 equal"] == told["runs resumed to the end"] == told["runs"] >= 1


def test_the_command_line_draws_an_adaptive_map(tmp_path):
    words = "map", "sleeping_top", "--resolution", 64, "--members", 2, "--adaptive", "--border", 0.5
    told = invoke(*words, "-o", f"{tmp_path}/map/")
    assert told.exit_code == 0 and "% of the pixels were computed" in told.stdout
    assert invoke(*words, "-o", tmp_path / "map.nc", "--plot", tmp_path / "map.png").exit_code == 0
    assert equal(rm.open(tmp_path / "map"), rm.open(tmp_path / "map.nc"))


STILL = rm.Scene(SCENE.body, start=rm.Start(omega=(1e-3, 1.0, 1e-3)))
Z, LAYERS = ("body.moments.3", 1.0, 1.45), 3


@pytest.fixture(scope="module")
def stack():
    return rm.stability_map(STILL, *SIDES, OF[:1], (40, 24), 1, z=Z, layers=LAYERS, **RUN)


def test_sides_have_units():
    """An end in text, and a unit beside the upper end alone, which is the unit of both."""
    x, y = ("start.omega.1", 0.0, "90 deg/s"), read_side("start.omega.2=1:10rpm:log", "y")
    asked = make_request(x, y, OF[:1], 2, 1, model=STILL.model)
    assert asked.x == ("start.omega.1", 0.0, pytest.approx(np.pi / 2.0, rel=4e-16), False)
    assert asked.y[1:3] == pytest.approx((np.pi / 30.0, np.pi / 3.0), rel=4e-16) and asked.y[3]
    with pytest.raises(OptionError, match="mm is a length"):
        make_request(("start.omega.1", 0.0, "1 mm"), y, OF[:1], 2, 1, model=STILL.model)


def test_a_layer_is_the_map_of_its_value(stack):
    assert dict(stack.sizes) == {"z": LAYERS, "y": 24, "x": 40}
    for k in range(LAYERS):
        scene = STILL.with_model(with_parameters(STILL.model, {Z[0]: float(stack.z[k])}))
        layer = rm.stability_map(scene, *SIDES, OF[:1], (40, 24), 1, **RUN)
        assert layer.drop_attrs().identical(stack.isel(z=k, drop=True).drop_attrs())
    assert not stack.isel(z=0, drop=True).equals(stack.isel(z=1, drop=True))


def test_a_stack_is_stored_and_zoomed(stack, tmp_path):
    asked = make_request(*SIDES, OF[:1], (40, 24), 1, Z, LAYERS)
    create_map(prepare_map(asked, STILL, **RUN), tmp_path / "map")
    resume.resume(tmp_path / "map")
    stack.to_netcdf(tmp_path / "map.nc")
    for name in ("map", "map.nc"):
        found = rm.open(tmp_path / name)
        assert found.drop_attrs().identical(stack.drop_attrs())
    part = rm.zoom_map(tmp_path / "map.nc", (0.5, 0.9), (0.3, 0.6))
    assert part.sizes == stack.sizes and np.array_equal(part.z, stack.z)
    told = invoke("view", tmp_path / "map.nc", "-o", f"{tmp_path}/a.html")
    assert told.exit_code == 3 and "cannot show a stack" in told.stderr


def test_a_stack_may_be_adaptive(stack):
    sides = {"z": Z, "layers": LAYERS, "adaptive": True}
    found = rm.stability_map(STILL, *SIDES, OF[:1], (40, 24), 1, **sides, **RUN)
    computed = found.computed.values > 0
    name = "p(flips>=1)"
    assert np.array_equal(found[name].values[computed], stack[name].values[computed], True)
    assert 0.2 < computed.mean() < 0.8  # measured 0.41


def test_a_stack_has_a_panel_for_each_layer(stack):
    *panels, bar = (drawn := stability_map(stack)).axes
    assert faults(drawn) == []
    titles = [f"I₃ = {z:.4g} kg m²" for z in stack.z.values]
    assert [panel.get_title() for panel in panels] == titles
    assert "p(flips ≥ 1)" in bar.get_ylabel()
    one = stack.isel(z=0).drop_vars("z").assign(computed=stack.good.isel(z=0, drop=True))
    assert "computed: " in stability_map(one).axes[1].get_title()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"layers": 3}, "give z"),
        ({"z": SIDES[0]}, "is already the parameter"),
        ({"z": ("body.moments.3", 2.0, 1.0)}, "low < high"),
        ({"z": Z, "layers": 65}, "layers"),
        ({"z": ("body.moment.3", 1.0, 2.0)}, "body.moments.3"),
    ],
)
def test_stacks_that_are_none_are_refused(given, words):
    with pytest.raises(rm.RigidmcError, match=words):
        rm.stability_map(STILL, *SIDES, OF[:1], 4, 1, **given, **RUN)
