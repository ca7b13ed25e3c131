"""Reading of XML files of others: robot descriptions. No document type, no entity, bounded size.

Elements come from Python's expat parser. A document type may define entities, which may name files
or expand to gigabytes, so that it is refused before any entity is read.
"""

import os
from collections.abc import Sequence
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from rigidmc.errors import FileError
from rigidmc.files.outputs import Path
from rigidmc.files.reading import bytes_of

DEPTH = 200  # elements within each other; chains of 100 bodies are long
MOST = 100_000  # elements
LARGEST = 1e50  # number, in SI: the square of none overflows


def read_xml(path: Path) -> Element:
    """Return the root element of an XML file of at most 4 MB; FileError."""
    file = os.fspath(path)

    def refuse(rule: str) -> FileError:
        return FileError(rule, at="XML", file=file)

    data = bytes_of(path)
    builder, parser, state = TreeBuilder(), expat.ParserCreate(), [0, 0]

    def begin(name: str, attributes: dict[str, str]) -> None:
        state[0] += 1
        state[1] += 1
        if state[0] > DEPTH or state[1] > MOST:
            raise refuse(f"has more than {MOST:,} elements, or is nested more than {DEPTH} deep")
        builder.start(name, attributes)

    def end(name: str) -> None:
        state[0] -= 1
        builder.end(name)

    def doctype(*_: object) -> None:
        raise refuse("has a document type (<!DOCTYPE>), which is not read: delete it")

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler, parser.EntityDeclHandler = doctype, doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise refuse(f"is not well-formed XML: {error}") from None
    except FileError:
        raise
    except Exception as error:  # the codec that the file names may raise anything
        rule = f"names an encoding that XML does not have: save it as UTF-8 ({error})"
        raise refuse(rule) from None
    return builder.close()


def numbers_of(
    element: Element, key: str, sizes: Sequence[int], at: str, file: str
) -> tuple[float, ...] | None:
    """Return the numbers of an attribute, None without it; FileError unless they are finite and as
    many as one of `sizes`.

    at : the element in words, such as "link arm, inertia"
    """
    text = element.get(key)
    if text is None:
        return None
    words = text.split()
    try:
        # float() also takes 1_000, inf and nan
        numbers = tuple(float(word) for word in words if "_" not in word)
    except ValueError:
        numbers = ()
    finite = all(abs(number) < LARGEST for number in numbers)
    if not finite or len(numbers) != len(words) or len(numbers) not in sizes:
        wanted = " or ".join(map(str, sizes))
        rule = f"expected {wanted} finite number{'s' if max(sizes) > 1 else ''}"
        raise FileError(rule, at=f"{at}, {key}", value=text, file=file)
    return numbers
