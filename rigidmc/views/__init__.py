"""Views of results, scenes and bodies: text, pictures, an interactive page, and `ds.rigid`.

Every view reads a Dataset or a scene and changes neither. Reading order: `accessor` (`ds.rigid` and
notebooks), `descriptions` (text on scenes and bodies), `new_scene` (a first scene as text),
`summary` (text on a result), `axes` and `states` (axes of a result, quantities from saved states),
`attitudes` (Euler angles of any sequence), `sample` (the members and times that pictures read),
`figures` (palette, and figures as files), `closed_motion` (states between the saves, where a closed
form covers the scene), `surfaces`, `sphere`, `quadric`, `caps` and `stage` (shapes, densities and
what to draw them on), `ensemble` and `globes` (pictures of an ensemble), `snapshots`,
`closed_forms`, `polhodes`, `poinsot`, `tops` and `phase_portraits` (pictures of a few bodies or
many), `gibbs`, `animation`, `html_page` (a page in one file), `web` (what pages share in the
browser), `viewer` (a page that replays the motion), and `live` (a page that computes it).

A new picture is a function of the Dataset and a line in PICTURES. Views do not import studies; each
study draws itself in `rigidmc/studies/*/picture.py`. Importing rigidmc imports neither xarray,
which takes 0.4 to 0.6 s (`python -X importtime -c "import xarray"`), nor matplotlib.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

from rigidmc.processes.import_hook import Load, on_import

# {name of the function: (its module, what it shows)}; modules are imported at first use, because
# they need matplotlib
PICTURES = {
    "summary": ("ensemble", "a body in motion, the ensemble against time, directions, drifts"),
    "snapshots": ("snapshots", "a typical body at eight instants of its motion"),
    "trajectory": ("tops", "the directions of body axis 3 in space"),
    "angles": ("tops", "the Euler angles against time, without their mean rates"),
    "phase_portrait": (
        "phase_portraits",
        "theta against its rate, or the components of omega of free bodies",
    ),
    "effective_potential": ("tops", "the potential of a heavy symmetric top, and energies"),
    "polhodes": (
        "polhodes",
        'the directions of the momentum in the body; surface="ellipsoid" draws omega instead, and'
        " energies=[...] polhodes of other energies",
    ),
    "poinsot": ("poinsot", "the inertia ellipsoid on the invariable plane, and the herpolhode"),
    "middle_component": ("ensemble", "omega about the axis of the middle moment against time"),
    "start_and_end": ("ensemble", "histograms of omega at the start and at the end"),
    "drift_histogram": ("ensemble", "histograms of the drifts of energy and |L|^2"),
}


def picture(name: str) -> Callable[..., Any]:
    """Return the function that draws one of PICTURES."""
    draw: Callable[..., Any] = getattr(import_module(f"rigidmc.views.{PICTURES[name][0]}"), name)
    return draw


ACCESSOR = "rigidmc.views.accessor"


def register() -> None:
    """Register the accessor as soon as xarray is imported, and install the HTML formatters for
    scenes and bodies in a notebook."""
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
