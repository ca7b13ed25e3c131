"""Ensembles of statistical mechanics: an energy shell, and thermal equilibrium."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidmc.engine.streams import uniforms
from rigidmc.errors import SceneError
from rigidmc.inputs.arrays import Array
from rigidmc.mechanics.inertia import vectors_into
from rigidmc.physics.dynamics.dual_arrays import as_array
from rigidmc.physics.dynamics.functions import exponential_of
from rigidmc.scene.distributions import Distribution
from rigidmc.scene.quantities import Source, draw, is_seed
from rigidmc.scene.vector_distributions.protocol import (
    Density,
    EquilibriumEnsemble,
    MemberFacts,
    fixed_vector,
    number,
)
from rigidmc.scene.vector_distributions.vectors import directions, uniform_attitudes

# uniform attitudes tried for each member: at an acceptance of 1 %, fewer than one in 1e17 members
# gets none
TRIES = 4096


@dataclass(frozen=True)
class Shell(EquilibriumEnsemble):
    """Angular momentum of a given energy.

    On the energy shell::

        E = 1/2 L . I^-1 L + V(q)

    A member with V(q) > E is flagged invalid_input.

    Parameters
    ----------
    energy : quantity [J]
        E
    direction : array_like (3,), optional
        direction of L in body axes; by default L is uniform on the shell (microcanonical
        ensemble), L = sqrt(2 (E - V) I) n with n uniform on the sphere

    Examples
    --------
    >>> start = rm.Start(momentum=rm.Shell(energy=2.0), attitude="ensemble")
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), start=start)
    """

    energy: Any
    direction: Any = None

    name = "shell"
    variables = ("momentum",)
    scaling = {"energy": "energy"}

    def check(self, at: str) -> "Shell":
        energy = number(self.energy, f"{at}.energy")
        if self.direction is None:
            return Shell(energy)
        return Shell(energy, fixed_vector(self.direction, f"{at}.direction", 3))

    def acceptance(self, seed: int, first: int, count: int, facts: MemberFacts) -> Density:
        """Return sqrt(E - V(q)) divided by its bound: the volume of momenta on the shell at each
        attitude, relative."""
        (energy,) = draw((self.energy,), seed, "start.momentum.energy", first, count)
        with np.errstate(all="ignore"):
            most = np.where(energy + facts.bound > 0.0, energy + facts.bound, np.nan)
        free = facts.bound == 0.0
        return lambda q: np.where(
            free, 1.0, np.sqrt(np.clip((energy - facts.potential(q)) / most, 0.0, 1.0))
        )

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        (energy,) = draw((self.energy,), sampler, f"{name}.energy", first, count)
        assert facts is not None
        twice = 2.0 * (energy - facts.potential(facts.attitude))
        if self.direction is None:
            v = np.sqrt(facts.moments) * directions(sampler, name, first, count)
        else:
            v = np.broadcast_to(as_array(self.direction)[:, None], (3, count))
            v = v if facts.turn is None else vectors_into(facts.turn, v)
            v = v / np.sqrt((v * v / facts.moments).sum(0))
        with np.errstate(invalid="ignore"):
            momenta: Array = np.sqrt(twice) * v  # nan if V(q) > E
        return momenta


@dataclass(frozen=True)
class GibbsMomentum(EquilibriumEnsemble):
    """Angular momentum in thermal equilibrium, with density exp(-T/kT) for the kinetic energy T.

    L_i is normal with variance I_i kT.

    Parameters
    ----------
    kT : quantity [J]
        Boltzmann's constant times temperature

    Examples
    --------
    >>> start = rm.Start(momentum=rm.GibbsMomentum(kT=0.5), attitude="ensemble")
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), start=start)
    """

    kT: Any

    name = "gibbs"
    variables = ("momentum",)
    scaling = {"kT": "energy"}

    def check(self, at: str) -> "GibbsMomentum":
        return GibbsMomentum(number(self.kT, f"{at}.kT", least=0.0))

    def acceptance(self, seed: int, first: int, count: int, facts: MemberFacts) -> Density:
        """Return exp(-V(q)/kT) divided by its bound."""
        (kT,) = draw((self.kT,), seed, "start.momentum.kT", first, count)
        return lambda q: exponential_of(-(facts.potential(q) + facts.bound) / kT)

    def sample(
        self, sampler: Source, name: str, first: int, count: int, facts: MemberFacts | None
    ) -> Array:
        assert facts is not None
        (kT,) = draw((self.kT,), sampler, f"{name}.kT", first, count)
        kT = np.where(kT >= 0.0, kT, np.nan)
        normal = (Distribution("normal", (0.0, 1.0)),) * 3
        return np.sqrt(facts.moments * kT) * draw(normal, sampler, f"{name}.normal", first, count)

    def log_density(self, x: Array, moments: Array) -> Array:
        variances = self.kT * moments
        return np.asarray(-0.5 * (x * x / variances + np.log(2.0 * np.pi * variances)).sum(0))


def attitudes_of_ensemble(share: Density, seed: Source, first: int, count: int) -> Array:
    """Draw unit quaternions (4, count) with density proportional to share(q) <= 1, by rejection:
    each member gets its first accepted uniform attitude; nan if none of TRIES is accepted."""
    if not is_seed(seed):
        rule = "attitudes of an ensemble are drawn by rejection, which needs independent points"
        raise SceneError(rule, at="run.points")
    q, left = np.full((4, count), np.nan), np.ones(count, bool)
    for i in range(TRIES):
        u, v, w, x = uniforms(seed, "start.attitude.ensemble", first, count, i)
        tried = uniform_attitudes(u, v, w)
        accepted = left & (x < share(tried))
        q[:, accepted] = tried[:, accepted]
        left &= ~accepted
        if not left.any():
            break
    return q
