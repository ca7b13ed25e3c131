"""Tables of measurements for `fit`: what is read, what is refused, and what looks wrong in them."""

import json
import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import rigidmc as rm
from rigidmc.cli.app import app
from rigidmc.errors import OptionError, RigidmcError
from rigidmc.studies.fit.options import FitOptions
from rigidmc.studies.fit.records import (
    MOST_BYTES,
    MOST_ROWS,
    Record,
    read_columns_option,
    read_records,
)
from rigidmc.studies.fit.setup import make_problem, records_of
from rigidmc.studies.fit.solve import minimise
from rigidmc.studies.fit.starts import make_starts
from rigidmc.studies.fit.streams import VECTOR, Stream, high_frequency_noise
from rigidmc.studies.fit.study import maker, start
from rigidmc.studies.fit.suspicions import FACTORS, examine
from rigidmc.studies.fit.visible import seen
from rigidmc.studies.fit.wheel import with_wheel

UNITS = {"omega": "rad s-1", "attitude": "1"}
SIZES = {"omega": 3, "attitude": 4}
DEGREE = np.pi / 180.0
T, W = [0.0, 0.5, 1.5], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.5]]


def table(head, separator=",", point=".", factor=1.0, order=(0, 1, 2), more=()):
    """The text of a table with the times T and the rates W."""
    rows = [[t, *(factor * w[i] for i in order), *more] for t, w in zip(T, W, strict=True)]
    lines = [separator.join(repr(x).replace(".", point) for x in row) for row in rows]
    return "\n".join([head, *lines, ""])


PHYPHOX = [f'"Gyroscope {x} (rad/s)"' for x in "xyz"]
# {what: (text, options of read_records)}; all have the times T and the rates W
READ = {
    "phyphox": (table(",".join(['"Time (s)"', *PHYPHOX, '"Absolute (rad/s)"']), more=[9.0]), {}),
    "phyphox, tabs": (table("\t".join(['"Time (s)"', *PHYPHOX]), "\t"), {}),
    "phyphox, tabs, decimal commas": (table("\t".join(['"Time (s)"', *PHYPHOX]), "\t", ","), {}),
    "phyphox, semicolons": (table(";".join(['"Time (s)"', *PHYPHOX]), ";", ","), {}),
    "Sensor Logger": (
        "time,seconds_elapsed,z,y,x\n"
        + "".join(f"{1.7e18 + 1e9 * t:.0f},{t},{w[2]},{w[1]},{w[0]}\n" for t, w in zip(T, W)),  # noqa: B905
        {},
    ),
    "nanoseconds": (
        "time,x,y,z\n" + "".join(f"{1e9 * t:.0f},{w[0]},{w[1]},{w[2]}\n" for t, w in zip(T, W)),  # noqa: B905
        {"time": "time:ns"},
    ),
    "rotation rate": (table("t," + ",".join(f"Rotation Rate {x} [rad/s]" for x in "XYZ")), {}),
    "degrees": (table("t (s),gx (deg/s),gy (deg/s),gz (deg/s)", factor=1.0 / DEGREE), {}),
    "suffixes": (table("t_s,gx_deg_s,gy_deg_s,gz_deg_s", factor=1.0 / DEGREE), {}),
    "spaces": (table("# t_s wx_rad_s wy_rad_s wz_rad_s  (rate 415 Hz)", "   "), {}),
    "tabs and a hash": (table("# t\twx\twy\twz", "\t"), {}),
    "a hash": (table("# t,wx,wy,wz"), {}),
    "of a result": (table("time,omega[1],omega[2],omega[3]"), {}),
    "numbers": (table("t,w1_rad_s,w2_rad_s,w3_rad_s"), {}),
    "any order": (table("t,gyro_z,gyro_x,gyro_y", order=(2, 0, 1)), {}),
    "columns": (
        table("t,a,b,c", factor=1.0 / DEGREE), {"columns": "omega=a,b,c:deg/s"}
    ),
    "a negated column": (
        table("t,a,b,c").replace(",2.0,", ",-2.0,").replace(",5.0,", ",-5.0,").replace(
            ",8.0,", ",-8.0,"
        ),
        {"columns": "omega=a,-b,c"},
    ),
    "a unit beside the same unit": (
        table("t,a (deg/s),b (deg/s),c (deg/s)", factor=1.0 / DEGREE),
        {"columns": "omega=a (deg/s),b (deg/s),c (deg/s):deg/s"},
    ),
    "dates": (
        "utc,wx,wy,wz\n2026-01-02T00:00,1,2,3\n2026-01-02T00:00:00.5Z,4,5,6\n"
        "2026-01-02 00:00:01.500,7,8,9.5\n",
        {},
    ),
    "a rate": (
        "wx,wy,wz\n1,2,3\n4,5,6\n,,\n7,8,9.5\n", {"rate": 2.0}
    ),
    "milliseconds": ("t_ms,wx,wy,wz\n0,1,2,3\n500,4,5,6\n1500,7,8,9.5\n", {}),
}  # fmt: skip


