"""Mass properties as text, as SolidWorks and Onshape show them::

    Mass = 13.5 grams
    Center of mass: ( millimeters )   X = ...  Y = ...  Z = ...
    Moments of inertia: ( grams * square millimeters )
    Taken at the center of mass ... (Using positive tensor notation.)
        Lxx = ...  Lxy = ...

`read_lines` collects the numbers, and `cad_signs` finds the sign of the products of inertia, in
which CAD programs and their settings differ.
"""

import re
from collections.abc import Container
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rigidmc.errors import FileError
from rigidmc.inputs.arrays import Array
from rigidmc.scene.body_files.cad_units import INERTIA, LENGTH, MASS, find_unit

# at most 40 digits and two of the power, so that no product overflows
_NUMBER = r"([-+]?(?:\d{1,40}\.?\d{0,40}|\.\d{1,40})(?:[eE][-+]?\d{1,2})?)(?=[\s,;)]|$)"
_ELEMENT = re.compile(rf"\b([LIJ])([xyz])([xyz])\s*[=:]\s*{_NUMBER}")
_POINT = re.compile(rf"^\s*([XYZ])\s*[=:]\s*{_NUMBER}(.*)$")
_AXIS = re.compile(rf"\bI([xyz])\s*[=:]\s*\(\s*{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}\s*\)")
_MOMENT = re.compile(rf"\bP([xyz])\s*[=:]\s*{_NUMBER}")
_MASS = re.compile(rf"^\s*mass\s*[=:]\s*{_NUMBER}(.*)$", re.IGNORECASE)
_COMMA = re.compile(r"[=:]\s*[-+]?\d+,\d")
_NOTATION = re.compile(r"(positive|negative) tensor notation")
LARGEST = 2**17  # bytes, of about 2,000 in SolidWorks: a heading is read for each number below


class Printed(NamedTuple):
    """A number of the text, in SI, and half a unit of its last digit."""

    value: float
    half: float

    @classmethod
    def of(cls, number: str, unit: float = 1.0) -> "Printed":
        mantissa, _, power = number.lower().partition("e")
        decimals = len(mantissa.partition(".")[2])
        return cls(float(number) * unit, 0.5 * 10.0 ** (int(power or 0) - decimals) * unit)


class Block(NamedTuple):
    """A tensor of the text: {(row, column): number}.

    at_centre : whether it is about the centre of mass; None if the text does not say
    """

    letter: str
    at_centre: bool | None
    elements: dict[tuple[int, int], Printed]

    def arrays(self, file: str) -> tuple[Array, Array]:
        """Return the elements as printed, and half of their last digits, (3, 3) each; FileError
        for a tensor that is not complete, symmetric and positive."""
        at = "Moments of inertia"
        value, half = np.full((3, 3), np.nan), np.zeros((3, 3))
        for (i, j), number in self.elements.items():
            value[i, j], half[i, j] = number
        missing = np.isnan(value)
        value, half = np.where(missing, value.T, value), np.where(missing, half.T, half)
        if np.isnan(value).any():
            raise FileError("expected all of xx, yy, zz, xy, xz and yz", at=at, file=file)
        if (np.abs(value - value.T) > 1.001 * (half + half.T)).any():
            raise FileError("the tensor is not symmetric", at=at, file=file)
        if not (value.diagonal() > 0.0).all():
            rule = "a moment is not positive: show more decimals in the CAD program"
            raise FileError(rule, at=at, file=file)
        return 0.5 * (value + value.T), half


