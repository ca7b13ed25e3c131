"""The posterior of a fit: draws of its parameters by Markov chains.

The likelihood of the residuals r has the covariance C that `rigidmc.studies.fit.uncertainty` finds
at the best answer, as a constant: white noise, and what lasts from sample to sample::

    ln L = -1/2 r^T C^-1 r,   C_kl = v delta_kl + u exp(-|t_k - t_l|/T)

Chains start at all answers that the data do not exclude. `emcee` moves walkers, half of them at
once: by stretch moves, and by draws of the normal approximations of all answers, between which
walkers change so. `nuts` follows gradients; its chains stay at their answers.

Source: Foreman-Mackey et al., PASP 125 (2013) 306; Hoffman & Gelman, JMLR 15 (2014) 1593.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from rigidmc.errors import OptionError
from rigidmc.processes.threads import MOMENT, Task, threads_of
from rigidmc.studies.fit.prior import Prior
from rigidmc.studies.fit.problem import FitProblem
from rigidmc.studies.fit.streams import Array
from rigidmc.studies.fit.uncertainty import ModelError, inverse_of

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

    order : of the residuals, channel by channel;  left : variance of each over that of the lasting
        error, given the one before;  factor : of K^-1 + u/v, see `solved`
    """

    def __init__(self, problem: FitProblem, error: ModelError, prior: Prior) -> None:
        self.problem, self.still, self.error, self.prior = problem, problem.still(), error, prior
        _, _, _, names, self.record, t = problem.samples_in_order()
        channel = np.unique(names, return_inverse=True)[1] + len(names) * self.record
        self.order = np.lexsort((t, channel))
        steps = np.diff(t[self.order], prepend=-np.inf)
        steps[np.diff(channel[self.order], prepend=-1) > 0] = np.inf
        band, self.left = inverse_of(steps, error.time)
        self.factor = cholesky_banded(band + [[0.0], [error.lasting / error.white]])

    def solved(self, rows: Array) -> Array:
        """Return C^-1 r of residuals (n, columns), which is (1 - (K^-1 + u/v)^-1 u/v) r/v with the
        autocorrelation K; nan if flagged."""
        found = np.empty_like(rows)
        found[self.order] = cho_solve_banded((self.factor, False), rows[self.order], False, False)
        return np.asarray((rows - self.error.lasting / self.error.white * found) / self.error.white)

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
        if some.size:
            rows = self.still.residuals_of(x[some]).T
            cost = (rows * self.solved(rows)).sum(0)
            ln[some] -= 0.5 * np.where(np.isfinite(cost), cost, np.inf)
        return ln

    def slopes(self, z: Array) -> tuple[Array, Array]:
        """Return (its values (draws,), its gradients (draws, size)) at draws z (draws, size)."""
        x, ln = self._moved(z)
        gradient, some = np.zeros_like(z), np.flatnonzero(np.isfinite(ln))
        if some.size:
            rows, index = self.problem.rows_of(x[some]), self.problem.parameters.index
            turns = self.problem.parameters.turns(x[some], self.problem.every)
            turns, pull = turns.reshape(some.size, *index.shape, -1), self.solved(rows[:, 0])
            ln[some] -= 0.5 * (rows[:, 0] * pull).sum(0)
            each, by_x = rows[:, 2:] * pull[:, None], np.zeros((some.size, x.shape[1]))
            for i, places in enumerate(index):
                total = each[self.record == i].sum(0)
                by_x[:, places] += np.einsum("it,tij->tj", total, turns[:, i])
            for draw, by_each in zip(some, by_x, strict=True):
                slopes, of_prior = self.prior.slopes(z[draw])
                gradient[draw] = by_each @ slopes + of_prior
        is_sound = np.isfinite(ln) & np.isfinite(gradient).all(1)
        return np.where(is_sound, ln, -np.inf), np.where(is_sound[:, None], gradient, 0.0)

    def precision(self, z: Array) -> Array:
        """Return minus its second derivatives (size, size) at a draw z (size,), as if residuals
        were linear in second moments and all else; the prior has them by differences."""
        residuals, jacobian = self.problem.jacobian(self._moved(z[None])[0][0])
        pull = -self.solved(residuals[:, None])[:, 0] @ jacobian
        slopes, steps = self.prior.slopes(z)[0], 1e-4 * np.eye(z.size)
        rows, moments = jacobian @ slopes, self.prior.moments.ravel()
        ends = [[self.prior.slopes(z + side * step) for side in (-1, 1)] for step in steps]
        bent = [(a - b).T @ pull + c - d for (a, c), (b, d) in ends]
        found = rows.T @ self.solved(rows) + np.stack(bent) / 2e-4
        found -= slopes[moments].T @ (pull[moments, None] * slopes[moments])
        return np.asarray(np.nan_to_num(0.5 * (found + found.T)))  # 0 if flagged

    def of_records(self, z: Array) -> Array:
        """Return the logarithm of the density of each record (draws, records)."""
        _, _, noise, _, record, _ = self.problem.samples_in_order()
        variance = 2.0 * np.pi * self.error.white * self.left * self.factor[1] ** 2
        constant = 0.5 * np.log(variance) + np.log(noise[self.order])
        found, x = np.zeros((self.problem.parameters.records, len(z))), self._moved(z)[0]
        for low in range(0, len(z), CHUNK):
            rows = self.still.residuals_of(x[low : low + CHUNK]).T
            part = found[:, low : low + CHUNK]
            np.add.at(part, record, -0.5 * rows * self.solved(rows))
        np.add.at(found, record[self.order], -constant[:, None])
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


