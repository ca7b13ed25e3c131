"""What a section asks for: "omega[1] = 0", or "every orbit"."""

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigidmc.effects import labelled
from rigidmc.effects.protocol import is_random
from rigidmc.errors import OptionError, SceneError, nearest
from rigidmc.scene.scene import Scene
from rigidmc.studies.components import Component, component_of

Array = NDArray[np.float64]
WAYS = ("rises", "falls", "both")
_CROSSING = re.compile(r"\s*(?P<of>[^=<>]+)=\s*(?P<value>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*")
_PERIOD = re.compile(r"\s*every\s+(?P<period>orbit|(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*(s\s*)?")
RULE = 'expected "NAME = NUMBER" or "NAME[3] = NUMBER", "every NUMBER" [s] or "every orbit"'


class Crossing(NamedTuple):
    """Where an observable, or a component of it, passes a value.  way : of WAYS"""

    of: Component
    value: float
    way: str

    def happens(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Whether levels, values less `value`, pass 0 between two saves."""
        up, down = (before < 0.0) & (after >= 0.0), (before > 0.0) & (after <= 0.0)
        found: NDArray[np.bool_] = {"rises": up, "falls": down, "both": up | down}[self.way]
        return found


def crossing_of(scene: Scene, at: str, way: str) -> Crossing:
    """The Crossing of a text; OptionError."""
    if way not in WAYS:
        raise OptionError("", "way", way, f"expected {', '.join(WAYS)}", nearest(way, WAYS))
    match = _CROSSING.fullmatch(at)
    if match is None or math.isinf(float(match["value"])):
        raise OptionError("", "at", at, RULE)
    if noisy := [label for label, effect in labelled(scene.effects) if is_random(effect)]:
        rule = "a path with noise is not known between saves: no section"
        raise SceneError("effects", noisy[0], None, rule)
    return Crossing(component_of(scene, match["of"], "at"), float(match["value"]), way)


def period_of(scene: Scene, at: str) -> float | None:
    """The time between two points of "every NUMBER" [s]; None for a crossing, or OptionError."""
    if (match := _PERIOD.fullmatch(at)) is None:
        return None
    word = match["period"]
    if word != "orbit":
        period = float(word)
        if not 0.0 < period < math.inf:
            raise OptionError("", "at", at, RULE)
        return period
    for label, effect in labelled(scene.effects):
        if label == "gravity_gradient":
            mu, distance = effect.mu, effect.distance
            if isinstance(mu, float) and isinstance(distance, float):
                return 2.0 * math.pi * math.sqrt(distance**3 / mu)
            rule = "members have orbits of their own: give a time"
            raise OptionError("", "at", at, rule)
    rule = "the scene has no gravity_gradient, and so no orbit"
    raise OptionError("", "at", at, rule)
