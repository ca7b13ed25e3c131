"""Log densities: against scipy.stats, by integration to 1, and against the draws."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

import rigidmc as rm
from rigidmc.errors import SceneError
from rigidmc.scene.distributions import joint_log_density

N = 20_000
MOMENTS = (1.0, 2.0, 2.5)
NUMBERS = {
    "normal": (rm.normal(1.0, 0.2), stats.norm(1.0, 0.2)),
    "uniform": (rm.uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    "gamma": (rm.distribution("gamma", a=2.5, scale=0.3), stats.gamma(2.5, scale=0.3)),
    "expon": (rm.distribution("expon", loc=1.0, scale=2.0), stats.expon(1.0, 2.0)),
    "truncated": (rm.normal(1.0, 2.0).between(-1.0, 2.0), stats.truncnorm(-1.0, 0.5, 1.0, 2.0)),
    # 10 standard deviations out, where 1 - F has the digits
    "tail": (rm.normal(0.0, 1.0).between(10.0, 11.0), stats.truncnorm(10.0, 11.0)),
    "narrowed": (rm.uniform(0.0, 4.0).between(1.0, 9.0), stats.uniform(1.0, 3.0)),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_densities_of_numbers_are_those_of_scipy(name):
    law, truth = NUMBERS[name]
    x = np.concatenate([truth.ppf(np.linspace(0.001, 0.999, 99)), truth.mean() + [-50.0, 50.0]])
    found, wanted = law.log_density(x), truth.logpdf(x)
    inside = np.isfinite(wanted)
    assert np.array_equal(inside, np.isfinite(found)) and (found[~inside] == -np.inf).all()
    assert np.abs(found[inside] - wanted[inside]).max() < 1e-14  # measured 1.1e-16
    twice = law.times(2.0).log_density(2.0 * x[inside])
    assert np.abs(twice + math.log(2.0) - wanted[inside]).max() < 4e-14  # measured 3.6e-15


def test_the_density_of_a_mixture_is_the_weighted_sum():
    law = rm.mixture((3.0, rm.normal(0.0, 0.1)), (1.0, rm.uniform(2.0, 3.0)))
    x = np.array([-0.1, 0.05, 1.5, 2.5])
    wanted = 0.75 * stats.norm(0.0, 0.1).pdf(x) + 0.25 * stats.uniform(2.0, 1.0).pdf(x)
    assert np.abs(np.exp(law.log_density(x)) / wanted - 1.0).max() < 1e-14  # measured 5e-16
    assert rm.mixture((1.0, law), (1.0, law)).log_density(x) == pytest.approx(np.log(wanted))


def attitudes(law):
    return rm.Start(omega=(0.0, 0.0, 1.0), attitude=law).sample_attitude(0, 0, N)


def one(ratio):
    """Whether the mean of a ratio of densities over draws of the lower one is 1."""
    error = ratio.std() / math.sqrt(ratio.size)
    return abs(ratio.mean() - 1.0) < 3.0 * error < 0.1


def test_correlated_numbers_have_the_density_of_scipy():
    by = np.array([[0.2, 0.0, 0.0], [0.05, 0.3, 0.0], [-0.1, 0.05, 0.4]])
    means = (1.0, -2.0, 0.5)
    laws = [rm.common(mean, *row) for mean, row in zip(means, by, strict=True)]
    x = np.random.default_rng(1).normal(size=(3, 50))
    truth = stats.multivariate_normal(means, by @ by.T)
    found = joint_log_density(laws, x)
    assert np.abs(found - truth.logpdf(x.T)).max() < 2e-12  # measured 1.4e-13
    alone = stats.norm(1.0, 0.2).logpdf(x[0])
    assert np.abs(laws[0].log_density(x[0]) - alone).max() < 1e-13
    two = joint_log_density(laws[:2], x[:2])  # with factors of other lengths
    assert np.abs(two - joint_log_density([rm.common(1.0, 0.2), laws[1]], x[:2])).max() < 1e-13
    with pytest.raises(SceneError, match="follow from the others"):
        joint_log_density([rm.common(1.0, 0.2), rm.common(2.0, 0.4)], x[:2])


def test_momenta_in_equilibrium_are_normal():
    x = np.random.default_rng(1).normal(size=(3, 50))
    moments = np.broadcast_to(np.array(MOMENTS)[:, None], x.shape)
    truth = stats.norm(0.0, np.sqrt(0.3 * moments)).logpdf(x).sum(0)
    found = rm.GibbsMomentum(0.3).log_density(x, moments)
    assert np.abs(found - truth).max() < 4e-14  # measured 3.6e-15


ATTITUDES = {
    "fisher": lambda kappa: rm.Fisher((1.0, 0.2, -0.3, 0.4), kappa),
    "pointing": lambda kappa: rm.Pointing((0.6, 0.0, 1.6), kappa),
}


@pytest.mark.parametrize("name", ATTITUDES)
def test_densities_of_attitudes_are_relative_to_uniform_ones(name):
    law = ATTITUDES[name](2.0)
    q = attitudes("uniform")
    assert one(np.exp(law.log_density(q, q)))  # measured .969 +- .022 and 1.010 +- .007
    q = attitudes(law)
    narrower = ATTITUDES[name](3.0)
    assert one(np.exp(narrower.log_density(q, q) - law.log_density(q, q)))
    assert np.abs(ATTITUDES[name](0.0).log_density(q, q)).max() < 1e-15


@pytest.mark.parametrize("kappa", [0.3, 20.0, 1e5])
def test_densities_of_attitudes_integrate_to_one(kappa):
    mean, away = (1.0, 0.0, 0.0, 0.0), min(math.pi, 30.0 / math.sqrt(kappa))

    def fisher(angle):
        q = np.array([[math.cos(0.5 * angle)], [math.sin(0.5 * angle)], [0.0], [0.0]])
        density = math.exp(rm.Fisher(mean, kappa).log_density(q, q)[0])
        return density * (1.0 - math.cos(angle)) / math.pi

    def pointing(angle):
        q = np.array([[math.cos(0.5 * angle)], [math.sin(0.5 * angle)], [0.0], [0.0]])
        density = math.exp(rm.Pointing((0.0, 0.0, 1.0), kappa).log_density(q, q)[0])
        return 0.5 * density * math.sin(angle)

    for density in (fisher, pointing):
        total = integrate.quad(density, 0.0, away, epsabs=1e-12)[0]
        assert total == pytest.approx(1.0, abs=1e-9)  # measured 6e-11