@dataclass
class CadNumbers:
    """The numbers of a text, in SI.

    masses [kg];  centre : {axis: coordinate} [m];  axes : {k: components of principal axis k}
    moments : {k: principal moment k} [kg m2];  notations : "positive" or "negative", in its words
    """

    file: str
    masses: list[Printed] = field(default_factory=list)
    centre: dict[int, Printed] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    axes: dict[int, list[Printed]] = field(default_factory=dict)
    moments: dict[int, Printed] = field(default_factory=dict)
    notations: set[str] = field(default_factory=set)
    heading: str = ""

    def read_line(self, line: str) -> None:
        """Read one line; FileError for a number without unit, or given twice."""
        if _COMMA.search(line):
            rule = "has a comma in a number: set a decimal point, and no separator of thousands"
            raise FileError(rule, at="text", value=line.strip(), file=self.file)
        self.notations.update(_NOTATION.findall(line.lower()))
        if (mass := _MASS.match(line)) is not None:
            unit = find_unit(mass[2], MASS, "Mass", self.file)
            self.masses.append(Printed.of(mass[1], unit))
        elif (point := _POINT.match(line)) is not None:
            self._read_point(*point.groups())
        elif elements := list(_ELEMENT.finditer(line)):
            for element, after in zip(elements, [*elements[1:], None], strict=True):
                tail = line[element.end() : after.start() if after else len(line)]
                self._read_element(element, tail)
        elif _AXIS.search(line) or _MOMENT.search(line):
            self._read_principal(line)
        elif line.strip():
            # a heading may take two lines: of what, and about which point
            follows = line.lower().lstrip().startswith(("taken", "(", "about", "calculated"))
            self.heading = f"{self.heading} {line}" if follows else line

    def _read_point(self, axis: str, number: str, tail: str) -> None:
        unit = find_unit(tail if tail.strip() else self.heading, LENGTH, axis, self.file)
        if "XYZ".index(axis) in self.centre:
            raise FileError("is given twice", at=f"Center of mass, {axis}", file=self.file)
        self.centre["XYZ".index(axis)] = Printed.of(number, unit)

    def _read_element(self, match: "re.Match[str]", tail: str) -> None:
        letter, row, column, number = match.groups()
        key, at_centre = ("xyz".index(row), "xyz".index(column)), _at_centre(self.heading)
        same = [b for b in self.blocks if (b.letter, b.at_centre) == (letter, at_centre)]
        block = same[0] if same else Block(letter, at_centre, {})
        if not same:
            self.blocks.append(block)
        at = f"{letter}{row}{column}"
        if key in block.elements:
            raise FileError("is given twice", at=at, file=self.file)
        unit = find_unit(tail if tail.strip() else self.heading, INERTIA, at, self.file)
        block.elements[key] = Printed.of(number, unit)

    def _read_principal(self, line: str) -> None:
        for axis in _AXIS.finditer(line):
            k = self._new(axis[1], self.axes, "I")
            self.axes[k] = [Printed.of(word) for word in axis.groups()[1:]]
        for moment in _MOMENT.finditer(line):
            k = self._new(moment[1], self.moments, "P")
            tail = line[moment.end() :]
            unit = find_unit(tail if tail.strip() else self.heading, INERTIA, "Px", self.file)
            self.moments[k] = Printed.of(moment[2], unit)

    def _new(self, letter: str, read: Container[int], name: str) -> int:
        """Return the index of an axis; FileError if its number is known already."""
        k = "xyz".index(letter)
        if k in read:
            raise FileError("is given twice", at=f"{name}{letter}", file=self.file)
        return k


def read_lines(text: str, file: str) -> CadNumbers:
    """Return the numbers of a text of mass properties; FileError for what is missing or reads two
    ways."""
    numbers = CadNumbers(file)
    for line in text.splitlines():
        numbers.read_line(line)
    if len(numbers.masses) != 1 or not numbers.masses[0].value > 0.0:
        rule = (
            "expected one line such as 'Mass = 1.5 kilograms', in English and with its unit, not"
            f" {len(numbers.masses)}"
        )
        raise FileError(rule, at="Mass", file=file)
    if len(numbers.centre) not in (0, 3):
        raise FileError("expected X, Y and Z", at="Center of mass", file=file)
    if not numbers.blocks:
        rule = "has no tensor: expected Lxx = ... Lxy = ... below a heading with its unit"
        raise FileError(rule, at="text", file=file)
    return numbers


def _at_centre(heading: str) -> bool | None:
    """Return whether a heading says that a tensor is about the centre of mass; None if it does not
    name a point."""
    words = heading.lower()
    if re.search(r"cent(er|re) of (mass|gravity)|centroid", words):
        return True
    return False if re.search(r"output coordinate system|origin", words) else None
