"""Derivatives in results, by a program that writes numbers which are known beforehand."""

from functools import partial

import numpy as np
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.engine.kernel import layout
from rigidmc.engine.program import Program
from rigidmc.engine.program_spec import Derivatives
from rigidmc.errors import SceneError
from rigidmc.physics.dynamics.so3 import multiply
from rigidmc.planning import plan
from rigidmc.results.export import member_table
from rigidmc.results.principal_axes import in_principal_axes
from rigidmc.results.sinks import MemorySink, make_buffer
from rigidmc.runs import assemble, blocks, settled
from rigidmc.runs.directory import checkpoints, gather, resume
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.dataset import open_run
from rigidmc.runs.settled import Machine
from rigidmc.scene.derivatives import derivative_units, parameters_of_run, quotient
from rigidmc.views.descriptions import outline
from rigidmc.views.sample import drive_of
from tests.runs.test_resume import changed
from tests.tools.commands import invoke

WRT = ("body.moments.2", "start.omega.1", "start.omega.3")
UNITS = ("kg m2", "rad s-1", "rad s-1")
TURN = np.array([1.0, -2.0, 3.0])  # the rotation vector by the first parameter
SCENE = rm.Scene(
    rm.Body.from_moments((1.0, 2.0, 3.0)),
    start=rm.Start(omega=(rm.normal(0.0, 0.1), 1.0, rm.normal(0.0, 0.1)), attitude="uniform"),
).with_run(
    integrator="rk4",
    dt=0.125,
    t_end=1.0,
    every=0.5,
    members=70,
    seed=4,
    save=("omega", "attitude", "energy", "flips", "omega_mean"),
)
LINEAR = ("flip_first", "flip_last", "flip_wait", "omega_mean")  # in the rows of a block
OMEGA, ATTITUDE, ENERGY = slice(0, 3), slice(3, 7), 7  # values of a save


