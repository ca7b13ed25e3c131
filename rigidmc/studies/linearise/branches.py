"""Continuation: steady motions followed along one parameter of a scene, and their bifurcations.

At each value of a grid Newton's method starts from the motions at the last value, and from new
random attitudes. A branch that the search meets late is followed back, so
that every branch ends where its motion ends, at a fold or at another branch. Changes of stability
and ends are then bisected.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from rigidmc.inputs.arrays import Array
from rigidmc.studies.linearise.motions import Problem, SteadyMotion, distinct, is_among

# a steady motion at the values of the grid, None where there is none
Branch = list[SteadyMotion | None]
HALVINGS = 32  # of an interval of the grid, where stability changes
END_HALVINGS = 16  # where a branch ends: its motions are known to the root of the step there
FAR = 0.5  # rad, or relative change of the momentum: a larger step leaves the branch
SMALLER = 3  # halvings of a step that fails
MOVED = 1e-3  # of a step, from a value of more symmetry
# of a step, between an end and the change of stability there; ends are late by up to 1e-3
TOGETHER = 0.02
# largest difference of signatures of branches that meet: they are apart by the root of 2^-16 steps
CLOSE = 0.05
PITCHFORK, TRANSCRITICAL, FOLD = "pitchfork", "transcritical", "fold"
HOPF, HAMILTONIAN_HOPF, ZERO, END = "Hopf", "Hamiltonian Hopf", "zero eigenvalue", "end"


class BranchEvent(NamedTuple):
    """A change of stability of one branch, or its end, before it is known what meets there.

    value : of the parameter;  step : of the grid
    nearest : number of the nearest other branch, -1 without one;  apart : their distance
    frequency : of the eigenvalue that crosses [rad/s], 0 if it passes 0; nan for ends
    growing : numbers of growing changes of the branch below and above the value
    is_last : of an end, whether the branch exists below it
    """

    branch: int
    value: float
    step: float
    nearest: int
    apart: float
    frequency: float
    growing: tuple[int, int]
    is_last: bool = False

    @property
    def is_end(self) -> bool:
        """Whether the branch ends."""
        return bool(np.isnan(self.frequency))

    def is_with(self, other: "BranchEvent") -> bool:
        """Return whether two events may be one bifurcation."""
        return abs(self.value - other.value) < TOGETHER * self.step


class Bifurcation(NamedTuple):
    """Where the stability of a branch changes, or branches begin or end.

    kind : pitchfork, transcritical, fold, Hopf, Hamiltonian Hopf, zero eigenvalue or end
    event : of the branch that goes through, or of the first that ends
    others : numbers of the branches that begin or end there, or cross
    """

    kind: str
    event: BranchEvent
    others: tuple[int, ...]


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
    usual, values = min(len(p.system.generators) for p in problems), values.copy()
    for k, problem in enumerate(problems):
        if len(problem.system.generators) > usual:
            values[k] += MOVED * (values[k - 1] - values[k] if k else values[1] - values[0])
            problems[k] = problem_at(float(values[k]))
    branches: list[Branch] = []
    for k, problem in enumerate(problems):
        before = [b[k - 1] if k else None for b in branches]
        tracked = _tracked(problem, before)
        _drop_merged(tracked)
        for i, old in enumerate(before):
            if old is not None and tracked[i] is None:
                ends = float(values[k - 1]), float(values[k])
                tracked[i] = _by_halves(problem_at, *ends, old, SMALLER)
        _drop_merged(tracked)
        for branch, motion in zip(branches, tracked, strict=True):
            branch.append(motion)
        alive = [motion for motion in tracked if motion is not None]
        # of motions alike the first stays, and known ones come first: the rest begin branches
        for motion in distinct([*alive, *problem.search(starts)])[len(alive) :]:
            branches.append([*[None] * k, motion])
        tell(k + 1)
    _follow_back(problems, branches)
    events = []
    for number, branch in enumerate(branches):
        for k in range(len(values) - 1):
            below, above = branch[k : k + 2]
            at = k if below is not None else k + 1
            beside = [b[at] if i != number else None for i, b in enumerate(branches)]
            low, high = float(values[k]), float(values[k + 1])
            if below is not None and above is not None:
                if below.growing != above.growing:
                    events.append(_change(problem_at, low, high, below, above, beside, number))
            elif below is not None:
                events.append(_end(problem_at, low, high, below, beside, number))
            elif above is not None:
                events.append(_end(problem_at, high, low, above, beside, number))
    is_hamiltonian = all(p.system.is_hamiltonian for p in problems)
    return values, branches, _bifurcations(events, is_hamiltonian)


def _bifurcations(events: Sequence[BranchEvent], is_hamiltonian: bool) -> list[Bifurcation]:
    """Return the bifurcations that changes of stability and ends of branches make up."""
    bifurcations, left = list[Bifurcation](), list(events)

    # Changes of stability first: an end beside one is part of a pitchfork, not of a fold.
    for event in [e for e in events if not e.is_end]:
        if event not in left:
            continue
        met = [e for e in left if e.is_end and e.nearest == event.branch and e.is_with(event)]
        pair = {event.branch, event.nearest}
        crossed = [
            e for e in left
            if not e.is_end and e.frequency == 0.0 == event.frequency and e.apart < CLOSE
            and {e.branch, e.nearest} == pair and e != event and e.is_with(event)
        ]  # fmt: skip
        if event.frequency:
            kind = HAMILTONIAN_HOPF if is_hamiltonian else HOPF
        # one branch ends here, and another begins: they are one branch, which crosses this one
        elif crossed or len({e.is_last for e in met}) == 2:
            kind = TRANSCRITICAL
        else:
            kind = PITCHFORK if met else ZERO
        others = tuple(e.branch for e in (*met, *crossed))
        bifurcations.append(Bifurcation(kind, event, others))
        left = [e for e in left if e not in (event, *met, *crossed)]
    while left:
        event = left.pop(0)
        met = [
            e for e in left
            if e.branch == event.nearest and e.is_last == event.is_last and e.is_with(event)
            and event.apart < CLOSE
        ]  # fmt: skip
        others = tuple(e.branch for e in met)
        if not met and 0.0 <= event.apart < CLOSE:
            others = (event.nearest,)
        bifurcations.append(Bifurcation(FOLD if met else END, event, others))
        left = [e for e in left if e not in met]
    return sorted(bifurcations, key=lambda bifurcation: bifurcation.event.value)


def _tracked(problem: Problem, before: Sequence[SteadyMotion | None]) -> list[SteadyMotion | None]:
    """Return the motions that continue those at a neighbouring value."""
    there = [(i, motion) for i, motion in enumerate(before) if motion is not None]
    after: list[SteadyMotion | None] = [None] * len(before)
    solved = problem.solved(problem.states_of([motion.guess for _, motion in there]))
    for (i, old), new in zip(there, solved, strict=True):
        after[i] = new if new is not None and _is_near(old, new) else None
    return after


def _by_halves(
    problem_at: Solve, start: float, end: float, motion: SteadyMotion, depth: int
) -> SteadyMotion | None:
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


def _is_near(old: SteadyMotion, new: SteadyMotion) -> bool:
    """Return whether two motions at neighbouring values may be one."""
    (q, l), (p, m) = old.guess, new.guess
    size = float(max(np.linalg.norm(l), np.linalg.norm(m)))
    # q and -q are one attitude; the arccosine errs by 1e-8 rad near 0, far below FAR
    turned = 2.0 * np.arccos(min(1.0, abs(float(q @ p))))
    unit = old.system.mechanics.unit
    return bool(turned < FAR and np.linalg.norm(l - m) < FAR * (size + 1e-6 * unit))


def _drop_merged(motions: list[SteadyMotion | None]) -> None:
    """Replace by None each motion that is the same as one before it."""
    for i, motion in enumerate(motions):
        if motion is not None and is_among(motion, motions[:i]):
            motions[i] = None


def _follow_back(problems: Sequence[Problem], branches: Sequence[Branch]) -> None:
    """Continue branches that were met late towards smaller values."""
    for number, branch in enumerate(branches):
        first = next(k for k, motion in enumerate(branch) if motion is not None)
        for k in range(first - 1, -1, -1):
            (motion,) = _tracked(problems[k], [branch[k + 1]])
            others = [b[k] for i, b in enumerate(branches) if i != number]
            if motion is None or is_among(motion, others):
                break
            branch[k] = motion


def _nearest(motion: SteadyMotion, others: Sequence[SteadyMotion | None]) -> tuple[int, float]:
    """Return (number, distance) of the motion nearest to one; (-1, inf) without one."""
    apart = [
        np.inf if o is None else float(np.abs(o.signature - motion.signature).max()) for o in others
    ]
    least = int(np.argmin(apart))
    return (least, apart[least]) if np.isfinite(apart[least]) else (-1, np.inf)


def _end(
    problem_at: Solve,
    inside: float,
    outside: float,
    motion: SteadyMotion,
    others: Sequence[SteadyMotion | None],
    number: int,
) -> BranchEvent:
    """Return the end of a branch between a value where it exists and one where it does not.

    others : the motions of all branches where it exists, None for its own
    """
    is_last, step = outside > inside, abs(outside - inside)
    for _ in range(END_HALVINGS):
        middle = 0.5 * (inside + outside)
        new, *beside = _tracked(problem_at(middle), [motion, *others])
        if new is None or is_among(new, beside):
            outside = middle
        else:
            inside, motion, others = middle, new, beside
    growing = (motion.growing, 0) if is_last else (0, motion.growing)
    value = 0.5 * (inside + outside)
    return BranchEvent(number, value, step, *_nearest(motion, others), np.nan, growing, is_last)


def _change(
    problem_at: Solve,
    low: float,
    high: float,
    below: SteadyMotion,
    above: SteadyMotion,
    others: Sequence[SteadyMotion | None],
    number: int,
) -> BranchEvent:
    """Return where the number of growing changes of a branch changes between two values.

    others : the motions of all branches at the lower value, None for its own
    """
    step, first, last = high - low, below.growing, above.growing
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        motion, *beside = _tracked(problem_at(middle), [below, *others])
        if motion is None:
            break
        if motion.growing == first:
            low, below, others = middle, motion, beside
        else:
            high, above = middle, motion
    more = above if last > first else below
    leaving = more.motion_values[int(more.motion_values.real.argmax())]
    turning = float(abs(leaving.imag))
    turning = turning * more.system.mechanics.rate if turning > 1e-3 else 0.0
    value = 0.5 * (low + high)
    return BranchEvent(number, value, step, *_nearest(below, others), turning, (first, last))
