"""Docstrings on the command line: numpydoc with one line for each parameter and no examples."""

import re
import textwrap
from collections.abc import Iterator
from inspect import cleandoc

_TITLE = re.compile(r"^(\w[\w ]*)\n-+\n", re.MULTILINE)
_PARAMETER = re.compile(r"^(?P<names>\w[\w, ]*) : (?P<kind>.*)\n(?P<meaning>(?:[ ]+.*\n?)+)", re.M)
_UNIT = re.compile(r"\[[^\]]+\]$")


def explained(docstring: str) -> str:
    """Summary, equation, text and source of a docstring, and lines `name : meaning [unit]`.

    Other sections tell what Python alone does: examples, errors raised, what is returned.
    """
    text, *sections = _TITLE.split(cleandoc(docstring))
    parts = [re.sub("::$", ":", text.strip(), flags=re.MULTILINE)]
    for title, section in zip(sections[::2], sections[1::2], strict=True):
        if title == "Parameters":
            parts.append("\n".join(_parameters(section)))
        elif title == "Notes":
            parts.append(section.strip())
    return "\n\n".join(parts)


def _parameters(section: str) -> Iterator[str]:
    for found in _PARAMETER.finditer(section):
        unit = _UNIT.search(found["kind"])
        words = [found["meaning"], *([unit[0]] if unit else [])]
        line = f"{found['names']} : {' '.join(' '.join(words).split())}"
        yield textwrap.fill(line, width=100, subsequent_indent="    ", break_on_hyphens=False)
