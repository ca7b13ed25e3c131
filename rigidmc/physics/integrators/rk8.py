"""Runge-Kutta of order 8."""

from typing import NamedTuple

from rigidmc.physics.dynamics.euler import scaled
from rigidmc.physics.dynamics.so3 import add_compensated, add_compensated4, axpy, axpy4, value_of
from rigidmc.physics.effects.sums import state_rates

# Coefficients of the 12-stage method of DOP853, without the columns of zeros; `step` shows which
# stages a row belongs to.
_A2 = (0.05260015195876773,)
_A3 = (0.0197250569845379, 0.0591751709536137)
_A4 = (0.02958758547680685, 0.08876275643042054)
_A5 = (0.2413651341592667, -0.8845494793282861, 0.924834003261792)
_A6 = (0.037037037037037035, 0.17082860872947386, 0.12546768756682242)
_A7 = (0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125)
_A8 = (
    0.03709200011850479, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
    0.008273789163814023,
)  # fmt: skip
_A9 = (
    0.6241109587160757, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
    20.154067550477894, -43.48988418106996,
)  # fmt: skip
_A10 = (
    0.47766253643826434, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
    15.279233632882423, -33.28821096898486, -0.020331201708508627,
)  # fmt: skip
_A11 = (
    -0.9371424300859873, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
    -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
)  # fmt: skip
_A12 = (
    2.273310147516538, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
    27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
    0.6433927460157636,
)  # fmt: skip
_B = (
    0.054293734116568765, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
    0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
)  # fmt: skip


def linear_combination(y, a, k):
    """Return (q, L) plus the changes k, each times its coefficient a."""
    if len(k) == 0:
        return y
    # Each row is a chain of fused multiply-adds that begins with y: no product stands alone.
    return linear_combination((axpy4(y[0], a[0], k[0][0]), axpy(y[1], a[0], k[0][1])), a[1:], k[1:])


def rates_at_stage(fixed, c, a, k):
    """Return (h dq/dt, h dL/dt) at c of a step, where the changes k times their coefficients lead.

    fixed : (q, L) at the start, Rates of the body over h, effects, body, t, h
    """
    start, rates, effects, body, t, h = fixed
    q, l = linear_combination(start, a, k)
    return state_rates(rates, effects, body, t + c * h, h, q, l)


class RK8(NamedTuple):
    """Runge-Kutta of order 8 with 12 stages, on quaternion and L; the quaternion is normalised.

    For any torque. The cheapest integrator for errors of 1e-4 and less, except for fast tops and
    long integrations (`python -m bench accuracy`). Energy and |L|^2 drift as h^9 t.
    Source: Dormand & Prince, in Hairer, Norsett & Wanner, Solving ODEs I (1993), II.5, the method
    of order 8 of DOP853.
    """

    order = 8
    slips = True
    has_many_stages = True
    evaluations = 12
    is_reversible = False
    conserves = ()
    accepts = "any torque"
    compensated = True

    def interleaving(self) -> int:
        return 2

    def step(self, body, effects, t, h, q, l):
        state, momentum = q, l
        q, l = value_of(q), value_of(l)
        start, rates = (q, l), scaled(body, h)
        fixed = start, rates, effects, body, t, h
        # Written out: 20 of the 78 coefficients are 0 and cost no operation.
        k1 = state_rates(rates, effects, body, t, h, q, l)
        k2 = rates_at_stage(fixed, 0.05260015195876773, _A2, (k1,))
        k3 = rates_at_stage(fixed, 0.0789002279381516, _A3, (k1, k2))
        k4 = rates_at_stage(fixed, 0.1183503419072274, _A4, (k1, k3))
        k5 = rates_at_stage(fixed, 0.2816496580927726, _A5, (k1, k3, k4))
        k6 = rates_at_stage(fixed, 0.3333333333333333, _A6, (k1, k4, k5))
        k7 = rates_at_stage(fixed, 0.25, _A7, (k1, k4, k5, k6))
        k8 = rates_at_stage(fixed, 0.3076923076923077, _A8, (k1, k4, k5, k6, k7))
        k9 = rates_at_stage(fixed, 0.6512820512820513, _A9, (k1, k4, k5, k6, k7, k8))
        k10 = rates_at_stage(fixed, 0.6, _A10, (k1, k4, k5, k6, k7, k8, k9))
        k11 = rates_at_stage(fixed, 0.8571428571428571, _A11, (k1, k4, k5, k6, k7, k8, k9, k10))
        k12 = rates_at_stage(fixed, 1.0, _A12, (k1, k4, k5, k6, k7, k8, k9, k10, k11))
        dq, dl = linear_combination(
            ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), _B, (k1, k6, k7, k8, k9, k10, k11, k12)
        )
        return add_compensated4(state, dq), add_compensated(momentum, dl)


INTEGRATORS = {"rk8": RK8()}
