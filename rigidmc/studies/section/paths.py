"""The motion of members between two saves of a run, by steps of rk8 that check themselves."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigidmc.engine.compiler.trees import numbers_of
from rigidmc.engine.formulas import Moved, evaluate
from rigidmc.engine.inspection import refuse_memory
from rigidmc.engine.kernel import layout
from rigidmc.errors import OptionError
from rigidmc.physics.dynamics.euler import MassProperties
from rigidmc.physics.effects.protocol import blank, parameter_count
from rigidmc.physics.integrators import INTEGRATORS
from rigidmc.physics.observables.protocol import size
from rigidmc.planning.initial import block_rows, initial_block_of, make_sampler
from rigidmc.planning.steps import rates
from rigidmc.scene.scene import Scene

Array = NDArray[np.float64]
# rad: a step of rk8 of this length is 1e-13 off, so that a section costs no digits of the run
ARC = 0.2
AGREED = 1e-11  # steps and steps of half their length: attitude [rad], and momentum of its size
FAIR = 1e-7  # steps that still differ by more, however short, are not believed
HALVINGS = 8
MOST = 2**20  # steps between two saves: seconds of computing for each point


class Paths:
    """What members do after states that a run has saved, each on its way to the next save.

    Steps turn a member by ARC at most, at the rate that its energy and the effects admit
    (`rigidmc.planning.steps.rates`), and are no longer than those of the run, which knows how fast
    torques change in time. Then they are halved until halving changes no state at the next save.
    The steps of a path depend on itself alone, and so do its bits.

    spans : from each state to the next save [s]
    sure : whether the steps of a path agree with steps of half their length within FAIR
    """

    def __init__(
        self,
        scene: Scene,
        members: NDArray[np.int64],
        observed: Mapping[str, Any],
        start: Array,
        m: NDArray[np.intp],
        times: Array,
        spans: Array,
        dt: float,
        threads: int | None,
    ) -> None:
        """start, m, times : states (7, n), places among `members`, and times of the saves [s]
        dt : the longest step [s], inf if members have steps of their own
        """
        refuse_memory(scene.effects)
        rows = block_rows(scene.effects, False)
        known = make_sampler(scene.model, scene.run), members, True, rows
        block, _ = initial_block_of(scene.model, *known)
        end = layout.EFFECTS + parameter_count(*scene.effects)
        table = block[layout.BODY : end].T
        observables = tuple(observed.values())
        fixed = np.array(numbers_of(observables))
        fixed = np.broadcast_to(fixed, (len(table), fixed.size))
        self._table = np.concatenate([table, fixed], axis=1)
        self._kind = Moved(
            MassProperties(*[0.0] * 9), blank(scene.effects), observables, INTEGRATORS["rk8"],
            0.0, 0.0, (0.0,) * 4, (0.0,) * 3,
        )  # fmt: skip
        self._width = 7 + sum(size(one.dims) for one in observables)
        self._start, self._m, self._times, self._threads = start, m, times, threads
        self.spans = spans
        at = block[:, m]
        at[layout.ATTITUDE : layout.REST] = start
        rate = rates(scene.effects, at)
        turns = rate * spans
        # what a member that moves at its rate has at least, for those that come to rest at a save
        self._size = rate / at[layout.BODY : layout.BODY + 3].max(axis=0)
        arc = min(ARC, scene.run.turn or ARC)
        steps = np.maximum(np.nan_to_num(turns) / arc, spans / dt * (1.0 - 1e-9))
        if steps.max(initial=0.0) > MOST:
            rule = f"between two saves a member turns by {turns.max():.3g} rad: save more often"
            raise OptionError("", "every", None, rule)
        self._steps = np.maximum(1, np.ceil(steps)).astype(int)
        self.sure = np.ones(m.size, bool)
        self._settle()

    def after(self, h: Array, which: NDArray[np.intp]) -> Array:
        """What `Moved.values` gives h after the states `which`."""
        count, now = self._steps[which], self._times[which]
        values = np.concatenate([self._start[:, which], np.empty((self._width - 7, h.size))])
        for done in range(count.max(initial=0)):
            left = np.flatnonzero(count > done)
            step = h[left] / count[left]
            columns = np.concatenate([now[None, left], step[None], values[:7, left]])
            rows = self._m[which][left]
            values[:, left] = evaluate(
                self._kind, self._width, columns, self._table, rows, self._threads
            )
            now[left] += step
        return values

    def _settle(self) -> None:
        """Halve steps until halving changes nothing at the next save; note where it always does."""
        left = np.arange(self._m.size)
        coarse, before = self.after(self.spans, left), np.full(left.size, np.inf)
        for _ in range(HALVINGS):
            self._steps[left] *= 2
            fine = self.after(self.spans[left], left)
            off = _apart(coarse, fine, self._size[left])
            self.sure[left] = off <= FAIR
            # agreed, or rounding: shorter steps are no better, and the longer ones are enough
            done = (off <= AGREED) | ((off <= FAIR) & (off > 0.5 * before))
            self._steps[left[done]] //= 2
            left, coarse, before = left[~done], fine[:, ~done], off[~done]
            if left.size == 0:
                return


def _apart(one: Array, two: Array, size: Array) -> Array:
    """How far states (7, ...) are apart: attitudes [rad], momenta of the largest of the two and
    `size`; inf for nan."""
    turned = 2.0 * np.linalg.norm(one[:4] - two[:4], axis=0)
    sizes = np.maximum(np.linalg.norm(one[4:7], axis=0), np.linalg.norm(two[4:7], axis=0))
    sizes = np.maximum(sizes, size)
    # a body at rest under nothing: no momentum differs, in any unit
    pushed = np.linalg.norm(one[4:7] - two[4:7], axis=0) / np.where(sizes > 0.0, sizes, 1.0)
    apart: Array = np.nan_to_num(np.maximum(turned, pushed), nan=np.inf)
    return apart
