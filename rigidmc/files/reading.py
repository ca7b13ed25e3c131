"""Readers of files that come from outside: regular files only, text of at most TEXT bytes, TOML
nested at most DEPTH deep.

A pipe would block for ever, a device has no end, and Python's own readers raise many kinds of
errors: here each is a FileError, or a SceneError for a text that is no TOML.
"""

import contextlib
import json
import os
import re
import stat
import tomllib
from typing import Any

from rigidmc.errors import FileError, SceneError
from rigidmc.files.outputs import Path

TEXT = 16 * 2**20  # bytes of a text: TOML is read at 5 MB/s
DEPTH = 100  # tables and lists within each other; scenes have 4
_KINDS = {stat.S_ISDIR: "a folder", stat.S_ISFIFO: "a pipe", stat.S_ISSOCK: "a socket"}
# strings and comments of TOML, in which brackets and dots have no meaning
_STRINGS = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)


def refuse_irregular(path: Path, mode: int | None = None) -> None:
    """Raise FileError for a pipe, a device or a folder; FileNotFoundError if there is nothing."""
    mode = os.stat(path).st_mode if mode is None else mode
    if not stat.S_ISREG(mode):
        kind = next((words for test, words in _KINDS.items() if test(mode)), "a device")
        rule = f"is {kind}, and only a regular file is read"
        raise FileError("", "file", None, rule, file=os.fspath(path))


def bytes_of(path: Path, most: int = TEXT, last: bool = False) -> bytes:
    """The bytes of a regular file; if it has more than `most`, the last ones or FileError."""
    refuse_irregular(path)
    with open(path, "rb", opener=_without_waiting) as file:
        refuse_irregular(path, os.fstat(file.fileno()).st_mode)
        if last:
            file.seek(max(0, os.fstat(file.fileno()).st_size - most))
            return file.read(most)
        data = file.read(most + 1)
    if len(data) > most:
        rule = f"has more than the {most / 2**20:g} MB that a text may have"
        raise FileError("", "file", None, rule, file=os.fspath(path))
    return data


def text_of(path: Path) -> str:
    """The text of a regular file; FileError if it is not UTF-8."""
    try:
        return bytes_of(path).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise FileError("", "file", None, "is no text in UTF-8", file=os.fspath(path)) from None


def _without_waiting(path: str, flags: int) -> int:
    """Open a file without waiting, even if a pipe without a writer has taken its place."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))


def toml(text: object, file: str | None = None) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises SceneError for text that is not TOML, for more than DEPTH levels, and for whole numbers
    of more than 64 bits.
    """
    if not isinstance(text, str) or len(text) > TEXT:
        rule = f"expected text of at most {TEXT / 2**20:g} MB"
        raise SceneError("", "TOML", None, rule, file=file)
    depth, plain = 0, _STRINGS.sub("", text)
    for bracket in re.finditer(r"[\[\]{}]", plain):
        depth = depth + 1 if bracket[0] in "[{" else max(0, depth - 1)
        if depth > DEPTH:
            break
    if depth > DEPTH or any(part.count(".") >= DEPTH for part in re.split(r"[\n,=\[\]{}]", plain)):
        raise SceneError("", "TOML", None, f"is nested more than {DEPTH} deep", file=file)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError comes also from a number of more than 4300 digits
        raise SceneError("", "TOML", None, f"not valid TOML: {error}", file=file) from None
    try:
        _refuse_long(data)
    except SceneError as error:
        error.file = file
        raise
    return data


def _refuse_long(data: object, table: str = "", key: str = "") -> None:
    """Raise SceneError for a whole number of more than 64 bits, which TOML does not have."""
    if isinstance(data, dict):
        for name, value in data.items():
            _refuse_long(value, f"{table}.{key}".strip("."), name)
    elif isinstance(data, list):
        for value in data:
            _refuse_long(value, table, key)
    elif isinstance(data, int) and not -(2**63) <= data < 2**63:
        value = float("inf") if data > 0 else float("-inf")
        raise SceneError(table, key, value, "whole numbers have 64 bits")


def json_of(text: str) -> Any:
    """The value of a JSON text; ValueError if it is not JSON or is nested too deep."""
    with contextlib.suppress(RecursionError):
        return json.loads(text)
    raise ValueError("nested too deep")
