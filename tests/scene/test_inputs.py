"""Arrays count by their places, or by their labels: every door takes the same, and refuses what
means more, or what reads two ways."""

import itertools
import re
import types

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import rigidmc as rm
from rigidmc.inputs.arrays import as_plain_arrays, floats
from rigidmc.mechanics import coordinates, inertia, rotation, textbook
from rigidmc.views.polhodes import draw_polhodes

BODY = rm.Body((1.0, 2.0, 2.5))
BOX = rm.Body.box(12.0, (1.0, 2.0, 3.0))
UP = (1.0, 0.0, 0.0, 0.0)
# also moments of four bodies: (3, 3) reads two ways
V = np.array([[1.0, 2.0, 2.5], [1.5, 2.0, 2.25], [2.0, 2.5, 3.0], [2.0, 3.0, 4.0]])
Q = np.array([[1, 2, 3, 4], [2, 1, 4, 3], [3, 4, 1, 2], [4, 3, 2, 1], [1, 1, 2, 3]], float)
T = np.diag([1.0, 2.0, 2.5])
COLUMN = np.array([1.0, 2.0, 3.0])


def effect(made):
    return rm.Scene(BODY, made).effects[0]


# {door: (an array that it takes, the door, and what it makes of the array)}
DOORS = {
    "omega": (V, lambda x: rm.Start(omega=x).omega),
    "momentum": (V, lambda x: rm.Start(momentum=x).momentum),
    "a component of omega": (COLUMN, lambda x: rm.Start(omega=(x, 0.0, 0.0)).omega),
    "one omega": (COLUMN, lambda x: rm.Start(omega=x).omega),
    "attitudes": (Q, lambda x: rm.Start(omega=(0, 0, 1), attitude=x).attitude),
    "one attitude": (Q[0], lambda x: rm.Start(omega=(0, 0, 1), attitude=x).attitude),
    "Euler angles": (COLUMN, lambda x: rm.Start(omega=(0, 0, 1), attitude=x).attitude),
    "moments": (V, lambda x: rm.Body(x).moments),
    "from_moments": (V, lambda x: rm.Body.from_moments(x).moments),
    "mass": (COLUMN, lambda x: rm.Body((1, 2, 2.5), mass=x).mass),
    "centre": (V, lambda x: rm.Body((1, 2, 2.5), centre=x).centre),
    "axes": (np.eye(3), lambda x: rm.Body((1, 2, 2.5), axes=x).axes),
    "tensor": (T, lambda x: rm.Body.from_tensor(x).moments),
    "masses": (COLUMN, lambda x: rm.Body.from_particles(x, np.eye(3)).moments),
    "positions": (V[:3], lambda x: rm.Body.from_particles([1, 2, 3], x).moments),
    "size": (COLUMN, lambda x: rm.Body.box(1.0, x).moments),
    "pivot": (COLUMN, lambda x: BOX.with_pivot(x).moments),
    "at": (COLUMN, lambda x: BOX.join(BOX, at=x).moments),
    "turned": (Q[0], lambda x: BOX.join(BOX, turned=x).moments),
    "a parameter": (COLUMN, lambda x: effect(rm.Gravity(x)).g),
    "a vector of an effect": (V, lambda x: effect(rm.BodyTorque(x)).torque),
    "mean": (V[0], lambda x: rm.Body(rm.Correlated(x, 0.01 * T)).moments.mean),
    "covariance": (T, lambda x: rm.Start(omega=rm.Correlated(COLUMN, x)).omega.covariance),
    "mean tensor": (T, lambda x: rm.Body.from_tensor(rm.UncertainInertia(x, np.eye(6))).axes),
    "six": (
        np.eye(6),
        lambda x: rm.Body.from_tensor(rm.UncertainInertia(9 * T, x)).moments.covariance,
    ),
    "direction": (COLUMN, lambda x: rm.Start(momentum=rm.Shell(1.0, x)).momentum.direction),
    "mean attitude": (
        Q[0],
        lambda x: rm.Start(omega=(0, 0, 1), attitude=rm.Fisher(x, 1.0)).attitude.attitude,
    ),
    "to_reference": (V, BODY.to_reference),
    "to_principal": (V, BODY.to_principal),
    "reference_attitude": (Q, BODY.reference_attitude),
    "angular_momentum": (V, BODY.angular_momentum),
    "kinetic_energy": (V, BODY.kinetic_energy),
    "free_top moments": (V, lambda x: rm.solve_free_top(x, COLUMN, UP, 1.0).omega),
    "free_top momentum": (V, lambda x: rm.solve_free_top(V[0], x, UP, 1.0).omega),
    "free_top attitude": (Q, lambda x: rm.solve_free_top(V[0], COLUMN, x, 1.0).attitude),
    "free_top t": (COLUMN, lambda x: rm.solve_free_top(V[0], COLUMN, UP, x).omega),
    "free_motion": (V, lambda x: rm.analyse_free_top(V[0], x).period),
    "lagrange_top": (V, lambda x: rm.solve_lagrange_top((1, 1, 0.5), 1.0, x, UP, 1.0).omega),
    "weight": (COLUMN, lambda x: rm.analyse_lagrange_top((1, 1, 0.5), x, COLUMN, UP).period),
    "to_space": (V, lambda x: rotation.to_space(UP, x)),
    "from_euler": (V, rotation.from_euler),
    "from_rotation_vector": (V, rotation.from_rotation_vector),
    "product": (Q, lambda x: rotation.product(x, Q)),
    "hat": (V, rotation.hat),
    "rates": (V, lambda x: rm.omega_from_euler_rates(V, x)),
    "coordinates": (V, lambda x: coordinates.rate_matrix("313", x)),
    "of_particles": (COLUMN, lambda x: inertia.of_particles(x, V[:3])),
    "about_point": (V, lambda x: inertia.about_point(T, 1.0, x)),
    "growth_rate": (V, inertia.growth_rate),
    "symmetric_omega": (V, lambda x: textbook.symmetric_omega((1, 1, 2), x, 0.5)),
}