def read(data, columns=None, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rm.SceneWarning)
        return read_records(data, read_columns_option(columns, "columns"), UNITS, SIZES, **options)


def is_the_record(record):
    t = record.times["omega"] - record.times["omega"][0]
    np.testing.assert_allclose(t, T, atol=3e-7)  # the resolution of seconds since 1970
    np.testing.assert_allclose(record.values["omega"], W, rtol=1e-14)
    return True


@pytest.mark.parametrize("what", READ)
def test_tables_are_read(tmp_path, what):
    text, options = READ[what]
    (tmp_path / "Gyroscope.csv").write_text(text)
    (record,) = read(tmp_path / "Gyroscope.csv", **options)
    assert is_the_record(record) and record.name == "data"


def test_objects_are_read(tmp_path):
    frame = pd.DataFrame(W, columns=["wx", "wy", "wz"]).assign(note="text")
    dates = pd.to_datetime(np.array(T) * 1e9 + 1.7e18)
    vectors = xr.Dataset({"omega": (("time", "axis"), W)}, {"time": T})
    for data in (
        {"t": T, "omega": np.array(W)},
        {"t": T, **dict(zip(["wx", "wy", "wz"], np.transpose(W).tolist(), strict=True))},
        frame.assign(t=T),
        frame.set_index(pd.Index(T, name="t")),
        frame.assign(timestamp=dates),
        frame.set_index(pd.Index(dates, name="utc")),
        vectors,
        vectors.expand_dims("member"),
    ):
        (record,) = read(data)
        assert is_the_record(record)


def test_a_result_is_read(tmp_path):
    scene = rm.Scene(rm.Body((1.0, 2.0, 3.0)), (), rm.Start(omega=(0.1, 1.0, 0.1)))
    run = {"t_end": 1.0, "dt": 0.1, "every": 0.1, "save": ("omega", "attitude")}
    result = rm.simulate(scene, members=1, **run)
    result.to_netcdf(tmp_path / "r.nc")
    for data in (result, tmp_path / "r.nc"):
        (record,) = read(data)
        assert record.values["omega"].shape == (11, 3) and record.values["attitude"].shape == (
            11,
            4,
        )
    with pytest.raises(OptionError, match="2 values of member: select one"):
        read(rm.simulate(scene, members=2, **run))


def test_several_files_are_several_records(tmp_path):
    for i in range(2):
        (tmp_path / f"{i}.csv").write_text(table("t,wx,wy,wz"))
    records = read([tmp_path / "0.csv", tmp_path / "1.csv"])
    assert [record.name for record in records] == ["0.csv", "1.csv"]
    assert all(map(is_the_record, records))


