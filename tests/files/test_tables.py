"""CSV tables as spreadsheets and instruments write them; files of another kind, named for it."""

import warnings

import numpy as np
import pytest

import rigidmc as rm
from rigidmc.files.tables import read_number_table
from rigidmc.scene.toml.columns import read_columns

NAMES = ("a", "b")
SEMICOLONS, COMMAS = "columns are separated by ';'", "a comma is the decimal point"
# text: (columns a and b, notes)
READ = {
    "a,b\n1,2\n3,4\n": ([1, 3], [2, 4], ()),
    "a;b\n1;2\n3;4\n": ([1, 3], [2, 4], (SEMICOLONS,)),
    "a;b\n1,5;2\n-3e-1;,25\n": ([1.5, -0.3], [2, 0.25], (SEMICOLONS, COMMAS)),
    "a;b\n1.5;2\n": ([1.5], [2], (SEMICOLONS,)),
    '"a","b"\n"1","2.5"\n': ([1], [2.5], ()),
    '"a";"b"\n"1,5";"2"\n': ([1.5], [2], (SEMICOLONS, COMMAS)),
    'b, "a"\n1, "2"\n': ([2], [1], ()),
    "a,b,name\n1,2,x\n": ([1], [2], ()),
    'a,b,"no, 1"\n1,2,"one; two"\n': ([1], [2], ()),
    'a,b,"c # d"\n1,2,"x # y"\n# a comment\n\n3,4,5 # another\n': ([1, 3], [2, 4], ()),
    "\ufeffa,b\r\n1,2\r\n": ([1], [2], ()),
    "a,b\r1,2\r": ([1], [2], ()),
    "a,b,c,c\n1,2,3,4\n": ([1], [2], ()),
}
REFUSED = {
    "a,a,b\n1,2,3\n": "several columns have the name a",
    "a,b\n1,x\n": "b': row 1 is text, 'x', not a number",
    "a,b\n1,2\n1,2021-03-04\n": "row 2 is text, '2021-03-04'",
    "a,b\n1,2\n\n1,\n": "row 2 is empty",
    "a,b\n1,nan\n": "row 1 is not finite",
    "a,b\n1_000,2\n": "row 1 is text, '1_000'",
    'a,b\n"1,5",2\n': "only if semicolons separate the columns",
    "a;b\n1,5;2.5\n": "has decimal points, but other columns have decimal commas",
    "a;b\n1.234,5;2\n": "without marks between thousands",
    "a,b\n1,5,2,5\n": "with decimal commas, separate them by semicolons",
    "a;b,c\n1;2,3\n": "commas and semicolons",
    "a,b\n1;2\n": "separate the names by semicolons, too",
    'a,b\n"1,2\n3",4\n': "does not end in its line",
    'a,b\n1,2\n3,"4\n': "cannot be read",
    "a,b\n1,2\n3\n": "row 2 has 1",
    "a,b\n": "no rows",
    f"a,b\n{'x' * 1000},2\n": "row 1 is text",
}  # fmt: skip


def columns(folder, text, name="t.csv"):
    (folder / name).write_bytes(text.encode())
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        found = read_columns(str(folder), name, list(NAMES), "start.omega")
    return [x.tolist() for x in found], [str(note.message) for note in notes]


@pytest.mark.parametrize("text", READ)
def test_tables_are_read(tmp_path, text):
    a, b, notes = READ[text]
    for name in ("t.csv", "t.CSV"):
        wanted = [f"{name}: {'; '.join(notes)}"] if notes else []
        assert columns(tmp_path, text, name) == ([a, b], wanted)


@pytest.mark.parametrize("text", REFUSED)
def test_tables_are_refused(tmp_path, text):
    with pytest.raises(rm.SceneError) as error:
        columns(tmp_path, text)
    assert REFUSED[text] in str(error.value) and "t.csv" in str(error.value)
    assert len(str(error.value)) < 400


