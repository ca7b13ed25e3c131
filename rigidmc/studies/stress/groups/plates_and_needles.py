"""Bodies at the edge of the triangle inequality, and bodies with moments far apart."""

from collections.abc import Iterator

from rigidmc.studies.stress.case import Case
from rigidmc.studies.stress.motions import tops
from rigidmc.studies.stress.problems import HARD
from rigidmc.studies.stress.truths import against_closed

TITLE = "plates and needles"

WHY = {
    "flat_plate": "I3 = I1 + I2 to rounding, the edge of the triangle inequality",
    "flat_disc": "flat and symmetric at once",
    "needle": "moments 1e6 apart: a step is short for one axis and long for the others",
    "needle_on_edge": "spin across a needle, 1e-7 along it",
    "rod": "moments 1e9 apart",
}


def cases() -> Iterator[Case]:
    for word, why in WHY.items():
        moments, momentum = HARD[word]
        yield Case(
            word.replace("_", " "),
            why,
            "closed form",
            against_closed(tops(moments, momentum), 10.0),
            quick=word == "needle",
        )
