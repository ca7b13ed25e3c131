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
    of the wheel: (records, 2 PIECES)}); without a wheel, the scene and {}.

    The pieces fit the readings by least squares.
    """
    if not records[0].wheel:
        return scene, {}
    curves = [_curve(record) for record in records]
    nodes = _nodes(curves)
    slopes = np.diff(np.eye(nodes.size), axis=0) / np.diff(nodes)[:, None]
    bends = 1e-8 * nodes[-1] * np.diff(slopes, axis=0)  # beyond a record, the line goes straight
    effects, inputs = list(scene.effects), dict[str, Array]()
    for i, axis in enumerate(np.eye(3)):
        lines = np.zeros((len(records), 2 * PIECES))
        for row, (t, momenta) in zip(lines, curves, strict=True):
            roofs = [np.interp(t, nodes, x) for x in np.eye(nodes.size)]
            system = np.concatenate([np.transpose(roofs), bends])
            wanted = np.append(momenta[i], np.zeros(len(bends)))
            heights = np.linalg.lstsq(system, wanted, rcond=None)[0]
            rates = slopes @ heights
            row[:] = *(heights[:-1] - rates * nodes[:-1]), *rates
        if lines.any():
            numbers = lines[0], nodes[:-1], axis
            effects.append(MeasuredWheel(*(tuple(x.tolist()) for x in numbers)))
            inputs[f"effects.{label_effects(effects)[-1][0]}.momenta"] = lines
    return scene.with_model(scene.model._replace(effects=tuple(effects))), inputs


def _curve(record: Record) -> tuple[Array, Array]:
    """Return times since the begin of a record (n,) and the momenta of its wheel (3, n)."""
    known, (begin, end) = record.wheel["t"], record.span
    t = np.unique([begin, *known[(known > begin) & (known < end)], end])
    return t - begin, np.stack([np.interp(t, known, x) for x in record.wheel["momenta"].T])


def _nodes(curves: Sequence[tuple[Array, Array]]) -> Array:
    """Return the ends of PIECES pieces, each where lines between the ends before are most wrong."""
    even = np.linspace(0.0, max(t[-1] for t, _ in curves), PIECES + 1)
    t = np.unique(np.concatenate([even, *(t for t, _ in curves)]))
    y = np.stack([np.interp(t, known, x) for known, momenta in curves for x in momenta])
    nodes, far = t[[0, -1]], 1e-9 * (np.abs(y).max() or 1.0) / t[-1]  # straight lines are halved
    while nodes.size <= PIECES:
        lines = [np.interp(t, nodes, np.interp(nodes, t, x)) for x in y]
        wrong = np.abs(y - lines).max(0) + far * np.abs(t - nodes[:, None]).min(0)
        nodes = np.sort(np.append(nodes, t[wrong.argmax()]))
    return nodes
