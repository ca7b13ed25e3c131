"""A file of another kind is named for what it is, wherever a scene, a result or a body is read."""

import pytest

import rigidmc as rm

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
