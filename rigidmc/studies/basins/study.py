"""Measure how often a small change of the start changes the end of a member, and the dimension
of the boundary between basins of attraction.

A start is uncertain at a distance epsilon if a start perturbed by epsilon ends in another basin.
The fraction f of uncertain starts falls as a power of the distance. In the space of the d
parameters that a member draws, the boundary has the (box) dimension D::

    f ~ epsilon^alpha,   D = d - alpha

alpha is 1 for a smooth boundary. It is smaller for a fractal boundary: there a more accurate start
hardly helps. Distances are measured in probability (for a uniform distribution, as fractions of
its range), along one parameter after the other, see `rigidmc.scene.sampling.NeighbourFamilies`.
alpha is the slope of a line through the logarithms. Source: McDonald, Grebogi, Ott & Yorke,
Physica D 17 (1985) 125.

{parameters}

{returns}

Raises
------
OptionError
    for a measure that is not a p(...)
SceneError
    if nothing in the scene is drawn, or if an effect is random

Examples
--------
A disc spins one way or the other: the boundary is a point on the line, of dimension 0.

>>> start = rm.Start(omega=(0.0, 0.0, rm.uniform(-1.0, 2.0)))
>>> scene = rm.Scene(rm.Body((1.0, 1.0, 2.0)), start=start)
>>> study = rm.basins(scene, "p(omega_last[3] >= 0)", 8000, dt=0.1, t_end=0.1)
>>> bool(study.dimension_low < 0.0 < study.dimension_high)
True
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import ndtri

from rigidmc.errors import OptionError
from rigidmc.inputs.arrays import Array, Bools
from rigidmc.planning.initial import members_at_start, uncertain_numbers
from rigidmc.results.labels import count_text
from rigidmc.results.variables import variables_of
from rigidmc.scene.model import Model
from rigidmc.scene.sampling import DISTANCES, NeighbourFamilies
from rigidmc.scene.scene import Scene
from rigidmc.scene.settings import Run
from rigidmc.statistics.intervals import Interval, probability, resolution_of
from rigidmc.statistics.measures import Measure, Variables, measure
from rigidmc.studies.framework.members import (
    TUNING,
    Batches,
    Members,
    drawn_families,
    refuse_noise,
    start_numbers,
)
from rigidmc.studies.framework.options import REQUIRED, Options, Words, confidence_option, option
from rigidmc.studies.framework.study import Example, Study
from rigidmc.studies.framework.variables import StudyVariable, interval_of, make_dataset

SAMPLE = 64  # families for each parameter, to compare distances with rounding
RESOLVED = 8.0  # least distance, in units of the resolution: it is then known to an eighth
LEAST = 10  # a fraction counts in the fit above this number of uncertain families
VARIABLES = (
    StudyVariable(
        "uncertain", "distance", "1", "uncertain fraction of starts",
        "nan where a perturbation is below rounding", has_interval=True,
    ),
    StudyVariable(
        "alpha", "", "1", "exponent of the uncertain fraction",
        "nan if fewer than three distances have more than 10 uncertain starts", has_interval=True,
    ),
    StudyVariable("dimension", "", "1", "dimension of the boundary", has_interval=True),
    StudyVariable(
        "basin", "family", "", "basin in which the first member ends",
        "measure i adds 2^i if it holds; -1 for families left out",
    ),
    StudyVariable("start", "family number", "", "parameter of the first member"),
)  # fmt: skip


class BasinOptions(Options):
    """The options of `basins`."""

    of: Words = option(
        REQUIRED,
        'measure that distinguishes the basins, such as "p(omega_last[3] >= 0)"; may be repeated',
        more="with several measures, two members end in different basins if any measure differs",
        metavar="MEASURE",
    )
    families: int = option(4096, "number of starts; each is perturbed 12 times", is_new=True)
    confidence: float = confidence_option("confidence level of the intervals")


def scene_of_neighbours(scene: Scene, options: BasinOptions, settings: Mapping[str, Any]) -> Scene:
    """Return the scene with the members of the study; raises for a scene without basins."""
    refuse_noise(scene.effects)
    scene = drawn_families(scene, options.of, "neighbours", options.families)
    for text in options.of:
        _share_of(text, variables_of(scene))
    return scene


def exponent(uncertain: Bools, largest: float, confidence: float = 0.95) -> Interval:
    """Return alpha with its interval, from the families that are uncertain at each of DISTANCES.

    uncertain : (distances, families);  largest : the fraction if ends did not depend on starts

    The interval follows to first order from the errors of the fractions, which are correlated:
    all distances use the same families.
    """
    count = uncertain.shape[1]
    share = uncertain.sum(axis=1) / max(1, count)
    if (_weights(share, count, largest) > 0.0).sum() < 3:
        return Interval(math.nan, math.nan, math.nan)
    # central differences: their rates agree to 6 digits for steps of 1e-3 to 1e-7 of a fraction
    value, step = _slope(share, count, largest), 1e-6
    slopes = [
        _slope(share * (1.0 + step * at), count, largest)
        - _slope(share * (1.0 - step * at), count, largest)
        for at in np.eye(share.size)
    ]
    rates = np.array(slopes) / (2.0 * step * np.maximum(share, 1.0 / count))
    # Each family's pull on alpha: its standard deviation contains the correlation of the distances.
    each = rates @ (uncertain - share[:, None])
    half = float(ndtri(0.5 + 0.5 * confidence) * each.std() / math.sqrt(count))
    return Interval(value, value - half, value + half)


def _weights(share: Array, count: int, largest: float) -> Array:
    """Return the weights of the distances in the fit, smooth in the fractions `share`.

    Least variance requires share/(1 - share), which the largest fractions dominate. Its root gives
    small fractions more weight, since the fractions of a fractal oscillate about the line. Weights
    vanish where a fraction reaches `largest`, and fall to 0 between 2 LEAST and LEAST uncertain
    families.
    """
    # Of 300 studies of a Cantor set with 4,096 families, 94 % of the intervals contain alpha; 90 %
    # without the root, and 83 % without `far`, because fractions level off at `largest`.
    many = np.clip(share * count / LEAST - 1.0, 0.0, 1.0)
    # fractions are dimensionless: 1e-300 stands for 0
    far = np.maximum(1.0 - share / max(largest, 1e-300), 0.0) ** 2
    odds: Array = share / np.maximum(1.0 - share, 1e-300)  # dimensionless, as above
    weights: Array = np.sqrt(odds) * far * many
    return weights


def _slope(share: Array, count: int, largest: float) -> float:
    """Return the slope of the line through the logarithms of fractions and distances."""
    weight, logs = _weights(share, count, largest), np.log(DISTANCES)
    apart = weight * (logs - (weight * logs).sum() / weight.sum())
    # a fraction of 0 has no weight; 1e-300 avoids its logarithm
    return float((apart * np.log(np.maximum(share, 1e-300))).sum() / (apart * logs).sum())


def fitted_line(study: xr.Dataset) -> Array:
    """Return the fitted line of a study, with slope alpha, at its distances."""
    share = np.nan_to_num(study.uncertain.values)  # nan at unresolved distances
    count = int((study.basin.values >= 0).sum())
    weight, logs = _weights(share, count, study.attrs["largest"]), np.log(study.distance.values)
    # as in `_slope`
    middle = (weight * np.log(np.maximum(share, 1e-300))).sum() / weight.sum()
    line = middle + float(study.alpha) * (logs - (weight * logs).sum() / weight.sum())
    return np.asarray(np.exp(line))


def is_resolved(model: Model, run: Run) -> Bools:
    """Return for each of DISTANCES whether perturbed starts differ from their member by more than
    rounding, RESOLVED times the resolution of the scene, in 95 of 100 families.

    At an unresolved distance the end is meaningless: in float32 the nearest perturbed starts equal
    the start, and none would be uncertain.
    """
    size, groups_of = NeighbourFamilies.size, len(uncertain_numbers(model)[0])
    _, start = members_at_start(model, run, 0, SAMPLE * groups_of * size)
    apart = np.zeros((SAMPLE * groups_of, size))
    for name, values in start.items():
        # angles jump by 2 pi: attitude and spin, which follow from these inputs, do not
        if name == "start_euler" or name.startswith("start_relative_"):  # others contain them
            continue
        families = np.atleast_2d(values).reshape(-1, *apart.shape)
        length = np.sqrt((families[..., 0] ** 2).sum(axis=0))
        moved = np.sqrt(((families - families[..., :1]) ** 2).sum(axis=0))
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.fmax(apart, np.nan_to_num(moved / length[:, None]))
    return np.asarray((apart[:, 1:] > RESOLVED * resolution_of(run)).mean(axis=0) > 0.95)


def _share_of(text: str, variables: Variables, may_save_more: bool = True) -> Measure:
    """Return the Measure of a text; OptionError unless it has two answers."""
    asked = measure(text, variables, may_save_more)
    if asked.kind != "p":
        rule = "does not distinguish two basins: use p(NAME >= NUMBER)"
        rule += ', as in "p(omega_last[3] >= 0)"'
        raise OptionError(rule, at="of", value=text)
    return asked


def _ends(part: xr.Dataset, measures: Sequence[Measure]) -> Array:
    """Return the basins of members (n,): the sum of 2^i over the measures i that hold; nan for
    members that are flagged or have no value."""
    holds = [measure.numbers(part) for measure in measures]
    return np.asarray(np.sum([x * 2.0**i for i, x in enumerate(holds)], axis=0))


def reduce(batches: Batches, options: BasinOptions) -> xr.Dataset:
    """Return the Dataset of the study of members. Incomplete families of an unfinished run are left
    out."""
    run, model = batches.scene.run, batches.scene.model
    may_save_more = batches.stored is None
    measures = [_share_of(text, batches.variables, may_save_more) for text in options.of]
    names, dimensions = uncertain_numbers(model)
    size = NeighbourFamilies.size
    count = -(-(run.first + run.members) // size)
    ends, start = np.full(count * size, np.nan), np.full((count, len(names)), np.nan)
    units = ["1"] * len(names)
    for part in batches.results:
        member = part.member.values
        ends[member] = _ends(part, measures)
        is_first = member % size == 0
        for i, name in enumerate(names):
            values, units[i] = start_numbers(part, name)
            start[member[is_first] // size, i] = values[is_first]
    families = ends.reshape(count, size)
    there = np.isfinite(families).all(axis=1)
    uncertain = (families[there, 1:] != families[there, :1]).T
    _, sizes = np.unique(families[there, 0], return_counts=True)
    resolved = is_resolved(model, run)
    # a fraction of 0 has no weight in the fit, so an unresolved distance does not count
    uncertain &= resolved[:, None]
    # the chance that two unrelated starts end in different basins: fractions level off there
    largest = 1.0 - float(((sizes / max(1, there.sum())) ** 2).sum())
    alpha, d = exponent(uncertain, largest, options.confidence), len(dimensions)
    shares = probability(uncertain.sum(axis=1), uncertain.shape[1], options.confidence)
    answers: dict[str, Any] = {
        "uncertain": [np.where(resolved, x, np.nan) for x in shares],
        "alpha": alpha,
        "dimension": (d - alpha.value, d - alpha.high, d - alpha.low),
        "basin": np.where(there, families[:, 0], -1.0).astype(int),
        "start": start,
    }
    distance = ("distance", np.array(DISTANCES), {"long_name": "distance in probability"})
    coordinates = {"distance": distance, "number": names, "units": ("number", units)}
    attrs = {
        "of": [of.text for of in measures],
        "confidence": options.confidence,
        "members": int(run.members),
        "numbers": d,
        "largest": largest,
        "unresolved": int((~resolved).sum()),
        "left_out": int((~there).sum()),
    }
    return make_dataset(VARIABLES, answers, coordinates, attrs)


def basin_names(study: xr.Dataset) -> dict[int, str]:
    """Return {basin: the conditions that define it} for the basins in which a start ends."""
    texts = [of.strip().removeprefix("p(").removesuffix(")") for of in np.atleast_1d(study.of)]
    return {
        basin: ", ".join(text if basin >> i & 1 else f"not {text}" for i, text in enumerate(texts))
        for basin in map(int, np.unique(study.basin.values))
        if basin >= 0
    }


def table(study: xr.Dataset) -> list[str]:
    """Return the study as lines of text."""
    basin = study.basin.values
    counts = int((basin >= 0).sum())
    lines = [f"{study.attrs['title']}: {count_text(counts, 'start')}, each perturbed 12 times"]
    for number, text in basin_names(study).items():
        lines.append(f"  {(basin == number).sum() / counts:7.1%} end with {text}")
    lines.append(f"  {'distance':>10s}  uncertain")
    for k in np.flatnonzero(study.uncertain.notnull().values):
        share, low, high = interval_of(study.isel(distance=k), "uncertain")
        lines.append(f"  {float(study.distance[k]):10.3g}  {share:.4f} ({low:.4f} to {high:.4f})")
    if math.isnan(float(study.alpha)):
        lines.append("  too few distances with uncertain starts for an exponent: add families")
    else:
        dimension = f"dimension of the boundary, {study.attrs['numbers']} - alpha,"
        for name, words in (("alpha", "alpha"), ("dimension", dimension)):
            value, low, high = interval_of(study, name)
            lines.append(f"  {words} = {value:.3f} ({low:.3f} to {high:.3f})")
    if rounded := study.attrs["unresolved"]:
        lines.append(
            f"  distances left out because perturbed starts differ by rounding alone: {rounded}"
        )
    if left := study.attrs["left_out"]:
        why = "with a member that is flagged, has no value or is missing"
        lines.append(f"  families left out, {why}: {left:,}")
    return lines


basins = Study(
    name="basins",
    text=__doc__,
    options=BasinOptions,
    work=Members(scene_of_neighbours, reduce, batch=2**17, points="neighbours"),
    table=table,
    variables=VARIABLES,
    picture="basins_and_shares",
    settings=TUNING,
    scene_text="a scene, its file, or the name of a shipped scene, with t_end long enough to reach"
    " an attractor; its distributions span the space",
    example=Example(
        "damped_dzhanibekov", {"of": "p(omega_last[1] >= 0)", "families": 16}, {"t_end": 20.0}
    ),
)
