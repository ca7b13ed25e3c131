"""The body of a mass-property text, and the sign of its products of inertia.

In "positive" notation L_xy = +int x y dm; in "negative" notation L_xy = -int x y dm, the element of
the tensor. The numbers decide wherever the text contains more than one tensor: a principal axis a
with the moment P obeys I a = P a, and the tensors about the centre of mass and about the origin
differ by m (c^2 1 - c c^T). Else its words decide, else the user.
"""

from collections.abc import Iterator

import numpy as np

from rigidmc.errors import FileError, SceneError, unknown
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics import inertia
from rigidmc.mechanics.impossible import opposite_products
from rigidmc.scene.body_files.cad_text import Block, CadNumbers, read_lines
from rigidmc.scene.body_files.rigid_parts import FoundBody, RigidPart

NOTATIONS, POINTS = ("positive", "negative"), ("centre", "pivot")
_SLACK = 4.0  # roundings of several printed numbers add up


def read_cad_text(text: str, products: str | None, about: str | None, file: str) -> FoundBody:
    """Return the body of a text of mass properties, in the axes of its output coordinate system and
    about its origin.

    products : "positive" or "negative", the notation; None to find it in the text
    about : "centre" or "pivot", the origin: the point of a tensor, where the text does not say it
    """
    for word, allowed, kind in ((products, NOTATIONS, "products"), (about, POINTS, "about")):
        if word is not None and word not in allowed:
            raise unknown("word", allowed, at=f"body.{kind}", value=word)
    numbers = read_lines(text, file)
    block = _chosen(numbers, about)
    at_centre = about == "centre" if block.at_centre is None else block.at_centre
    printed, half = block.arrays(file)
    notation, notes = _notation(numbers, block, at_centre, products)
    tensor = opposite_products(printed) if notation == "positive" else printed
    mass, (centre, _) = numbers.masses[0].value, _centre(numbers)
    if not numbers.centre:
        notes.append("the text has no centre of mass: the origin is taken")
    if not at_centre:
        tensor = inertia.about_centre(tensor, mass, centre)
    if (printed.diagonal() < 20.0 * half.diagonal()).any():
        notes.append(
            "a moment has fewer than two significant digits: show more decimals in the CAD program"
        )
    return FoundBody(RigidPart(mass, centre, tensor), tuple(notes))


def _chosen(numbers: CadNumbers, about: str | None) -> Block:
    """Return the tensor about the centre of mass, or else the one about the origin."""
    for wanted in (True, False, None):
        same = [block for block in numbers.blocks if block.at_centre is wanted]
        if len(same) > 1:
            rule = "has several tensors about the same point: keep one"
            raise FileError(rule, at="Moments of inertia", file=numbers.file)
        if same and wanted is None and about is None:
            rule = (
                'the text does not say about which point its tensor is: give "centre", the centre'
                ' of mass, or "pivot", the origin'
            )
            raise SceneError(rule, at="body.about", file=numbers.file)
        if same:
            return same[0]
    raise AssertionError("read_lines refuses a text without tensor")


def _centre(printed: CadNumbers) -> tuple[Array, float]:
    """Return the centre of mass (3,), the origin by default, and half of its last digit."""
    numbers = [printed.centre[k] for k in sorted(printed.centre)]
    if not numbers:
        return np.zeros(3), 0.0
    return np.array([number.value for number in numbers]), max(number.half for number in numbers)


def _notation(
    numbers: CadNumbers, block: Block, at_centre: bool, products: str | None
) -> tuple[str, list[str]]:
    """Return the notation of the products of inertia, and notes.

    FileError if the text contradicts itself or `products`; SceneError if nothing decides.
    """
    printed, _ = block.arrays(numbers.file)
    if not (printed - np.diag(printed.diagonal())).any():
        return "negative", []
    shown = _shown(numbers, block, at_centre)
    if len(numbers.notations) > 1:
        rule = "names both positive and negative tensor notation"
        raise FileError(rule, at="products of inertia", file=numbers.file)
    words = next(iter(numbers.notations), None)
    for stated, who in ((products, "products asks for"), (words, "its words say")):
        if stated is not None and shown is not None and stated != shown:
            rule = f"{who} {stated} notation, but its numbers fit {shown} notation alone"
            raise FileError(rule, at="products of inertia", file=numbers.file)
    if None not in (products, words) and products != words and shown is None:
        rule = f"products asks for {products} notation, but its words say {words} notation"
        raise FileError(rule, at="products of inertia", file=numbers.file)
    notation = products or shown or words
    if notation is None:
        rule = (
            'the products of inertia in the text read two ways: give "positive" if they are'
            ' +int x y dm, or "negative" if they are the elements of the tensor, -int x y dm'
        )
        raise SceneError(rule, at="body.products", file=numbers.file)
    why = "as asked" if products else "as its numbers show" if shown else "as its words say"
    sign = "+" if notation == "positive" else "-"
    return notation, [f"its {block.letter}xy is read as {sign}int x y dm, {why}"]


def _shown(numbers: CadNumbers, block: Block, at_centre: bool) -> str | None:
    """Return the notation that the numbers fit, None if they fit both; FileError if neither."""
    fits = [
        notation
        for notation in NOTATIONS
        if all(
            misfit <= 1.0
            for misfit in (
                *_of_axes(numbers, block, at_centre, notation),
                *_of_shift(numbers, notation),
            )
        )
    ]
    if not fits:
        rule = "its tensors, or its principal axes and moments, contradict each other"
        raise FileError(rule, at="Moments of inertia", file=numbers.file)
    return fits[0] if len(fits) == 1 else None


def _of_axes(numbers: CadNumbers, block: Block, at_centre: bool, notation: str) -> Iterator[float]:
    """Yield |I a - P a| over its bound by rounding, for each principal axis of the text."""
    printed, halves = block.arrays(numbers.file)
    tensor, half = _tensor(printed, notation), halves.max()
    if not at_centre:
        shift, more = _shift(numbers)
        tensor, half = tensor - shift, half + more
    for k in numbers.axes.keys() & numbers.moments.keys():
        axis = np.array([number.value for number in numbers.axes[k]])
        fine = max(number.half for number in numbers.axes[k])
        moment = numbers.moments[k]
        rounding = half + moment.half + fine * np.abs(tensor).max()
        misfit = np.abs(tensor @ axis - moment.value * axis).max()
        yield float(misfit / (_SLACK * rounding))


def _of_shift(numbers: CadNumbers, notation: str) -> Iterator[float]:
    """Yield the difference of the tensors about both points from m (c^2 1 - c c^T), over its bound
    by rounding."""
    about = {block.at_centre: block.arrays(numbers.file) for block in numbers.blocks}
    if not numbers.centre or not {True, False} <= about.keys():
        return
    (at_centre, fine), (moved, coarse) = about[True], about[False]
    shift, more = _shift(numbers)
    difference = _tensor(moved, notation) - _tensor(at_centre, notation) - shift
    rounding = fine.max() + coarse.max() + more
    yield float(np.abs(difference).max() / (_SLACK * rounding))


def _shift(numbers: CadNumbers) -> tuple[Array, float]:
    """Return m (c^2 1 - c c^T) of the text, and its bound by rounding."""
    mass, (centre, half) = numbers.masses[0], _centre(numbers)
    size = float(np.abs(centre).max())
    more = 4.0 * mass.value * size * half + 2.0 * mass.half * size * size
    shift: Array = mass.value * inertia.shift(centre)
    return shift, more


def _tensor(printed: Array, notation: str) -> Array:
    return opposite_products(printed) if notation == "positive" else printed