def test_records_of_a_table():
    t, w = np.arange(6.0), np.ones((6, 3))
    data = {"t": t % 3, "omega": w, "toss": t // 3}
    assert [r.name for r in read(data, split="toss")] == ["toss 0", "toss 1"]
    some = read({"t": t, "omega": w}, between=((0.0, 1.0), (2.5, 5.0)))
    assert [r.times["omega"].tolist() for r in some] == [[0, 1], [3, 4, 5]]


def test_intervals_are_texts_or_pairs():
    given = {"data": "toss", "free": "start.omega"}
    for between in ("0.9:1.4", [(0.9, 1.4)], ["0.9:1.4"]):
        assert FitOptions.read({**given, "between": between}).between == [(0.9, 1.4)]
    for between in ("1.4:0.9", "1", "a:b", (0.9, 1.4)):
        with pytest.raises(OptionError, match="expected FROM:TO in seconds"):
            FitOptions.read({**given, "between": between})


def test_observables_of_different_rates():
    t, w, q = np.arange(6.0), np.ones((6, 3)), np.zeros((6, 4))
    q[1::2], w[3] = np.nan, np.nan
    (record,) = read({"t": t, "omega": w, "attitude": q})
    assert record.times["attitude"].tolist() == [0, 2, 4]
    assert record.times["omega"].tolist() == [0, 1, 2, 4, 5]


# {text of a table: (options, message)}
REFUSED = {
    "t,wx,wy,wz\n0,1,2,3\n1,1,2,3\n1,4,5,6\n": ({}, "row 2 has 1 s, row 3 1 s (1 such rows)"),
    "t,wx,wy,wz\n0,1,2,3\n2,1,2,3\n1,4,5,6\n": ({}, "row 2 has 2 s, row 3 1 s"),
    "t,wx,wy,wz\n0,1,2,3\n1,2,3,4\n": ({"between": ((9.0, 10.0),)}, "times from 0 to 1 s"),
    "t,wx,wy,wz\n": ({}, "no rows"),
    "t,wx,wy,wz\n0,nan,nan,\n1,,nan,nan\n": ({}, "has no samples of omega"),
    "t,wx,wy,wz\n0,1,2,3\n1,1,x,3\n": ({}, "row 2 is text, 'x', not a number"),
    "t,wx,wx,wy,wz\n0,1,1,2,3\n1,1,1,2,3\n": ({}, "several columns have the name wx"),
    "t,a,b,c\n0,1,2,3\n1,1,2,3\n": ({}, "no column has the name of an observable"),
    "t,gx,gy,gz,wx,wy,wz\n0,1,2,3,1,2,3\n": ({}, "no column has the name of an observable"),
    "wx,wy,wz\n1,2,3\n1,2,3\n": ({}, "no column of times among wx, wy, wz"),
    "time,x,y,z\n1.7e18,1,2,3\n1.7e18,1,2,3\n": ({}, "--time time:ns"),
    "t,wx,wy,wz\n0,1,2,3\n1,1,2\n": ({}, "row 2 has 3"),
    "t,wx (m/s),wy (m/s),wz (m/s)\n0,1,2,3\n1,1,2,3\n": ({}, "wx (m/s)"),
    "t,wx_rad_s,b,c\n0,1,2,3\n1,1,2,3\n": (
        {"columns": "omega=wx_rad_s,b,c:deg/s"}, "rad/s, but its unit is given as deg/s: rename"
    ),
    "t,a,b,c\n0,1,2,3\n1,1,2,4\n": ({"columns": "omega=a,b"}, "3 components, but 2 columns"),
    "t,a,b,column\n0,1,2,3\n1,1,2,5\n": ({"columns": "omega=a,b,columm"}, "did you mean 'column'"),
    "t,a,b,c\n0,1,2,3\n1,1,2,6\n": ({"columns": "omega=a,b,c:dge/s"}, "dge"),
    "t,a,b,c\n0,1,2,3\n1,1,2,7\n": ({"columns": "omeg=a,b,c"}, "omega"),
    "t,a,b,c\n0,1,2,3\n1,1,2,8\n": ({"columns": "omega"}, "expected OBSERVABLE=COLUMN"),
    "t,a,b,c\n0,1,2,3\n1,1,2,5\n": ({"columns": "omega=,,"}, "expected OBSERVABLE=COLUMN"),
    "tt,wx,wy,wz\n0,1,2,3\n1,1,2,3\n": ({"time": "ty"}, "tt"),
    "t,wx,wy,wz\n0,1,2,3\n1,1,2,9\n": ({"split": "wxy"}, "wx"),
    "t,wx,wy,wz\n0,1,2,3\n1,-inf,2,3\n": ({}, "row 2 is infinite"),
    "t,a,b,c\n0,1,2,3\n1,1e308,2,3\n": ({"columns": "omega=9*a,b,c"}, "row 2 is infinite"),
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED)
def test_tables_are_refused(tmp_path, text):
    options, message = REFUSED[text]
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(RigidmcError) as error:
        read(tmp_path / "t.csv", **options)
    assert message in str(error.value)


def test_files_and_objects_are_refused(tmp_path):
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)) * 9)
    (tmp_path / "Accelerometer.csv").write_text("seconds_elapsed,z,y,x\n0,1,2,3\n1,2,3,4\n")
    (tmp_path / "long.csv").write_text("x" * (2**20 + 9))
    with open(tmp_path / "sparse.csv", "wb") as file:
        file.truncate(MOST_BYTES + 1)
    rows = np.arange(MOST_ROWS + 1.0)
    for data, message in (
        (tmp_path / "binary.csv", "UTF-8"),
        (tmp_path / "Accelerometer.csv", "no column has the name of an observable"),
        (tmp_path / "long.csv", "characters"),
        (tmp_path / "sparse.csv", "128 MiB, at most 128 are read"),
        ({"t": rows, "wx": rows, "wy": rows, "wz": rows}, "1,000,001 rows, at most 1,000,000"),
        (tmp_path, "a folder"),
        (tmp_path / "none.csv", "no such file"),
        (3, "expected the path of a table"),
        ({"t": T, "omega": W[:2]}, "differ in length: t 3, omega 2"),
        ({"t": T, "wx": list("abc"), "wy": T, "wz": T}, "has text"),
        (pd.DataFrame([[0, 1], [1, 2]], columns=["t", "t"]), "several columns have the name t"),
    ):
        with pytest.raises(RigidmcError, match=message):
            read(data)


