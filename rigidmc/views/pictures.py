"""The pictures of a result by name. A new one is a function of the Dataset and one line below."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

# {name of the function: its module}; modules are imported when used, because they need matplotlib
PICTURES = {
    "summary": "rigidmc.views.ensemble",
    "momentum_sphere": "rigidmc.views.hemispheres",
    "axis_sphere": "rigidmc.views.hemispheres",
    "middle_component": "rigidmc.views.ensemble",
    "start_and_end": "rigidmc.views.ensemble",
    "drift_histogram": "rigidmc.views.ensemble",
}


def picture(name: str) -> Callable[..., Any]:
    """The function that draws one of PICTURES."""
    draw: Callable[..., Any] = getattr(import_module(PICTURES[name]), name)
    return draw
