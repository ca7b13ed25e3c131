"""Tell how often members end otherwise if their start changes a little, and the dimension of
the boundary between basins of attraction.

A start is uncertain at a distance epsilon if its neighbour there ends otherwise. The share f of
uncertain starts falls as a power of the distance, and in the space of the d numbers that a
member draws the boundary has the (box) dimension D::

    f ~ epsilon^alpha,   D = d - alpha

alpha is 1 for a smooth boundary; for a fractal one it is smaller, and a better known start
hardly helps. Distances are those of probabilities, which for a uniform law are shares of its
range, along one number after the other, see `rigidmc.scene.sampling.NeighbourFamilies`. alpha is
the slope of a line through the logarithms. Source: McDonald, Grebogi, Ott & Yorke, Physica D 17
(1985) 125.

{parameters}

Returns
-------
xarray.Dataset
    over distance: `uncertain`, the share of starts, with its interval, nan where a neighbour is
    nearer than rounding; `alpha` and `dimension`
    with theirs, nan if less than three distances have more than 10 uncertain starts; over
    family `basin` (measure i adds 2^i if it holds, -1 for what is left out), and over number
    too `start`

Raises
------
OptionError
    for a measure that is no p(...)
SceneError
    if nothing in the scene is drawn, or if an effect is random

Examples
--------
Spun one way or the other: the boundary is a point of the line, of dimension 0.

>>> start = rm.Start(omega=(0.0, 0.0, rm.uniform(-1.0, 2.0)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> found = rm.basins(scene, "p(omega_last[3] >= 0)", 8000, dt=0.1, t_end=0.1)
>>> bool(found.dimension_low < 0.0 < found.dimension_high)
True
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtri

from rigidmc.errors import OptionError
from rigidmc.planning.initial import members_at_start, uncertain_numbers
from rigidmc.results.intervals import Interval, probability, resolution_of
from rigidmc.results.labels import count_text
from rigidmc.results.measures import Measure, Variables, measure
from rigidmc.results.variables import variables_of
from rigidmc.scene.sampling import DISTANCES, NeighbourFamilies
from rigidmc.scene.scene import Scene
from rigidmc.studies.framework.members import (
    TUNING,
    Batches,
    Members,
    drawn_families,
    refuse_noise,
    start_numbers,
)
from rigidmc.studies.framework.options import (
    REQUIRED,
    Example,
    Options,
    Words,
    confidence_option,
    option,
)
from rigidmc.studies.framework.study import Study

Array = NDArray[np.float64]
SAMPLE = 64  # families for each number, by which distances are compared with rounding
RESOLVED = 8.0  # resolutions: a distance is then known to an eighth
LEAST = 10  # uncertain families that make a share worth a place in the fit


class BasinOptions(Options):
    """What `basins` may be asked."""

    of: Words = option(
        REQUIRED,
        'what tells the basins apart: "p(omega_last[3] >= 0)"; may be repeated',
        more="with several such measures a member ends otherwise if one of them tells otherwise",
        metavar="MEASURE",
    )
    families: int = option(4096, "how many starts; each has 12 neighbours", is_new=True)
    confidence: float = confidence_option("of the intervals")


def scene_of_neighbours(scene: Scene, options: BasinOptions, settings: Mapping[str, Any]) -> Scene:
    """The scene with the members of the study; raises for what has no basins."""
    refuse_noise(scene)
    scene = drawn_families(scene, options.of, "neighbours", options.families)
    for text in options.of:
        _share_of(text, variables_of(scene))
    return scene


def exponent(uncertain: NDArray[np.bool_], largest: float, confidence: float = 0.95) -> Interval:
    """alpha with its interval, from whether families are uncertain at each of DISTANCES.

    uncertain : (distances, families);  largest : the share if ends were independent of starts

    The interval is that of the shares to first order in their errors, which are not independent:
    those of all distances are of the same families.
    """
    count = uncertain.shape[1]
    share = uncertain.sum(axis=1) / max(1, count)
    if (_weights(share, count, largest) > 0.0).sum() < 3:
        return Interval(math.nan, math.nan, math.nan)
    value, step = _slope(share, count, largest), 1e-6
    slopes = [
        _slope(share * (1.0 + step * one), count, largest)
        - _slope(share * (1.0 - step * one), count, largest)
        for one in np.eye(share.size)
    ]
    rates = np.array(slopes) / (2.0 * step * np.maximum(share, 1.0 / count))
    each = rates @ (uncertain - share[:, None])
    half = float(ndtri(0.5 + 0.5 * confidence) * each.std() / math.sqrt(count))
    return Interval(value, value - half, value + half)


def _weights(share: Array, count: int, largest: float) -> Array:
    """The weights of the distances in the fit, smooth in the shares.

    Least variance asks for share/(1 - share), where the largest shares decide; its root gives the
    small ones their say, since the shares of a fractal waver about the line. They fade where a
    distance mixes everything, and below 2 LEAST uncertain families.
    """
    many = np.clip(share * count / LEAST - 1.0, 0.0, 1.0)
    # shares are pure: 1e-300 stands for 0
    far = np.maximum(1.0 - share / max(largest, 1e-300), 0.0) ** 2
    odds: Array = share / np.maximum(1.0 - share, 1e-300)  # pure, as above
    weights: Array = np.sqrt(odds) * far * many
    return weights


def _slope(share: Array, count: int, largest: float) -> float:
    """The slope of the line through the logarithms of shares and distances."""
    weight, logs = _weights(share, count, largest), np.log(DISTANCES)
    apart = weight * (logs - (weight * logs).sum() / weight.sum())
    # a share is pure; 0, which has no weight, has no logarithm either
    return float((apart * np.log(np.maximum(share, 1e-300))).sum() / (apart * logs).sum())


def fitted_line(study: xr.Dataset) -> Array:
    """The line of a study, whose slope is alpha, at its distances."""
    share = np.nan_to_num(study.uncertain.values)  # nan where rounding decides
    count = int((study.basin.values >= 0).sum())
    weight, logs = _weights(share, count, study.attrs["largest"]), np.log(study.distance.values)
    # as in `_slope`
    middle = (weight * np.log(np.maximum(share, 1e-300))).sum() / weight.sum()
    found: Array = np.exp(
        middle + float(study.alpha) * (logs - (weight * logs).sum() / weight.sum())
    )
    return found


def is_resolved(scene: Scene) -> NDArray[np.bool_]:
    """Whether neighbours at each of DISTANCES differ from their member by more than rounding, in 95
    of 100 families of a scene: RESOLVED times the resolution of what these are made from.

    An end beyond says nothing of the distance: in float32 the nearest neighbours have the same
    start, and none would ever be uncertain.
    """
    size, groups_of = NeighbourFamilies.size, len(uncertain_numbers(scene.model)[0])
    _, start = members_at_start(scene.model, scene.run, 0, SAMPLE * groups_of * size)
    apart = np.zeros((SAMPLE * groups_of, size))
    for name, values in start.items():
        if name == "start_euler":  # start_attitude has it
            continue
        families = np.atleast_2d(values).reshape(-1, *apart.shape)
        length = np.sqrt((families[..., 0] ** 2).sum(axis=0))
        moved = np.sqrt(((families - families[..., :1]) ** 2).sum(axis=0))
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.fmax(apart, np.nan_to_num(moved / length[:, None]))
    told: NDArray[np.bool_] = (apart[:, 1:] > RESOLVED * resolution_of(scene)).mean(axis=0) > 0.95
    return told


def _share_of(text: str, variables: Variables, may_save_more: bool = True) -> Measure:
    """The Measure of a text; OptionError unless it has two answers."""
    asked = measure(text, variables, may_save_more)
    if asked.kind != "p":
        rule = 'does not tell two basins apart: take p(NAME >= NUMBER), as "p(omega_last[3] >= 0)"'
        raise OptionError(rule, at="of", value=text)
    return asked


def _ends(part: xr.Dataset, measures: Sequence[Measure]) -> Array:
    """Where members end (n,): 2^i for each measure i that holds; nan for those that are flagged or
    have no value."""
    ends: Array = np.sum([one.numbers(part) * 2.0**i for i, one in enumerate(measures)], axis=0)
    return ends


def reduce(batches: Batches, options: BasinOptions) -> xr.Dataset:
    """The Dataset of the study of members. Families of which some members are not there, in a run
    that has not ended, are left out."""
    scene, confidence = batches.scene, options.confidence
    known, may_save_more = batches.variables, batches.stored is None
    measures = [_share_of(text, known, may_save_more) for text in options.of]
    names, dimensions = uncertain_numbers(scene.model)
    size = NeighbourFamilies.size
    count = -(-(scene.run.first + scene.run.members) // size)
    ends, start = np.full(count * size, np.nan), np.full((count, len(names)), np.nan)
    units = ["1"] * len(names)
    for part in batches.results:
        member = part.member.values
        ends[member] = _ends(part, measures)
        own = member % size == 0
        for i, name in enumerate(names):
            values, units[i] = start_numbers(part, name)
            start[member[own] // size, i] = values[own]
    families = ends.reshape(count, size)
    there = np.isfinite(families).all(axis=1)
    uncertain = (families[there, 1:] != families[there, :1]).T
    _, each = np.unique(families[there, 0], return_counts=True)
    told = is_resolved(scene)
    uncertain &= told[:, None]
    largest = 1.0 - float(((each / max(1, there.sum())) ** 2).sum())
    alpha, d = exponent(uncertain, largest, confidence), len(dimensions)
    found = probability(uncertain.sum(axis=1), uncertain.shape[1], confidence)
    shares = Interval(*(np.where(told, x, np.nan) for x in found))
    variables: dict[str, Any] = {}
    for key, text, dims, found in (
        ("uncertain", "share of starts that end otherwise nearby", ("distance",), shares),
        ("alpha", "exponent of the share", (), alpha),
        ("dimension", "dimension of the boundary", (), Interval(*(d - x for x in _turned(alpha)))),
    ):
        for end, value in zip(("", "_low", "_high"), found, strict=True):
            variables[key + end] = dims, value, {"long_name": text, "units": "1"}
    basin = np.where(there, families[:, 0], -1.0).astype(int)
    variables["basin"] = "family", basin, {"long_name": "where the first member ends"}
    about = {"long_name": "number of the first member"}
    variables["start"] = ("family", "number"), start, about
    distance = ("distance", np.array(DISTANCES), {"long_name": "distance in probability"})
    coordinates = {"distance": distance, "number": names, "units": ("number", units)}
    attrs = {
        "title": scene.title,
        "of": [one.text for one in measures],
        "confidence": confidence,
        "members": int(scene.run.members),
        "numbers": d,
        "largest": largest,
        "unresolved": int((~told).sum()),
        "left_out": int((~there).sum()),
        "scene": scene.dumps(),
    }
    return xr.Dataset(variables, coordinates, attrs)


def _turned(found: Interval) -> Interval:
    """The interval of a number whose sign is turned afterwards: its ends change places."""
    return Interval(found.value, found.high, found.low)


def basin_names(study: xr.Dataset) -> dict[int, str]:
    """{basin: what the measures tell of it}, of the basins in which a start has ended."""
    texts = [of.strip().removeprefix("p(").removesuffix(")") for of in np.atleast_1d(study.of)]
    return {
        int(one): ", ".join(
            text if int(one) >> i & 1 else f"not {text}" for i, text in enumerate(texts)
        )
        for one in np.unique(study.basin.values)
        if one >= 0
    }


def table(study: xr.Dataset) -> list[str]:
    """The study in lines of text."""
    basin = study.basin.values
    counts = int((basin >= 0).sum())
    lines = [f"{study.attrs['title']}: {count_text(counts, 'start')}, each with 12 neighbours"]
    for one, text in basin_names(study).items():
        lines.append(f"  {(basin == one).sum() / counts:7.1%} end with {text}")
    lines.append(f"  {'distance':>10s}  uncertain")
    for k in np.flatnonzero(study.uncertain.notnull().values):
        share, low, high = (float(study[f"uncertain{end}"][k]) for end in ("", "_low", "_high"))
        lines.append(f"  {float(study.distance[k]):10.3g}  {share:.4f} ({low:.4f} to {high:.4f})")
    if math.isnan(float(study.alpha)):
        lines.append("  too few distances with uncertain starts for an exponent: add families")
    else:
        lines += [
            f"  {word} = {float(study[key]):.3f} ({float(study[f'{key}_low']):.3f} to"
            f" {float(study[f'{key}_high']):.3f})"
            for word, key in (
                ("alpha", "alpha"),
                (f"dimension of the boundary, {study.attrs['numbers']} - alpha,", "dimension"),
            )
        ]
    if rounded := study.attrs["unresolved"]:
        lines.append(
            f"  distances left out, at which neighbours differ by rounding alone: {rounded}"
        )
    if left := study.attrs["left_out"]:
        why = "with a member that is flagged, has no value or is not there"
        lines.append(f"  families left out, {why}: {left:,}")
    return lines


basins = Study(
    name="basins",
    text=__doc__,
    options=BasinOptions,
    work=Members(scene_of_neighbours, reduce, batch=2**17, points="neighbours"),
    table=table,
    picture="basins_and_shares",
    settings=TUNING,
    scene_text="what is run, until members have come to an attractor; its distributions are the"
    " space",
    example=Example(
        "damped_dzhanibekov",
        {"of": "p(omega_last[1] >= 0)", "families": 16},
        {"t_end": 20.0},
    ),
)