def test_numbers_keep_their_bits_over_all_pieces(tmp_path):
    """50,000 rows are three pieces; every number as Python reads it."""
    values = np.random.default_rng(1).normal(size=50_000) * 10.0 ** np.arange(50).repeat(1000)
    for mark, name in ((".", "a,b"), (",", "a;b")):
        lines = (f"{x!r}{name[1]}1\n".replace(".", mark) for x in values.tolist())
        (tmp_path / "t.csv").write_text(f"{name}\n" + "".join(lines))
        table = read_number_table(tmp_path / "t.csv")
        assert (table.columns[0] == values).all() and table.rows == values.size
    (tmp_path / "t.csv").write_text("a,b\n" + "1,2\n" * 30_000 + "1,x\n" + "1,y\n" * 30_000)
    assert read_number_table(tmp_path / "t.csv").columns[1] == (30_001, "x")


def test_a_quaternion_of_zeros_is_named_by_its_row(tmp_path):
    (tmp_path / "q.csv").write_text("w;x;y;z\n1;0;0;0\n0;0;0;0\n")
    (tmp_path / "s.toml").write_text(
        "[body]\nmoments = [1, 2, 2.5]\n[start]\nomega = [0, 0, 1]\n"
        'attitude = { table = "q.csv", columns = ["w", "x", "y", "z"] }\n'
    )
    with (
        pytest.warns(rm.SceneWarning, match=SEMICOLONS),
        pytest.raises(rm.SceneError, match="row 2 is zero"),
    ):
        rm.Scene.load(tmp_path / "s.toml")
    # as many rows as components: names decide, not the shape
    (tmp_path / "q.csv").write_text("w,x,y,z\n" + "1,0,0,0\n0,1,0,0\n" * 2)
    found = rm.Scene.load(tmp_path / "s.toml").start.attitude
    assert [x.tolist() for x in found[:2]] == [[1, 0, 1, 0], [0, 1, 0, 1]]


TEXTS = {
    "a.sdf": ('<sdf version="1.6"/>', "an SDF file, which rigidmc does not read: convert it"),
    "b.xml": ('<sdf version="1.6"/>', "the file of a body, not a scene: `rigidmc body"),
    "r.urdf": ('<robot name="r"/>', "the file of a body, not a scene: `rigidmc body"),
    "m.mjcf": ("<mujoco/>", "the file of a body, not a scene: `rigidmc body"),
    "c.txt": ("Mass = 1 g\n", "the file of a body, not a scene: `rigidmc body"),
    "d.stl": ("solid a\nendsolid a\n", "the file of a body, not a scene: `rigidmc body"),
    "e.step": ("ISO-10303-21;\n", "a CAD model, which rigidmc does not read: export"),
    "f.csv": ("a,b\n1,2\n", "a table, not a scene: a scene reads a column"),
    "g.py": ("import os\n", "code, not a scene: a scene names a class"),
    "h.png": ("\x89PNG", "a picture, not a scene"),
}
SCENE = "[body]\nmoments = [1.0, 2.0, 2.5]\n[start]\nomega = [0.0, 1.0, 0.0]\n"


@pytest.mark.parametrize("name", TEXTS)
def test_no_other_file_is_a_scene(name, tmp_path):
    text, words = TEXTS[name]
    path = tmp_path / name
    path.write_text(text, encoding="latin-1")
    with pytest.raises(rm.FileError) as caught:
        rm.Scene.load(path)
    assert f"is {words}" in str(caught.value) and name in str(caught.value)
    with pytest.raises(rm.FileError, match=f"is {words.split(', not')[0].split(':')[0]}"):
        rm.open(path)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("s.toml", SCENE, "is a scene, not a body: rm.Scene.load"),
        ("r.nc", "", "is a result, not a body: rm.Scene.load"),
        ("a.sdf", "<sdf/>", "is an SDF file"),
        ("b.xml", "<sdf/>", "is an SDF file"),
    ],
)
def test_no_other_file_is_a_body(name, text, words, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(rm.RigidmcError, match=words):
        rm.Body.read(tmp_path / name)


def test_a_scene_is_not_a_result_and_may_have_any_suffix(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(SCENE)
    with pytest.raises(rm.FileError, match="is a scene, not a result: run it first"):
        rm.open(path)
    other = tmp_path / "s.txt"
    other.write_text(SCENE)
    assert rm.Scene.load(other).body.moments == (1.0, 2.0, 2.5)
    other.write_text(SCENE + "[run\n")
    with pytest.raises(rm.SceneError, match="not valid TOML"):
        rm.Scene.load(other)
