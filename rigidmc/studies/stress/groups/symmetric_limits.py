"""Bodies with equal and nearly equal moments, where formulas change their form."""

from collections.abc import Iterator

import numpy as np

from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import tops
from rigidmc.studies.stress.truths import against_closed, over_members

TITLE = "symmetric limits"

MOMENTUM = (0.3, 0.2, 0.1)
BODIES = {
    "sphere": (1.0, 1.0, 1.0),
    "oblate": (1.0, 1.0, 2.0),
    "prolate": (1.0, 2.0, 2.0),
    "symmetric about 2": (1.0, 0.6, 1.0),
}


def cases() -> Iterator[Case]:
    for word, moments in BODIES.items():
        yield Case(
            word,
            "two equal moments: a coefficient of Euler's equations vanishes, and formulas"
            " must not divide by it",
            "closed form",
            against_closed(tops(moments, MOMENTUM), 50.0),
        )
    for split in (1e-4, 1e-8, 1e-12, 1e-15):
        for word, moments in (
            ("I1 = I2", (1.0, 1.0 + split, 2.0)),
            ("I2 = I3", (1.0, 2.0, 2.0 * (1.0 + split))),
        ):
            yield Case(
                f"{word} to {split:g}",
                "between the symmetric and the asymmetric formulas: neither may jump where"
                " the other begins",
                "closed form",
                against_closed(tops(moments, MOMENTUM), 50.0),
            )
    splits = (0.0, 1e-15, 3e-15, 1e-14)
    for word, at in (("I1 = I2", 1), ("I2 = I3", 2)):
        base = (1.0, 1.0, 2.0) if at == 1 else (1.0, 2.0, 2.0)
        rows = np.array([[x * (1.0 + s * (i == at)) for i, x in enumerate(base)] for s in splits])
        yield Case(
            f"continuous across {word}",
            "bodies that differ by a rounding must move alike: a formula that switches at"
            " equality shows here",
            "the symmetric body",
            over_members(tops(rows, MOMENTUM), 20.0),
            asked=1e-12,
            claims=makes_steps,
        )
