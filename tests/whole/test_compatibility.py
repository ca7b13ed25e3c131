"""The page on compatibility, the workflows and CITATION.cff agree with pyproject.toml and code."""

import re
import tomllib
from pathlib import Path

from rigidmc.results.variables import NEWER
from rigidmc.runs.directory.facts import FORMAT
from rigidmc.version import VERSION

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "compatibility.md").read_text("utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_supported_versions_begin_with_those_of_pyproject():
    for name, given in (
        ("Python", PROJECT["requires-python"]),
        ("NumPy", next(one for one in PROJECT["dependencies"] if one.startswith("numpy"))),
    ):
        lowest = given.rpartition(">=")[2]
        assert f"{name} {lowest}" in PAGE
        rows = re.findall(rf"^\| {name} `([\d.]+)` \| \w+ 20\d\d \|$", PAGE, re.M)
        assert rows[0] == lowest and len(rows) >= 4


def test_the_workflow_tests_the_supported_versions_of_python():
    text = (ROOT / ".github" / "workflows" / "tests.yml").read_text("utf-8")
    (listed,) = re.findall(r"python: \[(.*)\]", text)
    assert re.findall(r"[\d.]+", listed) == re.findall(r"^\| Python `([\d.]+)`", PAGE, re.M)


def test_files_of_other_releases():
    assert FORMAT == 1  # the page says that directories of all releases so far open
    assert all(f"`{name}`" in PAGE for name in NEWER)


def test_the_citation_has_the_version_and_the_authors_of_the_package():
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {VERSION}\n" in text
    assert f"\nlicense: {PROJECT['license']}\n" in text
    for author in PROJECT["authors"]:
        assert f'  - name: "{author["name"]}"\n' in text
