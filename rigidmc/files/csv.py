"""CSV files: tables of others that are read some lines at a time, and tables that are written so
that no spreadsheet takes a cell for a formula."""

import os
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import FileError
from rigidmc.files.opening import regular

LINE = 2**20  # letters of a line: the holes of a sparse file make one line of gigabytes
_LINES, _LETTERS = 20_000, 2**22  # that are turned into numbers at once


def numbers_of(path: str | os.PathLike[str]) -> tuple[list[str], NDArray[np.float64]]:
    """(names in the first line, numbers (rows, columns)) of a CSV file; (0, 0) without rows.

    Memory and time grow with the size of the file. Raises ValueError, of which UnicodeDecodeError
    is one, for lines that differ in length, and FileError for what is no text file.
    """
    with open(path, encoding="utf-8", opener=regular) as file:
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
        raise FileError("", "file", None, rule, file=file.name)
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