class Torch:
    """What a tensor of torch has."""

    def __init__(self, x):
        self.x = x

    def __len__(self):
        return len(self.x)

    def __iter__(self):
        return iter(self.x)

    def __array__(self, dtype=None, copy=None):
        return self.x


class Polars(Torch):
    """What a Series of polars has."""

    def to_numpy(self):
        return self.x


class Pint(Torch):
    """What a quantity of pint has."""

    magnitude, units = 1.0, "deg/s"


class Astropy(np.ndarray):
    unit = "deg / s"


def masked(x):
    mask = np.zeros(x.shape, bool)
    mask[1] = True
    return np.ma.masked_array(x, mask)


def named(x):
    names = [(f"w{i}", float) for i in range(x.shape[-1])]
    return np.array(list(map(tuple, np.atleast_2d(x))), names)


# {what: (of an array, a word of the message)}
REFUSED = {
    "masked": (masked, "row 1 is masked"),
    "DataFrame": (
        lambda x: pd.DataFrame(np.atleast_2d(x)).rename(columns="abcdef".__getitem__),
        "",
    ),
    "Series": (lambda x: pd.Series(list(x), index=range(5, 5 + len(x))), "label"),
    "nullable Series": (lambda x: pd.Series([*x.ravel(), None], dtype="Float64"), "missing"),
    "dict": (lambda x: dict(enumerate(x)), "has keys"),
    "values of a dict": (lambda x: dict(enumerate(x)).values(), "give list(x)"),
    "set": (lambda x: set(x.ravel()), "has no order"),
    "generator": (lambda x: (one for one in x), "give list(x)"),
    "DataArray": (lambda x: xr.DataArray(x, attrs={"units": "deg/h"}), "deg/h"),
    "Dataset": (lambda x: xr.Dataset({"w": (("n", "k")[: x.ndim], x)}), "several variables"),
    "polars": (Polars, "x.to_numpy()"),
    "pint": (Pint, "has a unit"),
    "astropy": (lambda x: x.view(Astropy), "has a unit"),
    "tensor of torch": (Torch, "np.asarray(x)"),
    "bytes": (lambda x: bytes(x.astype(np.uint8)), "of bytes"),
    "memoryview": (memoryview, "of bytes"),
    "complex": (lambda x: x + 1j, "are complex"),
    "truth values": (lambda x: x > 0.0, "booleans"),
    "dates": (lambda x: x.astype("M8[s]"), "are dates"),
    "time differences": (lambda x: x.astype("m8[s]"), "time differences"),
    "columns with names": (named, "have names"),
    "text": (lambda x: x.astype(str), "number"),
    "a list with a masked entry": (lambda x: [*x[:-1], np.ma.masked], "masked"),
    "a list with a frame": (lambda x: [*x[:-1], pd.DataFrame([np.ravel(x[-1])])], "is a table"),
    "components first": (lambda x: np.ones((x.shape[-1], 7)), "shape"),
}
COMPLEX = {"hat", "coordinates"}  # a derivative may be taken by a complex step
SCALARS = {k for k, (x, _) in DOORS.items() if x is COLUMN} - {
    "one omega", "Euler angles", "size", "pivot", "at", "direction",
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
def test_what_means_more_than_its_places_is_refused(door):
    """1,150 cases of doors and objects: each is refused, none is taken as numbers."""
    array, take = DOORS[door]
    for what, (of, word) in REFUSED.items():
        if (what == "complex" and door in COMPLEX) or (
            what == "components first" and door in SCALARS
        ):
            continue
        with pytest.raises(rm.SceneError) as error:
            pytest.fail(f"{door} takes {what}: {take(of(array))}")
        text = str(error.value)
        assert word in text or what in ("text", "components first"), (door, what, text)
        assert "Traceback" not in text and "object at 0x" not in text


@pytest.mark.parametrize("door", DOORS)
def test_every_plain_array_of_the_same_numbers_is_the_same(door, tmp_path):
    array, take = DOORS[door]
    wanted = repr(take(array))
    file = np.memmap(tmp_path / "x", float, "w+", shape=array.shape)
    file[:] = array
    plain, wide = np.ma.masked_array(array), array.astype(np.longdouble)
    same = [np.ma.masked_array(array, False), plain, wide, np.asfortranarray(array), file]
    if (array == array.astype(np.float32)).all():
        same.append(array.astype(np.float32))
    for one in same:
        assert repr(take(one)) == wanted, (door, type(one))


def test_rows_are_members_whatever_their_number():
    """(members, 3) and (members, 4) for 1 to 6 members; other shapes are refused, and those that
    read two ways."""
    for count, size in itertools.product(range(1, 7), (3, 4)):
        x = np.arange(1.0, 1.0 + count * size).reshape(count, size)

        def start(x, size=size):
            made = rm.Start(omega=x if size == 3 else (0, 0, 1), attitude=x if size == 4 else UP)
            return made.omega if size == 3 else made.attitude

        ambiguous = count == size or (count, size) == (3, 4)  # Euler angles of four members
        for one, rule in ((x, ""), (x.T, "give its transpose")):
            if rule or ambiguous:
                with pytest.raises(rm.SceneError, match="reads two ways" if ambiguous else rule):
                    start(one)
            else:
                assert np.array_equal(np.transpose(start(one)), x)
                assert np.array_equal(np.transpose(start(one.tolist())), x)
                assert np.array_equal(np.transpose(start(list(one))), x)


def test_components_of_quaternions_are_no_members():
    """(4, N) for N = 3 and 4, which have as many rows as components."""
    for count in (3, 4):
        q = rm.Start(omega=(0, 0, 1), attitude="uniform").sample_attitude(1, 0, count)
        with pytest.raises(rm.SceneError, match="its columns are quaternions"):
            rm.Start(omega=(0, 0, 1), attitude=q)
        rows = rm.Start(omega=(0, 0, 1), attitude=q.T)
        assert np.abs(rows.sample_attitude(0, 0, count) - q).max() == 0.0
    with pytest.raises(rm.SceneError, match="reads two ways"):
        rm.Start(omega=(0, 0, 1), attitude=np.eye(4)[[1, 2, 3, 0]])  # rows and columns
    for rows in (np.ones((4, 3)), list(np.ones((4, 3))), list(np.ones((3, 4)))):
        with pytest.raises(rm.SceneError, match="reads two ways"):
            rm.Start(omega=(0, 0, 1), attitude=rows)


def test_euler_angles_of_three_members_are_no_matrix():
    angles = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6]), np.array([0.7, 0.8, 0.9])
    q = rm.Start(omega=(0, 0, 1), attitude=angles).sample_attitude(0, 0, 3)
    assert np.abs(q.T - rotation.from_euler(np.column_stack(angles))).max() == 0.0
    for matrix in (np.eye(3), Rotation.from_euler("x", 0.3).as_matrix()):
        with pytest.raises(rm.SceneError, match="rows of a matrix or the Euler angles"):
            rm.Start(omega=(0, 0, 1), attitude=list(matrix))
        one = rm.Start(omega=(0, 0, 1), attitude=matrix.tolist())
        assert len(one.attitude) == 4


