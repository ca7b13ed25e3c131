"""What a program computes: the choices in a scene that decide its code, and its derivatives."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from rigidmc.engine.compiler.frozen import frozen
from rigidmc.engine.compiler.kernels import config
from rigidmc.engine.inspection import scalar_parts
from rigidmc.physics.dynamics.methods import OFF, Flag, implements
from rigidmc.physics.effects.present import memories_of, states_of
from rigidmc.physics.integrators.protocol import StepScheme, has_extra_state


class Derivatives(NamedTuple):
    """The derivatives that a block has besides its rows.

    at_once : derivatives of each number that one pass through the steps computes, 0 for none
    passes : passes; a block has rows for at_once * passes derivatives
    of_body, of_effects : whether derivatives of bodies and of the parameters of effects may be
        other than 0
    """

    at_once: int = 0
    passes: int = 1
    of_body: bool = True
    of_effects: bool = True

    def one_by_one(self) -> "Derivatives":
        """Return the same derivatives, each in a pass of its own."""
        if not self.at_once:
            return self
        return self._replace(at_once=1, passes=self.at_once * self.passes)


NO_DERIVATIVES = Derivatives()


class ProgramSpec(NamedTuple):
    """What a program computes.

    scheme : a StepScheme, see `rigidmc.physics.integrators.protocol`
    effects : blank effects
    observables : recorded at save times
    attitude : whether the attitude is integrated
    compensated : whether sums keep their remainders
    dtype : of the numbers in steps
    limits : () if only non-finite members are flagged; else the largest drift of energy (relative
        to the energies in play), of |L|^2 (relative to the start) and of L_z (relative to the
        largest |L| that the energies allow), |omega| h [rad], and ||q|^2 - 1|; inf where a scene
        has no such conservation law
    works : () if no works are saved; else for each effect OFF if its energy accounts for its work,
        ON if not, see `rigidmc.physics.effects.sums`
    events, running, growth : monitored quantities: compiled events; pairs (running observable,
        `static_count` of the numbers of its state); ON to record the growth of a tangent
    nodes : monitored states per step, by dense output except for the last; 0 to monitor only the
        states after steps
    paired : whether a step uses the noise of two steps of half its length, to follow their path as
        closely as possible; all members have the same steps
    shortens : whether some steps have another length
    axes : whether observables and events are of axes other than the principal axes, see
        `rigidmc.physics.dynamics.body_axes`
    derivatives : the derivatives that a block has
    """

    scheme: StepScheme
    effects: Sequence[Any] = ()
    observables: Sequence[Any] = ()
    attitude: bool = True
    compensated: bool = False
    dtype: DTypeLike = "float64"
    limits: Sequence[float] = ()
    works: Sequence[Any] = ()
    events: Sequence[Any] = ()
    running: Sequence[Any] = ()
    growth: Flag = OFF
    nodes: int = 0
    paired: bool = False
    shortens: bool = False
    axes: bool = False
    derivatives: Derivatives = NO_DERIVATIVES

    @property
    def trailing(self) -> int:
        """How many numbers follow L: states of effects, saved works and memories."""
        effects = tuple(self.effects)
        return len(states_of(effects)) + len(self.works) + len(memories_of(effects))

    def settled(self) -> "ProgramSpec":
        """Return it with tuples of frozen classes, and with the integrator that is compiled."""
        scheme, compensated = self.scheme, self.compensated
        scheme = scheme._replace(integrator=frozen(scheme.integrator))
        # An integrator with extra state compensates its rounding there.
        compensated = compensated and not has_extra_state(scheme.integrator)
        # ScaledRK4 keeps w in place of L, opened by row 0; with remainders it is RK4, which has no
        # opening.
        if compensated and implements(scheme.integrator, "with_compensation"):
            scheme = scheme._replace(
                integrator=frozen(scheme.integrator.with_compensation()),
                substeps=scheme.substeps * (np.arange(len(scheme.substeps)) > 0)[:, None],
            )
        fixed = ("effects", "observables", "events", "running")
        return self._replace(
            scheme=scheme, compensated=compensated, dtype=np.dtype(self.dtype).name,
            limits=tuple(self.limits),
            **{name: frozen(tuple(getattr(self, name))) for name in fixed},
        )  # fmt: skip

    @property
    def is_monitored(self) -> bool:
        """Whether anything is monitored over the steps."""
        return bool(self.events or self.running)

    def is_scalar(self) -> bool:
        """Return whether members go one at a time: a custom class branches on their numbers."""
        monitors = *self.observables, *self.events, *(one for one, _ in self.running)
        parts = scalar_parts(self.scheme.integrator, self.effects, monitors)
        return bool(config.DISABLE_JIT or parts)
