"""From a scene to rows for the kernel: the members of a block at their start."""

import numpy as np

from rigidmc.body import broken
from rigidmc.dynamics.euler import MassProperties
from rigidmc.effects import name_of
from rigidmc.engine import kernel
from rigidmc.sampling import draw


def stage(scene, first, count, carried):
    """(block, start): rows of `count` members as the kernel wants them, and what they were made from by the names of the result."""
    seed = scene.run.seed
    moments, mass, centre = scene.body.sample(seed, first, count)
    which, spin = scene.start.spin(seed, first, count)
    effects = [
        (f"{name_of(e)}_{field}", draw((value,), seed, f"effects.{name_of(e)}.{field}", first, count)[0])
        for e in scene.effects
        for field, value in zip(e._fields, e, strict=True)
    ]
    start = {"moments": moments, "mass": mass, "centre": centre, f"start_{which}": spin, **dict(effects)}
    block = np.zeros((kernel.EFFECTS + len(effects), count))
    block[kernel.ATTITUDE] = 1.0
    if carried:
        start["start_attitude"] = block[kernel.ATTITUDE : kernel.MOMENTUM] = scene.start.quaternions(seed, first, count)
        if scene.start.attitude != "uniform" and len(scene.start.attitude) == 3:
            start["start_euler"] = draw(scene.start.attitude, seed, "start.attitude", first, count)
    block[kernel.MOMENTUM : kernel.REST] = spin * moments if which == "omega" else spin
    bad = broken(moments) | ~(mass > 0)
    block[kernel.STATUS, bad] = kernel.STATUSES["invalid_body"]
    with np.errstate(all="ignore"):
        block[kernel.BODY : kernel.EFFECTS] = MassProperties.of(tuple(moments), tuple(mass * centre))
    for i, (_, values) in enumerate(effects):
        block[kernel.EFFECTS + i] = values
    return block, start
