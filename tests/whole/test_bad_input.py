"""Whatever a scene file contains: one message, an exit code, no traceback; nothing is executed.

300 scenes made from those of the package; a hundred times as many with `HYPOTHESIS_PROFILE=nightly
pytest tests/whole/test_bad_input.py`. Torn files of all kinds are in test_hostile.py.
"""

import ast
import pathlib
import random
import stat

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import rigidmc
from rigidmc.engine.compiler.disk_cache import cache_folder
from rigidmc.scene.library import read_source, shipped_names
from tests.tools.commands import invoke
from tests.tools.hostile import hostile_toml

PACKAGE = pathlib.Path(rigidmc.__file__).parent
NEVER = {
    "eval", "exec", "compile", "pickle", "cPickle", "marshal", "shelve", "dill", "cloudpickle",
    "joblib", "yaml", "exec_module", "__import__",
}  # fmt: skip


def told(*words):
    """The exit code of a command; fails on a traceback or more than one message."""
    made = invoke(*words)
    assert made.exception is None or isinstance(made.exception, SystemExit), (words, made.exception)
    messages = made.stderr.count("rigidmc: ") - made.stderr.count("rigidmc: note")
    assert made.exit_code in (0, 5) or messages == 1, made.stderr
    return made.exit_code


@settings(
    max_examples=3 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.generate],
)
@given(st.integers(0, 2**64))
def test_a_bad_scene_is_one_message(tmp_path_factory, seed):
    """A shipped scene with one to three of its values replaced, deleted or moved."""
    file, some = tmp_path_factory.getbasetemp() / "bad.toml", random.Random(seed)
    file.write_bytes(hostile_toml(some, read_source(some.choice(shipped_names()))))
    assert told("check", file) in (0, 3)


def test_nothing_is_executed_but_what_was_allowed():
    """No pickle, eval, exec or yaml in the syntax trees of the package.

    One place runs a user's file, with --allow-code; one imports this package in a helper
    process, one loads xarray, Numba and matplotlib.
    """
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = (
                {getattr(node, "id", None), getattr(node, "attr", None)}
                if isinstance(node, (ast.Name, ast.Attribute))
                else set()
            )
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names = {word for alias in node.names for word in alias.name.split(".")} | set(
                    (getattr(node, "module", None) or "").split(".")
                )
            # of regular expressions and kernels
            names -= {"compile"} if isinstance(node, ast.Attribute) else set()
            if names & NEVER:
                found.add((path.relative_to(PACKAGE).as_posix(), *(names & NEVER)))
    assert sorted(found) == [
        ("files/helper_main.py", "exec_module"),
        ("files/user_code.py", "exec_module"),
        ("processes/import_hook.py", "exec_module"),
    ]


def test_kernels_are_cached_where_only_the_user_may_write():
    mode = stat.S_IMODE(pathlib.Path(cache_folder()).stat().st_mode)
    assert mode & 0o022 == 0
