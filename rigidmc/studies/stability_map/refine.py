"""Adaptive maps: choose the pixels to compute from the pixels computed so far.

An adaptive map first computes every STRIDE-th pixel along each side. Each further level halves the
distance. It computes a pixel if one of the nearest pixels of the previous level (one, two or four)
differs in class from any of its eight neighbours there, or has an uncertain class. All other pixels
copy a computed one nearby. This is a quadtree whose cells are divided where they meet a border, and
one cell beyond. For heavy_chaos, whose border is fractal, it computes 19.9 % of the 1024 x 1024
pixels, and 0.30 % differ in class from the full map (`python -m bench.adaptive_maps heavy_chaos
1024`).

The next pixels depend only on the level and the results so far, so that a killed map continues as
if it had not stopped.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rigidmc.engine.kernel.layout import LANES
from rigidmc.errors import OptionError, unknown
from rigidmc.inputs.arrays import Array, Bools, Ints
from rigidmc.statistics.measures import Measure
from rigidmc.studies.stability_map.pixels import Pixels
from rigidmc.studies.stability_map.question import Borders, MapRequest

STRIDE = 8  # distance between the pixels of the first level
BEGUN = 2 * STRIDE  # the stride before the first level
CLASSES = 8  # of a measure without borders: equal parts of the range in the first pixels
EDGES = 0.01, 0.99  # quantiles that define this range
UNITS = 2**13  # most parts of a map, each a shard of its run directory
_NEVER = -1.0  # class of a pixel without a value or without a good member


class Refinement(NamedTuple):
    """The progress of an adaptive map.

    source : (pixels,) the computed pixel that each pixel shows
    known : (pixels,) whether it was computed
    wanted : the pixels to compute next, in order; empty if the map is finished
    level : the stride of their level, 0 if the map is finished
    """

    source: Ints
    known: Bools
    wanted: Ints
    level: int


def pixel_multiple(request: MapRequest) -> int:
    """Return the size of the groups in which pixels are computed; each group is a shard."""
    return LANES * -(-request.pixels // UNITS)


def pixel_members(request: MapRequest, pixels: Ints) -> Ints:
    """Return the members of pixels, in order."""
    return np.add.outer(np.arange(request.replicas) * request.pixels, pixels).ravel()


def borders_of(measures: Sequence[Measure], asked: Borders = ()) -> Borders:
    """Return the given borders between the classes of measures, or default ones of the first
    measure.

    Default borders: 0.5 for a fraction p(...), 4 for a MEGNO (it is 2 for regular motion, and grows
    in time for chaos), and none for other measures, which means CLASSES equal parts of the range.
    Raises OptionError for malformed borders, and for measures that the map does not have.
    """
    try:
        borders = tuple((str(text).strip(), tuple(map(float, values))) for text, values in asked)
    except (TypeError, ValueError):
        rule = "expected (measure, values between its classes) for each measure"
        raise OptionError(rule, at="adaptive", value=asked) from None
    texts = [measure.text for measure in measures]
    for text, _ in borders:
        if text not in texts:
            raise unknown("measure of the map", texts, at="adaptive", value=text, error=OptionError)
    measure = measures[0]
    usual = (0.5,) if measure.kind == "p" else (4.0,) if measure.result.name == "megno" else ()
    return borders or ((measure.text, usual),)


def refine(request: MapRequest, pixels: Pixels, done: int = 1) -> Refinement:
    """Return the progress of an adaptive map from its pixels.

    done : the stride of the last complete level; BEGUN at the beginning
    """
    shape = request.layers, request.rows, request.columns
    number = np.arange(request.pixels).reshape(shape)
    computed = (pixels.counts.sum(0) > 0).reshape(shape)
    classes, sure = _classes(request, pixels)
    stride, shown = STRIDE, number[:, ::STRIDE, ::STRIDE]
    level, wanted = (STRIDE, shown.ravel()) if done == BEGUN else (0, number[:0].ravel())
    while stride > 1:
        stride //= 2
        mine, here = number[:, ::stride, ::stride], computed[:, ::stride, ::stride]
        low, high = _around(shape, stride)
        if stride < done and not wanted.size:
            unlike = _unlike(classes[:, shown]) | ~sure[shown]
            near = [unlike[:, i[:, None], j] for i in (low[0], high[0]) for j in (low[1], high[1])]
            asked_for = np.logical_or.reduce(near)
            level, wanted = stride, mine[asked_for & ~here]
        # of two equally near pixels, the one that also belongs to the next coarser level
        i, j = (np.where(a % 2, b, a) for a, b in zip(low, high, strict=True))
        shown = np.where(here, mine, shown[:, i[:, None], j])
    if not wanted.size:
        return Refinement(shown.ravel(), computed.ravel(), wanted, 0)
    return Refinement(
        shown.ravel(), computed.ravel(), _rounded_up(request, wanted, computed, level), level
    )


def _around(shape: tuple[int, int, int], stride: int) -> tuple[list[Ints], list[Ints]]:
    """Return, for the rows and columns of a level, the nearest below and above in the previous
    level."""
    places = [np.arange(-(-size // stride)) for size in shape[1:]]
    last = [-(-size // (2 * stride)) - 1 for size in shape[1:]]
    above = [np.minimum((place + 1) // 2, end) for place, end in zip(places, last, strict=True)]
    return [place // 2 for place in places], above


def _unlike(classes: Array) -> Bools:
    """Return whether a pixel differs from one of its eight neighbours in one of its classes."""
    wide = np.pad(classes, ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge")
    rows, columns = classes.shape[2:]
    others = (wide[..., i : i + rows, j : j + columns] for i in range(3) for j in range(3))
    found: Bools = np.logical_or.reduce([other != classes for other in others]).any(0)
    return found


def _classes(request: MapRequest, pixels: Pixels) -> tuple[Array, Bools]:
    """Return (classes of the pixels (measures, pixels), whether all classes of a pixel are
    certain).

    A class is certain if the interval contains no border, if there is no interval, or if all
    members agree on a fraction p(...) of 0 or 1: with few members, intervals would contain a border
    everywhere.
    """
    classes, sure = [np.where(pixels.counts[0] > 0, 0.0, _NEVER)], np.ones(request.pixels, bool)
    for text, borders in request.borders or ():
        value, low, high, _ = pixels.intervals[text]
        places = np.sort(borders) if borders else _equal_parts(request, value)
        among, least, most = (
            np.where(np.isnan(numbers), _NEVER, np.searchsorted(places, numbers, side="right"))
            for numbers in (value, low, high)
        )
        classes.append(among)
        agreed = text.startswith("p(") & ((value == 0.0) | (value == 1.0))
        sure &= agreed | (least == most) | np.isnan(low) | np.isnan(high)
    return np.array(classes), sure


def _equal_parts(request: MapRequest, values: Array) -> Array:
    """Return the borders of CLASSES equal parts of the range of the first pixels."""
    shape = request.layers, request.rows, request.columns
    first = values.reshape(shape)[:, ::STRIDE, ::STRIDE]
    first = first[np.isfinite(first)]
    if not first.size:
        return np.zeros(0)
    low, high = np.quantile(first, EDGES)
    return np.linspace(low, high, CLASSES + 1)[1:-1]


def _rounded_up(request: MapRequest, wanted: Ints, computed: Any, stride: int) -> Ints:
    """Return the wanted pixels, and evenly spread others of their level up to a multiple of
    `pixel_multiple`.

    If the level has too few others, they come from the whole map, or are all that are left.
    """
    short = -wanted.size % pixel_multiple(request)
    number = np.arange(request.pixels).reshape(computed.shape)
    for step in (stride, 1):
        left = np.setdiff1d(number[:, ::step, ::step][~computed[:, ::step, ::step]], wanted)
        if left.size >= short:
            break
    count = min(short, left.size)
    more = left[np.arange(count) * left.size // max(1, count)]
    return np.sort(np.concatenate([wanted, more]))
