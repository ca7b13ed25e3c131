"""The score of the noise of a bath, which the likelihood ratio needs."""

from typing import NamedTuple

from rigidmc.physics.observables.protocol import Array, noise_sum


@noise_sum(
    of_noise=True,
    outputs={
        "gamma_score": ("s", "derivative of ln(density of the motion) by gamma of the bath", ()),
        "kT_score": ("J-1", "derivative of ln(density of the motion) by kT of the bath", ()),
    },
)
class NoiseScore(NamedTuple):
    """Derivatives of the log of the probability density of a motion in a bath, by gamma and kT.

    A step of length h draws L_i from a normal distribution with mean m_i = exp(-gamma h) l_i and
    variance s_i^2 = I_i kT (1 - exp(-2 gamma h)), with l the momentum before. The score of a
    parameter p is the sum over steps and components of the derivatives of its log density, with the
    normal deviates n_i = (L_i - m_i)/s_i::

        sum_i ((n_i^2 - 1) d ln s_i/dp + n_i (dm_i/dp)/s_i)

    For any quantity Y of the motion, ``d<Y>/dp = <Y score>``, also if Y jumps. The variance of the
    score of kT is 3/(2 kT^2) times the number of steps.
    Source: Glynn, Commun. ACM 33 (1990) 75.
    """

    def results(self, sums: Array) -> dict[str, Array]:
        """Return the scores from the sums (7, n) over the steps; see `noise_score` of the bath."""
        return {"gamma_score": sums[0], "kT_score": sums[1]}
