"""What effects have done to a body: the ledger of their work."""

from typing import NamedTuple


class Work(NamedTuple):
    """The work of each effect since t = 0, W = integral of torque . omega dt, TdC (3.16), (3.34); dE/dt is that of effects without an energy.

    Saving it makes the kernel integrate it beside L, to the order of the integrator (4 by srkn11), and book it: E - E(0) less the work of the
    effects without an energy (the attribute `booked` of the variable names them) is then a drift like any other.
    """

    units, long_name, dims = "J", "work of an effect since t = 0", ("effect",)

    def value(self, works):
        return works
