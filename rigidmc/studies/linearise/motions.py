"""The steady motions of one scene: found from many starts, each listed once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.scene.scene import Scene
from rigidmc.studies.linearise.rates import Mechanics, energy_of, mechanics_of
from rigidmc.studies.linearise.stability import MOTION, Linearised, linearise_motion
from rigidmc.studies.linearise.steady import (
    SOLVED,
    States,
    held_momenta,
    search_starts,
    seen_from_body,
    signatures,
    solve,
    standing,
    with_frames,
)
from rigidmc.studies.linearise.symmetries import Symmetries, find_symmetries

Array = NDArray[np.float64]
SAME = 1e-5  # largest difference of signatures of one motion; double roots are found to 1e-7
# largest change of the held momenta, where the motion is more symmetric than the start: a top that
# starts at a tilt of 0.03 rad has L_z - L_3 of half the square, and none when it stands upright
NEAR = 1e-3


class Motion(NamedTuple):
    """One steady motion, and the linearised motion about it.

    state : with one column;  residual : largest of its equations, in scaled units
    signature : see `rigidmc.studies.linearise.steady.signatures`
    """

    known: Mechanics
    found: Symmetries
    state: States
    residual: float
    signature: Array
    linear: Linearised

    @property
    def energy(self) -> float:
        """Kinetic plus potential energy [J]."""
        return float(energy_of(self.known, self.state.q, self.state.l)[0])

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
        return self.state.q[:, 0], self.state.l[:, 0] * self.known.moment * self.known.rate


class Problem(NamedTuple):
    """The equations of the steady motions of a scene, and the start of a member."""

    known: Mechanics
    found: Symmetries
    q: Array
    l: Array
    held: Array

    @staticmethod
    def of(scene: Scene, member: int) -> "Problem":
        """Return the Problem of a member; SceneError for a scene without steady motions."""
        known, q, l = mechanics_of(scene, member)
        found = find_symmetries(known)
        return Problem(known, found, q, l, held_momenta(known, found, q[:, None], l[:, None]))

    def states_of(self, guesses: Sequence[tuple[Array, Array]]) -> States:
        """Return the states of guesses (q, l [kg m^2/s])."""
        scale = self.known.moment * self.known.rate
        q = np.array([q for q, _ in guesses]).reshape(-1, 4).T
        return with_frames(
            self.known, self.found, q, np.array([l for _, l in guesses]).reshape(-1, 3).T / scale
        )

    def starts(self, count: int) -> States:
        """Return states to search from, that of the member first."""
        return search_starts(self.known, self.found, self.q, self.l, count)

    def solved(self, starts: States) -> list[Motion | None]:
        """Return the steady motion found from each state, None where the search fails."""
        if not starts.q.shape[1]:
            return []
        states, left = solve(self.known, self.found, starts, self.held)
        if len(self.held) and (left > SOLVED).any():
            free = self.found._replace(central=self.found.central[:0], conserves_size=False)
            near, near_left = solve(self.known, free, states, self.held[:0])
            apart = held_momenta(self.known, self.found, near.q, near.l) - self.held
            take = (left > SOLVED) & (np.abs(apart).max(axis=0) < NEAR)
            take &= [len(standing(self.found, near.at(i))) > 0 for i in range(len(left))]
            states = States(*(np.where(take, a, b) for a, b in zip(near, states, strict=True)))
            left = np.where(take, near_left, left)
        return [
            self._motion(states.at(slice(i, i + 1)), float(size)) if size < SOLVED else None
            for i, size in enumerate(left)
        ]

    def _motion(self, state: States, left: float) -> Motion:
        state = seen_from_body(self.found, state)
        seen = signatures(self.known, self.found, state)[0]
        linear = linearise_motion(self.known, self.found, state)
        return Motion(self.known, self.found, state, left, seen, linear)


def is_same(a: Motion, b: Motion) -> bool:
    """Return whether symmetries carry one motion of a scene into another."""
    return bool(np.abs(a.signature - b.signature).max() < SAME)


def distinct(motions: Sequence[Motion | None]) -> list[Motion]:
    """Return each motion once, in the order found."""
    kept: list[Motion] = []
    for one in motions:
        if one is not None and not any(is_same(one, other) for other in kept):
            kept.append(one)
    return kept
