"""Tables of numbers in text files: separators, decimal commas, quoted cells and columns of text.

A file is read a few lines at a time, so that its memory and time grow with its numbers only. A note
names a separator other than the comma, and decimal commas; what reads two ways is refused.
"""

import csv
import os
import re
from collections.abc import Iterator
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.errors import FileError
from rigidmc.files.opening import open_regular

LINE = 2**20  # longest line, in characters: a hole of a sparse file reads as a line of gigabytes
_LINES, _LETTERS = 20_000, 2**22  # lines and characters converted to numbers at once
_KINDS = {" ": "spaces", "\t": "tabs"}
_DATE = re.compile(r"\s*\d{4}-\d\d-\d\d([T ][\d:.]*Z?)?\s*$")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,(?:[eE][+-]?\d+)?")


class TextColumn(NamedTuple):
    """The first cell of a column that is not a number: its row, from 1 on, and its text."""

    row: int
    cell: str


class NumberTable(NamedTuple):
    """The columns of a CSV file.

    names : in the first line;  columns : numbers, or the first cell that is not a number, or None
        for numbers with decimal points in a table with decimal commas
    rows : number of rows below the first line;  notes : how it was read, if not with commas and
        decimal points
    """

    names: list[str]
    columns: list[NDArray[np.float64] | TextColumn | None]
    rows: int
    notes: tuple[str, ...]


def read_number_table(path: str | os.PathLike[str], is_measured: bool = False) -> NumberTable:
    """Return the columns of a text file, whose first line names them.

    Columns are separated by commas, semicolons or tabs, as the first line shows. With semicolons or
    tabs, numbers may have decimal commas. Quoted cells are read as plain ones; a # outside quotes
    begins a comment.

    is_measured : whether an empty cell is a gap, nan; a date of ISO 8601 a number of seconds since
        1970; and a first line that begins with a # has names and columns separated by spaces

    Raises ValueError if lines differ in length, if a quoted text is not closed in its line, or if
    the text is not UTF-8 (UnicodeDecodeError is a ValueError), and FileError if it is not a text
    file.
    """
    with open(path, encoding="utf-8", opener=open_regular, newline=None) as file:
        first = read_line(file).lstrip("\ufeff")
        separator = _separator(first, is_measured)
        if separator == " ":  # a name has no space: "(rate 415 Hz)" is a remark
            first = " ".join(re.sub(r"\([^()]*\s[^()]*\)", "", first.lstrip("# ")).split())
        names = [word.strip() for word in next(_cells([first], separator), [])]
        columns = [_Column(separator in ";\t", is_measured) for _ in names]
        rows = 0
        while lines := _some(file):
            bare = [_without_comment(line) for line in lines]
            if separator == " ":
                bare = [" ".join(line.split()) for line in bare]
            cells = list(_cells(bare, separator, is_measured))
            for row, cell in enumerate(cells, rows + 1):
                if len(cell) != len(names):
                    raise ValueError(_unequal(names, row, cell, separator))
            for column, words in zip(columns, zip(*cells, strict=True), strict=False):
                column.add(words, rows)
            rows += len(cells)
    notes = [f"columns are separated by {_KINDS.get(separator, repr(separator))}"]
    notes *= int(separator != ",")
    commas = any(column.commas for column in columns)
    notes += ["a comma is the decimal point"] * commas
    values = [None if commas and column.points else column.values() for column in columns]
    return NumberTable(names, values, rows, tuple(notes))


