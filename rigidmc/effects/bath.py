"""Thermal noise: the body in a bath."""

import math
from typing import NamedTuple

from rigidmc.dynamics.so3 import expm1


class Bath(NamedTuple):
    """Friction and thermal noise of a bath of temperature T, which bring the law exp(-(T + V)/kT) of Gibbs.

        dL = -gamma L dt + sqrt(2 gamma kT I) dW

    Splittings of order 2 take it between two halves of the free motion (BAOAB), exactly over each step:
    L_i <- exp(-gamma h) L_i + sqrt(I_i kT (1 - exp(-2 gamma h))) n_i with normal n_i; averages are off by order h^2.
    Source: Leimkuhler & Matthews, Appl. Math. Res. Express 2013, 34; Davidchack, Ouldridge & Tretyakov, J. Chem. Phys. 142 (2015) 144114.

    gamma : rate at which the momentum forgets [1/s]
    kT : Boltzmann's constant times temperature [J]
    """

    gamma: float
    kT: float
    noise: tuple = (
        0.0,
        0.0,
        0.0,
    )  # three normal deviates, which the kernel puts there anew before each step

    units = {"gamma": "s-1", "kT": "J", "noise": "1"}
    shapes = {"noise": 3}
    hidden = ("noise",)
    limits = {"gamma": (0.0, math.inf), "kT": (0.0, math.inf), "noise": (0.0, 0.0)}
    example = (1.0, 0.7)
    stochastic = True
    isotropic = True

    def energy_scale(self, body):
        return (
            4.0 * self.kT
        )  # drifts are prepared for spins of 4 standard deviations, and right to 5e-12 at 8, where a member is flagged

    def shake(self, body, h, l):
        less = expm1(-self.gamma * h)
        spread = -self.kT * less * (2.0 + less)
        one, two, three = body.i2 * body.i3, body.i3 * body.i1, body.i1 * body.i2
        share = spread / (body.i1 * one)  # spread I_1 = share / (I_2 I_3): one division for three
        return (
            l[0] + less * l[0] + math.sqrt(share * one) * self.noise[0],
            l[1] + less * l[1] + math.sqrt(share * two) * self.noise[1],
            l[2] + less * l[2] + math.sqrt(share * three) * self.noise[2],
        )
