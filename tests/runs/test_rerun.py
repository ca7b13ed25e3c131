"""A member of a result integrated again: equal to the bit, or refused."""

import math
import pkgutil
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.physics.effects.protocol import Number, effect
from rigidmc.scene.scene import scene_of
from rigidmc.scene.user_parts.registry import origin_of, remember_classes
from tests.tools.commands import invoke

BODY = rm.Body.from_moments((rm.uniform(1.0, 1.2), 1.4, 2.0), mass=1.0, centre=(0.1, 0.0, 0.3))
SCENE = rm.Scene(
    BODY,
    (rm.Gravity(rm.normal(9.81, 0.1)),),
    rm.Start(omega=(rm.normal(0.0, 0.1), 1.0, 0.2), attitude="uniform"),
)
SCENE = SCENE.with_run(
    members=200,
    first=1000,
    t_end=2.0,
    dt=0.01,
    every=0.5,
    save=("omega", "attitude"),
    integrator="rk4",
)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("rerun") / "a.nc")
    rm.simulate(SCENE, output=path).close()
    return path


def test_a_member_again_with_everything_saved(file):
    with rm.open(file) as first:
        made = rm.rerun(file, 1123, every=0.02)
        assert made.sizes["time"] == 101
        assert set(made.data_vars) >= {
            "omega",
            "momentum",
            "attitude",
            "energy",
            "energy_drift",
            "l2",
            "l2_drift",
        }
        assert made.attrs["rerun"] == "equal to the bit at 5 times in omega, attitude"
        assert np.array_equal(
            made.omega.sel(time=first.time, member=[1123]), first.omega.sel(member=[1123])
        )
        some = rm.rerun(file, range(1100, 1164), save=("omega",))
        assert np.array_equal(some.omega, first.omega.sel(member=some.member))


def test_differences_are_reported(file, tmp_path):
    with rm.open(file) as first:
        other = first.load().copy(deep=True)
    other["omega"][2, 1, 123] += 1e-12
    path = str(tmp_path / "other.nc")
    other.to_netcdf(path)
    with pytest.warns(rm.SceneWarning, match=r"differs from .*other.nc: omega by 1\.0e-12"):
        made = rm.rerun(path, 1123, save=("omega", "attitude"))
    assert made.attrs["rerun"].startswith("differs: omega by")


@pytest.mark.parametrize(("member", "options", "words"), [
    (999, {}, "has the members 1000 to 1199"),
    (range(1190, 1201), {}, "has the members 1000 to 1199"),
    (1000, {"save": ("omga",)}, "did you mean 'omega'"),
])  # fmt: skip
def test_what_cannot_be_had_is_refused(file, member, options, words):
    kind = rm.SceneError if "save" in options else rm.OptionError
    with pytest.raises(kind, match=words):
        rm.rerun(file, member, **options)


def test_steps_of_their_own_stay_as_they_were(tmp_path):
    path = str(tmp_path / "own.nc")
    rm.simulate(SCENE, turn=0.05, output=path).close()
    assert rm.rerun(path, 1005).attrs["rerun"].startswith("equal to the bit at 5 times")
    with pytest.raises(rm.SceneError, match=r"their own steps in each 0\.5 s"):
        rm.rerun(path, 1005, every=0.25)


def test_from_the_command_line(file, tmp_path):
    output = str(tmp_path / "b.nc")
    words = "rerun --member 1123 --every 0.1 --save omega,energy -o", output, file
    result = invoke(*words)
    assert result.exit_code == 0
    assert "member 1123, 21 saves of omega, energy" in result.output
    assert "equal to the bit at 5 times in omega" in result.output
    assert invoke(*words).exit_code == 6
    assert invoke("rerun", file, "--member", "5").exit_code == 3


def test_no_public_name_is_also_a_module():
    """Importing the module would replace the attribute of that name in the package."""
    assert not set(rm.__all__) & {module.name for module in pkgutil.iter_modules(rm.__path__)}


ROWS = rm.Scene(
    rm.Body.from_moments((1.0, 1.4, 2.0), mass=1.0, centre=(0.1, 0.0, 0.3)),
    (rm.Gravity(9.81), rm.ViscousDamping(0.1)),
    rm.Start(omega=np.random.default_rng(0).normal(size=(200, 3)) + [0.0, 3.0, 0.0]),
).with_run(dt=0.01, t_end=1.0, every=0.1, save=("omega", "energy_drift", "work"))  # fmt: skip


@pytest.mark.parametrize("integrator", ["rk4", "strang"])
def test_a_rerun_integrates_saved_work_again(integrator):
    """Before, energy_drift was another quantity, and the message blamed the processor."""
    ds = rm.simulate(ROWS, integrator)
    for save in (None, ("omega", "energy_drift")):
        assert (
            ds.rigid.rerun(5, save=save).attrs["rerun"]
            == "equal to the bit at 11 times in omega, energy_drift, work"
        )


def test_a_selection_has_rows_for_its_own_members_only():
    """A choice made by a look at all rows is written down; the other rows are not needed."""
    ds = rm.simulate(ROWS, "strang")
    for members in ([5], [7, 5, 130]):
        made = ds.isel(member=members).rigid.rerun(5, every=0.02)
        assert made.attrs["rerun"] == "equal to the bit at 11 times in omega, energy_drift, work"


def test_inputs_are_compared_too():
    ds = rm.simulate(ROWS, "rk4", members=32)
    ds = ds.assign(moments=ds.moments * (1.0 + 1e-12))
    with pytest.warns(rm.SceneWarning, match="moments by"):
        ds.rigid.rerun(5)


def test_members_of_two_seeds_are_not_those_of_one():
    """Put together they have a member twice; a selection has inputs that scene and seed do not
    give. In all 20 members the inputs of the two seeds differ, by 6e-3 of their size and more."""
    runs = [rm.simulate(SCENE, first=0, members=20, seed=seed) for seed in (1, 2)]
    both = xr.concat(runs, "member", data_vars="minimal", coords="minimal", compat="override")
    with pytest.raises(rm.FileError, match="has member 0 more than once"):
        both.rigid.rerun(3)
    second = both.isel(member=slice(20, 40))
    with pytest.raises(
        rm.FileError, match=r"inputs of member 3 \(.*\) do not follow from this scene"
    ):
        second.rigid.rerun(3)
    for made in (both.isel(member=slice(0, 20)), runs[1]):
        assert made.rigid.rerun(3).attrs["rerun"].startswith("equal to the bit")


def test_rows_of_a_member_that_is_there_twice_are_not_chosen():
    ds = rm.simulate(ROWS, "rk4", members=32)
    twice = xr.concat([ds, ds], "member", data_vars="minimal", coords="minimal", compat="override")
    with pytest.raises(rm.FileError, match="has member 0 more than once"):
        rm.simulate(scene_of(twice))


def test_a_result_leads_to_the_classes_of_its_process():
    @effect(units={"size": "N m"}, limits={"size": (0.0, math.inf)})
    class Push(NamedTuple):
        size: Number

        def torque(self):
            return self.size, 0.0, 0.0

    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), Push(1.0), rm.Start(omega=(0.0, 1.0, 0.0)))
    result = xr.Dataset(coords={"member": [0]}, attrs={"scene": scene.dumps()})
    with pytest.raises(rm.SceneError, match="module"):  # of another process
        scene_of(result)
    origin_of(result)["classes"] = key = remember_classes(scene.user_parts)
    assert key == remember_classes(scene.user_parts) and not remember_classes(
        rm.Scene.load("heavy_top").user_parts
    )
    assert type(scene_of(result.isel(member=[0])).effects[0]) is Push