def test_the_command_refuses_with_code_3(tmp_path):
    (tmp_path / "t.csv").write_text("t,wx,wy,wz\n0,1,2,3\n0,1,2,3\n")
    words = ["fit", "tennis_racket", str(tmp_path / "t.csv"), "--free", "body.moments"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 3 and "row 2" in done.output and "t.csv" in done.output


def test_notes_about_times():
    (record,) = read({"t": [0.0, np.nan, 0.5, 1.0], "omega": np.ones((4, 3))}, rate=100.0)
    assert record.notes[0] == "1 rows have no time and are left out"
    assert "have 2 samples a second, not the rate 100" in record.notes[1]
    (record,) = read({"t": [0.0, 0.5, 1.0], "omega": np.ones((3, 3))}, rate=2.0)
    assert not record.notes


# bodies: asymmetric, nearly symmetric, a disc
BODIES = (0.00121, 0.01638, 0.01748), (1.0, 2.0, 3.0), (0.5, 0.52, 1.0), (1.0, 1.0, 2.0)
TILT = Rotation.from_rotvec([0.1, -0.05, 0.08]).as_matrix()


@pytest.fixture(scope="module", params=BODIES, ids=str)
def motion(request):
    """A scene, and times and rates of its body with drag that the scene lacks, and with noise."""
    body, spin = rm.Body(request.param), rm.Start(omega=(1.0, -6.0, 1.3))
    drag = rm.AxialDamping((0.1, 0.15, 0.2))
    result = rm.simulate(
        rm.Scene(body, (drag,), spin), members=1, t_end=3.0, dt=0.01, every=0.01, save=("omega",),
        integrator="rk8",
    )  # fmt: skip
    w = result.omega.transpose("time", "member", "axis").values[:, 0]
    noise = 0.005 * np.random.default_rng(1).standard_normal(w.shape)
    return rm.Scene(body, (), spin), result.time.values, w + noise


def told(scene, t, w, nuisances=()):
    return examine(scene, [Record("data", {"omega": t}, {"omega": w})], nuisances)[1]


def test_nothing_is_told_of_sound_rates(motion):
    scene, t, w = motion
    assert told(scene, t, w) == []
    assert told(scene, t, w @ TILT, ("alignment",)) == []
    assert told(scene, t, w * [-1.0, -1.0, 1.0]) == []  # the same body, turned
    assert told(scene, t[::7], w[::7]) == []
    gaps = np.where(np.random.default_rng(2).random(w.shape) < 0.1, np.nan, w)
    assert told(scene, t, gaps) == []


def test_rough_guesses_are_not_suspected(motion):
    """First guesses right to 10 % tell a negated column, and columns in another order."""
    scene, t, w = motion
    rng, found = np.random.default_rng(4), list[bool]()
    for _ in range(6):
        guess = np.array((1.0, 1.0, 9.0))
        while 2.0 * guess.max() >= guess.sum():
            guess = np.array(scene.body.moments) * np.exp(0.1 * rng.standard_normal(3))
        rough = rm.Scene(rm.Body(tuple(guess)), (), scene.start)
        assert told(rough, t, w) == []
        found += [told(rough, t, w * [1, -1, 1]) != [], told(rough, t, w[:, [2, 0, 1]]) != []]
    assert all(found)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("is_turned", [False, True])
def test_units_are_told(motion, factor, is_turned):
    scene, t, w = motion
    scaled = (t * factor, w) if "times" in FACTORS[factor] else (t, w * factor)
    some = told(scene, scaled[0], scaled[1] @ (TILT if is_turned else np.eye(3)),
                ("omega.alignment",) if is_turned else ())  # fmt: skip
    assert any(FACTORS[factor] in text for text in some)


def test_another_rate_is_told(motion):
    scene, t, w = motion
    if np.ptp(scene.body.moments[:2]) < 0.1 * scene.body.moments[1]:
        return  # another body with an axis of symmetry moves so
    (text,) = told(scene, 2.0 * t, w)
    assert "another sampling rate" in text


def test_rates_of_no_free_body_are_told(motion):
    scene, t, w = motion
    turned = w + np.stack([np.sin(4 * t), np.cos(5 * t), np.sin(6 * t)], axis=1) * 4.0
    (text,) = told(scene, t, turned)
    assert "no free body moves so" in text


def signed(columns):
    """The axes of a sensor whose columns are (2, -1, 3) of the body, say."""
    return np.array([np.sign(c) * np.eye(3)[abs(c) - 1] for c in columns])


@pytest.mark.parametrize("columns", [(2, 1, 3), (1, -2, 3), (2, 3, 1), (3, -1, -2), (-1, -2, -3)])
def test_axes_are_told(motion, columns):
    scene, t, w = motion
    readings = w @ signed(columns).T
    (text,) = told(scene, t, readings)
    words = text.partition("(")[2].partition(")")[0].replace("omega[", "").replace("]", "")
    mended = readings @ signed([int(word) for word in words.split(",")]).T
    assert told(scene, t, mended) == []


def test_a_left_hand_is_told(motion):
    scene, t, w = motion
    if scene.body.moments[0] < 0.1 * scene.body.moments[1]:
        return  # a thin body moves much like its mirror image
    (text,) = told(scene, t, (w * [1.0, 1.0, -1.0]) @ TILT, ("alignment",))
    assert "left-handed" in text


def test_other_torques_forbid_the_balance(motion):
    scene, t, w = motion
    heavy = rm.Scene(
        rm.Body(scene.body.moments, 1.0, (0.0, 0.0, 0.1)), (rm.Gravity(9.8),), scene.start
    )
    assert told(heavy, t, w[:, [1, 0, 2]]) == []


def test_impossible_times_are_refused(motion):
    scene, t, w = motion
    with pytest.raises(OptionError, match="rad between two readings"):
        told(scene, 1e9 * t, w)


def test_saturated_readings_are_left_out(motion):
    scene, t, w = motion
    top = np.quantile(w[:, 1], 0.7)
    clipped = np.minimum(w, [np.inf, top, np.inf])
    record = Record("data", {"omega": t}, {"omega": clipped})
    (record,), notes = examine(scene, [record], ())
    left = np.isnan(record.values["omega"])
    assert left[:, 1].any() and not left[:, [0, 2]].any()
    assert (w[left[:, 1], 1] >= top).all()
    assert f"omega[2] stays at its extreme {top:g}" in notes[0] and "left out" in notes[0]


def test_smooth_tops_are_not_saturated():
    t = np.arange(200) * 0.01
    w = np.round(np.stack([np.sin(t), np.cos(3 * t), 2 + np.sin(2 * t)], axis=1), 3)
    record = Record("data", {"omega": t}, {"omega": w})
    scene = rm.Scene(rm.Body((1, 1, 1)), (), rm.Start(omega=(0.0, 0.0, 1.0)))
    (found,), notes = examine(scene, [record], ())
    assert np.isfinite(found.values["omega"]).all()
    assert not any("extreme" in text for text in notes)


def test_hanging_and_slow_sensors_are_told():
    rng, t = np.random.default_rng(3), np.arange(100) * 0.01
    scene = rm.Scene(rm.Body((1, 1, 1)), (), rm.Start(omega=(0.0, 0.0, 1.0)))
    w = np.array([0.0, 0.0, 1.0]) + 0.01 * rng.standard_normal((100, 3))
    hanging = np.array(w)
    hanging[:, 0] = 0.5
    empty = np.array(w)
    empty[:, 1] = np.nan
    for readings, text in (
        (hanging, "omega[1] reads 0.5 at all times"),
        (empty, "omega[2] has no readings"),
        (np.repeat(w[::4], 4, axis=0), "repeats each reading about 4.1 times"),
    ):
        notes = told(scene, t, readings)
        assert len(notes) == 1 and text in notes[0]


def test_numbers_are_no_sensors_that_hang():
    scene = rm.Scene(rm.Body((1, 1, 1)), (), rm.Start(omega=(0.0, 0.0, 1.0)))
    w = 1.0 + 0.01 * np.random.default_rng(3).random(9)
    data = {"t": np.arange(9.0) * 0.1, "w": w, "c": [0.5] * 9}
    for words, count in (("omega=0,-1.5e-1,w", 0), ("omega=0,c,w", 1), ("omega=0,2*c,w", 1)):
        records = records_of(scene, data, read_columns_option(words, "columns"), None, None, ())
        notes = examine(scene, records, ())[1]
        assert len(notes) == count and all("omega[2] reads" in text for text in notes)


@pytest.mark.filterwarnings("ignore:steps 4 times finer")
def test_a_planar_pendulum_shows_one_moment():
    def scene(size):
        body = rm.Body((0.0973 * size, 0.001 * size, 0.0973 * size), 0.45728, (0.0, -0.413, 0.0))
        start = rm.Start(omega=(0.0, 0.0, 0.0), attitude=(0.0, 0.5 * np.pi, -0.3))
        return rm.Scene(body, (rm.Gravity(9.809),), start)

    run = {"t_end": 2.0, "dt": 0.01, "every": 0.02, "save": ("omega",), "integrator": "rk8"}
    w = rm.simulate(scene(1.0), members=1, **run).omega.transpose("time", ...).values.reshape(-1, 3)
    data = {
        "t": np.arange(101) * 0.02,
        "omega": w + 0.005 * np.random.default_rng(1).random((101, 3)),
    }
    for size in (1.0, 0.45):
        study = rm.fit(scene(size), data, "body.moments,start.omega.3", trials=8)
        assert np.isfinite(study.deviation.values[:3]).tolist() == [False, False, True]
        assert np.isinf(study.ratio_deviation.values[[0, 1], 2]).all()
        # measured 1e-4
        assert abs(study.value.values[0, 2] - 0.0973) < 1e-3
        unseen = [text.split(":")[0] for text in study.attrs["unseen"].splitlines()]
        assert sorted(unseen) == [f"the data do not show body.moments.{i}" for i in (1, 2)]
        told = "body.moments.3 is 2.22 times its first guess" in study.attrs["notes"]
        assert told == (size < 1.0)


def test_noise_of_channels():
    """Times of any spacing, gaps, and a channel that hangs."""
    rng = np.random.default_rng(1)
    for t in (np.arange(2000) * 0.01, np.sort(rng.uniform(0.0, 20.0, 2000))):
        x = np.sin(3 * t)[:, None] * [1.0, 2.0, 3.0] + 0.01 * rng.standard_normal((2000, 3))
        x[:, 2], x[::9] = 5.0, np.nan
        t[1000:] += 3.0
        noise = high_frequency_noise(Stream("omega", VECTOR, t[None], x[None], np.empty(0)))
        np.testing.assert_allclose(noise, 0.01, rtol=0.1)
        assert noise[2] == max(noise[:2])


def test_notes_come_with_the_study(tmp_path, capsys):
    data = {"t": np.arange(40) * 0.05, "omega": np.tile([0.0, 0.0, 1.0], (40, 1))}
    scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), (), rm.Start(omega=(0.0, 0.0, 1.0)))
    study = rm.fit(scene, data, "start.omega", trials=2)
    assert "omega[1] reads 0 at all times" in study.attrs["notes"]
    study.to_netcdf(tmp_path / "fit.nc")
    assert "reads 0 at all times" in str(xr.open_dataset(tmp_path / "fit.nc").attrs["notes"])


