"""The posterior of a fit: draws of its parameters by Markov chains.

The likelihood of the residuals r has the covariance C that `rigidmc.studies.fit.uncertainty` finds
at the best answer, as a constant: white noise, and what lasts from sample to sample::

    ln L = -1/2 r^T C^-1 r,   C_kl = v delta_kl + u exp(-|t_k - t_l|/T)

Where nothing lasts this is -cost/(2 v). Otherwise a Kalman filter gives mean and variance of each
reading after those before it, and so independent residuals. Chains start at all answers that the
data do not exclude. `emcee` moves walkers, half of them at once: by stretch moves, and by draws of
the normal approximations of all answers, between which walkers change so. `nuts` follows gradients;
its chains stay at their answers.

Source: Foreman-Mackey et al., PASP 125 (2013) 306; Hoffman & Gelman, JMLR 15 (2014) 1593; Durbin &
Koopman, Time Series Analysis by State Space Methods (2012), 4.3.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import minimize

from rigidmc.errors import OptionError
from rigidmc.studies.fit.prior import Prior
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.uncertainty import ModelError

WALKERS = 32  # for each chain of `chains`
WARM_UP = 100  # moves of a walker, or half of the draws of NUTS, that are left out
THINNING = 15, 75  # moves between draws, until the chains agree
TAIL = 5.0  # degrees of freedom of a jump's t distribution: it goes where the density has tails
RAREST = 0.05  # of jumps to an answer: its approximation may miss what lies there
EXCLUDED = 12.0  # an answer exp(-12) times as likely as the best has none of 1e5 draws
CLOSE = 0.1  # squared distance of two maxima that are one, in standard deviations
CHUNK = 256  # draws whose residuals are in memory at once


def package(name: str) -> Any:
    """Return a package that draws; OptionError if it is missing."""
    try:
        with warnings.catch_warnings(action="ignore"):  # ArviZ announces its next version
            return import_module(name)
    except ImportError as error:
        rule = f"needs the package {name}: pip install 'rigidmc[fit]' ({error})"
        raise OptionError(rule, at="posterior") from None


class Density:
    """The logarithm of the density of draws z, up to a constant.

    order : of the residuals, channel by channel;  ratio : autocorrelation with the one before
    scale : deviation of each after those before it;  band : of the filter, of first order
    """

    def __init__(self, problem: FitProblem, error: ModelError, prior: Prior) -> None:
        self.problem, self.error, self.prior = problem, error, prior
        t, _, _, names, records = problem.samples_in_order()
        channel = np.unique(names, return_inverse=True)[1] * problem.parameters.records + records
        self.order = np.argsort(channel, kind="stable")
        self.ratio = np.exp(-np.abs(np.diff(t[self.order], prepend=t[0])) / error.time)
        self.ratio[np.diff(channel[self.order], prepend=-1) > 0] = 0.0
        self.band, variance, left = np.ones((2, t.size)), np.zeros(t.size), 0.0
        for k, ratio in enumerate(self.ratio):
            lasting = ratio**2 * left + error.lasting * (1.0 - ratio**2)
            variance[k] = lasting + error.white
            left = lasting * error.white / variance[k]
        self.band[1, :-1] = -self.ratio[1:] * error.white / variance[:-1]
        self.scale = np.sqrt(variance)

    def whitened(self, residuals: Array) -> Array:
        """Return independent residuals of unit variance, by channel, of residuals (n, columns)."""
        rows = residuals[self.order]
        rows[1:] -= self.ratio[1:, None] * rows[:-1]
        found = solve_banded((1, 0), self.band, rows, check_finite=False)  # nan if flagged
        return np.asarray(found / self.scale[:, None])

    def unwhitened(self, rows: Array) -> Array:
        """Return C^-1 r of whitened residuals: the transposed filter, backwards in time."""
        band, found = np.stack([np.roll(self.band[1], 1), self.band[0]]), np.empty_like(rows)
        back = solve_banded((0, 1), band, rows / self.scale, check_finite=False)
        back[:-1] -= self.ratio[1:] * back[1:]
        found[self.order] = back
        return found

    def _moved(self, z: Array) -> tuple[Array, Array]:
        """Return (coordinates of the fit, logarithm of the prior) of draws, -inf beyond limits."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            x, ln = self.prior.of(z)
            low, high = self.prior.parameters.low, self.prior.parameters.high
            inside = ((x >= low) & (x <= high) & np.isfinite(x)).all(1) & np.isfinite(ln)
        return x, np.where(inside, ln, -np.inf)

    def __call__(self, z: Array) -> Array:
        """Return it of draws z (draws, size), -inf where the motion is flagged."""
        x, ln = self._moved(z)
        some = np.flatnonzero(np.isfinite(ln))
        if some.size and not self.error.lasting:
            ln[some] -= 0.5 * self.problem.sums(x[some]).cost / self.error.white
        elif some.size:
            cost = (self.whitened(self.problem.residuals_of(x[some]).T) ** 2).sum(0)
            ln[some] -= 0.5 * np.where(np.isfinite(cost), cost, np.inf)
        return ln

    def slopes(self, z: Array) -> tuple[float, Array]:
        """Return (its value, its gradient) at a draw z (size,)."""
        (x,), (ln,) = self._moved(z[None])
        cost: Any = np.inf
        if np.isfinite(ln) and not self.error.lasting:
            _, gradient, cost = (part[0] / self.error.white for part in self.problem.sums(x[None]))
        elif np.isfinite(ln):
            residuals, jacobian = self.problem.jacobian(x)
            rows = self.whitened(residuals[:, None])[:, 0]
            cost, gradient = rows @ rows, -self.unwhitened(rows) @ jacobian
        if not np.isfinite(ln - cost):
            return -np.inf, np.zeros_like(z)
        slopes, of_prior = self.prior.slopes(z)
        return float(ln - 0.5 * cost), slopes.T @ gradient + of_prior

    def of_records(self, z: Array) -> Array:
        """Return the logarithm of the density of each record (draws, records)."""
        _, _, noise, _, record = self.problem.samples_in_order()
        constant = np.log(np.sqrt(2.0 * np.pi) * self.scale * noise[self.order])
        found, x = np.zeros((self.problem.parameters.records, len(z))), self._moved(z)[0]
        for low in range(0, len(z), CHUNK):
            rows = self.whitened(self.problem.residuals_of(x[low : low + CHUNK]).T)
            part = found[:, low : low + CHUNK]
            np.add.at(part, record[self.order], -0.5 * rows**2 - constant[:, None])
        return found.T


