"""Readers of untrusted text files: TOML, JSON and meshes.

They read only regular files, of at most TEXT bytes, and TOML nested at most DEPTH deep: a pipe
would block for ever, and a device has no end. Python's own readers raise many kinds of errors; here
each becomes a FileError, or a SceneError for text that is not TOML. CSV files are read by
`rigidmc.files.tables`, and written so that no spreadsheet interprets a cell as a formula
(`harmless`).
"""

import contextlib
import hashlib
import io
import json
import os
import re
import tomllib
from typing import Any

from rigidmc.errors import FileError, SceneError, path_of
from rigidmc.files.opening import open_plain, open_regular
from rigidmc.files.outputs import Path

HASHED = 4 * 2**30  # largest mesh in bytes: 4 s of hashing
TEXT = 4 * 2**20  # largest text in bytes: TOML is read at 1 to 5 MB/s
DEPTH = 100  # tables and lists within each other; scenes have 4
# strings and comments of TOML, in which brackets and dots have no meaning. An unclosed string ends
# with its line or the text: if it did not match, the search would restart at each of its quotes
_STRINGS = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"{3,5}|\\?\Z)|\'\'\'.*?(?:\'{3,5}|\Z)'
    r'|"(?:\\.|[^"\\\n])*+"?|\'[^\'\n]*+\'?|#[^\n]*+',
    re.DOTALL,
)


def bytes_of(path: Path, most: int = TEXT, last: bool = False, links: bool = True) -> bytes:
    """Return the bytes of a regular file; beyond `most`, the last `most` bytes or FileError.

    last : whether to return the last bytes of a longer file
    links : whether to follow a link: yes for a path that the user names, no within a folder
    """
    with open(path, "rb", opener=open_regular if links else open_plain) as file:
        if last:
            file.seek(max(0, os.fstat(file.fileno()).st_size - most))
            return file.read(most)
        data = file.read(most + 1)
    if len(data) > most:
        rule = f"is larger than {most / 2**20:g} MB, the limit for text"
        raise FileError(rule, at="file", file=os.fspath(path))
    return data


def sha256_of(path: Path) -> str:
    """Return the sha256 of a regular file of at most HASHED bytes, in hexadecimal digits."""
    with open(path, "rb", opener=open_regular) as file:
        if os.fstat(file.fileno()).st_size > HASHED:
            rule = f"is larger than {HASHED / 2**30:g} GB, the limit for meshes"
            raise FileError(rule, at="file", file=os.fspath(path))
        return hashlib.file_digest(file, "sha256").hexdigest()


def text_of(path: Path, most: int = TEXT, links: bool = True) -> str:
    """Return the text of a regular file; FileError if not UTF-8. most, links : as in `bytes_of`"""
    try:
        return bytes_of(path, most, links=links).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise FileError("is not UTF-8 text", at="file", file=os.fspath(path)) from None


def toml(text: object) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises SceneError for text that is not TOML, for more than DEPTH levels, and for integers of
    more than 64 bits.
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
        # a number of more than 4300 digits also raises ValueError
        raise SceneError(f"not valid TOML: {error}", at="TOML") from None
    _refuse_long(data, "")
    return data


def _refuse_long(data: object, at: str) -> None:
    """Raise SceneError for an integer of more than 64 bits, which TOML does not allow."""
    if isinstance(data, dict):
        for name, value in data.items():
            _refuse_long(value, path_of(at, name))
    elif isinstance(data, list):
        for value in data:
            _refuse_long(value, at)
    elif isinstance(data, int) and not -(2**63) <= data < 2**63:
        value = float("inf") if data > 0 else float("-inf")
        raise SceneError("integers must fit in 64 bits", at=at, value=value)


def json_of(text: str) -> Any:
    """Return the value of a JSON text; ValueError if it is not JSON or is nested too deep."""
    with contextlib.suppress(RecursionError):
        return json.loads(text)
    raise ValueError("nested too deep")


def harmless(cell: Any) -> Any:
    """Return a table cell made safe: text that a spreadsheet would evaluate gets a leading
    apostrophe, which the spreadsheet hides; other cells are unchanged."""
    return f"'{cell}" if isinstance(cell, str) and cell.lstrip()[:1] in _FORMULA else cell


_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")  # and their wide forms


MESHES = (".stl", ".obj", ".ply", ".off")


def load_mesh(path: str) -> Any:
    """Return the trimesh.Trimesh of a file; raises trimesh's errors, and ValueError for another
    format."""
    import trimesh

    ending = os.path.splitext(path)[1].lower()
    if ending not in MESHES:
        raise ValueError(f"its name must end in one of {', '.join(MESHES)}")
    with open(path, "rb", opener=open_regular) as file:
        # pass bytes, which have no folder: an OBJ file names material files, which trimesh opens
        # in the folder of an open file; a pipe with such a name kept it waiting for 20 s
        data = io.BytesIO(file.read())
    return trimesh.load(data, file_type=ending[1:], force="mesh", process=False)
