"""Readers of files that come from outside: regular files only, text of at most TEXT bytes, TOML nested at most DEPTH deep.

A pipe would block for ever, a device has no end, and Python's own readers raise many kinds of errors: here each is a SceneError.
"""

import contextlib
import json
import os
import re
import stat
import tomllib

from rigidmc.errors import SceneError

TEXT = 16 * 2**20  # bytes of a text: TOML is read at 5 MB/s
DEPTH = 100  # tables and lists within each other; scenes have 4
_KINDS = {stat.S_ISDIR: "a folder", stat.S_ISFIFO: "a pipe", stat.S_ISSOCK: "a socket"}
# strings and comments of TOML, in which brackets and dots have no meaning
_STRINGS = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)


def refuse_irregular(path, mode=None):
    """SceneError for a pipe, a device or a folder in the place of a file; FileNotFoundError for nothing."""
    mode = os.stat(path).st_mode if mode is None else mode
    if not stat.S_ISREG(mode):
        kind = next((words for test, words in _KINDS.items() if test(mode)), "a device")
        raise SceneError(
            "", "file", None, f"is {kind}, and only a regular file is read", file=os.fspath(path)
        )


def bytes_of(path, most=TEXT, last=False):
    """The bytes of a regular file. If it has more than `most`: the last ones with `last`, else SceneError."""
    refuse_irregular(path)
    with open(path, "rb", opener=_at_once) as file:
        refuse_irregular(path, os.fstat(file.fileno()).st_mode)
        if last:
            file.seek(max(0, os.fstat(file.fileno()).st_size - most))
            return file.read(most)
        data = file.read(most + 1)
    if len(data) > most:
        raise SceneError(
            "",
            "file",
            None,
            f"has more than the {most / 2**20:g} MB that a text may have",
            file=os.fspath(path),
        )
    return data


def text_of(path):
    """The text of a regular file in UTF-8; SceneError for what is none."""
    try:
        return bytes_of(path).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise SceneError("", "file", None, "is no text in UTF-8", file=os.fspath(path)) from None


def _at_once(path, flags):
    """Open a file without waiting, even if a pipe without a writer has taken its place meanwhile."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))


def toml(text, file=None):
    """The tables of a TOML text; SceneError for what is none, for more than DEPTH levels, and for whole numbers of more than 64 bits."""
    if not isinstance(text, str) or len(text) > TEXT:
        raise SceneError(
            "", "TOML", None, f"expected text of at most {TEXT / 2**20:g} MB", file=file
        )
    depth, plain = 0, _STRINGS.sub("", text)
    for bracket in re.finditer(r"[\[\]{}]", plain):
        depth = depth + 1 if bracket[0] in "[{" else max(0, depth - 1)
        if depth > DEPTH:
            break
    if depth > DEPTH or any(part.count(".") >= DEPTH for part in re.split(r"[\n,=\[\]{}]", plain)):
        raise SceneError("", "TOML", None, f"is nested more than {DEPTH} deep", file=file)
    try:
        data = tomllib.loads(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # ValueError: also a number of more than 4300 digits
        raise SceneError("", "TOML", None, f"not valid TOML: {error}", file=file) from None
    try:
        _refuse_long(data)
    except SceneError as error:
        error.file = file
        raise
    return data


def _refuse_long(data, table="", key=""):
    """SceneError for a whole number of more than 64 bits, which TOML has not."""
    if isinstance(data, dict):
        for name, value in data.items():
            _refuse_long(value, f"{table}.{key}".strip("."), name)
    elif isinstance(data, list):
        for value in data:
            _refuse_long(value, table, key)
    elif isinstance(data, int) and not -(2**63) <= data < 2**63:
        raise SceneError(
            table, key, float("inf") if data > 0 else float("-inf"), "whole numbers have 64 bits"
        )


def json_of(text):
    """The value of a JSON text; ValueError if it is not JSON or is nested too deep."""
    with contextlib.suppress(RecursionError):
        return json.loads(text)
    raise ValueError("nested too deep")
