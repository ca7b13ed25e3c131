"""Published ends of named problems, see `rigidmc.studies.stress.problems`."""

from collections.abc import Iterator

from rigidmc.studies.stress.case import Case
from rigidmc.studies.stress.problems import PROBLEMS
from rigidmc.studies.stress.truths import against_end

TITLE = "published ends"


def cases() -> Iterator[Case]:
    for word in ("nasa_brick", "toms903_step", "hairer_free", "hairer_heavy", "cardona_top"):
        problem = PROBLEMS[word]
        yield Case(
            word.replace("_", " "),
            "a published result, at 34 digits where sources agree",
            problem.source.split(";")[0],
            against_end(problem),
            effects=problem.effects,
            quick=word in ("hairer_heavy", "nasa_brick"),
        )