def climb(density: Density, answer: int, z: Array) -> Mode:
    """Return the maximum above z. The eigenvalues of its precision count by absolute value."""
    steps = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(density.precision(z))), 1.0))  # or z by 1

    def minus(y: Array) -> tuple[float, Array]:
        (value,), (gradient,) = density.slopes((z + steps * y)[None])
        return -value, -steps * gradient

    with np.errstate(invalid="ignore"):  # a search may meet flagged motions
        found = minimize(
            minus, np.zeros(z.size), jac=True, method="trust-exact",
            hess=lambda y: density.precision(z + steps * y) * np.outer(steps, steps),
            options={"gtol": 1e-3, "maxiter": 100, "max_trust_radius": 100.0},
        )  # fmt: skip
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(found.hess)), 1e-12))
    values, vectors = np.linalg.eigh(found.hess * np.outer(scale, scale))
    values = np.maximum(np.abs(values), 1e-12 * np.abs(values).max())
    factor = (steps * scale)[:, None] * vectors / np.sqrt(values)
    weight = float(np.linalg.slogdet(factor)[1] - found.fun)
    return Mode(answer, z + steps * found.x, weight, factor)


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
    ln = np.log(share) - [np.linalg.slogdet(mode.factor)[1] for mode in modes]

    def density(z: Array) -> Array:  # its logarithm, up to a constant
        tails = np.log1p(np.stack([mode.apart(z) for mode in modes], axis=1) / TAIL)
        return np.asarray(np.logaddexp.reduce(ln - 0.5 * (TAIL + z.shape[1]) * tails, axis=1))

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
    emcee, prior, size = package("emcee"), density.prior, density.prior.size
    walkers, move = chains * max(WALKERS, size), emcee.moves.StretchMove()
    random, steps = np.random.RandomState(seed % 2**32), max(1, draws * chains // walkers)
    is_log = np.isin(range(size), [*np.flatnonzero(prior.is_flat), *prior.moments.flat])

    def stretch(z: Array, others: Sequence[Array], random: Any) -> tuple[Array, Array]:
        at = np.exp(at := np.concatenate([z, *others]), at, where=is_log)
        w, factor = plain(at[: len(z)], [at[len(z) :]], random)
        inside = ((w > 0.0) | ~is_log).all(1, keepdims=True)
        there = np.where(inside, np.log(w, np.array(w), where=is_log & inside), z)
        return there, factor + (z - there)[:, is_log].sum(1)

    plain, move.get_proposal = move.get_proposal, stretch  # of x and J: straight along a limit
    moves = [(move, 0.5), (emcee.moves.MHMove(jumps(modes)), 0.5)]
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
    mode. When all chains wait for a gradient, one run has all gradients."""
    nutpie, best, size = package("nutpie"), modes[0], density.prior.size
    asked, waiting = SimpleQueue[Any](), list[Any]()

    def ask(y: Array) -> Any:
        asked.put((y, own := SimpleQueue[Any]()))
        return own.get()

    def chain(i: int, first: Array) -> Any:
        model = nutpie.compiled_pyfunc.from_pyfunc(
            size, lambda: ask, lambda *seeds: lambda y: {"y": y}, [np.dtype(float)], [(size,)],
            ["y"], make_initial_point_fn=lambda seed: first,
        )  # fmt: skip
        return nutpie.sample(
            model, draws=draws, tune=2 * WARM_UP, chains=1, cores=1, seed=seed % 2**31 + i,
            save_warmup=False, progress_bar=False,
        )  # fmt: skip

    firsts = first_draws(modes, np.random.RandomState(seed % 2**32), chains) - best.z
    firsts = firsts @ np.linalg.inv(best.factor).T
    tasks = [Task(chain, i, first, answers=asked) for i, first in enumerate(firsts)]
    try:
        for task in tasks:
            threads_of("chains", chains).begin(task)
        while not all(task.done for task in tasks):
            question = asked.get()
            waiting += [] if isinstance(question, Task) else [question]
            if waiting and len(waiting) == sum(not task.done for task in tasks):
                y = np.stack([y for y, _ in waiting])
                values, gradients = density.slopes(best.z + y @ best.factor.T)
                for value, slope in zip(values, gradients @ best.factor, strict=True):
                    waiting.pop(0)[1].put((value, slope))
    finally:  # after an error or a signal chains run through the rest, which diverges
        for task in tasks:
            task.dropped = True
        while any(task.begun and not task.done for task in tasks):
            with suppress(Empty):
                question = waiting.pop() if waiting else asked.get(timeout=MOMENT)
                if not isinstance(question, Task):
                    question[1].put((-np.inf, np.zeros(size)))
    found = [task.result() for task in tasks]
    y = np.concatenate([one.posterior.y.values for one in found])
    ln, diverging, rate = (
        np.concatenate([one.sample_stats[name].values for one in found])
        for name in ("logp", "diverging", "mean_tree_accept")
    )
    yield best.z + y @ best.factor.T, ln, diverging.astype(float), rate.mean(1)


SAMPLERS = {"emcee": ("emcee", by_emcee), "nuts": ("nutpie", by_nuts)}  # with their packages
