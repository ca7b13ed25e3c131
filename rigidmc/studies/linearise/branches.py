"""Continuation: steady motions followed along one parameter of a scene, and their bifurcations.

At each value of a grid Newton's method starts from the motions at the last value, and from new
random attitudes. A branch that the search meets late is followed back, so
that every branch ends where its motion ends, at a fold or at another branch. Changes of stability
and ends are then bisected.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.studies.linearise.motions import Motion, Problem, distinct, is_same

Array = NDArray[np.float64]
HALVINGS = 32  # of an interval of the grid, where stability changes
END_HALVINGS = 16  # where a branch ends: its motions are known to the root of the step there
FAR = 0.5  # rad, or relative change of the momentum: a larger step leaves the branch
SMALLER = 3  # halvings of a step that fails
MOVED = 1e-3  # of a step, from a value of more symmetry
GAIN, END = "stability", "end"


class Branch(NamedTuple):
    """A steady motion at the values of the grid, None where it does not exist."""

    motions: list[Motion | None]


class Bifurcation(NamedTuple):
    """Where the stability of a branch changes, or the branch ends.

    kind : "stability" or "end";  branch : its number
    value : of the parameter
    frequency : of the eigenvalue that crosses [rad/s], 0 if it passes 0; nan for ends
    growing : numbers of growing changes below and above the value
    """

    kind: str
    branch: int
    value: float
    frequency: float
    growing: tuple[int, int]


Solve = Callable[[float], Problem]


def follow(
    problem_at: Solve, values: Array, starts: int, tell: Callable[[int], None]
) -> tuple[Array, list[Branch], list[Bifurcation]]:
    """Return (values, branches, bifurcations) of the steady motions at values of a parameter.

    A value that is more symmetric than its neighbours is moved by 1e-3 of a step: there the
    momenta that are held, and the motions that count as one, are others.

    problem_at : value -> Problem;  starts : of the search at each value;  tell : called with the
    number of finished values
    """
    problems = [problem_at(float(value)) for value in values]
    usual, values = min(len(p.found.generators) for p in problems), values.copy()
    for k, problem in enumerate(problems):
        if len(problem.found.generators) > usual:
            values[k] += MOVED * (values[k - 1] - values[k] if k else values[1] - values[0])
            problems[k] = problem_at(float(values[k]))
    branches: list[Branch] = []
    for k, problem in enumerate(problems):
        before = [b.motions[k - 1] if k else None for b in branches]
        tracked = _tracked(problem, before)
        _drop_merged(tracked)
        for i, old in enumerate(before):
            if old is not None and tracked[i] is None:
                ends = float(values[k - 1]), float(values[k])
                tracked[i] = _by_halves(problem_at, *ends, old, SMALLER)
        _drop_merged(tracked)
        for branch, motion in zip(branches, tracked, strict=True):
            branch.motions.append(motion)
        alive = [motion for motion in tracked if motion is not None]
        for motion in distinct([*alive, *problem.solved(problem.starts(starts))])[len(alive) :]:
            branches.append(Branch([*[None] * k, motion]))
        tell(k + 1)
    _follow_back(problems, branches)
    found = []
    for number, branch in enumerate(branches):
        others = branches[:number] + branches[number + 1 :]
        for k in range(len(values) - 1):
            below, above = branch.motions[k : k + 2]
            low, high = float(values[k]), float(values[k + 1])
            if below is not None and above is not None:
                if below.growing != above.growing:
                    found.append(_change(problem_at, low, high, below, above, number))
            elif below is not None:
                beside = [b.motions[k] for b in others]
                found.append(_end(problem_at, low, high, below, beside, number))
            elif above is not None:
                beside = [b.motions[k + 1] for b in others]
                found.append(_end(problem_at, high, low, above, beside, number))
    return values, branches, sorted(found, key=lambda one: one.value)


def _tracked(problem: Problem, before: Sequence[Motion | None]) -> list[Motion | None]:
    """Return the motions that continue those at a neighbouring value."""
    known = [(i, motion) for i, motion in enumerate(before) if motion is not None]
    after: list[Motion | None] = [None] * len(before)
    solved = problem.solved(problem.states_of([motion.guess for _, motion in known]))
    for (i, old), new in zip(known, solved, strict=True):
        after[i] = new if new is not None and _is_near(old, new) else None
    return after


def _by_halves(
    problem_at: Solve, start: float, end: float, motion: Motion, depth: int
) -> Motion | None:
    """Return the motion that continues one from a value to another, in steps that are halved where
    they fail, or None."""
    middle, at = 0.5 * (start + end), start
    for value in (middle, end):
        (new,) = _tracked(problem_at(value), [motion])
        if new is None and depth:
            new = _by_halves(problem_at, at, value, motion, depth - 1)
        if new is None:
            return None
        motion, at = new, value
    return motion


def _is_near(old: Motion, new: Motion) -> bool:
    """Return whether two motions at neighbouring values may be one."""
    (q, l), (p, m) = old.guess, new.guess
    size = float(max(np.linalg.norm(l), np.linalg.norm(m)))
    turned = 2.0 * np.arccos(min(1.0, abs(float(q @ p))))
    unit = old.known.moment * old.known.rate
    return bool(turned < FAR and np.linalg.norm(l - m) < FAR * (size + 1e-6 * unit))


def _drop_merged(motions: list[Motion | None]) -> None:
    """Replace by None each motion that is the same as one before it."""
    for i, motion in enumerate(motions):
        others = motions[:i]
        if motion is not None and any(o is not None and is_same(o, motion) for o in others):
            motions[i] = None


def _follow_back(problems: Sequence[Problem], branches: Sequence[Branch]) -> None:
    """Continue branches that were met late towards smaller values."""
    for number, branch in enumerate(branches):
        first = next(k for k, motion in enumerate(branch.motions) if motion is not None)
        for k in range(first - 1, -1, -1):
            (motion,) = _tracked(problems[k], [branch.motions[k + 1]])
            others = [b.motions[k] for i, b in enumerate(branches) if i != number]
            if motion is None or any(o is not None and is_same(o, motion) for o in others):
                break
            branch.motions[k] = motion


def _end(
    problem_at: Solve,
    inside: float,
    outside: float,
    motion: Motion,
    others: Sequence[Motion | None],
    number: int,
) -> Bifurcation:
    """Return the end of a branch between a value where it exists and one where it does not.

    others : the motions of the other branches where it exists
    """
    is_last = outside > inside
    for _ in range(END_HALVINGS):
        middle = 0.5 * (inside + outside)
        new, *beside = _tracked(problem_at(middle), [motion, *others])
        if new is None or any(o is not None and is_same(o, new) for o in beside):
            outside = middle
        else:
            inside, motion, others = middle, new, beside
    growing = (motion.growing, 0) if is_last else (0, motion.growing)
    return Bifurcation(END, number, 0.5 * (inside + outside), np.nan, growing)


def _change(
    problem_at: Solve, low: float, high: float, below: Motion, above: Motion, number: int
) -> Bifurcation:
    """Return where the number of growing changes of a branch changes between two values."""
    first, last = below.growing, above.growing
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        (motion,) = _tracked(problem_at(middle), [below])
        if motion is None:
            break
        if motion.growing == first:
            low, below = middle, motion
        else:
            high, above = middle, motion
    more = above if last > first else below
    leaving = more.motion_values[int(more.motion_values.real.argmax())]
    turning = float(abs(leaving.imag)) * more.known.rate if abs(leaving.imag) > 1e-3 else 0.0
    return Bifurcation(GAIN, number, 0.5 * (low + high), turning, (first, last))
