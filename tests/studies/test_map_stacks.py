"""Maps over three parameters: a stack, whose layers are maps."""

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import OptionError
from rigidmc.runs.directory import resume
from rigidmc.scene.parameters import with_parameters
from rigidmc.studies.framework.options import read_side
from rigidmc.studies.stability_map.compute import prepare_map
from rigidmc.studies.stability_map.picture import stability_map
from rigidmc.studies.stability_map.question import make_request
from rigidmc.studies.stability_map.stored import create_map
from tests.tools.axes import faults
from tests.tools.commands import invoke

pytestmark = pytest.mark.filterwarnings("ignore::rigidmc.errors.SceneWarning")
SCENE = rm.Scene(rm.Body.from_moments((0.5, 1.0, 1.4)), start=rm.Start(omega=(1e-3, 1.0, 1e-3)))
SIDES = ("body.moments.1", 0.2, 2.6), ("start.omega.2", 0.2, 1.5)
Z, LAYERS, OF = ("body.moments.3", 1.0, 1.45), 3, ("p(flips >= 1)",)
RUN = {"integrator": "rk8", "dt": 0.5, "t_end": 30.0}


@pytest.fixture(scope="module")
def stack():
    return rm.stability_map(SCENE, *SIDES, OF, (40, 24), 1, z=Z, layers=LAYERS, **RUN)


def test_sides_have_units():
    """An end in text, and a unit beside the upper end alone, which is the unit of both."""
    x, y = ("start.omega.1", 0.0, "90 deg/s"), read_side("start.omega.2=1:10rpm:log", "y")
    asked = make_request(x, y, OF, 2, 1, scene=SCENE)
    assert asked.x == ("start.omega.1", 0.0, pytest.approx(np.pi / 2.0, rel=4e-16), False)
    assert asked.y[1:3] == pytest.approx((np.pi / 30.0, np.pi / 3.0), rel=4e-16) and asked.y[3]
    with pytest.raises(OptionError, match="mm is a length"):
        make_request(("start.omega.1", 0.0, "1 mm"), y, OF, 2, 1, scene=SCENE)


def test_a_layer_is_the_map_of_its_value(stack):
    assert dict(stack.sizes) == {"z": LAYERS, "y": 24, "x": 40}
    for k in range(LAYERS):
        scene = SCENE.with_model(with_parameters(SCENE.model, {Z[0]: float(stack.z[k])}))
        layer = rm.stability_map(scene, *SIDES, OF, (40, 24), 1, **RUN)
        assert layer.drop_attrs().identical(stack.isel(z=k, drop=True).drop_attrs())
    assert not stack.isel(z=0, drop=True).equals(stack.isel(z=1, drop=True))


def test_a_stack_is_stored_and_zoomed(stack, tmp_path):
    asked = make_request(*SIDES, OF, (40, 24), 1, Z, LAYERS)
    create_map(prepare_map(asked, SCENE, **RUN), tmp_path / "map")
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
    found = rm.stability_map(
        SCENE, *SIDES, OF, (40, 24), 1, z=Z, layers=LAYERS, adaptive=True, **RUN
    )
    computed = found.computed.values > 0
    name = "p(flips>=1)"
    assert np.array_equal(found[name].values[computed], stack[name].values[computed], True)
    assert 0.2 < computed.mean() < 0.8  # measured 0.41


def test_a_stack_has_a_panel_for_each_layer(stack):
    *panels, bar = (drawn := stability_map(stack)).axes
    assert faults(drawn) == []
    assert [panel.get_title() for panel in panels] == [
        f"I₃ = {z:.4g} kg m²" for z in stack.z.values
    ]
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
        rm.stability_map(SCENE, *SIDES, OF, 4, 1, **given, **RUN)
