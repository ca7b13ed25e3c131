"""`rigidmc body FILE`, and files damaged at random: a body or one line, never a traceback."""

import json
import random
import warnings

import numpy as np
import pytest

import rigidmc as rm
from tests.scene.body_files.test_real_bodies import GO1_URDF, PANDA_MJCF, PANDA_URDF, UR5, WING
from tests.tools.commands import invoke


def body_command(*words):
    return invoke("body", *words)


def test_a_link_is_described(tmp_path):
    (tmp_path / "ur5.urdf").write_text(UR5)
    shown = body_command(tmp_path / "ur5.urdf", "--link", "forearm_link", "--pivot", "centre")
    assert shown.exit_code == 0 and "mass         2.275 kg" in shown.stdout
    shown = body_command(tmp_path / "ur5.urdf", "--link", "forearm_link", "--json")
    assert json.loads(shown.stdout)["centre"] == [0.0, 0.0, 0.25]
    words = "--link", "forearm_link", "--pivot", "0,0,0.05", "--json"
    moved = body_command(tmp_path / "ur5.urdf", *words)
    assert json.loads(moved.stdout)["centre"] == [0.0, 0.0, 0.2]


def test_what_is_assumed_is_told(tmp_path):
    (tmp_path / "panda.urdf").write_text(PANDA_URDF)
    shown = body_command(tmp_path / "panda.urdf", "--link", "panda_link7")
    assert "note: " in shown.stderr and "includes panda_hand, by fixed joints" in shown.stderr
    (tmp_path / "wing.TXT").write_text(WING)
    shown = body_command(tmp_path / "wing.TXT")
    assert shown.exit_code == 0 and "Lxy is read as +int x y dm" in shown.stderr


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["ur5.urdf", "--link", "forearm"], "did you mean 'forearm_link'"),
        (["ur5.urdf"], "choose one of upper_arm_link, forearm_link"),
        (["ur5.urdf", "--link", "forearm_link", "--pivot", "top"], "--pivot = 'top'"),
        (["ur5.urdf", "--link", "forearm_link", "--mass", "3"], "is for meshes only"),
        (["dzhanibekov", "--link", "arm"], "apply to files with a body only"),
    ],
)
def test_mistakes_take_one_line(tmp_path, monkeypatch, words, rule):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ur5.urdf").write_text(UR5)
    shown = body_command(*words)
    assert shown.exit_code == 3 and rule in shown.stderr and shown.stderr.count("\n") == 1
    assert "Traceback" not in shown.output


def test_a_missing_file():
    shown = body_command("nothing.urdf")
    assert shown.exit_code == 74 and "nothing.urdf" in shown.stderr


@pytest.mark.parametrize(
    ("name", "text", "link"),
    [
        ("a.urdf", PANDA_URDF, "panda_link7"),
        ("a.urdf", GO1_URDF, None),
        ("a.xml", PANDA_MJCF, "link7"),
        ("a.txt", WING, None),
    ],
)
def test_damaged_files_make_a_body_or_an_error(tmp_path, name, text, link):
    chance, good = random.Random(1), 0
    for _ in range(100):
        letters = list(text)
        for _ in range(chance.choice([1, 1, 2, 5, 20])):
            at = chance.randrange(len(letters))
            letters[at] = chance.choice((*'09-<>"e x/\n', ""))
        (tmp_path / name).write_text("".join(letters))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rm.SceneWarning)
            try:
                body = rm.Body.read(tmp_path / name, link=link)
            except rm.RigidmcError as error:
                assert len(str(error)) < 1700 and "\n" not in str(error)
            else:
                good += 1
                assert np.isfinite(body.tensor).all() and body.mass > 0.0
    assert good > 5  # the damage is not always fatal