class Mode(NamedTuple):
    """A maximum z of the density: the place of its answer, the logarithm of the probability around
    it, up to a constant, and F of the covariance F F^T of its normal approximation."""

    answer: int
    z: Array
    weight: float
    factor: Array

    def apart(self, z: Array) -> Array:
        """Return the squared distances (draws,) of draws z, in standard deviations."""
        return np.asarray(np.sum(np.linalg.solve(self.factor, (z - self.z).T) ** 2, axis=0))


def root(density: Density, z: Array, basis: Array) -> Array:
    """Return F with F F^T the inverse of minus the second derivatives at z, whose eigenvalues count
    by absolute value; by differences along the columns of a basis, one standard deviation long."""
    ends = [[density.slopes(z + side * step)[1] for side in (-0.1, 0.1)] for step in basis.T]
    precision = np.stack([low - high for low, high in ends]) @ basis / 0.2
    unit = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(precision)), 1e-12))
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T) * np.outer(unit, unit))
    values = np.maximum(np.abs(values), 1e-12 * np.abs(values).max())
    return np.asarray(basis @ (unit[:, None] * vectors / np.sqrt(values)))


def climb(density: Density, answer: int, z: Array) -> Mode:
    """Return the maximum above z: the second round searches in units of the first."""
    unit, slopes = density.prior.unit, np.diag(density.prior.slopes(z)[0])
    steps = np.minimum(unit / slopes, 1.0)  # that change the residuals by 1, or z by 1
    factor = np.diag(np.concatenate([steps, np.ones(z.size - unit.size)]))

    def minus(y: Array) -> tuple[float, Array]:
        value, gradient = density.slopes(z + factor @ y)
        return -value, -factor.T @ gradient

    for _ in range(2):
        factor = root(density, z, factor)
        with np.errstate(invalid="ignore"):  # a search may meet flagged motions
            y = minimize(minus, np.zeros(z.size), method="BFGS", jac=True, options={"gtol": 1e-2}).x
        z = z + factor @ y
    factor = root(density, z, factor)
    weight = float(density(z[None])[0] + np.linalg.slogdet(factor)[1])
    return Mode(answer, z, weight, factor)


def modes_of(density: Density, answers: Sequence[Array]) -> list[Mode]:
    """Return the maxima above the coordinates of answers, each once, without those that the data
    exclude, the most probable first."""
    found = [climb(density, i, density.prior.inverse(x)) for i, x in enumerate(answers)]
    left = list[Mode]()
    for mode in sorted(found, key=lambda mode: -mode.weight):
        is_new = all(one.apart(mode.z[None])[0] > CLOSE for one in left)
        if is_new and mode.weight > max(one.weight for one in found) - EXCLUDED:
            left.append(mode)
    return left


