"""How a step is made. An integrator is a NamedTuple with a method `step` and its facts; a new one is one class and one line below.

    step(self, [body, effects, t, h, q, l]) -> (q, l)

Facts: order, evaluations of the torque per step, reversible, conserves (free body), accepts (which torques).
Where the compiled form depends on the size of the step: prepared(self, turn, attitude) -> (integrator, pieces per step).
"""

from typing import Any

from rigidmc.integrators.exact import Exact
from rigidmc.integrators.lie import RKMK4
from rigidmc.integrators.rk4 import RK4
from rigidmc.integrators.splitting import Strang

INTEGRATORS: dict[str, Any] = {"rk4": RK4, "rkmk4": RKMK4, "strang": Strang, "exact": Exact}