def known(steps, base, columns):
    """Saves (time, value, 1 + columns, member) of members with the numbers `base`: the derivative
    of a value by parameter j is j + 1 times the value, and dq = q (0, (j + 1) TURN/2)."""
    times = np.arange(steps.total // steps.stride + 1)[:, None, None]
    values = (1.0 + times + 10.0 * np.arange(8)[:, None]) * base
    values[:, ATTITUDE] = [np.cos(base), np.sin(base), 0.0 * base, 0.0 * base]
    saves = values[:, :, None] * np.arange(1 + columns)[:, None]
    saves[:, :, 0] = values
    for j in range(columns):
        turned = multiply(np.moveaxis(values[:, ATTITUDE], 1, 0), (0.0, *(0.5 * (j + 1) * TURN)))
        saves[:, ATTITUDE, 1 + j] = np.moveaxis(turned, 0, 1)
    return saves


def advance(program, block, steps, noise=None, saves=None):
    """What `Program.advance` does, with the numbers of `known`; member 3 is flagged.

    The derivative of each row of a monitor by parameter j is j + 1 times the row. Each member has
    flipped twice.
    """
    rows, base = program.rows, block[layout.MOMENTUM]
    columns = len(block) // rows - 1
    assert len(block) == rows * (1 + columns)
    found = known(steps, base, columns)
    place = saves.column + np.arange(block.shape[1])
    if saves.order.size == block.shape[1]:
        place = saves.column + saves.order
    out = saves.out.reshape(len(found), 8, 1 + columns, saves.columns)
    done = np.arange(len(found)) * steps.stride
    for i in np.flatnonzero((done >= steps.first) & (done <= steps.last)):
        out[i][..., place] = found[i]
    block[layout.STATUS] = 0.0
    block[layout.STATUS, noise.members == 3] = 1.0
    at = layout.EFFECTS
    monitored = np.arange(1.0, rows - at + 1)[:, None] * (0.01 + abs(base))
    for j in range(1 + columns):
        start = j * rows
        block[start + at : start + rows] = monitored * max(j, 1)
        block[start + at + layout.COUNT] = 2.0 * (j == 0)


@pytest.fixture(autouse=True)
def _known_numbers(monkeypatch):
    monkeypatch.setattr(Program, "advance", advance)
    compiled = partial(assemble.make_program, compiled=False)
    monkeypatch.setattr(settled, "make_program", compiled)


def check(ds, tolerance=0.0):
    """Compare all derivatives of a result with the values."""
    assert ds.parameter.values.tolist() == list(WRT)
    assert ds.parameter_unit.values.tolist() == list(UNITS)
    factors = xr.DataArray([1.0, 2.0, 3.0], dims="parameter")
    for ending in ("", "_thinned", "_final"):
        for name in ("omega", "attitude", "energy"):
            if f"{name}{ending}" not in ds:
                assert f"d_{name}{ending}" not in ds
                continue
            value, found = ds[f"{name}{ending}"], ds[f"d_{name}{ending}"]
            dims = ("parameter", *("axis" if dim == "quat" else dim for dim in value.dims))
            assert found.dims == dims
            of = xr.DataArray(TURN, dims="axis") if name == "attitude" else value
            true = (factors * of).broadcast_like(found).transpose(*dims)
            np.testing.assert_allclose(found.values, true.values, max(tolerance, 1e-14), 0)
    assert "d_flips" not in ds and "d_followed_until" not in ds
    for name in LINEAR:
        found = ds[f"d_{name}"]
        assert found.dims == ("parameter", *ds[name].dims)
        assert np.isnan(found.values[..., ds.member.values == 3]).all()  # flagged
        assert np.isfinite(found.values[..., ds.member.values != 3]).all()
        true = np.multiply.outer([1.0, 2.0, 3.0], ds[name].values)
        np.testing.assert_allclose(found.values, true, max(tolerance, 1e-13))
    return ds


def test_a_result_has_the_derivatives_of_all_that_it_saves():
    ds = check(rm.simulate(SCENE, wrt=WRT))
    assert ds.d_energy.dims == ("parameter", "time", "member")
    assert ds.d_omega.attrs["units"] == "rad s-1 per parameter_unit"
    by_mass = rm.simulate(SCENE, wrt="body.mass")
    assert by_mass.d_omega.attrs["units"] == "rad s-1 kg-1"
    assert by_mass.d_flip_first.attrs["units"] == "s kg-1"
    assert ds.d_flip_first.attrs == {
        "units": "s per parameter_unit",
        "long_name": "derivative of time of the first flip; nan if none",
    }
    turn = ds.d_attitude.sel(parameter="body.moments.2").isel(time=0, member=2)
    assert turn.values == pytest.approx(TURN, rel=1e-14)
    check(rm.simulate(SCENE, wrt=WRT, threads=2, block=32))
    some = check(rm.simulate(SCENE, wrt=WRT, members=[1, 2, 40]))
    assert some.equals(ds.sel(member=[1, 2, 40]))


def test_without_parameters_nothing_changes(monkeypatch):
    plain, ds = rm.simulate(SCENE), rm.simulate(SCENE, wrt=WRT)
    assert plain.identical(ds.drop_dims("parameter").assign_attrs(scene=plain.scene))
    for none in ((), [], "", "none", None):
        scene = SCENE.with_run(wrt=WRT).with_run(wrt=none)
        assert scene.run.wrt == (WRT if none is None else None)
    assert scene.with_run(wrt=()).dumps() == SCENE.dumps()
    run = rm.prepare(SCENE, wrt=())
    rows, _ = run.initial(0, 5)
    assert rows.shape == (run.plan.places.end, 32)
    assert (run.plan.columns, run.layout.columns, run.layout.numbers) == (0, 0, 3 * 8)


def test_columns_that_fill_a_pass_are_in_no_result(monkeypatch):
    monkeypatch.setattr(plan, "choose_derivatives", lambda wrt: Derivatives(2, 2))
    run = rm.prepare(SCENE, wrt=WRT)
    assert (run.plan.columns, run.layout.numbers) == (4, 3 * 8 * 5)
    check(run.run())
    assert "derivatives  3 parameters: 2 passes of 2; d_NAME by body.moments.2" in (
        "\n".join(outline(SCENE.with_run(wrt=WRT)))
    )


@pytest.mark.parametrize("keep", ["full", "thinned", "final", {"omega": "final"}, "none"])
def test_files_have_what_memory_has(tmp_path, keep):
    settings = {"wrt": WRT, "keep": keep, "every": 0.125}
    settings |= {"thin": 3} if keep == "thinned" else {}
    made = check(rm.simulate(SCENE, **settings))
    if keep != "full":
        there = made.d_omega_flagged.sizes
        assert there == {"parameter": 3, "time": 9, "axis": 3, "flagged": made.sizes["flagged"]}
        true = made.omega_flagged.values * np.array([1, 2, 3])[:, None, None, None]
        np.testing.assert_allclose(made.d_omega_flagged.values, true, 1e-14)
    file = tmp_path / "one.nc"
    with rm.simulate(SCENE, **settings, output=file, threads=2, block=32) as written:
        check(written)
        assert set(written.coords) == set(made.coords)
    with rm.open(file) as opened:
        assert list(opened.data_vars) == list(made.data_vars)
        for name in (*made.data_vars, *made.coords):
            if "parameter" in made[name].dims:
                assert opened[name].attrs == made[name].attrs
            xr.testing.assert_equal(opened[name], made[name])
        assert set(opened.coords) == set(made.coords)


def test_digits_round_derivatives_too(tmp_path):
    file = tmp_path / "one.nc"
    with rm.simulate(SCENE, wrt=WRT, digits=4, output=file) as ds:
        check(ds, 2e-4)
        assert ds.d_omega.attrs["significant_digits"] == 4
        assert (ds.d_omega.values.view("i8") & 0xFFFF).max() == 0


def test_a_run_directory_resumes_and_reruns(tmp_path):
    path = tmp_path / "run"
    create(SCENE.with_run(wrt=WRT, keep="thinned"), path, 20_000)
    changed(path, block=32, shard=32)
    resume.resume(path, threads=1, only=range(1, 2))
    directory, _ = resume.resume(path, threads=1)
    assert directory.count == 3 and gather.verify(path) == []
    with gather.consolidate(path, tmp_path / "one.nc") as whole:
        check(whole)
    again = rm.rerun(tmp_path / "one.nc", 5, save=SCENE.run.save)
    for name in ("d_omega_thinned", "d_flip_first"):
        assert name in again.attrs["rerun"] and "differs" not in again.attrs["rerun"]
    other = rm.rerun(tmp_path / "one.nc", 5, save=SCENE.run.save, wrt=WRT[1:])
    assert "equal to the bit" in other.attrs["rerun"] and "d_" not in other.attrs["rerun"]
    pytest.importorskip("dask")
    with open_run(path) as ds:
        check(ds)


def test_a_block_in_progress_keeps_its_derivatives(tmp_path, monkeypatch):
    """A block that a checkpoint holds has the rows and the saves of all columns."""
    run = rm.prepare(SCENE, wrt=WRT)
    assert run.initial(0, 5)[0].shape == (4 * run.plan.places.end, 32)
    job = blocks.make_job(run, run.program(), 0, 32, make_buffer(run.layout, 32))
    assert job.out.size == 3 * 8 * 4 * 32
    job = job._replace(steps=job.steps._replace(stride=4, total=8))
    assert checkpoints._saved(job, 4) == 2 * 8 * 4 * 32


def test_a_shard_in_progress_keeps_its_derivatives():
    run = rm.prepare(SCENE, wrt=WRT, keep={"omega": "final"})
    first, second = (MemorySink(run.layout, run.members, direct=False) for _ in range(2))
    for sink, some in ((first, [0]), (second, [1, 2])):
        if sink is second:
            part = first.part()
            assert sum(array.nbytes for array in part.values()) <= first.largest()
            assert second.fill(part)
        blocks.compute(run, sink, Machine(1, "cpu", 32), some, 70)
    assert check(second.finish()).equals(run.run())


def test_rows_of_derivatives_keep_their_members():
    """Members with steps of their own are sorted in a block: their derivatives with them."""
    spread = rm.Start(omega=(rm.uniform(0.1, 20.0), 1.0, 0.0))
    scene = rm.Scene(SCENE.body, start=spread).with_run(turn=0.1, t_end=1.0, every=0.5, members=32)
    run = rm.prepare(scene, wrt=WRT, save=SCENE.run.save)
    ds = run.run()
    for i in (0, 13, 31):
        alone = run.run(members=range(i, i + 1))
        assert np.array_equal(ds.d_omega.values[..., i], alone.d_omega.values[..., 0])
    assert np.ptp(ds.steps.values) > 0


def test_units_of_integration_are_those_of_the_scene_again():
    """A body of 1e-30 kg m2 is integrated in other units; dX/dp has both factors."""
    scene = rm.Scene(
        rm.Body.from_moments((1e-32, 2e-32, 3e-32)),
        start=rm.Start(omega=(rm.normal(0.0, 1e-9), 1e-8, 0.0)),
    ).with_run(t_end=1e8, dt=1e7, every=5e7, members=5, save=SCENE.run.save, dtype="float32")
    run = rm.prepare(scene, wrt=WRT)
    assert run.units is not None
    ds = run.run()
    for j, unit in enumerate(UNITS):
        factor = (1 + j) / run.units.factor(unit)
        np.testing.assert_allclose(ds.d_omega[j].values, factor * ds.omega.values, 1e-14)
        np.testing.assert_allclose(ds.d_energy[j].values, factor * ds.energy.values, 1e-14)
        turn = factor * TURN[:, None] * np.ones(5)
        np.testing.assert_allclose(ds.d_attitude[j, -1].values, turn, 1e-14)
        for name in LINEAR:
            np.testing.assert_allclose(ds[f"d_{name}"][j].values, factor * ds[name].values, 1e-13)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"wrt": ("start.omga.1",)}, r"\[run\] wrt = 'start.omga.1'.*did you mean 'start.omega.1'"),
        ({"wrt": ("gravity.g",)}, "no such parameter with a derivative"),
        ({"wrt": ("body.mass",), "integrator": "closed"}, 'use integrator = "exact", which has'),
        ({"wrt": (1.0,)}, "wrt"),
        ({"wrt": 3}, "wrt"),
    ],
)
def test_what_has_no_derivative_is_refused_by_name(settings, words):
    with pytest.raises(SceneError, match=words):
        rm.simulate(SCENE, **settings)


