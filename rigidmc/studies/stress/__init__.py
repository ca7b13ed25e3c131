"""Hard cases: the error of each integrator, and how far a scene can be trusted.

A `HardCase` (`case`) is one motion, the reason why it is hard, the truth, and a function that
returns the error of an integrator. The cases are in three catalogues, `free_cases`, `heavy_cases`
and `numerical_cases`; `motions` and `truths` compute the errors, `problems` has published ends.
`hard_cases` compares each error with its bound in bounds.csv, in worker processes (`processes`).
`trust` runs checks on one scene of a user. `study` is the record of both, `table` prints and
`picture` draws both.

A measured bound is four times the error on one machine. Only a new measurement may increase it,
never the needs of a code change.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigidmc.studies.stress.case import HardCase

GROUPS = {  # {group: its title}
    "H1": "principal axes",
    "H2": "Dzhanibekov",
    "H3": "separatrix",
    "H4": "symmetric limits",
    "H5": "plates and needles",
    "H6": "fast spin",
    "H7": "heavy symmetric tops",
    "H8": "scale",
    "H9": "very many steps",
    "H10": "integrable and steady heavy tops",
    "H11": "chaos",
    "H12": "refused",
    "H13": "attitude errors",
    "H14": "damping",
    "H15": "published ends",
}


def catalogue() -> "list[HardCase]":
    """Return all cases, group by group."""
    from rigidmc.studies.stress import free_cases, heavy_cases, numerical_cases

    cases = {**free_cases.CASES, **heavy_cases.CASES, **numerical_cases.CASES}
    return [replace(case, group=group) for group in GROUPS for case in cases[group]()]
