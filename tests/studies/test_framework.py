"""What is made of the record of a study, for every study of the registry: function, command, run
directory, result, picture, and what they refuse."""

import inspect
import math
import re

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from typer.main import get_command

import rigidmc as rm
from rigidmc.cli import app
from rigidmc.studies import STUDIES, load_study
from rigidmc.studies.framework.members import Members
from rigidmc.studies.framework.options import (
    REQUIRED,
    Names,
    Numbers,
    Options,
    Time,
    Words,
    option,
    options_of,
)
from rigidmc.studies.framework.tasks import Tasks
from rigidmc.studies.framework.work import Direct
from tests.studies.examples import command_words, function_of, words_of
from tests.tools.axes import faults
from tests.tools.commands import invoke

INVALID, USAGE = 3, 2


def done(*words, codes=(0,)):
    found = invoke(*words)
    assert found.exit_code in codes, found.output
    return found.output


@pytest.fixture(scope="module")
def studied():
    """A function of a name: the Dataset of the example of this study, computed once."""
    known = {}

    def of(name):
        if name not in known:
            known[name] = function_of(name)()
            known[name].attrs.pop("seconds", None)  # which are measured
        return known[name]

    return of


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def assert_same(stored, dataset):
    with xr.open_dataset(stored) as found:
        assert set(found.variables) == set(dataset.variables)
        for name, variable in dataset.variables.items():
            np.testing.assert_array_equal(found[name].values, variable.values, name)
        for key, value in dataset.attrs.items():
            np.testing.assert_array_equal(*np.atleast_1d(found.attrs[key], value), key)


# those whose numbers come from the members of one scene, and those that run directories hold
OF_MEMBERS = [name for name in STUDIES if isinstance(load_study(name).work, Members)]
STORED = [name for name in STUDIES if not isinstance(load_study(name).work, Direct)]
DONE = 0, 4, 5  # some flagged, or an accuracy that is not reached


@pytest.mark.parametrize("name", STUDIES)
def test_command_and_function_give_the_same(name, studied, here):
    files = "-o", "study.nc", "--plot", "study.png"
    dataset = studied(name)
    codes = ({"done": 0, "flagged": 4, "incomplete": 5}[load_study(name).outcome(dataset)],)
    printed = done(*command_words(name), *files, "--threads", 1, codes=codes)
    assert_same("study.nc", dataset)
    assert all(line in printed for line in load_study(name).table(dataset))
    assert (here / "study.png").stat().st_size > 1000


@pytest.mark.parametrize("name", STORED)
def test_a_run_directory_resumes_to_the_same(name, studied, here):
    """A run that lost a shard computes it again; tests/runs/test_resume.py kills such runs."""
    study = load_study(name)
    short = () if isinstance(study.work, Tasks) else ("--shard-time", 1e-9)
    done(*command_words(name), *short, "-o", "run/", codes=DONE)
    *_, last = shards = sorted((here / "run" / "shards").iterdir())
    assert len(shards) > 1
    last.unlink()
    done("status", "run/", codes=(5,))
    assert "not done" not in done("resume", "run/")
    assert "all sound" in done("verify", "run/")
    done(study.command, "run/", *words_of(name, stored=True), "-o", "again.nc", codes=DONE)
    assert_same("again.nc", studied(name))


@pytest.mark.parametrize("name", OF_MEMBERS)
def test_a_result_gives_what_the_scene_gives(name, studied, here):
    study = load_study(name)
    scene = study.design(study.example.scene, **study.example.options, **study.example.settings)
    rm.simulate(scene, output="members.nc").close()
    old = {one.name for one in options_of(study.options) if not one.is_new}
    asked = {key: value for key, value in study.example.options.items() if key in old}
    with rm.open("members.nc") as result:
        xr.testing.assert_identical(study.of(result, **asked), studied(name))
    assert "no such" not in done(name, "members.nc", *words_of(name, stored=True))
    if new := [one for one in options_of(study.options) if one.is_new]:
        words = f"--{new[0].name}", study.example.options[new[0].name]
        said = done(name, "members.nc", *words_of(name, stored=True), *words, codes=(INVALID,))
        assert "already has its members" in said


