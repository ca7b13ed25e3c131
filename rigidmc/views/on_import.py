"""`ds.rigid` on every Dataset once rigidmc and xarray are both imported, in either order.

Importing rigidmc does not import xarray, which takes 0.4 to 0.6 s (`python -X importtime -c "import
xarray"`).
"""

import sys
from importlib import import_module
from types import ModuleType

from rigidmc.import_hook import Load, on_import

ACCESSOR = "rigidmc.views.accessor"
NOTEBOOK = "rigidmc.views.accessor"


def register() -> None:
    """Register the accessor now if xarray is imported, otherwise as soon as it is; and tell a
    notebook how to show scenes and bodies."""
    if "IPython" in sys.modules:
        shell = sys.modules["IPython"].get_ipython()
        if shell is not None:
            import_module(NOTEBOOK).install(shell)
    if "xarray" in sys.modules:
        import_module(ACCESSOR)
    else:
        on_import(("xarray",), _load)


def _load(module: ModuleType, load: Load) -> None:
    """Load xarray, then register the accessor."""
    load()
    import_module(ACCESSOR)