def test_numbers_at_the_ends_of_the_range():
    for x in (10**400, -(10**400), np.longdouble("1e4000"), np.nan, np.inf):
        with pytest.raises(rm.SceneError):
            rm.Start(omega=(x, 0.0, 0.0))
        with pytest.raises(rm.SceneError):
            rm.Start(omega=(np.array([1.0, x]), 0.0, 0.0))
    with pytest.raises(rm.SceneError, match="too large"):
        rm.solve_free_top((10**400, 1, 1), COLUMN, UP, 1.0)
    assert rm.Start(omega=(2**70, 0, 0)).omega[0] == 2.0**70
    assert floats([2**70, 1]).tolist() == [2.0**70, 1.0]
    for bad in (None, [1.0, None], [[1.0, 2.0], [3.0]], "1", ["1"], types):
        with pytest.raises(rm.SceneError):
            floats(bad)
    assert as_plain_arrays(range(3)) == [0, 1, 2]


def test_members_of_a_run_are_indices():
    scene = rm.Scene(BODY, start=rm.Start(omega=(0.0, 1.0, 0.0)))
    scene = scene.with_run(dt=0.1, t_end=0.1, integrator="exact")
    for which, word in (
        (np.ma.masked_array([1, 2, 3], [0, 1, 0]), "row 1 is masked"),
        (pd.Series([2, 1]), "increasing member indices"),
        (pd.DataFrame({"member": [1, 2]}), "increasing member indices"),
        (pd.Series([1, None], dtype="Int64"), "expected"),
        (np.array([False, True]), "booleans"),
        ({1, 2}, "has no order"),
        *((bad, "increasing member indices") for bad in (
            [2, 1], [1.0, 2.0], [], np.array([]), np.array([3, 3]), np.array([-1, 2]),
            np.array([0.5, 1.0]), np.array([[1, 2]]),
        )),
    ):  # fmt: skip
        with pytest.raises(rm.SceneError, match=re.escape(word)):
            rm.simulate(scene, members=which)
    ds = rm.simulate(scene, members=6)
    for which in (
        *([1, 2, 5], (1, 2, 5), np.array([1, 2, 5]), pd.Index([1, 2, 5])),
        *(
            ds.member[[1, 2, 5]],
            pd.Series([1, 2, 5], [7, 8, 9]),
            pd.Series([1, 2, 5], dtype="Int8"),
        ),
    ):
        assert rm.simulate(scene, members=which).member.values.tolist() == [1, 2, 5]


