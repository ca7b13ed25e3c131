"""Thermal noise: the body in a bath."""

import math
from typing import NamedTuple

from rigidmc.physics.dynamics.so3 import expm1, root
from rigidmc.physics.effects.protocol import Number, Vector, effect


@effect(
    units={"gamma": "s-1", "kT": "J", "noise": "1"},
    shapes={"noise": 3},
    limits={"gamma": (0.0, math.inf), "kT": (0.0, math.inf), "noise": (0.0, 0.0)},
    hidden=("noise",),
    example=(1.0, 0.7),
    is_random=True,
    isotropic=True,
)
class Bath(NamedTuple):
    """Friction and noise of a heat bath, which lead to the Gibbs distribution exp(-(T + V)/kT).

    Change of the momentum::

        dL = -gamma L dt + sqrt(2 gamma kT I) dW

    Splittings of order 2 apply it between two halves of the free motion (BAOAB). Its flow is exact:
    L_i <- exp(-gamma h) L_i + sqrt(I_i kT (1 - exp(-2 gamma h))) n_i with normal deviates n_i.
    Averages have an error of order h^2.
    Source: Leimkuhler & Matthews, Appl. Math. Res. Express 2013, 34; Davidchack, Ouldridge &
    Tretyakov, J. Chem. Phys. 142 (2015) 144114.

    Parameters
    ----------
    gamma : quantity [1/s]
        rate of decay of the momentum
    kT : quantity [J]
        Boltzmann's constant times temperature
    noise : floats (3,), optional
        the normal deviates of a step; the engine fills them in, a scene leaves them out

    Examples
    --------
    >>> bath = rm.Bath(gamma=1.0, kT=0.5)
    >>> start = rm.Start(momentum=rm.GibbsMomentum(kT=0.5))
    >>> scene = rm.Scene(rm.Body.from_moments((1.0, 2.0, 2.5)), bath, start)
    """

    gamma: Number
    kT: Number
    noise: Vector = (0.0, 0.0, 0.0)  # normal deviates; the engine draws new ones for each step

    def energy_scale(self, body):
        # The spin at 4 standard deviations. Drifts prepared for it have errors of 5e-12 at 8
        # standard deviations, where a member is flagged.
        return 4.0 * self.kT

    def add_noise(self, body, h, l):
        decay = expm1(-self.gamma * h)
        # 1 - exp(-2x) = -less (2 + less) without cancellation, less = exp(-x) - 1.
        variance = -self.kT * decay * (2.0 + decay)
        one, two, three = body.i2 * body.i3, body.i3 * body.i1, body.i1 * body.i2
        scaled = variance / (
            body.i1 * one
        )  # spread I_1 = share / (I_2 I_3): one division for three
        return (
            l[0] + decay * l[0] + root(scaled * one) * self.noise[0],
            l[1] + decay * l[1] + root(scaled * two) * self.noise[1],
            l[2] + decay * l[2] + root(scaled * three) * self.noise[2],
        )

    def noise_score(self, body, h, l):
        decay = expm1(-self.gamma * h)
        left = 1.0 + decay
        spread = -decay * (2.0 + decay)  # variances are I_i kT times this
        x, y, z = self.noise
        squares = x * x + y * y + z * z - 3.0
        # d ln(deviation)/d gamma = h left^2/spread; the mean left L_i changes by -h left L_i
        unit = 1.0 / (self.kT * spread)
        pulled = (
            root(body.i1 * unit) * l[0] * x
            + root(body.i2 * unit) * l[1] * y
            + root(body.i3 * unit) * l[2] * z
        )
        by_gamma = h * left * (squares * left / spread - pulled)
        return by_gamma, 0.5 * squares / self.kT
