"""Results, scenes and bodies shown: in words, in pictures, as a page to turn, and as `ds.rigid`.

Every view reads a Dataset or a scene and changes neither. Reading order: `accessor` (`ds.rigid` and
notebooks), `descriptions` (scenes and bodies in words), `new_scene` (a first scene as text),
`summary` and `states` (a result in words, and as states in space), `lazy` (functions of arrays that
dask reads), `sample` (the members and times that pictures read), `ensemble` and `hemispheres` (the
pictures of a result), `sphere` and `surfaces` (what they are drawn on), `closed_forms`, `gibbs`,
`animation`, and `viewer` (a page that turns the body in a browser).

A new picture is a function of the Dataset and a line in PICTURES. Views know no study: those draw
themselves in `rigidmc/studies/*/picture.py`. Importing rigidmc imports no xarray, which takes 0.4
to 0.6 s (`python -X importtime -c "import xarray"`), and no matplotlib.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

from rigidmc.import_hook import Load, on_import

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


ACCESSOR = "rigidmc.views.accessor"


def register() -> None:
    """Register the accessor now if xarray is imported, otherwise as soon as it is; and tell a
    notebook how to show scenes and bodies."""
    if "IPython" in sys.modules:
        shell = sys.modules["IPython"].get_ipython()
        if shell is not None:
            import_module(ACCESSOR).install(shell)
    if "xarray" in sys.modules:
        import_module(ACCESSOR)
    else:
        on_import(("xarray",), _load_xarray)


def _load_xarray(module: ModuleType, load: Load) -> None:
    """Load xarray, then register the accessor."""
    load()
    import_module(ACCESSOR)
