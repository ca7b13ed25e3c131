"""Results as zarr and as tables: each number as in the netCDF file, to the bit; nothing torn."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import rigidmc as rm
from rigidmc.files import opening
from rigidmc.results import export
from tests.tools.commands import invoke
from tests.tools.scenes import FREE, MONITORED, STATE

HEAVY = rm.Body((1.0, 2.0, 2.5), mass=1.0, centre=(0.0, 0.0, 0.1))
SCENE = replace(FREE, body=HEAVY, effects=(rm.Gravity(9.81),)).with_run(
    members=70, t_end=1.0, every=0.25, dt=0.01, save=(*STATE, *MONITORED)
)


# since pandas 3.1 the default is exact
OLD = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
EXACT = {"float_precision": "round_trip"} if OLD else {}


def same_bits(a, b):
    """Whether two Datasets are equal to the bit: names, dimensions, types, values, attributes."""
    assert a.identical(b)
    for name in a.variables:
        x, y = a[name].values, b[name].values
        assert x.dtype == y.dtype and x.tobytes() == y.tobytes(), name


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """{ending: path} of one run, written in each format by `rigidmc run`."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "s.toml").write_text(SCENE.dumps())
    files = {end: folder / f"r.{end}" for end in ("nc", "zarr", "csv", "parquet")}
    for file in files.values():
        done = invoke("run", folder / "s.toml", "-o", file)
        assert done.exit_code == 0 and f"wrote {file}" in done.output, done.output
    assert sorted(os.listdir(folder)) == sorted(["s.toml", *(f"r.{end}" for end in files)])
    return files


def test_zarr_is_the_netcdf_file_to_the_bit(results):
    with rm.open(results["nc"]) as nc, rm.open(results["zarr"]) as zarr:
        same_bits(nc, zarr)
    with xr.open_dataset(results["nc"]) as nc, xr.open_dataset(results["zarr"]) as zarr:
        assert nc.attrs == zarr.attrs and set(nc.variables) == set(zarr.variables)
        assert np.array_equal(nc.omega, zarr.omega) and list(zarr.quat.values) == list("wxyz")
        other = zarr.copy(deep=True)
    other.omega.values[0, 0, 0] = np.nextafter(other.omega.values[0, 0, 0], 9.0)
    with rm.open(results["nc"]) as nc, pytest.raises(AssertionError):
        same_bits(nc, other)  # the test can fail


def test_a_zarr_store_is_read_like_a_file(results, tmp_path):
    both = [invoke("summary", results[end]).output for end in ("nc", "zarr")]
    assert both[0] == both[1] and "energy_drift_max" in both[0]
    assert invoke("plot", results["zarr"], "-o", tmp_path / "p.png").exit_code == 0
    again = invoke("rerun", results["zarr"], "--member", 3, "-o", tmp_path / "m.zarr")
    assert again.exit_code == 0 and "equal" in again.output, again.output
    with rm.open(tmp_path / "m.zarr") as member, rm.open(results["nc"]) as nc:
        assert np.array_equal(member.omega.isel(member=0)[-1], nc.omega.isel(member=3)[-1])
    assert "70 in blocks" in invoke("show", results["zarr"]).output
    assert invoke("run", results["zarr"], "-o", tmp_path / "again.nc").exit_code == 0
    with rm.open(tmp_path / "again.nc") as a, rm.open(results["nc"]) as b:
        assert np.array_equal(a.omega, b.omega)


def test_tables_have_a_row_per_member_with_every_number(results):
    with rm.open(results["nc"]) as ds:
        csv = pd.read_csv(results["csv"], **EXACT)
        parquet = pd.read_parquet(results["parquet"])
        assert list(csv.columns) == list(parquet.columns) and csv.columns[0] == "member"
        assert csv.shape == (70, len(parquet.columns))
        for frame in (csv, parquet):
            for axis in (1, 2, 3):
                final = ds.omega.isel(time=-1).sel(axis=axis).values
                assert frame[f"omega_final_{axis}"].to_numpy().tobytes() == final.tobytes()
                start = ds.start_omega.sel(axis=axis).values
                assert np.array_equal(frame[f"start_omega_{axis}"], start)
            w = ds.attitude.isel(time=-1).sel(quat="w").values
            assert np.array_equal(frame["attitude_final_w"], w)
            for name in ("energy_drift_max", "status", "status_time", "flips", "mass"):
                assert np.array_equal(frame[name], ds[name].values, equal_nan=True), name
        assert parquet["status"].dtype == "int8"
        assert parquet.attrs["units"]["omega_final_1"] == ds.omega.attrs["units"]
        assert parquet.attrs["scene"] == ds.attrs["scene"]
        wrong = ds.omega.isel(time=-2).sel(axis=1).values
        assert not np.array_equal(csv["omega_final_1"], wrong)


