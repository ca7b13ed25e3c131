"""Docstrings of the package as reStructuredText.

A docstring is a summary, paragraphs, indented equations, and lines `name : meaning`. Equations
become literal blocks and lines a list of fields; the rest is text without markup.
"""

import re

_FIELD = re.compile(r"(?P<names>[A-Za-z_]\w*(?:, \w+)*) : (?P<meaning>.*)")
_MARKUP = re.compile(r"([|*`_\\])")


def blocks(lines):
    """Paragraphs: lists of lines between blank ones."""
    block = []
    for line in [*lines, ""]:
        if line.strip():
            block.append(line)
        elif block:
            yield block
            block = []


def escaped(text):
    """Text that has no markup but what is between backticks."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return _MARKUP.sub(r"\\\1", text)
    return "".join(
        f"``{part}``" if i % 2 else _MARKUP.sub(r"\\\1", part) for i, part in enumerate(parts)
    )


def fields(block):
    """(names, meaning) of lines `name : meaning`, also two on a line; [] if it is a paragraph."""
    found = []
    for line in block:
        for part in re.split(r"(?<=\S);  (?=\w+ : )", line):
            if match := _FIELD.fullmatch(part):
                found.append([match["names"], match["meaning"]])
            elif found and (line.startswith("    ") or not found[-1][1].endswith(".")):
                found[-1][1] += " " + part.strip()
            else:
                return []
    return found


def written(block):
    """A block as reStructuredText."""
    if block[0].startswith("    "):
        yield from ("::", "", *(f"    {line}" for line in block))
    elif found := fields(block):
        for names, meaning in found:
            yield from (f"``{names}``", f"    {escaped(meaning)}")
    else:
        yield from map(escaped, block)
    yield ""


def process(app, what, name, thing, options, lines):
    lines[:] = [line for block in blocks(lines) for line in written(block)]


def setup(app):
    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
