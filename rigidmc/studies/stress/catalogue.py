"""The catalogue of hard cases. A new group is one file in `groups` and one line below.

A group is a module with TITLE, its title, and cases(), which yields its `Case`s.
"""

from dataclasses import replace
from importlib import import_module
from types import ModuleType

from rigidmc.studies.stress.case import Case

_FILES = {  # {group: file in `groups`}
    "H1": "principal_axes",
    "H2": "dzhanibekov",
    "H3": "separatrix",
    "H4": "symmetric_limits",
    "H5": "plates_and_needles",
    "H6": "fast_spin",
    "H7": "heavy_tops",
    "H8": "scale",
    "H9": "many_steps",
    "H10": "integrable_tops",
    "H11": "chaos",
    "H12": "refusals",
    "H13": "attitude_errors",
    "H14": "damping",
    "H15": "published",
}
MODULES: dict[str, ModuleType] = {
    group: import_module(f"rigidmc.studies.stress.groups.{file}") for group, file in _FILES.items()
}
GROUPS: dict[str, str] = {group: module.TITLE for group, module in MODULES.items()}


def catalogue() -> list[Case]:
    """All cases, group by group."""
    return [
        replace(case, group=group) for group, module in MODULES.items() for case in module.cases()
    ]