class _Column:
    """A column in progress."""

    def __init__(self, may_have_commas: bool, is_measured: bool) -> None:
        self.may_have_commas, self.commas, self.points = may_have_commas, False, False
        self.is_measured = is_measured
        self.pieces: list[NDArray[np.float64]] = []
        self.text: TextColumn | None = None

    def add(self, words: tuple[str, ...], before: int) -> None:
        """Add cells below `before` rows."""
        if self.text is not None:
            return
        if self.is_measured:
            words = tuple(word if word.strip() else "nan" for word in words)
        if self.may_have_commas:
            commas = [_DECIMAL_COMMA.fullmatch(word.strip()) is not None for word in words]
            self.points = self.points or any("." in word for word in words)
            if any(commas):
                self.commas = True
                pairs = zip(words, commas, strict=True)
                words = tuple(w.replace(",", ".") if comma else w for w, comma in pairs)
        try:
            if any("_" in word for word in words):  # Python reads 1_000 as a number
                raise ValueError
            self.pieces.append(np.array(words, dtype=float))
        except ValueError:
            if self.is_measured and (seconds := _seconds(words)) is not None:
                self.pieces.append(seconds)
                return
            row = next(i for i, word in enumerate(words) if not _is_number(word))
            self.text = TextColumn(before + row + 1, words[row][:80])
            self.pieces.clear()

    def values(self) -> NDArray[np.float64] | TextColumn:
        if self.text is not None:
            return self.text
        return np.concatenate(self.pieces) if self.pieces else np.empty(0)


def _seconds(words: tuple[str, ...]) -> NDArray[np.float64] | None:
    """Return the seconds of UTC since 1970 of dates; None for other text."""
    if not all(_DATE.match(word) or word == "nan" for word in words):
        return None
    dates = ["NaT" if word == "nan" else word.strip().removesuffix("Z") for word in words]
    try:
        since = np.array(dates, "datetime64[ns]") - np.datetime64(0, "s")
    except ValueError:
        return None
    return np.asarray(since / np.timedelta64(1, "s"))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def _separator(first: str, is_measured: bool) -> str:
    """Return the separator that the first line shows; ValueError for both kinds."""
    bare = re.sub(r'"(?:[^"]|"")*"', "", first)
    if ";" in bare and "," in bare:
        raise ValueError("its first line has commas and semicolons: separate columns by one kind")
    if ";" in bare or "," in bare:
        return ";" if ";" in bare else ","
    if "\t" in bare:
        return "\t"
    return " " if is_measured and bare.startswith("#") else ","


def _cells(lines: list[str], separator: str, are_gaps: bool = False) -> Iterator[list[str]]:
    """Return the cells of each line that is not blank; ValueError for a quoted text beyond its
    line. are_gaps : whether a line of empty cells is not blank"""
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    count = 0
    try:
        for cells in reader:
            count += 1
            if reader.line_num != count:
                raise ValueError('a quoted text does not end in its line: close it by "')
            if any(cell.strip() for cell in cells) or (are_gaps and len(cells) > 1):
                yield cells
    except csv.Error as error:
        raise ValueError(f"a line cannot be read: {error}") from None


def _without_comment(line: str) -> str:
    """Return a line without its comment: from a # outside quotes on."""
    if "#" not in line:
        return line
    parts = re.match(r'(?:[^"#]|"(?:[^"]|"")*")*', line)
    return parts[0] if parts else line


def _unequal(names: list[str], row: int, cells: list[str], separator: str) -> str:
    cure = "columns are separated by commas: with decimal commas, separate them by semicolons"
    if separator != ",":
        cure = f"the first line separates columns by {_KINDS.get(separator, 'semicolons')}"
    elif any(";" in cell for cell in cells):
        cure = "separate the names by semicolons, too"
    return (
        f"its first line names {len(names)} columns ({', '.join(names[:20])}), but row {row} has"
        f" {len(cells)}; {cure}"
    )


def read_line(file: IO[str]) -> str:
    """Return the next line of a text file; FileError if it is too long."""
    line = file.readline(LINE + 1)
    if len(line) > LINE:
        rule = f"has a line of more than {LINE:,} characters"
        raise FileError(rule, at="file", file=file.name)
    return line


def _some(file: IO[str]) -> list[str]:
    """Return the next lines of a file."""
    lines, letters = list[str](), 0
    while len(lines) < _LINES and letters < _LETTERS and (line := read_line(file)):
        lines.append(line)
        letters += len(line)
    return lines
