"""What README and docs/ name exists: benches, commands, files, links; Python in them runs.

The build of the documentation runs its tutorials and draws its gallery.
"""

import importlib
import re
import textwrap
from pathlib import Path

import pytest
from typer.main import get_command

import rigidmc
from bench.__main__ import BENCHES
from rigidmc.cli import app
from rigidmc.studies import STUDIES

ROOT = Path(__file__).parents[2]
PAGES = [p for p in sorted((ROOT / "docs").rglob("*.md")) if not {"_build", "paper"} & {*p.parts}]
TEXT = "\n".join(path.read_text("utf-8") for path in (ROOT / "README.md", *PAGES))


def test_every_bench_that_is_named_can_be_run():
    named = {
        name
        for words in re.findall(r"python -m bench((?: [a-z_]+)+)", TEXT)
        for name in words.split()
    }
    assert named and named <= set(BENCHES), named - set(BENCHES)


def test_every_bench_has_a_name():
    modules = {
        path.stem
        for path in (ROOT / "bench").glob("*.py")
        if "\ndef report(" in path.read_text("utf-8")
    }
    assert modules == set(BENCHES)


@pytest.mark.parametrize("name", BENCHES)
def test_a_bench_has_rows_and_a_report(name):
    found = importlib.import_module(f"bench.{name}")
    assert callable(found.run) and callable(found.report)


def test_every_command_that_is_named_exists():
    code = "\n".join(re.findall(r"```.*?```|`[^`\n]+`", TEXT, flags=re.S))
    named = set(re.findall(r"(?:^|`|/)rigidmc ([a-z]+)", code, flags=re.M))
    assert {"run", "accuracy", "stress"} <= named <= set(get_command(app).commands), named


def test_every_picture_is_there():
    for path in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT):
        assert (ROOT / path).is_file(), path


def test_every_page_is_there():
    for path in re.findall(r"\]\((docs/[^)]+)\)", TEXT):
        assert (ROOT / path).is_file(), path


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 90


def test_the_python_of_readme_runs():
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.S)
    assert lines.count("members=100_000") == 1
    *before, last = lines.replace("members=100_000", "members=200").splitlines()
    names = {}
    exec("\n".join(before), names)
    assert 0.0 < float(eval(last, names)) < 1e-9  # measured 1.9e-10


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_python_on_pages_is_python(path):
    for code in re.findall(r"```python\n(.*?)```", path.read_text("utf-8"), re.S):
        compile(textwrap.dedent(code), str(path), "exec")


def test_every_public_name_is_in_the_reference():
    text = (ROOT / "docs" / "reference" / "python.md").read_text("utf-8")
    listed = [n for names in re.findall(r"```\{names\} (.*)", text) for n in names.split()]
    assert listed.count("studies") == 1  # those of the registry
    # names with a dot are not of `rigidmc` itself, and have a page all the same
    listed = [n for n in listed if n != "studies" and "." not in n] + list(STUDIES)
    assert sorted(listed) == sorted(rigidmc.__all__)
