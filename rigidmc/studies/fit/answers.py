"""The answers of a fit: the distinct minima in which its trials end.

Trials begin with few readings of the first turns, whose cost has few false minima, and where they
end begins the fit of a longer part. Source: Pisarenko & Sornette, Phys. Rev. E 69 (2004) 036122.
"""

from functools import cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigidmc.engine.kernel.normal_equations import ATTITUDE
from rigidmc.runs.prepare import prepare_scene
from rigidmc.studies.fit.parameters import MOMENTS
from rigidmc.studies.fit.problem import FitProblem, Sums
from rigidmc.studies.fit.solve import KEPT, Solution, minimise
from rigidmc.studies.fit.starts import SPINS
from rigidmc.studies.fit.streams import Array, Stream
from rigidmc.studies.fit.suspicions import BETTER, RIGHT
from rigidmc.studies.fit.uncertainty import Assessment

FIRST, SAMPLES = 64, 128  # saves of the first part, about 16 rad; its readings for many trials
LEAST = 5  # readings of the first part, for each parameter: with fewer, any body fits
FAR = np.log(2.0)  # of ln(moment/first guess), which an error of 10 % never is
FALSE = 1e3  # growth from which on a minimum may well be false
FAILED = 0.25  # of the changes of readings: false minima leave .35, a frisbee without lift .14
FAST = 100.0  # growth of a change over a part, from which on the next is longer by 1/4, not 1/2
HOPELESS = 100.0  # excess of the cost, in variances of a residual: ten standard deviations
MOST = 20  # answers kept
ALIKE = 0.01  # of the variance of a residual: a tenth of a standard deviation
SAME = 1.0  # squared distance, in standard deviations, up to which two minima are one


def best_of(problem: FitProblem, solution: Solution) -> int:
    """Return the first trial of the least cost: the first guess, where it ends there, has the size
    of the scene's moments, which rates do not show."""
    cost = solution.sums.cost
    least = float(cost.min())
    return int(np.argmax(cost <= least + ALIKE * least / max(1, problem.residuals)))


def upright(problem: FitProblem, solution: Solution) -> Solution:
    """Return the trials with their axes named so that the sensors turn least.

    A body with its axes renamed and its sensor turned back, R g and g^T omega, has the same
    readings: 24 trials are one answer. Where a torque tells the axes apart, the cost shows it.
    """
    parameters, x = problem.parameters, np.array(solution.x)
    turned = [c for c in parameters.columns if c.word == "alignment"]
    if not turned:
        return solution
    group = Rotation.create_group("O")
    first = Rotation.from_rotvec(x[:, parameters.index[0, turned[0].columns]])
    which = np.argmin([(first * g).magnitude() for g in group], axis=0)
    turn = np.rint(group[which].as_matrix())  # exact, so that limits still hold
    for column in parameters.columns:
        for places in parameters.index[: 1 if column.is_shared else None, column.columns]:
            if column.word == "alignment":
                x[:, places] = (Rotation.from_rotvec(x[:, places]) * group[which]).as_rotvec()
            elif column.stream < 0 and column.size == 3 and column.name not in parameters.tied:
                # moments, and rates of the axes that are never below 0, only change places
                is_signed = column.name != MOMENTS and (parameters.low[places] < 0.0).all()
                by = turn if is_signed else np.abs(turn)
                x[:, places] = np.einsum("tji,tj->ti", by, x[:, places])
    some = np.flatnonzero((x != solution.x).any(1) & np.isfinite(solution.sums.cost))
    if not some.size:
        return solution
    sums = problem.sums(x[some])
    same = sums.cost <= solution.sums.cost[some] * (1.0 + 1e-6)
    for old, new in zip((solution.x, *solution.sums), (x[some], *sums), strict=True):
        old[some[same]] = new[same]
    return solution


def doubts(problem: FitProblem, solution: Solution, found: Assessment) -> list[str]:
    """Return what else the readings allow beside the first answer, in sentences."""
    x, cost, told = solution.x[0], float(solution.sums.cost[0]), list[str]()
    if problem.parameters.mixed:
        guess = problem.parameters.nominal[MOMENTS]
        if any(c.word == "alignment" for c in problem.parameters.columns):  # renames axes
            guess = np.sort(guess)[np.argsort(np.argsort(problem.parameters.values(x)[:3]))]
        told = _far(problem, x, guess, found) + _mirrored(problem, x, guess, cost)
    changed, changes = growth(problem, x), float(problem.residuals)
    for s in problem.streams:
        noise = 0.5 * s.noise.mean() if s.kind == ATTITUDE else s.noise
        read = np.ma.masked_invalid((s.values / noise).reshape(-1, s.values.shape[2]))
        changes += float(np.sum(read.anom(0) ** 2))
    left = np.sqrt(cost / changes)
    if cost > 4.0 * problem.residuals and (changed > FALSE or left > FAILED):
        told.append(
            f"no motion fits: residuals are {left:.2g} of the changes of readings, and changes of"
            f" the motion grow {changed:.2g}-fold. In a false minimum all numbers are wrong: try"
            " more --trials, or a shorter part by --between"
        )
    return told


def _far(problem: FitProblem, x: Array, guess: Array, found: Assessment) -> list[str]:
    """Return a sentence about a moment that is shown to be far from its first guess."""
    moments, of = problem.parameters.values(x)[:3], ""
    change, slopes = np.log(moments / guess), problem.parameters.slopes(x)[:3] / moments[:, None]
    if found.shown.hides(slopes).all():
        change, slopes, of = change - change.mean(), slopes - slopes.mean(0), "beside the others, "
    width = np.sqrt(((slopes @ found.covariance) * slopes).sum(1))
    far = np.where(found.shown.hides(slopes), 0.0, np.abs(change) - 2.0 * width)
    i = int(far.argmax())
    text = f"{of}{MOMENTS}.{i + 1} is {np.exp(change[i]):.3g} times its first guess: wrong units?"
    return [text] if far[i] > FAR else []


