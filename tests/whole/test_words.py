"""Phrases that a native reader stumbles over stay out: `words.csv` lists them, with better ones.

What is read is every page, scene file, docstring, comment and message. A phrase may be quoted in
backquotes, as an option or a name is.
"""

import csv
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("words.csv")
ROWS = list(csv.DictReader(LIST.read_text("utf-8").splitlines()))
PLACES = "README.md", "CHANGELOG.md", ".github/SECURITY.md", "docs/**/*.md", "rigidmc/**/*.py"
PLACES += "rigidmc/**/*.toml", "bench/tools/readme.py"
MADE = "_build", "api"  # folders that the build of the documentation makes


def files():
    for place in PLACES:
        for path in sorted(ROOT.glob(place)):
            if not set(MADE) & set(path.relative_to(ROOT).parts):
                yield path


def found(text, pattern):
    """The lines of a text that have a phrase, also one that goes on in the next line."""
    text = re.sub(r"`[^`\n]*`", lambda quoted: "`" * len(quoted[0]), text)
    text = re.sub(r"\n[ \t]*(#:? )?", lambda space: "\n" + " " * (len(space[0]) - 1), text)
    spaced = pattern.replace(" ", r"\s+")
    return [text.count("\n", 0, one.start()) + 1 for one in re.finditer(spaced, text)]


@pytest.mark.parametrize("row", ROWS, ids=[row["pattern"] for row in ROWS])
def test_no_file_has_a_forbidden_phrase(row):
    lines = [
        f"{path.relative_to(ROOT)}:{line}: {row['pattern']} -> {row['better']}"
        for path in files()
        for line in found(path.read_text("utf-8"), row["pattern"])
    ]
    assert not lines, "\n".join(lines)


def test_a_phrase_is_found_over_two_lines_and_not_in_backquotes():
    assert found("a\nthose\n    # of b", r"\bthose of\b") == [2]
    assert found("`those of`", r"\bthose of\b") == []