def test_derivatives_require_compiled_code(monkeypatch):
    monkeypatch.setattr("rigidmc.planning.check.is_uncompiled", lambda: True)
    with pytest.raises(SceneError, match=r"wrt.*NUMBA_DISABLE_JIT is set"):
        rm.prepare(SCENE, wrt=WRT)


def test_a_vector_stands_for_its_components():
    names = parameters_of_run(SCENE.model, ("start.omega.2", "start.omega", "body.moments"))
    omega = ["start.omega.2", "start.omega.1", "start.omega.3"]
    assert names == (*omega, *(f"body.moments.{i}" for i in (1, 2, 3)))
    euler = rm.Scene(SCENE.body, start=rm.Start(omega=(1.0, 0.0, 0.0), attitude=(0.1, 0.2, 0.3)))
    assert parameters_of_run(euler.model, ("start.attitude",)) == tuple(
        f"start.attitude.{name}" for name in ("phi", "theta", "psi")
    )
    assert parameters_of_run(SCENE.model, None) == ()


def test_units_divide():
    assert quotient("rad s-1", "kg m2") == "rad s-1 kg-1 m-2"
    assert quotient("rad s-1", "rad s-1") == "1" == quotient("1", "1")
    assert quotient("kg m2 s-2", "m s-2") == "kg m"
    assert quotient("1", "s") == "s-1"
    assert quotient("a%", "s") == "a% per s"
    assert derivative_units("J", ("kg", "kg")) == "J kg-1"
    assert derivative_units("J", ("kg", "m")) == "J per parameter_unit"


