"""The settings of a run are defined once: files, keywords and options follow from `Run`."""

import inspect
import re
from types import NoneType
from typing import get_args

import numpy as np
import pytest
from typer.main import get_command

import rigidmc as rm
from rigidmc.cli.app import app
from rigidmc.scene.settings import Run, types

COMMANDS = get_command(app).commands


def options_of(command):
    return {option.name for option in COMMANDS[command].params}


def test_every_setting_says_what_it_is():
    for name, field in Run.model_fields.items():
        text = field.description
        assert text and text == text.strip() and not text.endswith("."), name
        assert not text[0].isupper(), name


@pytest.mark.parametrize("name", [name for name in Run.model_fields if name != "varied"])
def test_a_setting_is_a_key_a_keyword_and_an_option(name):
    signature = inspect.signature(rm.simulate)
    assert name in signature.parameters
    assert signature.parameters[name].default is None
    assert re.search(rf"^ *{name} : ", rm.simulate.__doc__, re.MULTILINE)
    assert name in options_of("run") and name in options_of("show")
    (option,) = (p for p in COMMANDS["run"].params if p.name == name)
    assert f"--{name.replace('_', '-')}" in option.opts
    described = Run.model_fields[name].description
    assert option.help.replace("\\[", "[").lower().startswith(described.lower())


def test_settings_reach_the_run_from_all_three_sides(tmp_path):
    """Each value below differs from the default, so that a setting that is dropped shows."""
    values = {
        "dt": 0.02,
        "seed": 7,
        "points": "sobol",
        "checks": False,
        "thin": 3,
        "compress": True,
    }
    assert all(Run.model_fields[name].default != value for name, value in values.items())
    body = "[body]\nmoments = [1.0, 2.0, 3.0]\n[start]\nomega = [{ normal = [0, 1] }, 1.0, 0.0]\n"
    rows = (
        f"{k} = {str(v).lower() if isinstance(v, bool) else repr(v)}" for k, v in values.items()
    )
    from_file = rm.Scene.loads(body + "[run]\n" + "\n".join(rows)).run
    from_python = rm.Scene.loads(body).with_run(**values).run
    assert from_file == from_python
    assert from_file != rm.Scene.loads(body).run
    words = [
        f"--{k}" if v is True else f"--no-{k}" if v is False else f"--{k}={v}"
        for k, v in values.items()
    ]
    context = COMMANDS["show"].make_context("show", ["dzhanibekov", *words])
    taken = {k: v for k, v in context.params.items() if k in values}
    assert taken == values


def test_an_unknown_keyword_is_refused_with_the_nearest():
    scene = rm.Scene.load("dzhanibekov")
    with pytest.raises(
        TypeError, match=r"simulate\(\) got .* 'tolerence'; did you mean 'tolerance'"
    ):
        rm.simulate(scene, tolerence=1e-6)


def test_types_are_without_none():
    assert set(types()) == set(Run.model_fields)
    assert not any(NoneType in get_args(kind) for kind in types().values())


def test_rows_are_the_members_unless_a_number_is_given():
    """A number of members was once ignored if a scene had one row per member."""
    omega = (np.linspace(0.1, 0.5, 5), 1.0, 0.01)
    scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 3.0)), start=rm.Start(omega=omega))
    quick = {"t_end": 0.1, "integrator": "exact"}
    assert rm.simulate(scene, **quick).sizes["member"] == 5
    assert rm.simulate(scene, members=2, **quick).sizes["member"] == 2
    assert rm.simulate(scene.with_run(members=3), **quick).sizes["member"] == 3
    assert rm.simulate(scene.with_run(seed=1), **quick).sizes["member"] == 5
    assert rm.simulate(scene.with_run(first=2), **quick).member.values.tolist() == [2, 3, 4]
    assert rm.simulate(scene, first=2, **quick).member.values.tolist() == [2, 3, 4]
    with pytest.raises(rm.SceneError, match="rows for only 5 members"):
        rm.simulate(scene.with_run(members=9), **quick)