@pytest.mark.parametrize("source", ["nc", "zarr"])
@pytest.mark.parametrize("ending", ["nc", "zarr", "csv", "parquet"])
def test_export_writes_what_run_writes(results, tmp_path, source, ending):
    file = tmp_path / f"x.{ending}"
    done = invoke("export", results[source], "-o", file)
    assert done.exit_code == 0 and os.listdir(tmp_path) == [file.name], done.output
    if ending in ("nc", "zarr"):
        with rm.open(file) as a, rm.open(results["nc"]) as b:
            same_bits(a, b)
    elif ending == "csv":
        assert file.read_bytes() == results["csv"].read_bytes()
    else:
        pd.testing.assert_frame_equal(pd.read_parquet(file), pd.read_parquet(results[ending]))
    assert invoke("export", results[source], "-o", file).exit_code == 6
    assert invoke("export", results[source], "-o", file, "--force").exit_code == 0
    assert os.listdir(tmp_path) == [file.name]


def test_python_writes_the_same(results, tmp_path):
    ds = rm.simulate(SCENE, output=tmp_path / "a.zarr")
    ds.rigid.export(tmp_path / "b.zarr")
    ds.to_zarr(tmp_path / "c.zarr", zarr_format=2, consolidated=False)
    for name in "abc":
        with rm.open(tmp_path / f"{name}.zarr") as one:
            same_bits(one, ds)
    frame = export.member_table(ds)
    assert frame.shape[0] == 70 and frame.attrs["units"]["omega_final_3"] == "rad s-1"
    few = ds.sel(member=[5, 2])
    assert list(export.member_table(few)["member"]) == [5, 2]


@pytest.mark.parametrize("keep", ["final", "thinned", "summary"])
def test_tables_of_runs_that_keep_less(keep):
    scene = replace(SCENE, effects=()).with_run(save=("omega",))
    ds, full = rm.simulate(scene, keep=keep), rm.simulate(scene)
    frame, wanted = export.member_table(ds), export.member_table(full)["omega_final_2"]
    assert "omega_final_2" in frame or keep == "summary"
    assert np.array_equal(frame.get("omega_final_2", wanted), wanted)
    assert ("omega_mean_2" in frame) == (keep == "summary")
    assert not [name for name in frame if "flagged" in name or "thinned" in name]


def test_digits_are_those_of_the_file(tmp_path):
    for end in ("nc", "zarr"):
        rm.simulate(SCENE, digits=4, output=tmp_path / f"r.{end}").close()
    with rm.open(tmp_path / "r.nc") as nc, rm.open(tmp_path / "r.zarr") as zarr:
        same_bits(nc, zarr)
        assert zarr.omega.attrs["significant_digits"] == 4
    assert not np.array_equal(rm.simulate(SCENE).omega, zarr.omega)


def test_a_run_directory_is_exported(results, tmp_path):
    scene = results["nc"].with_name("s.toml")
    assert invoke("run", scene, "-o", f"{tmp_path}/run/").exit_code == 0
    assert invoke("export", tmp_path / "run", "-o", tmp_path / "r.csv").exit_code == 0
    assert (tmp_path / "r.csv").read_bytes() == results["csv"].read_bytes()
    done = invoke("export", tmp_path / "run", "-o", tmp_path / "r.zarr")
    with rm.open(tmp_path / "r.zarr") as a, rm.open(results["nc"]) as b:
        assert done.exit_code == 0 and np.array_equal(a.omega, b.omega)


