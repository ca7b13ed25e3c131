"""A way of integrating a pilot, with its cost on this machine and its errors."""

from typing import NamedTuple

from rigidmc.planning.rates import Array
from rigidmc.planning.tolerance.deviation import upper_quantile


class Way(NamedTuple):
    """One way of integrating a pilot.

    steps : of the fastest member of the pilot;  mean_steps, dt : mean over its members;  turn : of
        steps of their own [rad], None if all have the same;  errors : {quantity: (members,)};  ns :
        time per member and step on one thread [ns]
    """

    integrator: str
    dtype: str
    steps: int
    mean_steps: float
    dt: float
    turn: float | None
    errors: dict[str, Array]
    ns: float

    @property
    def upper(self) -> float:
        """The error that 99 % of all members stay below, with 95 % certainty."""
        return upper_quantile(self.errors["state"])

    @property
    def step(self) -> str:
        """The length of a step, in words."""
        if self.integrator == "closed":
            return "at every save"
        if self.turn is None:
            return f"at dt = {self.dt:.4g} s ({self.steps:,} steps)"
        steps = f"{self.mean_steps:,.1f} steps in the mean, {self.steps:,} of the fastest member"
        return f"at turn = {self.turn:.4g} rad ({steps})"

    def with_precision(self) -> str:
        """The integrator, and its precision if that is not double."""
        return self.integrator + (" in float32" if self.dtype == "float32" else "")
