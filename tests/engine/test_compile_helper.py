"""Kernels compiled by a second process: the same code, through the cache.

If that process fails, this one compiles.
"""

import json
import os
import sys
import time

import pytest

import rigidmc as rm
from rigidmc.engine import compile_helper as module
from rigidmc.engine import compile_time
from rigidmc.engine.compile_helper import (
    _from_json,
    _lookup,
    _to_json,
    compile_in_helper,
    helper_can,
)
from rigidmc.engine.compile_time import seconds, split_work
from rigidmc.engine.compiler.kernels import KernelKey, config, type_key
from tests.tools.commands import python
from tests.tools.plans import program_of

EVERY = ["gather", "scatter", "initialise", "march", "assess", "record", "advance"]


def asked(scene="heavy_top", **settings):
    scene = rm.Scene.load(scene).with_run(**settings)
    return {name: one for name, one in program_of(scene).kernel_keys.items() if one}


def test_a_request_reaches_the_other_process_unchanged():
    for settings in (
        {"integrator": "srkn11"},
        {"integrator": "rk8", "dtype": "float32"},
        {"save": ("energy_mean", "megno", "work")},
    ):
        for one in asked(**settings).values():
            parts = _from_json(json.loads(json.dumps(_to_json(one[1]))))
            assert parts == one[1] and type_key(parts) == type_key(one[1])


def test_nothing_but_the_package_is_imported():
    with pytest.raises(ImportError, match="not of this package"):
        _lookup("os:system")


SCRIPT = """
import rigidmc as rm
from rigidmc.engine.compile_helper import compile_in_helper
from rigidmc.engine.compiler.kernels import is_compiled
from tests.tools.plans import program_of
scene = rm.Scene.load("nasa_brick").with_run(integrator="rk4", members=4, t_end=1.0)
asked = program_of(scene).kernel_keys
some = [asked["gather"], asked["advance"]]
print([is_compiled(one) for one in some])
with compile_in_helper(some):
    pass
print([is_compiled(one) for one in (*some, asked["march"])])
"""


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_another_process_fills_the_cache(tmp_path):
    found, _ = python(SCRIPT, cache=tmp_path / "cache")
    assert found.splitlines() == ["[False, False]", "[True, True, False]"]


@pytest.mark.parametrize("script", ["#!/bin/sh\nexit 1\n", "#!/bin/sh\nexec sleep 30\n", None])
@pytest.mark.skipif(os.name != "posix", reason="the false Pythons are shell scripts")
def test_a_process_that_fails_or_hangs_is_abandoned(script, tmp_path, monkeypatch):
    path = tmp_path / "python"
    if script:
        path.write_text(script)
        path.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(path))
    monkeypatch.setattr(module, "PATIENCE", 0.2)
    began = time.perf_counter()
    with compile_in_helper([asked()["advance"]]):
        pass
    assert time.perf_counter() - began < 10.0


def test_user_effects_are_compiled_in_this_process(monkeypatch):
    class Push(rm.Gravity):
        pass

    monkeypatch.setattr(module, "threads_available", lambda: 2)
    own = KernelKey(asked()["march"].function, (Push(1.0),), "float64", 8, "psw")
    assert "march" not in helper_can({"march": own})
    assert config.DISABLE_JIT or "march" in helper_can(asked())
    monkeypatch.setattr(module, "threads_available", lambda: 1)
    assert helper_can(asked()) == []


def test_work_is_divided_if_that_saves_time(tmp_path, monkeypatch):
    monkeypatch.setenv("RIGIDMC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compile_time, "compiled", [])
    theirs = split_work("rk4", EVERY, (), EVERY)
    assert "advance" in theirs and "march" not in theirs
    assert seconds("rk4", EVERY, (), theirs) < 0.75 * seconds("rk4", EVERY)
    assert split_work("rk4", EVERY, (), []) == [] == split_work("rk4", ["record"], (), EVERY)
    compile_time.compiled.append("rk4")
    assert split_work("rk4", ["march", "assess"], (), EVERY) == []
