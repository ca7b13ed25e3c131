"""The physical model of a scene: body, effects and start."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from rigidmc.physics.effects.protocol import is_effect, numbers
from rigidmc.scene.body import Body
from rigidmc.scene.quantities import Grid
from rigidmc.scene.start import Start
from rigidmc.scene.validation import PILOT
from rigidmc.scene.vector_distributions.protocol import VectorDistribution

Change = Callable[[Any], Any]


class Model(NamedTuple):
    """Body, effects and start, without the run settings: the input of planning and kernels.

    effects : in the order in which they act
    """

    body: Body
    effects: tuple[Any, ...]
    start: Start

    def quantities(self) -> tuple[Any, ...]:
        """Return all numbers, distributions, grids and arrays, which may differ between members."""
        parameters = (value for effect in self.effects for _, _, value in numbers(effect))
        return (*self.body.quantities(), *self.start.quantities(), *parameters)

    def mapped(self, change: Change) -> "Model":
        """Return the model with change(quantity) in place of each quantity."""
        parts = {
            key: _mapped(getattr(self.body, key), change) for key in ("moments", "mass", "centre")
        }
        start, which = self.start, self.start.spin_name
        starts = {which: _mapped(getattr(start, which), change)}
        if not isinstance(start.attitude, str):
            starts["attitude"] = _mapped(start.attitude, change)
        return Model(
            replace(self.body, **parts),
            tuple(_mapped(effect, change) for effect in self.effects),
            replace(start, **starts),
        )

    def coarse(self) -> "Model":
        """Return the model with coarser grids, so that its first PILOT members cover their whole
        range; the model itself if it has no grids."""
        strides = sorted({q.stride for q in self.quantities() if isinstance(q, Grid)})
        if not strides:
            return self
        count = max(1, int(PILOT ** (1.0 / len(strides)) + 1e-9))
        coarser = {stride: count**i for i, stride in enumerate(strides)}

        def change(q: Any) -> Any:
            return replace(q, count=count, stride=coarser[q.stride]) if isinstance(q, Grid) else q

        return self.mapped(change)


def _mapped(value: Any, change: Change) -> Any:
    """Apply `change` to a quantity, or to each quantity of a distribution, an effect or a tuple."""
    if isinstance(value, VectorDistribution):
        return replace(value, **{k: _mapped(v, change) for k, v in value.as_dict().items()})
    if isinstance(value, tuple):
        parts = [_mapped(x, change) for x in value]
        return type(value)(*parts) if is_effect(value) else tuple(parts)
    return change(value)