def test_summaries_and_tables_have_a_place_for_derivatives():
    ds = rm.simulate(SCENE, wrt=WRT, keep={"omega": "final", "attitude": "none"})
    text = ds.rigid.summary()
    assert "derivatives, d_NAME, by body.moments.2, start.omega.1, start.omega.3" in text
    assert "d_omega_final" not in text and "omega_final[1]" in text and "d_flip_first" not in text
    table = member_table(ds)
    column = "d_omega_final_start.omega.1_3"
    assert np.array_equal(table[column], ds.d_omega_final[1, 2])
    assert table.attrs["units"][column] == "rad s-1 per rad s-1"
    assert np.array_equal(table["d_energy_final_body.moments.2"], ds.d_energy[0, -1])
    assert "d_omega_mean_body.moments.2_1" in table
    with pytest.raises(ValueError, match="derivatives are in the axes of the result"):
        rm.simulate(SCENE, wrt=WRT).rigid.principal("d_omega")


def test_the_command_line_names_parameters(tmp_path, monkeypatch):
    file = tmp_path / "one.nc"
    (tmp_path / "s.toml").write_text(SCENE.dumps())
    words = ["run", f"{tmp_path}/s.toml", "--wrt", ",".join(WRT), "-o", f"{file}"]
    assert invoke(*words).exit_code == 4  # some members are flagged
    with rm.open(file) as ds:
        check(ds)
        assert rm.Scene.load(file).run.wrt == WRT
    words = ["run", f"{file}", "--set", f"run.wrt={list(WRT[:1])}", "-o", f"{file}", "--force"]
    assert invoke(*words).exit_code == 4
    with rm.open(file) as ds:
        assert ds.parameter.values.tolist() == list(WRT[:1])
    off = rm.Scene.load(file, settings=[("run.wrt", "[]")])
    assert off.run.wrt is None


