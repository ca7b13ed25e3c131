"""Free motion on and beside the separatrix, where the modulus is 1 to rounding."""

import math
from collections.abc import Iterator

from rigidmc.studies.stress.case import Case, makes_steps
from rigidmc.studies.stress.motions import conserved, constant, tops
from rigidmc.studies.stress.problems import HARD
from rigidmc.studies.stress.truths import against_closed

TITLE = "separatrix"


def cases() -> Iterator[Case]:
    for word in ("separatrix", "separatrix_below", "separatrix_above", "near_middle_axis_13"):
        moments, momentum = HARD[word]
        yield Case(
            word.replace("_", " "),
            "the modulus is 1 to rounding: formulas with m, K(m) and inverse sines lose all"
            " digits, and errors grow as exp(0.6 t)",
            "closed form",
            against_closed(tops(moments, momentum), 12.0),
            quick=word == "separatrix",
        )
    near = tops((1.0, 2.0, 3.0), (1.0 - 1e-15, 1.0, math.sqrt(3.0)))
    yield Case(
        "invariants on the separatrix",
        "1e5 steps along the separatrix and back by the middle axis, on whichever side"
        " rounding takes them",
        "invariants",
        constant(near, 1e4, conserved, steps=100_000),
        claims=makes_steps,
    )
