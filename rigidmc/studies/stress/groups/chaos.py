"""Chaotic tops: the bits must not depend on the blocks, and invariants must survive."""

from collections.abc import Iterator

import numpy as np

from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import GRAVITY, conserved, constant, random_tops, tops
from rigidmc.studies.stress.truths import same_bits

TITLE = "chaos"


def cases() -> Iterator[Case]:
    moments, momentum = random_tops(64, 2)
    random = np.random.default_rng(3)
    q = random.normal(size=(64, 4))
    attitude = q / np.linalg.norm(q, axis=1, keepdims=True)
    heavy = tops(moments, momentum, attitude, random.normal(0.0, 0.3, (64, 3)))
    yield Case(
        "same bits in any blocks, heavy",
        "errors grow exponentially: a single wrong bit would show",
        "the same run in other blocks",
        same_bits(heavy, 20.0),
        asked=0.0,
        effects=GRAVITY,
        claims=makes_steps,
        quick=True,
    )
    near = np.array([(1e-9, 2.0, 1e-9 * i) for i in range(64)])
    yield Case(
        "same bits in any blocks, by the separatrix",
        "errors grow exponentially: a single wrong bit would show",
        "the same run in other blocks",
        same_bits(tops(np.tile((1.0, 2.0, 3.0), (64, 1)), near), 40.0),
        asked=0.0,
        claims=makes_steps,
    )
    yield Case(
        "energy and L_z of 64 chaotic tops",
        "positions are lost, invariants must not be",
        "invariants",
        constant(heavy, 100.0, conserved),
        effects=GRAVITY,
        claims=makes_steps,
    )