def test_studies_read_values_alone():
    with pytest.raises(TypeError, match="unexpected keyword argument 'wrt'"):
        rm.ftle(SCENE, wrt=WRT)
    scene, _ = rm.frequencies.designed(SCENE.with_run(wrt=WRT), {"of": "omega[1]"}, {})
    assert scene.run.wrt is None


def test_a_result_with_code_is_opened_without_running_it(tmp_path):
    """Only the code knows the unit of the parameter, so the file's own is shown."""
    text = (
        "from typing import NamedTuple\nimport rigidmc as rm\n"
        "@rm.protocols.effect(units={'size': 'N m'}, limits={'size': (0.0, 1.0)}, example=(0.1,))\n"
        "class Wind(NamedTuple):\n    size: float\n"
        "    def torque(self, t, l):\n        return self.size, 0.0, 0.0\n"
    )
    (tmp_path / "wind.py").write_text(text)
    wind = '[effects.Wind]\nmodule = "wind.py"\nsize = 0.1\n[start]'
    (tmp_path / "s.toml").write_text(
        SCENE.dumps().replace("[effects]", "").replace("[start]", wind)
    )
    scene = rm.Scene.load(tmp_path / "s.toml", allow_code=True)
    rm.simulate(scene, wrt="effects.Wind.size", output=tmp_path / "r.nc").close()
    with rm.open(tmp_path / "r.nc") as ds:
        assert ds.d_omega.attrs["units"] == "rad s-1 N-1 m-1"
        assert ds.parameter_unit.values.tolist() == [""]
        assert np.array_equal(ds.d_omega[0], ds.omega)


def test_derivatives_are_not_taken_for_vectors_of_the_body():
    """d_momentum ends like the momentum of a rotor, and has axes: both decided by name once."""
    ds = rm.simulate(SCENE, wrt=WRT).rename(omega="momentum", d_omega="d_momentum")
    assert drive_of(ds) == drive_of(ds.drop_dims("parameter"))
    turn = ("quat", "member"), np.broadcast_to([[0.6], [0.8], [0.0], [0.0]], (4, 70))
    turned = in_principal_axes(ds.assign(principal_axes=turn).assign_attrs(body_axes="described"))
    assert turned.d_momentum.identical(ds.d_momentum)
    assert not turned.momentum.equals(ds.momentum)
