"""What README names exists: benches, commands of rigidmc, files."""

import importlib
import re
from pathlib import Path

import pytest
from typer.main import get_command

from bench.__main__ import BENCHES
from rigidmc.cli import app

ROOT = Path(__file__).parents[2]
TEXT = "\n".join(
    path.read_text("utf-8") for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
)


def test_every_bench_that_is_named_can_be_run():
    named = {
        name
        for words in re.findall(r"python -m bench((?: [a-z]+)+)", TEXT)
        for name in words.split()
    }
    assert named and named <= set(BENCHES), named - set(BENCHES)


def test_every_bench_has_a_name():
    modules = {
        f"bench.{path.stem}"
        for path in (ROOT / "bench").glob("*.py")
        if "\ndef report(" in path.read_text("utf-8")
    }
    assert modules == set(BENCHES.values())


@pytest.mark.parametrize("module", sorted(BENCHES.values()))
def test_a_bench_has_rows_and_a_report(module):
    found = importlib.import_module(module)
    assert callable(found.run) and callable(found.report)


def test_every_command_that_is_named_exists():
    code = "\n".join(re.findall(r"```.*?```|`[^`\n]+`", TEXT, flags=re.S))
    named = set(re.findall(r"(?:^|`|/)rigidmc ([a-z]+)", code, flags=re.M))
    assert {"run", "accuracy", "stress"} <= named <= set(get_command(app).commands), named


def test_every_picture_is_there():
    for path in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT):
        assert (ROOT / path).is_file(), path
