"""Adaptive maps: which pixels are computed, by what those that are there say.

Every STRIDE-th pixel along each side is computed first. Then, level by level, the distance is
halved: a pixel is computed if one of the nearest of the level before (one, two or four) differs in
class from any of its eight neighbours there, or is not sure of its own. The others show one nearby
that was computed. That is a quadtree whose cells are divided where they meet a border, and
one cell beyond. Of the 1024 x 1024 pixels of heavy_chaos, whose border is fractal, 19.9 % are
computed so, and 0.30 % are of another class than in the whole map (`python -m bench.adaptive_maps
heavy_chaos 1024`).

What comes next is a function of the level and of the results so far, so that a map that was killed
goes on as if it had not been.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.kernel.layout import LANES
from rigidmc.errors import OptionError, unknown
from rigidmc.results.measures import Measure
from rigidmc.studies.stability_map.pixels import Pixels
from rigidmc.studies.stability_map.question import Borders, MapRequest

STRIDE = 8  # pixels between those that are computed first
BEGUN = 2 * STRIDE  # the stride of the level before the first
CLASSES = 8  # of a measure without borders: equal parts of the range among the first pixels
EDGES = 0.01, 0.99  # that range: these quantiles
UNITS = 2**13  # parts of a map at most, each a shard of its run directory
_NEVER = -1.0  # the class of a pixel without a number; pixels without a good member have it too

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Refinement(NamedTuple):
    """How far an adaptive map is.

    source : (pixels,) the pixel that each pixel shows
    known : (pixels,) whether it was computed
    wanted : the pixels that are to be computed next, in their order; none if the map is done
    level : the stride of their level, 0 if the map is done
    """

    source: Ints
    known: Bools
    wanted: Ints
    level: int


def pixel_multiple(request: MapRequest) -> int:
    """Pixels are computed in multiples of so many, the members of a whole shard."""
    return LANES * -(-request.pixels // UNITS)


def pixel_members(request: MapRequest, pixels: Ints) -> Ints:
    """The members of some pixels, in their order."""
    return np.add.outer(np.arange(request.replicas) * request.pixels, pixels).ravel()


def borders_of(measures: Sequence[Measure], given: Borders = ()) -> Borders:
    """The borders between the classes of measures: those given, or else those of the first.

    These are 0.5 for a share, 4 for a MEGNO (2 for regular motion, and it grows in time with
    chaos), and none, which stands for CLASSES equal parts of its range, for other measures.
    Raises OptionError for what are no borders, and for measures that the map has not.
    """
    try:
        found = tuple((str(text).strip(), tuple(map(float, values))) for text, values in given)
    except (TypeError, ValueError):
        rule = "expected (measure, values that divide its classes) for each measure"
        raise OptionError(rule, at="adaptive", value=given) from None
    texts = [one.text for one in measures]
    for text, _ in found:
        if text not in texts:
            raise unknown("measure of the map", texts, at="adaptive", value=text, error=OptionError)
    one = measures[0]
    usual = (0.5,) if one.kind == "p" else (4.0,) if one.result.name == "megno" else ()
    return found or ((one.text, usual),)


def refine(request: MapRequest, pixels: Pixels, done: int = 1) -> Refinement:
    """How far an adaptive map is, by what its pixels say.

    done : the stride of the last level, all of whose pixels are there; BEGUN if none is
    """
    shape = request.layers, request.rows, request.columns
    number = np.arange(request.pixels).reshape(shape)
    known = (pixels.counts.sum(0) > 0).reshape(shape)
    classes, sure = _classes(request, pixels)
    stride, shown = STRIDE, number[:, ::STRIDE, ::STRIDE]
    level, wanted = (STRIDE, shown.ravel()) if done == BEGUN else (0, number[:0].ravel())
    while stride > 1:
        stride //= 2
        mine, here = number[:, ::stride, ::stride], known[:, ::stride, ::stride]
        low, high = _around(shape, stride)
        if stride < done and not wanted.size:
            unlike = _unlike(classes[:, shown]) | ~sure[shown]
            near = [unlike[:, i[:, None], j] for i in (low[0], high[0]) for j in (low[1], high[1])]
            asked_for = np.logical_or.reduce(near)
            level, wanted = stride, mine[asked_for & ~here]
        # of two that are equally near the one that the level before shares with the next coarser
        i, j = (np.where(a % 2, b, a) for a, b in zip(low, high, strict=True))
        shown = np.where(here, mine, shown[:, i[:, None], j])
    if not wanted.size:
        return Refinement(shown.ravel(), known.ravel(), wanted, 0)
    return Refinement(
        shown.ravel(), known.ravel(), _rounded_up(request, wanted, known, level), level
    )


def _around(shape: tuple[int, int, int], stride: int) -> tuple[list[Ints], list[Ints]]:
    """The nearest rows and columns of the level before, for those of a level: below, and above."""
    places = [np.arange(-(-size // stride)) for size in shape[1:]]
    last = [-(-size // (2 * stride)) - 1 for size in shape[1:]]
    above = [np.minimum((one + 1) // 2, end) for one, end in zip(places, last, strict=True)]
    return [one // 2 for one in places], above


def _unlike(classes: NDArray[np.float64]) -> Bools:
    """Whether a pixel differs from one of its eight neighbours in one of its classes."""
    wide = np.pad(classes, ((0, 0), (0, 0), (1, 1), (1, 1)), mode="edge")
    rows, columns = classes.shape[2:]
    others = (wide[..., i : i + rows, j : j + columns] for i in range(3) for j in range(3))
    found: Bools = np.logical_or.reduce([other != classes for other in others]).any(0)
    return found


def _classes(request: MapRequest, pixels: Pixels) -> tuple[NDArray[np.float64], Bools]:
    """((measures, pixels) the classes of the pixels, whether each is sure of all of its own).

    A pixel is sure if no border is within its interval, or if there is none, or if all of its
    members agree on a share: the intervals of a few would hold a border everywhere.
    """
    found, sure = [np.where(pixels.counts[0] > 0, 0.0, _NEVER)], np.ones(request.pixels, bool)
    for text, borders in request.borders or ():
        value, low, high, _ = pixels.intervals[text]
        places = np.sort(borders) if borders else _equal_parts(request, value)
        among, least, most = (
            np.where(np.isnan(one), _NEVER, np.searchsorted(places, one, side="right"))
            for one in (value, low, high)
        )
        found.append(among)
        agreed = text.startswith("p(") & ((value == 0.0) | (value == 1.0))
        sure &= agreed | (least == most) | np.isnan(low) | np.isnan(high)
    return np.array(found), sure


def _equal_parts(request: MapRequest, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Borders of CLASSES equal parts of the range of the pixels that come first."""
    shape = request.layers, request.rows, request.columns
    first = values.reshape(shape)[:, ::STRIDE, ::STRIDE]
    first = first[np.isfinite(first)]
    if not first.size:
        return np.zeros(0)
    low, high = np.quantile(first, EDGES)
    return np.linspace(low, high, CLASSES + 1)[1:-1]


def _rounded_up(request: MapRequest, wanted: Ints, known: Any, stride: int) -> Ints:
    """Pixels that are wanted, and others of their level, spread evenly, to a multiple of
    `pixel_multiple`.

    If their level has too few others, those of the whole map are taken, or all of them.
    """
    short = -wanted.size % pixel_multiple(request)
    number = np.arange(request.pixels).reshape(known.shape)
    for step in (stride, 1):
        left = np.setdiff1d(number[:, ::step, ::step][~known[:, ::step, ::step]], wanted)
        if left.size >= short:
            break
    count = min(short, left.size)
    more = left[np.arange(count) * left.size // max(1, count)]
    return np.sort(np.concatenate([wanted, more]))