def test_axes_are_a_right_handed_set():
    for axes, word in ((2.0 * np.eye(3), "orthonormal"), (-np.eye(3), "left-handed")):
        with pytest.raises(rm.SceneError, match=word):
            rm.Body((1, 2, 2.5), axes=axes)


def test_polhodes_of_labels():
    with pytest.raises(rm.SceneError, match="which component is which"):
        draw_polhodes(pd.Series([1.0, 2.0, 3.0], list("abc")), COLUMN)


TABLE = """
[body]
moments = [1.0, 2.0, 2.5]
[start]
omega = { table = "FILE", columns = ["w1", "w2", "w3"] }
"""


@pytest.mark.parametrize("header", ["w1,w2,w3,w1", ' w1,w2,w3,"w1"', "w1,w3,w2,w3", "w2,w2,w3,w1"])
def test_a_column_that_is_named_twice_is_refused(tmp_path, header):
    (tmp_path / "t.csv").write_text(f"{header}\n1,2,3,4\n5,6,7,8\n")
    (tmp_path / "s.toml").write_text(TABLE.replace("FILE", "t.csv"))
    with pytest.raises(rm.SceneError, match="several columns have the name"):
        rm.Scene.load(tmp_path / "s.toml")
    for other in ("w1,w2,w3,x", "w1,w2,w3,", "x,w3,w2,w1"):  # others may be named alike
        (tmp_path / "t.csv").write_text(f"{other}\n1,2,3,4\n5,6,7,8\n")
        first = rm.Scene.load(tmp_path / "s.toml").start.omega[0]
        assert first.tolist() == ([1.0, 5.0] if other.startswith("w1") else [4.0, 8.0])
    (tmp_path / "t.csv").write_text("w1,w2,w3,x,x\n1,2,3,4,4\n5,6,7,8,8\n")
    assert rm.Scene.load(tmp_path / "s.toml").start.omega[2].tolist() == [3.0, 7.0]


def test_components_in_a_file_are_along_the_dimension_that_says_so(tmp_path):
    """For 1 to 8 members, either order of the dimensions, with and without their names."""
    text = TABLE.replace("FILE", "t.nc").replace('"w1", "w2", "w3"', '"w[1]", "w[2]", "w[3]"')
    (tmp_path / "s.toml").write_text(text)
    for count in range(1, 9):
        w = np.arange(1.0, 1.0 + 3 * count).reshape(3, count)
        for dims in (("axis", "member"), ("axis", "n"), ("k", "member"), ("k", "n")):
            for turned in (False, True):
                array = xr.DataArray(w, dims=dims)
                array = array.transpose(*dims[::-1]) if turned else array
                xr.Dataset({"w": array}).to_netcdf(tmp_path / "t.nc")
                if dims == ("k", "n") and (turned or count <= 6):
                    with pytest.raises(rm.SceneError, match="no such column"):
                        rm.Scene.load(tmp_path / "s.toml")
                    continue
                assert np.array_equal(rm.Scene.load(tmp_path / "s.toml").start.omega, w)
