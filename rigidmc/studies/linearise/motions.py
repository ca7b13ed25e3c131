"""The steady motions of one scene: found from many starts, each listed once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.inputs.arrays import Array, Bools
from rigidmc.scene.model import Model
from rigidmc.scene.settings import Run
from rigidmc.studies.linearise import steady
from rigidmc.studies.linearise.stability import MOTION, Linearised, linearise_motions
from rigidmc.studies.linearise.steady import SOLVED, States
from rigidmc.studies.linearise.system import System, energy_of, find_symmetries, mechanics_of

SAME = 1e-5  # largest difference of signatures of one motion; double roots are found to 1e-7
# largest change of the held momenta, where the motion is more symmetric than the start: a top that
# starts at a tilt of 0.03 rad has L_z - L_3 of half the square, and none when it stands upright
NEAR = 1e-3


class SteadyMotion(NamedTuple):
    """One steady motion, and the linearised motion about it.

    state : with one column;  residual : largest of its equations, in scaled units
    reached : from how many states a search ended here
    signature : see `rigidmc.studies.linearise.steady.signatures`
    """

    system: System
    state: States
    residual: float
    signature: Array
    linear: Linearised
    reached: int = 1

    @property
    def energy(self) -> float:
        """Kinetic plus potential energy [J]."""
        return float(energy_of(self.system.mechanics, self.state.q, self.state.l)[0])

    @property
    def growing(self) -> int:
        """The number of eigenvalues of the motion whose changes grow."""
        return int((self.motion_values.real > self.errors).sum())

    @property
    def motion_values(self) -> NDArray[np.complex128]:
        """The eigenvalues of the motion, in scaled units."""
        return self.linear.values[: self.linear.origins.count(MOTION)]

    @property
    def errors(self) -> Array:
        """The errors of the eigenvalues of the motion."""
        return self.linear.errors[: self.linear.origins.count(MOTION)]

    @property
    def guess(self) -> tuple[Array, Array]:
        """(q (4,), l (3,) [kg m^2/s]), to search from in another scene."""
        mechanics = self.system.mechanics
        return self.state.q[:, 0], self.state.l[:, 0] * mechanics.moment * mechanics.rate


class Problem(NamedTuple):
    """The equations of the steady motions of a scene, and the start of a member."""

    system: System
    q: Array
    l: Array
    held: Array

    @staticmethod
    def of(model: Model, run: Run) -> "Problem":
        """Return the Problem of the first member; SceneError for a model without steady motions."""
        mechanics, q, l = mechanics_of(model, run, run.first)
        system = find_symmetries(mechanics)
        if not len(system.central) and not system.conserves_size:
            # the momentum of the start then does not matter, but would spoil the scales of a slow
            # orbit: of a body that turns 1000 times an orbit, one start in seven finds a motion
            turning = mechanics.rate * float(np.sqrt((system.frame**2).sum()))
            mechanics, q, l = mechanics_of(model, run, run.first, turning)
            system = find_symmetries(mechanics)
        return Problem(system, q, l, steady.held_momenta(system, q[:, None], l[:, None]))

    def states_of(self, guesses: Sequence[tuple[Array, Array]]) -> States:
        """Return the states of guesses (q, l [kg m^2/s])."""
        q, l = (np.array([pair[i] for pair in guesses]).reshape(-1, 4 - i).T for i in (0, 1))
        return steady.with_frames(self.system, q, l / self.system.mechanics.unit)

    def starts(self, count: int) -> States:
        """Return states to search from, that of the member first."""
        return steady.search_starts(self.system, self.q, self.l, count)

    def solved(self, starts: States) -> list[SteadyMotion | None]:
        """Return the steady motion found from each state, None where the search fails."""
        states, left, _ = self._solve(starts)
        good = np.flatnonzero(left < SOLVED)
        motions: list[SteadyMotion | None] = [None] * len(left)
        for i, motion in zip(good, self._motions(states.at(good), left[good]), strict=True):
            motions[i] = motion
        return motions

    def search(self, count: int) -> list[SteadyMotion]:
        """Return the steady motions found from `count` states, each once, in the order found."""
        states, left, is_near = self._solve(self.starts(count))
        good = np.flatnonzero(left < SOLVED)
        if not len(good):
            return []
        states, left, is_near = states.at(good), left[good], is_near[good]
        seen = steady.signatures(self.system, states)
        apart = np.abs(seen[:, None] - seen).max(axis=2)
        same = apart < np.where(is_near[:, None] | is_near, 10.0 * NEAR, SAME)
        # of the states that are one motion, take the first that has the held momenta
        rank = np.arange(len(left)) + len(left) * is_near
        chosen = np.where(same, rank, 3 * len(left)).argmin(axis=1)
        kept = np.array(list(dict.fromkeys(chosen)), np.intp)
        reached = np.bincount(chosen, minlength=len(left))[kept]
        motions = self._motions(states.at(kept), left[kept])
        return [m._replace(reached=int(n)) for m, n in zip(motions, reached, strict=True)]

    def _solve(self, starts: States) -> tuple[States, Array, Bools]:
        """Return (states, residuals) of Newton's method from each state, and which of the states
        are more symmetric than the start, with momenta that are only near those held."""
        count = starts.q.shape[1]
        if not count:
            return starts, np.zeros(0), np.zeros(0, bool)
        states, left = steady.solve(self.system, starts, self.held)
        failed = np.flatnonzero(left > SOLVED)
        is_near = np.zeros(count, bool)
        if not len(self.held) or not len(failed):
            return states, left, is_near
        free = self.system._replace(central=self.system.central[:0], conserves_size=False)
        near, near_left = steady.solve(free, states.at(failed), self.held[:0])
        apart = steady.held_momenta(self.system, near.q, near.l) - self.held
        take = (np.abs(apart).max(axis=0) < NEAR) & (near_left < SOLVED)
        take &= [len(steady.standing(self.system, near.at(i))) > 0 for i in range(len(failed))]
        is_near[failed[take]] = True
        left[failed[take]] = near_left[take]
        return states.with_at(failed[take], near.at(take)), left, is_near

    def _motions(self, states: States, left: Array) -> list[SteadyMotion]:
        """Return the Motions of steady states with their residuals."""
        if not len(left):
            return []
        states = steady.seen_from_body(self.system, states)
        seen = steady.signatures(self.system, states)
        linear = linearise_motions(self.system, states)
        each = (states.at(slice(i, i + 1)) for i in range(len(left)))
        rows = zip(each, left.tolist(), seen, linear, strict=True)
        return [SteadyMotion(self.system, *row) for row in rows]


def is_among(motion: SteadyMotion, others: Sequence[SteadyMotion | None]) -> bool:
    """Return whether symmetries carry a motion of a scene into one of others."""
    apart = (np.abs(o.signature - motion.signature).max() for o in others if o is not None)
    return any(x < SAME for x in apart)


def distinct(motions: Sequence[SteadyMotion | None]) -> list[SteadyMotion]:
    """Return each motion once, in the order found."""
    kept: list[SteadyMotion] = []
    for motion in motions:
        if motion is not None and not is_among(motion, kept):
            kept.append(motion)
    return kept
