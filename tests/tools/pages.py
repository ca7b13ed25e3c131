"""The scenes of all pages, docstrings and shipped files, without running them."""

import ast
import contextlib
import doctest
import io
import os
import re
import shlex
import textwrap
import warnings
from itertools import pairwise
from pathlib import Path

import rigidmc as rm
from rigidmc.runs import prepare as preparing
from rigidmc.scene.library import shipped_names

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
CODE = re.compile(r"(?m)^```(?:\{code-cell\}.*|python)\n(?:^:.*\n)*([\s\S]*?)^```")
TOML = re.compile(r"(?m)^```toml\n([\s\S]*?)^```")
COMMAND = re.compile(r"(?m)^(?:\$ )?rigidmc (.*)$")


class Seen(Exception):
    """Ends the preparation of a run."""


def statements(text):
    """Yield the statements of Python code, one at a time."""
    try:
        tree = ast.parse(textwrap.dedent(text))
    except SyntaxError:
        return
    for one in tree.body:
        yield ast.Module([one], type_ignores=[])


def run_statements(texts, names):
    """Run each statement of some texts by itself; those that fail, as all that use a result, do
    nothing."""
    for text in texts:
        for one in statements(text):
            with contextlib.suppress(BaseException), contextlib.redirect_stdout(io.StringIO()):
                exec(compile(one, "page", "exec"), names)


def docstrings():
    """Yield (name, code) of the examples of each function and class of the package."""
    parser = doctest.DocTestParser()
    for path in sorted((ROOT / "rigidmc").glob("**/*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)):
                examples = parser.get_examples(ast.get_docstring(node) or "")
                if examples:
                    name = getattr(node, "name", "module")
                    yield f"{path.stem}.{name}", [one.source for one in examples]


def scenes(monkeypatch, tmp_path):
    """Return [(place, scene)] of every scene that shipped files, pages and docstrings run."""
    found, place = [], [""]

    def seen(scene, recorded):
        found.append((place[0], scene))
        raise Seen

    monkeypatch.setattr(preparing, "check_scene", seen)
    monkeypatch.chdir(tmp_path)

    def prepare(scene):
        with contextlib.suppress(Seen, rm.RigidmcError):
            preparing.prepare_scene(scene)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in shipped_names():
            place[0] = name
            prepare(rm.Scene.load(name))
        for path in PAGES:
            place[0], text = str(path.relative_to(ROOT)), path.read_text("utf-8")
            names = {"__name__": "page", "rm": rm}
            for toml in TOML.findall(text):
                with contextlib.suppress(rm.RigidmcError, OSError):
                    prepare(rm.Scene.loads(toml))
            for line in COMMAND.findall(text):
                with contextlib.suppress(ValueError, OSError):
                    words = shlex.split(line)
                    pairs = [x.split("=", 1) for k, x in pairwise(words) if k == "--set"]
                    prepare(rm.Scene.load(words[1], {key: _number(x) for key, x in pairs}))
            run_statements(CODE.findall(text), names)
        for name, examples in docstrings():
            place[0] = name
            run_statements(examples, {"rm": rm, **_numpy()})
    os.chdir(ROOT)
    return found


def _number(text):
    """Return the number of a setting, or the text."""
    try:
        return float(text)
    except ValueError:
        return text.strip("'\"")


def _numpy():
    import numpy as np
    import xarray as xr

    return {"np": np, "xr": xr}