def _mirrored(problem: FitProblem, x: Array, guess: Array, cost: float) -> list[str]:
    """Return a sentence about the body of a left-handed sensor, if first guesses do not exclude it.

    Another body has the reversed rates: the coefficients a_1 = (I_2 - I_3)/I_1, ... of Euler's
    equations change their signs for the moments 1 + a_2, 1 - a_1, 1 + a_1 a_2.
    """
    parameters = problem.parameters
    i, j, k = moments = parameters.values(x)[:3]
    a, b = (j - k) / i, (k - i) / j
    y, other = np.array(x), np.array([1.0 + b, 1.0 - a, 1.0 + a * b])
    other *= moments.sum() / other.sum()
    orders = np.array(list(permutations(other)))  # of swapped columns
    here, there, change = (
        3.0 * np.var(np.log(u / v), -1).min()
        for u, v in ((moments, guess), (orders, guess), (other, moments))
    )
    is_open = there < BETTER * max(RIGHT**2, here) and change > 1e-4  # 1 %
    if not is_open or any(s.kind == ATTITUDE for s in problem.streams):
        return []
    y[:3] = parameters.coordinates({MOMENTS: other})[:3]
    for column in parameters.columns:
        if column.name in SPINS or column.word == "bias":
            y[parameters.index[:, column.columns]] *= -1.0
    streams = [s._replace(values=-s.values) for s in problem.streams]
    mirrored = FitProblem(problem.run, parameters, streams, problem.threads, problem.loss)
    ratios = " : ".join(f"{one:.4g}" for one in other / other[2])
    text = f"if the sensor is left-handed (a column negated, two swapped), moments are as {ratios}"
    return [text] if mirrored.sums(y[None]).cost[0] <= cost * (1.0 + 1e-6) else []


def grown(problem: FitProblem, x: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return (trials that begin the fit of the whole record, number of the x that lead to each)."""
    total, saves = problem.run.layout.axes.times.size - 1, FIRST
    ends = np.ones(x.shape[0], np.int64)
    while (part := part_of(problem, min(saves, total), x.shape[0] > KEPT)) is not problem:
        if part.residuals < LEAST * part.parameters.size and saves < total:
            saves *= 2
            continue
        solution = upright(part, minimise(part, x, ends))
        # a part may show too little for a trial to settle
        solution = solution._replace(is_settled=np.isfinite(solution.sums.cost))
        x, _, _, ends = merged(part, solution)
        if saves >= total:
            break
        saves += saves // (4 if growth(part, x[0]) > FAST else 2)
    return x, ends


def part_of(problem: FitProblem, saves: int, is_thin: bool) -> FitProblem:
    """Return the problem of the first saves, with all or some of their readings; or itself, if
    these are all."""
    end, streams, is_whole = saves * problem.every, list[Stream](), True
    for stream in problem.streams:
        inside = np.count_nonzero(stream.times <= end * (1.0 + 1e-9), axis=1).max()
        some = slice(0, max(1, inside), max(1, inside // SAMPLES) if is_thin else 1)
        few = stream._replace(times=stream.times[:, some], values=stream.values[:, some])
        is_whole &= few.times.shape == stream.times.shape
        streams.append(few)
    if is_whole:
        return problem
    run = prepare_scene(problem.run.scene.with_run(t_end=end))
    return FitProblem(run, problem.parameters, streams, problem.threads, problem.loss)


def growth(problem: FitProblem, x: Array) -> float:
    """Return how much more the parameters of the motion change a reading at any time than one in
    the first tenth of the record."""
    moving = problem.parameters.index[:, : problem.parameters.moving].ravel()
    slopes = np.abs(problem.jacobian(x)[1][:, moving])
    times = problem.samples_in_order()[0]
    early = slopes[times <= 0.1 * times.max()].max(0, initial=0.0)
    return float((slopes.max(0) / np.where(early > 0.0, early, np.inf)).max())


def merged(problem: FitProblem, solution: Solution) -> Solution:
    """Return the distinct minima among the trials, the best first.

    A minimum that contradicts the data does not count. Two trials are one answer if the step
    between them changes the residuals by less than their noise: d^T N d <= variance, to first
    order, or as computed. Steps along what the data do not show change nothing, however long.
    """
    x, (matrix, _, cost), ends = solution.x, solution.sums, np.zeros_like(solution.ends)
    best, left = best_of(problem, solution), list[int]()
    # of a weighted residual
    variance = float(cost[best]) / max(1, problem.residuals - problem.parameters.size)
    residuals = cache(lambda i: problem.jacobian(x[i])[0])
    for i in (best, *(int(i) for i in np.argsort(cost, kind="stable") if i != best)):
        if not cost[i] <= cost[best] + HOPELESS * variance:
            break
        for j in left:
            step = x[i] - x[j]
            is_same = step @ matrix[j] @ step <= SAME * variance
            if is_same or np.sum((residuals(i) - residuals(j)) ** 2) <= SAME * variance:
                ends[j] += solution.ends[i]
                break
        else:
            if len(left) < MOST and (solution.is_settled[i] or not left):
                left.append(i)
                ends[i] = solution.ends[i]
    sums = Sums(*(part[left] for part in solution.sums))
    return Solution(x[left], sums, solution.is_settled[left], ends[left])