def test_missing_packages_are_named_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(opening.importlib.util, "find_spec", lambda name: None)
    for ending, extra in (("zarr", "zarr"), ("parquet", "table")):
        done = invoke("run dzhanibekov -o", tmp_path / f"x.{ending}")
        assert done.exit_code == 3 and f"pip install 'rigidmc[{extra}]'" in done.output
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("ending", ["zarr", "csv", "parquet"])
def test_a_failed_write_leaves_what_was_there(results, tmp_path, monkeypatch, ending):
    with rm.open(results["nc"]) as ds:
        file = tmp_path / f"x.{ending}"
        export.write(ds, file)
        before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

        def fails(*arguments, **words):
            with open(arguments[1] + "/half" if ending == "zarr" else arguments[1], "w") as part:
                part.write("half")
            raise KeyboardInterrupt

        owner = xr.Dataset if ending == "zarr" else pd.DataFrame
        if ending == "zarr":
            real = xr.Dataset.to_zarr
            monkeypatch.setattr(owner, "to_zarr", lambda *a, **w: (real(*a, **w), fails(*a)))
        else:
            monkeypatch.setattr(owner, f"to_{ending}", fails)
        with pytest.raises(KeyboardInterrupt):
            export.write(ds, file, force=True)
        with pytest.raises(KeyboardInterrupt):
            export.write(ds, tmp_path / f"y.{ending}")
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_folders_that_are_no_store_are_never_replaced(results, tmp_path):
    (tmp_path / "x.zarr").mkdir()
    (tmp_path / "x.zarr" / "thesis.tex").write_text("precious")
    done = invoke("export", results["nc"], "-o", tmp_path / "x.zarr", "--force")
    assert done.exit_code == 74 and "names a folder" in done.output
    assert (tmp_path / "x.zarr" / "thesis.tex").read_text() == "precious"
    done = invoke("summary", tmp_path / "x.zarr")
    assert done.exit_code == 3 and "Traceback" not in done.output


def test_damaged_stores_are_refused(results, tmp_path):
    assert invoke("export", results["nc"], "-o", tmp_path / "x.zarr").exit_code == 0
    group = tmp_path / "x.zarr" / ".zattrs"
    words = json.loads(group.read_text())
    for text in ("{", json.dumps({**words, "scene": "[body]"}), json.dumps({})):
        group.write_text(text)
        (tmp_path / "x.zarr" / ".zmetadata").unlink(missing_ok=True)
        done = invoke("summary", tmp_path / "x.zarr")
        assert done.exit_code == 3 and "x.zarr" in done.output, done.output
        assert "Traceback" not in done.output


@pytest.mark.parametrize("name", ["status", "energy_drift_max"])
def test_damaged_chunks_are_told_without_a_traceback(results, tmp_path, name):
    assert invoke("export", results["nc"], "-o", f"{tmp_path}/x.zarr").exit_code == 0
    (tmp_path / "x.zarr" / name / "0").write_bytes(b"xx")
    for words in (("summary",), ("export", "-o", tmp_path / "y.csv")):
        done = invoke(words[0], tmp_path / "x.zarr", *words[1:])
        assert done.exit_code in (3, 74) and "decompress" in done.output, done.output
        assert "Traceback" not in done.output and os.listdir(tmp_path) == ["x.zarr"]


def test_a_store_with_a_slash_is_no_run_directory(tmp_path):
    assert invoke("run nasa_brick --t-end 1 -o", f"{tmp_path}/x.zarr/").exit_code == 0
    with rm.open(tmp_path / "x.zarr") as ds:
        assert ds.attrs["title"] == "nasa_brick"


def test_without_zarr_and_pyarrow_all_else_works(tmp_path):
    line = (
        "import sys; sys.modules['zarr'] = sys.modules['pyarrow'] = None\n"
        "import rigidmc as rm; ds = rm.simulate(rm.Scene.load('nasa_brick'), t_end=0.1)\n"
        "ds.rigid.export('x.csv'); ds.rigid.export('x.nc')"
    )
    done = subprocess.run(
        [sys.executable, "-c", line], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert sorted(os.listdir(tmp_path)) == ["x.csv", "x.nc"]