def first_draws(modes: Sequence[Mode], random: Any, count: int) -> Array:
    """Return draws (count, size) around the modes in turn."""
    each = [modes[i % len(modes)] for i in range(count)]
    return np.stack([m.z + m.factor @ random.standard_normal(m.z.size) for m in each])


def jumps(modes: Sequence[Mode]) -> Callable[[Array, Any], tuple[Array, Array]]:
    """Return a proposal of emcee: draws of t distributions around the modes."""
    share = np.maximum(np.exp([mode.weight - modes[0].weight for mode in modes]), RAREST)
    share /= share.sum()

    def density(z: Array) -> Array:  # its logarithm, up to a constant
        parts = [
            np.log(one) - np.linalg.slogdet(mode.factor)[1]
            - 0.5 * (TAIL + mode.z.size) * np.log1p(mode.apart(z) / TAIL)
            for mode, one in zip(modes, share, strict=True)
        ]  # fmt: skip
        return np.asarray(np.logaddexp.reduce(parts, axis=0))

    def propose(z: Array, random: Any) -> tuple[Array, Array]:
        normal = random.standard_normal(z.shape)
        normal /= np.sqrt(random.chisquare(TAIL, (len(z), 1)) / TAIL)
        some = [modes[int(i)] for i in random.choice(len(modes), size=len(z), p=share)]
        there = np.stack([m.z + m.factor @ x for m, x in zip(some, normal, strict=True)])
        return there, density(z) - density(there)

    return propose


def by_emcee(
    density: Density, modes: Sequence[Mode], chains: int, draws: int, seed: int
) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield (draws z (chains, draws, size), logarithm of their density and whether a trajectory
    diverges (chains, draws), share of accepted moves (chains,)) of an ensemble, each time after
    more moves. A walker is a chain."""
    emcee, size = package("emcee"), density.prior.size
    walkers = chains * max(WALKERS, size)
    random, steps = np.random.RandomState(seed % 2**32), max(1, draws * chains // walkers)
    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.MHMove(jumps(modes)), 0.5)]
    sampler = emcee.EnsembleSampler(walkers, size, density, moves=moves, vectorize=True)
    state = first_draws(modes, random, walkers)
    sampler.random_state = random.get_state()
    state = sampler.run_mcmc(state, WARM_UP, store=False)
    for thinning in THINNING:
        sampler.reset()
        state = sampler.run_mcmc(state, steps, thin_by=thinning)
        z, ln = (np.swapaxes(x, 0, 1) for x in (sampler.get_chain(), sampler.get_log_prob()))
        yield z, ln, np.zeros_like(ln), sampler.acceptance_fraction


def by_nuts(
    density: Density, modes: Sequence[Mode], chains: int, draws: int, seed: int
) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield what `by_emcee` yields, by NUTS, in units of the normal approximation of the best
    mode."""
    nutpie, best, size = package("nutpie"), modes[0], density.prior.size

    def at(y: Array) -> tuple[float, Array]:
        value, gradient = density.slopes(best.z + best.factor @ y)
        return value, best.factor.T @ gradient

    found, random = [], np.random.RandomState(seed % 2**32)
    for i, z in enumerate(first_draws(modes, random, chains)):
        first = np.linalg.solve(best.factor, z - best.z)
        model = nutpie.compiled_pyfunc.from_pyfunc(
            size, lambda: at, lambda *seeds: lambda y: {"y": y}, [np.dtype(float)], [(size,)],
            ["y"], make_initial_point_fn=lambda seed, first=first: first,
        )  # fmt: skip
        found.append(nutpie.sample(
            model, draws=draws, tune=2 * WARM_UP, chains=1, cores=1, seed=seed % 2**31 + i,
            save_warmup=False, progress_bar=False,
        ))  # fmt: skip
    y = np.concatenate([one.posterior.y.values for one in found])
    ln, diverging, rate = (
        np.concatenate([one.sample_stats[name].values for one in found])
        for name in ("logp", "diverging", "mean_tree_accept")
    )
    yield best.z + y @ best.factor.T, ln, diverging.astype(float), rate.mean(1)


SAMPLERS = {"emcee": ("emcee", by_emcee), "nuts": ("nutpie", by_nuts)}  # with their packages
