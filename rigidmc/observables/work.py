"""What effects have done to a body: the ledger of their work."""

from typing import NamedTuple

from rigidmc.observables.protocol import observable


@observable(units="J", long_name="work of an effect since t = 0", dims=("effect",))
class Work(NamedTuple):
    """The work of each effect since t = 0, W = integral of torque . omega dt, TdC (3.16), (3.34).

    dE/dt is the power of the effects without an energy. Saving the work makes the kernel integrate
    it beside L, to the order of the integrator (4 by srkn11), and book it: E - E(0) less the work
    of the effects without an energy is then a drift like any other. The attribute `booked` of the
    variable names those effects.
    """

    def value(self, works):
        return works
