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
    from rigidmc.studies.stress.case import CaseGroup, HardCase


def groups() -> "dict[str, CaseGroup]":
    """Return the groups of hard cases by name, in the order of their numbers."""
    from rigidmc.studies.stress import case, free_cases, heavy_cases, numerical_cases  # noqa: F401

    return dict(sorted(case.GROUPS.items(), key=lambda item: int(item[0][1:])))


def catalogue() -> "list[HardCase]":
    """Return all cases, group by group."""
    named = groups().items()
    return [replace(case, group=name) for name, group in named for case in group.cases()]
