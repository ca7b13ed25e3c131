"""Readers of text files from outside: TOML, JSON, CSV and meshes.

Only regular files are read, of at most TEXT bytes, TOML nested at most DEPTH deep: a pipe would
block for ever, and a device has no end. Python's own readers raise many kinds of errors; here each
is a FileError, or a SceneError for a text that is no TOML. CSV is read some lines at a time, and
written so that no spreadsheet takes a cell for a formula (`harmless`).
"""

import contextlib
import io
import json
import os
import re
import tomllib
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import FileError, SceneError, path_of
from rigidmc.files.opening import open_plain, open_regular
from rigidmc.files.outputs import Path

TEXT = 4 * 2**20  # bytes of a text: TOML is read at 1 to 5 MB/s
DEPTH = 100  # tables and lists within each other; scenes have 4
# strings and comments of TOML, in which brackets and dots have no meaning. One that is not closed
# ends with its line or the text: if it were no match, each quote in it would be tried again
_STRINGS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"{3,5}|\\?\Z)|\'\'\'.*?(?:\'{3,5}|\Z)'
    r'|"(?:\\.|[^"\\\n])*+"?|\'[^\'\n]*+\'?|#[^\n]*+',
    re.DOTALL,
)


def bytes_of(path: Path, most: int = TEXT, last: bool = False, links: bool = True) -> bytes:
    """The bytes of a regular file; if it has more than `most`, the last ones or FileError.

    links : whether a link is followed: of a path that the user names, but not within a folder
    """
    with open(path, "rb", opener=open_regular if links else open_plain) as file:
        if last:
            file.seek(max(0, os.fstat(file.fileno()).st_size - most))
            return file.read(most)
        data = file.read(most + 1)
    if len(data) > most:
        rule = f"has more than the {most / 2**20:g} MB that a text may have"
        raise FileError(rule, at="file", file=os.fspath(path))
    return data


def text_of(path: Path, links: bool = True) -> str:
    """The text of a regular file; FileError if it is not UTF-8. links : as of `bytes_of`"""
    try:
        return bytes_of(path, links=links).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise FileError("is no text in UTF-8", at="file", file=os.fspath(path)) from None


def toml(text: object) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises SceneError for text that is not TOML, for more than DEPTH levels, and for whole numbers
    of more than 64 bits.
    """
    if not isinstance(text, str) or len(text) > TEXT:
        rule = f"expected text of at most {TEXT / 2**20:g} MB"
        raise SceneError(rule, at="TOML")
    depth, plain = 0, _STRINGS.sub("", text)
    for bracket in re.finditer(r"[\[\]{}]", plain):
        depth = depth + 1 if bracket[0] in "[{" else max(0, depth - 1)
        if depth > DEPTH:
            break
    if depth > DEPTH or any(part.count(".") >= DEPTH for part in re.split(r"[\n,=\[\]{}]", plain)):
        raise SceneError(f"is nested more than {DEPTH} deep", at="TOML")
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError comes also from a number of more than 4300 digits
        raise SceneError(f"not valid TOML: {error}", at="TOML") from None
    _refuse_long(data, "")
    return data


def _refuse_long(data: object, at: str) -> None:
    """Raise SceneError for a whole number of more than 64 bits, which TOML does not have."""
    if isinstance(data, dict):
        for name, value in data.items():
            _refuse_long(value, path_of(at, name))
    elif isinstance(data, list):
        for value in data:
            _refuse_long(value, at)
    elif isinstance(data, int) and not -(2**63) <= data < 2**63:
        value = float("inf") if data > 0 else float("-inf")
        raise SceneError("whole numbers have 64 bits", at=at, value=value)


def json_of(text: str) -> Any:
    """The value of a JSON text; ValueError if it is not JSON or is nested too deep."""
    with contextlib.suppress(RecursionError):
        return json.loads(text)
    raise ValueError("nested too deep")


LINE = 2**20  # letters of a line: the holes of a sparse file make one line of gigabytes
_LINES, _LETTERS = 20_000, 2**22  # that are turned into numbers at once


def read_number_table(path: str | os.PathLike[str]) -> tuple[list[str], NDArray[np.float64]]:
    """(names in the first line, numbers (rows, columns)) of a CSV file; (0, 0) without rows.

    Memory and time grow with the size of the file. Raises ValueError, of which UnicodeDecodeError
    is one, for lines that differ in length, and FileError for what is no text file.
    """
    with open(path, encoding="utf-8", opener=open_regular) as file:
        names = [
            word.strip().strip('"') for word in _line(file).strip().lstrip("\ufeff").split(",")
        ]
        pieces = list[NDArray[np.float64]]()
        while lines := _some(file):
            text = [line for line in lines if line.strip()]
            rows = np.genfromtxt(text, delimiter=",", ndmin=2) if text else np.empty((0, 0))
            if rows.size:
                pieces.append(rows)
    if len({rows.shape[1] for rows in pieces}) > 1:
        raise ValueError("its rows have different numbers of columns")
    return names, np.concatenate(pieces) if pieces else np.empty((0, 0))


def _line(file: IO[str]) -> str:
    line = file.readline(LINE + 1)
    if len(line) > LINE:
        rule = f"has a line of more than {LINE:,} letters"
        raise FileError(rule, at="file", file=file.name)
    return line


def _some(file: IO[str]) -> list[str]:
    """The next lines of a file."""
    lines, letters = list[str](), 0
    while len(lines) < _LINES and letters < _LETTERS and (line := _line(file)):
        lines.append(line)
        letters += len(line)
    return lines


def harmless(cell: Any) -> Any:
    """A cell of a table that is written: text that a spreadsheet would compute begins with an
    apostrophe, which it hides; all else as it is."""
    return f"'{cell}" if isinstance(cell, str) and cell.lstrip()[:1] in _FORMULA else cell


_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")  # and their wide forms


MESHES = (".stl", ".obj", ".ply", ".off")


def load_mesh(path: str) -> Any:
    """The trimesh.Trimesh of a file; what trimesh raises, and ValueError for another format."""
    import trimesh

    ending = os.path.splitext(path)[1].lower()
    if ending not in MESHES:
        raise ValueError(f"its name ends in none of {', '.join(MESHES)}")
    with open(path, "rb", opener=open_regular) as file:
        # by the bytes, which have no place: an OBJ file names others, of materials, and trimesh
        # looks for them beside an open file; a pipe of such a name kept it waiting for 20 s
        data = io.BytesIO(file.read())
    return trimesh.load(data, file_type=ending[1:], force="mesh", process=False)
