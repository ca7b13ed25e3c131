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
import logging
import os
import re
import tomllib
from typing import Any

from rigidmc.errors import FileError, SceneError, path_of
from rigidmc.files.opening import data_bytes, open_plain, open_regular
from rigidmc.files.outputs import Path

MESH = 2**28  # largest mesh in bytes; of 20 to 50 for a triangle, which needs 500 of memory
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
    """Return the sha256 of a mesh, in hexadecimal digits; FileError as `refuse_large_mesh`."""
    refuse_large_mesh(path)
    with open(path, "rb", opener=open_regular) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def refuse_large_mesh(path: Path) -> None:
    """Raise FileError for a mesh file of more than MESH bytes, and for a sparse one, whose size may
    be a thousand times what it occupies on the disk."""
    with open(path, "rb", opener=open_regular) as file:
        size, data = os.fstat(file.fileno()).st_size, data_bytes(file.fileno())
    if size > MESH:
        rule = f"is larger than {MESH / 2**20:g} MB, the limit for meshes: simplify it"
        raise FileError(rule, at="file", file=os.fspath(path))
    if 2 * data < size:
        rule = f"is sparse: only {data / 1e6:.2g} of its {size / 1e6:.2g} MB are stored"
        raise FileError(rule, at="file", file=os.fspath(path))


def text_of(path: Path, most: int = TEXT, links: bool = True) -> str:
    """Return the text of a regular file; FileError if not UTF-8. most, links : as in `bytes_of`"""
    try:
        text = bytes_of(path, most, links=links).decode("utf-8")
    except UnicodeDecodeError:
        raise FileError("is not UTF-8 text", at="file", file=os.fspath(path)) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


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
        raise SceneError(f"not valid TOML: {error}{_cure(text, str(error))}", at="TOML") from None
    _refuse_long(data, "")
    return data


def _cure(text: str, error: str) -> str:
    """Return what to write in place of a bare number with a unit, or with a decimal comma, in the
    line of an error of TOML; "" for other errors."""
    if not (at := re.search(r"at line (\d+)", error)):
        return ""
    plain = _STRINGS.sub(lambda string: "\n" * string[0].count("\n"), text)
    line = "".join(plain.splitlines()[int(at[1]) - 1 : int(at[1])])
    if found := re.search(r"[=,\[]\s*([-+]?\d[\d.]*\s*(?:[a-zA-Z]+|°)[^,\]}#]{0,40})", line):
        return f'; a number with its unit is a text, "{found[1].strip()}"'
    if found := re.fullmatch(r"[^=]*=\s*([-+]?\d+),(\d+)\s*(?:#.*)?", line):
        return f"; decimals follow a point, {found[1]}.{found[2]}"
    return ""


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
# trimesh logs tracebacks about parts of a file that nothing needs, such as normals
logging.getLogger("trimesh").addHandler(logging.NullHandler())


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
