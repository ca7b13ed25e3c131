"""A wheel whose momentum is measured beside the motion: a known input of a fit.

With it, rates show the whole tensor, and not ratios of moments alone.
Method: arXiv 2503.13137 (a reaction wheel in a body that is thrown).
"""

from collections.abc import Sequence

import numpy as np

from rigidmc.physics.effects import label_effects
from rigidmc.physics.effects.rotor import PIECES, MeasuredWheel
from rigidmc.scene.scene import Scene
from rigidmc.studies.fit.records import Record
from rigidmc.studies.fit.streams import Array


def with_wheel(scene: Scene, records: Sequence[Record]) -> tuple[Scene, dict[str, Array]]:
    """Return (the scene with a wheel for each axis along which records have a momentum, {momenta
    of the wheel: (records, PIECES + 1)}); without a wheel, the scene and {}.

    The pieces fit the readings by least squares.
    """
    if not records[0].wheel:
        return scene, {}
    spans = [record.span[1] - record.span[0] for record in records]
    nodes = np.linspace(0.0, max(spans), PIECES + 1)
    bends = 1e-6 * np.diff(np.eye(PIECES + 1), 2, axis=0)  # beyond a record, the line goes straight
    effects, inputs = list(scene.effects), dict[str, Array]()
    for axis in np.eye(3):
        heights = np.zeros((len(records), PIECES + 1))
        for row, span, record in zip(heights, spans, records, strict=True):
            t = np.linspace(0.0, span, 8 * PIECES + 1)
            roofs = np.maximum(0.0, 1.0 - np.abs(t[:, None] - nodes) / nodes[1])
            momenta = record.wheel["momenta"] @ axis
            curve = np.interp(t + record.span[0], record.wheel["t"], momenta)
            wanted = np.concatenate([curve, np.zeros(len(bends))])
            row[:] = np.linalg.lstsq(np.concatenate([roofs, bends]), wanted, rcond=None)[0]
        if heights.any():
            numbers = heights[0], nodes[:-1], axis
            effects.append(MeasuredWheel(*(tuple(x.tolist()) for x in numbers)))
            inputs[f"effects.{label_effects(effects)[-1][0]}.momenta"] = heights
    return scene.with_model(scene.model._replace(effects=tuple(effects))), inputs