@pytest.fixture(scope="module")
def thrown():
    """Times, rates and momenta of a wheel in the axes of a tilted sensor, by SciPy; its moments."""
    moments, t = np.array([3.0, 5.0, 6.0]), np.arange(0.0, 3.0, 0.02)

    def wheel(t):
        return TILT.T @ [0.0, 0.0, 4.0 - 3.0 * t]

    def rate(t, w):
        torque = np.cross(moments * w + wheel(t), w) + TILT.T @ [0.0, 0.0, 3.0]
        return torque / moments

    found = solve_ivp(rate, (0.0, 3.0), [1.0, -2.0, 0.5], "DOP853", t, rtol=1e-12, atol=1e-12)
    return t, found.y.T @ TILT.T, 4.0 - 3.0 * t, moments


@pytest.mark.parametrize("is_later", [False, True])
def test_a_measured_wheel_shows_the_whole_tensor(thrown, is_later):
    t, w, momentum, moments = thrown
    table = {"t": t, **dict(zip(("wx", "wy", "wz"), w.T, strict=True)), "spin": momentum / 0.02}
    if is_later:  # a second record, which begins in the middle
        table = {k: np.concatenate([x, x[60:]]) for k, x in table.items()}
        table["toss"] = np.repeat([0, 1], [t.size, t.size - 60])
    scene = rm.Scene(rm.Body((4.0, 5.0, 7.0)), (), rm.Start(omega=(0.0, -1.0, 0.0)))
    columns = read_columns_option("wheel=0,0,2e-2*spin", "columns")
    records = records_of(scene, table, columns, None, "toss" if is_later else None, ())
    free = "body.moments", "start.omega"
    problem = make_problem(scene, free, (), records, None, ("alignment",), 1)
    trials = make_starts(problem, 8, 1)
    solution = minimise(problem, trials)
    x = solution.x[np.argmin(solution.sums.cost)]
    names = dict(zip(problem.parameters.names, problem.parameters.values(x), strict=True))
    assert len(names) == 3 + 3 * len(records) + 3
    assert not seen(problem.sums(x[None]).matrix[0]).unseen.size
    turn = Rotation.from_rotvec([names[f"omega.alignment.{i}"] for i in (1, 2, 3)]).as_matrix()
    tensor = (turn * [names[f"body.moments.{i}"] for i in (1, 2, 3)]) @ turn.T
    # measured: 2e-7
    np.testing.assert_allclose(tensor, (TILT * moments) @ TILT.T, atol=1e-5)
    given = {"columns": "wheel=0,0,2e-2*spin", "nuisances": "alignment"}
    split = "toss" if is_later else None
    request = rm.fit.design(scene, table, ",".join(free), split=split, **given)[1]
    kept = maker(json.loads(json.dumps(request)), 1)(scene)  # as a run directory has it
    np.testing.assert_array_equal(kept.sums(x[None]).cost, problem.sums(x[None]).cost)


