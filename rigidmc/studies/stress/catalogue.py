"""The catalogue of hard cases. A new group is one file in `groups` and one line below.

A group is a module with TITLE, its title, and cases(), which yields its `Case`s.
"""

from dataclasses import replace
from types import ModuleType

from rigidmc.studies.stress.case import Case
from rigidmc.studies.stress.groups import (
    attitude_errors,
    chaos,
    damping,
    dzhanibekov,
    fast_spin,
    heavy_tops,
    integrable_tops,
    many_steps,
    plates_and_needles,
    principal_axes,
    published,
    refusals,
    scale,
    separatrix,
    symmetric_limits,
)

MODULES: dict[str, ModuleType] = {
    "H1": principal_axes,
    "H2": dzhanibekov,
    "H3": separatrix,
    "H4": symmetric_limits,
    "H5": plates_and_needles,
    "H6": fast_spin,
    "H7": heavy_tops,
    "H8": scale,
    "H9": many_steps,
    "H10": integrable_tops,
    "H11": chaos,
    "H12": refusals,
    "H13": attitude_errors,
    "H14": damping,
    "H15": published,
}
GROUPS: dict[str, str] = {group: module.TITLE for group, module in MODULES.items()}


def catalogue() -> list[Case]:
    """All cases, group by group."""
    return [
        replace(case, group=group) for group, module in MODULES.items() for case in module.cases()
    ]