@pytest.mark.parametrize("name", STUDIES)
def test_wrong_options_are_refused(name, here):
    study = load_study(name)
    first = options_of(study.options)[0]
    for word in (first.name, "t_end"):
        with pytest.raises(TypeError, match=f"did you mean '{word}'"):
            study(study.example.scene, **study.example.options, **{f"{word}s": 1})
    assert "No such option" in done(*command_words(name), "--familis", 3, codes=(USAGE,))
    for one in options_of(study.options):
        if one.below < math.inf:  # refused here, not after the work
            with pytest.raises(rm.OptionError, match=f"{one.name} = 2.5: expected a "):
                study.options.read({**study.example.options, one.name: 2.5})
    counts = [one for one in options_of(study.options) if one.type is int]
    for one in counts:
        with pytest.raises(rm.OptionError, match=f"{one.name} = 0: expected an integer"):
            study(study.example.scene, **{**study.example.options, one.name: 0})
        if one.in_command:
            said = done(*command_words(name), f"--{one.name}", 0, codes=(INVALID,))
            assert f"--{one.name} = 0: expected an integer" in said
    with pytest.raises(rm.SceneError, match="is a int; expected a Scene"):
        study(3, **study.example.options)


@pytest.mark.parametrize("name", [name for name in STUDIES if load_study(name).variables])
def test_variables_are_as_declared(name, studied):
    """Their names, dimensions and long names; members also bring their starts."""
    declared = {one.name: one for one in load_study(name).variables}
    page = inspect.getdoc(load_study(name))
    for key, variable in studied(name).data_vars.items():
        one = declared.get(re.sub("_(low|high)$", "", key)) or declared.get(key)
        if one is None:
            assert key.startswith("start_")
            continue
        assert variable.dims == tuple(one.dims.split())
        assert variable.attrs["long_name"].startswith(one.text.partition("{")[0])
        assert f"`{key}`" in page


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_names_its_scene_and_version_and_is_drawn(name, studied):
    attrs = studied(name).attrs
    assert attrs["source"].startswith("rigidmc ") and attrs["title"]
    assert rm.Scene.loads(attrs["scene"])
    figure = load_study(name).draw(studied(name))
    assert isinstance(figure, Figure)
    assert faults(figure) == []


@pytest.mark.parametrize("name", STUDIES)
def test_signature_docstring_and_help_page_have_every_option(name):
    study = load_study(name)
    command = get_command(app).commands[study.command]
    helps = {one.name: getattr(one, "help", "") for one in command.params}
    pages = inspect.getdoc(study)
    for one in options_of(study.options):
        assert (one.name in inspect.signature(study).parameters) == one.in_function
        assert (f"\n{one.name} : " in pages) == one.in_function
        if one.in_command:
            assert one.text[1:].replace("[", "\\[") in helps[one.name]
    assert command.help.startswith(STUDIES[name].split("\n")[0])


class Every(Options):
    """An option of each kind."""

    of: Words = option(REQUIRED, "what")
    count: int = option(3, "how many", least=2)
    share: float | None = option(None, "of it", above=0.0, below=1.0)
    way: str = option("up", "where to")
    some: Names | None = option(None, "which")
    steps: Numbers = option((1.0,), "with --count: how long")
    end: Time | None = option(None, "when")
    whole: bool = option(False, "whether all of it")


def test_options_are_read_once_for_function_and_command():
    read = Every.read({"of": "omega", "count": 1e2})
    assert (read.of, read.count, read.share, read.way) == (("omega",), 100, None, "up")
    types = [Words, int, float, str, Names, Numbers, Time, bool]
    assert [one.type for one in options_of(Every)] == types
    read = Every.read({"of": "omega", "some": "a, b", "steps": "1e-4,2", "end": "2 min"})
    assert (read.some, read.steps, read.end, read.whole) == (("a", "b"), (1e-4, 2.0), 120.0, False)
    assert "\n    with `count`: how long" in options_of(Every)[5].documented()
    assert Every.read({"of": ["a", "b"], "share": 0.5}).of == ("a", "b")
    for values, words in (
        ({"count": 1}, "count = 1: expected an integer of at least 2"),
        ({"share": 1.0}, "share = 1.0: expected a number above 0 and below 1"),
        ({"share": "x"}, "share = 'x': expected a number"),
        ({"steps": "1,x"}, "steps = '1,x': expected numbers separated by commas"),
        ({"steps": 3}, "steps = 3: expected numbers separated by commas"),
        ({"end": 0.0}, "end = 0.0: must be greater than 0"),
        ({"some": 3}, "some = 3: expected names separated by commas"),
        ({"whole": 2}, "whole = 2: expected true or false"),
    ):
        with pytest.raises(rm.OptionError) as error:
            Every.read({"of": "omega", **values})
        assert words in str(error.value)