def test_pieces_of_a_wheel_end_where_its_speed_steps():
    scene, t = rm.Scene(rm.Body((4.0, 5.0, 7.0))), np.arange(0.0, 600.0, 0.25)
    steps = [[0.0, 120.0, 122.0, 300.0, 302.0], [0.0, 100.0, 101.0, 250.0, 252.0]]
    speeds = [np.interp(t, step, [1.0, 1.0, 2.5, 2.5, -0.5]) for step in steps]
    speeds[1] = speeds[1][: 4 * 400]  # a shorter record
    wheels = [{"t": 50.0 + t[: h.size], "momenta": h[:, None] * [0.0, 1.0, 0.0]} for h in speeds]
    records = [
        Record("pass", {"omega": w["t"]}, {"omega": np.zeros((h.size, 3))}, w)
        for w, h in zip(wheels, speeds, strict=True)
    ]
    made, inputs = with_wheel(scene, records)
    (wheel,), (lines,) = made.effects, inputs.values()
    place = np.searchsorted(wheel.times, t, side="right") - 1
    for (first, rate), h in zip(lines.reshape(2, 2, -1), speeds, strict=True):
        found = first[place] + rate[place] * t
        np.testing.assert_allclose(found[: h.size], h, atol=1e-6)


def test_a_request_keeps_the_wheel(thrown):
    t, w, momentum, _ = thrown
    table = {"t": t, **dict(zip(("wx", "wy", "wz"), w.T, strict=True)), "spin": momentum}
    scene = rm.Scene(rm.Body((4.0, 5.0, 7.0)), (), rm.Start(omega=(0.0, -1.0, 0.0)))
    given = {"data": table, "columns": "wheel=0,0,-2*spin", "free": "body.moments,start.omega"}
    request = start(scene, FitOptions.read(given), {})[1]
    ((*_, wheel),) = request["records"]
    np.testing.assert_array_equal(np.array(wheel["momenta"])[:, 2], -2.0 * momentum)
    assert len(maker(request, 1)(scene).run.scene.effects) == 1
