"""Operations counted in LLVM's code: of known formulas, and of steps as in their assembly.

The counts of the assembly are those of test_vectorisation.
"""

import math
from typing import NamedTuple

from rigidmc.engine.inspection import step_operations, torque_operations
from rigidmc.physics.effects import Gravity, ViscousDamping
from rigidmc.physics.integrators import INTEGRATORS, TurnBounds, scheme_of


class Known(NamedTuple):
    """Three products, a root, a quotient and a sum."""

    size: float

    def torque(self, l):
        return self.size * l[0], math.sqrt(self.size * l[1]), self.size * l[2] / l[0] + 1.0


def test_operations_of_a_torque():
    assert torque_operations(Known(2.0)) == (6, 1, 1, 0)
    assert torque_operations(ViscousDamping(0.1)) == (3, 0, 0, 0)
    assert torque_operations(Gravity(9.81)) == (27, 0, 0, 0)


def counted(name, effects=(), attitude=True):
    made = scheme_of(INTEGRATORS[name], TurnBounds(0.1, 0.1), effects)
    return step_operations(made, effects, attitude).all


def test_operations_of_a_step():
    assert counted("rk4") == 188  # as many as in the assembly
    # 293 in the assembly: fifteen products are the same in all steps
    assert counted("rk4", (Gravity(1.0),)) == 308
    assert counted("rk4", attitude=False) == 63
    assert abs(counted("exact") - 123) <= 8  # 135 in the assembly: here signs and sides are known
    assert abs(counted("strang") - 449) <= 8
    assert counted("strang", (Gravity(1.0),)) > counted("strang")
