"""Errors: one path for each, the file named once, options only at the command line."""

import ast
import pickle
from pathlib import Path
from typing import NamedTuple

import pytest

import rigidmc as rm
from rigidmc.errors import in_file, unknown
from rigidmc.inputs.amounts import parse_count, parse_seconds
from tests.tools.commands import invoke

PACKAGE = Path(rm.__file__).parent


class Wind(NamedTuple):
    """A part of a user's own whose torque asks for what there is not."""

    speed: float

    def torque(self, v):
        return v, 0.0, 0.0


@pytest.mark.parametrize(("error", "table", "key", "text"), [
    (rm.SceneError("no", at="run.dt", value=-1.0), "run", "dt", "[run] dt = -1.0: no"),
    (rm.SceneError("no", at="effects.bath.T"), "effects.bath", "T", "[effects.bath] T: no"),
    (rm.SceneError("no", at="start"), "", "start", "start: no"),
    # a table itself has no table
    (rm.SceneError("no", at="body.box", table="", value=5), "", "body.box", "body.box = 5: no"),
    (unknown("key", ["dt"], at="run", key="d.t"), "run", "d.t",
     "[run] d.t: no such key; known: dt (did you mean 'dt'?)"),
    # the dots of a file are those of its name
    (rm.FileError("no", at="scene.toml", file="run/"), "", "scene.toml", "run/: scene.toml: no"),
    (rm.OptionError("no", at="max_wall", value=0), "", "max_wall", "max_wall = 0: no"),
    (rm.PartError.of(Wind, "no", "effects", "torque"), "effects", "Wind.torque",
     "[effects] Wind.torque: no"),
])  # fmt: skip
def test_table_and_key_follow_from_the_path(error, table, key, text):
    assert (error.table, error.key, str(error)) == (table, key, text)
    again = pickle.loads(pickle.dumps(error))  # as from a worker of a cluster
    assert vars(again) == vars(error) and str(again) == text and type(again) is type(error)


def test_a_mistake_in_a_part_names_its_file_and_line():
    scene = rm.Scene(rm.Body((1.0, 2.0, 2.5)), (Wind(3.0),), rm.Start(omega=(0.0, 1.0, 0.0)))
    with pytest.raises(rm.PartError, match="unknown argument 'v'") as caught:
        rm.prepare(scene)
    error = caught.value
    assert isinstance(error, rm.SceneError) and error.at == "effects.Wind.torque"
    assert error.source == __file__
    lines = Path(__file__).read_text("utf-8").splitlines()
    assert lines[error.line - 1].strip() == "def torque(self, v):"


def test_a_file_that_raises_is_named_with_its_line(tmp_path):
    (tmp_path / "mine.py").write_text("x = 1\nnothing()\n")
    text = (
        'body.moments = [1, 2, 2.5]\nstart.omega = [0, 1, 0]\n[effects.Own]\nmodule = "mine.py"\n'
    )
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(rm.PartError, match="raises NameError") as caught:
        rm.Scene.load(tmp_path / "scene.toml", allow_code=True)
    error = caught.value
    assert (error.at, error.line) == ("effects.Own.module", 2)
    assert error.source == str((tmp_path / "mine.py").resolve())
    assert error.file == str(tmp_path / "scene.toml")


def test_a_key_may_have_a_dot():
    with pytest.raises(rm.SceneError, match=r"^\[run\] keep.omga = 'omga': no such") as caught:
        rm.prepare("heavy_top", save=("omega",), keep={"omga": "final"})
    assert caught.value.at == "run.keep.omga"


def test_the_first_file_stays():
    with pytest.raises(rm.FileError) as caught, in_file("outer.toml"), in_file("inner.nc"):
        raise rm.FileError("no", at="time")
    assert caught.value.file == "inner.nc"


def test_amounts_know_rule_and_value_alone():
    for read, wrong in ((parse_seconds, "soon"), (parse_count, 1.5)):
        with pytest.raises(ValueError, match="expected") as caught:
            read(wrong)
        assert not isinstance(caught.value, rm.RigidmcError)
    with pytest.raises(rm.SceneError, match=r"\[run\] dt = 'soon': expected a finite") as caught:
        rm.Scene.load("heavy_top").with_run(dt="soon")
    assert caught.value.at == "run.dt" and caught.value.value == "soon"


def test_the_command_line_shows_an_argument_as_its_option():
    with pytest.raises(rm.OptionError) as caught:
        rm.ftle("heavy_top", 0)
    assert caught.value.at == "families" and str(caught.value).startswith("families = 0: ")
    done = invoke("rare heavy_top --of mean(flips)")
    assert done.exit_code == 3 and done.output.startswith("rigidmc: heavy_top: --of = 'mean(")
    # `map` has no option of the name of its argument
    done = invoke("map list nosuch")
    assert done.exit_code == 3 and done.output.startswith("rigidmc: list: map = 'nosuch'")
    # a word after the option is no option, although it has the name of one
    done = invoke("new x.toml --solid box --size size=1,2")
    assert done.output.startswith("rigidmc: --size size = "), done.output


@pytest.mark.parametrize("path", ["x.foo", "nowhere/x.png"])
def test_outputs_are_named_by_their_own_option(path):
    done = invoke("run heavy_top --plot", path)
    assert done.exit_code in (3, 74) and "--output" not in done.output
    assert done.exit_code == 74 or "--plot = 'x.foo'" in done.output


def test_no_path_is_written_as_an_option_and_no_room_has_two_names_for_a_place():
    """`at` has no dashes, and no function takes (table, key)."""
    wrong = []
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            where = f"{file.relative_to(PACKAGE)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.keyword) and node.arg == "at":
                words = [x.value for x in ast.walk(node.value) if isinstance(x, ast.Constant)]
                if any(isinstance(x, str) and x.startswith("-") for x in words):
                    wrong.append(where)
            if isinstance(node, ast.FunctionDef) and file.name != "errors.py":
                every = (*node.args.args, *node.args.kwonlyargs)
                texts = {one.arg for one in every if ast.unparse(one.annotation or one) == "str"}
                if {"table", "key"} <= texts:
                    wrong.append(where)
    assert wrong == []
